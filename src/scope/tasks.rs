//! The tasks' end.

use super::{CHANNELS, Plan, Recorder, Recording, Row};
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use heapless::spsc::{Consumer, Producer, Queue};

/// What both ends tell each other while a recording is on its way.
#[derive(Default)]
pub(super) struct Shared {
    /// By the tasks: a command has been sent to the drive.
    pub commanded: AtomicBool,
    /// By the tasks: it is to end as it is.
    pub cancelled: AtomicBool,
    /// By the interrupt.
    pub triggered: AtomicBool,
    /// By the tasks once they have sent a recording, by the interrupt before it gives it back. One look at it in every period
    /// costs less than one at a queue.
    pub lent: AtomicBool,
}

/// What connects both ends.
#[derive(Default)]
pub struct Channels {
    to: Queue<&'static mut Recording, 2>,
    back: Queue<&'static mut Recording, 2>,
    shared: Shared,
}

impl Channels {
    /// Empty ones.
    pub const fn new() -> Self {
        let shared = Shared {
            commanded: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            triggered: AtomicBool::new(false),
            lent: AtomicBool::new(false),
        };
        Self { to: Queue::new(), back: Queue::new(), shared }
    }

    /// Both ends, with the memory for a recording; without, it has to be [given](Scope::give).
    pub fn split(&'static mut self, recording: Option<&'static mut Recording>) -> (Recorder, Scope) {
        let (to, come) = self.to.split();
        let (done, back) = self.back.split();
        let shared = &self.shared;
        (Recorder { come, done, shared, recording: None }, Scope { to, back, shared, recording })
    }
}

/// How a recording is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum State {
    /// There is none.
    #[default]
    None,
    /// It waits for its trigger.
    Waiting,
    /// The rows after the trigger are being taken.
    Triggered,
    /// It is complete.
    Done,
}

/// A recording is under way: it has to be [cancelled](Scope::cancel) first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

/// What a task owns.
pub struct Scope {
    to: Producer<'static, &'static mut Recording, 2>,
    back: Consumer<'static, &'static mut Recording, 2>,
    shared: &'static Shared,
    /// While the interrupt does not have it.
    recording: Option<&'static mut Recording>,
}

impl Scope {
    /// Begins a recording; the one before is lost.
    ///
    /// # Errors
    /// [`Busy`]; nothing has changed then.
    pub fn begin(&mut self, plan: &Plan) -> Result<(), Busy> {
        self.poll();
        let recording = self.recording.take().ok_or(Busy)?;
        recording.restart(plan);
        let Shared { commanded, cancelled, triggered, lent } = self.shared;
        commanded.store(false, Relaxed);
        cancelled.store(false, Relaxed);
        triggered.store(false, Relaxed);
        // It has room, as there is one recording.
        self.to.enqueue(recording).map_err(|recording| {
            self.recording = Some(recording);
            Busy
        })?;
        lent.store(true, Relaxed);
        Ok(())
    }

    /// Ends a recording that is under way, at the next period; a complete one is kept.
    pub fn cancel(&self) {
        self.shared.cancelled.store(true, Relaxed);
    }

    /// Gives it memory for a recording.
    pub fn give(&mut self, recording: &'static mut Recording) {
        self.recording = Some(recording);
    }

    /// Takes the memory, if the interrupt does not have it; what was recorded is lost.
    pub fn take_memory(&mut self) -> Option<&'static mut Recording> {
        self.poll();
        self.recording.take()
    }

    /// A command is sent to the drive, which may be the trigger.
    pub fn commanded(&self) {
        self.shared.commanded.store(true, Relaxed);
    }

    #[cfg_attr(feature = "small", inline(never))]
    fn poll(&mut self) {
        if let Some(recording) = self.back.dequeue() {
            self.recording = Some(recording);
        }
    }

    /// How it is.
    pub fn state(&mut self) -> State {
        self.poll();
        match &self.recording {
            Some(recording) if recording.is_complete() => State::Done,
            Some(_) => State::None,
            None if self.shared.triggered.load(Relaxed) => State::Triggered,
            None => State::Waiting,
        }
    }

    /// A row of a complete recording, the oldest first.
    pub fn row(&mut self, number: u16) -> Option<Row> {
        self.raw(number).map(|row| row.map(u32::cast_signed))
    }

    /// The same where it lies, as bits.
    pub fn raw(&mut self, number: u16) -> Option<&[u32; CHANNELS]> {
        self.poll();
        self.recording.as_ref()?.raw(number)
    }
}
