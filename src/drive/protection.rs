//! What protects motor, bridge and supply, for a drive with current sensing; a file each danger.

mod currents;
mod overload;
mod stall;
mod temperature;
mod timeout;

use super::{Idle, Sample};
use crate::control::Window;
use crate::control::config::Config;
use crate::fault::{Fault, Limits};
use currents::Currents;
use overload::Overload;
use stall::Stall;
use temperature::Temperature;
pub use timeout::Timeout;

/// What each danger needs to be found, and what is left to the current.
#[derive(Clone, Copy, Debug)]
pub(super) struct Protection {
    pub currents: Currents,
    /// What is left to the current along q at the moment.
    pub window: Window,
    pub stall: Stall,
    pub timeout: Timeout,
    temperatures: [Temperature; 2],
    overload: Overload,
}

impl Protection {
    /// No thresholds, and no current: for a drive without current sensing, and before the bridge is first on.
    pub const NONE: Self = Self {
        currents: Currents::NONE,
        window: Window::ZERO,
        stall: Stall::NONE,
        timeout: Timeout::NONE,
        temperatures: [Temperature::NONE; 2],
        overload: Overload::POWER_UP,
    };

    /// Clears the counts while the bridge is off. What is warm stays warm.
    pub fn rest(&mut self) {
        self.currents.rest();
        self.stall = Stall::NONE;
        self.timeout = Timeout::NONE;
    }

    /// What would be a fault at once if the bridge were switched on now. Changes nothing: the thresholds are made on the
    /// stack, where they stay.
    #[inline(never)]
    pub fn refusal(&self, config: &Config, zeros: &Idle, sample: &Sample) -> Option<Fault> {
        if !zeros.zeros_are_plausible(config) {
            return Some(Fault::CurrentOffset);
        }
        let mut currents = Currents::NONE;
        currents.set_zeros(config, zeros.zeros());
        if !currents.allow(sample) {
            return Some(currents.fault(sample));
        }
        let hot = (0..2).find_map(|place| temperature::fault(config, sample, place));
        hot.or_else(|| self.overload.refusal(config))
    }

    /// The bridge is to be switched on: nothing is counted yet, and the largest current is that of these temperatures.
    pub fn arm(&mut self, config: &Config, sample: &Sample) {
        self.rest();
        for place in 0..2 {
            self.temperatures[place].derate(config, sample, place);
        }
        self.overload.begin(config);
        self.overload.limit_by_winding(config);
        self.overload.limit_by_bridge(config);
        self.limit_by_heat(config);
    }

    /// A part of the work against heat, of 16. `square` is that of the current's length.
    #[inline(always)]
    pub fn heat(&mut self, part: u32, square: impl Fn() -> i32, config: &Config, sample: &Sample) -> Option<Fault> {
        let (overload, [bridge, motor]) = (&mut self.overload, &mut self.temperatures);
        match part % 16 {
            0 | 8 => overload.count_winding(config, square()),
            4 | 12 => overload.count_bridge(config, square()),
            2 => overload.count_housing(config, square()),
            1 => return temperature::fault(config, sample, 0),
            9 => return temperature::fault(config, sample, 1),
            5 => bridge.derate(config, sample, 0),
            13 => motor.derate(config, sample, 1),
            3 | 11 => return overload.limit_by_winding(config),
            7 | 15 => return overload.limit_by_bridge(config),
            _ => self.limit_by_heat(config),
        }
        None
    }

    /// The window that heat leaves.
    #[inline(always)]
    fn limit_by_heat(&mut self, config: &Config) {
        let [bridge, motor] = self.temperatures.map(|temperature| temperature.most);
        let most = bridge.min(motor).min(self.overload.most());
        let narrowed = Limits::NONE.set(Limits::HEAT, most < config.max_current);
        self.window = Window { narrowed, ..Window::symmetric(most) };
    }
}
