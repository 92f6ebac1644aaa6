//! Independent watchdog (RM0440, chapter 41), on its own 32 kHz.

use crate::bits::{unmodelled, wrong};
use crate::rcc::LSI_HZ;
use bus::Complaint;
use measure::Range;

const NAME: &str = "IWDG";
/// A write to PR, RLR or WINR takes effect after five cycles of LSI at the most (41.4.4).
const UPDATE_S: f64 = 5.0 / LSI_HZ;

/// The peripheral.
#[derive(Clone, Debug)]
pub struct Iwdg {
    prescaler: u32,
    reload: u32,
    window: u32,
    unlocked: bool,
    updated_at_s: [f64; 3],
    /// When it runs out.
    bites_at_s: Option<f64>,
    refreshed_s: Option<f64>,
    /// Time between two refreshes, s.
    pub interval_s: Range,
}

impl Default for Iwdg {
    fn default() -> Self {
        Self {
            prescaler: 0,
            reload: 0xfff,
            window: 0xfff,
            unlocked: false,
            updated_at_s: [0.0; 3],
            bites_at_s: None,
            refreshed_s: None,
            interval_s: Range::default(),
        }
    }
}

impl Iwdg {
    /// As reset leaves it: stopped.
    pub fn reset(&mut self) {
        *self = Self { interval_s: self.interval_s, ..Self::default() };
    }

    /// Whether it has been started.
    pub fn runs(&self) -> bool {
        self.bites_at_s.is_some()
    }

    /// When it resets the chip unless refreshed, s.
    pub fn bites_at_s(&self) -> Option<f64> {
        self.bites_at_s
    }

    /// From refresh to reset, s.
    pub fn timeout_s(&self) -> f64 {
        let divider = 4 << self.prescaler.min(6);
        f64::from(divider) * f64::from(self.reload + 1) / LSI_HZ
    }

    /// Reads a register.
    pub fn read(&self, offset: u32, now_s: f64) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => 0,
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c => (0..3).filter(|&k| now_s < self.updated_at_s[k]).map(|k| 1 << k).sum(),
            0x10 => self.window,
            _ => return Err(unmodelled(NAME, offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now_s: f64) -> Result<(), Complaint> {
        match offset {
            0x00 => self.key(value & 0xffff, now_s),
            0x04 => self.update(0, now_s, |this| this.prescaler = value & 7),
            0x08 => self.update(1, now_s, |this| this.reload = value & 0xfff),
            0x10 => {
                if value & 0xfff != 0xfff {
                    return Err(wrong(NAME, "WINR: the window is not modelled"));
                }
                self.update(2, now_s, |this| this.window = value & 0xfff)?;
                self.refresh(now_s);
                Ok(())
            }
            _ => Err(unmodelled(NAME, offset)),
        }
    }

    fn key(&mut self, key: u32, now_s: f64) -> Result<(), Complaint> {
        self.unlocked = key == 0x5555;
        match key {
            0x5555 => {}
            0xaaaa => self.refresh(now_s),
            0xcccc => {
                self.bites_at_s = Some(now_s + self.timeout_s());
                self.refreshed_s = Some(now_s);
            }
            _ => return Err(wrong(NAME, format!("KR: {key:#06x} is no key"))),
        }
        Ok(())
    }

    fn refresh(&mut self, now_s: f64) {
        if self.bites_at_s.is_some() {
            self.bites_at_s = Some(now_s + self.timeout_s());
            if let Some(before_s) = self.refreshed_s.replace(now_s) {
                self.interval_s.add(now_s - before_s);
            }
        }
    }

    fn update(&mut self, which: usize, now_s: f64, set: impl FnOnce(&mut Self)) -> Result<(), Complaint> {
        if !self.unlocked {
            return Err(wrong(NAME, "a register is written without the key 0x5555 (41.3.4)"));
        }
        if now_s < self.updated_at_s[which] {
            return Err(wrong(NAME, "a register is written while its last update is under way (41.4.4)"));
        }
        set(self);
        self.updated_at_s[which] = now_s + UPDATE_S;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_bites_after_what_pr_and_rlr_say() {
        let mut watchdog = Iwdg::default();
        watchdog.write(0x00, 0xcccc, 0.0).unwrap();
        // As reset leaves it: 4 · 4096 / 32 kHz.
        assert_eq!(watchdog.bites_at_s(), Some(0.512));
        watchdog.write(0x00, 0x5555, 0.0).unwrap();
        watchdog.write(0x04, 1, 0.0).unwrap();
        watchdog.write(0x08, 799, 0.0).unwrap();
        assert_eq!(watchdog.read(0x0c, 1e-4).unwrap(), 0b11);
        assert_eq!(watchdog.read(0x0c, 1.6e-4).unwrap(), 0);
        watchdog.write(0x00, 0xaaaa, 0.01).unwrap();
        // 8 · 800 / 32 kHz = 200 ms.
        assert!((watchdog.bites_at_s().unwrap() - 0.21).abs() < 1e-12);
        assert_eq!((watchdog.interval_s.min, watchdog.interval_s.count), (0.01, 1));
    }

    #[test]
    fn registers_are_locked() {
        let mut watchdog = Iwdg::default();
        assert!(watchdog.write(0x04, 1, 0.0).is_err());
        watchdog.write(0x00, 0x5555, 0.0).unwrap();
        watchdog.write(0x00, 0xaaaa, 0.0).unwrap();
        assert!(watchdog.write(0x04, 1, 0.0).is_err(), "another key locks again");
        assert!(!watchdog.runs());
    }
}
