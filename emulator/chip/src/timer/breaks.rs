//! MOE and the break inputs (RM0440, 28.3.16, 28.6.20, 28.6.26).

use super::{BIF, MoeEdge, Timer};
use bus::Cycle;

impl Timer {
    /// Sets or clears MOE and keeps its edges.
    pub(super) fn set_moe(&mut self, on: bool, at: Cycle, cause: Option<(usize, usize)>) {
        if on == self.moe() {
            return;
        }
        self.bdtr = self.bdtr & !(1 << 15) | u32::from(on) << 15;
        self.outputs.set_moe(on, at);
        self.moe_edges.push(MoeEdge { at, on, cause });
    }

    /// Levels of the sources of both break inputs: the pin (`None` where no pin is assigned) and comparators 1 to 7.
    /// BKF's filter is not modelled: a break acts at once. Returns whether pins may have changed.
    pub fn set_breaks(&mut self, sources: [[Option<bool>; 8]; 2], now: Cycle) -> bool {
        let mut changed = false;
        for (input, levels) in sources.iter().enumerate() {
            let active_high = self.bdtr >> [13, 25][input] & 1 != 0;
            let af = self.af[input];
            let active = |source: usize| {
                // BKINP, BKCMP1P to BKCMP4P (28.6.26).
                let inverted = source <= 4 && af >> (9 + source) & 1 != 0;
                af >> source & 1 != 0 && levels[source].is_some_and(|level| (level != inverted) == active_high)
            };
            let cause = (0..8).find(|&source| self.break_enabled(input) && active(source));
            self.breaks[input] = cause.is_some();
            if let Some(source) = cause {
                self.sr |= BIF << input;
                changed |= self.moe();
                self.set_moe(false, now, Some((input, source)));
            }
        }
        changed
    }

    /// Names of the sources that AF1 (`0`) or AF2 (`1`) lets through to an enabled break input.
    pub fn break_names(&self, input: usize) -> Vec<String> {
        let pin = ["TIM1_BKIN", "TIM1_BKIN2"][input];
        (0..8)
            .filter(|&source| self.break_enabled(input) && self.af[input] >> source & 1 != 0)
            .map(|source| if source == 0 { pin.into() } else { format!("COMP{source}") })
            .collect()
    }

    /// Whether a break input is enabled.
    pub fn break_enabled(&self, input: usize) -> bool {
        self.bdtr >> [12, 24][input] & 1 != 0
    }
}
