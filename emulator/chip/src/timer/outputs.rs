//! From references to output levels: dead time, polarity, off states (RM0440, 28.3.15, 28.3.16, 28.6.20 and table 289).

use bus::Cycle;

const NEVER: Cycle = Cycle::MAX;

/// Dead time of BDTR.DTG in periods of tDTS (28.6.20).
pub const fn dead_time_counts(dtg: u32) -> u32 {
    match dtg >> 5 & 7 {
        0..=3 => dtg & 0x7f,
        4 | 5 => (64 + (dtg & 0x3f)) * 2,
        6 => (32 + (dtg & 0x1f)) * 8,
        _ => (32 + (dtg & 0x1f)) * 16,
    }
}

/// Enables and polarities of one channel's pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Pair {
    /// CCxE, CCxNE.
    enabled: [bool; 2],
    /// CCxP, CCxNP.
    active_low: [bool; 2],
    /// OISx, OISxN.
    idle: [bool; 2],
}

/// Outputs of channels 1 to 3 with their complements.
#[derive(Clone, Debug)]
pub struct Outputs {
    pairs: [Pair; 3],
    moe: bool,
    off_state_idle: bool,
    off_state_run: bool,
    /// Dead time at the rising and the falling edge of the reference, cycles of HCLK.
    dead: [Cycle; 2],
    references: [bool; 3],
    /// When the reference changed last.
    changed_at: [Cycle; 3],
    moe_at: Cycle,
    /// Up to here, delayed edges have been dealt with.
    settled: Cycle,
    next: Cycle,
}

impl Default for Outputs {
    fn default() -> Self {
        Self {
            pairs: [Pair::default(); 3],
            moe: false,
            off_state_idle: false,
            off_state_run: false,
            dead: [0; 2],
            references: [false; 3],
            changed_at: [0; 3],
            moe_at: 0,
            settled: 0,
            next: NEVER,
        }
    }
}

impl Outputs {
    /// Takes over what CCER, CR2 and BDTR say; `dts` is tDTS in cycles of HCLK.
    pub fn configure(&mut self, ccer: u32, cr2: u32, bdtr: u32, dtr2: u32, dts: Cycle) {
        for (channel, pair) in self.pairs.iter_mut().enumerate() {
            let (enables, idles) = (ccer >> (4 * channel), cr2 >> (8 + 2 * channel));
            *pair = Pair {
                enabled: [enables & 1 != 0, enables & 4 != 0],
                active_low: [enables & 2 != 0, enables & 8 != 0],
                idle: [idles & 1 != 0, idles & 2 != 0],
            };
        }
        self.off_state_idle = bdtr >> 10 & 1 != 0;
        self.off_state_run = bdtr >> 11 & 1 != 0;
        let rising = Cycle::from(dead_time_counts(bdtr & 0xff)) * dts;
        let falling = if dtr2 >> 16 & 1 != 0 { Cycle::from(dead_time_counts(dtr2 & 0xff)) * dts } else { rising };
        self.dead = [rising, falling];
        self.schedule();
    }

    /// References of channels 1 to 3 from now on.
    pub fn set_references(&mut self, references: [bool; 3], now: Cycle) {
        for channel in 0..3 {
            if references[channel] != self.references[channel] {
                self.changed_at[channel] = now;
            }
        }
        self.references = references;
        self.settle(now);
    }

    /// MOE from now on.
    pub fn set_moe(&mut self, on: bool, now: Cycle) {
        self.moe = on;
        self.moe_at = now;
        self.settle(now);
    }

    /// Delayed edges up to now have been seen.
    pub fn settle(&mut self, now: Cycle) {
        self.settled = self.settled.max(now);
        self.schedule();
    }

    /// When a delayed edge comes next.
    pub fn next(&self) -> Cycle {
        self.next
    }

    fn schedule(&mut self) {
        let mut next = NEVER;
        let mut due = |at: Cycle| {
            if at > self.settled && at < next {
                next = at;
            }
        };
        for channel in 0..3 {
            due(self.changed_at[channel] + self.dead[usize::from(!self.references[channel])]);
        }
        if !self.moe {
            due(self.moe_at + self.dead[0]);
        }
        self.next = next;
    }

    /// Level of output `side` (0: OCx, 1: OCxN) of channel 0 to 2; `None` where the timer does not drive it.
    pub fn level(&self, channel: usize, side: usize, now: Cycle) -> Option<bool> {
        let pair = &self.pairs[channel];
        if pair.enabled == [false; 2] {
            return None;
        }
        let inactive = pair.active_low[side];
        if !self.moe {
            return self.off_state_idle.then(|| {
                let both_active = (0..2).all(|k| pair.idle[k] != pair.active_low[k]);
                if now >= self.moe_at + self.dead[0] && !both_active { pair.idle[side] } else { inactive }
            });
        }
        if !pair.enabled[side] {
            return self.off_state_run.then_some(inactive);
        }
        let reference = self.references[channel];
        if !pair.enabled[1 - side] {
            // Alone, neither complemented nor delayed.
            return Some(reference ^ inactive);
        }
        let waited = now >= self.changed_at[channel] + self.dead[usize::from(!reference)];
        let active = waited && reference == (side == 0);
        Some(active ^ inactive)
    }

    /// Level that an output would have with MOE off for good.
    pub fn level_if_off(&self, channel: usize, side: usize) -> Option<bool> {
        let off = Self { moe: false, moe_at: 0, ..self.clone() };
        off.level(channel, side, NEVER)
    }

    /// OISx or OISxN, where the channel has an output enabled.
    pub fn idle(&self, channel: usize, side: usize) -> Option<bool> {
        let pair = &self.pairs[channel];
        (pair.enabled != [false; 2]).then_some(pair.idle[side])
    }

    /// The level that the timer drives for "on": CCxP, CCxNP.
    pub fn active_low(&self, channel: usize) -> [bool; 2] {
        self.pairs[channel].active_low
    }

    /// Dead time at the rising edge, cycles of HCLK.
    pub fn dead_time(&self) -> Cycle {
        self.dead[0]
    }

    /// Whether outputs are driven while MOE is off (OSSI).
    pub fn driven_when_off(&self) -> bool {
        self.off_state_idle
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_four_ranges_of_dtg() {
        for (dtg, counts) in
            [(0x00, 0), (0x7f, 127), (0x80, 128), (0xbf, 254), (0xc0, 256), (0xdf, 504), (0xe0, 512), (0xff, 1008)]
        {
            assert_eq!(dead_time_counts(dtg), counts, "{dtg:#x}");
        }
    }

    fn outputs(ccer: u32, cr2: u32, bdtr: u32) -> Outputs {
        let mut outputs = Outputs::default();
        outputs.configure(ccer, cr2, bdtr, 0, 1);
        outputs
    }

    fn pair(outputs: &Outputs, now: Cycle) -> [Option<bool>; 2] {
        [0, 1].map(|side| outputs.level(0, side, now))
    }

    #[test]
    fn each_edge_that_switches_on_comes_a_dead_time_late() {
        let mut outputs = outputs(0x5, 0, 0x8000 | 10);
        outputs.set_moe(true, 0);
        outputs.set_references([true, false, false], 100);
        assert_eq!(pair(&outputs, 100), [Some(false), Some(false)]);
        assert_eq!(outputs.next(), 110);
        assert_eq!(pair(&outputs, 110), [Some(true), Some(false)]);
        outputs.set_references([false; 3], 200);
        assert_eq!(pair(&outputs, 200), [Some(false), Some(false)]);
        assert_eq!(pair(&outputs, 210), [Some(false), Some(true)]);
    }

    #[test]
    fn a_pulse_shorter_than_the_dead_time_is_lost() {
        let mut outputs = outputs(0x5, 0, 0x8000 | 10);
        outputs.set_moe(true, 0);
        outputs.set_references([true, false, false], 100);
        outputs.set_references([false; 3], 108);
        for now in 100..118 {
            assert_eq!(pair(&outputs, now), [Some(false), Some(false)]);
        }
        assert_eq!(pair(&outputs, 118), [Some(false), Some(true)]);
    }

    #[test]
    fn the_table_of_output_controls() {
        // (MOE, OSSI, OSSR, CCxE, CCxNE) with CCxP = 0, CCxNP = 1, OISx = 0, OISxN = 1, the reference on.
        let cases = [
            ([1, 0, 0, 0, 0], [None, None]),
            ([1, 0, 0, 0, 1], [None, Some(false)]),
            ([1, 0, 0, 1, 0], [Some(true), None]),
            ([1, 0, 0, 1, 1], [Some(true), Some(true)]),
            ([1, 0, 1, 0, 1], [Some(false), Some(false)]),
            ([1, 0, 1, 1, 0], [Some(true), Some(true)]),
            ([0, 0, 0, 1, 1], [None, None]),
            ([0, 1, 0, 0, 0], [None, None]),
            ([0, 1, 0, 1, 1], [Some(false), Some(true)]),
        ];
        for ([moe, ossi, ossr, e, ne], expected) in cases {
            let mut outputs = outputs(e | ne << 2 | 8, 2 << 8, ossi << 10 | ossr << 11);
            outputs.set_moe(moe == 1, 0);
            outputs.set_references([true, false, false], 0);
            assert_eq!(pair(&outputs, 1000), expected, "MOE {moe} OSSI {ossi} OSSR {ossr} E {e} NE {ne}");
        }
    }

    #[test]
    fn moe_off_is_inactive_at_once_and_idle_after_the_dead_time() {
        // OISx high, active high: a pin that goes off at once and comes back a dead time later.
        let mut outputs = outputs(0x5, 1 << 8, 1 << 10 | 10);
        outputs.set_moe(true, 0);
        outputs.set_references([true, false, false], 0);
        assert_eq!(pair(&outputs, 50), [Some(true), Some(false)]);
        outputs.set_moe(false, 50);
        assert_eq!(pair(&outputs, 50), [Some(false), Some(false)]);
        assert_eq!(outputs.next(), 60);
        assert_eq!(pair(&outputs, 60), [Some(true), Some(false)]);
    }

    #[test]
    fn idle_states_that_are_both_active_are_not_taken() {
        let mut outputs = outputs(0x5, 3 << 8, 1 << 10);
        outputs.set_moe(false, 0);
        assert_eq!(pair(&outputs, 100), [Some(false), Some(false)]);
    }
}
