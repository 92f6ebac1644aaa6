//! The [map](crate::hall::map) of the magnets at a drive: found after power-up, put into effect, watched, and dropped
//! when it does not fit.
//!
//! The pole is looked for in two ways: by the [signature](Signature) of the magnets, at any speed and with the bridge off,
//! and, while the motor runs with its currents controlled, by a [`Finder`]. When one of them is sure, the map is put into
//! effect over a tenth of a second. From then on every turn is asked whether another pole, or no map, would fit better: three
//! answers in a row that say so end it, and the search begins again. A map that was dropped three times is not this
//! rotor's. The signature answers, as what it says does not depend on how the rotor is shaken; the finder where a map was
//! stored without one, or where it tells nothing, as all poles are alike.

use crate::angle::{PolePairs, Position};
use crate::control::config::Config as Control;
use crate::fault::Limits;
use crate::hall::map::{Collector, Finder, Seen, Signature, Verdict};
use crate::hall::model::Model;
use crate::mode::Mode;
use crate::service::adaptation::torque_nm;
use crate::storage::map::Known;
use crate::telemetry::{Measurement, Record, Status};
pub use crate::turn::Use;
use crate::turn::{Effect, Live, WHOLE};
use core::f32::consts::TAU;

/// Most pole pairs of a rotor whose pole is looked for by its motion.
pub const POLES: usize = 32;

/// A map, and what it is used for.
#[derive(Debug)]
pub struct Magnets {
    effect: Effect,
    known: Option<Known>,
    finder: Finder<POLES>,
    collector: Collector,
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
            collector: Collector::OFF,
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
        self.known = known.map(|known| Known { signature: known.signature.filter(Signature::tells), ..known });
        if let Some(known) = &self.known {
            self.live().load(known.map.table());
        }
        let findable = self.known.is_some_and(|known| moves_tell(&known) || known.signature.is_some());
        self.effect.renew(findable, learnt_in.filter(|_| self.known.is_some()));
        self.begin();
    }

    /// Another map is learnt: this one is not used any more, and the magnets' signature is collected.
    pub fn learn(&mut self, pole_pairs: PolePairs) {
        self.suspend();
        self.collector.begin(pole_pairs);
    }

    fn suspend(&mut self) {
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
        self.collector = Collector::OFF;
        if let Some(pole_pairs) = self.known.and_then(|known| PolePairs::new(known.map.pole_pairs())) {
            self.collector.begin(pole_pairs);
        }
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

    /// Takes a record of a drive with the model of its Halls.
    #[inline(never)]
    pub fn record(&mut self, record: &Record, model: &Model) {
        let tracked = matches!(record.status.mode(), Mode::Ready | Mode::Running) && record.missed == 0;
        if !tracked || record.status.limits().contains(Limits::TWO_HALLS) || self.begins_anew() {
            return;
        }
        self.collector.push(model, &record.codes, record.rotor.position());
        if matches!(self.state(), Use::Searching | Use::Used)
            && let Some(Known { map, signature: Some(signature), .. }) = &self.known
            && let Some(verdict) = self.collector.judge(signature, map, self.effect.used())
        {
            self.judge(&verdict);
        }
    }

    /// Whether the drive counts its turns anew, so that the search begins anew.
    fn begins_anew(&mut self) -> bool {
        let anew = self.state() == Use::Searching && self.effect.is_lost();
        if anew {
            self.search();
        }
        anew
    }

    /// Takes a measurement of a drive that runs on all three Halls.
    #[inline(never)]
    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        let torque_nm = torque_nm(measurement, control);
        let mean_nm = 0.5 * (torque_nm + core::mem::replace(&mut self.torque_nm, torque_nm));
        if self.two_halls || !matches!(self.state(), Use::Searching | Use::Used) {
            return;
        }
        self.begins_anew();
        let Some(known) = self.known.as_ref().filter(|known| moves_tell(known)) else { return };
        if self.state() == Use::Used && known.signature.is_some() {
            return;
        }
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

    /// What was collected of the magnets since the learning began, once it is a whole turn.
    pub fn signature(&self) -> Option<Signature> {
        self.collector.signature()
    }

    /// What the magnets are known to differ by at each Hall, share of the amplitude RMS.
    pub fn unevenness(&self) -> Option<[f32; 3]> {
        self.known.as_ref().and_then(|known| known.signature.as_ref()).map(Signature::rms)
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

/// Whether a pole of this map can be found by the rotor's motion.
fn moves_tell(known: &Known) -> bool {
    usize::from(known.map.pole_pairs()) <= POLES
}
