//! What every drive runs beside the control interrupt: commands, telemetry, adaptation, procedures, storage and a sign
//! of life for the watchdog.
//!
//! `no_std`, no allocation, no `unsafe`, no peripheral and no runtime: a [`Supervisor`] has one call for time and one
//! for each direction of a serial line. A main loop, RTIC or an RTOS calls them; the module `embassy` does with
//! the feature of that name.
//!
//! ```
//! use embedded_storage::nor_flash::NorFlash;
//! use hallservo::{drive::Drive, settings::{Error, Settings}};
//! use hallservo_app::{Housekeeping, Identity, Memory, Supervisor};
//! # trait Board {
//! #     fn start_control_interrupt(&mut self, drive: &'static mut Drive);
//! #     fn millis(&self) -> u64;
//! #     fn received(&mut self) -> &[u8];
//! #     fn consume(&mut self, bytes: usize);
//! #     fn send(&mut self, bytes: &[u8]);
//! #     fn feed_watchdog(&mut self);
//! # }
//!
//! // In the control interrupt: HOUSEKEEPING.update(&sample); let output = drive.step(&sample);
//! static HOUSEKEEPING: Housekeeping = Housekeeping::new();
//!
//! // `memory` is a static: `static MEMORY: ConstStaticCell<Memory<Flash>> = ConstStaticCell::new(Memory::new());`
//! fn run<F: NorFlash>(
//!     flash: F,
//!     memory: &'static mut Memory<F>,
//!     board: &mut impl Board,
//! ) -> Result<(), Error<'static>> {
//!     let identity = Identity { board: "mine", firmware: "1.0", serial: [1, 2, 3] };
//!     let (drive, supervisor) = Supervisor::start(identity, Settings::default(), flash, 0, memory)?;
//!     board.start_control_interrupt(drive);
//!     let (mut ticked_ms, mut bytes) = (0, [0; 64]);
//!     loop {
//!         let taken = supervisor.receive(board.received());
//!         board.consume(taken);
//!         let length = supervisor.transmit(&mut bytes);
//!         board.send(&bytes[..length]);
//!         let now_ms = board.millis();
//!         if now_ms != ticked_ms {
//!             ticked_ms = now_ms;
//!             supervisor.tick(now_ms, HOUSEKEEPING.read());
//!         }
//!         if supervisor.is_alive() {
//!             board.feed_watchdog();
//!         }
//!     }
//! }
//! ```
//!
//! # The flash
//! [`storage::BLOCKS`] erasable blocks for all kinds of [records](hallservo::storage): sensors, cogging, settings.
//! With the features `encoder` and `map`, [`storage::ENCODER_BLOCKS`] and [`storage::MAP_BLOCKS`] follow.
//! It is written only while the bridge is off and the rotor at rest, for an erase stalls the core; what is to be saved
//! meanwhile waits. A calibration and a learnt table of the cogging are saved by themselves. So is what the adaptation
//! has learnt, when it differs from what is stored by more than [`storage::LEAST_CHANGE`], and not more often than
//! every [`storage::SAVE_INTERVAL_S`]. Settings are saved on request.
//!
//! A calibration takes the place of the one before when it has succeeded, and so of the map of the magnets, which is given
//! up then, in the flash after the new calibration is there. While it runs, the drive has neither. Whatever ends it but
//! success, the sensors are those of before, whether the flash holds them yet or not, and the map is that of the flash.
//!
//! A record that is corrupt or foreign is named in the history, the log and the status; the drive then starts with the
//! board's settings, or without a calibration, and never with half of either. Settings that could not be taken over may
//! have been stricter than those that it starts with: the bridge stays off until a person has confirmed these.
#![no_std]

mod adaptation;
#[cfg(feature = "registers")]
pub mod bus;
mod controller;
#[cfg(feature = "embassy")]
pub mod embassy;
pub mod encoder;
mod fmt;
mod history;
mod housekeeping;
mod magnets;
mod measure;
mod outbox;
mod procedure;
#[cfg(feature = "registers")]
mod registers;
mod requests;
mod scope;
mod stop;
pub mod storage;
mod supervisor;
mod tasks;

pub use housekeeping::{Housekeeping, Readings};
#[cfg(feature = "registers")]
pub use stop::FrameListener;
pub use stop::{Dealt, Listener, Stop};
pub use supervisor::Supervisor;

use adaptation::SensorAdaptation;
use core::mem::MaybeUninit;
use encoder::{Encoder, NoEncoder};
use hallservo::config::Config;
use hallservo::control::Impedance;
use hallservo::control::cogging::Table;
use hallservo::drive::Channels;
use hallservo::hall::estimate::Estimator;
use hallservo::service::Service;
use magnets::MagnetMemory;
use procedure::Procedure;
use scope::ScopeMemory;

/// A request and what it asks as a drive takes them, with the bytes of names.
type Request<'a> = hallservo_protocol::RequestBy<&'a [u8]>;
type Ask<'a> = hallservo_protocol::AskBy<&'a [u8]>;

/// What the drive says it is, to whoever asks.
#[derive(Clone, Copy, Debug)]
pub struct Identity {
    /// Name of the board, up to 40 bytes.
    pub board: &'static str,
    /// Version of the firmware, up to 40 bytes.
    pub firmware: &'static str,
    /// Serial number of the chip, the lowest word first: it tells a board from others of its kind.
    pub serial: [u32; 3],
}

/// The memory of one drive and its supervisor: a static. What [`Supervisor::start`] fills is not initialised, so that
/// the static is all zeros, which neither the flash nor the stack of a chip has to hold.
pub struct Memory<F, E: Encoder = NoEncoder> {
    drive: MaybeUninit<E::Drive>,
    channels: Channels,
    tables: [Table; 2],
    impedances: [MaybeUninit<Impedance>; 2],
    estimators: [MaybeUninit<Estimator>; 2],
    /// Settings on their way to the drive.
    config: MaybeUninit<Config>,
    service: MaybeUninit<Service>,
    procedure: MaybeUninit<Option<Procedure>>,
    adaptation: MaybeUninit<SensorAdaptation>,
    encoder: E::Memory,
    magnets: MagnetMemory,
    scope: ScopeMemory,
    supervisor: MaybeUninit<Supervisor<F, E>>,
}

impl<F> Memory<F> {
    /// Of one drive.
    pub const fn new() -> Self {
        Self::with_encoder()
    }
}

impl<F, E: Encoder> Memory<F, E> {
    /// Of one drive with an encoder.
    pub const fn with_encoder() -> Self {
        Self {
            drive: MaybeUninit::uninit(),
            channels: Channels::new(),
            tables: [Table::ZERO; 2],
            impedances: [const { MaybeUninit::uninit() }; 2],
            estimators: [const { MaybeUninit::uninit() }; 2],
            config: MaybeUninit::uninit(),
            service: MaybeUninit::uninit(),
            procedure: MaybeUninit::uninit(),
            adaptation: MaybeUninit::uninit(),
            encoder: E::MEMORY,
            magnets: MagnetMemory::new(),
            scope: ScopeMemory::new(),
            supervisor: MaybeUninit::uninit(),
        }
    }
}

impl<F> Default for Memory<F> {
    fn default() -> Self {
        Self::new()
    }
}
