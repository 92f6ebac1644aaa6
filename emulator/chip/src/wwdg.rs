//! System window watchdog (RM0440, chapter 42): a 7-bit count down from APB1's clock, which resets the chip when it
//! falls below 0x40.

use crate::bits::{bit, field, unmodelled, wrong};
use bus::Complaint;
use measure::Range;

const NAME: &str = "WWDG";
/// Cycles of PCLK1 a count, before the division by WDGTB (42.3.4).
const PRESCALER: f64 = 4096.0;
/// T6: the count is not over.
const RUNS: u32 = 0x40;
const COUNT: u32 = 0x7f;

/// The peripheral. Its prescaler runs through, so what a refresh leaves is up to one count shorter than what is written.
#[derive(Clone, Debug)]
pub struct Wwdg {
    count: u32,
    /// When the count has begun that `count` stands at, s.
    since_s: f64,
    active: bool,
    window: u32,
    divider: u32,
    pclk_hz: f64,
    /// When it was refreshed last, and for how long, s.
    refreshed_s: Option<(f64, f64)>,
    /// Time between two refreshes as a share of the longest that was allowed.
    pub used: Range,
}

impl Wwdg {
    /// As reset leaves it: not started. `pclk_hz`: PCLK1.
    pub fn new(pclk_hz: f64, now_s: f64) -> Self {
        Self {
            count: COUNT,
            since_s: now_s,
            active: false,
            window: COUNT,
            divider: 0,
            pclk_hz,
            refreshed_s: None,
            used: Range::default(),
        }
    }

    /// By a reset of the chip.
    pub fn reset(&mut self, now_s: f64) {
        *self = Self { used: self.used, ..Self::new(self.pclk_hz, now_s) };
    }

    /// Another PCLK1. What is left of the present count is counted anew.
    pub fn set_clock(&mut self, pclk_hz: f64, now_s: f64) {
        if pclk_hz != self.pclk_hz {
            self.settle(now_s);
            (self.pclk_hz, self.since_s) = (pclk_hz, now_s);
        }
    }

    /// Whether it has been started.
    pub fn runs(&self) -> bool {
        self.active
    }

    /// When it resets the chip unless refreshed, s.
    pub fn bites_at_s(&self) -> Option<f64> {
        self.active.then(|| self.since_s + f64::from(self.count.saturating_sub(RUNS - 1)) * self.tick_s())
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now_s: f64) -> Result<u32, Complaint> {
        self.settle(now_s);
        Ok(match offset {
            0x00 => self.count | u32::from(self.active) << 7,
            0x04 => self.window | self.divider << 11,
            _ => return Err(unmodelled(NAME, offset)),
        })
    }

    /// Writes a register. A refresh that comes too early, or with a count that is over, bites at once.
    pub fn write(&mut self, offset: u32, value: u32, now_s: f64) -> Result<(), Complaint> {
        self.settle(now_s);
        match offset {
            0x00 => {
                let early = self.active && self.count > self.window;
                self.active |= bit(value, 7);
                self.count = if early { 0 } else { value & COUNT };
                let allowed_s = f64::from(self.count.saturating_sub(RUNS - 1)) * self.tick_s();
                if let Some((before_s, allowed_s)) = self.refreshed_s.replace((now_s, allowed_s)) {
                    self.used.add((now_s - before_s) / allowed_s);
                }
                Ok(())
            }
            0x04 => {
                let divider = field(value, 11, 3);
                if divider != self.divider {
                    (self.divider, self.since_s, self.refreshed_s) = (divider, now_s, None);
                }
                self.window = value & COUNT;
                if bit(value, 9) {
                    Err(wrong(NAME, "CFR: the early wake-up interrupt is not modelled"))
                } else {
                    Ok(())
                }
            }
            _ => Err(unmodelled(NAME, offset)),
        }
    }

    /// A count, s.
    fn tick_s(&self) -> f64 {
        PRESCALER * f64::from(1 << self.divider) / self.pclk_hz
    }

    fn settle(&mut self, now_s: f64) {
        let ticks = ((now_s - self.since_s) / self.tick_s()).floor();
        if ticks >= 1.0 {
            self.since_s += ticks * self.tick_s();
            self.count = (self.count.wrapping_sub(ticks as u32)) & COUNT;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PCLK: f64 = 85e6;
    const TICK_S: f64 = 4096.0 / PCLK;

    #[test]
    fn it_bites_when_t6_falls_within_a_count_of_what_was_written() {
        let mut watchdog = Wwdg::new(PCLK, 0.0);
        assert_eq!(watchdog.bites_at_s(), None);
        watchdog.write(0x00, 0xc9, 0.0).unwrap();
        assert!((watchdog.bites_at_s().unwrap() - 10.0 * TICK_S).abs() < 1e-12);
        // Refreshed in the middle of a count.
        watchdog.write(0x00, 0xc9, 2.5 * TICK_S).unwrap();
        assert!((watchdog.bites_at_s().unwrap() - 12.0 * TICK_S).abs() < 1e-12);
        assert_eq!(watchdog.read(0x00, 4.5 * TICK_S).unwrap(), 0xc7);
        assert!((watchdog.used.max - 0.25).abs() < 1e-9);
    }

    #[test]
    fn the_prescaler_may_be_changed_while_it_runs() {
        let mut watchdog = Wwdg::new(PCLK, 0.0);
        watchdog.write(0x00, 0xc9, 0.0).unwrap();
        watchdog.write(0x04, 0x7f | 7 << 11, TICK_S / 2.0).unwrap();
        let bites_s = watchdog.bites_at_s().unwrap();
        assert!((bites_s - (TICK_S / 2.0 + 10.0 * 128.0 * TICK_S)).abs() < 1e-9, "{bites_s}");
        assert_eq!(watchdog.read(0x04, TICK_S).unwrap(), 0x7f | 7 << 11);
        watchdog.set_clock(PCLK / 2.0, TICK_S);
        assert!(watchdog.bites_at_s().unwrap() > 0.12);
    }

    #[test]
    fn it_is_not_stopped_and_bites_at_once_where_a_refresh_is_wrong() {
        let mut watchdog = Wwdg::new(PCLK, 0.0);
        watchdog.write(0x00, 0xff, 0.0).unwrap();
        watchdog.write(0x00, 0x7f, 1e-6).unwrap();
        assert!(watchdog.runs());
        let mut over = watchdog.clone();
        over.write(0x00, 0xbf, 2e-6).unwrap();
        assert!(over.bites_at_s().unwrap() <= 2e-6);
        watchdog.write(0x04, 0x50, 2e-6).unwrap();
        watchdog.write(0x00, 0xff, 3e-6).unwrap();
        assert!(watchdog.bites_at_s().unwrap() <= 3e-6, "before the window");
        assert!(watchdog.write(0x04, 0x200, 3e-6).is_err(), "early wake-up");
    }
}
