//! The [map](crate::hall::map) of the magnets at a drive: found after power-up, put into effect, watched, and dropped
//! when it does not fit.
//!
//! While the motor runs with its currents controlled, a [`Finder`] looks for the pole. When it is sure, the map is put
//! into effect over a tenth of a second. From then on every turn is asked whether another pole, or no map, would leave
//! less: three turns in a row that say so end it, and the search begins again. A map that was dropped three times is
//! not this rotor's.

use crate::angle::Position;
use crate::control::config::Config as Control;
use crate::fault::Limits;
use crate::hall::map::{Finder, Seen, Verdict};
use crate::mode::Mode;
use crate::service::adaptation::torque_nm;
use crate::storage::map::Known;
use crate::telemetry::{Measurement, Status};
pub use crate::turn::Use;
use crate::turn::{Effect, Live, WHOLE};
use core::f32::consts::TAU;

/// Most pole pairs of a rotor whose pole is looked for.
pub const POLES: usize = 32;

/// A map, and what it is used for.
#[derive(Debug)]
pub struct Magnets {
    effect: Effect,
    known: Option<Known>,
    finder: Finder<POLES>,
    /// The last verdict, and how many there were since the search began.
    verdict: Option<Verdict>,
    verdicts: u32,
    /// Torque at the last measurement, N·m.
    torque_nm: f32,
    /// Whether a Hall is lost: the map is that of three.
    two_halls: bool,
}

impl Magnets {
    /// Without a map.
    pub const fn new(live: &'static Live) -> Self {
        Self {
            effect: Effect::new(live),
            known: None,
            finder: Finder::new(),
            verdict: None,
            verdicts: 0,
            torque_nm: 0.0,
            two_halls: false,
        }
    }

    /// Takes over a map, or none. One that was just learnt begins at position zero of this count of turns; otherwise
    /// its pole is looked for.
    pub fn set(&mut self, known: Option<Known>, learnt_in: Option<u32>) {
        self.suspend();
        self.known = known;
        if let Some(known) = &self.known {
            self.live().load(known.map.table());
        }
        let findable = self.known.is_some_and(|known| usize::from(known.map.pole_pairs()) <= POLES);
        self.effect.renew(findable, learnt_in.filter(|_| self.known.is_some()));
        self.begin();
    }

    /// The map is not used any more, as while another is learnt.
    pub fn suspend(&mut self) {
        self.effect.suspend();
    }

    /// Looks for the pole.
    pub fn search(&mut self) {
        self.effect.search();
        self.begin();
    }

    /// Nothing is known of the pole.
    fn begin(&mut self) {
        (self.verdict, self.verdicts) = (None, 0);
        self.finder = Finder::new();
    }

    /// Once a millisecond, with the drive's state: raises or ends the map's effect.
    pub fn tick(&mut self, status: Status) {
        self.two_halls = status.limits().contains(Limits::TWO_HALLS);
        if self.effect.tick(self.two_halls, true) {
            self.begin();
        }
        if status.mode() != Mode::Running {
            self.torque_nm = 0.0;
        }
    }

    /// Takes a measurement of a drive that runs on all three Halls.
    #[inline(never)]
    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        let torque_nm = torque_nm(measurement, control);
        let mean_nm = 0.5 * (torque_nm + core::mem::replace(&mut self.torque_nm, torque_nm));
        if self.two_halls || !matches!(self.state(), Use::Searching | Use::Used) {
            return;
        }
        if self.state() == Use::Searching && self.effect.is_lost() {
            self.search();
        }
        let Some(known) = &self.known else { return };
        let scale = &control.scale;
        let turns_s2 = mean_nm / control.motor.inertia_kgm2 * scale.pole_pairs / TAU;
        let rotor = &measurement.rotor;
        let (pole, share) = self.effect.share();
        let taken_off = known.map.error_from(pole, rotor.position()).to_bits() / WHOLE * share;
        let seen = Seen {
            measured: Position::from_bits(rotor.position().to_bits() + i64::from(taken_off)),
            speed: rotor.speed(),
            sequence: measurement.sequence,
            driven: turns_s2 / (scale.step_hz * scale.step_hz),
        };
        let used = self.effect.used();
        if let Some(verdict) = self.finder.push(&known.map, known.noise_deg, used, &seen) {
            self.judge(&verdict);
        }
    }

    fn judge(&mut self, verdict: &Verdict) {
        self.verdict = Some(*verdict);
        self.verdicts = self.verdicts.saturating_add(1);
        self.effect.judge(verdict.sure.then_some(verdict.electrical_turns), verdict.misfit);
    }

    /// How it is.
    pub const fn state(&self) -> Use {
        self.effect.state()
    }

    /// The map.
    pub const fn known(&self) -> Option<&Known> {
        self.known.as_ref()
    }

    /// What the last mechanical turn has shown.
    pub const fn verdict(&self) -> Option<&Verdict> {
        self.verdict.as_ref()
    }

    /// Mechanical turns since the search began.
    pub const fn verdicts(&self) -> u32 {
        self.verdicts
    }

    /// The map that the interrupt reads.
    pub const fn live(&self) -> &'static Live {
        self.effect.live()
    }
}
