//! A swing that the control keeps up: a mass has been mounted since the settings were found, and with gains for a light
//! rotor, a heavy one swings about its place for ever, at the largest current.
//!
//! In such a swing the current goes to and fro, and its impulse from one reversal to the next changes the speed by less
//! than the inertia of the settings says. A load that comes or goes turns the current round once, and what a hand does to
//! the rotor is not what the current does.

use crate::control::config::Config;

/// The inertia counts as up to 2⁵ times that of the settings.
const HEAVIEST: u8 = 5;
/// So many reversals, one after the other, are a swing.
const SWING: u8 = 3;

/// The inertia.
pub(super) struct Inertia {
    /// How often the loops count with twice the inertia of the settings.
    pub doubled: u8,
    /// Reversals, one after the other, at which the rotor was heavier than that.
    reversals: u8,
    /// Sum of the currents since the last reversal, in 2⁻¹⁵ of the full scale.
    impulse: i32,
    /// Speed at the last reversal.
    from: i32,
}

impl Inertia {
    /// As in the settings.
    pub const NEW: Self = Self { doubled: 0, reversals: 0, impulse: 0, from: 0 };

    /// A way to another place begins. Moves to and fro against friction are no swing: one place has to be swung about.
    #[inline(always)]
    pub const fn begin_way(&mut self) {
        self.reversals = 0;
    }

    /// Looks at a current and a speed, 512 steps after the last time. A rotor that swings, more than two and two thirds
    /// times as heavy as it counts, counts as twice as heavy from now on.
    // So seldom that it need not lie in the fast memory.
    #[cold]
    #[inline(never)]
    pub fn look(&mut self, current: i32, speed: i32, config: &Config) {
        if (current ^ self.impulse) >= 0 || current.wrapping_abs() < config.max_current >> 2 {
            self.impulse = self.impulse.saturating_add(current);
            return;
        }
        let change = config.velocity.quarter_of_impulse(speed.wrapping_sub(self.from));
        let (impulse, change) =
            if self.impulse < 0 { (-(self.impulse >> 2), -change) } else { (self.impulse >> 2, change) };
        // A rotor that does not turn is no swing.
        let heavier = (impulse - (impulse >> 2)) >> 1 >> self.doubled > change && impulse >> 6 < change;
        self.reversals = if heavier { self.reversals + 1 } else { 0 };
        (self.impulse, self.from) = (current, speed);
        if self.reversals >= SWING && self.doubled < HEAVIEST {
            self.doubled += 1;
            self.reversals = SWING - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    /// A rotor that is turned to and fro, and what is found of it.
    struct Rotor {
        config: Config,
        inertia: Inertia,
        speed: f64,
        /// Change of the speed by the largest current from look to look, with the inertia of the settings.
        most: f64,
    }

    impl Rotor {
        fn new() -> Self {
            let settings = Settings { control: Some(Control::default()), ..Settings::default() };
            let config = settings.validate().unwrap().control.unwrap();
            let of_a_million = 4.0 * f64::from(config.velocity.quarter_of_impulse(1_000_000));
            let most = f64::from(config.max_current) / of_a_million * 1e6;
            Self { config, inertia: Inertia::NEW, speed: 0.0, most }
        }

        /// So many looks at a share of the largest current, and at a torque of another kind.
        fn turn(&mut self, looks: u32, share: f64, other: f64, times: f64) {
            for _ in 0..looks {
                let current = (share * f64::from(self.config.max_current)) as i32;
                self.inertia.look(current, self.speed as i32, &self.config);
                self.speed += (share + other) / times * self.most;
            }
        }

        /// What is found when it swings by a current, so many looks each way.
        fn swing(&mut self, times: f64, share: f64, looks: u32) -> u8 {
            for _ in 0..20 {
                self.turn(looks, share, 0.0, times);
                self.turn(looks, -share, 0.0, times);
            }
            self.inertia.doubled
        }
    }

    #[test]
    fn finds_how_often_the_inertia_is_doubled() {
        for (times, doubled) in [(0.2, 0), (1.0, 0), (2.5, 0), (4.0, 1), (8.0, 2), (16.0, 3), (32.0, 4), (60.0, 5)] {
            for (share, looks) in [(1.0, 2), (0.6, 3), (0.3, 8), (1.0, 100)] {
                let found = Rotor::new().swing(times, share, looks);
                assert_eq!(found, doubled, "{times} times, {share} of the current for {looks} looks");
            }
        }
    }

    /// Two reversals are none: a load that comes and goes, a move and its braking.
    #[test]
    fn a_swing_has_three_reversals() {
        let mut rotor = Rotor::new();
        for share in [1.0, -1.0, 1.0, -0.2, -0.2] {
            rotor.turn(5, share, 0.0, 12.0);
        }
        assert_eq!(rotor.inertia.doubled, 0);
        rotor.turn(1, -1.0, 0.0, 12.0);
        assert_eq!(rotor.inertia.doubled, 1);
    }

    /// Held against a torque that comes and goes, it hardly turns; a hand turns it against its current.
    #[test]
    fn what_others_do_to_a_rotor_is_no_swing() {
        for (share, other) in [(1.0, -1.0), (0.8, -0.79), (1.0, -1.5), (0.3, -3.0)] {
            let mut rotor = Rotor::new();
            for _ in 0..20 {
                rotor.turn(5, share, other, 1.0);
                rotor.turn(5, -share, -other, 1.0);
            }
            assert_eq!(rotor.inertia.doubled, 0, "{share} {other}");
        }
    }

    #[test]
    fn nothing_overflows() {
        let mut rotor = Rotor::new();
        for speed in [i32::MAX, i32::MIN, 0, 1 << 29, -1 << 29] {
            for current in [32_767, -32_767, 0, 32_767] {
                for _ in 0..100_000 {
                    rotor.inertia.look(current, speed, &rotor.config);
                }
                assert!(rotor.inertia.doubled <= HEAVIEST);
            }
        }
    }
}
