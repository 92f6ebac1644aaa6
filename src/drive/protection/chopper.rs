//! The brake chopper: a resistor across the bus that takes what the supply does not take back.
//!
//! It is on from `chopper_v` on, until the bus voltage is a little below. How hot the resistor is follows from the time
//! that it was on: it may be on for `chopper_on_s` in one go, and for `chopper_share` of the time for ever. Beyond, it
//! stays off until it has cooled down altogether.

use crate::control::config::Chopper as Config;

/// Whether the resistor is on, and how hot it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chopper {
    on: bool,
    /// It was on for too long and has not cooled down yet.
    hot: bool,
    /// In the unit of its configuration.
    heat: i32,
}

impl Chopper {
    /// Off and cold.
    pub const OFF: Self = Self { on: false, hot: false, heat: 0 };

    /// Whether it is on.
    #[inline(always)]
    pub const fn is_on(&self) -> bool {
        self.on
    }

    /// Whether the resistor has to cool down.
    pub const fn is_hot(&self) -> bool {
        self.hot
    }

    /// Whether it is off, cold and not needed at a bus voltage, in 2⁻¹⁵ of its full scale: then there is nothing to
    /// decide.
    #[inline(always)]
    pub const fn idles(&self, config: &Config, bus: i32) -> bool {
        !self.on && self.heat == 0 && bus <= config.on
    }

    /// Decides by a bus voltage, in 2⁻¹⁵ of its full scale. False where the resistor is needed and has to cool down.
    pub fn decide(&mut self, config: &Config, bus: i32) -> bool {
        let needed = bus > if self.on { config.off } else { config.on };
        // For the time since the last decision.
        self.heat = (self.heat + if self.on { config.heats } else { -config.cools }).max(0);
        self.hot = if self.hot { self.heat > 0 } else { self.heat > config.most };
        self.on = needed && !self.hot;
        self.on || !needed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::config::Config as Control;
    use crate::settings::{self, GuardSettings, Settings};

    const DECISIONS_HZ: f32 = 5000.0;

    fn config(chopper_v: f32, chopper_on_s: f32, chopper_share: f32) -> Control {
        let guard = GuardSettings { chopper_v, chopper_on_s, chopper_share, ..GuardSettings::default() };
        let control = settings::Control { guard, ..settings::Control::default() };
        let settings = Settings { control: Some(control), ..Settings::default() };
        settings.validate().unwrap().control.unwrap()
    }

    fn bus(volts: f32) -> i32 {
        (volts / settings::Control::default().bus_full_scale_v * 32_768.0) as i32
    }

    #[test]
    fn it_is_on_from_its_voltage_on_until_a_little_below() {
        let config = config(26.0, 1.0, 0.1);
        let mut chopper = Chopper::OFF;
        let steps =
            [(25.9, false), (26.1, true), (25.3, true), (25.1, false), (25.9, false), (26.1, true), (0.0, false)];
        for (volts, on) in steps {
            assert!(chopper.decide(&config.chopper, bus(volts)));
            assert_eq!(chopper.is_on(), on, "{volts}");
        }
    }

    #[test]
    fn without_one_nothing_switches_it_on() {
        let config = config(0.0, 1.0, 0.1);
        let mut chopper = Chopper { on: true, ..Chopper::OFF };
        for bus in [i32::MAX, 0, 65_535, i32::MAX] {
            assert!(chopper.decide(&config.chopper, bus));
            assert!(!chopper.is_on() && !chopper.is_hot());
        }
    }

    /// Seconds on, from cold, until it has to cool down at a voltage that never falls, and seconds until it goes on again.
    fn times(config: &Control) -> (f32, f32) {
        let mut chopper = Chopper::OFF;
        let until = |chopper: &mut Chopper, on: bool| {
            let mut decisions = 0;
            while chopper.decide(&config.chopper, i32::MAX - 1) == on {
                decisions += 1;
                assert!(decisions < 1_000_000_000);
            }
            decisions as f32 / DECISIONS_HZ
        };
        (until(&mut chopper, true), until(&mut chopper, false))
    }

    #[test]
    fn a_resistor_that_is_needed_for_too_long_cools_down_first() {
        for (on_s, share) in [(0.5, 0.1), (0.01, 0.5), (2.0, 0.02), (60.0, 0.1)] {
            let (on, off) = times(&config(26.0, on_s, share));
            assert!((on / on_s - 1.0).abs() < 0.05, "{on} of {on_s}");
            // What it is on in the long run is its share.
            assert!(on / (on + off) <= 1.01 * share && on / (on + off) > 0.9 * share, "{on} of {on} + {off}");
        }
    }

    #[test]
    fn within_its_share_it_never_has_to_cool_down() {
        let config = config(26.0, 0.1, 0.2);
        let mut chopper = Chopper::OFF;
        for k in 0..1_000_000 {
            assert!(chopper.decide(&config.chopper, if k % 100 < 19 { bus(27.0) } else { bus(24.0) }));
        }
        // One that may be on for ever.
        let config = self::config(26.0, 0.01, 1.0);
        (0..1_000_000).for_each(|_| assert!(chopper.decide(&config.chopper, bus(27.0)) && chopper.is_on()));
    }

    #[test]
    fn the_largest_heat_of_all_settings_is_within_its_integer() {
        let guard =
            GuardSettings { chopper_v: 26.0, chopper_on_s: 60.0, chopper_share: 0.01, ..GuardSettings::default() };
        let control = settings::Control { guard, ..settings::Control::default() };
        let scale = crate::control::Scale { step_hz: 200e3, amperes: 8.25, volts: 36.3, pole_pairs: 4.0 };
        let config = Config::new(&control, 25e3, &scale);
        assert!(config.most > 1_500_000_000 && config.most.checked_add(config.heats).is_some());
        assert!(config.cools > 0);
    }
}
