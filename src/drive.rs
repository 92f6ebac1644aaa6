//! Everything that the control interrupt does: one [`Sample`] in, one [`Output`] out.
//!
//! The interrupt owns a [`Drive`] and calls [`Drive::step`] once a PWM period. Tasks talk to it through the lock-free queues
//! of [`Channels`] only: commands in; replies, records and used-up estimators out. Large parameters travel as
//! references, so a calibration is taken up between two steps by swapping a pointer.

pub mod absolute;
mod channels;
pub mod drag;
mod loss;
mod servo;

use crate::angle::ElectricalAngle;
use crate::commutation::block::Sextant;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
use crate::commutation::{Commutation, Legs, Modulation, Output};
use crate::control::cogging;
use crate::control::{Current, Speed};
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::normalize::Implausible;
use crate::hall::track::{Jump, Tracker};
use crate::hall::{Channel, Codes};
use crate::mode::{Event, Mode};
use crate::pwm::Amplitude;
use crate::settings::Config;
use crate::telemetry::{Measurement, Progress, Record, Status};
pub use channels::{Channels, Command, Interrupt, Refusal, Reply, Sample, Tasks};
use drag::{Drag, Stage};
use servo::Servo;
pub use servo::{Demand, State};

/// The drive. What a step in a hurry needs comes first, within reach of the short forms of the load instructions.
#[repr(C)]
pub struct Drive {
    /// The progress, state and limits with angle and speed, as the tasks get it.
    live: Record,
    /// Steps to the next record.
    until_record: u32,
    /// The estimator while the drive runs sinusoidally and no sample was missed. That it is here is what a step looks at first.
    hurried: Option<&'static mut Estimator>,
    /// From the rotor to the field: a quarter turn and the phase advance.
    lead: ElectricalAngle,
    /// The amplitude, for the sinusoidal commutation.
    axes: Axes,
    channels: Interrupt,
    config: Config,
    /// The estimator otherwise.
    resting: Option<&'static mut Estimator>,
    /// A Hall lost while running, as long as the estimator counts on it.
    lost: Option<Channel>,
    /// What would be a fault, unless two Halls do.
    suspicion: Option<Fault>,
    mode: Mode,
    limits: Limits,
    progress: Progress,
    amplitude: Amplitude,
    /// Where block commutation stands.
    sextant: Sextant,
    drag: Drag,
    servo: Servo,
    cogging: Option<&'static mut cogging::Table>,
}

impl Drive {
    /// Unarmed and without a calibration.
    pub const fn new(config: Config, channels: Interrupt) -> Self {
        Self {
            drag: Drag::OFF,
            config,
            channels,
            hurried: None,
            resting: None,
            lost: None,
            suspicion: None,
            mode: Mode::Unarmed,
            limits: Limits::NONE,
            progress: Progress::None,
            live: Record::new(),
            amplitude: Amplitude::ZERO,
            axes: Axes::new(Amplitude::ZERO, config.order(), config.limits.half()),
            lead: ElectricalAngle::QUARTER,
            sextant: Sextant::First,
            until_record: 1,
            servo: Servo::new(),
            cogging: None,
        }
    }

    /// One PWM period. What it returns is to be written to the preloaded compare registers at once; if the bridge is to
    /// be off, it must be switched off at once.
    ///
    /// A step that hands over a record leaves a waiting command, the look at the speed and the comparison of the sensors with each
    /// other to the next, so that no step is burdened with everything. Once a sample was missed, all of them are compared.
    #[inline]
    pub fn step(&mut self, sample: &Sample) -> Output {
        let codes = &sample.halls;
        self.until_record = self.until_record.wrapping_sub(1);
        let records = self.until_record == 0;
        if !records {
            self.receive(sample);
        }
        // First what is in a hurry.
        let Some(estimator) = &self.hurried else { return self.slow(sample, records) };
        let angle = if records { estimator.angle_of_one(codes) } else { estimator.angle(codes) };
        // No sample was missed, so there is nothing to do when one is found.
        if !self.track(angle, |_| ()) {
            return self.fallen(sample, records);
        }
        if records {
            self.record(codes, self.config.record_every);
        } else if self.is_too_fast() {
            self.fail(Fault::OverSpeed);
            return Output::OFF;
        }
        let vector = self.live.rotor.predicted(&self.config.tracking) + self.lead;
        Output { compare: sinusoidal::compare(vector, &self.axes), legs: Legs::ALL }
    }

    #[inline(always)]
    fn is_too_fast(&self) -> bool {
        self.live.rotor.speed().wrapping_add(self.config.fastest) as u32 > 2 * self.config.fastest as u32
    }

    /// Obeys one command, if there is one.
    #[inline(always)]
    fn receive(&mut self, sample: &Sample) {
        if let Some(command) = self.channels.commands.dequeue() {
            let reply = self.obey(command, sample);
            // A task that reads no replies does not get any.
            let _ = self.channels.replies.enqueue(reply);
        }
    }

    /// Takes state, limits and progress over into the record, and the estimator to where it belongs: after
    /// every change.
    fn publish(&mut self) {
        let sinusoidal = self.mode == Mode::Running
            && self.config.commutation == Commutation::Sinusoidal
            && self.config.control.is_none();
        let estimator = self.hurried.take().or(self.resting.take());
        if sinusoidal && self.live.missed == 0 && self.lost.is_none() {
            self.hurried = estimator;
        } else {
            self.resting = estimator;
        }
        self.live.status = Status::new(self.mode, self.limits(), self.progress);
    }

    /// A step that is in no hurry.
    #[cold]
    #[inline(never)]
    fn slow(&mut self, sample: &Sample, records: bool) -> Output {
        if self.mode == Mode::Running && self.servo.demand != Demand::Voltage {
            return self.serve(sample, records);
        }
        let codes = &sample.halls;
        self.watch(sample);
        let output = match self.mode {
            Mode::Running if self.is_too_fast() => {
                self.fail(Fault::OverSpeed);
                Output::OFF
            }
            Mode::Running => self.run(codes),
            Mode::Aligning | Mode::Calibrating => self.calibrate(),
            Mode::Unarmed | Mode::Ready | Mode::Faulted(_) => {
                self.measure(codes);
                if let Some(control) = &self.config.control {
                    self.servo.idle(control, sample);
                }
                Output::OFF
            }
        };
        if records {
            self.record_all(sample);
        }
        // The command may have been to disarm, the angle implausible.
        if self.mode.drives() { output } else { Output::OFF }
    }

    /// A running step that follows a current, a speed or a position.
    #[inline(never)]
    fn serve(&mut self, sample: &Sample, records: bool) -> Output {
        self.watch(sample);
        if self.is_too_fast() {
            self.fail(Fault::OverSpeed);
        }
        self.observe(&sample.halls);
        // The loops rely on a voltage and currents within their limits.
        let output = if self.mode == Mode::Running { self.regulate() } else { Output::OFF };
        if records {
            self.record_all(sample);
        }
        output
    }

    /// A record with currents and voltages, if there are any.
    #[inline(never)]
    fn record_all(&mut self, sample: &Sample) {
        if self.config.control.is_some() && self.mode == Mode::Running {
            self.publish();
            let Record { rotor, sequence, .. } = self.live;
            let measurement = Measurement { rotor, sequence, state: self.servo.state, trim: self.servo.trim() };
            let _ = self.channels.measurements.enqueue(measurement);
        }
        let calibrating = matches!(self.mode, Mode::Aligning | Mode::Calibrating);
        let every = if calibrating { self.config.calibration_record_every } else { self.config.record_every };
        self.record(&sample.halls, every);
        // A calibration may record every step.
        if every == 1 {
            self.receive(sample);
        }
    }

    /// Currents, voltage and temperatures; what is wrong with them makes a running drive fail.
    #[inline(always)]
    fn watch(&mut self, sample: &Sample) {
        if let Some(control) = &self.config.control
            && let Some(fault) = self.servo.watch(control, sample)
        {
            self.fail(fault);
        }
    }

    /// The step that found a fault.
    #[cold]
    #[inline(never)]
    fn fallen(&mut self, sample: &Sample, records: bool) -> Output {
        let codes = &sample.halls;
        if self.runs_on(*codes) {
            return self.slow(sample, records);
        }
        if records {
            self.record(codes, self.config.record_every);
        }
        Output::OFF
    }

    /// Lets the next step hand over a record, unless this one does.
    fn hasten_record(&mut self) {
        if self.until_record != 0 {
            self.live.sequence = self.live.sequence.wrapping_sub(self.until_record - 1);
            self.until_record = 1;
        }
    }

    /// Angle and speed from the Halls in a step that is in no hurry.
    #[inline(always)]
    fn measure(&mut self, codes: &Codes) {
        let Some(estimator) = &self.resting else { return };
        let angle = estimator.angle(codes);
        self.track(angle, Self::found);
    }

    /// Takes up an angle, if it is one; `done` is for what else is to be done then. False when a running drive failed.
    #[inline(always)]
    fn track(&mut self, angle: Result<ElectricalAngle, Implausible>, done: impl Fn(&mut Self)) -> bool {
        match angle {
            Ok(angle) => match self.live.rotor.step(&self.config.tracking, angle) {
                Ok(()) => {
                    done(self);
                    true
                }
                Err(Jump) => self.jumped(angle),
            },
            Err(why) => self.blind(why),
        }
    }

    /// The angle is plausible, perhaps again.
    fn found(&mut self) {
        if self.live.missed != 0 {
            self.live.missed = 0;
            self.limits = self.limits.without(Limits::EXTRAPOLATED);
            self.publish();
        }
    }

    /// The codes are no angle.
    #[cold]
    #[inline(never)]
    fn blind(&mut self, why: Implausible) -> bool {
        self.live.rotor.coast();
        if self.miss() {
            return true;
        }
        if !self.mode.drives() {
            // Nothing is known of the rotor, so it is not turned on and on.
            self.live.rotor = Tracker::at(self.live.rotor.angle());
        }
        self.fail_unless_two_do(Fault::Hall(why))
    }

    /// The angle is not where the rotor can be.
    #[cold]
    #[inline(never)]
    fn jumped(&mut self, angle: ElectricalAngle) -> bool {
        if self.miss() {
            return true;
        }
        if !self.mode.drives() {
            // While nothing is driven, believe what comes again and again.
            self.live.rotor = Tracker::at(angle);
            self.found();
        }
        self.fail_unless_two_do(Fault::AngleJump)
    }

    /// Counts a sample without a plausible angle; false when they are too many.
    fn miss(&mut self) -> bool {
        self.live.missed = self.live.missed.saturating_add(1);
        self.limits = self.limits.with(Limits::EXTRAPOLATED);
        self.publish();
        self.live.missed <= self.config.tolerated
    }

    /// Latches a fault if the bridge is on; true if it is not.
    #[cold]
    fn fail(&mut self, fault: Fault) -> bool {
        let failed = self.mode.drives();
        if failed {
            self.progress = Progress::None;
            self.on(Event::Fail(fault));
            self.hasten_record();
            self.set_amplitude(Amplitude::ZERO);
        }
        !failed
    }

    /// Angle and speed from the Halls that are left.
    #[inline(always)]
    fn observe(&mut self, codes: &Codes) {
        match self.lost {
            None => self.measure(codes),
            Some(lost) => self.measure_without(lost, *codes),
        }
        self.runs_on(*codes);
    }

    /// A running step that is in no hurry and follows a voltage.
    fn run(&mut self, codes: &Codes) -> Output {
        self.observe(codes);
        if self.servo.is_silent() {
            return self.regulate();
        }
        let vector = self.live.rotor.predicted(&self.config.tracking) + self.lead;
        match self.config.commutation {
            Commutation::Sinusoidal | Commutation::FieldOriented => {
                Output { compare: sinusoidal::compare(vector, &self.axes), legs: Legs::ALL }
            }
            Commutation::Block => {
                self.sextant = self.sextant.follow(vector);
                self.sextant.output(self.config.order(), self.amplitude, self.config.limits.half())
            }
        }
    }

    /// What a current, a speed or a position takes.
    #[inline(always)]
    fn regulate(&mut self) -> Output {
        let Some(control) = &self.config.control else { return Output::OFF };
        let rotor = &self.live.rotor;
        if self.servo.is_silent() && self.servo.demand != Demand::Speed(Speed(0)) {
            self.servo.follow(Demand::Speed(Speed(0)), rotor);
        }
        self.servo.outer(control, rotor, self.cogging.as_deref());
        let Config { limits, tracking, reversed, .. } = &self.config;
        if self.config.commutation == Commutation::FieldOriented {
            return Output { compare: self.servo.field(control, rotor, tracking, limits, *reversed), legs: Legs::ALL };
        }
        self.locally()
    }

    /// With the local feedback: one current, one voltage.
    #[inline(never)]
    fn locally(&mut self) -> Output {
        let Some(control) = &self.config.control else { return Output::OFF };
        let (rotor, order) = (&self.live.rotor, self.config.order());
        let vector = rotor.predicted(&self.config.tracking) + ElectricalAngle::QUARTER;
        let block = self.config.commutation == Commutation::Block;
        let measured = if block {
            self.servo.across(self.sextant.conducting(order))
        } else {
            self.servo.park(rotor.angle(), self.config.reversed);
            self.servo.state.current.q
        };
        let modulation = self.servo.local(control, measured, rotor.speed());
        let limits = &self.config.limits;
        self.servo.limits = self.servo.limits.set(Limits::DUTY, limits.limits(modulation));
        let amplitude = limits.amplitude(modulation);
        if block {
            self.sextant = self.sextant.follow(vector);
            return self.sextant.output(order, amplitude, limits.half());
        }
        let axes = Axes::new(amplitude, order, limits.half());
        Output { compare: sinusoidal::compare(vector, &axes), legs: Legs::ALL }
    }

    fn set_amplitude(&mut self, amplitude: Amplitude) {
        self.amplitude = amplitude;
        self.axes = Axes::new(amplitude, self.config.order(), self.config.limits.half());
    }

    /// A step of the calibration's motion.
    fn calibrate(&mut self) -> Output {
        self.servo.heard();
        // The field that acts while this sample is taken stands for the rotor that follows it.
        self.live.rotor = Tracker::at(self.drag.field());
        self.progress = match self.drag.step(&self.config.drag) {
            Stage::Rise | Stage::Stand(_) => Progress::None,
            Stage::Settle(_) => {
                self.on(Event::Aligned);
                Progress::None
            }
            Stage::Record(sweep) => Progress::Sample(sweep),
            Stage::Done => {
                self.on(Event::Swept);
                Progress::Complete
            }
        };
        self.publish();
        let amplitude = self.config.limits.amplitude(self.drag.modulation());
        let axes = Axes::new(amplitude, PhaseOrder::FORWARD, self.config.limits.half());
        Output { compare: sinusoidal::compare(self.drag.field(), &axes), legs: Legs::ALL }
    }

    /// Hands a record to the tasks; when they do not keep up, it is lost.
    #[inline(always)]
    fn record(&mut self, codes: &Codes, every: u32) {
        self.until_record = every;
        self.live.codes = *codes;
        let _ = self.channels.records.enqueue(self.live);
        self.live.sequence = self.live.sequence.wrapping_add(every);
    }

    #[cold]
    #[inline(never)]
    fn obey(&mut self, command: Command, sample: &Sample) -> Reply {
        // What the tasks send by themselves says nothing of whoever commands.
        if !matches!(command, Command::Install(_) | Command::Balance(_) | Command::Trip(_)) {
            self.servo.heard();
        }
        match command {
            Command::Calibrate => {
                self.on_command(Event::Calibrate)?;
                self.drag = Drag::OFF;
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
            Command::Drive(modulation) => self.drive(modulation)?,
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
        let allowed = self.on_command(Event::Installed);
        let slot = if self.hurried.is_some() { &mut self.hurried } else { &mut self.resting };
        let unused = if allowed.is_ok() { slot.replace(estimator) } else { Some(estimator) };
        if let Some(unused) = unused {
            // The queue holds more than there are estimators in a sane drive; beyond, one is leaked, not lost track of.
            let _ = self.channels.retired.enqueue(unused);
        }
        if allowed.is_ok() {
            self.take_up_loss();
        }
        if allowed.is_ok() && self.mode == Mode::Ready {
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
            && let Some(fault) = self.servo.refusal(control, sample)
        {
            return Err(Refusal::Fault(fault));
        }
        match self.mode {
            Mode::Unarmed => Err(Refusal::NotCalibrated),
            Mode::Ready if self.limits.contains(Limits::TWO_HALLS) => Err(Refusal::HallLost),
            Mode::Ready if self.live.missed != 0 => Err(Refusal::NoAngle),
            _ => {
                self.set_amplitude(Amplitude::ZERO);
                self.servo.reset();
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
        self.servo.follow(demand, &self.live.rotor);
        Ok(())
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

    fn drive(&mut self, modulation: Modulation) -> Reply {
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        let magnitude = i32::from(modulation.to_bits()).unsigned_abs();
        if magnitude > i32::from(self.config.max_modulation.to_bits()).unsigned_abs() {
            return Err(Refusal::TooLarge);
        }
        self.servo.reset();
        self.set_amplitude(self.config.limits.amplitude(modulation));
        let cut = self.config.limits.limits(modulation);
        self.limits = if cut { self.limits.with(Limits::DUTY) } else { self.limits.without(Limits::DUTY) };
        // A negative amplitude turns the field by half a turn; its advance is in the direction of the command, too.
        let advance = if modulation.is_negative() { -self.config.advance } else { self.config.advance };
        self.lead = ElectricalAngle::QUARTER + advance;
        Ok(())
    }

    fn on(&mut self, event: Event) {
        if let Some(mode) = self.mode.after(event) {
            self.enter(mode);
        }
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.publish();
    }

    fn on_command(&mut self, event: Event) -> Reply {
        let mode = self.mode.after(event).ok_or(Refusal::Mode(self.mode))?;
        self.enter(mode);
        Ok(())
    }

    /// The state.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// What holds the drive back.
    pub const fn limits(&self) -> Limits {
        self.limits.with(self.servo.limits)
    }

    /// Currents and voltages of a drive with current control.
    pub const fn state(&self) -> &State {
        &self.servo.state
    }

    /// What the alignment was found to be off by while turning field-oriented: added to the Halls' angle.
    pub const fn trim(&self) -> ElectricalAngle {
        self.servo.trim()
    }

    /// How the phases are driven.
    pub const fn commutation(&self) -> Commutation {
        self.config.commutation
    }

    /// Everything known at the last step.
    pub const fn live(&self) -> &Record {
        &self.live
    }

    /// Angle, speed and turns.
    pub const fn tracker(&self) -> &Tracker {
        &self.live.rotor
    }

    /// The estimator in use.
    pub fn estimator(&self) -> Option<&Estimator> {
        self.hurried.as_deref().or(self.resting.as_deref())
    }
}

#[cfg(test)]
mod tests;
