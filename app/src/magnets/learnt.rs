//! The map, its record and what is told of it; beside it, the cogging that differs from pole to pole.

use crate::storage::{Sensors, Storage};
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use hallservo::angle::PolePairs;
use hallservo::config::Config;
use hallservo::control::Config as Control;
use hallservo::control::cogging::by_pole::Waves;
use hallservo::drive::Drive;
use hallservo::service::by_pole::ByPole;
use hallservo::service::magnets::Magnets;
use hallservo::service::mapping::Mapping;
use hallservo::service::procedure::Error;
use hallservo::settings::Settings;
use hallservo::storage::map::{Known, fingerprint};
use hallservo::telemetry::{Measurement, Record, Status};
use hallservo::turn::Live;
use hallservo_protocol::{
    Answer, CoggingByPole, MagnetsRefusal, MagnetsReport, MagnetsStatus, POINTS_AT_ONCE, Problem, Procedure, Refusal,
};

/// What is static of a map, and of the cogging by pole.
pub(crate) struct MagnetMemory {
    live: [Live; 2],
    magnets: MaybeUninit<Magnets>,
    cogging: MaybeUninit<ByPole>,
}

impl MagnetMemory {
    pub const fn new() -> Self {
        Self { live: [const { Live::new() }; 2], magnets: MaybeUninit::uninit(), cogging: MaybeUninit::uninit() }
    }
}

/// What the control interrupt reads.
pub(crate) struct ForDrive(&'static [Live; 2]);

impl ForDrive {
    pub const fn attach(self, drive: Drive) -> Drive {
        let [map, cogging] = self.0;
        drive.with_map(map).with_cogging(cogging)
    }
}

/// The tasks' side of a map.
pub(crate) struct MagnetMap {
    magnets: &'static mut Magnets,
    learning: Procedure<MagnetsReport>,
    /// The count of turns in which the learning began.
    begun_in: u32,
    problem: Problem,
    unsaved: bool,
    cogging: &'static mut ByPole,
    /// Counting the way the settings say: whether that is reversed.
    by_pole: Waves,
    reversed: bool,
}

impl MagnetMap {
    pub fn start(memory: &'static mut MagnetMemory) -> (Self, ForDrive) {
        let MagnetMemory { live, magnets, cogging } = memory;
        let live: &'static [Live; 2] = live;
        let map = Self {
            magnets: magnets.write(Magnets::new(&live[0])),
            learning: Procedure::None,
            begun_in: 0,
            problem: Problem::Blank,
            unsaved: false,
            cogging: cogging.write(ByPole::new(&live[1])),
            by_pole: Waves::NONE,
            reversed: false,
        };
        (map, ForDrive(live))
    }

    /// Takes what the flash holds, if it is of this calibration and of so many pole pairs.
    #[inline(never)]
    pub fn restore<F: NorFlash>(
        &mut self,
        storage: &mut Storage<F>,
        sensors: Option<&Sensors>,
        settings: &Settings,
    ) -> Problem {
        let known = storage.map().and_then(|known| {
            let fits = sensors.is_some_and(|sensors| fingerprint(&sensors.calibrated) == known.calibration)
                && known.map.pole_pairs() == settings.pole_pairs;
            if fits { Ok(known) } else { Err(Problem::Foreign) }
        });
        self.problem = known.as_ref().err().copied().unwrap_or_default();
        if let Ok(mut known) = known {
            known.direct(settings.reversed);
            self.magnets.set(Some(known), None);
        }
        self.problem
    }

    /// Takes what the flash holds of the cogging that differs from pole to pole.
    #[inline(never)]
    pub fn restore_by_pole(&mut self, by_pole: Waves, settings: &Settings) {
        self.set_by_pole(by_pole, settings);
    }

    /// The cogging begins to be learnt.
    pub fn begin_by_pole(&mut self, settings: &Settings) {
        self.cogging.begin(pole_pairs(settings));
    }

    /// It is learnt from a measurement.
    pub fn learn_by_pole(&mut self, direction: Option<bool>, measurement: &Measurement, control: &Control) {
        self.cogging.learn(direction, measurement, control);
    }

    /// It has been learnt.
    #[inline(never)]
    pub fn learnt_by_pole(&mut self, settings: &Settings) {
        (self.by_pole, self.reversed) = (self.cogging.learnt(), settings.reversed);
        self.cogging.use_learnt(self.by_pole.table(pole_pairs(settings)));
    }

    fn set_by_pole(&mut self, by_pole: Waves, settings: &Settings) {
        (self.by_pole, self.reversed) = (by_pole, settings.reversed);
        self.cogging.set(self.by_pole.table(pole_pairs(settings)));
    }

    /// The cogging that differs from pole to pole.
    pub const fn by_pole(&self) -> &Waves {
        &self.by_pole
    }

    /// The current for it, A RMS.
    pub fn by_pole_a(&self, full_scale_a: f32) -> f32 {
        self.by_pole.rms() / 32_768.0 * full_scale_a
    }

    pub fn record(&mut self, record: &Record, sensors: &Sensors) {
        self.magnets.record(record, &sensors.model);
    }

    /// What the magnets are known to differ by at each Hall, share of the amplitude RMS.
    pub fn unevenness(&self) -> Option<[f32; 3]> {
        self.magnets.unevenness()
    }

    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        self.magnets.measurement(measurement, control);
        self.cogging.measurement(measurement, control);
    }

    pub fn tick(&mut self, status: Status, anti_cogging: bool) {
        self.magnets.tick(status);
        self.cogging.tick(anti_cogging);
    }

    /// The drive works with these settings now. The map of so many pole pairs that the flash holds comes back.
    pub fn adopt<F: NorFlash>(&mut self, storage: &mut Storage<F>, sensors: Option<&Sensors>, settings: &Settings) {
        if self.cogging.pole_pairs().is_some_and(|pairs| pairs != settings.pole_pairs) {
            self.set_by_pole(Waves::NONE, settings);
        } else if self.reversed != settings.reversed {
            self.set_by_pole(self.by_pole.reversed(), settings);
        }
        let Some(known) = self.magnets.known() else {
            if self.problem == Problem::Foreign
                && !self.unsaved
                && self.restore(storage, sensors, settings) == Problem::None
            {
                self.set_by_pole(storage.by_pole(settings), settings);
            }
            return;
        };
        if known.map.pole_pairs() != settings.pole_pairs {
            // Other pole pairs may be a trial.
            self.magnets.set(None, None);
            (self.unsaved, self.problem) = (false, Problem::Foreign);
        } else if known.reversed != settings.reversed {
            let mut known = *known;
            known.direct(settings.reversed);
            self.magnets.set(Some(known), None);
        }
    }

    /// The sensors are being calibrated: the map of the calibration before is not used meanwhile, and stays in the flash.
    pub fn set_aside(&mut self) {
        self.unsaved = false;
        self.magnets.set(None, None);
    }

    /// The map is given up, in the flash as well.
    pub fn forget(&mut self) {
        self.unsaved |= self.magnets.known().is_some() || self.problem != Problem::Blank;
        self.magnets.set(None, None);
    }

    pub const fn is_settled(&self) -> bool {
        !self.unsaved
    }

    /// Saves the map, or that there is none, where the flash does not hold it.
    pub fn save<F: NorFlash>(&mut self, storage: &mut Storage<F>) -> Option<Result<(), Problem>> {
        if !core::mem::take(&mut self.unsaved) {
            return None;
        }
        let known = self.magnets.known();
        let saved = storage.save_map(known);
        let held = if known.is_some() { Problem::None } else { Problem::Blank };
        self.problem = saved.err().unwrap_or(held);
        Some(saved)
    }

    /// A learning of the map begins.
    pub fn begin(&mut self, settings: &Settings) {
        self.learning = Procedure::Running;
        self.begun_in = self.magnets.live().count();
        self.magnets.learn(pole_pairs(settings));
    }

    /// It has come to a map, which is kept if it is worth more than noise.
    #[inline(never)]
    pub fn learnt(&mut self, mapping: &Mapping, sensors: &Sensors, config: &Config) {
        let Some(map) = mapping.map() else { return self.failed(Error::Inconclusive) };
        let calibration = fingerprint(&sensors.calibrated);
        let (signature, reversed) = (self.magnets.signature(), config.is_reversed());
        let map = signature.map_or(map, |signature| map.aligned(&signature, &sensors.model));
        let known = Known { map, signature, noise_deg: mapping.noise_deg(), calibration, reversed };
        let report = report(&known, config);
        self.learning = Procedure::Done(report);
        if report.kept {
            self.magnets.set(Some(known), Some(self.begun_in));
            self.unsaved = true;
        } else {
            self.forget();
        }
    }

    /// It has come to nothing: the map before is looked for again.
    pub fn failed(&mut self, error: Error) {
        self.learning = Procedure::Failed(error);
        self.magnets.search();
    }

    pub fn status(&self, learns: bool, config: &Config, full_scale_a: f32) -> MagnetsStatus {
        let known = self.magnets.known();
        let verdict = self.magnets.verdict();
        MagnetsStatus {
            state: self.magnets.state(),
            pole_pairs: known.map_or(0, |known| known.map.pole_pairs()),
            report: known.map(|known| report(known, config)).unwrap_or_default(),
            learning: if learns { Procedure::Running } else { self.learning },
            turns: self.magnets.verdicts(),
            fit: verdict.map_or(f32::NAN, |verdict| verdict.fit),
            left_deg: verdict.map_or(f32::NAN, |verdict| verdict.left_deg),
            stored: if self.unsaved { Problem::Blank } else { self.problem },
            cogging: CoggingByPole { state: self.cogging.state(), rms_a: self.by_pole_a(full_scale_a) },
        }
    }

    /// Some points of the map, from a number on.
    pub fn points(&self, first: u16) -> Result<Answer<'static>, Refusal<'static>> {
        let known = self.magnets.known().ok_or(Refusal::Magnets(MagnetsRefusal::None))?;
        let rest = known.map.points().iter().skip(first.into());
        let mut points = [0; POINTS_AT_ONCE];
        points.iter_mut().zip(rest).for_each(|(place, point)| *place = *point);
        Ok(Answer::MagnetPoints(points))
    }
}

fn pole_pairs(settings: &Settings) -> PolePairs {
    PolePairs::new(settings.pole_pairs).unwrap_or(PolePairs::ONE)
}

fn report(known: &Known, config: &Config) -> MagnetsReport {
    let without_deg = known.map.rms_deg();
    let with_deg = known.noise_deg * config.tracked_noise();
    MagnetsReport { without_deg, with_deg, kept: without_deg > with_deg, found_again: known.map.is_told() }
}
