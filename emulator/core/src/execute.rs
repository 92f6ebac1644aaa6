//! What each instruction does (DDI 0403, A7.7), and what it costs beyond one cycle.
//!
//! Cycles follow the processor's technical reference manual (DDI 0439, 3.3.1): a taken branch refills the pipeline (2
//! more), a load takes 2, a transfer of N words N more, a division 2 to 12, FP division and root 14, an FP multiply-add
//! 3. Stores go through the write buffer. What the manual leaves open (overlap of neighbouring loads, refills of 1 to
//!    3) and what the
//! bus matrix does is not modelled: durations are good to 20 to 30 %.

use crate::alu::{self, add_with_carry};
use crate::fault::Fault;
use crate::machine::Machine;
use crate::op::{Alu, Dsp, DspLong, Extend, Hint, Index, Long, Op, Saturating, Set, Shift};
use bus::Bus;

/// A taken branch, beyond its own cycle.
const REFILL: u64 = 2;

impl<S: Bus> Machine<S> {
    #[inline(always)]
    pub(crate) fn reg(&self, number: u8) -> u32 {
        self.cpu.r[usize::from(number & 15)]
    }

    /// Writes R0 to R14; the stack pointer's lower bits stay zero.
    #[inline(always)]
    pub(crate) fn set(&mut self, number: u8, value: u32) {
        self.cpu.r[usize::from(number & 15)] = if number == 13 { value & !3 } else { value };
    }

    #[inline(always)]
    pub(crate) fn branch(&mut self, target: u32) {
        self.cpu.pc = target & !1;
        self.now += REFILL;
    }

    /// A branch that may change the instruction set or return from an exception.
    #[inline(always)]
    pub(crate) fn branch_exchange(&mut self, target: u32) -> Result<(), Fault> {
        if target >= 0xF000_0000 && self.cpu.ipsr != 0 {
            return Err(Fault::ExceptionReturn(target));
        }
        self.branch(target);
        if target & 1 == 0 { Err(Fault::InvalidState) } else { Ok(()) }
    }

    #[inline(always)]
    fn sets(&self, set: Set) -> bool {
        match set {
            Set::No => false,
            Set::Yes => true,
            Set::OutsideIt => !self.within_it,
        }
    }

    #[inline(always)]
    pub(crate) fn execute(&mut self, op: Op) -> Result<(), Fault> {
        match op {
            Op::Undefined => return Err(Fault::Undefined),
            Op::Imm { op, set, rotated, rd, rn, imm } => {
                let carry = if rotated { imm >> 31 != 0 } else { self.cpu.c };
                self.arithmetic(op, set, rd, rn, imm, carry);
            }
            Op::Reg { op, set, shift, amount, rd, rn, rm } => {
                let (operand, carry) = if amount == 0 {
                    (self.reg(rm), self.cpu.c)
                } else {
                    alu::shift(self.reg(rm), shift, amount.into(), self.cpu.c)
                };
                self.arithmetic(op, set, rd, rn, operand, carry);
            }
            Op::ShiftReg { shift, set, rd, rn, rm } => {
                let (value, carry) = alu::shift(self.reg(rn), shift, self.reg(rm) & 0xFF, self.cpu.c);
                if self.sets(set) {
                    self.cpu.set_nz(value);
                    self.cpu.c = carry;
                }
                self.set(rd, value);
            }
            Op::Movt { rd, imm } => self.set(rd, self.reg(rd) & 0xFFFF | u32::from(imm) << 16),
            Op::Adr { rd, offset } => self.set(rd, (self.reg(15) & !3).wrapping_add_signed(offset)),
            Op::MovPc { rm } => self.branch(self.reg(rm)),
            Op::AddPc { rm } => self.branch(self.reg(15).wrapping_add(self.reg(rm))),
            Op::Bx { rm } => return self.branch_exchange(self.reg(rm)),
            Op::Blx { rm } => {
                let target = self.reg(rm);
                self.set(14, self.cpu.pc | 1);
                self.branch(target);
                if target & 1 == 0 {
                    return Err(Fault::InvalidState);
                }
            }
            Op::B { offset } => self.branch(self.reg(15).wrapping_add_signed(offset)),
            Op::Bcond { cond, offset } => {
                if self.cpu.holds(cond) {
                    self.branch(self.reg(15).wrapping_add_signed(offset));
                }
            }
            Op::Bl { offset } => {
                self.set(14, self.cpu.pc | 1);
                self.branch(self.reg(15).wrapping_add_signed(offset));
            }
            Op::Cbz { nonzero, rn, offset } => {
                if (self.reg(rn) != 0) == nonzero {
                    self.branch(self.reg(15).wrapping_add(offset.into()));
                }
            }
            Op::TableBranch { half, rn, rm } => return self.table_branch(half, rn, rm),
            Op::It { state } => self.cpu.it = state,
            Op::Load { cell, index, rt, rn, offset } => {
                let (address, base) = self.indexed(rn, index, offset);
                let value = self.load_cell(cell, address)?;
                self.now += 1;
                if index != Index::Offset {
                    self.set(rn, base);
                }
                return self.loaded(rt, value);
            }
            Op::Store { cell, index, rt, rn, offset } => {
                let (address, base) = self.indexed(rn, index, offset);
                self.store_cell(cell, address, self.reg(rt))?;
                if index != Index::Offset {
                    self.set(rn, base);
                }
            }
            Op::LoadReg { cell, rt, rn, rm, shift } => {
                let value = self.load_cell(cell, self.reg(rn).wrapping_add(self.reg(rm) << shift))?;
                self.now += 1;
                return self.loaded(rt, value);
            }
            Op::StoreReg { cell, rt, rn, rm, shift } => {
                self.store_cell(cell, self.reg(rn).wrapping_add(self.reg(rm) << shift), self.reg(rt))?;
            }
            Op::LoadLiteral { cell, rt, offset } => {
                let value = self.load_cell(cell, (self.reg(15) & !3).wrapping_add_signed(offset))?;
                self.now += 1;
                return self.loaded(rt, value);
            }
            Op::LoadDual { index, rt, rt2, rn, offset } => return self.load_dual(rt, rt2, rn, index, offset.into()),
            Op::StoreDual { index, rt, rt2, rn, offset } => return self.store_dual(rt, rt2, rn, index, offset.into()),
            Op::LoadMultiple { before, back, rn, list } => return self.load_multiple(rn, before, back, list),
            Op::StoreMultiple { before, back, rn, list } => return self.store_multiple(rn, before, back, list),
            Op::LoadExclusive { cell, rt, rn, offset } => return self.load_exclusive(cell, rt, rn, offset),
            Op::StoreExclusive { cell, rd, rt, rn, offset } => return self.store_exclusive(cell, rd, rt, rn, offset),
            Op::Clrex => self.cpu.exclusive = None,
            Op::Extend { kind, rd, rn, rm, rotate } => {
                let value = self.extend(kind, rn, self.reg(rm).rotate_right(rotate.into()));
                self.set(rd, value);
            }
            Op::Mul { set, rd, rn, rm } => {
                let value = self.reg(rn).wrapping_mul(self.reg(rm));
                if self.sets(set) {
                    self.cpu.set_nz(value);
                }
                self.set(rd, value);
            }
            Op::Mla { subtract, rd, rn, rm, ra } => {
                let product = self.reg(rn).wrapping_mul(self.reg(rm));
                let ra = self.reg(ra);
                self.set(rd, if subtract { ra.wrapping_sub(product) } else { ra.wrapping_add(product) });
                self.now += 1;
            }
            Op::Long { kind, low, high, rn, rm } => self.long(kind, low, high, rn, rm),
            Op::Dsp { kind, rd, rn, rm, ra } => self.dsp(kind, rd, rn, rm, ra),
            Op::DspLong { kind, low, high, rn, rm } => self.dsp_long(kind, low, high, rn, rm),
            Op::Div { signed, rd, rn, rm } => return self.divide(signed, rd, rn, rm),
            Op::Extract { signed, rd, rn, lsb, width } => {
                let value = self.reg(rn) << (32 - u32::from(lsb + width).min(32));
                let down = 32 - u32::from(width);
                self.set(rd, if signed { (value as i32 >> down) as u32 } else { value >> down });
            }
            Op::Insert { rd, rn, lsb, width } => {
                let mask = (u32::MAX >> (32 - u32::from(width))) << lsb;
                let field = if rn == 15 { 0 } else { self.reg(rn) << lsb };
                self.set(rd, self.reg(rd) & !mask | field & mask);
            }
            Op::Saturate { signed, rd, rn, shift, amount, bits } => {
                let (operand, _) = alu::shift(self.reg(rn), shift, amount.into(), self.cpu.c);
                let operand = i64::from(operand as i32);
                let value = if signed {
                    self.saturated(alu::saturate_signed(operand, bits.into())) as u32
                } else {
                    self.saturated(alu::saturate_unsigned(operand, bits.into()))
                };
                self.set(rd, value);
            }
            Op::Saturate16 { signed, rd, rn, bits } => {
                let lane = |machine: &mut Self, top| {
                    let operand = i64::from(alu::half(machine.reg(rn), top));
                    if signed {
                        machine.saturated(alu::saturate_signed(operand, bits.into())) as u32
                    } else {
                        machine.saturated(alu::saturate_unsigned(operand, bits.into()))
                    }
                };
                let (low, high) = (lane(self, false), lane(self, true));
                self.set(rd, high << 16 | low & 0xFFFF);
            }
            Op::Bits { kind, rd, rm } => self.set(rd, alu::bits(kind, self.reg(rm))),
            Op::Parallel { lanes, lane, signed, rd, rn, rm } => {
                let (value, ge) = alu::parallel(lanes, lane, signed, self.reg(rn), self.reg(rm));
                self.cpu.ge = ge.unwrap_or(self.cpu.ge);
                self.set(rd, value);
            }
            Op::Sel { rd, rn, rm } => {
                let mask =
                    (0..4).filter(|lane| self.cpu.ge >> lane & 1 != 0).fold(0, |mask, lane| mask | 0xFF << (8 * lane));
                self.set(rd, self.reg(rn) & mask | self.reg(rm) & !mask);
            }
            Op::Saturating { kind, rd, rn, rm } => {
                let value = self.saturating(kind, self.reg(rn) as i32, self.reg(rm) as i32);
                self.set(rd, value as u32);
            }
            Op::Pack { top, rd, rn, rm, amount } => {
                let kind = if top { Shift::Asr } else { Shift::Lsl };
                let (shifted, _) = alu::shift(self.reg(rm), kind, amount.into(), false);
                let n = self.reg(rn);
                self.set(rd, if top { n & !0xFFFF | shifted & 0xFFFF } else { shifted & !0xFFFF | n & 0xFFFF });
            }
            Op::Cps { disable, primask, faultmask } => self.change_masks(disable, primask, faultmask),
            Op::Mrs { rd, special } => {
                let value = self.read_special(special);
                self.set(rd, value);
            }
            Op::Msr { rn, special, mask } => self.write_special(special, mask, self.reg(rn)),
            Op::Svc => return Err(Fault::Supervisor),
            Op::Bkpt { imm } => return Err(Fault::Breakpoint(imm)),
            Op::Hint(hint) => self.hint(hint),
            Op::Barrier => self.due = 0,
            float => return self.execute_float(float),
        }
        Ok(())
    }

    #[inline(always)]
    fn arithmetic(&mut self, op: Alu, set: Set, rd: u8, rn: u8, operand: u32, shifter_carry: bool) {
        let n = self.reg(rn);
        let logical = |value: u32, cpu: &crate::cpu::Cpu| (value, shifter_carry, cpu.v);
        let (value, carry, overflow) = match op {
            Alu::And | Alu::Tst => logical(n & operand, &self.cpu),
            Alu::Bic => logical(n & !operand, &self.cpu),
            Alu::Orr => logical(n | operand, &self.cpu),
            Alu::Orn => logical(n | !operand, &self.cpu),
            Alu::Eor | Alu::Teq => logical(n ^ operand, &self.cpu),
            Alu::Mov => logical(operand, &self.cpu),
            Alu::Mvn => logical(!operand, &self.cpu),
            Alu::Add | Alu::Cmn => add_with_carry(n, operand, false),
            Alu::Adc => add_with_carry(n, operand, self.cpu.c),
            Alu::Sub | Alu::Cmp => add_with_carry(n, !operand, true),
            Alu::Sbc => add_with_carry(n, !operand, self.cpu.c),
            Alu::Rsb => add_with_carry(!n, operand, true),
        };
        if self.sets(set) {
            self.cpu.set_nz(value);
            self.cpu.c = carry;
            self.cpu.v = overflow;
        }
        if !matches!(op, Alu::Tst | Alu::Teq | Alu::Cmn | Alu::Cmp) {
            self.set(rd, value);
        }
    }

    fn extend(&self, kind: Extend, rn: u8, rotated: u32) -> u32 {
        let base = if rn == 15 { 0 } else { self.reg(rn) };
        let value = match kind {
            Extend::Sxth => i32::from(rotated as i16) as u32,
            Extend::Uxth => rotated & 0xFFFF,
            Extend::Sxtb => i32::from(rotated as i8) as u32,
            Extend::Uxtb => rotated & 0xFF,
            Extend::Sxtb16 | Extend::Uxtb16 => {
                let lane = |byte: u32| {
                    if kind == Extend::Sxtb16 { i32::from(byte as i8) as u32 } else { byte & 0xFF }
                };
                let low = (base & 0xFFFF).wrapping_add(lane(rotated)) & 0xFFFF;
                let high = (base >> 16).wrapping_add(lane(rotated >> 16));
                return high << 16 | low;
            }
        };
        base.wrapping_add(value)
    }

    fn long(&mut self, kind: Long, low: u8, high: u8, rn: u8, rm: u8) {
        let (n, m) = (self.reg(rn), self.reg(rm));
        let sum = u64::from(self.reg(high)) << 32 | u64::from(self.reg(low));
        let signed = || (i64::from(n as i32) * i64::from(m as i32)) as u64;
        let unsigned = u64::from(n) * u64::from(m);
        let value = match kind {
            Long::Smull => signed(),
            Long::Umull => unsigned,
            Long::Smlal => sum.wrapping_add(signed()),
            Long::Umlal => sum.wrapping_add(unsigned),
            Long::Umaal => unsigned + u64::from(self.reg(high)) + u64::from(self.reg(low)),
        };
        self.set(low, value as u32);
        self.set(high, (value >> 32) as u32);
    }

    fn dsp(&mut self, kind: Dsp, rd: u8, rn: u8, rm: u8, ra: u8) {
        let (n, m) = (self.reg(rn), self.reg(rm));
        let added = if ra == 15 { 0 } else { self.reg(ra) };
        let wide = |top: bool, other: bool| i64::from(alu::half(n, top)) * i64::from(alu::half(m, other));
        let accumulate = i64::from(added as i32);
        let exact = match kind {
            Dsp::Smlaxy { x, y } => accumulate + wide(x, y),
            Dsp::Smlad { exchange } => accumulate + wide(false, exchange) + wide(true, !exchange),
            Dsp::Smlsd { exchange } => accumulate + wide(false, exchange) - wide(true, !exchange),
            Dsp::Smlaw { top } => accumulate + ((i64::from(n as i32) * i64::from(alu::half(m, top))) >> 16),
            Dsp::Smmla { round } | Dsp::Smmls { round } => {
                let product = i64::from(n as i32) * i64::from(m as i32);
                let base = accumulate << 32;
                let sum = if matches!(kind, Dsp::Smmls { .. }) {
                    base.wrapping_sub(product)
                } else {
                    base.wrapping_add(product)
                };
                let value = sum.wrapping_add(if round { 0x8000_0000 } else { 0 }) >> 32;
                return self.set(rd, value as u32);
            }
            Dsp::Usada8 => {
                let lane = |at: u32| (n >> at & 0xFF).abs_diff(m >> at & 0xFF);
                let sum = (0..4).map(|index| lane(8 * index)).fold(added, u32::wrapping_add);
                return self.set(rd, sum);
            }
        };
        self.cpu.q |= i32::try_from(exact).is_err();
        self.set(rd, exact as u32);
    }

    fn dsp_long(&mut self, kind: DspLong, low: u8, high: u8, rn: u8, rm: u8) {
        let (n, m) = (self.reg(rn), self.reg(rm));
        let wide = |top: bool, other: bool| i64::from(alu::half(n, top)) * i64::from(alu::half(m, other));
        let product = match kind {
            DspLong::Smlalxy { x, y } => wide(x, y),
            DspLong::Smlald { exchange } => wide(false, exchange) + wide(true, !exchange),
            DspLong::Smlsld { exchange } => wide(false, exchange) - wide(true, !exchange),
        };
        let sum = (u64::from(self.reg(high)) << 32 | u64::from(self.reg(low))).wrapping_add(product as u64);
        self.set(low, sum as u32);
        self.set(high, (sum >> 32) as u32);
    }

    fn divide(&mut self, signed: bool, rd: u8, rn: u8, rm: u8) -> Result<(), Fault> {
        let (n, m) = (self.reg(rn), self.reg(rm));
        if m == 0 && self.scs.traps_division() {
            return Err(Fault::DivideByZero);
        }
        let value = match (m, signed) {
            (0, _) => 0,
            (_, true) => (n as i32).wrapping_div(m as i32) as u32,
            (_, false) => n / m,
        };
        // Early termination: a few bits of the quotient in each cycle, 2 to 12 in all.
        let length = |x: u32| 32 - if signed { (x as i32).unsigned_abs() } else { x }.leading_zeros();
        let quotient = if m == 0 { 0 } else { (length(n) + 1).saturating_sub(length(m)) };
        self.now += u64::from(1 + quotient.div_ceil(3).min(10));
        self.set(rd, value);
        Ok(())
    }

    fn saturating(&mut self, kind: Saturating, n: i32, m: i32) -> i32 {
        let doubled = match kind {
            Saturating::Qdadd | Saturating::Qdsub => self.saturated(alu::saturate_signed(2 * i64::from(n), 32)),
            _ => n,
        };
        let exact = match kind {
            Saturating::Qadd | Saturating::Qdadd => i64::from(m) + i64::from(doubled),
            Saturating::Qsub | Saturating::Qdsub => i64::from(m) - i64::from(doubled),
        };
        self.saturated(alu::saturate_signed(exact, 32))
    }

    fn saturated<T>(&mut self, (value, cut): (T, bool)) -> T {
        self.cpu.q |= cut;
        value
    }

    fn hint(&mut self, hint: Hint) {
        use crate::cpu::Sleep;
        match hint {
            Hint::Nop => {}
            Hint::Sev => self.cpu.event = true,
            Hint::Wfe if std::mem::take(&mut self.cpu.event) => {}
            Hint::Wfe => self.fall_asleep(Sleep::Event),
            Hint::Wfi => self.fall_asleep(Sleep::Interrupt),
        }
    }
}
