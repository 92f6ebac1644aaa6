//! Arithmetic without state: what the reference manual's pseudocode functions of the same names compute (DDI 0403,
//! A2.2).

use crate::op::{Bits, Lane, Lanes, Shift};

/// Sum, carry out, signed overflow.
#[inline(always)]
pub fn add_with_carry(a: u32, b: u32, carry: bool) -> (u32, bool, bool) {
    let (sum, c1) = a.overflowing_add(b);
    let (sum, c2) = sum.overflowing_add(u32::from(carry));
    let overflow = (a ^ sum) & (b ^ sum) & 0x8000_0000 != 0;
    (sum, c1 | c2, overflow)
}

/// Result and carry out. `amount` may be anything a register's low byte holds.
#[inline(always)]
pub fn shift(value: u32, kind: Shift, amount: u32, carry: bool) -> (u32, bool) {
    if amount == 0 {
        return (value, carry);
    }
    match kind {
        Shift::Lsl if amount < 32 => (value << amount, value >> (32 - amount) & 1 != 0),
        Shift::Lsl => (0, amount == 32 && value & 1 != 0),
        Shift::Lsr if amount < 32 => (value >> amount, value >> (amount - 1) & 1 != 0),
        Shift::Lsr => (0, amount == 32 && value >> 31 != 0),
        Shift::Asr if amount < 32 => ((value as i32 >> amount) as u32, (value as i32 >> (amount - 1)) & 1 != 0),
        Shift::Asr => ((value as i32 >> 31) as u32, value >> 31 != 0),
        Shift::Ror => {
            let result = value.rotate_right(amount & 31);
            (result, result >> 31 != 0)
        }
        Shift::Rrx => (value >> 1 | u32::from(carry) << 31, value & 1 != 0),
    }
}

/// Into a signed number of `bits`; whether it was cut.
pub fn saturate_signed(value: i64, bits: u32) -> (i32, bool) {
    let limit = 1i64 << (bits - 1);
    let cut = value.clamp(-limit, limit - 1);
    (cut as i32, cut != value)
}

/// Into an unsigned number of `bits`.
pub fn saturate_unsigned(value: i64, bits: u32) -> (u32, bool) {
    let cut = value.clamp(0, (1i64 << bits) - 1);
    (cut as u32, cut != value)
}

/// Lower or upper half, signed.
pub fn half(value: u32, top: bool) -> i32 {
    i32::from(if top { (value >> 16) as i16 } else { value as i16 })
}

/// REV and its kind, CLZ.
pub fn bits(kind: Bits, value: u32) -> u32 {
    match kind {
        Bits::Rev => value.swap_bytes(),
        Bits::Rev16 => value.swap_bytes().rotate_left(16),
        Bits::Rbit => value.reverse_bits(),
        Bits::Revsh => i32::from((value as u16).swap_bytes() as i16) as u32,
        Bits::Clz => value.leading_zeros(),
    }
}

/// Lane by lane (A7.7, e.g. SADD16, UQSUB8): the result, and the GE bits where lanes wrap.
pub fn parallel(lanes: Lanes, lane: Lane, signed: bool, n: u32, m: u32) -> (u32, Option<u8>) {
    let eight = matches!(lanes, Lanes::Add8 | Lanes::Sub8);
    let width = if eight { 8 } else { 16 };
    let take = |value: u32, at: u32| {
        let raw = value >> at & ((1 << width) - 1);
        if signed { ((raw << (32 - width)) as i32) >> (32 - width) } else { raw as i32 }
    };
    let (mut result, mut ge) = (0, 0u8);
    for index in 0..32 / width {
        let at = index * width;
        let (subtract, from) = match lanes {
            Lanes::Add8 | Lanes::Add16 => (false, at),
            Lanes::Sub8 | Lanes::Sub16 => (true, at),
            Lanes::Asx => (index == 0, 16 - at),
            Lanes::Sax => (index == 1, 16 - at),
        };
        let (a, b) = (take(n, at), take(m, from));
        let value = if subtract { a - b } else { a + b };
        let out = match lane {
            Lane::Wrap => value,
            Lane::Halve => value >> 1,
            Lane::Saturate if signed => saturate_signed(value.into(), width).0,
            Lane::Saturate => saturate_unsigned(value.into(), width).0 as i32,
        };
        result |= (out as u32 & ((1 << width) - 1)) << at;
        let reached = if signed || subtract { value >= 0 } else { value >> width != 0 };
        if reached {
            ge |= if eight { 1 << index } else { 3 << (2 * index) };
        }
    }
    (result, (lane == Lane::Wrap).then_some(ge))
}
