//! No map.

use crate::storage::{Sensors, Storage};
use embedded_storage::nor_flash::NorFlash;
use hallservo::control::Config as Control;
use hallservo::drive::Drive;
use hallservo::settings::Settings;
use hallservo::telemetry::{Measurement, Record, Status};
use hallservo_protocol::Problem;

pub(crate) struct MagnetMemory;

impl MagnetMemory {
    pub const fn new() -> Self {
        Self
    }
}

pub(crate) struct ForDrive;

impl ForDrive {
    pub fn attach(self, drive: Drive) -> Drive {
        drive
    }
}

pub(crate) struct MagnetMap;

impl MagnetMap {
    pub fn start(_: &'static mut MagnetMemory) -> (Self, ForDrive) {
        (Self, ForDrive)
    }

    pub fn restore<F: NorFlash>(&mut self, _: &mut Storage<F>, _: Option<&Sensors>, _: &Settings) -> Problem {
        Problem::None
    }

    pub fn record(&mut self, _: &Record, _: &Sensors) {}

    pub const fn unevenness(&self) -> Option<[f32; 3]> {
        None
    }

    pub fn measurement(&mut self, _: &Measurement, _: &Control) {}

    pub const fn by_pole_a(&self, _: f32) -> f32 {
        f32::NAN
    }

    pub fn tick(&mut self, _: Status, _: bool) {}

    pub fn adopt<F: NorFlash>(&mut self, _: &mut Storage<F>, _: Option<&Sensors>, _: &Settings) {}

    pub fn set_aside(&mut self) {}

    pub fn forget(&mut self) {}

    pub const fn is_settled(&self) -> bool {
        true
    }
}
