//! The drive step by step, with codes straight from a model.

mod anything;
mod calibration;
mod commands;
mod direction;
mod following;
mod halls;
mod impedance;
mod interlock;
mod records;
mod refusals;
mod seams;
mod third_current;

use super::*;
use crate::angle::Position;
use crate::board::{LostPeriods, TemperatureCode};
use crate::commutation::Modulation;
use crate::control::impedance::{Motion, Request};
use crate::control::{Current, Speed};
use crate::hall::Codes;
use crate::hall::model::Model;
use crate::service::{self, Service};
use crate::settings::Settings;
use proptest::prelude::*;

extern crate std;
use std::boxed::Box;
use std::vec::Vec;

/// A drive with its service, and a rotor that is where the test puts it.
struct Bench {
    drive: Drive,
    service: Service,
    model: Model,
    rotor: ElectricalAngle,
    config: Config,
    /// Whether currents, voltage and temperatures are there.
    healthy: bool,
}

impl Bench {
    fn new(settings: &Settings) -> Self {
        let config = settings.validate().unwrap();
        let (interrupt, tasks) = Box::leak(Box::new(Channels::new())).split();
        let estimators = [(); 2].map(|()| Box::leak(Box::new(Estimator::blank())));
        Self {
            drive: Drive::new(config, interrupt),
            service: Service::new(config, tasks, estimators),
            model: Model::nominal(12, 600.0, ElectricalAngle::THIRD),
            rotor: ElectricalAngle::from_degrees(10.0),
            config,
            healthy: false,
        }
    }

    /// Installed and running.
    fn running() -> Self {
        Self::running_with(&Settings::default())
    }

    fn running_with(settings: &Settings) -> Self {
        let mut bench = Self::new(settings);
        bench.install().unwrap();
        bench.command(Command::Arm).unwrap();
        bench
    }

    fn install(&mut self) -> Reply {
        self.service.install(&self.model).unwrap();
        loop {
            match self.service.poll() {
                Some(service::Event::Installed(reply)) => return reply,
                Some(_) => {}
                None => drop(self.step()),
            }
        }
    }

    fn step(&mut self) -> Output {
        self.step_with(self.model.codes(self.rotor))
    }

    fn step_with(&mut self, halls: Codes) -> Output {
        let sample = if self.healthy { healthy(halls) } else { Sample { halls, ..Sample::default() } };
        self.drive.step(&sample)
    }

    fn reply(&mut self) -> Reply {
        loop {
            match self.service.poll() {
                Some(service::Event::Reply(reply)) => return reply,
                Some(_) => {}
                None => drop(self.step()),
            }
        }
    }

    fn command(&mut self, command: Command) -> Reply {
        self.service.send(command).unwrap();
        self.reply()
    }

    /// Arms, and waits until what was commanded is followed.
    fn arm(&mut self) {
        self.command(Command::Arm).unwrap();
        while self.drive.limits().contains(Limits::CHECKING) {
            self.step();
        }
    }

    fn mode(&self) -> Mode {
        self.drive.mode()
    }
}

/// 24 V, no current, 25 °C.
fn healthy(halls: Codes) -> Sample {
    Sample { halls, currents: [2048; 3], bus: 2708, temperatures: [TemperatureCode::new(2048); 2], ..Sample::default() }
}

/// Installed, and with currents to measure.
fn with_control(commutation: Commutation, change: impl Fn(&mut crate::settings::Control)) -> Bench {
    let mut control = crate::settings::Control::default();
    // The tests send no commands but those that they are about.
    control.guard.command_timeout_s = 60.0;
    // The rotor of these tests turns as it likes.
    control.guard.arming_check = false;
    change(&mut control);
    let mut bench = Bench::new(&Settings { commutation, control: Some(control), ..Settings::default() });
    bench.healthy = true;
    bench.install().unwrap();
    bench
}

/// A spring and a damper by the settings; none without currents to control.
fn impedance(config: &Config, motion: Motion) -> Command {
    let request = Request { motion, ..Request::default() };
    Command::Impedance(Box::leak(Box::new(config.impedance(&request).unwrap_or(crate::control::Impedance::NONE))))
}

/// A reference that is at a position at once and moves on, rad/s.
fn at_once(position_turns: f64, speed_rad_s: f32) -> Motion {
    Motion::To {
        position_turns: Some(position_turns),
        speed_rad_s,
        stop_turns: None,
        max_speed_rad_s: Some(f32::INFINITY),
        max_acceleration_rad_s2: Some(f32::INFINITY),
    }
}
