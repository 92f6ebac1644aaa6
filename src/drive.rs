//! Everything that the control interrupt does: one [`Sample`] in, one [`Output`] out.
//!
//! The interrupt owns a [`Drive`] and calls [`Drive::step`] once a PWM period. Tasks talk to it through the lock-free queues
//! of [`Channels`] only: commands in; replies, records and used-up estimators out. Large parameters travel as
//! references, so a calibration is taken up between two steps by swapping a pointer.

pub mod absolute;
mod channels;
pub mod drag;
mod follow;
mod loss;
mod obey;
mod records;
mod servo;
mod sight;
mod slots;
mod watch;

use crate::angle::ElectricalAngle;
use crate::commutation::block::Sextant;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
use crate::commutation::{Commutation, Legs, Output};
use crate::config::Config;
use crate::control::cogging;
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::track::Tracker;
use crate::hall::{Channel, Codes};
use crate::mode::{Event, Mode};
use crate::pwm::Amplitude;
use crate::telemetry::{Progress, Record, Status};
pub use channels::{Channels, Command, Interrupt, Refusal, Reply, Sample, Tasks};
use drag::{Drag, Stage};
use servo::Servo;
pub use servo::{Demand, State};
pub use slots::{CYCLE, OUTER};

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
    /// Whether a current, a speed or a position is followed.
    serves: bool,
    /// The estimator while the drive does so field-oriented and no sample was missed.
    serving: Option<&'static mut Estimator>,
    /// The step of the schedule.
    tick: u32,
    /// While something is followed: what to add to that for the number of the step before, and where the next record, and the next
    /// currents and voltages are due.
    first: u32,
    record_due: u32,
    state_due: u32,
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
            serves: false,
            serving: None,
            tick: 0,
            first: 0,
            record_due: 0,
            state_due: 0,
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
        if self.serves {
            return self.serve(sample);
        }
        let codes = &sample.halls;
        self.until_record = self.until_record.wrapping_sub(1);
        let records = self.until_record == 0;
        if !records {
            self.receive(sample);
        }
        // First what is in a hurry.
        let Some(estimator) = &self.hurried else {
            return Output::unpack(self.slow(sample, records));
        };
        let angle = if records { estimator.angle_of_one(codes) } else { estimator.angle(codes) };
        // No sample was missed, so there is nothing to do when one is found.
        if !self.track(angle, |_| ()) {
            return Output::unpack(self.fallen(sample, records));
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
        let Config { commutation, control, .. } = &self.config;
        let follows = self.servo.demand != Demand::Voltage;
        let complete = self.mode == Mode::Running && self.live.missed == 0 && self.lost.is_none();
        let estimator = self.hurried.take().or(self.serving.take()).or(self.resting.take());
        match commutation {
            Commutation::Sinusoidal if complete && control.is_none() => self.hurried = estimator,
            Commutation::FieldOriented if complete && follows => self.serving = estimator,
            _ => self.resting = estimator,
        }
        self.serve_if(self.mode == Mode::Running && follows);
        self.live.status = Status::new(self.mode, self.limits(), self.progress);
    }

    /// A step that is in no hurry.
    #[cold]
    #[inline(never)]
    fn slow(&mut self, sample: &Sample, records: bool) -> u64 {
        let codes = &sample.halls;
        self.attend(sample);
        self.is_healthy(sample);
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
                    self.servo.watch.idle(control, sample);
                }
                Output::OFF
            }
        };
        if records {
            self.record_all(sample);
        }
        // The command may have been to disarm, the angle implausible.
        if self.mode.drives() { output.pack() } else { Output::OFF.pack() }
    }

    /// Looks at currents and voltage. False when a running drive failed.
    #[inline(always)]
    fn is_healthy(&mut self, sample: &Sample) -> bool {
        self.servo.watch.healthy(sample) || self.fail(self.servo.watch.explain(sample))
    }

    /// The step that found a fault.
    #[cold]
    #[inline(never)]
    fn fallen(&mut self, sample: &Sample, records: bool) -> u64 {
        let codes = &sample.halls;
        if self.runs_on(*codes) {
            return self.slow(sample, records);
        }
        if records {
            self.record(codes, self.config.record_every);
        }
        Output::OFF.pack()
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

    /// A running step that is in no hurry and follows a voltage.
    fn run(&mut self, codes: &Codes) -> Output {
        self.observe(codes);
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

    /// Currents and voltages of a drive with current control, as noted last: every [`CYCLE`] steps.
    pub const fn state(&self) -> &State {
        &self.servo.noted.state
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
        self.hurried.as_deref().or(self.serving.as_deref()).or(self.resting.as_deref())
    }
}

#[cfg(test)]
mod tests;
