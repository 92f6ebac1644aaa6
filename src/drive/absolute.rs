//! A drive with an absolute encoder beside its Halls: the mechanical angle from the first sample after power-up.
//!
//! [`AbsoluteDrive`] is what the interrupt owns then, around its [`Drive`], which goes on commutating by the Halls. The
//! encoder's angle is checked by itself on every sample; a task checks the Halls' turn counter against it
//! ([`AbsoluteTasks::poll`]). An encoder without an angle for longer than tolerated, or a disagreement, switches a
//! running bridge off.

use super::{Drive, Sample};
use crate::angle::{MechanicalAngle, Position};
use crate::board::encoder::AbsoluteEncoder;
use crate::board::{Legs, Output};
use crate::fault::Fault;
use crate::vernier::turns::{Disagreement, TurnCheck, TurnZero};
use heapless::spsc::{Consumer, Producer, Queue};

/// One sample of an encoder, with where the Halls were at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Absolute<Reading, Fault> {
    /// What was read of it, for a calibration such as the vernier's
    /// [`Calibrator`](crate::vernier::calibrate::Calibrator).
    pub reading: Reading,
    /// The angle, or why there is none; `None` while no encoder is installed.
    pub angle: Option<Result<MechanicalAngle, Fault>>,
    /// Position by the Halls.
    pub halls: Position,
}

/// One sample of an encoder of a kind.
pub type SampleOf<E> = Absolute<<E as AbsoluteEncoder>::Reading, <E as AbsoluteEncoder>::Fault>;

/// The queues between the interrupt and the tasks, beside those of the drive.
pub struct AbsoluteChannels<E: AbsoluteEncoder + 'static> {
    encoders: Queue<&'static mut E, 2>,
    retired: Queue<&'static mut E, 4>,
    samples: Queue<SampleOf<E>, 64>,
}

/// The interrupt's ends.
pub struct AbsoluteInterrupt<E: AbsoluteEncoder + 'static> {
    encoders: Consumer<'static, &'static mut E, 2>,
    retired: Producer<'static, &'static mut E, 4>,
    samples: Producer<'static, SampleOf<E>, 64>,
}

/// The tasks' ends.
pub struct AbsoluteTasks<E: AbsoluteEncoder + 'static> {
    encoders: Producer<'static, &'static mut E, 2>,
    retired: Consumer<'static, &'static mut E, 4>,
    samples: Consumer<'static, SampleOf<E>, 64>,
    check: Option<TurnCheck>,
    zero: TurnZero,
}

impl<E: AbsoluteEncoder + 'static> Default for AbsoluteChannels<E> {
    fn default() -> Self {
        Self::new()
    }
}

impl<E: AbsoluteEncoder + 'static> AbsoluteChannels<E> {
    /// Empty ones.
    pub const fn new() -> Self {
        Self { encoders: Queue::new(), retired: Queue::new(), samples: Queue::new() }
    }

    /// Both ends.
    pub fn split(&'static mut self) -> (AbsoluteInterrupt<E>, AbsoluteTasks<E>) {
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
pub struct AbsoluteDrive<E: AbsoluteEncoder + 'static> {
    drive: Drive,
    channels: AbsoluteInterrupt<E>,
    encoder: Option<&'static mut E>,
    state: E::State,
    angle: Option<Result<MechanicalAngle, E::Fault>>,
    /// Successive samples without an angle.
    missed: u16,
    every: u32,
    until_sample: u32,
}

impl<E: AbsoluteEncoder + 'static> AbsoluteDrive<E> {
    /// Around a drive. Every `every`-th sample, at least each, goes to the tasks.
    pub fn new(drive: Drive, channels: AbsoluteInterrupt<E>, every: u32) -> Self {
        let every = every.max(1);
        let state = E::State::default();
        Self { drive, channels, encoder: None, state, angle: None, missed: 0, every, until_sample: 1 }
    }

    /// One PWM period, as [`Drive::step`], with the encoder's heads read at the same instant.
    #[inline]
    pub fn step(&mut self, sample: &Sample, reading: E::Reading) -> Output {
        if let Some(encoder) = self.channels.encoders.dequeue() {
            self.install(encoder);
        }
        let output = self.drive.step(sample);
        let output = if self.read(reading) { output } else { self.trip(&output) };
        self.until_sample = self.until_sample.wrapping_sub(1);
        if self.until_sample == 0 {
            self.until_sample = self.every;
            let halls = self.drive.tracker().position();
            let _ = self.channels.samples.enqueue(Absolute { reading, angle: self.angle, halls });
        }
        output
    }

    /// Reads the encoder. False when it has had no angle for longer than tolerated.
    fn read(&mut self, reading: E::Reading) -> bool {
        let Some(encoder) = &self.encoder else { return true };
        let angle = encoder.angle(&mut self.state, reading);
        self.missed = if angle.is_ok() { 0 } else { self.missed.saturating_add(1) };
        self.angle = Some(angle);
        self.missed <= self.drive.config.tolerated
    }

    #[cold]
    fn install(&mut self, encoder: &'static mut E) {
        if let Some(old) = self.encoder.replace(encoder) {
            let _ = self.channels.retired.enqueue(old);
        }
        self.state = E::State::default();
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
    pub const fn angle(&self) -> Option<Result<MechanicalAngle, E::Fault>> {
        self.angle
    }

    /// Whether the angle has been proven by motion since power-up.
    pub fn is_proven(&self) -> bool {
        E::is_proven(&self.state)
    }
}

impl<E: AbsoluteEncoder + 'static> AbsoluteTasks<E> {
    /// Gives the drive a calibrated encoder, which it takes up between two steps. What it had before comes back from
    /// [`Self::retired`].
    ///
    /// # Errors
    /// The encoder, while the last one is not taken up yet.
    pub fn install(&mut self, encoder: &'static mut E) -> Result<(), &'static mut E> {
        self.zero = TurnZero::default();
        self.encoders.enqueue(encoder)
    }

    /// An encoder that the drive no longer uses.
    pub fn retired(&mut self) -> Option<&'static mut E> {
        self.retired.dequeue()
    }

    /// From now on every sample is compared with the Halls; `None` stops it.
    pub fn watch(&mut self, check: Option<TurnCheck>) {
        self.check = check;
        self.zero = TurnZero::default();
    }

    /// The next sample, compared with the Halls where both have an angle.
    pub(crate) fn compare_next(&mut self) -> Option<(SampleOf<E>, Result<(), Disagreement>)> {
        let absolute = self.samples.dequeue()?;
        let agreement = match (&self.check, absolute.angle) {
            (Some(check), Some(Ok(angle))) => check.check(&mut self.zero, angle, absolute.halls).map(|_| ()),
            _ => Ok(()),
        };
        Some((absolute, agreement))
    }

    /// The shaft's absolute angle by the Halls alone, once a comparison has given their turn counter its start.
    pub fn by_halls(&self, halls: Position) -> Option<MechanicalAngle> {
        self.check.and_then(|check| check.absolute(self.zero, halls))
    }
}
