//! What an emulated Cortex-M and the chip around it know of each other: accesses to the bus, interrupt lines, resets
//! and time.
//!
//! The core owns the instructions, the RAM, the exceptions and the private peripherals from `0xE000_0000` on.
//! Everything else that an address can reach is a [`Bus`], which also says by its [`Integration`] where the memories
//! are. Time is counted in [`Cycle`]s of the core's clock; the core drives it, the bus follows.

use serde::Serialize;
use std::fmt;

/// Cycles of the core's clock since power-on. Keeps counting over a reset. How long one lasts is [`Bus::clock_hz`]'s
/// answer, which changes while the firmware programs the clocks; [`Bus::seconds`] adds them up.
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

/// Why an access is wrong. The core lists each with program counter and count; none is silently accepted.
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

/// What reset the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ResetCause {
    /// Power came (back).
    PowerOn,
    /// The independent watchdog.
    Watchdog,
    /// The window watchdog.
    WindowWatchdog,
    /// AIRCR.SYSRESETREQ.
    Software,
}

/// How a core is built into a chip: where the memories are, and what Armv7-M leaves to the maker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Integration {
    /// Address of the code memory; its bytes are [`Bus::code`].
    pub code: u32,
    /// Where else the whole of it appears. The vector table is read at 0 out of reset.
    pub code_aliases: &'static [u32],
    /// The cache in front of the code memory.
    pub cache: Cache,
    /// Address of the RAM.
    pub ram: u32,
    /// Its size, bytes: a multiple of 64.
    pub ram_bytes: u32,
    /// Parts of it that appear elsewhere as well.
    pub ram_aliases: &'static [Alias],
    /// Implemented bits of a priority, from the highest: 3 to 8.
    pub priority_bits: u8,
    /// Core cycles in a cycle of SysTick's external reference.
    pub systick_reference: u64,
}

/// A part of the RAM at another address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alias {
    /// The other address.
    pub address: u32,
    /// Begin of the part, bytes from the begin of the RAM.
    pub offset: u32,
    /// Its size, bytes.
    pub bytes: u32,
}

/// A direct-mapped cache, always on. An access to a word of the code memory takes [`Bus::code_wait_states`] more than a
/// cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cache {
    /// Bytes of a line: a power of two.
    pub line_bytes: u32,
    /// Bytes that the code memory delivers at once: a power of two, of a line at most.
    pub word_bytes: u32,
    /// Lines for instructions: a power of two.
    pub instruction_lines: u32,
    /// Lines for data: a power of two.
    pub data_lines: u32,
}

/// How a line of the cache is filled. What the core waits for lies between the two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum Fill {
    /// With the word that was missing the whole line is there.
    AtOnce,
    /// The memory goes on to read the line word by word: each comes an access later than the one before, and what else
    /// is missing waits until the line is full.
    #[default]
    WordByWord,
}

/// Everything outside the core.
pub trait Bus {
    /// How the core is built in; the same for ever.
    fn integration(&self) -> Integration;

    /// Reads what is neither RAM nor code memory. `now` never decreases from call to call.
    fn read(&mut self, address: u32, width: Width, now: Cycle) -> (u32, Option<Complaint>);

    /// Writes anything but RAM; a write to code memory programs it.
    fn write(&mut self, address: u32, width: Width, value: u32, now: Cycle) -> Option<Complaint>;

    /// Brings everything to `now`; returns when something happens next at the latest, always later than `now`, so that
    /// the core can run until then in one go. The core asks again at that cycle and after every read and write.
    fn advance(&mut self, now: Cycle) -> Cycle;

    /// Level of each interrupt line at the last access or `advance`: bit n is IRQ n.
    fn interrupts(&self) -> u128;

    /// When what an interrupt line tells of began, if that is known: the trigger of a conversion, say. Latency is
    /// counted from there as well.
    fn origin(&self, line: u16) -> Option<Cycle> {
        let _ = line;
        None
    }

    /// When a reset is asked for from outside the core (watchdog, the power coming back, …), its cause, once.
    fn take_reset(&mut self) -> Option<ResetCause>;

    /// Puts the registers into their reset state. Code memory and time go on.
    fn reset(&mut self, cause: ResetCause);

    /// Contents of the code memory, whole.
    fn code(&self) -> &[u8];

    /// Byte offsets into [`Bus::code`] that changed since the last call.
    fn take_code_changes(&mut self) -> Vec<core::ops::Range<u32>> {
        Vec::new()
    }

    /// Data are read from the code memory at this offset; whether they cannot be corrected, which is a non-maskable
    /// interrupt.
    fn code_is_torn(&mut self, offset: u32) -> bool {
        let _ = offset;
        false
    }

    /// Wait states of the code memory as programmed.
    fn code_wait_states(&self) -> u32;

    /// Whether the next line of instructions is fetched from the code memory before it is needed.
    fn code_prefetch(&self) -> bool {
        false
    }

    /// Cycles that the core is held before its next instruction, once: while the code memory is busy, nothing is
    /// fetched from it.
    fn take_stall(&mut self) -> Cycle {
        0
    }

    /// The core's clock at this moment.
    fn clock_hz(&self) -> f64;

    /// Time since power-on, seconds.
    fn seconds(&self, at: Cycle) -> f64;
}
