//! What current heats: the motor by a thermal model of its winding, the bridge by an I²t limit.
//!
//! Everything is counted as the mean square of the current vector's length, over the thermal time constants: in the
//! long run a constant current makes each its own square. The winding's rise over the housing and the housing's over
//! the surroundings are taken for half of the whole each, so the winding's temperature is the mean of both, and that of
//! the continuous current where it reaches its square.
//!
//! At power-up nothing is known: the housing is assumed to be as warm as the continuous current makes it and the winding
//! to be as warm as the housing; the bridge to be at half of its largest rise. From there the model knows, whatever the
//! drive does: neither disarming nor clearing a fault cools anything.
//!
//! Where the tasks measure the winding's temperature by its resistance, the hotter of the model and the measurement
//! counts. What was measured last cools as the housing does, whose time constant is the longest, until it is measured anew.

use crate::control::config::{Config, Heating};
use crate::fault::Fault;
use crate::math::clamp;

/// Mean squares and the largest currents that they allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overload {
    winding: Mean,
    housing: Mean,
    bridge: Mean,
    /// Rise of the winding as measured.
    #[cfg(not(feature = "small"))]
    measured: Mean,
    /// Whether the assumption about power-up has been made.
    begun: bool,
    /// By winding and by bridge, in 2⁻¹⁵ of the full scale.
    most: [i32; 2],
}

/// Mean square of the current in 2⁻⁶² of the full scale's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Mean(i64);

impl Mean {
    const fn of(square: i32) -> Self {
        Self((square as i64) << 32)
    }

    const fn square(self) -> i32 {
        (self.0 >> 32) as i32
    }

    #[inline(always)]
    const fn count(&mut self, square: i32, rate: i32) {
        self.0 += (square.wrapping_sub(self.square())) as i64 * rate as i64;
    }
}

impl Overload {
    /// Before the settings are known.
    pub const POWER_UP: Self = Self {
        winding: Mean(0),
        housing: Mean(0),
        bridge: Mean(0),
        #[cfg(not(feature = "small"))]
        measured: Mean(0),
        begun: false,
        most: [0; 2],
    };

    /// Counts a square of the current's length, in 2⁻³⁰ of the full scale's, for the winding.
    #[inline(always)]
    pub fn count_winding(&mut self, config: &Config, square: i32) {
        self.winding.count(square, config.overload.winding.rate);
    }

    /// … for the housing, and what was measured cools.
    #[inline(always)]
    pub fn count_housing(&mut self, config: &Config, square: i32) {
        self.housing.count(square, config.overload.housing_rate);
        #[cfg(not(feature = "small"))]
        self.measured.count(0, config.overload.housing_rate);
    }

    /// Takes up the winding's rise as measured, as the square of the current that makes it.
    #[cfg(not(feature = "small"))]
    pub const fn measure_winding(&mut self, square: i32) {
        self.measured = Mean::of(square);
    }

    /// … for the bridge.
    #[inline(always)]
    pub fn count_bridge(&mut self, config: &Config, square: i32) {
        self.bridge.count(square, config.overload.bridge.rate);
    }

    /// The first time, makes the assumption about power-up.
    pub fn begin(&mut self, config: &Config) {
        if !self.begun {
            self.begun = true;
            self.housing = Mean::of(config.overload.winding.square);
            self.bridge = Mean::of(config.overload.bridge.square / 2);
        }
    }

    /// Temperature rise of the winding, as the square of the current that makes it.
    #[inline(always)]
    fn rise(&self) -> i32 {
        // Each below 2³¹.
        let model = ((self.winding.0 >> 33) + (self.housing.0 >> 33)) as i32;
        #[cfg(not(feature = "small"))]
        let model = model.max(self.measured.square());
        model
    }

    /// The largest current for the winding, and whether it is too hot for any.
    #[inline(always)]
    pub fn limit_by_winding(&mut self, config: &Config) -> Option<Fault> {
        let (rise, heating) = (self.rise(), &config.overload.winding);
        self.most[0] = most(heating, rise, config.max_current);
        (rise > heating.fault).then_some(Fault::WindingHot)
    }

    /// The largest current for the bridge, and whether it is too hot for any.
    #[inline(always)]
    pub fn limit_by_bridge(&mut self, config: &Config) -> Option<Fault> {
        let (rise, heating) = (self.bridge.square(), &config.overload.bridge);
        self.most[1] = most(heating, rise, config.max_current);
        (rise > heating.fault).then_some(Fault::BridgeOverload)
    }

    /// What is still too hot to begin with: above what the continuous current makes, with a little room.
    pub fn refusal(&self, config: &Config) -> Option<Fault> {
        let hot = |rise: i32, heating: &Heating| rise > heating.square.saturating_add(heating.square >> 5);
        if hot(self.rise(), &config.overload.winding) {
            Some(Fault::WindingHot)
        } else if hot(self.bridge.square(), &config.overload.bridge) {
            Some(Fault::BridgeOverload)
        } else {
            None
        }
    }

    /// The largest current.
    #[inline(always)]
    pub fn most(&self) -> i32 {
        self.most[0].min(self.most[1])
    }
}

/// The continuous current where the rise is its own, more below, less above.
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
const fn most(heating: &Heating, rise: i32, max_current: i32) -> i32 {
    let room = (((heating.square - rise) as i64 * heating.slope as i64) >> 20) as i32;
    let most = clamp(room, max_current) + heating.current;
    if most < 0 {
        0
    } else if most > max_current {
        max_current
    } else {
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    #[test]
    fn what_is_assumed_at_power_up_is_assumed_once() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let mut overload = Overload::POWER_UP;
        overload.begin(&config);
        assert_eq!(overload.housing.square(), config.overload.winding.square);
        assert_eq!(overload.bridge.square(), config.overload.bridge.square / 2);
        // From there on the model knows: another arming neither cools nor heats.
        overload.count_bridge(&config, 1 << 30);
        let known = overload;
        overload.begin(&config);
        assert_eq!(overload, known);
    }

    #[test]
    fn what_is_a_little_too_hot_does_not_arm() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let warm = |square: i32, more: i32| Mean::of(square + square / 64 * more);
        // A sixty-fourth above what the continuous current makes is room, four are not.
        for (more, winding, bridge) in [(1, None, None), (4, Some(Fault::WindingHot), Some(Fault::BridgeOverload))] {
            let rise = warm(config.overload.winding.square, more);
            let of_winding = Overload { winding: rise, housing: rise, ..Overload::POWER_UP };
            assert_eq!(of_winding.refusal(&config), winding);
            let of_bridge = Overload { bridge: warm(config.overload.bridge.square, more), ..Overload::POWER_UP };
            assert_eq!(of_bridge.refusal(&config), bridge);
        }
    }
}
