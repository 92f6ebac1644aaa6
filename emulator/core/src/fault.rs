//! Faults, from the instruction that raises one to the report a person reads.

use serde::Serialize;

/// Why an instruction did not complete (B1.5.14).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No such instruction, or one that this machine knows not.
    Undefined,
    /// A branch to an even address: there is no Arm state.
    InvalidState,
    /// A return from an exception that does not fit.
    InvalidReturn,
    /// The FPU is off (CPACR).
    NoCoprocessor,
    Unaligned,
    DivideByZero,
    /// A data access where nothing is.
    Data(u32),
    /// A fetch where nothing is.
    Fetch,
    /// Stacking for an exception where nothing is.
    Stacking,
    /// SVC, as an exception that is taken synchronously.
    Supervisor,
    /// BKPT.
    Breakpoint(u8),
    /// Not a fault: the branch was a return from an exception, with this value.
    ExceptionReturn(u32),
}

/// CFSR bits (B3.2.15).
pub const IBUSERR: u32 = 1 << 8;
pub const PRECISERR: u32 = 1 << 9;
pub const STKERR: u32 = 1 << 12;
pub const BFARVALID: u32 = 1 << 15;
pub const UNDEFINSTR: u32 = 1 << 16;
pub const INVSTATE: u32 = 1 << 17;
pub const INVPC: u32 = 1 << 18;
pub const NOCP: u32 = 1 << 19;
pub const UNALIGNED: u32 = 1 << 24;
pub const DIVBYZERO: u32 = 1 << 25;

/// HFSR bits (B3.2.16).
pub const VECTTBL: u32 = 1 << 1;
pub const FORCED: u32 = 1 << 30;
pub const DEBUGEVT: u32 = 1 << 31;

/// What the core was doing when it took a fault.
#[derive(Clone, Debug, Serialize)]
pub struct FaultReport {
    /// Seconds since power-on.
    pub at_s: f64,
    /// `HardFault`, `BusFault`, `UsageFault`, `lockup`.
    pub exception: &'static str,
    /// In words.
    pub what: String,
    /// Address of the instruction.
    pub pc: u32,
    /// R0 to R12, SP, LR at the instruction.
    pub registers: [u32; 15],
    /// Program status.
    pub xpsr: u32,
    /// Configurable fault status.
    pub cfsr: u32,
    /// Hard fault status.
    pub hfsr: u32,
    /// The data address, for a bus fault.
    pub address: Option<u32>,
}
