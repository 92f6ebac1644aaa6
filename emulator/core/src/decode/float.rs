//! The FPv4-SP extension, A6.4 to A6.7, and its absence: other coprocessors.

use super::{bit, bits, reg};
use crate::op::{Float2, Float3, Op};

pub fn decode(h: u32, l: u32) -> Option<Op> {
    if bits(l, 11, 9) != 0b101 || bit(h, 12) {
        return None;
    }
    match bits(h, 11, 8) {
        0b1100 if h & 0xFFE0 == 0xEC40 => pair(h, l),
        0b1100 | 0b1101 => transfer(h, l),
        0b1110 if bit(l, 4) => single_transfer(h, l),
        0b1110 if !bit(l, 8) => arithmetic(h, l),
        _ => None,
    }
}

/// A single register's number: four bits and one more at the end.
fn single(four: u32, one: u32) -> u8 {
    (four << 1 | one) as u8
}

/// A double register as the first of its two single ones. The chip has 16 of them.
fn double(four: u32, one: u32) -> Option<u8> {
    (one == 0).then_some((four << 1) as u8)
}

fn register(double_: bool, four: u32, one: u32) -> Option<u8> {
    if double_ { double(four, one) } else { Some(single(four, one)) }
}

fn pair(h: u32, l: u32) -> Option<Op> {
    let is_double = bit(l, 8);
    let m = register(is_double, bits(l, 3, 0), bits(l, 5, 5))?;
    (m < 31 && bits(l, 7, 6) == 0 && bit(l, 4)).then_some(Op::FloatPair {
        to_core: bit(h, 4),
        rt: reg(l, 12),
        rt2: reg(h, 0),
        m,
    })
}

fn transfer(h: u32, l: u32) -> Option<Op> {
    let (p, u, w, is_load, is_double) = (bit(h, 8), bit(h, 7), bit(h, 5), bit(h, 4), bit(l, 8));
    let rn = reg(h, 0);
    let d = register(is_double, bits(l, 15, 12), bits(h, 6, 6))?;
    let words = l & 0xFF;
    if p && !w {
        let offset = if u { (words << 2) as i16 } else { -((words << 2) as i16) };
        return Some(if is_load {
            Op::FloatLoad { double: is_double, d, rn, offset }
        } else {
            Op::FloatStore { double: is_double, d, rn, offset }
        });
    }
    if p == u || words == 0 || u32::from(d) + words > 32 {
        return None;
    }
    let count = words as u8;
    Some(if is_load {
        Op::FloatLoadMultiple { before: p, back: w, rn, first: d, count }
    } else {
        Op::FloatStoreMultiple { before: p, back: w, rn, first: d, count }
    })
}

fn single_transfer(h: u32, l: u32) -> Option<Op> {
    let (rt, to_core) = (reg(l, 12), bit(h, 4));
    if bit(l, 8) {
        // One half of a double register.
        let half = u8::from(bit(h, 5));
        let n = double(bits(h, 3, 0), bits(l, 7, 7))? + half;
        if bits(h, 7, 6) != 0 || bits(l, 6, 5) != 0 {
            return None;
        }
        return Some(if to_core { Op::FloatToCore { rt, n } } else { Op::FloatFromCore { rt, n } });
    }
    match bits(h, 7, 5) {
        0 => {
            let n = single(bits(h, 3, 0), bits(l, 7, 7));
            Some(if to_core { Op::FloatToCore { rt, n } } else { Op::FloatFromCore { rt, n } })
        }
        7 if bits(h, 3, 0) == 1 => Some(if to_core { Op::Vmrs { rt } } else { Op::Vmsr { rt } }),
        _ => None,
    }
}

fn arithmetic(h: u32, l: u32) -> Option<Op> {
    let d = single(bits(l, 15, 12), bits(h, 6, 6));
    let n = single(bits(h, 3, 0), bits(l, 7, 7));
    let m = single(bits(l, 3, 0), bits(l, 5, 5));
    let op = match (bit(h, 7), bits(h, 5, 4), bit(l, 6)) {
        (false, 0, false) => Float3::Mla,
        (false, 0, true) => Float3::Mls,
        (false, 1, false) => Float3::Nmls,
        (false, 1, true) => Float3::Nmla,
        (false, 2, false) => Float3::Mul,
        (false, 2, true) => Float3::Nmul,
        (false, 3, false) => Float3::Add,
        (false, 3, true) => Float3::Sub,
        (true, 0, false) => Float3::Div,
        (true, 1, false) => Float3::Fnms,
        (true, 1, true) => Float3::Fnma,
        (true, 2, false) => Float3::Fma,
        (true, 2, true) => Float3::Fms,
        (true, 3, false) => return Some(Op::FloatImm { d, bits: expand(bits(h, 3, 0) << 4 | bits(l, 3, 0)) }),
        (true, 3, true) => return other(h, l, d, m),
        _ => return None,
    };
    Some(Op::Float3 { op, d, n, m })
}

fn other(h: u32, l: u32, d: u8, m: u8) -> Option<Op> {
    let upper = bit(l, 7);
    let opcode = bits(h, 3, 0);
    let op = match opcode {
        0 if upper => Float2::Abs,
        0 => Float2::Mov,
        1 if upper => Float2::Sqrt,
        1 => Float2::Neg,
        2 => Float2::FromHalf { top: upper },
        3 => Float2::ToHalf { top: upper },
        4 => return Some(Op::FloatCompare { d, m: Some(m) }),
        5 => return Some(Op::FloatCompare { d, m: None }),
        8 => Float2::FromInt { signed: upper },
        12 | 13 => Float2::ToInt { signed: opcode == 13, zero: upper },
        10 | 11 | 14 | 15 => {
            let half = !upper;
            let size = if half { 16 } else { 32 };
            let imm = bits(l, 3, 0) << 1 | bits(l, 5, 5);
            let fraction = size - imm.min(size);
            return Some(Op::FloatFixed {
                to_fixed: opcode >= 14,
                signed: opcode & 1 == 0,
                half,
                fraction: fraction as u8,
                d,
            });
        }
        _ => return None,
    };
    Some(Op::Float2 { op, d, m })
}

/// VFPExpandImm.
fn expand(imm: u32) -> u32 {
    let exponent = if bit(imm, 6) { 0x1F << 25 } else { 1 << 30 };
    (imm & 0x80) << 24 | exponent | (imm & 0x3F) << 19
}
