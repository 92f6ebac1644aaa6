//! Register values as pure functions, tested on the host against the reference manual (RM0440, revision 8).
//!
//! Whatever decides whether transistors burn is computed here and nowhere else: the modules that own a peripheral only
//! write these values to it.

pub mod adc;
pub mod analog;
pub mod can;
pub mod clock;
pub mod flash;
pub mod timer;
pub mod usart;
pub mod watchdog;

/// A value of `bits` bits, placed at a bit of a register.
const fn field(value: u32, at: u32, bits: u32) -> u32 {
    assert!(value < 1 << bits, "the value does not fit its field");
    value << at
}

/// A bit of a register if, and only if, it is to be set.
const fn bit(set: bool, at: u32) -> u32 {
    (set as u32) << at
}
