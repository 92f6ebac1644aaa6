//! Thumb and Thumb-2 encodings (DDI 0403, chapters A5 and A6) to [`Op`]s.

mod float;
mod narrow;
mod wide;

use crate::op::Op;

/// Whether a first half-word announces a second (A5.1).
pub fn is_wide(first: u16) -> bool {
    first >> 11 >= 0b11101
}

/// A narrow instruction.
pub fn narrow(half: u16) -> Op {
    narrow::decode(u32::from(half)).unwrap_or(Op::Undefined)
}

/// A wide one.
pub fn wide(first: u16, second: u16) -> Op {
    wide::decode(u32::from(first), u32::from(second)).unwrap_or(Op::Undefined)
}

fn bits(value: u32, high: u32, low: u32) -> u32 {
    value >> low & ((1 << (high - low + 1)) - 1)
}

fn reg(value: u32, low: u32) -> u8 {
    (value >> low & 15) as u8
}

fn bit(value: u32, at: u32) -> bool {
    value >> at & 1 != 0
}

fn sign_extend(value: u32, width: u32) -> i32 {
    (value << (32 - width)) as i32 >> (32 - width)
}
