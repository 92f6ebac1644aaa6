//! The cogging that differs [from pole to pole](crate::control::cogging::by_pole) at a drive: it is learnt with the rest of
//! it, its table's pole is found after power-up, it is put into effect, watched, and dropped when it does not fit.
//!
//! Whenever the motor turns by four whole mechanical turns one way with its currents controlled, a [`Finder`] tells the
//! pole, if it is sure; then the table is put into effect over a tenth of a second. From then on it is asked every eight
//! turns whether another pole, or no table, would fit better: three answers in a row that say so end it. A table that
//! was dropped three times is not this rotor's.

use crate::angle::PolePairs;
use crate::control::cogging::by_pole::{Finder, Learner, Taken, Waves};
use crate::control::config::Config as Control;
use crate::service::magnets::POLES;
use crate::telemetry::Measurement;
use crate::turn::{Effect, Live, Table, Use};

/// A table, and what it is used for.
#[derive(Debug)]
pub struct ByPole {
    effect: Effect,
    table: Option<Table>,
    taken: Taken,
    finder: Finder<POLES>,
    /// The learner's own, as a table may be in use, and watched, while another is learnt.
    taken_meanwhile: Taken,
    learner: Learner,
    /// The count of turns in which it began to learn.
    begun_in: u32,
}

impl ByPole {
    /// Without a table.
    pub const fn new(live: &'static Live) -> Self {
        Self {
            effect: Effect::new(live),
            table: None,
            taken: Taken::NONE,
            finder: Finder::new(),
            taken_meanwhile: Taken::NONE,
            learner: Learner::NONE,
            begun_in: 0,
        }
    }

    /// Begins to learn, with a [`Learning`](super::learning::Learning) that begins.
    pub fn begin(&mut self, pole_pairs: PolePairs) {
        self.learner.begin(pole_pairs);
        self.begun_in = self.live().count();
    }

    /// Learns from a measurement, while the rotor turns in the [direction](super::learning::Learning::direction) of the
    /// learning.
    pub fn learn(&mut self, direction: Option<bool>, measurement: &Measurement, control: &Control) {
        let taken = self.taken_meanwhile.take(measurement, control);
        if let (Some((position, current)), Some(forward)) = (taken, direction) {
            self.learner.push(forward, position, current);
        }
    }

    /// What was learnt; with [`Self::use_learnt`] the drive uses it.
    pub fn learnt(&self) -> Waves {
        self.learner.waves().unwrap_or_default()
    }

    /// Uses what was learnt, from position zero of the count of turns in which the learning began.
    pub fn use_learnt(&mut self, table: Option<Table>) {
        self.take_over(table, Some(self.begun_in));
    }

    /// Takes over a table, or none, whose pole is to be found.
    pub fn set(&mut self, table: Option<Table>) {
        self.take_over(table, None);
    }

    #[inline(never)]
    fn take_over(&mut self, table: Option<Table>, learnt_in: Option<u32>) {
        self.effect.suspend();
        self.table = table;
        if let Some(table) = &self.table {
            self.effect.live().load(table);
        }
        let findable = self.table.as_ref().is_some_and(|table| usize::from(table.pole_pairs()) <= POLES);
        self.effect.renew(findable, learnt_in.filter(|_| self.table.is_some()));
        self.finder = Finder::new();
    }

    /// Once a millisecond: raises the table's effect, or ends it where it is not `wanted`.
    pub fn tick(&mut self, wanted: bool) {
        if self.effect.tick(false, wanted) {
            self.finder = Finder::new();
        }
    }

    /// Takes a measurement of a drive that runs.
    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        let Some(table) = &self.table else { return };
        match self.state() {
            Use::Searching if self.effect.is_lost() => {
                self.effect.search();
                self.finder = Finder::new();
            }
            Use::Searching | Use::Used => {}
            Use::None | Use::Foreign => return,
        }
        let Some((position, current)) = self.taken.take(measurement, control) else { return };
        if let Some(verdict) = self.finder.push(table, self.effect.used(), position, current) {
            self.effect.judge(verdict.sure.then_some(verdict.electrical_turns), verdict.misfit);
        }
    }

    /// The table.
    pub const fn table(&self) -> Option<&Table> {
        self.table.as_ref()
    }

    /// The pole in use: electrical turns from the table's begin at position zero.
    pub fn pole(&self) -> Option<i32> {
        self.effect.used()
    }

    /// Pole pairs of the table's rotor, where there is one.
    pub fn pole_pairs(&self) -> Option<u8> {
        self.table.as_ref().map(Table::pole_pairs)
    }

    /// How it is.
    pub const fn state(&self) -> Use {
        self.effect.state()
    }

    /// The table that the interrupt reads.
    pub const fn live(&self) -> &'static Live {
        self.effect.live()
    }
}
