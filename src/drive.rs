//! Everything that the control interrupt does: one [`Sample`] in, one [`Output`] out.
//!
//! The interrupt owns a [`Drive`] and calls [`Drive::step`] once a PWM period. Tasks talk to it through the lock-free
//! queues of [`Channels`] only: commands in; replies, records and used-up estimators out. Large parameters travel as
//! references, so a calibration is taken up between two steps by swapping a pointer.
//!
//! A drive dispatches its steps over control paths. The state ([`Mode`]), what is followed ([`Demand`]) and the
//! [`Commutation`] say which one is active; each keeps what it alone needs:
//!
//! | path | active | what it does |
//! |---|---|---|
//! | `idle` | bridge off | measures the angle; learns the current amplifiers' zeros |
//! | `arming` | for an instant after arming, with current sensing | checks phases, amplifiers and commutation |
//! | `open_loop` | aligning, calibrating | turns the field whatever the rotor does |
//! | `standstill` | aligning, for a measurement | one phase against the others, to measure R and L |
//! | `voltage` | running by a modulation | a voltage vector turned with the rotor, sinusoidal or block |
//! | `local_feedback` | following, sinusoidal or block | one current controlled by one voltage |
//! | `field_oriented` | following, field-oriented | currents along d and q controlled |
//!
//! What control with currents needs beside its path, the outer loops, the protection and the schedule, is in `servo`.

pub mod absolute;
mod arming;
mod channels;
mod chopper;
mod command;
mod field_oriented;
mod following;
mod hall_loss;
mod idle;
mod impedance;
mod inertia;
mod interlock;
mod local_feedback;
mod look;
pub mod open_loop;
mod protection;
mod records;
mod schedule;
mod servo;
mod set_points;
mod slowed;
pub mod standstill;
mod supervision;
mod third_current;
mod tracking;
mod voltage;

use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output, Sample};
use crate::commutation::Commutation;
use crate::config::Config;
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::track::Tracker;
use crate::mode::{Event, Mode};
use crate::telemetry::{Progress, Record, Status};
use crate::turn::Live;
use arming::{Arming, Step};
pub use channels::{Channels, Command, Interrupt, Refusal, Reply, Tasks};
use command::Later;
use field_oriented::FieldOriented;
use hall_loss::HallLoss;
use idle::Idle;
use local_feedback::LocalFeedback;
use open_loop::{OpenLoop, Stage};
#[cfg(not(feature = "no-chopper"))]
use protection::chopper::Chopper;
pub use schedule::{CYCLE, OUTER};
use servo::Servo;
pub use servo::{Demand, State};
use slowed::Slowed;
use standstill::Standstill;
pub(crate) use supervision::{PARTS, SETTLING};
use third_current::ThirdCurrent;
use voltage::Voltage;

/// The drive. What every step needs comes first, within reach of the short forms of the load instructions.
#[repr(C)]
pub struct Drive {
    /// The record of this step: state, angle, speed, limits and progress; handing it to the tasks is one copy.
    record: Record,
    /// Steps to the next record.
    until_record: u32,
    /// How the next step is done, and by which path.
    route: Route,
    path: Path,
    /// The estimator in use; none before the first calibration.
    estimator: Option<&'static mut Estimator>,
    /// What is taken off the Halls' angle until it is looked up again: the map of the magnets, the delay of the Halls at this
    /// speed, and the field of the windings.
    correction: ElectricalAngle,
    channels: Interrupt,
    paths: Paths,
    servo: Servo,
    config: Config,
    hall_loss: HallLoss,
    mode: Mode,
    limits: Limits,
    progress: Progress,
    /// The map of the rotor's magnets, if there is memory for one.
    map: Option<&'static Live>,
    third_current: ThirdCurrent,
    /// Whether the enable input is off, in a step with that interlock.
    disabled: bool,
    /// What a command has left to do.
    later: Later,
    /// Last, as nothing of it is needed in every step: what lies further away takes longer addresses.
    arming: Arming,
    slowed: Slowed,
    /// The brake resistor, for boards that have a pin for it.
    #[cfg(not(feature = "no-chopper"))]
    chopper: Chopper,
}

/// The control paths.
#[repr(C)]
struct Paths {
    voltage: Voltage,
    field_oriented: FieldOriented,
    local_feedback: LocalFeedback,
    open_loop: OpenLoop,
    idle: Idle,
    standstill: Standstill,
}

/// The control path that is active.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Path {
    Idle,
    Arming,
    OpenLoop,
    Voltage,
    LocalFeedback,
    FieldOriented,
}

/// How the next step is done. Two paths have a short step beside the general one, for the time that nothing is amiss:
/// no sample was missed, no Hall is lost and all currents are sampled. A short step that meets anything else hands over to
/// the general one.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Route {
    /// The short step of the voltage path: sinusoidal, without current sensing.
    Voltage,
    /// The short step of the field-oriented path.
    FieldOriented,
    /// Any path, whatever was missed.
    General,
}

impl Drive {
    /// Unarmed and without a calibration.
    pub const fn new(config: Config, channels: Interrupt) -> Self {
        Self {
            record: Record::new(),
            until_record: 1,
            route: Route::General,
            path: Path::Idle,
            estimator: None,
            correction: ElectricalAngle::ZERO,
            channels,
            paths: Paths {
                voltage: Voltage::new(&config),
                field_oriented: FieldOriented::new(),
                local_feedback: LocalFeedback::new(),
                open_loop: OpenLoop::OFF,
                idle: Idle::new(),
                standstill: Standstill::OFF,
            },
            config,
            servo: Servo::new(),
            hall_loss: HallLoss::NONE,
            mode: Mode::Unarmed,
            limits: Limits::NONE,
            progress: Progress::None,
            arming: Arming::off(),
            #[cfg(not(feature = "no-chopper"))]
            chopper: Chopper::OFF,
            map: None,
            third_current: ThirdCurrent::NONE,
            disabled: false,
            later: Later::Nothing,
            slowed: Slowed::NOT,
        }
    }

    /// Corrects the Halls' angle by a map whenever its tasks put it into effect.
    #[cfg(not(feature = "small"))]
    #[must_use]
    pub const fn with_map(self, map: &'static Live) -> Self {
        Self { map: Some(map), ..self }
    }

    /// Compensates what of the cogging differs from pole to pole whenever its tasks put it into effect: currents along
    /// q, in 2⁻¹⁵ of the full scale.
    #[cfg(not(feature = "small"))]
    #[must_use]
    pub const fn with_cogging(mut self, table: &'static Live) -> Self {
        self.servo.cogging_by_pole = Some(table);
        self
    }

    /// The map, where there may be one.
    #[inline(always)]
    fn map(&self) -> Option<&'static Live> {
        if cfg!(feature = "small") { None } else { self.map }
    }

    /// One PWM period. What it returns is to be written to the preloaded compare registers at once; if the bridge is to
    /// be off, it must be switched off at once.
    ///
    /// With a current control, everything but angle and current has its slots: a command each 8 steps at most, the speed each
    /// 64, the Halls against each other each 8. Without, a step that hands over a record leaves to the next one what can
    /// wait: a command, the check of the speed, and the comparison of the Halls, which after a missed sample is made in
    /// every step. That keeps the longest step short.
    #[inline]
    pub fn step(&mut self, sample: &Sample) -> Output {
        match self.route {
            Route::Voltage if !cfg!(feature = "small") => self.voltage_step(sample),
            Route::FieldOriented => self.field_oriented_step(sample),
            _ => Output::unpack(self.general_step(sample)),
        }
    }

    /// The short step of the field-oriented path.
    #[inline(always)]
    fn field_oriented_step(&mut self, sample: &Sample) -> Output {
        let angle = self.attend(sample).and_then(|estimator| estimator.angle_in_range(&sample.halls).ok());
        let correction = self.correction;
        if !angle.is_some_and(|angle| self.record.rotor.follow(&self.config.tracking, angle - correction)) {
            return Output::unpack(self.finish_step(sample, false));
        }
        if !self.is_healthy(sample) {
            return Output::OFF;
        }
        self.field_oriented_output(sample)
    }

    #[inline(always)]
    fn field_oriented_output(&mut self, sample: &Sample) -> Output {
        let Self { paths, servo, record, config, .. } = self;
        let (compare, beyond) = paths.field_oriented.step(servo, &record.rotor, &config.tracking, sample);
        let [a, b, c] = compare;
        if ThirdCurrent::MAY_MISS && beyond {
            return Output::unpack(self.leave_out(a as i16, b as i16, c as i16));
        }
        Output { compare, legs: Legs::ALL }
    }

    /// The short step of the voltage path.
    #[inline(always)]
    fn voltage_step(&mut self, sample: &Sample) -> Output {
        self.until_record = self.until_record.wrapping_sub(1);
        let records = self.until_record == 0;
        if records {
            self.record.codes = sample.halls;
        } else if self.channels.commands.ready() {
            self.receive(sample);
            if self.route != Route::Voltage {
                return Output::unpack(self.finish_step(sample, false));
            }
        }
        let Some(estimator) = &self.estimator else { return Output::OFF };
        let angle = if records { estimator.angle_in_range(&sample.halls) } else { estimator.angle(&sample.halls) };
        let followed = match angle {
            Ok(angle) => self.record.rotor.follow(&self.config.tracking, angle),
            Err(_) => false,
        };
        if !followed {
            return Output::unpack(self.start_over(sample));
        }
        if records {
            self.send_record(self.config.record_every);
        } else if self.is_too_fast() {
            self.fail(Fault::OverSpeed);
            return Output::OFF;
        }
        self.paths.voltage.sinusoidal(self.record.rotor.predicted(&self.config.tracking))
    }

    /// Does as a general step what a short step of the voltage path could not finish.
    #[cold]
    #[inline(never)]
    fn start_over(&mut self, sample: &Sample) -> u64 {
        self.until_record = self.until_record.wrapping_add(1);
        self.general_step(sample)
    }

    /// A step of any path.
    #[cold]
    #[inline(never)]
    fn general_step(&mut self, sample: &Sample) -> u64 {
        let completed;
        let sample = if self.third_current.is_missing() {
            completed = self.completed(sample);
            &completed
        } else {
            sample
        };
        let (mut records, mut busy) = (false, false);
        if !self.servo.schedule.records {
            self.until_record = self.until_record.wrapping_sub(1);
            records = self.until_record == 0;
            if !records {
                let drives = self.mode.drives();
                busy = self.receive(sample) && !drives;
            }
        }
        // With the bridge off there is nothing that the slot would have to protect, and a voltage of before tells nothing of
        // the alignment.
        let skips = busy || !matches!(self.path, Path::FieldOriented) && self.servo.schedule.trims_next();
        if skips {
            self.servo.schedule.skip();
        } else {
            self.attend(sample);
        }
        if ThirdCurrent::MAY_MISS {
            self.third_current.end_step();
        }
        self.finish_step(sample, records)
    }

    /// The rest of a step of any path, after its slot of the schedule.
    // Not inlined, as it is cold; but compiled with the interrupt, for speed.
    #[cold]
    #[inline]
    fn finish_step(&mut self, sample: &Sample, records: bool) -> u64 {
        self.is_healthy(sample);
        if self.mode.drives() {
            self.paths.idle.drives();
        }
        let output = match self.path {
            Path::Idle => self.idle(sample),
            Path::Arming => self.arming(sample),
            Path::OpenLoop => self.open_loop(sample),
            Path::Voltage => self.voltage(sample),
            Path::LocalFeedback => self.local_feedback(sample),
            Path::FieldOriented => self.field_oriented(sample),
        };
        if records {
            self.send_record_and_measurement(sample);
        }
        self.route = self.route();
        // What was found after the output was computed, such as too high a speed, switches the bridge off as well.
        if self.mode.drives() { output.pack() } else { Output::OFF.pack() }
    }

    /// The path for state, demand and commutation. They change rarely, and each change [publishes](Self::publish) it.
    fn path(&self) -> Path {
        match (self.mode, self.config.commutation) {
            (Mode::Unarmed | Mode::Ready | Mode::Faulted(_), _) => Path::Idle,
            (Mode::Aligning | Mode::Calibrating, _) => Path::OpenLoop,
            (Mode::Running, _) if self.arming.is_active() => Path::Arming,
            (Mode::Running, _) if !self.servo.follows() => Path::Voltage,
            (Mode::Running, Commutation::FieldOriented) => Path::FieldOriented,
            (Mode::Running, Commutation::Block | Commutation::Sinusoidal) => Path::LocalFeedback,
        }
    }

    fn route(&self) -> Route {
        let sampled = u32::from(self.record.missed) | u32::from(self.third_current.left()) == 0;
        let complete = sampled && self.hall_loss.lost.is_none() && self.estimator.is_some();
        let Config { commutation, control, .. } = &self.config;
        match self.path {
            Path::FieldOriented if complete => Route::FieldOriented,
            Path::Voltage if complete && *commutation == Commutation::Sinusoidal && control.is_none() => Route::Voltage,
            _ => Route::General,
        }
    }

    fn idle(&mut self, sample: &Sample) -> Output {
        self.measure(&sample.halls);
        if let Some(control) = &self.config.control {
            self.paths.idle.step(control, sample);
            self.servo.protection.rest();
        }
        Output::OFF
    }

    /// Checks what the bridge is connected to; then does what was commanded meanwhile.
    fn arming(&mut self, sample: &Sample) -> Output {
        self.measure(&sample.halls);
        let Self { config, paths, record, arming, .. } = self;
        let (Some(control), true) = (&config.control, self.mode.drives()) else { return Output::OFF };
        let phases = paths.idle.phases(control, sample);
        if self.servo.schedule.is_even() {
            // A step with the outer loops or a command has enough to do.
            return arming.between(config, control, phases, &record.rotor);
        }
        match arming.step(config, control, phases, &record.rotor) {
            Step::Output(output) => return output,
            Step::Begin { slow } => self.begin_arming(slow, sample),
            Step::Failed(fault) => self.fail(fault),
            Step::Done { step, proven } => self.end_arming(step, proven, sample),
        }
        self.arming.held()
    }

    /// Turns the field. Its angle at the sampling instant is recorded as the rotor's, which follows it.
    fn open_loop(&mut self, sample: &Sample) -> Output {
        self.servo.command_received(self.config.control.as_ref());
        self.forget_pole();
        if self.paths.standstill.is_active() {
            return self.standstill(sample);
        }
        let Self { config, paths: Paths { open_loop, idle, .. }, servo, record, .. } = self;
        record.rotor = Tracker::at(open_loop.field());
        let stage = open_loop.step(&config.open_loop);
        let output = match (&config.control, &config.open_loop.regulator) {
            (Some(control), Some(regulator)) => {
                open_loop.regulate(regulator, servo.measure_current(record.rotor.angle(), sample));
                open_loop.compensated(regulator, &config.limits, idle.phases(control, sample))
            }
            _ => open_loop.output(&config.limits),
        };
        self.progress = match stage {
            Stage::Rise | Stage::Stand(_) | Stage::Settle(_) | Stage::Brake => Progress::None,
            Stage::Record(sweep) => Progress::Sample(sweep),
            Stage::Done => Progress::Complete,
        };
        match stage {
            Stage::Settle(_) => self.on(Event::Aligned),
            Stage::Done => self.on(Event::Swept),
            _ => {}
        }
        // Changes of the mode are published by themselves.
        if self.record.status != self.status() {
            self.publish();
        }
        output
    }

    fn voltage(&mut self, sample: &Sample) -> Output {
        self.measure(&sample.halls);
        if !self.mode.drives() {
            return Output::OFF;
        }
        if self.is_too_fast() {
            self.fail(Fault::OverSpeed);
        }
        self.paths.voltage.output(self.record.rotor.predicted(&self.config.tracking), &self.config)
    }

    fn local_feedback(&mut self, sample: &Sample) -> Output {
        self.measure(&sample.halls);
        if !self.mode.drives() {
            return Output::OFF;
        }
        let Self { config, paths: Paths { local_feedback, idle, .. }, servo, record, .. } = self;
        let Some(control) = &config.control else { return Output::OFF };
        local_feedback.step(config, control, servo, idle, &record.rotor, sample)
    }

    fn field_oriented(&mut self, sample: &Sample) -> Output {
        self.measure(&sample.halls);
        if !self.mode.drives() {
            return Output::OFF;
        }
        self.field_oriented_output(sample)
    }

    #[inline(always)]
    fn is_too_fast(&self) -> bool {
        self.record.rotor.speed().wrapping_add(self.config.fastest) as u32 > 2 * self.config.fastest as u32
    }

    /// Checks currents, bus voltage and lost periods. False when a running drive failed.
    #[inline(always)]
    fn is_healthy(&mut self, sample: &Sample) -> bool {
        self.servo.protection.currents.allow(sample) || self.tolerates_fault(sample)
    }

    /// Latches the fault that the protection has found if the bridge is on; false then.
    #[cold]
    #[inline(never)]
    fn tolerates_fault(&mut self, sample: &Sample) -> bool {
        self.fail(self.servo.protection.currents.fault(sample));
        !matches!(self.mode, Mode::Faulted(_))
    }

    /// Latches a fault if the bridge is on.
    #[cold]
    #[inline(never)]
    fn fail(&mut self, fault: Fault) {
        if self.mode.drives() {
            self.progress = Progress::None;
            self.servo.supervision.doubt();
            self.on(Event::Fail(fault));
            self.hasten_record();
        }
    }

    fn on(&mut self, event: Event) {
        if let Some(mode) = self.mode.after(event) {
            self.enter(mode);
        }
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        if !mode.drives() {
            self.arming.end();
            self.limits = self.limits.without(Limits::CHECKING);
        }
        self.publish();
    }

    /// After every change: state, limits and progress go into the record, and the next step is chosen.
    fn publish(&mut self) {
        let follows = matches!(self.mode, Mode::Running) && self.servo.follows();
        self.record_by_schedule(follows);
        self.servo.supervised = follows && !self.arming.is_active();
        if !follows {
            self.servo.forget_current();
        }
        self.record.status = self.status();
        self.path = self.path();
        self.route = self.route();
    }

    fn status(&self) -> Status {
        Status::new(self.mode, self.limits(), self.progress)
            .with_heavier(self.servo.inertia.doubled > 0)
            .with_lighter(self.slowed.is_slowed())
    }

    /// The state.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// What limits the drive at the moment.
    pub const fn limits(&self) -> Limits {
        self.limits.with(self.servo.limits)
    }

    /// Currents and voltages of a drive with current control, as noted last: every [`CYCLE`] steps.
    pub const fn state(&self) -> &State {
        &self.servo.measurement.state
    }

    /// Correction of the alignment, found while turning field-oriented and added to the Halls' angle: −30° to 30°.
    pub const fn trim(&self) -> ElectricalAngle {
        self.paths.field_oriented.trim()
    }

    /// Counts of the timer in half a PWM period, as the settings of now have it. It changes in a step with the bridge off
    /// only.
    #[inline(always)]
    pub const fn period(&self) -> u16 {
        self.config.period
    }

    /// How the phases are driven.
    pub const fn commutation(&self) -> Commutation {
        self.config.commutation
    }

    /// State, angle, speed and Hall codes as of the last step.
    pub const fn record(&self) -> &Record {
        &self.record
    }

    /// Angle, speed and turns.
    pub const fn tracker(&self) -> &Tracker {
        &self.record.rotor
    }

    /// The estimator in use.
    pub fn estimator(&self) -> Option<&Estimator> {
        self.estimator.as_deref()
    }
}

#[cfg(test)]
mod tests;
