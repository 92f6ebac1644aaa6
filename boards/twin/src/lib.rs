//! A drive and its motor, period by period, exactly alike on the chip and on the host.
//!
//! The physics is f64 by soft-float on the chip, the control code integers and f32: nothing in it rounds differently on
//! the two. So a run is a function of its settings and of the periods in which commands arrive, and a digest of all
//! codes and outputs tells whether the machines agree to the bit.
#![no_std]

mod digest;
mod figures;
pub mod log;

pub use digest::Digest;
pub use figures::Figures;

use hallservo::board::{Output, Sample};
use hallservo::config::Config;
use hallservo::drive::{Drive, Interrupt};
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use plant::{Legs, Plant, PlantParameters};

/// Seed of the motor, its imperfections and its noise.
const SEED: u64 = 1;

/// Periods between two checkpoints: a run of which the machines disagree differs first within these.
pub const CHECKPOINT: u32 = 4000;

/// The settings of the run: the default, but for a calibration in a quarter of the time.
pub fn settings() -> Settings {
    Settings { calibration_align_s: 0.1, calibration_turns: 8, calibration_hz: 20.0, ..Settings::default() }
}

/// A drive at its motor.
pub struct Twin {
    plant: Plant,
    drive: Drive,
    config: Config,
    digest: Digest,
    periods: u32,
    installed: Option<u32>,
    figures: Figures,
}

impl Twin {
    /// Both at rest; the drive takes its commands from the other end of `channels`. `None` if the plant refuses its own
    /// parameters.
    pub fn new(config: Config, channels: Interrupt) -> Option<Self> {
        let mut plant = Plant::new(&PlantParameters::imperfect(SEED), SEED).ok()?;
        plant.place(0.3, 0.0).ok()?;
        let drive = Drive::new(config, channels);
        Some(Self {
            plant,
            drive,
            config,
            digest: Digest::default(),
            periods: 0,
            installed: None,
            figures: Figures::new(config.pole_pairs),
        })
    }

    /// What the converters deliver at the beginning of a period.
    pub fn sample(&mut self) -> Sample {
        Sample { halls: self.plant.sample().halls, ..Sample::default() }
    }

    /// The drive, whose step comes between [`Self::sample`] and [`Self::actuate`].
    pub fn drive(&mut self) -> &mut Drive {
        &mut self.drive
    }

    /// Lets the output act for a period.
    pub fn actuate(&mut self, sample: &Sample, output: &Output) {
        self.digest.push(&sample.halls);
        self.digest.push(&output.compare);
        self.digest.push(&[output.legs.bits().into()]);
        if self.drive.estimator().is_some() && self.installed.is_none() {
            self.installed = Some(self.periods);
        }
        if self.drive.mode() == Mode::Running {
            self.figures.push(&self.drive, sample, &self.plant.truth());
        }
        self.plant.advance(&legs(output, self.config.period));
        self.periods += 1;
    }

    /// How well the drive did while it ran.
    pub fn figures(&self) -> &Figures {
        &self.figures
    }

    /// The period in which the drive got its calibration.
    pub fn installed(&self) -> Option<u32> {
        self.installed
    }

    /// Periods done.
    pub fn periods(&self) -> u32 {
        self.periods
    }

    /// Of all samples and outputs so far.
    pub fn digest(&self) -> u64 {
        self.digest.value()
    }
}

/// What the timer makes of an output.
fn legs(output: &Output, period: u16) -> Legs {
    Legs::timer(output.compare, period, [0, 1, 2].map(|leg| output.legs.contains(leg)))
}
