//! What each command does. A refused one changes nothing.

use super::arming::Pending;
use super::slowed::Slowed;
use super::supervision;
use super::{Command, Demand, Drive, OpenLoop, Path, Refusal, Reply, Sample};
use crate::angle::ElectricalAngle;
use crate::commutation::{Commutation, Modulation};
use crate::config::Config;
use crate::control::{Current, Speed, cogging};
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::track::Tracker;
use crate::hall::{Codes, Halls};
use crate::mode::{Event, Mode};
use crate::schedule::coarse;
use crate::telemetry::Progress;

/// What a command has left to do in the steps after it, before another one.
#[derive(Clone, Copy)]
pub(super) enum Later {
    Nothing,
    /// To reset the servo, which has followed something.
    Reset,
    /// To arm: the protection, then the servo, then the bridge.
    Protect,
    Settle,
    Arm,
}

impl Later {
    const fn next(self) -> Self {
        match self {
            Self::Protect => Self::Settle,
            Self::Settle => Self::Arm,
            Self::Nothing | Self::Reset | Self::Arm => Self::Nothing,
        }
    }
}

impl Command {
    /// Whether it restarts the command time-out: what a user sends, not what the tasks send by themselves.
    const fn restarts_timeout(&self) -> bool {
        #[cfg(not(feature = "small"))]
        if matches!(self, Self::Winding(_)) {
            return false;
        }
        !matches!(
            self,
            Self::Install(_) | Self::CalibrationFailed | Self::AntiCogging(_) | Self::Trip(_) | Self::SlowDown
        )
    }

    /// What it sets the control to follow, if it is a set-point.
    #[inline(always)]
    const fn demand(&self) -> Option<Demand> {
        match *self {
            Self::Current(current) => Some(Demand::Current(current)),
            Self::Speed(speed) => Some(Demand::Speed(speed)),
            Self::Position(position) => Some(Demand::Position(position)),
            _ => None,
        }
    }
}

impl Drive {
    /// Carries out a waiting command and answers it; whether there was one. What the one before has left to do comes
    /// first, a part in each step.
    #[cold]
    #[inline(never)]
    pub(super) fn receive(&mut self, sample: &Sample) -> bool {
        if !matches!(self.later, Later::Nothing) {
            return self.go_on(sample);
        }
        let Some(command) = self.channels.commands.dequeue() else { return false };
        // What may be streamed to a drive that turns goes the short way.
        if let Some(demand) = command.demand() {
            let reply = self.follow(demand);
            if reply.is_ok() {
                self.restart_timeout();
            }
            self.answer(reply);
            return true;
        }
        let reply = self.execute(command, sample);
        if !matches!(self.later, Later::Protect) {
            self.answer(reply);
        }
        true
    }

    /// The next part of what a command has left to do; whether it belongs to arming, which then is answered.
    #[cold]
    #[inline(never)]
    fn go_on(&mut self, sample: &Sample) -> bool {
        let part = self.later;
        self.later = part.next();
        match part {
            Later::Nothing => {}
            Later::Reset | Later::Settle => self.reset_servo(sample),
            Later::Protect => {
                if let Some(control) = &self.config.control {
                    self.servo.protection.arm(control, sample);
                }
            }
            Later::Arm => {
                let reply = self.arm();
                if reply.is_ok() {
                    self.restart_timeout();
                }
                self.answer(reply);
            }
        }
        !matches!(part, Later::Reset)
    }

    /// Ends an arming that has begun before the bridge is on, and answers it.
    pub(super) fn give_up_arming(&mut self, reply: Reply) {
        if matches!(self.later, Later::Protect | Later::Settle | Later::Arm) {
            self.later = Later::Nothing;
            self.answer(reply);
        }
    }

    fn answer(&mut self, reply: Reply) {
        // A task that reads no replies does not get any.
        let _ = self.channels.replies.enqueue(reply);
    }

    fn execute(&mut self, command: Command, sample: &Sample) -> Reply {
        let restarts_timeout = command.restarts_timeout();
        match command {
            Command::Calibrate | Command::Arm if self.disabled && !matches!(self.mode, Mode::Faulted(_)) => {
                return Err(Refusal::Fault(Fault::Disabled));
            }
            Command::Calibrate => self.calibrate()?,
            Command::Measure { begins, probe } => self.measure_standstill(begins, probe)?,
            Command::Install(estimator) => self.install(estimator, sample.halls)?,
            Command::CalibrationFailed => self.refuse_calibration()?,
            Command::Arm => self.prepare_to_arm(sample)?,
            Command::Disarm => self.disarm()?,
            Command::Drive(modulation) => self.drive(modulation)?,
            // These have gone the short way.
            Command::Current(_) | Command::Speed(_) | Command::Position(_) => {}
            Command::Impedance(impedance) => self.follow_impedance(impedance)?,
            Command::Commutate(commutation) => self.commutate(commutation)?,
            Command::AntiCogging(table) => self.set_anti_cogging(table),
            Command::Configure(config) => self.configure(config)?,
            Command::Retune(config) => self.retune(config)?,
            Command::SlowDown => self.slow_down(),
            #[cfg(not(feature = "small"))]
            Command::Winding(square) => self.servo.protection.measure_winding(square),
            Command::Trip(fault) => self.fail(fault),
            Command::Clear => {
                self.on_command(Event::Clear { calibrated: self.estimator().is_some() })?;
                // It may have made good what had slipped, which has been mended since.
                self.paths.field_oriented.forget_trim();
            }
        }
        if restarts_timeout {
            self.restart_timeout();
        }
        Ok(())
    }

    /// Restarts the command time-out.
    fn restart_timeout(&mut self) {
        let timed_out = self.servo.limits.contains(Limits::TIMEOUT);
        self.servo.command_received(self.config.control.as_ref());
        if timed_out {
            self.publish();
        }
    }

    /// A change of state by a command.
    fn on_command(&mut self, event: Event) -> Reply {
        let mode = self.mode.after(event).ok_or(Refusal::Mode(self.mode))?;
        self.enter(mode);
        Ok(())
    }

    pub(super) fn calibrate(&mut self) -> Reply {
        self.mode = self.mode.after(Event::Calibrate).ok_or(Refusal::Mode(self.mode))?;
        self.give_up_calibration();
        self.paths.open_loop = OpenLoop::OFF;
        self.paths.standstill.end();
        if let Some(control) = &self.config.control {
            self.servo.reset(control, &self.paths.idle);
        }
        self.publish();
        Ok(())
    }

    /// Whether an estimator was made for the settings of now.
    const fn fits(&self, estimator: &Estimator) -> bool {
        estimator.is_for(self.config.adc_bits, self.config.is_reversed(), self.config.halls)
    }

    /// Gives the estimator back: it is not to be used again, even where no other one comes.
    fn give_up_calibration(&mut self) {
        self.progress = Progress::None;
        self.servo.supervision.doubt();
        if let Some(estimator) = self.estimator.take() {
            self.record.rotor = Tracker::at(self.record.rotor.angle());
            self.forget_pole();
            let _ = self.channels.retired.enqueue(estimator);
        }
    }

    /// A model that is installed later is no new calibration.
    fn refuse_calibration(&mut self) -> Reply {
        self.progress = Progress::None;
        self.on_command(Event::Fail(Fault::Calibration))
    }

    pub(super) fn disarm(&mut self) -> Reply {
        let mode = self.mode.after(Event::Disarm).ok_or(Refusal::Mode(self.mode))?;
        self.progress = Progress::None;
        self.enter(mode);
        Ok(())
    }

    fn install(&mut self, estimator: &'static mut Estimator, codes: Codes) -> Reply {
        // A model that was learnt while a hand turns the shaft must not reset the count of its turns.
        let tracks = self.mode == Mode::Ready && self.record.missed <= self.config.tolerated;
        let calibrated = self.mode == Mode::Unarmed && self.progress == Progress::Complete;
        // It may have been made for settings that have been replaced since.
        let fits = if self.fits(estimator) { Ok(()) } else { Err(Refusal::NotCalibrated) };
        // One that was learnt while turning changes no state.
        let runs = matches!(self.mode, Mode::Running);
        let after = || if runs { Some(self.mode) } else { self.mode.after(Event::Installed) };
        let mode = fits.and_then(|()| after().ok_or(Refusal::Mode(self.mode)));
        let aligned = self.estimator().is_some_and(|before| before.alignment() == estimator.alignment());
        let unused = if mode.is_ok() { self.estimator.replace(estimator) } else { Some(estimator) };
        if let Some(unused) = unused {
            // The queue holds more than there are estimators in a sane drive; beyond, one is leaked, not lost track of.
            let _ = self.channels.retired.enqueue(unused);
        }
        // Published below.
        self.mode = mode?;
        if !aligned {
            self.paths.field_oriented.forget_trim();
            self.servo.supervision.doubt();
        }
        // Nor has it anything to say of a lost Hall, if it is of three. What is followed tells its limits with each record.
        let of_three = self.estimator().is_some_and(|now| now.lost().is_none()) && self.config.halls == Halls::Three;
        if runs && of_three && self.servo.follows() {
            return Ok(());
        }
        self.update_hall_loss(calibrated);
        if self.mode == Mode::Ready && !tracks {
            self.restart_tracking(codes);
        }
        Ok(())
    }

    /// Restarts the tracking at the present angle.
    fn restart_tracking(&mut self, codes: Codes) {
        let angle = self.estimator().and_then(|estimator| estimator.angle(&codes).ok());
        self.record.missed = if angle.is_some() { 0 } else { self.config.tolerated.saturating_add(1) };
        self.record.rotor = Tracker::at(angle.unwrap_or(ElectricalAngle::ZERO));
        self.forget_pole();
    }

    /// Whether the drive may arm. One with current sensing then prepares it in steps of their own, and is answered after
    /// the last one.
    fn prepare_to_arm(&mut self, sample: &Sample) -> Reply {
        match self.mode {
            Mode::Unarmed => return Err(Refusal::NotCalibrated),
            Mode::Ready => {}
            mode => return Err(Refusal::Mode(mode)),
        }
        let control = self.config.control.as_ref();
        let protection = &self.servo.protection;
        if let Some(fault) = control.and_then(|control| protection.refusal(control, &self.paths.idle, sample)) {
            return Err(Refusal::Fault(fault));
        }
        #[cfg(not(feature = "no-chopper"))]
        if self.chopper.is_hot() {
            return Err(Refusal::Fault(Fault::BrakeResistor));
        }
        if self.limits.contains(Limits::TWO_HALLS) {
            return Err(Refusal::HallLost);
        }
        if self.record.missed != 0 {
            return Err(Refusal::NoAngle);
        }
        let Some(control) = control else {
            let turns = self.turns_faster_than(self.config.fastest >> 6);
            return if turns { Err(Refusal::Turning) } else { self.arm() };
        };
        if supervision::is_outside(&control.motion, &self.record.rotor) {
            return Err(Refusal::Fault(Fault::PositionBounds));
        }
        self.later = Later::Protect;
        Ok(())
    }

    /// Switches the bridge on, unless that has become impossible meanwhile.
    fn arm(&mut self) -> Reply {
        let mode = self.mode.after(Event::Arm).ok_or(Refusal::Mode(self.mode))?;
        if self.disabled {
            return Err(Refusal::Fault(Fault::Disabled));
        }
        if self.record.missed != 0 {
            return Err(Refusal::NoAngle);
        }
        if let Some(control) = &mut self.config.control {
            self.slowed.end(&mut control.velocity);
            self.arming.wait();
            self.servo.supervision.begin_again();
            self.limits = self.limits.with(Limits::CHECKING);
        }
        self.paths.voltage.release(&self.config);
        self.mode = mode;
        self.publish();
        Ok(())
    }

    /// The step after the one that armed. At rest, a drive with current sensing checks what it is connected to, and then holds
    /// a speed of zero until it is commanded something else. A rotor that turns turns on, by a current of zero, and so one whose
    /// commutation the check has not shown to be right.
    pub(super) fn begin_arming(&mut self, slow: bool, sample: &Sample) {
        let Some(control) = &self.config.control else { return };
        if !slow {
            return self.take_up_pending(Demand::Current(Current(0)));
        }
        self.servo.supervision.doubt();
        self.arming.begin(control, control.bus(sample.bus));
        self.take_up(Demand::Current(Current(0)));
    }

    /// After the check, which may have shown that the commutation is right: what was commanded meanwhile, a part in each
    /// step.
    pub(super) fn end_arming(&mut self, step: u32, proven: bool, sample: &Sample) {
        if step == 1 {
            return self.reset_servo(sample);
        }
        if proven {
            self.servo.supervision.prove();
        }
        // What the last push has left would roll a heavy rotor on.
        let rest = if proven { Demand::Speed(Speed(0)) } else { Demand::Current(Current(0)) };
        self.take_up_pending(rest);
    }

    /// The check is over, or there was none: what was commanded meanwhile, or what is to be followed until something is.
    fn take_up_pending(&mut self, otherwise: Demand) {
        self.limits = self.limits.without(Limits::CHECKING);
        let pending = self.arming.pending.take();
        self.arming.end();
        match pending {
            Some(Pending::Voltage(modulation)) => self.command_voltage(modulation),
            Some(Pending::Demand(demand)) => self.take_up(demand),
            None => {
                // The check is no time in which a command is missing.
                self.restart_timeout();
                self.take_up(otherwise);
            }
        }
    }

    fn turns_faster_than(&self, speed: i32) -> bool {
        self.record.rotor.speed().unsigned_abs() > speed.unsigned_abs()
    }

    /// Takes up a demand for current, speed or position.
    fn follow(&mut self, demand: Demand) -> Reply {
        let control = self.config.control.as_ref().ok_or(Refusal::NoControl)?;
        if !matches!(self.mode, Mode::Running) {
            return Err(Refusal::Mode(self.mode));
        }
        let [least, largest] = control.motion.bounds;
        if let Demand::Position(position) = demand
            && !(least..=largest).contains(&(coarse(position).to_bits()))
        {
            return Err(Refusal::OutOfBounds);
        }
        let (magnitude, most) = match demand {
            Demand::Current(Current(current)) => (current.unsigned_abs(), control.max_current),
            Demand::Speed(Speed(speed)) => (speed.unsigned_abs(), control.trajectory.speed()),
            Demand::Position(_) | Demand::Impedance | Demand::Voltage => (0, 0),
        };
        if magnitude > most as u32 {
            return Err(Refusal::TooLarge);
        }
        if self.arming.is_active() {
            self.arming.pending = Some(Pending::Demand(demand));
        } else {
            self.take_up(demand);
        }
        Ok(())
    }

    pub(super) fn take_up(&mut self, demand: Demand) {
        if let Some(control) = &self.config.control {
            self.servo.follow(control, demand, &self.record.rotor);
            if self.servo.turns_round(&self.record.rotor) {
                self.channels.told.tell_turn();
            }
        }
        // Where something was followed before, nothing else changes.
        if !matches!(self.path, Path::FieldOriented | Path::LocalFeedback) {
            self.publish();
        }
    }

    pub(super) fn reset_servo(&mut self, sample: &Sample) {
        if let Some(control) = &self.config.control {
            self.servo.reset(control, &self.paths.idle);
            self.paths.local_feedback.reset();
            self.paths.field_oriented.reset(control, self.record.rotor.speed(), sample);
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

    /// Exchanges the table of anti-cogging currents.
    fn set_anti_cogging(&mut self, table: Option<&'static mut cogging::Table>) {
        if let Some(unused) = core::mem::replace(&mut self.servo.cogging, table) {
            let _ = self.channels.tables.enqueue(unused);
        }
    }

    fn configure(&mut self, config: &'static mut Config) -> Reply {
        let allowed = if self.mode.drives() { Err(Refusal::Mode(self.mode)) } else { Ok(()) };
        if allowed.is_ok() {
            (self.config, self.slowed) = (*config, Slowed::NOT);
            self.servo.supervision.doubt();
            // What it was measured against may be another resistance now.
            #[cfg(not(feature = "small"))]
            self.servo.protection.measure_winding(0);
            if self.estimator().is_some_and(|estimator| !self.fits(estimator)) {
                self.give_up_calibration();
                self.on(Event::Invalidated);
            }
        }
        let _ = self.channels.configs.enqueue(config);
        allowed
    }

    /// Takes over gains, whatever the motor does, but for a calibration.
    #[inline(never)]
    fn retune(&mut self, config: &'static mut Config) -> Reply {
        let calibrates = matches!(self.mode, Mode::Aligning | Mode::Calibrating);
        if !calibrates {
            self.config.retune(config);
            self.slowed = Slowed::NOT;
            if let Some(control) = &self.config.control {
                self.servo.go_on(control, &self.record.rotor);
            }
            self.publish();
        }
        let _ = self.channels.configs.enqueue(config);
        if calibrates { Err(Refusal::Mode(self.mode)) } else { Ok(()) }
    }

    #[inline(never)]
    fn slow_down(&mut self) {
        if let Some(control) = &mut self.config.control
            && self.servo.moves()
            && self.slowed.halve(&mut control.velocity)
        {
            self.servo.go_on(control, &self.record.rotor);
            self.publish();
        }
    }

    fn drive(&mut self, modulation: Modulation) -> Reply {
        let sweeps = matches!(self.mode, Mode::Aligning | Mode::Calibrating) && !self.paths.standstill.is_active();
        if sweeps && modulation == Modulation::ZERO {
            self.paths.open_loop.brake();
            return Ok(());
        }
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        let magnitude = i32::from(modulation.to_bits()).unsigned_abs();
        if magnitude > i32::from(self.config.max_modulation.to_bits()).unsigned_abs() {
            return Err(Refusal::TooLarge);
        }
        if self.arming.is_active() {
            self.arming.pending = Some(Pending::Voltage(modulation));
        } else {
            // What is followed ends at once; the servo is reset for what will be followed next.
            if self.servo.follows() {
                self.later = Later::Reset;
            }
            self.servo.release();
            self.command_voltage(modulation);
        }
        Ok(())
    }

    fn command_voltage(&mut self, modulation: Modulation) {
        self.publish();
        self.paths.voltage.command(modulation, &self.config);
        let cut = self.config.limits.limits(modulation);
        self.limits = self.limits.set(Limits::DUTY, cut);
    }
}
