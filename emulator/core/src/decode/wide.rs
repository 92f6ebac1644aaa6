//! 32-bit encodings, A5.3. `h` is the first half-word, `l` the second.

use super::{bit, bits, float, reg, sign_extend};
use crate::op::{Alu, Bits, Cell, Dsp, DspLong, Extend, Hint, Index, Lane, Lanes, Long, Op, Saturating, Set, Shift};

pub fn decode(h: u32, l: u32) -> Option<Op> {
    let op2 = bits(h, 10, 4);
    match bits(h, 12, 11) {
        0b01 => match op2 {
            _ if op2 & 0b110_0100 == 0 => multiple(h, l),
            _ if op2 & 0b110_0100 == 0b100 => dual(h, l),
            _ if op2 & 0b110_0000 == 0b010_0000 => shifted(h, l),
            _ => float::decode(h, l),
        },
        0b10 if bit(l, 15) => branch(h, l),
        0b10 if bit(h, 9) => plain(h, l),
        0b10 => modified(h, l),
        _ => match op2 {
            _ if op2 & 0b111_0001 == 0 || op2 & 0b110_0001 == 1 => single(h, l),
            _ if op2 & 0b111_0000 == 0b010_0000 => register(h, l),
            _ if op2 & 0b111_1000 == 0b011_0000 => multiply(h, l),
            _ if op2 & 0b111_1000 == 0b011_1000 => long(h, l),
            _ if bit(op2, 6) => float::decode(h, l),
            _ => None,
        },
    }
}

fn multiple(h: u32, l: u32) -> Option<Op> {
    let (back, rn, list) = (bit(h, 5), reg(h, 0), l as u16);
    let before = match bits(h, 8, 7) {
        0b01 => false,
        0b10 => true,
        _ => return None,
    };
    Some(if bit(h, 4) {
        Op::LoadMultiple { before, back, rn, list }
    } else {
        Op::StoreMultiple { before, back, rn, list }
    })
}

/// Dual, exclusive, table branch: A5.3.6.
fn dual(h: u32, l: u32) -> Option<Op> {
    let (p, u, w, is_load) = (bit(h, 8), bit(h, 7), bit(h, 5), bit(h, 4));
    let (rn, rt, rt2) = (reg(h, 0), reg(l, 12), reg(l, 8));
    let words = (l & 0xFF) << 2;
    if p || w {
        let index = index(p, w);
        let offset = if u { words as i16 } else { -(words as i16) };
        return Some(if is_load {
            Op::LoadDual { index, rt, rt2, rn, offset }
        } else {
            Op::StoreDual { index, rt, rt2, rn, offset }
        });
    }
    Some(match (u, is_load, bits(l, 7, 4)) {
        (false, true, _) => Op::LoadExclusive { cell: Cell::Word, rt, rn, offset: words as u16 },
        (false, false, _) => Op::StoreExclusive { cell: Cell::Word, rd: rt2, rt, rn, offset: words as u16 },
        (true, true, 0) => Op::TableBranch { half: false, rn, rm: reg(l, 0) },
        (true, true, 1) => Op::TableBranch { half: true, rn, rm: reg(l, 0) },
        (true, true, 4) => Op::LoadExclusive { cell: Cell::Byte, rt, rn, offset: 0 },
        (true, true, 5) => Op::LoadExclusive { cell: Cell::Half, rt, rn, offset: 0 },
        (true, false, 4) => Op::StoreExclusive { cell: Cell::Byte, rd: reg(l, 0), rt, rn, offset: 0 },
        (true, false, 5) => Op::StoreExclusive { cell: Cell::Half, rd: reg(l, 0), rt, rn, offset: 0 },
        _ => return None,
    })
}

fn index(pre: bool, back: bool) -> Index {
    match (pre, back) {
        (true, true) => Index::Pre,
        (true, false) => Index::Offset,
        _ => Index::Post,
    }
}

/// The operation of A5.3.1 and A5.3.11, with its tests (Rd 15) and moves (Rn 15).
fn operation(h: u32, rd: u8) -> Option<(Alu, Set)> {
    let (set, rn) = (bit(h, 4), reg(h, 0));
    let test = set && rd == 15;
    let alu = match bits(h, 8, 5) {
        0 if test => Alu::Tst,
        0 => Alu::And,
        1 => Alu::Bic,
        2 if rn == 15 => Alu::Mov,
        2 => Alu::Orr,
        3 if rn == 15 => Alu::Mvn,
        3 => Alu::Orn,
        4 if test => Alu::Teq,
        4 => Alu::Eor,
        8 if test => Alu::Cmn,
        8 => Alu::Add,
        10 => Alu::Adc,
        11 => Alu::Sbc,
        13 if test => Alu::Cmp,
        13 => Alu::Sub,
        14 => Alu::Rsb,
        _ => return None,
    };
    Some((alu, if set { Set::Yes } else { Set::No }))
}

fn immediate_shift(kind: u32, amount: u32) -> (Shift, u8) {
    match (kind, amount as u8) {
        (0, n) => (Shift::Lsl, n),
        (1, 0) => (Shift::Lsr, 32),
        (1, n) => (Shift::Lsr, n),
        (2, 0) => (Shift::Asr, 32),
        (2, n) => (Shift::Asr, n),
        (_, 0) => (Shift::Rrx, 1),
        (_, n) => (Shift::Ror, n),
    }
}

fn shifted(h: u32, l: u32) -> Option<Op> {
    let (rn, rd, rm) = (reg(h, 0), reg(l, 8), reg(l, 0));
    let count = bits(l, 14, 12) << 2 | bits(l, 7, 6);
    if bits(h, 8, 5) == 6 {
        let (_, amount) = immediate_shift(bits(l, 5, 4), count);
        return Some(Op::Pack { top: bit(l, 5), rd, rn, rm, amount });
    }
    let (op, set) = operation(h, rd)?;
    let (shift, amount) = immediate_shift(bits(l, 5, 4), count);
    Some(Op::Reg { op, set, shift, amount, rd, rn, rm })
}

/// ThumbExpandImm_C: the constant, and whether it is a rotated one.
fn expand(imm12: u32) -> (u32, bool) {
    let byte = imm12 & 0xFF;
    match imm12 >> 8 {
        0 => (byte, false),
        1 => (byte << 16 | byte, false),
        2 => (byte << 24 | byte << 8, false),
        3 => (byte * 0x0101_0101, false),
        _ => ((0x80 | imm12 & 0x7F).rotate_right(imm12 >> 7), true),
    }
}

fn imm12(h: u32, l: u32) -> u32 {
    bits(h, 10, 10) << 11 | bits(l, 14, 12) << 8 | l & 0xFF
}

fn modified(h: u32, l: u32) -> Option<Op> {
    let (rd, rn) = (reg(l, 8), reg(h, 0));
    let (op, set) = operation(h, rd)?;
    let (imm, rotated) = expand(imm12(h, l));
    Some(Op::Imm { op, set, rotated, rd, rn, imm })
}

fn plain(h: u32, l: u32) -> Option<Op> {
    let (rd, rn, imm) = (reg(l, 8), reg(h, 0), imm12(h, l));
    let lsb = (bits(l, 14, 12) << 2 | bits(l, 7, 6)) as u8;
    let field = (l & 0x1F) as u8;
    let add = |op| Op::Imm { op, set: Set::No, rotated: false, rd, rn, imm };
    Some(match bits(h, 8, 4) {
        0b00000 if rn == 15 => Op::Adr { rd, offset: imm as i32 },
        0b00000 => add(Alu::Add),
        0b01010 if rn == 15 => Op::Adr { rd, offset: -(imm as i32) },
        0b01010 => add(Alu::Sub),
        0b00100 => {
            let imm = u32::from(rn) << 12 | imm;
            Op::Imm { op: Alu::Mov, set: Set::No, rotated: false, rd, rn: 15, imm }
        }
        0b01100 => Op::Movt { rd, imm: (u32::from(rn) << 12 | imm) as u16 },
        0b10010 if lsb == 0 => Op::Saturate16 { signed: true, rd, rn, bits: (field & 15) + 1 },
        0b10000 | 0b10010 => {
            let (shift, amount) = immediate_shift(bits(h, 5, 5) << 1, lsb.into());
            Op::Saturate { signed: true, rd, rn, shift, amount, bits: field + 1 }
        }
        0b11010 if lsb == 0 => Op::Saturate16 { signed: false, rd, rn, bits: field & 15 },
        0b11000 | 0b11010 => {
            let (shift, amount) = immediate_shift(bits(h, 5, 5) << 1, lsb.into());
            Op::Saturate { signed: false, rd, rn, shift, amount, bits: field }
        }
        0b10100 => Op::Extract { signed: true, rd, rn, lsb, width: field + 1 },
        0b11100 => Op::Extract { signed: false, rd, rn, lsb, width: field + 1 },
        0b10110 if field >= lsb => Op::Insert { rd, rn, lsb, width: field - lsb + 1 },
        _ => return None,
    })
}

/// Branches and miscellaneous control, A5.3.4.
fn branch(h: u32, l: u32) -> Option<Op> {
    let s = bits(h, 10, 10);
    let (j1, j2) = (bits(l, 13, 13), bits(l, 11, 11));
    let far = || {
        let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
        sign_extend(s << 24 | i1 << 23 | i2 << 22 | bits(h, 9, 0) << 12 | bits(l, 10, 0) << 1, 25)
    };
    match (bit(l, 14), bit(l, 12)) {
        (true, true) => return Some(Op::Bl { offset: far() }),
        (false, true) => return Some(Op::B { offset: far() }),
        (true, false) => return None,
        _ => {}
    }
    if bits(h, 9, 7) != 7 {
        let offset = sign_extend(s << 20 | j2 << 19 | j1 << 18 | bits(h, 5, 0) << 12 | bits(l, 10, 0) << 1, 21);
        return Some(Op::Bcond { cond: bits(h, 9, 6) as u8, offset });
    }
    Some(match bits(h, 10, 4) {
        0b011_1000 | 0b011_1001 => Op::Msr { rn: reg(h, 0), special: l as u8, mask: bits(l, 11, 10) as u8 },
        0b011_1010 => Op::Hint(match l & 0xFF {
            2 => Hint::Wfe,
            3 => Hint::Wfi,
            4 => Hint::Sev,
            _ => Hint::Nop,
        }),
        0b011_1011 => match bits(l, 7, 4) {
            2 => Op::Clrex,
            4..=6 => Op::Barrier,
            _ => return None,
        },
        0b011_1110 | 0b011_1111 => Op::Mrs { rd: reg(l, 8), special: l as u8 },
        _ => return None,
    })
}

/// Single loads and stores, A5.3.7 to A5.3.10.
fn single(h: u32, l: u32) -> Option<Op> {
    let (rn, rt, signed, is_load) = (reg(h, 0), reg(l, 12), bit(h, 8), bit(h, 4));
    let cell = match (bits(h, 6, 5), signed) {
        (0, false) => Cell::Byte,
        (0, true) => Cell::SignedByte,
        (1, false) => Cell::Half,
        (1, true) => Cell::SignedHalf,
        (2, false) => Cell::Word,
        _ => return None,
    };
    if is_load && rt == 15 && cell != Cell::Word {
        // Preload hints.
        return Some(Op::Hint(Hint::Nop));
    }
    let make = |index, offset| {
        if is_load { Op::Load { cell, index, rt, rn, offset } } else { Op::Store { cell, index, rt, rn, offset } }
    };
    if rn == 15 {
        let offset = (l & 0xFFF) as i32;
        return is_load.then_some(Op::LoadLiteral { cell, rt, offset: if bit(h, 7) { offset } else { -offset } });
    }
    if bit(h, 7) {
        return Some(make(Index::Offset, (l & 0xFFF) as i32));
    }
    if bit(l, 11) {
        let (p, u, w) = (bit(l, 10), bit(l, 9), bit(l, 8));
        if !p && !w {
            return None;
        }
        let offset = (l & 0xFF) as i32;
        return Some(make(index(p, w), if u { offset } else { -offset }));
    }
    let (rm, shift) = (reg(l, 0), bits(l, 5, 4) as u8);
    (bits(l, 10, 6) == 0).then_some(if is_load {
        Op::LoadReg { cell, rt, rn, rm, shift }
    } else {
        Op::StoreReg { cell, rt, rn, rm, shift }
    })
}

/// A5.3.12 to A5.3.15.
fn register(h: u32, l: u32) -> Option<Op> {
    let (rn, rd, rm) = (reg(h, 0), reg(l, 8), reg(l, 0));
    if bits(l, 15, 12) != 15 {
        return None;
    }
    if !bit(h, 7) && bits(l, 7, 4) == 0 {
        let shift = [Shift::Lsl, Shift::Lsr, Shift::Asr, Shift::Ror][bits(h, 6, 5) as usize];
        let set = if bit(h, 4) { Set::Yes } else { Set::No };
        return Some(Op::ShiftReg { shift, set, rd, rn, rm });
    }
    if !bit(h, 7) && bit(l, 7) {
        let kind = match bits(h, 6, 4) {
            0 => Extend::Sxth,
            1 => Extend::Uxth,
            2 => Extend::Sxtb16,
            3 => Extend::Uxtb16,
            4 => Extend::Sxtb,
            5 => Extend::Uxtb,
            _ => return None,
        };
        return Some(Op::Extend { kind, rd, rn, rm, rotate: bits(l, 5, 4) as u8 * 8 });
    }
    if bit(h, 7) && !bit(l, 7) {
        let lanes = match bits(h, 6, 4) {
            0 => Lanes::Add8,
            1 => Lanes::Add16,
            2 => Lanes::Asx,
            4 => Lanes::Sub8,
            5 => Lanes::Sub16,
            6 => Lanes::Sax,
            _ => return None,
        };
        let lane = match bits(l, 5, 4) {
            0 => Lane::Wrap,
            1 => Lane::Saturate,
            2 => Lane::Halve,
            _ => return None,
        };
        return Some(Op::Parallel { lanes, lane, signed: !bit(l, 6), rd, rn, rm });
    }
    if bits(h, 7, 6) != 2 || bits(l, 7, 6) != 2 {
        return None;
    }
    let which = bits(l, 5, 4) as usize;
    Some(match (bits(h, 5, 4), which) {
        (0, _) => {
            let kind = [Saturating::Qadd, Saturating::Qdadd, Saturating::Qsub, Saturating::Qdsub][which];
            Op::Saturating { kind, rd, rn, rm }
        }
        (1, _) => Op::Bits { kind: [Bits::Rev, Bits::Rev16, Bits::Rbit, Bits::Revsh][which], rd, rm },
        (2, 0) => Op::Sel { rd, rn, rm },
        (3, 0) => Op::Bits { kind: Bits::Clz, rd, rm },
        _ => return None,
    })
}

fn multiply(h: u32, l: u32) -> Option<Op> {
    let (rn, ra, rd, rm) = (reg(h, 0), reg(l, 12), reg(l, 8), reg(l, 0));
    let (x, y) = (bit(l, 5), bit(l, 4));
    let kind = match bits(h, 6, 4) {
        0 if y => return Some(Op::Mla { subtract: true, rd, rn, rm, ra }),
        0 if ra == 15 => return Some(Op::Mul { set: Set::No, rd, rn, rm }),
        0 => return Some(Op::Mla { subtract: false, rd, rn, rm, ra }),
        1 => Dsp::Smlaxy { x, y },
        2 => Dsp::Smlad { exchange: y },
        3 => Dsp::Smlaw { top: y },
        4 => Dsp::Smlsd { exchange: y },
        5 => Dsp::Smmla { round: y },
        6 => Dsp::Smmls { round: y },
        _ => Dsp::Usada8,
    };
    Some(Op::Dsp { kind, rd, rn, rm, ra })
}

fn long(h: u32, l: u32) -> Option<Op> {
    let (rn, low, high, rm) = (reg(h, 0), reg(l, 12), reg(l, 8), reg(l, 0));
    let (x, y) = (bit(l, 5), bit(l, 4));
    let plain = |kind| Op::Long { kind, low, high, rn, rm };
    let dsp = |kind| Op::DspLong { kind, low, high, rn, rm };
    Some(match (bits(h, 6, 4), bits(l, 7, 4)) {
        (0, 0) => plain(Long::Smull),
        (1, 15) => Op::Div { signed: true, rd: high, rn, rm },
        (2, 0) => plain(Long::Umull),
        (3, 15) => Op::Div { signed: false, rd: high, rn, rm },
        (4, 0) => plain(Long::Smlal),
        (4, 8..=11) => dsp(DspLong::Smlalxy { x, y }),
        (4, 12 | 13) => dsp(DspLong::Smlald { exchange: y }),
        (5, 12 | 13) => dsp(DspLong::Smlsld { exchange: y }),
        (6, 0) => plain(Long::Umlal),
        (6, 6) => plain(Long::Umaal),
        _ => return None,
    })
}
