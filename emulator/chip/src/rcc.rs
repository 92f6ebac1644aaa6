//! Reset and clock control (RM0440, chapter 7).

use crate::bits::{bit, field, merged, unmodelled, wrong};
use bus::{Complaint, ResetCause};

const NAME: &str = "RCC";
/// Internal oscillators, Hz.
pub const HSI_HZ: f64 = 16e6;
/// Low-speed internal oscillator, Hz.
pub const LSI_HZ: f64 = 32e3;

const CR: u32 = 0x00;
const CFGR: u32 = 0x08;
const PLLCFGR: u32 = 0x0c;
const AHB1ENR: u32 = 0x48;
const CCIPR: u32 = 0x88;
const BDCR: u32 = 0x90;
const CSR: u32 = 0x94;
/// APB1ENR1: the clock of the window watchdog.
const WWDGEN: u32 = 1 << 11;
const CRRCR: u32 = 0x98;

const HSION: u32 = 1 << 8;
const PLLON: u32 = 1 << 24;

/// Start-up times, upper ends of the data sheet's ranges, s.
const HSI_START_S: f64 = 1.2e-6;
const PLL_LOCK_S: f64 = 40e-6;
const LSI_START_S: f64 = 130e-6;
const HSI48_START_S: f64 = 6e-6;

/// The clock tree as the registers make it, Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clocks {
    /// System clock.
    pub sysclk: f64,
    /// Core, memories and AHB.
    pub hclk: f64,
    /// APB1 peripherals.
    pub pclk1: f64,
    /// APB2 peripherals.
    pub pclk2: f64,
    /// Cycles of HCLK per cycle of the timers on APB1 and APB2.
    pub timer_ratio: [u64; 2],
    /// PLL outputs, where the PLL runs and the output is enabled.
    pub pll_p: Option<f64>,
    /// For USB and others.
    pub pll_q: Option<f64>,
}

/// The peripheral.
#[derive(Clone, Debug)]
pub struct Rcc {
    registers: [u32; 41],
    /// When each oscillator that is on becomes ready, s.
    hsi_at: f64,
    pll_at: f64,
    lsi_at: f64,
    hsi48_at: f64,
    /// The independent watchdog keeps LSI on (RM0440, 41.3.1).
    pub watchdog_runs: bool,
}

impl Rcc {
    /// After a reset at this time. A power-on sets the flags of brown-out and pin (7.4.29).
    pub fn new(cause: ResetCause) -> Self {
        let mut registers = [0; 41];
        registers[(CR / 4) as usize] = 0x100;
        registers[(CFGR / 4) as usize] = 0x5;
        registers[(PLLCFGR / 4) as usize] = 0x1000;
        registers[(AHB1ENR / 4) as usize] = 0x100;
        for (offset, reset) in [
            (0x04, 0x4000_0000),
            (0x68, 0x0000_130f),
            (0x6c, 0x050f_667f),
            (0x70, 0x0000_0101),
            (0x78, 0xd2fe_cd3f),
            (0x7c, 0x0000_0103),
            (0x80, 0x0437_f801),
        ] {
            registers[offset / 4] = reset;
        }
        registers[(CSR / 4) as usize] = match cause {
            ResetCause::PowerOn => 0x0c00_0000,
            ResetCause::Watchdog => 0x2400_0000,
            ResetCause::WindowWatchdog => 0x4400_0000,
            ResetCause::Software => 0x1400_0000,
        };
        Self { registers, hsi_at: 0.0, pll_at: 0.0, lsi_at: 0.0, hsi48_at: 0.0, watchdog_runs: false }
    }

    fn at(&self, offset: u32) -> u32 {
        self.registers[(offset / 4) as usize]
    }

    /// Whether a bit of a register is set: clock enables.
    pub fn has(&self, offset: u32, position: u32) -> bool {
        bit(self.at(offset), position)
    }

    /// A field of CCIPR: where a peripheral takes its kernel clock from.
    pub fn source(&self, position: u32) -> u32 {
        field(self.at(CCIPR), position, 2)
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now_s: f64) -> Result<u32, Complaint> {
        let value = match offset {
            CR => {
                let mut value = self.at(CR) & !0x0202_0400;
                value |= if value & HSION != 0 && now_s >= self.hsi_at { 0x400 } else { 0 };
                value | if value & PLLON != 0 && now_s >= self.pll_at { 1 << 25 } else { 0 }
            }
            CSR => {
                let on = self.at(CSR) & 1 != 0 || self.watchdog_runs;
                let value = self.at(CSR) & !2;
                value | if on && now_s >= self.lsi_at { 2 } else { 0 }
            }
            CRRCR => {
                let value = self.at(CRRCR) & !2;
                value | if value & 1 != 0 && now_s >= self.hsi48_at { 2 } else { 0 }
            }
            0x04 | CFGR | PLLCFGR | 0x18 | 0x1c => self.at(offset),
            0x28..=0x30 | 0x38..=0x40 | 0x48..=0x50 | 0x58..=0x60 | 0x68..=0x70 | 0x78..=0x80 => self.at(offset),
            CCIPR | BDCR | 0x9c => self.at(offset),
            0x20 => 0,
            _ => return Err(unmodelled(NAME, offset)),
        };
        Ok(value)
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now_s: f64) -> Result<(), Complaint> {
        let old = self.at(offset.min(0xa0));
        let mut complaint = None;
        match offset {
            CR => {
                complaint = self.write_cr(old, value, now_s);
            }
            CFGR => {
                complaint = self.write_cfgr(value, now_s);
            }
            PLLCFGR => {
                if self.at(CR) & PLLON != 0 && (old ^ value) & !0x0111_0000 != 0 {
                    return Err(wrong(NAME, "PLLCFGR is written while the PLL runs (7.4.4)"));
                }
                self.set(PLLCFGR, value);
            }
            CSR => {
                let flags = if bit(value, 23) { 0 } else { old & 0xfe00_0000 };
                if value & !old & 1 != 0 {
                    self.lsi_at = now_s + LSI_START_S;
                }
                self.set(CSR, flags | value & 1);
            }
            CRRCR => {
                if value & !old & 1 != 0 {
                    self.hsi48_at = now_s + HSI48_START_S;
                }
                self.set(CRRCR, value & 1);
            }
            BDCR => {
                if value & 1 != 0 {
                    complaint = Some(wrong(NAME, "LSE: the boards have no crystal there"));
                }
                self.set(BDCR, value & !2);
            }
            0x04 => self.set(offset, merged(old, value, 0x7f00_0000)),
            // The clock of the window watchdog stays on until the next reset (7.4.19).
            0x58 => self.set(offset, value | old & WWDGEN),
            0x18 | 0x28..=0x30 | 0x38..=0x40 | 0x48..=0x50 | 0x58..=0x60 | 0x68..=0x70 | 0x78..=0x80 => {
                self.set(offset, value);
            }
            CCIPR | 0x9c => self.set(offset, value),
            0x20 => self.set(0x1c, self.at(0x1c) & !value),
            _ => return Err(unmodelled(NAME, offset)),
        }
        complaint.map_or(Ok(()), Err)
    }

    fn set(&mut self, offset: u32, value: u32) {
        self.registers[(offset / 4) as usize] = value;
    }

    fn write_cr(&mut self, old: u32, value: u32, now_s: f64) -> Option<Complaint> {
        let mut value = merged(old, value, 0x010d_0300);
        if value & !old & HSION != 0 {
            self.hsi_at = now_s + HSI_START_S;
        }
        if value & !old & PLLON != 0 {
            self.pll_at = now_s + PLL_LOCK_S;
        }
        let mut complaint = None;
        let uses = self.source_in_use();
        if uses == 1 && value & HSION == 0 {
            // Hardware keeps the oscillator that drives the system (7.4.1).
            value |= HSION;
            complaint = Some(wrong(NAME, "HSI is the system clock and cannot be switched off"));
        }
        if uses == 3 && value & PLLON == 0 {
            value |= PLLON;
            complaint = Some(wrong(NAME, "the PLL is the system clock and cannot be switched off"));
        }
        if bit(value, 16) && !bit(old, 16) {
            complaint = Some(wrong(NAME, "HSE is switched on: the board is modelled without its crystal"));
        }
        self.set(CR, value);
        complaint
    }

    fn write_cfgr(&mut self, value: u32, now_s: f64) -> Option<Complaint> {
        let wanted = field(value, 0, 2);
        let cr = self.read(CR, now_s).unwrap_or(0);
        let ready = match wanted {
            1 => cr & 0x400 != 0,
            3 => cr & 0x0200_0000 != 0 && bit(self.at(PLLCFGR), 24),
            _ => false,
        };
        let source = if ready { wanted } else { self.source_in_use() };
        self.set(CFGR, value & !0xf | wanted | source << 2);
        (!ready).then(|| wrong(NAME, format!("SW selects source {wanted}, which is not ready (7.4.3)")))
    }

    fn source_in_use(&self) -> u32 {
        field(self.at(CFGR), 2, 2)
    }

    fn vco(&self) -> Option<f64> {
        let pll = self.at(PLLCFGR);
        let input = match field(pll, 0, 2) {
            2 => HSI_HZ,
            _ => return None,
        };
        let divided = input / f64::from(field(pll, 4, 4) + 1);
        (self.at(CR) & PLLON != 0).then(|| divided * f64::from(field(pll, 8, 7)))
    }

    /// The clock tree (7.2, figure 17).
    pub fn clocks(&self) -> Clocks {
        let pll = self.at(PLLCFGR);
        let vco = self.vco();
        let two = |at: u32| f64::from(2 * (field(pll, at, 2) + 1));
        let divider_p = match field(pll, 27, 5) {
            0 => {
                if bit(pll, 17) {
                    17.0
                } else {
                    7.0
                }
            }
            direct => f64::from(direct),
        };
        let sysclk = match self.source_in_use() {
            3 => vco.map_or(HSI_HZ, |hz| hz / two(25)),
            _ => HSI_HZ,
        };
        let cfgr = self.at(CFGR);
        let hclk = sysclk / ahb_divider(field(cfgr, 4, 4));
        let apb = [8, 11].map(|at| apb_divider(field(cfgr, at, 3)));
        Clocks {
            sysclk,
            hclk,
            pclk1: hclk / apb[0] as f64,
            pclk2: hclk / apb[1] as f64,
            timer_ratio: apb.map(|divider| if divider == 1 { 1 } else { divider / 2 }),
            pll_p: vco.filter(|_| bit(pll, 16)).map(|hz| hz / divider_p),
            pll_q: vco.filter(|_| bit(pll, 20)).map(|hz| hz / two(21)),
        }
    }

    /// Input and VCO of the PLL against the data sheet's limits (DS12288, table 46: 2.66 to 16 MHz, 96 to 344 MHz).
    pub fn pll_complaint(&self) -> Option<Complaint> {
        let pll = self.at(PLLCFGR);
        let vco = self.vco()?;
        let input = vco / f64::from(field(pll, 8, 7).max(1));
        if !(2.66e6..=16e6).contains(&input) {
            return Some(wrong(NAME, format!("PLL input of {:.2} MHz is out of 2.66 to 16 MHz", input / 1e6)));
        }
        (!(96e6..=344e6).contains(&vco))
            .then(|| wrong(NAME, format!("PLL VCO of {:.0} MHz is out of 96 to 344 MHz", vco / 1e6)))
    }
}

fn ahb_divider(code: u32) -> f64 {
    match code {
        8..=11 => f64::from(2 << (code - 8)),
        12..=15 => f64::from(64 << (code - 12)),
        _ => 1.0,
    }
}

fn apb_divider(code: u32) -> u64 {
    if code < 4 { 1 } else { 2 << (code - 4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_170() -> Rcc {
        let mut rcc = Rcc::new(ResetCause::PowerOn);
        // 16 MHz / 4 · 85 / 2 = 170 MHz on R.
        rcc.write(PLLCFGR, 2 | 3 << 4 | 85 << 8 | 1 << 24, 0.0).unwrap();
        rcc.write(CR, HSION | PLLON, 0.0).unwrap();
        rcc
    }

    #[test]
    fn reset_runs_from_hsi() {
        let rcc = Rcc::new(ResetCause::PowerOn);
        let clocks = rcc.clocks();
        assert_eq!((clocks.sysclk, clocks.hclk, clocks.pclk1), (16e6, 16e6, 16e6));
    }

    #[test]
    fn the_pll_gives_170_mhz_once_it_is_ready() {
        let mut rcc = at_170();
        assert!(rcc.write(CFGR, 3, 1e-6).is_err(), "not locked yet");
        assert_eq!(rcc.clocks().hclk, 16e6);
        assert_eq!(rcc.read(CFGR, 1e-6).unwrap() & 0xf, 0b0111, "SW asks, SWS shows HSI");
        assert_eq!(rcc.read(CR, 41e-6).unwrap() >> 25 & 1, 1);
        rcc.write(CFGR, 3, 41e-6).unwrap();
        assert_eq!(rcc.clocks().hclk, 170e6);
        assert_eq!(rcc.read(CFGR, 41e-6).unwrap() & 0xf, 0xf);
    }

    #[test]
    fn timers_on_a_divided_bus_run_at_twice_its_clock() {
        let mut rcc = at_170();
        rcc.write(CFGR, 3 | 0b101 << 8 | 0b100 << 11, 1e-4).unwrap();
        let clocks = rcc.clocks();
        assert_eq!((clocks.pclk1, clocks.pclk2), (42.5e6, 85e6));
        assert_eq!(clocks.timer_ratio, [2, 1]);
    }

    #[test]
    fn the_running_clock_cannot_be_switched_off() {
        let mut rcc = at_170();
        rcc.write(CFGR, 3, 1e-4).unwrap();
        assert!(rcc.write(CR, HSION, 1e-4).is_err());
        assert_eq!(rcc.clocks().hclk, 170e6);
    }

    #[test]
    fn reset_flags_name_the_cause_until_they_are_removed() {
        let mut rcc = Rcc::new(ResetCause::Watchdog);
        assert_eq!(rcc.read(CSR, 0.0).unwrap() >> 29 & 1, 1);
        rcc.write(CSR, 1 << 23, 0.0).unwrap();
        assert_eq!(rcc.read(CSR, 0.0).unwrap() >> 24, 0);
    }

    #[test]
    fn pll_p_for_the_adcs() {
        let mut rcc = at_170();
        rcc.write(CR, HSION, 0.0).unwrap();
        // P = VCO 340 MHz / 8 = 42.5 MHz.
        rcc.write(PLLCFGR, 2 | 3 << 4 | 85 << 8 | 1 << 16 | 8 << 27 | 1 << 24, 0.0).unwrap();
        rcc.write(CR, HSION | PLLON, 0.0).unwrap();
        assert_eq!(rcc.clocks().pll_p, Some(42.5e6));
        assert_eq!(rcc.pll_complaint(), None);
    }
}
