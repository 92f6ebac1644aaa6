//! Two counters of the core: SysTick (DDI 0403, B3.3) and the DWT's cycle counter (C1.8.8).

use bus::Cycle;

/// Counts down from RELOAD to 0 in cycles of the core, or of an external reference.
#[derive(Clone, Debug)]
pub struct SysTick {
    /// Core cycles in a cycle of the external reference.
    reference: u64,
    control: u32,
    reload: u32,
    /// When the counter is next loaded with RELOAD after having been 0.
    wrap: Cycle,
    /// Value while it stands still.
    held: u32,
    /// Reached 0 since it was last asked.
    flag: bool,
}

impl SysTick {
    pub fn new(reference: u64) -> Self {
        SysTick { reference, control: 0, reload: 0, wrap: 0, held: 0, flag: false }
    }

    fn is_on(&self) -> bool {
        self.control & 1 != 0 && self.reload != 0
    }

    /// Core cycles a count.
    fn divider(&self) -> u64 {
        if self.control & 4 != 0 { 1 } else { self.reference }
    }

    fn period(&self) -> u64 {
        u64::from(self.reload + 1) * self.divider()
    }

    /// Whether it reached 0 with its interrupt enabled since the last call, and when it next does.
    pub fn advance(&mut self, now: Cycle) -> (bool, Cycle) {
        if !self.is_on() {
            return (false, Cycle::MAX);
        }
        let mut reached = false;
        while self.wrap <= now {
            self.wrap += self.period();
            reached = true;
        }
        self.flag |= reached;
        (reached && self.control & 2 != 0, self.wrap)
    }

    pub fn current(&self, now: Cycle) -> u32 {
        if !self.is_on() {
            return self.held;
        }
        let left = self.wrap.saturating_sub(now);
        (left.div_ceil(self.divider()) as u32 % (self.reload + 1)) & 0xFF_FFFF
    }

    pub fn read_control(&mut self, now: Cycle) -> u32 {
        self.advance(now);
        self.control | u32::from(std::mem::take(&mut self.flag)) << 16
    }

    pub fn reload(&self) -> u32 {
        self.reload
    }

    pub fn write_control(&mut self, value: u32, now: Cycle) {
        let left = self.current(now);
        self.control = value & 7;
        // It starts with what it holds; 0 is followed by RELOAD.
        let counts = if left == 0 { u64::from(self.reload) + 1 } else { u64::from(left) };
        self.wrap = now + counts * self.divider();
        self.held = left;
    }

    pub fn write_reload(&mut self, value: u32, now: Cycle) {
        self.held = self.current(now);
        self.reload = value & 0xFF_FFFF;
        if self.is_on() && self.wrap <= now {
            self.wrap = now + self.period();
        }
    }

    /// A write to the counter clears it and the flag.
    pub fn clear(&mut self, now: Cycle) {
        (self.held, self.flag) = (0, false);
        self.wrap = now + self.period();
    }
}

/// CYCCNT. Stands still while the core sleeps.
#[derive(Clone, Debug, Default)]
pub struct CycleCounter {
    on: bool,
    /// What to add to the time, modulo 2³², to get the count; or the count itself while it is off.
    offset: u32,
}

impl CycleCounter {
    pub fn is_on(&self) -> bool {
        self.on
    }

    pub fn read(&self, now: Cycle) -> u32 {
        if self.on { (now as u32).wrapping_add(self.offset) } else { self.offset }
    }

    pub fn write(&mut self, value: u32, now: Cycle) {
        self.offset = if self.on { value.wrapping_sub(now as u32) } else { value };
    }

    pub fn switch(&mut self, on: bool, now: Cycle) {
        let count = self.read(now);
        self.on = on;
        self.write(count, now);
    }

    pub fn pause(&mut self, from: Cycle, to: Cycle) {
        if self.on {
            self.offset = self.offset.wrapping_sub((to - from) as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systick_comes_every_reload_plus_one_counts() {
        let mut tick = SysTick::new(8);
        tick.write_reload(99, 0);
        tick.clear(0);
        tick.write_control(7, 1000);
        assert_eq!(tick.advance(1099), (false, 1100));
        assert_eq!(tick.advance(1100), (true, 1200));
        assert_eq!(tick.current(1150), 50);
        assert_eq!(tick.read_control(1150) >> 16, 1);
        assert_eq!(tick.read_control(1150) >> 16, 0);
    }
}
