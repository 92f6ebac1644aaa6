//! DAC, comparators and op-amps (RM0440, chapters 22, 24 and 25), as far as a drive uses them.

use crate::bits::{bit, field, merged, unmodelled, wrong};
use crate::gpio::Pin;
use bus::Complaint;

/// Supply and reference, V.
pub const VDDA: f64 = 3.3;
/// Internal reference, V (DS12288, table 20).
pub const VREFINT: f64 = 1.212;

/// A DAC with two channels.
#[derive(Clone, Debug)]
pub struct Dac {
    name: &'static str,
    cr: u32,
    mcr: u32,
    data: [u32; 2],
}

impl Dac {
    /// As reset leaves it.
    pub fn new(name: &'static str) -> Self {
        Self { name, cr: 0, mcr: 0, data: [0; 2] }
    }

    /// Output of a channel (0 or 1), V.
    pub fn volts(&self, channel: usize) -> f64 {
        if bit(self.cr, 16 * channel as u32) { f64::from(self.data[channel]) / 4096.0 * VDDA } else { 0.0 }
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => self.cr,
            0x08 | 0x2c => self.data[0],
            0x14 | 0x30 => self.data[1],
            // Ready where it is on (22.7.14).
            0x34 => (self.cr & 1) << 11 | (self.cr >> 16 & 1) << 27,
            0x3c => self.mcr,
            _ => return Err(unmodelled(self.name, offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        match offset {
            0x00 => {
                self.cr = value;
                if value & !0x0001_0001 != 0 {
                    return Err(wrong(self.name, "CR: triggers, waves, DMA and calibration are not modelled"));
                }
            }
            0x08 => self.data[0] = value & 0xfff,
            0x14 => self.data[1] = value & 0xfff,
            0x20 => self.data = [value & 0xfff, value >> 16 & 0xfff],
            0x3c => self.mcr = value,
            _ => return Err(unmodelled(self.name, offset)),
        }
        Ok(())
    }
}

/// What a comparator compares with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threshold {
    /// Quarters of VREFINT.
    Reference(u8),
    /// Channel (1 or 2) of a DAC (1 to 4).
    Dac(u8, u8),
    /// A pin.
    Pin(Pin),
}

/// A comparator.
#[derive(Clone, Copy, Debug, Default)]
pub struct Comp {
    csr: u32,
    value: bool,
}

/// Non-inverting pins (24.3.2, table 196), INPSEL 0 and 1, of COMP1 to COMP7.
const PLUS: [[Pin; 2]; 7] = [
    [Pin::of(b'A', 1), Pin::of(b'B', 1)],
    [Pin::of(b'A', 7), Pin::of(b'A', 3)],
    [Pin::of(b'A', 0), Pin::of(b'C', 1)],
    [Pin::of(b'B', 0), Pin::of(b'E', 7)],
    [Pin::of(b'B', 13), Pin::of(b'D', 12)],
    [Pin::of(b'B', 11), Pin::of(b'D', 11)],
    [Pin::of(b'B', 14), Pin::of(b'D', 14)],
];
/// Inverting pins (table 197), INMSEL 6 and 7.
const MINUS: [[Pin; 2]; 7] = [
    [Pin::of(b'A', 4), Pin::of(b'A', 0)],
    [Pin::of(b'A', 5), Pin::of(b'A', 2)],
    [Pin::of(b'F', 1), Pin::of(b'C', 0)],
    [Pin::of(b'E', 8), Pin::of(b'B', 2)],
    [Pin::of(b'B', 10), Pin::of(b'D', 13)],
    [Pin::of(b'D', 10), Pin::of(b'B', 15)],
    [Pin::of(b'D', 15), Pin::of(b'B', 12)],
];
/// DAC and channel of INMSEL 4 and 5 (table 197).
const DACS: [[(u8, u8); 2]; 7] = [
    [(3, 1), (1, 1)],
    [(3, 2), (1, 2)],
    [(3, 1), (1, 1)],
    [(3, 2), (1, 1)],
    [(4, 1), (1, 2)],
    [(4, 2), (2, 1)],
    [(4, 1), (2, 1)],
];

impl Comp {
    /// The register.
    pub fn read(&self) -> u32 {
        self.csr & !(1 << 30) | u32::from(self.output()) << 30
    }

    /// Writes it.
    pub fn write(&mut self, value: u32) -> Result<(), Complaint> {
        if bit(self.csr, 31) {
            return Err(wrong("COMP", "CSR is written while it is locked (24.6.1)"));
        }
        self.csr = value & !(1 << 30);
        if field(value, 19, 3) != 0 {
            return Err(wrong("COMP", "CSR: blanking is not modelled"));
        }
        Ok(())
    }

    /// Whether it is on.
    pub fn enabled(&self) -> bool {
        bit(self.csr, 0)
    }

    /// Pin of the non-inverting input of comparator `number` (from 0).
    pub fn plus(&self, number: usize) -> Pin {
        PLUS[number][usize::from(bit(self.csr, 8))]
    }

    /// The inverting input.
    pub fn minus(&self, number: usize) -> Threshold {
        match field(self.csr, 4, 3) {
            select @ 0..=3 => Threshold::Reference(select as u8 + 1),
            select @ (4 | 5) => {
                let (dac, channel) = DACS[number][select as usize - 4];
                Threshold::Dac(dac, channel)
            }
            select => Threshold::Pin(MINUS[number][select as usize - 6]),
        }
    }

    /// Takes the inputs, with the hysteresis of HYST (10 mV a step, 24.6.1).
    pub fn compare(&mut self, plus: f64, minus: f64) {
        let half = 0.005 * f64::from(field(self.csr, 16, 3));
        self.value = plus > minus + if self.value { -half } else { half };
    }

    /// After polarity.
    pub fn output(&self) -> bool {
        self.enabled() && self.value != bit(self.csr, 15)
    }
}

/// An op-amp.
#[derive(Clone, Copy, Debug, Default)]
pub struct Opamp {
    csr: u32,
}

/// Non-inverting pins (25.3.3, tables 200 to 205): VP_SEL 0 to 2 of OPAMP1 to OPAMP6; 3 is a DAC or a pin off the
/// package.
const OPAMP_PLUS: [[Pin; 3]; 6] = [
    [Pin::of(b'A', 1), Pin::of(b'A', 3), Pin::of(b'A', 7)],
    [Pin::of(b'A', 7), Pin::of(b'B', 14), Pin::of(b'B', 0)],
    [Pin::of(b'B', 0), Pin::of(b'B', 13), Pin::of(b'A', 1)],
    [Pin::of(b'B', 13), Pin::of(b'D', 11), Pin::of(b'B', 11)],
    [Pin::of(b'B', 14), Pin::of(b'D', 12), Pin::of(b'C', 3)],
    [Pin::of(b'B', 12), Pin::of(b'D', 9), Pin::of(b'B', 13)],
];
/// Output pins of OPAMP1 to OPAMP6.
pub const OPAMP_OUT: [Pin; 6] =
    [Pin::of(b'A', 2), Pin::of(b'A', 6), Pin::of(b'B', 1), Pin::of(b'B', 12), Pin::of(b'A', 8), Pin::of(b'B', 11)];

impl Opamp {
    /// The register.
    pub fn read(&self) -> u32 {
        self.csr
    }

    /// Writes it.
    pub fn write(&mut self, value: u32) -> Result<(), Complaint> {
        if bit(self.csr, 31) {
            return Err(wrong("OPAMP", "CSR is written while it is locked (25.5.1)"));
        }
        self.csr = merged(self.csr, value, !(1 << 30));
        if bit(value, 11) || bit(value, 1) {
            return Err(wrong("OPAMP", "CSR: calibration mode is not modelled"));
        }
        if bit(value, 0) && field(value, 5, 2) < 2 {
            return Err(wrong("OPAMP", "CSR: standalone mode (VM_SEL 0, 1) is not modelled"));
        }
        if bit(value, 0) && field(value, 5, 2) == 2 && self.gain().is_none() {
            return Err(wrong("OPAMP", "CSR: PGA_GAIN holds a reserved value"));
        }
        Ok(())
    }

    /// Whether it is on.
    pub fn enabled(&self) -> bool {
        bit(self.csr, 0)
    }

    /// Whether its output goes to a converter inside instead of to its pin (OPAINTOEN).
    pub fn internal(&self) -> bool {
        bit(self.csr, 8)
    }

    /// Non-inverting gain, where it is one that exists (25.5.1, PGA_GAIN).
    pub fn gain(&self) -> Option<f64> {
        if field(self.csr, 5, 2) == 3 {
            return Some(1.0);
        }
        let code = field(self.csr, 14, 5);
        (code & 7 < 6).then(|| f64::from(2 << (code & 7)))
    }

    /// Pin of its non-inverting input.
    pub fn plus(&self, number: usize) -> Option<Pin> {
        OPAMP_PLUS[number].get(field(self.csr, 2, 2) as usize).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dac_sets_the_threshold_of_a_comparator() {
        let mut dac = Dac::new("DAC3");
        dac.write(0x00, 1).unwrap();
        dac.write(0x08, 2048).unwrap();
        assert_eq!(dac.volts(0), 1.65);
        let mut comp = Comp::default();
        comp.write(1 | 4 << 4).unwrap();
        assert_eq!((comp.plus(0), comp.minus(0)), (Pin::of(b'A', 1), Threshold::Dac(3, 1)));
        comp.compare(1.66, dac.volts(0));
        assert_ne!(comp.read() & 1 << 30, 0);
        comp.compare(1.64, dac.volts(0));
        assert_eq!(comp.read() & 1 << 30, 0);
    }

    #[test]
    fn hysteresis_and_polarity() {
        let mut comp = Comp::default();
        comp.write(1 | 2 << 16 | 1 << 15).unwrap();
        comp.compare(1.005, 1.0);
        assert!(comp.output(), "not above by 10 mV, inverted");
        comp.compare(1.011, 1.0);
        assert!(!comp.output());
        comp.compare(0.991, 1.0);
        assert!(!comp.output());
        comp.compare(0.989, 1.0);
        assert!(comp.output());
    }

    #[test]
    fn programmable_gains() {
        let mut opamp = Opamp::default();
        for (code, gain) in [(0, 2.0), (3, 16.0), (5, 64.0), (11, 16.0), (19, 16.0), (27, 16.0)] {
            opamp.write(1 | 2 << 5 | code << 14).unwrap();
            assert_eq!(opamp.gain(), Some(gain), "PGA_GAIN {code}");
        }
        assert!(opamp.write(1 | 2 << 5 | 6 << 14).is_err());
        opamp.write(1 | 3 << 5).unwrap();
        assert_eq!(opamp.gain(), Some(1.0), "follower");
        assert_eq!(opamp.plus(2), Some(Pin::of(b'B', 0)));
    }
}
