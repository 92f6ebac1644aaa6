//! The seam of the emulator: on one side the Cortex-M core, on the other the chip, the board and the motor.
//!
//! The core owns the instructions, the RAM, the exceptions and everything at `0xE000_0000` and above. Everything else that an
//! address can reach is a [`System`]. Time is counted in [`Cycle`]s of HCLK; the core drives it, the system follows.

mod disturbance;
mod facts;

pub use disturbance::{Disturbance, HallFault};
pub use facts::{Clock, Edge, Facts, Leg, Pwm, Range, Sampling, Trace, Watchdog};

use serde::Serialize;
use std::fmt;

/// Cycles of HCLK since power-on. Keeps counting over a reset. How long one lasts is [`System::hclk_hz`]'s answer, which
/// changes while the firmware programs the clock tree; [`System::seconds`] adds them up.
pub type Cycle = u64;

/// Size of an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// 8 bits.
    Byte,
    /// 16 bits.
    Half,
    /// 32 bits.
    Word,
}

impl Width {
    /// Bytes: 1, 2 or 4.
    pub const fn bytes(self) -> u32 {
        match self {
            Width::Byte => 1,
            Width::Half => 2,
            Width::Word => 4,
        }
    }
}

/// Why an access is wrong. Each is listed in the report with program counter, symbol, line and count; none is silently
/// accepted.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub enum Complaint {
    /// The peripheral's clock is off.
    Unclocked {
        /// As the reference manual calls it, e.g. `ADC2`.
        peripheral: &'static str,
    },
    /// The register exists, the model of it does not.
    Unmodelled {
        /// As the reference manual calls it.
        peripheral: &'static str,
        /// Offset from the peripheral's base, bytes.
        register: u32,
    },
    /// The chip would take it, but what the firmware does is wrong (a reserved value, a sequence out of order, …).
    Wrong {
        /// As the reference manual calls it.
        peripheral: &'static str,
        /// What is wrong, for a person.
        what: String,
    },
    /// Nothing is at this address: the core takes a bus fault.
    Unmapped,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Complaint::Unclocked { peripheral } => write!(f, "{peripheral} is not clocked"),
            Complaint::Unmodelled { peripheral, register } => {
                write!(f, "{peripheral}: the register at {register:#05x} is not modelled")
            }
            Complaint::Wrong { peripheral, what } => write!(f, "{peripheral}: {what}"),
            Complaint::Unmapped => write!(f, "nothing is at this address"),
        }
    }
}

/// What reset the chip (RM0440, 7.4.29, RCC_CSR, and power-on).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ResetCause {
    /// Power came (back).
    PowerOn,
    /// The independent watchdog.
    Watchdog,
    /// AIRCR.SYSRESETREQ.
    Software,
    /// Flash option bytes were reloaded.
    OptionBytes,
}

/// Everything outside the core.
pub trait System {
    /// Reads a peripheral register, or flash through the bus. `now` never decreases from call to call.
    fn read(&mut self, address: u32, width: Width, now: Cycle) -> (u32, Option<Complaint>);

    /// Writes one.
    fn write(&mut self, address: u32, width: Width, value: u32, now: Cycle) -> Option<Complaint>;

    /// Brings peripherals and motor to `now`; returns when something happens next at the latest, always later than `now`, so
    /// that the core can run until then in one go. The core asks again at that cycle and after every read and write.
    fn advance(&mut self, now: Cycle) -> Cycle;

    /// Level of each interrupt line at the last access or `advance`: bit n is IRQ n.
    fn interrupts(&self) -> u128;

    /// When a reset is asked for from outside the core (watchdog, the power coming back, …), its cause, once.
    fn take_reset(&mut self) -> Option<ResetCause>;

    /// Contents of the flash at `0x0800_0000`, whole.
    fn flash(&self) -> &[u8];

    /// Byte offsets into [`System::flash`] that changed since the last call.
    fn take_flash_changes(&mut self) -> Vec<core::ops::Range<u32>>;

    /// Data are read from the flash at this offset; whether they cannot be corrected, which is a non-maskable interrupt (RM0440, 3.3.4).
    fn reads_torn_flash(&mut self, offset: u32) -> bool {
        let _ = offset;
        false
    }

    /// Cycles that the core is held before its next instruction, once: a flash operation stalls fetches from flash
    /// (RM0440, 3.3.8).
    fn take_stall(&mut self) -> Cycle {
        0
    }

    /// Puts the registers into their reset state. Flash, motor, and time go on.
    fn reset(&mut self, cause: ResetCause);

    /// HCLK as the clock tree is programmed at this moment.
    fn hclk_hz(&self) -> f64;

    /// Time since power-on, seconds.
    fn seconds(&self, at: Cycle) -> f64;

    /// Flash wait states as programmed (FLASH_ACR.LATENCY).
    fn flash_wait_states(&self) -> u32;

    /// The last ADC trigger whose end of sequence raised an interrupt line: line and cycle of the trigger.
    fn last_sampling(&self) -> Option<(u16, Cycle)> {
        None
    }

    /// Does to the board or the motor what a script asks. Refuses what the board has not, saying what.
    fn disturb(&mut self, disturbance: &Disturbance, now: Cycle) -> Result<(), String>;

    /// Bytes that the firmware sent over its serial port since the last call.
    fn take_serial(&mut self) -> Vec<u8>;

    /// What was seen at the pins so far.
    fn facts(&self) -> Facts;

    /// Traces recorded since the last call.
    fn take_trace(&mut self) -> Trace;
}
