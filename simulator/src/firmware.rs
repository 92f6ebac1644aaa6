//! What a simulated drive runs: the application of every board, with the Halls alone or with an encoder.

use super::flash::Flash;
use super::rings;
use anyhow::{Context as _, Result};
use hallservo::board::{Interlock, Output, Sample};
use hallservo::drive::Drive;
use hallservo::drive::absolute::AbsoluteDrive;
use hallservo::scope::Recorder;
use hallservo::settings::Settings;
use hallservo::vernier::encoder;
use hallservo_app::encoder::{Encoder, NoEncoder, Vernier};
use hallservo_app::{Dealt, Identity, Memory, Readings, Supervisor};
use plant::heads::{Encoder as Rings, HEADS};

/// A drive in its control interrupt and in its tasks.
pub(super) trait Firmware {
    /// One control period, the shaft being at an angle.
    fn step(&mut self, sample: &Sample, interlock: Option<Interlock>, shaft_rad: f64) -> Output;
    /// The drive.
    fn drive(&self) -> &Drive;
    /// Its tasks.
    fn tasks(&mut self) -> &mut dyn Tasks;
    /// The rings on its shaft.
    fn rings(&mut self) -> Option<&mut Rings>;
}

/// The calls of a [`Supervisor`].
pub(super) trait Tasks {
    fn tick(&mut self, now_ms: u64, readings: Readings);
    fn receive(&mut self, bytes: &[u8]) -> usize;
    fn transmit(&mut self, bytes: &mut [u8]) -> usize;
    fn dealt_with(&self) -> Option<Dealt>;
    fn is_alive(&mut self) -> bool;
}

impl<E: Encoder> Tasks for Supervisor<Flash, E> {
    fn tick(&mut self, now_ms: u64, readings: Readings) {
        self.tick(now_ms, readings);
    }

    fn receive(&mut self, bytes: &[u8]) -> usize {
        self.receive(bytes)
    }

    fn transmit(&mut self, bytes: &mut [u8]) -> usize {
        self.transmit(bytes)
    }

    fn dealt_with(&self) -> Option<Dealt> {
        self.dealt_with()
    }

    fn is_alive(&mut self) -> bool {
        self.is_alive()
    }
}

/// With the Halls alone.
struct Halls {
    drive: &'static mut Drive,
    supervisor: &'static mut Supervisor<Flash, NoEncoder>,
    recorder: Option<Recorder>,
}

impl Firmware for Halls {
    fn step(&mut self, sample: &Sample, interlock: Option<Interlock>, _: f64) -> Output {
        let output = match interlock {
            None => self.drive.step(sample),
            Some(interlock) => self.drive.step_off(sample, interlock),
        };
        record(&mut self.recorder, self.drive, sample, &output);
        output
    }

    fn drive(&self) -> &Drive {
        self.drive
    }

    fn tasks(&mut self) -> &mut dyn Tasks {
        self.supervisor
    }

    fn rings(&mut self) -> Option<&mut Rings> {
        None
    }
}

/// With two rings beside them.
struct WithRings {
    drive: &'static mut AbsoluteDrive<encoder::Encoder<HEADS>>,
    supervisor: &'static mut Supervisor<Flash, Vernier<HEADS>>,
    recorder: Option<Recorder>,
    rings: Rings,
}

impl Firmware for WithRings {
    fn step(&mut self, sample: &Sample, interlock: Option<Interlock>, shaft_rad: f64) -> Output {
        let reading = rings::read(&mut self.rings, shaft_rad);
        let output = match interlock {
            None => self.drive.step(sample, reading),
            Some(interlock) => self.drive.step_off(sample, interlock, reading),
        };
        record(&mut self.recorder, self.drive.drive(), sample, &output);
        output
    }

    fn drive(&self) -> &Drive {
        self.drive.drive()
    }

    fn tasks(&mut self) -> &mut dyn Tasks {
        self.supervisor
    }

    fn rings(&mut self) -> Option<&mut Rings> {
        Some(&mut self.rings)
    }
}

/// A row of the scope's.
fn record(recorder: &mut Option<Recorder>, drive: &Drive, sample: &Sample, output: &Output) {
    if let Some(recorder) = recorder {
        recorder.take(drive, sample, output);
    }
}

/// A drive at power-up.
///
/// # Errors
/// The settings are invalid.
pub(super) fn start(
    identity: Identity,
    settings: Settings,
    flash: Flash,
    rings: Option<Rings>,
) -> Result<Box<dyn Firmware>> {
    // On a chip the memory is a static; here, too, a drive lives as long as its process.
    Ok(match rings {
        None => {
            let memory = Box::leak(Box::new(Memory::new()));
            let (drive, supervisor) =
                Supervisor::start(identity, settings, flash, 0, memory).context("the settings")?;
            let recorder = supervisor.recorder();
            Box::new(Halls { drive, supervisor, recorder })
        }
        Some(rings) => {
            let memory = Box::leak(Box::new(Memory::with_encoder()));
            let (drive, supervisor) =
                Supervisor::start_with_encoder(identity, settings, flash, 0, memory).context("the settings")?;
            let recorder = supervisor.recorder();
            Box::new(WithRings { drive, supervisor, recorder, rings })
        }
    })
}
