//! Fields of registers.

use bus::Complaint;

/// The field of `length` bits at `at`.
pub const fn field(value: u32, at: u32, length: u32) -> u32 {
    (value >> at) & ((1 << length) - 1)
}

/// The bit at `at`.
pub const fn bit(value: u32, at: u32) -> bool {
    value >> at & 1 != 0
}

/// `old` with the bits of `mask` taken from `new`.
pub const fn merged(old: u32, new: u32, mask: u32) -> u32 {
    old & !mask | new & mask
}

/// A complaint about what the firmware does.
pub fn wrong(peripheral: &'static str, what: impl Into<String>) -> Complaint {
    Complaint::Wrong { peripheral, what: what.into() }
}

/// A register without a model.
pub const fn unmodelled(peripheral: &'static str, register: u32) -> Complaint {
    Complaint::Unmodelled { peripheral, register }
}
