//! A drive with an absolute encoder beside its Halls: the mechanical angle from the first sample after power-up.
//!
//! [`AbsoluteDrive`] is what the interrupt owns then, around its [`Drive`], which goes on commutating by the Halls. The
//! encoder's angle is checked by itself on every sample. Once its [`Mounting`] is known, the position counts from its
//! zero, it may close the loops, and every step checks the Halls' count against it (`mounted`). Before that a task can
//! compare them ([`AbsoluteTasks::watch`]). An encoder without an angle for longer than tolerated, or a disagreement,
//! switches a running bridge off, unless the mounting says that the Halls take over.

mod mounted;

use super::{Drive, Sample};
use crate::angle::{MechanicalAngle, Position};
use crate::board::encoder::AbsoluteEncoder;
use crate::board::{Interlock, Legs, Output};
use crate::fault::Fault;
use crate::vernier::turns::{Disagreement, TurnCheck, TurnZero};
use heapless::spsc::{Consumer, Producer, Queue};
use mounted::Mounted;
pub use mounted::Mounting;

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
    /// Position of the rotor: by the encoder, where that closes the loops.
    pub position: Position,
    /// Whether that counts from the zero of the encoder's [`Mounting`].
    pub absolute: bool,
    /// Whether the encoder is in use: mounted, counting, and not lost.
    pub used: bool,
    /// Whether motion has shown the angle to be right.
    pub proven: bool,
    /// Number of the sample, wrapping: a gap tells that some were lost.
    pub number: u32,
}

/// One sample of an encoder of a kind.
pub type SampleOf<E> = Absolute<<E as AbsoluteEncoder>::Reading, <E as AbsoluteEncoder>::Fault>;

/// What the tasks tell the interrupt, beside a new encoder.
#[derive(Clone, Copy, Debug)]
enum Order {
    Remove,
    Mount(Option<Mounting>),
    Count,
}

/// The queues between the interrupt and the tasks, beside those of the drive.
pub struct AbsoluteChannels<E: AbsoluteEncoder + 'static> {
    encoders: Queue<&'static mut E, 2>,
    orders: Queue<Order, 4>,
    retired: Queue<&'static mut E, 4>,
    samples: Queue<SampleOf<E>, 64>,
}

/// The interrupt's ends.
pub struct AbsoluteInterrupt<E: AbsoluteEncoder + 'static> {
    encoders: Consumer<'static, &'static mut E, 2>,
    orders: Consumer<'static, Order, 4>,
    retired: Producer<'static, &'static mut E, 4>,
    samples: Producer<'static, SampleOf<E>, 64>,
}

/// The tasks' ends.
pub struct AbsoluteTasks<E: AbsoluteEncoder + 'static> {
    encoders: Producer<'static, &'static mut E, 2>,
    orders: Producer<'static, Order, 4>,
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
        Self { encoders: Queue::new(), orders: Queue::new(), retired: Queue::new(), samples: Queue::new() }
    }

    /// Both ends.
    pub fn split(&'static mut self) -> (AbsoluteInterrupt<E>, AbsoluteTasks<E>) {
        let (encoders_in, encoders) = self.encoders.split();
        let (orders_in, orders) = self.orders.split();
        let (retired, retired_out) = self.retired.split();
        let (samples, samples_out) = self.samples.split();
        let interrupt = AbsoluteInterrupt { encoders, orders, retired, samples };
        let tasks = AbsoluteTasks {
            encoders: encoders_in,
            orders: orders_in,
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
    mounted: Option<Mounted>,
    /// Successive samples without an angle.
    missed: u16,
    every: u32,
    until_sample: u32,
    number: u32,
}

impl<E: AbsoluteEncoder + 'static> AbsoluteDrive<E> {
    /// Around a drive. Every `every`-th sample, at least each, goes to the tasks.
    pub fn new(drive: Drive, channels: AbsoluteInterrupt<E>, every: u32) -> Self {
        let every = every.max(1);
        Self {
            drive,
            channels,
            encoder: None,
            state: E::State::default(),
            angle: None,
            mounted: None,
            missed: 0,
            every,
            // In step with the drive's schedule, so that no sample is due in the longest of its slots.
            until_sample: 2,
            number: 0,
        }
    }

    /// One PWM period, as [`Drive::step`], with the encoder's heads read at the same instant.
    #[inline]
    pub fn step(&mut self, sample: &Sample, reading: E::Reading) -> Output {
        let before = self.drive.record.rotor.position();
        let output = self.drive.step(sample);
        self.look(before, reading, output)
    }

    /// One PWM period with an interlock, as [`Drive::step_off`].
    #[cold]
    pub fn step_off(&mut self, sample: &Sample, interlock: Interlock, reading: E::Reading) -> Output {
        let before = self.drive.record.rotor.position();
        let output = self.drive.step_off(sample, interlock);
        self.look(before, reading, output)
    }

    /// Whether the brake resistor is to be on, as [`Drive::chopper`].
    #[inline(always)]
    pub fn chopper(&mut self, sample: &Sample) -> Option<bool> {
        self.drive.chopper(sample)
    }

    /// Reads the encoder after the drive's own step. One copy for both kinds of steps, for the sake of the memory without
    /// wait states.
    #[inline(never)]
    fn look(&mut self, before: Position, reading: E::Reading, output: Output) -> Output {
        if self.channels.encoders.ready() || self.channels.orders.ready() {
            self.receive();
        }
        let halls = self.drive.record.rotor.position();
        let output = match self.read(before, reading) {
            None => output,
            Some(fault) => self.trip(fault, &output),
        };
        self.until_sample = self.until_sample.wrapping_sub(1);
        if self.until_sample == 0 {
            self.until_sample = self.every;
            self.number = self.number.wrapping_add(1);
            let mounted = self.mounted.as_ref();
            let _ = self.channels.samples.enqueue(Absolute {
                reading,
                angle: self.angle,
                halls,
                position: self.drive.record.rotor.position(),
                absolute: mounted.is_some_and(|mounted| mounted.absolute),
                used: mounted.is_some_and(Mounted::is_used),
                proven: E::is_proven(&self.state),
                number: self.number,
            });
        }
        output
    }

    /// Reads the encoder. A fault when it has had no angle for longer than tolerated, or disagrees with the Halls.
    #[inline(always)]
    fn read(&mut self, before: Position, reading: E::Reading) -> Option<Fault> {
        let encoder = self.encoder.as_ref()?;
        let angle = encoder.angle(&mut self.state, reading);
        self.missed = if angle.is_ok() { 0 } else { self.missed.saturating_add(1) };
        self.angle = Some(angle);
        let lost = self.missed > self.drive.config.tolerated;
        let Some(mounted) = &mut self.mounted else { return lost.then_some(Fault::Encoder) };
        let fault = mounted.step(&mut self.drive, before, angle.ok(), self.missed);
        if lost && !mounted.mounting.falls_back { Some(Fault::Encoder) } else { fault }
    }

    /// Takes up what the tasks have sent.
    #[cold]
    #[inline(never)]
    fn receive(&mut self) {
        if let Some(encoder) = self.channels.encoders.dequeue() {
            if let Some(old) = self.encoder.replace(encoder) {
                let _ = self.channels.retired.enqueue(old);
            }
            self.state = E::State::default();
            self.missed = 0;
        }
        match self.channels.orders.dequeue() {
            Some(Order::Remove) => {
                self.mounted = None;
                self.angle = None;
                if let Some(old) = self.encoder.take() {
                    let _ = self.channels.retired.enqueue(old);
                }
            }
            Some(Order::Mount(mounting)) => self.mounted = mounting.map(Mounted::new),
            Some(Order::Count) => self.mounted.iter_mut().for_each(Mounted::count),
            None => {}
        }
    }

    /// Off, if the bridge was on.
    #[cold]
    fn trip(&mut self, fault: Fault, output: &Output) -> Output {
        if output.legs != Legs::NONE {
            self.drive.fail(fault);
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

    /// Takes the encoder from the drive; it comes back from [`Self::retired`].
    ///
    /// # Errors
    /// False, while the last orders are not taken up yet.
    pub fn remove(&mut self) -> bool {
        self.orders.enqueue(Order::Remove).is_ok()
    }

    /// Tells the drive how its encoder is mounted; `None`: not at all, or nobody knows. The position does not count from
    /// its zero before [`Self::count`].
    ///
    /// # Errors
    /// False, while the last orders are not taken up yet.
    pub fn mount(&mut self, mounting: Option<Mounting>) -> bool {
        self.orders.enqueue(Order::Mount(mounting)).is_ok()
    }

    /// The position counts from the encoder's zero from now on, or from when the bridge is off: encoder and Halls
    /// were found to agree.
    pub fn count(&mut self) -> bool {
        self.orders.enqueue(Order::Count).is_ok()
    }

    /// From now on every sample is compared with the Halls; `None` stops it.
    pub fn watch(&mut self, check: Option<TurnCheck>) {
        self.check = check;
        self.zero = TurnZero::default();
    }

    /// The next sample.
    pub fn take(&mut self) -> Option<SampleOf<E>> {
        self.samples.dequeue()
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
