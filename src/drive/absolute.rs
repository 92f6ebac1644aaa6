//! A drive with an absolute encoder beside its Halls: the mechanical angle from the first sample after power-up.
//!
//! [`AbsoluteDrive`] is what the interrupt owns then, around its [`Drive`], which goes on commutating by the Halls. The
//! encoder's angle is checked by itself on every sample; a task checks the Halls' turn counter against it
//! ([`AbsoluteTasks::poll`]). An encoder without an angle for longer than tolerated, or a disagreement, switches a running
//! bridge off.

use super::{Command, Drive, Sample};
use crate::angle::{MechanicalAngle, Position};
use crate::board::{Legs, Output};
use crate::fault::Fault;
use crate::service::Service;
use crate::vernier::continuity::{self, State};
use crate::vernier::encoder::{Encoder, Reading};
use crate::vernier::turns::{Disagreement, TurnCheck, TurnZero};
use heapless::spsc::{Consumer, Producer, Queue};

/// One sample of the encoder, with where the Halls were at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Absolute<const HEADS: usize> {
    /// The heads, for a [`Calibrator`](crate::vernier::calibrate::Calibrator).
    pub reading: Reading<HEADS>,
    /// The angle, or why there is none; `None` while no encoder is installed.
    pub angle: Option<Result<MechanicalAngle, continuity::Fault>>,
    /// Position by the Halls.
    pub halls: Position,
}

/// The queues between the interrupt and the tasks, beside those of the drive.
#[derive(Default)]
pub struct AbsoluteChannels<const HEADS: usize> {
    encoders: Queue<&'static mut Encoder<HEADS>, 2>,
    retired: Queue<&'static mut Encoder<HEADS>, 4>,
    samples: Queue<Absolute<HEADS>, 64>,
}

/// The interrupt's ends.
pub struct AbsoluteInterrupt<const HEADS: usize> {
    encoders: Consumer<'static, &'static mut Encoder<HEADS>, 2>,
    retired: Producer<'static, &'static mut Encoder<HEADS>, 4>,
    samples: Producer<'static, Absolute<HEADS>, 64>,
}

/// The tasks' ends.
pub struct AbsoluteTasks<const HEADS: usize> {
    encoders: Producer<'static, &'static mut Encoder<HEADS>, 2>,
    retired: Consumer<'static, &'static mut Encoder<HEADS>, 4>,
    samples: Consumer<'static, Absolute<HEADS>, 64>,
    check: Option<TurnCheck>,
    zero: TurnZero,
}

impl<const HEADS: usize> AbsoluteChannels<HEADS> {
    /// Empty ones.
    pub const fn new() -> Self {
        Self { encoders: Queue::new(), retired: Queue::new(), samples: Queue::new() }
    }

    /// Both ends.
    pub fn split(&'static mut self) -> (AbsoluteInterrupt<HEADS>, AbsoluteTasks<HEADS>) {
        let (encoders_in, encoders) = self.encoders.split();
        let (retired, retired_out) = self.retired.split();
        let (samples, samples_out) = self.samples.split();
        let interrupt = AbsoluteInterrupt { encoders, retired, samples };
        let tasks = AbsoluteTasks {
            encoders: encoders_in,
            retired: retired_out,
            samples: samples_out,
            check: None,
            zero: TurnZero::default(),
        };
        (interrupt, tasks)
    }
}

/// The drive and its encoder.
pub struct AbsoluteDrive<const HEADS: usize> {
    drive: Drive,
    channels: AbsoluteInterrupt<HEADS>,
    encoder: Option<&'static mut Encoder<HEADS>>,
    state: State,
    angle: Option<Result<MechanicalAngle, continuity::Fault>>,
    /// Successive samples without an angle.
    missed: u16,
    every: u32,
    until_sample: u32,
}

impl<const HEADS: usize> AbsoluteDrive<HEADS> {
    /// Around a drive. Every `every`-th sample, at least each, goes to the tasks.
    pub fn new(drive: Drive, channels: AbsoluteInterrupt<HEADS>, every: u32) -> Self {
        let every = every.max(1);
        let state = State::default();
        Self { drive, channels, encoder: None, state, angle: None, missed: 0, every, until_sample: 1 }
    }

    /// One PWM period, as [`Drive::step`], with the encoder's heads read at the same instant.
    #[inline]
    pub fn step(&mut self, sample: &Sample, reading: Reading<HEADS>) -> Output {
        if let Some(encoder) = self.channels.encoders.dequeue() {
            self.install(encoder);
        }
        let output = self.drive.step(sample);
        let output = if self.follow(reading) { output } else { self.trip(&output) };
        self.until_sample = self.until_sample.wrapping_sub(1);
        if self.until_sample == 0 {
            self.until_sample = self.every;
            let halls = self.drive.tracker().position();
            let _ = self.channels.samples.enqueue(Absolute { reading, angle: self.angle, halls });
        }
        output
    }

    /// Reads the encoder. False when it has had no angle for longer than tolerated.
    fn follow(&mut self, reading: Reading<HEADS>) -> bool {
        let Some(encoder) = &self.encoder else { return true };
        let angle = encoder.step(&mut self.state, reading).map(|decoded| decoded.angle);
        self.missed = if angle.is_ok() { 0 } else { self.missed.saturating_add(1) };
        self.angle = Some(angle);
        self.missed <= self.drive.config.tolerated
    }

    #[cold]
    fn install(&mut self, encoder: &'static mut Encoder<HEADS>) {
        if let Some(old) = self.encoder.replace(encoder) {
            let _ = self.channels.retired.enqueue(old);
        }
        self.state = State::default();
        self.missed = 0;
    }

    /// Off, if the bridge was on.
    #[cold]
    fn trip(&mut self, output: &Output) -> Output {
        if output.legs != Legs::NONE {
            self.drive.fail(Fault::Encoder);
        }
        Output::OFF
    }

    /// The drive inside.
    pub const fn drive(&self) -> &Drive {
        &self.drive
    }

    /// The shaft's angle at the last sample, or why there is none; `None` while no encoder is installed.
    pub const fn angle(&self) -> Option<Result<MechanicalAngle, continuity::Fault>> {
        self.angle
    }

    /// Whether the angle has been proven by motion since power-up.
    pub fn is_proven(&self) -> bool {
        self.state.is_proven()
    }
}

impl<const HEADS: usize> AbsoluteTasks<HEADS> {
    /// Gives the drive a calibrated encoder, which it takes up between two steps. What it had before comes back from
    /// [`Self::retired`].
    ///
    /// # Errors
    /// The encoder, while the last one is not taken up yet.
    pub fn install(&mut self, encoder: &'static mut Encoder<HEADS>) -> Result<(), &'static mut Encoder<HEADS>> {
        self.zero = TurnZero::default();
        self.encoders.enqueue(encoder)
    }

    /// An encoder that the drive no longer uses.
    pub fn retired(&mut self) -> Option<&'static mut Encoder<HEADS>> {
        self.retired.dequeue()
    }

    /// From now on every sample is compared with the Halls; `None` stops it.
    pub fn watch(&mut self, check: Option<TurnCheck>) {
        self.check = check;
        self.zero = TurnZero::default();
    }

    /// The next sample, compared with the Halls where both have an angle. A disagreement makes a running drive fail with
    /// [`Fault::Turns`].
    pub fn poll(&mut self, service: &mut Service) -> Option<(Absolute<HEADS>, Result<(), Disagreement>)> {
        let absolute = self.samples.dequeue()?;
        let agreement = match (&self.check, absolute.angle) {
            (Some(check), Some(Ok(angle))) => check.check(&mut self.zero, angle, absolute.halls).map(|_| ()),
            _ => Ok(()),
        };
        if agreement.is_err() {
            // When the queue is full, the next sample says it again.
            let _ = service.trip(Fault::Turns);
        }
        Some((absolute, agreement))
    }

    /// The shaft's absolute angle by the Halls alone, once a comparison has given their turn counter its start.
    pub fn by_halls(&self, halls: Position) -> Option<MechanicalAngle> {
        self.check.and_then(|check| check.absolute(self.zero, halls))
    }
}

impl Service {
    /// Makes a running drive fail.
    ///
    /// # Errors
    /// The command, when the queue is full.
    pub fn trip(&mut self, fault: Fault) -> Result<(), Command> {
        self.send_internal(Command::Trip(fault))
    }
}
