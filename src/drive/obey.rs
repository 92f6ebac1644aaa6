//! What each command does.

use super::{Command, Demand, Drag, Drive, Refusal, Reply, Sample};
use crate::angle::ElectricalAngle;
use crate::commutation::{Commutation, Modulation};
use crate::control::{Current, Speed};
use crate::fault::{Fault, Limits};
use crate::hall::Codes;
use crate::hall::estimate::Estimator;
use crate::hall::track::Tracker;
use crate::mode::{Event, Mode};
use crate::pwm::Amplitude;
use crate::telemetry::Progress;

impl Drive {
    #[cold]
    #[inline(never)]
    pub(super) fn obey(&mut self, command: Command, sample: &Sample) -> Reply {
        // What the tasks send by themselves says nothing of whoever commands.
        if !matches!(command, Command::Install(_) | Command::Balance(_) | Command::Trip(_)) {
            self.servo.heard();
        }
        match command {
            Command::Calibrate => {
                self.on_command(Event::Calibrate)?;
                self.drag = Drag::OFF;
                self.reset_servo(sample);
                self.forget_loss();
                self.progress = Progress::None;
                self.publish();
            }
            Command::Install(estimator) => self.install(estimator, sample.halls)?,
            Command::CalibrationFailed => self.on_command(Event::Fail(Fault::Calibration))?,
            Command::Arm => self.arm(sample)?,
            Command::Disarm => {
                self.on_command(Event::Disarm)?;
                self.progress = Progress::None;
                self.publish();
                self.set_amplitude(Amplitude::ZERO);
            }
            Command::Drive(modulation) => self.drive(modulation, sample)?,
            Command::Current(current) => self.follow(Demand::Current(current))?,
            Command::Speed(speed) => self.follow(Demand::Speed(speed))?,
            Command::Position(position) => self.follow(Demand::Position(position))?,
            Command::Commutate(commutation) => self.commutate(commutation)?,
            Command::Balance(table) => {
                if let Some(unused) = core::mem::replace(&mut self.cogging, table) {
                    let _ = self.channels.tables.enqueue(unused);
                }
            }
            Command::Configure(config) => {
                let allowed = if self.mode.drives() { Err(Refusal::Mode(self.mode)) } else { Ok(()) };
                if allowed.is_ok() {
                    core::mem::swap(&mut self.config, config);
                }
                let _ = self.channels.configs.enqueue(config);
                return allowed;
            }
            Command::Trip(fault) => {
                self.fail(fault);
            }
            Command::Clear => self.on_command(Event::Clear { calibrated: self.estimator().is_some() })?,
        }
        Ok(())
    }

    fn install(&mut self, estimator: &'static mut Estimator, codes: Codes) -> Reply {
        // What was learnt while somebody turns the shaft is no reason to forget its turns.
        let tracks = self.mode == Mode::Ready && self.live.missed <= self.config.tolerated;
        let allowed = self.on_command(Event::Installed);
        let slot = match self {
            Self { hurried: Some(_), .. } => &mut self.hurried,
            Self { serving: Some(_), .. } => &mut self.serving,
            _ => &mut self.resting,
        };
        let unused = if allowed.is_ok() { slot.replace(estimator) } else { Some(estimator) };
        if let Some(unused) = unused {
            // The queue holds more than there are estimators in a sane drive; beyond, one is leaked, not lost track of.
            let _ = self.channels.retired.enqueue(unused);
        }
        if allowed.is_ok() {
            self.take_up_loss();
        }
        if allowed.is_ok() && self.mode == Mode::Ready && !tracks {
            self.relock(codes);
        }
        allowed
    }

    /// Starts to track anew where the rotor is.
    fn relock(&mut self, codes: Codes) {
        let angle = self.estimator().and_then(|estimator| estimator.angle(&codes).ok());
        self.live.missed = if angle.is_some() { 0 } else { self.config.tolerated.saturating_add(1) };
        self.live.rotor = Tracker::at(angle.unwrap_or(ElectricalAngle::ZERO));
    }

    fn arm(&mut self, sample: &Sample) -> Reply {
        if let (Mode::Ready, Some(control)) = (self.mode, &self.config.control)
            && let Some(fault) = self.servo.watch.refusal(control, sample)
        {
            return Err(Refusal::Fault(fault));
        }
        match self.mode {
            Mode::Unarmed => Err(Refusal::NotCalibrated),
            Mode::Ready if self.limits.contains(Limits::TWO_HALLS) => Err(Refusal::HallLost),
            Mode::Ready if self.live.missed != 0 => Err(Refusal::NoAngle),
            _ => {
                self.set_amplitude(Amplitude::ZERO);
                self.reset_servo(sample);
                self.on_command(Event::Arm)
            }
        }
    }

    /// Takes up a demand for current, speed or position.
    fn follow(&mut self, demand: Demand) -> Reply {
        let control = self.config.control.as_ref().ok_or(Refusal::NoControl)?;
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        let (magnitude, most) = match demand {
            Demand::Current(Current(current)) => (current.unsigned_abs(), control.max_current),
            Demand::Speed(Speed(speed)) => (speed.unsigned_abs(), control.trajectory.speed()),
            Demand::Position(_) | Demand::Voltage => (0, 0),
        };
        if magnitude > most as u32 {
            return Err(Refusal::TooLarge);
        }
        self.servo.follow(control, demand, &self.live.rotor);
        self.publish();
        Ok(())
    }

    fn reset_servo(&mut self, sample: &Sample) {
        if let Some(control) = &self.config.control {
            self.servo.reset(control, &self.live.rotor, sample);
        }
    }

    fn commutate(&mut self, commutation: Commutation) -> Reply {
        if commutation == Commutation::FieldOriented && self.config.control.is_none() {
            return Err(Refusal::NoControl);
        }
        if self.mode.drives() {
            return Err(Refusal::Mode(self.mode));
        }
        self.config.commutation = commutation;
        Ok(())
    }

    fn drive(&mut self, modulation: Modulation, sample: &Sample) -> Reply {
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        let magnitude = i32::from(modulation.to_bits()).unsigned_abs();
        if magnitude > i32::from(self.config.max_modulation.to_bits()).unsigned_abs() {
            return Err(Refusal::TooLarge);
        }
        self.reset_servo(sample);
        self.publish();
        self.set_amplitude(self.config.limits.amplitude(modulation));
        let cut = self.config.limits.limits(modulation);
        self.limits = self.limits.set(Limits::DUTY, cut);
        // A negative amplitude turns the field by half a turn; its advance is in the direction of the command, too.
        let advance = if modulation.is_negative() { -self.config.advance } else { self.config.advance };
        self.lead = ElectricalAngle::QUARTER + advance;
        Ok(())
    }
}
