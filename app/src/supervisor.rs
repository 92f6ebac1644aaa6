//! The tasks of a drive without a runtime: three calls.

use crate::Request;
use crate::encoder::{Encoder, NoEncoder};
use crate::housekeeping::Readings;
use crate::outbox::Outbox;
#[cfg(feature = "registers")]
use crate::registers::Registers;
use crate::requests::{Awaited, Step};
use crate::stop::Dealt;
use crate::tasks::{Tasks, start};
use crate::{Identity, Memory};
use embedded_storage::nor_flash::NorFlash;
use hallservo::drive::Drive;
use hallservo::settings::{self, Settings};
use hallservo_protocol::{Answer, Decoder, Error, Refusal};

/// Ticks until a control interrupt that does not answer is given up.
const ANSWER_TIMEOUT: u32 = 100;

/// Everything that a drive does beside its control interrupt: commands, telemetry, adaptation, procedures and storage.
///
/// A main loop, a task of RTIC or of an RTOS calls [`tick`](Self::tick) once a millisecond, [`receive`](Self::receive)
/// with what came over the line and [`transmit`](Self::transmit) for what is to go out. None of them waits, but two of
/// a tick's duties take long: the fit after a calibration and a write to the flash, up to a quarter of a second. So the
/// tasks run at the lowest priority.
#[repr(C)]
pub struct Supervisor<F, E: Encoder = NoEncoder> {
    pending: Option<Pending>,
    /// Bytes taken from the line, wrapping.
    taken: u32,
    /// Frames taken from the bus, wrapping.
    #[cfg(feature = "registers")]
    frames: u32,
    alive: Alive,
    tasks: Tasks<F, E>,
    outbox: Outbox,
    decoder: Decoder,
    #[cfg(feature = "registers")]
    registers: Registers,
}

/// A request that is answered when the control interrupt has, or the flash.
#[derive(Clone, Copy)]
struct Pending {
    id: u16,
    awaited: Awaited,
    ticks: u32,
}

/// What has run since the watchdog was fed last.
#[derive(Default)]
struct Alive {
    ticked: bool,
    received: bool,
    transmitted: bool,
    /// Count of control periods now, and when the watchdog was fed last.
    periods: u32,
    periods_before: u32,
}

impl<F: NorFlash> Supervisor<F> {
    /// Reads the flash and decides what the drive starts with. The drive belongs to the control interrupt, the
    /// supervisor to the tasks. `first_block` is the address of the first of [`BLOCKS`](crate::storage::BLOCKS)
    /// erasable blocks of the flash.
    ///
    /// # Errors
    /// The board's own `defaults` are invalid, which a test of the board shows.
    pub fn start(
        identity: Identity,
        defaults: Settings,
        flash: F,
        first_block: u32,
        memory: &'static mut Memory<F>,
    ) -> Result<(&'static mut Drive, &'static mut Self), settings::Error<'static>> {
        start(identity, defaults, flash, first_block, memory)
    }
}

impl<F: NorFlash, E: Encoder> Supervisor<F, E> {
    /// The same with an encoder, for which there are [`ENCODER_BLOCKS`](crate::storage::ENCODER_BLOCKS) behind the others.
    ///
    /// # Errors
    /// As [`start`](Supervisor::start).
    pub fn start_with_encoder(
        identity: Identity,
        defaults: Settings,
        flash: F,
        first_block: u32,
        memory: &'static mut Memory<F, E>,
    ) -> Result<(&'static mut E::Drive, &'static mut Self), settings::Error<'static>> {
        start(identity, defaults, flash, first_block, memory)
    }

    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub(crate) fn new(tasks: Tasks<F, E>) -> Self {
        Self {
            tasks,
            decoder: Decoder::new(),
            outbox: Outbox::new(),
            pending: None,
            #[cfg(feature = "registers")]
            registers: Registers::new(),
            taken: 0,
            #[cfg(feature = "registers")]
            frames: 0,
            alive: Alive::default(),
        }
    }

    /// The control interrupt's end of the scope, once; without one that takes rows, the drive says that it has no scope.
    #[cfg(feature = "scope")]
    pub const fn recorder(&mut self) -> Option<hallservo::scope::Recorder> {
        self.tasks.scope.recorder()
    }

    /// Before the first tick.
    pub(crate) const fn tasks(&mut self) -> &mut Tasks<F, E> {
        &mut self.tasks
    }

    /// Everything that is due every millisecond. `now_ms` is the time since power-up; ticks that were missed are not
    /// made up for.
    // A stack frame of its own, which is not to add to what a request takes.
    #[inline(never)]
    pub fn tick(&mut self, now_ms: u64, readings: Readings) {
        self.alive.ticked = true;
        self.alive.periods = readings.periods;
        self.tasks.tick(now_ms, readings);
        if self.outbox.tick() {
            self.tasks.lost_frames = self.tasks.lost_frames.saturating_add(1);
        }
        self.answer_pending();
        #[cfg(feature = "registers")]
        if self.pending.is_none() {
            self.registers.tick(&mut self.tasks);
        }
        self.stream();
    }

    // Answers are large: what holds one has a stack frame of its own.
    #[inline(never)]
    fn stream(&mut self) {
        if let Some((id, telemetry)) = self.tasks.telemetry()
            && !self.outbox.push_if_spare(id, &Answer::Telemetry(telemetry))
        {
            self.tasks.lost_frames = self.tasks.lost_frames.saturating_add(1);
        }
    }

    /// Takes bytes from the line and returns how many: fewer than all while a request waits for its answer, or answers
    /// wait to be transmitted, which they do for a tenth of a second at most. The rest is to be offered again after the
    /// next tick.
    pub fn receive(&mut self, bytes: &[u8]) -> usize {
        self.alive.received = true;
        for (taken, byte) in bytes.iter().enumerate() {
            if self.is_busy() || !self.outbox.has_room() {
                return taken;
            }
            self.taken = self.taken.wrapping_add(1);
            self.push(*byte);
        }
        bytes.len()
    }

    /// Whether the drive owes an answer, which it does for a millisecond or two after a command: until then no other is
    /// taken.
    pub const fn is_busy(&self) -> bool {
        #[cfg(feature = "registers")]
        if self.registers.waits() {
            return true;
        }
        self.pending.is_some()
    }

    /// What is dealt with: `None` while a request waits for the drive. For [`Stop::release`](crate::Stop::release),
    /// after every tick.
    pub fn dealt_with(&self) -> Option<Dealt> {
        // What a client has asked for before has its turn as well.
        #[cfg(feature = "registers")]
        let waits = self.registers.has_wish();
        #[cfg(not(feature = "registers"))]
        let waits = false;
        (!waits && !self.is_busy() && !self.tasks.disarm_due).then_some(Dealt {
            counts: [
                self.taken,
                #[cfg(feature = "registers")]
                self.frames,
            ],
            #[cfg(feature = "registers")]
            address: self.registers.address(),
        })
    }

    /// Writes bytes for the line and returns how many; 0 where nothing is to go out.
    pub fn transmit(&mut self, bytes: &mut [u8]) -> usize {
        self.alive.transmitted = true;
        self.outbox.pop(bytes)
    }

    /// Whether the watchdog may be fed: since it last returned true, control periods have passed and all of
    /// [`tick`](Self::tick), [`receive`](Self::receive) and [`transmit`](Self::transmit) were called, be it with
    /// nothing to carry.
    pub fn is_alive(&mut self) -> bool {
        let Alive { ticked, received, transmitted, periods, periods_before } = self.alive;
        let alive = ticked && received && transmitted && periods != periods_before;
        if alive {
            self.alive = Alive { periods, periods_before: periods, ..Alive::default() };
        }
        alive
    }

    /// Where the drive is on a bus that carries registers.
    #[cfg(feature = "registers")]
    pub const fn set_bus(&mut self, address: hallservo_registers::Address) {
        self.registers.set_address(address);
    }

    /// How that bus is.
    #[cfg(feature = "registers")]
    pub const fn set_bus_health(&mut self, health: hallservo_registers::axis::BusHealth) {
        self.registers.set_bus_health(health);
    }

    /// Where the settings say that the drive is on a bus.
    #[cfg(feature = "registers")]
    pub fn bus_address(&self) -> hallservo_registers::Address {
        let settings = &self.tasks.settings;
        hallservo_registers::Address { id: settings.bus_id, prefix: settings.bus_prefix as u16 }
    }

    /// A frame of registers from a bus, and its reply; not to be called while the drive [is busy](Self::is_busy).
    #[cfg(feature = "registers")]
    #[inline(never)]
    pub fn frame(&mut self, request: &hallservo_registers::Request) -> Option<hallservo_registers::Reply> {
        self.frames = self.frames.wrapping_add(1);
        self.registers.handle(request, &mut self.tasks)
    }

    fn push(&mut self, byte: u8) {
        #[cfg(feature = "registers")]
        self.registers.hear(byte, &mut self.tasks, &mut self.outbox);
        let Self { tasks, decoder, .. } = self;
        match &decoder.push::<Request<'_>>(byte) {
            None => {}
            Some(Ok(request)) => {
                let mut answer = Answer::Done;
                match tasks.begin(request, &mut answer) {
                    Step::Answered => self.outbox.push(request.id, &answer),
                    Step::Await(awaited) => self.pending = Some(Pending { id: request.id, awaited, ticks: 0 }),
                }
            }
            Some(Err(error)) => {
                tasks.garbage = tasks.garbage.saturating_add(1);
                if !matches!(error, Error::Version { .. }) {
                    return;
                }
                // The tool has to learn the version of the drive.
                self.outbox.push(0, &tasks.hello());
            }
        }
    }

    #[inline(never)]
    fn answer_pending(&mut self) {
        let Some(pending) = &mut self.pending else { return };
        pending.ticks += 1;
        let Pending { id, awaited, ticks } = *pending;
        let answer = &match self.tasks.awaited(awaited) {
            Some(answer) => answer,
            None if ticks < ANSWER_TIMEOUT => return,
            None => {
                self.tasks.give_up(awaited);
                Answer::Refused(Refusal::NoAnswer)
            }
        };
        self.pending = None;
        self.outbox.push(id, answer);
    }
}
