//! 16-bit encodings, A5.2.

use super::{bit, bits, reg, sign_extend};
use crate::op::{Alu, Bits, Cell, Extend, Hint, Index, Op, Set, Shift};

pub fn decode(h: u32) -> Option<Op> {
    Some(match h >> 11 {
        0b00000..=0b00010 => shift(h),
        0b00011 => add_sub(h),
        0b00100..=0b00111 => immediate(h),
        0b01000 if !bit(h, 10) => register(h),
        0b01000 => special(h),
        0b01001 => Op::LoadLiteral { cell: Cell::Word, rt: low(h, 8), offset: (h as i32 & 0xFF) << 2 },
        0b01010 | 0b01011 => load_store_register(h),
        0b01100..=0b10001 => load_store_immediate(h),
        0b10010 => store(Cell::Word, low(h, 8), 13, (h & 0xFF) << 2),
        0b10011 => load(Cell::Word, low(h, 8), 13, (h & 0xFF) << 2),
        0b10100 => Op::Adr { rd: low(h, 8), offset: (h as i32 & 0xFF) << 2 },
        0b10101 => add(Alu::Add, low(h, 8), 13, (h & 0xFF) << 2),
        0b10110 | 0b10111 => return miscellaneous(h),
        0b11000 => Op::StoreMultiple { before: false, back: true, rn: low(h, 8), list: h as u16 & 0xFF },
        0b11001 => {
            let (rn, list) = (low(h, 8), h as u16 & 0xFF);
            Op::LoadMultiple { before: false, back: list >> rn & 1 == 0, rn, list }
        }
        0b11010 | 0b11011 => match bits(h, 11, 8) {
            0b1110 => return None,
            0b1111 => Op::Svc,
            cond => Op::Bcond { cond: cond as u8, offset: sign_extend(h & 0xFF, 8) << 1 },
        },
        0b11100 => Op::B { offset: sign_extend(h & 0x7FF, 11) << 1 },
        _ => return None,
    })
}

fn low(h: u32, at: u32) -> u8 {
    (h >> at & 7) as u8
}

fn load(cell: Cell, rt: u8, rn: u8, offset: u32) -> Op {
    Op::Load { cell, index: Index::Offset, rt, rn, offset: offset as i32 }
}

fn store(cell: Cell, rt: u8, rn: u8, offset: u32) -> Op {
    Op::Store { cell, index: Index::Offset, rt, rn, offset: offset as i32 }
}

fn add(op: Alu, rd: u8, rn: u8, imm: u32) -> Op {
    Op::Imm { op, set: Set::No, rotated: false, rd, rn, imm }
}

fn shift(h: u32) -> Op {
    let amount = bits(h, 10, 6) as u8;
    let (shift, amount) = match (bits(h, 12, 11), amount) {
        (0, n) => (Shift::Lsl, n),
        (1, 0) => (Shift::Lsr, 32),
        (1, n) => (Shift::Lsr, n),
        (_, 0) => (Shift::Asr, 32),
        (_, n) => (Shift::Asr, n),
    };
    Op::Reg { op: Alu::Mov, set: Set::OutsideIt, shift, amount, rd: low(h, 0), rn: 15, rm: low(h, 3) }
}

fn add_sub(h: u32) -> Op {
    let op = if bit(h, 9) { Alu::Sub } else { Alu::Add };
    let (set, rd, rn) = (Set::OutsideIt, low(h, 0), low(h, 3));
    if bit(h, 10) {
        Op::Imm { op, set, rotated: false, rd, rn, imm: bits(h, 8, 6) }
    } else {
        Op::Reg { op, set, shift: Shift::Lsl, amount: 0, rd, rn, rm: low(h, 6) }
    }
}

fn immediate(h: u32) -> Op {
    let (op, set) = match bits(h, 12, 11) {
        0 => (Alu::Mov, Set::OutsideIt),
        1 => (Alu::Cmp, Set::Yes),
        2 => (Alu::Add, Set::OutsideIt),
        _ => (Alu::Sub, Set::OutsideIt),
    };
    Op::Imm { op, set, rotated: false, rd: low(h, 8), rn: low(h, 8), imm: h & 0xFF }
}

fn register(h: u32) -> Op {
    let (rd, rm) = (low(h, 0), low(h, 3));
    let alu = |op| Op::Reg { op, set: Set::OutsideIt, shift: Shift::Lsl, amount: 0, rd, rn: rd, rm };
    let test = |op| Op::Reg { op, set: Set::Yes, shift: Shift::Lsl, amount: 0, rd, rn: rd, rm };
    let shift = |shift| Op::ShiftReg { shift, set: Set::OutsideIt, rd, rn: rd, rm };
    match bits(h, 9, 6) {
        0 => alu(Alu::And),
        1 => alu(Alu::Eor),
        2 => shift(Shift::Lsl),
        3 => shift(Shift::Lsr),
        4 => shift(Shift::Asr),
        5 => alu(Alu::Adc),
        6 => alu(Alu::Sbc),
        7 => shift(Shift::Ror),
        8 => test(Alu::Tst),
        9 => Op::Imm { op: Alu::Rsb, set: Set::OutsideIt, rotated: false, rd, rn: rm, imm: 0 },
        10 => test(Alu::Cmp),
        11 => test(Alu::Cmn),
        12 => alu(Alu::Orr),
        13 => Op::Mul { set: Set::OutsideIt, rd, rn: rm, rm: rd },
        14 => alu(Alu::Bic),
        _ => alu(Alu::Mvn),
    }
}

/// High registers, A5.2.3.
fn special(h: u32) -> Op {
    let (rd, rm) = (low(h, 0) | (bits(h, 7, 7) << 3) as u8, reg(h, 3));
    let alu = |op, set| Op::Reg { op, set, shift: Shift::Lsl, amount: 0, rd, rn: rd, rm };
    match bits(h, 9, 8) {
        0 if rd == 15 => Op::AddPc { rm },
        0 => alu(Alu::Add, Set::No),
        1 => alu(Alu::Cmp, Set::Yes),
        2 if rd == 15 => Op::MovPc { rm },
        2 => alu(Alu::Mov, Set::No),
        _ if bit(h, 7) => Op::Blx { rm },
        _ => Op::Bx { rm },
    }
}

fn load_store_register(h: u32) -> Op {
    let (rt, rn, rm, shift) = (low(h, 0), low(h, 3), low(h, 6), 0);
    match bits(h, 11, 9) {
        0 => Op::StoreReg { cell: Cell::Word, rt, rn, rm, shift },
        1 => Op::StoreReg { cell: Cell::Half, rt, rn, rm, shift },
        2 => Op::StoreReg { cell: Cell::Byte, rt, rn, rm, shift },
        3 => Op::LoadReg { cell: Cell::SignedByte, rt, rn, rm, shift },
        4 => Op::LoadReg { cell: Cell::Word, rt, rn, rm, shift },
        5 => Op::LoadReg { cell: Cell::Half, rt, rn, rm, shift },
        6 => Op::LoadReg { cell: Cell::Byte, rt, rn, rm, shift },
        _ => Op::LoadReg { cell: Cell::SignedHalf, rt, rn, rm, shift },
    }
}

fn load_store_immediate(h: u32) -> Op {
    let (rt, rn, imm) = (low(h, 0), low(h, 3), bits(h, 10, 6));
    match h >> 11 {
        0b01100 => store(Cell::Word, rt, rn, imm << 2),
        0b01101 => load(Cell::Word, rt, rn, imm << 2),
        0b01110 => store(Cell::Byte, rt, rn, imm),
        0b01111 => load(Cell::Byte, rt, rn, imm),
        0b10000 => store(Cell::Half, rt, rn, imm << 1),
        _ => load(Cell::Half, rt, rn, imm << 1),
    }
}

/// A5.2.5.
fn miscellaneous(h: u32) -> Option<Op> {
    Some(match bits(h, 11, 8) {
        0b0000 => add(if bit(h, 7) { Alu::Sub } else { Alu::Add }, 13, 13, (h & 0x7F) << 2),
        0b0001 | 0b0011 | 0b1001 | 0b1011 => {
            let offset = (bits(h, 9, 9) << 6 | bits(h, 7, 3) << 1) as u8;
            Op::Cbz { nonzero: bit(h, 11), rn: low(h, 0), offset }
        }
        0b0010 => {
            let kind = [Extend::Sxth, Extend::Sxtb, Extend::Uxth, Extend::Uxtb][bits(h, 7, 6) as usize];
            Op::Extend { kind, rd: low(h, 0), rn: 15, rm: low(h, 3), rotate: 0 }
        }
        0b0100 | 0b0101 => {
            let list = (h & 0xFF | bits(h, 8, 8) << 14) as u16;
            Op::StoreMultiple { before: true, back: true, rn: 13, list }
        }
        0b1100 | 0b1101 => {
            let list = (h & 0xFF | bits(h, 8, 8) << 15) as u16;
            Op::LoadMultiple { before: false, back: true, rn: 13, list }
        }
        0b0110 if h & 0xFFEC == 0xB660 => Op::Cps { disable: bit(h, 4), primask: bit(h, 1), faultmask: bit(h, 0) },
        0b1010 => {
            let kind = match bits(h, 7, 6) {
                0 => Bits::Rev,
                1 => Bits::Rev16,
                3 => Bits::Revsh,
                _ => return None,
            };
            Op::Bits { kind, rd: low(h, 0), rm: low(h, 3) }
        }
        0b1110 => Op::Bkpt { imm: h as u8 },
        0b1111 if h & 15 != 0 => Op::It { state: h as u8 },
        0b1111 => Op::Hint(match bits(h, 7, 4) {
            2 => Hint::Wfe,
            3 => Hint::Wfi,
            4 => Hint::Sev,
            _ => Hint::Nop,
        }),
        _ => return None,
    })
}
