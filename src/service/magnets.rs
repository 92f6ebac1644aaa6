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
use crate::hall::map::{Finder, Live, Seen, Verdict, WHOLE};
use crate::mode::Mode;
use crate::service::adaptation::torque_nm;
use crate::storage::map::Known;
use crate::telemetry::{Measurement, Status};
use core::f32::consts::TAU;

/// Most pole pairs of a rotor whose pole is looked for.
pub const POLES: usize = 32;
/// Verdicts in a row against a map that is in effect that end it.
const DOUBTS: u8 = 3;
/// Times that a map is dropped until it is not looked for any more.
const DROPS: u8 = 3;
/// Of the share in a millisecond: all of it in a tenth of a second.
const RISE: i32 = WHOLE.div_euclid(100) + 1;

/// How the map is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Use {
    /// There is none, or it is being learnt.
    #[default]
    None,
    /// Its pole is not known: looked for while the motor runs.
    Searching,
    /// In effect.
    Used,
    /// It did not fit, again and again: another rotor, or Halls that were moved.
    Foreign,
}

/// A map, and what it is used for.
#[derive(Debug)]
pub struct Magnets {
    live: &'static Live,
    known: Option<Known>,
    finder: Finder<POLES>,
    state: Use,
    /// Where the map begins, the count of turns that this holds in, and the share that is in effect.
    pole: i32,
    count: u32,
    share: i32,
    doubts: u8,
    drops: u8,
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
            live,
            known: None,
            finder: Finder::new(),
            state: Use::None,
            pole: 0,
            count: 0,
            share: 0,
            doubts: 0,
            drops: 0,
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
        self.drops = 0;
        self.known = known;
        if let Some(known) = &self.known {
            self.live.load(&known.map);
        }
        self.search();
        if let Some(count) = learnt_in.filter(|&count| known.is_some() && count == self.live.count()) {
            (self.state, self.pole, self.count) = (Use::Used, 0, count);
        }
    }

    /// The map is not used any more, as while another is learnt.
    pub fn suspend(&mut self) {
        self.live.end();
        (self.state, self.share) = (Use::None, 0);
    }

    /// Looks for the pole.
    pub fn search(&mut self) {
        self.live.end();
        let fits = self.known.is_some_and(|known| usize::from(known.map.pole_pairs()) <= POLES);
        self.state = if fits { Use::Searching } else { Use::None };
        (self.share, self.doubts) = (0, 0);
        (self.verdict, self.verdicts) = (None, 0);
        self.finder = Finder::new();
    }

    /// Once a millisecond, with the drive's state: raises or ends the map's effect.
    pub fn tick(&mut self, status: Status) {
        self.two_halls = status.limits().contains(Limits::TWO_HALLS);
        let lost = self.two_halls || self.count != self.live.count();
        match self.state {
            Use::Used if lost => self.search(),
            Use::Used if self.doubts >= DOUBTS => self.leave(),
            Use::Used if self.share < WHOLE => self.set_share(self.share + RISE),
            _ => {}
        }
        if status.mode() != Mode::Running {
            self.torque_nm = 0.0;
        }
    }

    fn leave(&mut self) {
        self.set_share(self.share - RISE);
        if self.share == 0 {
            self.drops += 1;
            self.search();
            if self.drops >= DROPS {
                self.state = Use::Foreign;
            }
        }
    }

    fn set_share(&mut self, share: i32) {
        self.share = share.clamp(0, WHOLE);
        self.live.use_from(self.pole, self.count, self.share);
    }

    /// Takes a measurement of a drive that runs on all three Halls.
    #[inline(never)]
    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        let torque_nm = torque_nm(measurement, control);
        let mean_nm = 0.5 * (torque_nm + core::mem::replace(&mut self.torque_nm, torque_nm));
        if self.two_halls || !matches!(self.state, Use::Searching | Use::Used) {
            return;
        }
        if self.state == Use::Searching && self.count != self.live.count() {
            self.search();
            self.count = self.live.count();
        }
        let Some(known) = &self.known else { return };
        let scale = &control.scale;
        let turns_s2 = mean_nm / control.motor.inertia_kgm2 * scale.pole_pairs / TAU;
        let rotor = &measurement.rotor;
        let taken_off = known.map.error_from(self.pole, rotor.position()).to_bits() / WHOLE * self.share;
        let seen = Seen {
            measured: Position::from_bits(rotor.position().to_bits() + i64::from(taken_off)),
            speed: rotor.speed(),
            sequence: measurement.sequence,
            driven: turns_s2 / (scale.step_hz * scale.step_hz),
        };
        let used = (self.state == Use::Used).then_some(self.pole);
        if let Some(verdict) = self.finder.push(&known.map, known.noise_deg, used, &seen) {
            self.judge(&verdict);
        }
    }

    fn judge(&mut self, verdict: &Verdict) {
        self.verdict = Some(*verdict);
        self.verdicts = self.verdicts.saturating_add(1);
        if self.state == Use::Used {
            self.doubts = if verdict.misfit { self.doubts.saturating_add(1) } else { 0 };
            return;
        }
        if verdict.sure {
            (self.state, self.pole, self.doubts) = (Use::Used, verdict.electrical_turns, 0);
        }
    }

    /// How it is.
    pub const fn state(&self) -> Use {
        self.state
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
        self.live
    }
}
