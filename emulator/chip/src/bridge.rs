//! Gate drivers and transistors: from the levels at the timer's pins to what conducts.

use crate::board::Driver;
use measure::Range;
use plant::Switch;

/// Gaps longer than this are no dead time but a bridge that was off, s.
const LONGEST_DEAD_TIME_S: f64 = 10e-6;
/// Sides.
pub const HIGH: usize = 0;
/// The other.
pub const LOW: usize = 1;

/// One leg.
#[derive(Clone, Debug)]
pub struct Leg {
    /// What the inputs ask for: high side, low side on.
    asked: [bool; 2],
    /// The input that went off last, and when.
    asked_off: Option<(usize, f64)>,
    gate: Switch,
    gate_off_s: [f64; 2],
    pending: Option<(Switch, f64)>,
    /// From low side off to high side on at the inputs, s.
    pub rising_s: Range,
    /// From high side off to low side on, s.
    pub falling_s: Range,
    /// Both transistors on, or both asked to be: how often, and when first, s.
    pub shoot_through: (u64, Option<f64>),
}

impl Default for Leg {
    fn default() -> Self {
        Self {
            asked: [false; 2],
            asked_off: None,
            gate: Switch::Neither,
            gate_off_s: [f64::NEG_INFINITY; 2],
            pending: None,
            rising_s: Range::default(),
            falling_s: Range::default(),
            shoot_through: (0, None),
        }
    }
}

impl Leg {
    fn ask(&mut self, asked: [bool; 2], driver: &Driver, now_s: f64) {
        if asked == self.asked {
            return;
        }
        for side in [HIGH, LOW] {
            if self.asked[side] && !asked[side] {
                self.asked_off = Some((side, now_s));
            }
        }
        for side in [HIGH, LOW] {
            if asked[side] && !self.asked[side] {
                self.measure(side, now_s);
            }
        }
        if asked == [true; 2] && self.asked != [true; 2] {
            self.shoots_through(now_s);
        }
        self.asked = asked;
        self.drive(driver, now_s);
    }

    fn measure(&mut self, side: usize, now_s: f64) {
        if let Some((other, off_s)) = self.asked_off.take()
            && other != side
            && now_s - off_s < LONGEST_DEAD_TIME_S
        {
            if side == HIGH { &mut self.rising_s } else { &mut self.falling_s }.add(now_s - off_s);
        }
    }

    fn shoots_through(&mut self, now_s: f64) {
        self.shoot_through.0 += 1;
        self.shoot_through.1.get_or_insert(now_s);
    }

    /// The driver refuses to switch both on.
    fn drive(&mut self, driver: &Driver, now_s: f64) {
        let target = match self.asked {
            [true, false] => Switch::High,
            [false, true] => Switch::Low,
            _ => Switch::Neither,
        };
        self.pending = None;
        if target == self.gate {
            return;
        }
        match self.gate {
            Switch::High => self.gate_off_s[HIGH] = now_s,
            Switch::Low => self.gate_off_s[LOW] = now_s,
            Switch::Neither => {}
        }
        self.gate = Switch::Neither;
        let earliest_s = match target {
            Switch::High => self.gate_off_s[LOW] + driver.own_dead_time_s,
            Switch::Low => self.gate_off_s[HIGH] + driver.own_dead_time_s,
            Switch::Neither => return,
        };
        self.pending = Some((target, earliest_s.max(now_s)));
        self.settle(driver, now_s);
    }

    fn settle(&mut self, driver: &Driver, now_s: f64) {
        let Some((target, at_s)) = self.pending else { return };
        if at_s > now_s {
            return;
        }
        self.pending = None;
        self.gate = target;
        let other_off_s = self.gate_off_s[if target == Switch::High { LOW } else { HIGH }];
        if at_s - other_off_s < driver.overlap_s {
            self.shoots_through(at_s);
        }
    }

    /// Shortest dead time seen at the inputs, s.
    pub fn shortest_s(&self) -> f64 {
        self.rising_s.min.min(self.falling_s.min)
    }
}

/// The three legs with their drivers.
#[derive(Clone, Debug)]
pub struct Bridge {
    driver: Driver,
    /// U, V, W.
    pub legs: [Leg; 3],
}

impl Bridge {
    /// All off.
    pub fn new(driver: Driver) -> Self {
        Self { driver, legs: Default::default() }
    }

    /// Whether a level at an input asks for its transistor; an input that floats is pulled to off inside the driver.
    pub fn asks(&self, side: usize, level: Option<bool>) -> bool {
        level.is_some_and(|level| level != (side == LOW && self.driver.low_inverted))
    }

    /// Levels at the inputs from now on.
    pub fn set_inputs(&mut self, levels: [[Option<bool>; 2]; 3], now_s: f64) {
        for leg in 0..3 {
            let asked = [HIGH, LOW].map(|side| self.asks(side, levels[leg][side]));
            self.legs[leg].ask(asked, &self.driver, now_s);
        }
    }

    /// When a driver's own dead time is over, s.
    pub fn next_s(&self) -> f64 {
        self.legs.iter().filter_map(|leg| leg.pending).fold(f64::INFINITY, |next, (_, at)| next.min(at))
    }

    /// Ends the drivers' own dead times up to now.
    pub fn settle(&mut self, now_s: f64) {
        for leg in &mut self.legs {
            leg.settle(&self.driver, now_s);
        }
    }

    /// What conducts.
    pub fn switches(&self) -> [Switch; 3] {
        [0, 1, 2].map(|leg| self.legs[leg].gate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn l6387() -> Driver {
        Driver { name: "L6387".into(), low_inverted: false, own_dead_time_s: 0.0, overlap_s: 60e-9, standby: None }
    }

    fn l6398() -> Driver {
        Driver { name: "L6398".into(), low_inverted: true, own_dead_time_s: 320e-9, ..l6387() }
    }

    fn inputs(high: bool, low: bool) -> [[Option<bool>; 2]; 3] {
        [[Some(high), Some(low)], [None; 2], [None; 2]]
    }

    #[test]
    fn dead_time_is_measured_at_the_inputs() {
        let mut bridge = Bridge::new(l6387());
        for (high, low, at_s) in [(false, true, 0.0), (false, false, 1e-3), (true, false, 1.0008e-3)] {
            bridge.set_inputs(inputs(high, low), at_s);
        }
        assert_eq!(bridge.switches()[0], Switch::High);
        assert!((bridge.legs[0].rising_s.min - 800e-9).abs() < 1e-15);
        assert_eq!(bridge.legs[0].falling_s.count, 0);
        assert_eq!(bridge.legs[0].shoot_through.0, 0);
    }

    #[test]
    fn without_dead_time_the_transistors_overlap() {
        let mut bridge = Bridge::new(l6387());
        bridge.set_inputs(inputs(false, true), 0.0);
        bridge.set_inputs(inputs(true, false), 1e-3);
        assert_eq!(bridge.legs[0].rising_s.min, 0.0);
        assert_eq!(bridge.legs[0].shoot_through, (1, Some(1e-3)));
    }

    #[test]
    fn the_l6398_has_a_dead_time_of_its_own_and_an_inverted_input() {
        let mut bridge = Bridge::new(l6398());
        bridge.set_inputs(inputs(false, false), 0.0);
        assert_eq!(bridge.switches()[0], Switch::Low, "low at LIN is on");
        bridge.set_inputs(inputs(true, true), 1e-3);
        assert_eq!(bridge.switches()[0], Switch::Neither);
        assert!((bridge.next_s() - 1.00032e-3).abs() < 1e-12);
        bridge.settle(1.00032e-3);
        assert_eq!(bridge.switches()[0], Switch::High);
        assert_eq!(bridge.legs[0].shoot_through.0, 0);
    }

    #[test]
    fn both_inputs_on_is_counted_and_nothing_conducts() {
        let mut bridge = Bridge::new(l6387());
        bridge.set_inputs(inputs(true, false), 0.0);
        bridge.set_inputs(inputs(true, true), 1e-3);
        assert_eq!(bridge.switches()[0], Switch::Neither);
        assert_eq!(bridge.legs[0].shoot_through, (1, Some(1e-3)));
        assert_eq!(bridge.switches()[1], Switch::Neither, "inputs that float are off");
    }
}
