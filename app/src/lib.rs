//! What every drive runs beside the control interrupt: the tasks for commands, telemetry, adaptation, storage and the watchdog.
//!
//! `no_std`, no allocation, no `unsafe`, no peripheral: a real board, the emulated one and the simulated drive run this same
//! code and differ in what they give it: a flash, a serial line, a clock (`embassy-time`), and the control interrupt.
//!
//! ```ignore
//! static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new(Memory::new());
//! static ALIVE: Heartbeat = Heartbeat::new();
//!
//! let (drive, app) = hallservo_app::start(IDENTITY, defaults, flash, PLACE, MEMORY.take(), APP.uninit());
//! // The control interrupt owns the drive: ALIVE.beat(&sample); let output = drive.step(&sample);
//! app.run(rx, tx, &ALIVE, || watchdog.pet()).await
//! ```
//!
//! # The flash
//! [`saving::BLOCKS`] erasable blocks from `place` on, two for each kind of [record](hallservo::storage): sensors, cogging, settings. It is written only
//! while the bridge is off and the rotor at rest, for an erase stalls the core; what is to be saved meanwhile waits. A calibration and a learnt table of
//! the cogging are saved by themselves. So is what the adaptation has learnt, when it differs from what is stored by more
//! than [`saving::WORTH`], and not more often than every [`saving::REST_S`]. Settings are saved when asked to.
//!
//! A record that is corrupt or foreign is named in the history, the log and the status; the drive then starts with the board's
//! settings, or without a calibration, and never with half of either.
#![no_std]

mod fmt;
mod heartbeat;
mod history;
mod learning;
mod measure;
mod procedure;
mod request;
mod run;
pub mod saving;
pub mod settings;
mod supervisor;
pub mod wire;

pub use heartbeat::Heartbeat;
pub use run::App;

use crate::supervisor::Supervisor;
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use hallservo::control::cogging::Table;
use hallservo::drive::{Channels, Drive};
use hallservo::hall::estimate::Estimator;
use hallservo::service::Service;
use hallservo::settings::{Config, Settings};
use learning::Learning;
use procedure::Procedure;

/// What the board is, for a person who asks.
#[derive(Clone, Copy, Debug)]
pub struct Identity {
    /// Name of the board, up to 40 bytes.
    pub board: &'static str,
    /// Version of the firmware, up to 40 bytes.
    pub firmware: &'static str,
}

/// What outlives everything: a static of a board, leaked memory of a host. What [`start`] fills is not initialised, so that a
/// static is all zeros, which neither the flash nor the stack of a chip has to hold.
pub struct Memory {
    channels: Channels,
    tables: [Table; 2],
    estimators: [MaybeUninit<Estimator>; 2],
    /// Settings on their way to the drive.
    config: MaybeUninit<Config>,
    /// What is large, and would pass over the stack otherwise.
    service: MaybeUninit<Service>,
    procedure: MaybeUninit<Option<Procedure>>,
    learning: MaybeUninit<Learning>,
}

impl Memory {
    /// Of one drive.
    pub const fn new() -> Self {
        Self {
            channels: Channels::new(),
            tables: [Table::ZERO; 2],
            estimators: [MaybeUninit::uninit(), MaybeUninit::uninit()],
            config: MaybeUninit::uninit(),
            service: MaybeUninit::uninit(),
            procedure: MaybeUninit::uninit(),
            learning: MaybeUninit::uninit(),
        }
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

/// Reads the flash and decides what the drive starts with. `place` is the address of the first of six erasable blocks; `app` is
/// where the application is to live, so that it is not moved over a small stack.
///
/// # Panics
/// When the board's own `defaults` are invalid, which a test of the board shows.
pub fn start<F: NorFlash>(
    identity: Identity,
    defaults: Settings,
    flash: F,
    place: u32,
    memory: &'static mut Memory,
    app: &'static mut MaybeUninit<App<F>>,
) -> (Drive, &'static App<F>) {
    Supervisor::start(identity, defaults, flash, place, memory, app)
}
