//! The map: its record, and what is told of it.

use crate::storage::{Sensors, Storage};
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use hallservo::config::Config;
use hallservo::control::Config as Control;
use hallservo::drive::Drive;
use hallservo::hall::map::Live;
use hallservo::service::magnets::Magnets;
use hallservo::service::mapping::Mapping;
use hallservo::service::procedure::Error;
use hallservo::settings::Settings;
use hallservo::storage::map::{Known, fingerprint};
use hallservo::telemetry::{Measurement, Status};
use hallservo_protocol::{
    Answer, MagnetsRefusal, MagnetsReport, MagnetsStatus, POINTS_AT_ONCE, Problem, Procedure, Refusal,
};

/// What is static of a map.
pub(crate) struct MagnetMemory {
    live: Live,
    magnets: MaybeUninit<Magnets>,
}

impl MagnetMemory {
    pub const fn new() -> Self {
        Self { live: Live::new(), magnets: MaybeUninit::uninit() }
    }
}

/// What the control interrupt reads.
pub(crate) struct ForDrive(&'static Live);

impl ForDrive {
    pub const fn attach(self, drive: Drive) -> Drive {
        drive.with_map(self.0)
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
}

impl MagnetMap {
    pub fn start(memory: &'static mut MagnetMemory) -> (Self, ForDrive) {
        let MagnetMemory { live, magnets } = memory;
        let live: &'static Live = live;
        let magnets = magnets.write(Magnets::new(live));
        let map = Self { magnets, learning: Procedure::None, begun_in: 0, problem: Problem::Blank, unsaved: false };
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

    pub fn measurement(&mut self, measurement: &Measurement, control: &Control) {
        self.magnets.measurement(measurement, control);
    }

    pub fn tick(&mut self, status: Status) {
        self.magnets.tick(status);
    }

    /// The drive works with these settings now.
    pub fn adopt(&mut self, settings: &Settings) {
        let Some(known) = self.magnets.known() else { return };
        if known.map.pole_pairs() != settings.pole_pairs {
            self.forget();
        } else if known.reversed != settings.reversed {
            let mut known = *known;
            known.direct(settings.reversed);
            self.magnets.set(Some(known), None);
        }
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

    /// A learning begins.
    pub fn begin(&mut self) {
        self.learning = Procedure::Running;
        self.begun_in = self.magnets.live().count();
        self.magnets.suspend();
    }

    /// It has come to a map, which is kept if it is worth more than noise.
    #[inline(never)]
    pub fn learnt(&mut self, mapping: &Mapping, sensors: &Sensors, config: &Config) {
        let Some(map) = mapping.map() else { return self.failed(Error::Inconclusive) };
        let calibration = fingerprint(&sensors.calibrated);
        let known = Known { map, noise_deg: mapping.noise_deg(), calibration, reversed: config.is_reversed() };
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

    pub fn status(&self, learns: bool, config: &Config) -> MagnetsStatus {
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

fn report(known: &Known, config: &Config) -> MagnetsReport {
    let without_deg = known.map.rms_deg();
    let with_deg = known.noise_deg * config.tracked_noise();
    MagnetsReport { without_deg, with_deg, kept: without_deg > with_deg, found_again: known.map.is_told() }
}
