//! What two or three converters share (RM0440, 21.8).

use super::AdcClock;
use crate::bits::{bit, field, unmodelled, wrong};
use crate::rcc::{Clocks, Rcc};
use bus::Complaint;

/// Dividers of CCR.PRESC.
const PRESCALERS: [f64; 12] = [1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0, 32.0, 64.0, 128.0, 256.0];
/// Highest clock of a converter in range 1, single-ended (DS12288, table 66), Hz.
const HIGHEST_HZ: f64 = 60e6;

/// The common block.
#[derive(Clone, Debug)]
pub struct Common {
    name: &'static str,
    ccr: u32,
    /// Field of CCIPR that selects the kernel clock.
    selector: u32,
}

impl Common {
    /// `selector` is the position of ADC12SEL or ADC345SEL in CCIPR.
    pub fn new(name: &'static str, selector: u32) -> Self {
        Self { name, ccr: 0, selector }
    }

    /// As reset leaves it.
    pub fn reset(&mut self) {
        self.ccr = 0;
    }

    /// Reads a register; `flags` are the ISR of master and slave.
    pub fn read(&self, offset: u32, flags: [u32; 2]) -> Result<u32, Complaint> {
        match offset {
            0x00 => Ok(flags[0] & 0x7ff | (flags[1] & 0x7ff) << 16),
            0x08 => Ok(self.ccr),
            _ => Err(unmodelled(self.name, offset)),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        if offset != 0x08 {
            return Err(unmodelled(self.name, offset));
        }
        self.ccr = value & 0x01ff_ef1f;
        if field(value, 0, 5) != 0 {
            return Err(wrong(
                self.name,
                "CCR: dual modes are not modelled; one trigger makes converters simultaneous",
            ));
        }
        Ok(())
    }

    /// Whether CCR switches a source on: VREFINT (22), temperature (23), VBAT (24).
    pub fn connects(&self, position: u32) -> bool {
        bit(self.ccr, position)
    }

    /// The clock of the converters (21.4.3).
    pub fn clock(&self, rcc: &Rcc, clocks: &Clocks) -> AdcClock {
        let mode = field(self.ccr, 16, 2) as usize;
        let ratio = match mode {
            0 => {
                let kernel = match rcc.source(self.selector) {
                    1 => clocks.pll_p,
                    2 => Some(clocks.sysclk),
                    _ => None,
                };
                let divider = PRESCALERS[(field(self.ccr, 18, 4) as usize).min(11)];
                kernel.map_or(f64::INFINITY, |hz| clocks.hclk * divider / hz)
            }
            mode => f64::from(1 << (mode - 1)),
        };
        AdcClock { ratio, mode }
    }

    /// What is wrong with a clock.
    pub fn complaint(&self, clock: AdcClock, hclk: f64) -> Option<Complaint> {
        if clock.ratio.is_infinite() {
            return Some(wrong(self.name, "no kernel clock is selected (RCC_CCIPR) and CKMODE is asynchronous"));
        }
        let hz = hclk / clock.ratio;
        (hz > HIGHEST_HZ * 1.0001).then(|| wrong(self.name, format!("a clock of {:.1} MHz is above 60 MHz", hz / 1e6)))
    }
}
