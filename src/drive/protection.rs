//! What protects motor, bridge and supply, for a drive with current sensing; a file each danger.

#[cfg(not(feature = "no-chopper"))]
pub(super) mod chopper;
mod currents;
mod overload;
mod stall;
mod supply;
mod temperature;
mod timeout;

use super::{Idle, Sample};
use crate::control::Window;
use crate::control::config::Config;
use crate::control::weakening::Weakening;
use crate::fault::{Fault, Limits};
use currents::Currents;
use overload::Overload;
use stall::Stall;
use supply::Supply;
use temperature::Temperature;
pub use timeout::Timeout;

/// What a current along d takes from the largest along q: by a straight line instead of the circle of the largest current,
/// which it meets at d = 0 and at 0.866 of that current. Beyond, up to 15/16, the vector is up to 4.4 % too long.
#[inline(always)]
const fn beside(field: i32) -> i32 {
    (field * 37) >> 6
}

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
    /// Largest current of what is followed: of a position that is held, of a spring.
    pub most_of_demand: i32,
    /// Largest current that heat allows, in 2⁻¹⁵ of the full scale.
    most: i32,
    supply: Supply,
    /// The current against the magnets' field, of which the one along q gets what it leaves.
    pub weakening: Weakening,
}

impl Protection {
    /// No thresholds, and no current: for a drive without current sensing, and before the bridge is first on.
    // A constant would lie in the flash with all its zeros: 96 bytes.
    #[inline(always)]
    pub const fn none() -> Self {
        Self {
            currents: Currents::NONE,
            window: Window::ZERO,
            stall: Stall::NONE,
            timeout: Timeout::NONE,
            temperatures: [Temperature::NONE; 2],
            overload: Overload::POWER_UP,
            most_of_demand: i32::MAX,
            most: 0,
            supply: Supply::NONE,
            weakening: Weakening::NONE,
        }
    }

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
        self.timeout.restart(config, None);
        for place in 0..2 {
            self.temperatures[place].derate(config, sample, place);
        }
        self.overload.begin(config);
        self.overload.limit_by_winding(config);
        self.overload.limit_by_bridge(config);
        self.limit_by_heat();
        self.supply = Supply::NONE;
        self.weakening = Weakening::NONE;
        self.narrow_now(config);
    }

    /// The winding's rise as measured, as the square of the current that makes it, in 2⁻³⁰ of the full scale's.
    #[cfg(not(feature = "small"))]
    pub const fn measure_winding(&mut self, square: i32) {
        self.overload.measure_winding(square);
    }

    /// A part of the work against heat, of 16. `square` is that of the current's length.
    #[inline(always)]
    pub fn heat(&mut self, part: u32, square: impl Fn() -> i32, config: &Config, sample: &Sample) -> Option<Fault> {
        let (overload, [bridge, motor]) = (&mut self.overload, &mut self.temperatures);
        match part % 16 {
            0 | 8 => overload.count_winding(config, square()),
            4 | 12 => overload.count_bridge(config, square()),
            11 => overload.count_housing(config, square()),
            1 => return temperature::fault(config, sample, 0),
            9 => return temperature::fault(config, sample, 1),
            5 => bridge.derate(config, sample, 0),
            13 => motor.derate(config, sample, 1),
            3 => return overload.limit_by_winding(config),
            7 | 15 => return overload.limit_by_bridge(config),
            _ => self.limit_by_heat(),
        }
        None
    }

    /// The largest current that heat allows.
    #[inline(always)]
    fn limit_by_heat(&mut self) {
        let [bridge, motor] = self.temperatures.map(|temperature| temperature.most);
        self.most = bridge.min(motor).min(self.overload.most());
    }

    /// Takes up speed and bus voltage for what the supply takes back.
    #[inline(always)]
    pub fn take_up(&mut self, config: &Config, speed: i32, bus: i32, controls_field: bool) {
        self.supply.take_up(config, speed, bus, self.most >> 2, controls_field);
    }

    /// The current along d that burns what the supply does not take back, for a current along q that is `asked` for; in
    /// 2⁻²⁸ of the full scale.
    #[inline(always)]
    pub fn burn(&mut self, config: &Config, bus: i32, asked: i32, controls_field: bool) -> i32 {
        self.supply.burn(config, bus, asked, self.most >> 2, controls_field)
    }

    /// Whether a current along d burns something.
    #[inline(always)]
    pub const fn burns(&self) -> bool {
        self.supply.burns()
    }

    /// What the supply has to drive with, beside what the current along d takes.
    #[inline(always)]
    pub fn limit_driving(&mut self, config: &Config, bus: i32) {
        self.supply.limit_driving(config, bus, self.most >> 2, self.weakening.current() >> 15);
    }

    /// How much the magnets' field may be weakened at a back-EMF.
    #[inline(always)]
    pub fn limit_weakening(&mut self, config: &Config, induced: i32) {
        self.weakening.limit(&config.weakening, induced, self.most << 13);
    }

    /// What the bus, `left` below its end, has room for of a current, where the one along d is not controlled.
    pub fn room_for(&self, config: &Config, left: i32, current: i32, speed: i32, moves: bool) -> Option<i32> {
        self.supply.room_for(config, left, current, speed, moves)
    }

    /// What is left to brake with.
    #[inline(always)]
    pub fn limit_braking(&mut self, config: &Config, bus: i32) {
        self.supply.limit(config, bus, self.most >> 2);
    }

    /// The same as [`Self::narrow`] in one copy, where a command does it.
    #[inline(never)]
    pub fn narrow_now(&mut self, config: &Config) {
        self.narrow(config);
    }

    /// The window that is left by all that narrows it.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub fn narrow(&mut self, config: &Config) {
        let against_field = beside(self.weakening.current() >> 13);
        let most = (self.most - against_field).max(0);
        self.window = Window::symmetric(config.max_current - against_field);
        self.window.from_below(-most, Limits::HEAT);
        self.window.from_above(most, Limits::HEAT);
        self.window.from_below(-self.most_of_demand, Limits::NONE);
        self.window.from_above(self.most_of_demand, Limits::NONE);
        self.supply.narrow(&mut self.window);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commutation::svpwm::LONGEST;
    use crate::settings::{self, Settings};

    #[test]
    fn heat_that_comes_at_once_leaves_nothing_beside_a_current_against_the_field() {
        let control = settings::Control { field_weakening_a: 2.625, ..settings::Control::default() };
        let settings = Settings { control: Some(control), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let mut protection = Protection { most: config.max_current, ..Protection::none() };
        protection.most_of_demand = i32::MAX;
        protection.weakening.limit(&config.weakening, LONGEST, i32::MAX);
        for _ in 0..1000 {
            protection.weakening.step(&config.weakening, -protection.weakening.current(), -LONGEST);
        }
        let current = protection.weakening.current() >> 13;
        assert!((current as f32 / config.max_current as f32 - 0.875).abs() < 0.01, "{current}");
        protection.narrow(&config);
        assert!((0.4..0.6).contains(&(protection.window.highest as f32 / config.max_current as f32)));
        protection.most = 0;
        protection.narrow(&config);
        assert_eq!((protection.window.lowest, protection.window.highest), (0, 0));
    }
}
