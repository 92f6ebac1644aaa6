//! The floating-point unit: FPv4-SP in the round-to-nearest mode that it has after reset. The cumulative exception
//! flags of FPSCR stay as they are.

use crate::cpu::Cpu;
use crate::fault::Fault;
use crate::machine::Machine;
use crate::op::{Float2, Float3, Op};
use bus::Bus;

const DEFAULT_NAN: u32 = 0x7FC0_0000;

/// FPSCR: default NaN, flush to zero.
const DN: u32 = 1 << 25;

fn is_nan(bits: u32) -> bool {
    bits & 0x7FFF_FFFF > 0x7F80_0000
}

fn is_signalling(bits: u32) -> bool {
    is_nan(bits) && bits & 0x0040_0000 == 0
}

/// FPProcessNaNs: the first signalling operand, else the first quiet one, quieted; else the result.
fn settle<const N: usize>(fpscr: u32, operands: [u32; N], result: f32) -> u32 {
    if !result.is_nan() {
        return result.to_bits();
    }
    let first = operands.iter().find(|&&bits| is_signalling(bits)).or(operands.iter().find(|&&bits| is_nan(bits)));
    match first {
        Some(bits) if fpscr & DN == 0 => bits | 0x0040_0000,
        _ => DEFAULT_NAN,
    }
}

fn negate(bits: u32) -> u32 {
    bits ^ 0x8000_0000
}

impl Cpu {
    fn binary(&self, a: u32, b: u32, f: impl Fn(f32, f32) -> f32) -> u32 {
        settle(self.fpscr, [a, b], f(f32::from_bits(a), f32::from_bits(b)))
    }

    fn product(&self, a: u32, b: u32) -> u32 {
        self.binary(a, b, |a, b| a * b)
    }

    fn sum(&self, a: u32, b: u32) -> u32 {
        self.binary(a, b, |a, b| a + b)
    }

    fn fused(&self, d: u32, n: u32, m: u32) -> u32 {
        let product_of_nothing = |a: u32, b: u32| a & 0x7FFF_FFFF == 0x7F80_0000 && b & 0x7FFF_FFFF == 0;
        if is_nan(d) && !is_signalling(d) && (product_of_nothing(n, m) || product_of_nothing(m, n)) {
            return DEFAULT_NAN;
        }
        settle(self.fpscr, [d, n, m], f32::from_bits(n).mul_add(f32::from_bits(m), f32::from_bits(d)))
    }

    fn float3(&self, op: Float3, d: u32, n: u32, m: u32) -> u32 {
        match op {
            Float3::Add => self.sum(n, m),
            Float3::Sub => self.binary(n, m, |n, m| n - m),
            Float3::Mul => self.product(n, m),
            Float3::Nmul => negate(self.product(n, m)),
            Float3::Div => self.binary(n, m, |n, m| n / m),
            Float3::Mla => self.sum(d, self.product(n, m)),
            Float3::Mls => self.sum(d, negate(self.product(n, m))),
            Float3::Nmla => self.sum(negate(d), negate(self.product(n, m))),
            Float3::Nmls => self.sum(negate(d), self.product(n, m)),
            Float3::Fma => self.fused(d, n, m),
            Float3::Fms => self.fused(d, negate(n), m),
            Float3::Fnma => self.fused(negate(d), negate(n), m),
            Float3::Fnms => self.fused(negate(d), n, m),
        }
    }

    fn compare(&mut self, a: u32, b: u32) {
        let (n, z, c, v) = match f32::from_bits(a).partial_cmp(&f32::from_bits(b)) {
            Some(core::cmp::Ordering::Less) => (1, 0, 0, 0),
            Some(core::cmp::Ordering::Equal) => (0, 1, 1, 0),
            Some(core::cmp::Ordering::Greater) => (0, 0, 1, 0),
            None => (0, 0, 1, 1),
        };
        self.fpscr = self.fpscr & 0x0FFF_FFFF | n << 31 | z << 30 | c << 29 | v << 28;
    }

    /// To an integer or to fixed point: saturates, NaN gives 0.
    fn to_integer(value: f64, signed: bool, bits: u32) -> u32 {
        let (low, high) = if signed {
            (-((1u64 << (bits - 1)) as f64), ((1u64 << (bits - 1)) - 1) as f64)
        } else {
            (0.0, ((1u64 << bits) - 1) as f64)
        };
        if value.is_nan() { 0 } else { value.clamp(low, high) as i64 as u32 }
    }

    fn float2(&self, op: Float2, d: u32, m: u32) -> u32 {
        match op {
            Float2::Mov => m,
            Float2::Abs => m & 0x7FFF_FFFF,
            Float2::Neg => negate(m),
            Float2::Sqrt => settle(self.fpscr, [m], f32::from_bits(m).sqrt()),
            Float2::FromHalf { top } => from_half((if top { m >> 16 } else { m }) as u16),
            Float2::ToHalf { top } => {
                let half = u32::from(to_half(m));
                if top { d & 0xFFFF | half << 16 } else { d & 0xFFFF_0000 | half }
            }
            Float2::FromInt { signed } => if signed { m as i32 as f32 } else { m as f32 }.to_bits(),
            Float2::ToInt { signed, zero } => {
                let value = f64::from(f32::from_bits(m));
                Self::to_integer(if zero { value.trunc() } else { value.round_ties_even() }, signed, 32)
            }
        }
    }

    fn fixed(value: u32, to_fixed: bool, signed: bool, half: bool, fraction: u8) -> u32 {
        let scale = 2f64.powi(fraction.into());
        let bits = if half { 16 } else { 32 };
        if to_fixed {
            let fixed = Self::to_integer((f64::from(f32::from_bits(value)) * scale).trunc(), signed, bits);
            // The narrow result is extended to the register.
            return if half && signed { i32::from(fixed as i16) as u32 } else { fixed };
        }
        let integer = match (half, signed) {
            (true, true) => f64::from(value as i16),
            (true, false) => f64::from(value as u16),
            (false, true) => f64::from(value as i32),
            (false, false) => f64::from(value),
        };
        ((integer / scale) as f32).to_bits()
    }
}

/// IEEE half precision, exact.
fn from_half(half: u16) -> u32 {
    let (sign, exponent, fraction) = (u32::from(half >> 15) << 31, u32::from(half >> 10 & 31), u32::from(half & 0x3FF));
    match exponent {
        31 if fraction != 0 => sign | 0x7FC0_0000 | fraction << 13,
        31 => sign | 0x7F80_0000,
        0 => sign | (fraction as f32 * 2f32.powi(-24)).to_bits(),
        _ => sign | (exponent + 112) << 23 | fraction << 13,
    }
}

/// … rounded to nearest even.
fn to_half(bits: u32) -> u16 {
    let sign = (bits >> 16 & 0x8000) as u16;
    let magnitude = f32::from_bits(bits & 0x7FFF_FFFF);
    if magnitude.is_nan() {
        return sign | 0x7E00 | (bits >> 13 & 0x1FF) as u16;
    }
    if magnitude >= 65520.0 {
        return sign | 0x7C00;
    }
    let exponent = ((bits >> 23 & 0xFF) as i32 - 127).max(-14);
    let units = (f64::from(magnitude) * 2f64.powi(10 - exponent)).round_ties_even() as u16;
    // 1024 units are the hidden bit, which counts the exponent up by one; a carry out of the fraction does the same.
    sign | ((((exponent + 14) as u16) << 10) + units)
}

impl<S: Bus> Machine<S> {
    #[inline(never)]
    pub(crate) fn execute_float(&mut self, op: Op) -> Result<(), Fault> {
        self.prepare_float()?;
        let cpu = &mut self.cpu;
        let s = |cpu: &Cpu, number: u8| cpu.s[usize::from(number)];
        match op {
            Op::Float3 { op, d, n, m } => {
                cpu.s[usize::from(d)] = cpu.float3(op, s(cpu, d), s(cpu, n), s(cpu, m));
                self.now += match op {
                    Float3::Div => 13,
                    Float3::Add | Float3::Sub | Float3::Mul | Float3::Nmul => 0,
                    _ => 2,
                };
            }
            Op::Float2 { op, d, m } => {
                cpu.s[usize::from(d)] = cpu.float2(op, s(cpu, d), s(cpu, m));
                self.now += if op == Float2::Sqrt { 13 } else { 0 };
            }
            Op::FloatImm { d, bits } => cpu.s[usize::from(d)] = bits,
            Op::FloatCompare { d, m } => {
                let with = m.map_or(0, |m| s(cpu, m));
                cpu.compare(s(cpu, d), with);
            }
            Op::FloatFixed { to_fixed, signed, half, fraction, d } => {
                cpu.s[usize::from(d)] = Cpu::fixed(s(cpu, d), to_fixed, signed, half, fraction);
            }
            Op::FloatToCore { rt, n } => {
                let value = s(cpu, n);
                self.set(rt, value);
            }
            Op::FloatFromCore { rt, n } => cpu.s[usize::from(n)] = cpu.r[usize::from(rt)],
            Op::FloatPair { to_core: true, rt, rt2, m } => {
                let (first, second) = (s(cpu, m), s(cpu, m + 1));
                self.set(rt, first);
                self.set(rt2, second);
                self.now += 1;
            }
            Op::FloatPair { to_core: false, rt, rt2, m } => {
                (cpu.s[usize::from(m)], cpu.s[usize::from(m) + 1]) = (cpu.r[usize::from(rt)], cpu.r[usize::from(rt2)]);
                self.now += 1;
            }
            Op::Vmrs { rt: 15 } => {
                let flags = cpu.fpscr;
                (cpu.n, cpu.z) = (flags >> 31 != 0, flags >> 30 & 1 != 0);
                (cpu.c, cpu.v) = (flags >> 29 & 1 != 0, flags >> 28 & 1 != 0);
            }
            Op::Vmrs { rt } => {
                let value = cpu.fpscr;
                self.set(rt, value);
            }
            Op::Vmsr { rt } => cpu.fpscr = cpu.r[usize::from(rt)] & 0xF7C0_009F,
            Op::FloatLoad { double, d, rn, offset } => return self.float_load(double, d, rn, offset),
            Op::FloatStore { double, d, rn, offset } => return self.float_store(double, d, rn, offset),
            Op::FloatLoadMultiple { before, back, rn, first, count } => {
                return self.float_multiple(true, rn, before, back, first, count);
            }
            Op::FloatStoreMultiple { before, back, rn, first, count } => {
                return self.float_multiple(false, rn, before, back, first, count);
            }
            _ => return Err(Fault::Undefined),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_go_and_come_back() {
        for half in 0..=u16::MAX {
            let bits = from_half(half);
            if !is_nan(bits) {
                assert_eq!(to_half(bits), half);
            }
        }
    }
}
