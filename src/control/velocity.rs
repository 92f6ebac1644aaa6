//! Speed control: a PI that asks for a current, with the torque of the acceleration fed forward.
//!
//! With the gain `ω J / K_t` the rotor's inertia makes the loop an integrator of bandwidth ω; the integral acts below
//! ω/4, which damps the loop with a ratio of 1. Where the current is limited, the integrator is corrected by what the
//! limit took off.

use crate::control::{Motor, Scale, Window, fixed};
use crate::math::{clamp, high};
use core::f32::consts::TAU;

/// Gains of the speed controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gains {
    /// Current per speed in 2⁻³².
    proportional: i32,
    /// Current per speed and step of the loop in 2⁻³².
    integral: i32,
    /// Anti-windup by back-calculation: share of the current that the limit took off, in 2⁻³².
    back: i32,
    /// Current per acceleration in 2⁻²⁴.
    inertia: i32,
    /// Largest error of the speed that counts: where the proportional current is four full scales.
    far: i32,
}

/// The full scale of the current, in 2⁻⁷ of it.
const FULL_SCALE: i32 = 1 << 7;

impl Gains {
    /// For a bandwidth in hertz, and a loop that is computed `loop_hz` times a second. Of a rotor so heavy that the least
    /// acceleration takes more than 0.4 % of the full scale, a part is fed forward, and the integrator does the rest.
    ///
    /// # Errors
    /// Beyond the range of the integers: the largest bandwidth at this inertia.
    pub fn new(motor: &Motor, bandwidth_hz: f32, loop_hz: f32, scale: &Scale) -> Result<Self, f32> {
        let omega = TAU * bandwidth_hz;
        // Units of current for a change of speed by one unit in a second.
        let inertia =
            motor.inertia_kgm2 / motor.torque_constant(scale.pole_pairs) * scale.per_ampere() / scale.per_radian_s();
        let share = omega / 4.0 / loop_hz;
        // What fits the integers, and a little less.
        let too_fast = 0.999 * 0.5 / (inertia * TAU);
        Ok(Self {
            inertia: fixed((inertia * loop_hz).min(127.9), 24).ok_or(too_fast)?,
            proportional: fixed(inertia * omega, 32).ok_or(too_fast)?,
            integral: fixed(inertia * omega * share.min(1.0), 32).ok_or(too_fast)?.max(1),
            back: fixed(share.min(0.49), 32).ok_or(too_fast)?,
            far: (131_072.0 / (inertia * omega)).min(536_870_912.0) as i32,
        })
    }

    /// Those for half of the inertia.
    #[must_use]
    pub(crate) const fn halved(&self) -> Self {
        Self {
            proportional: self.proportional / 2,
            integral: self.integral / 2,
            inertia: self.inertia / 2,
            far: if self.far < 1 << 28 { 2 * self.far } else { 1 << 29 },
            ..*self
        }
    }

    /// The current that accelerates by `acceleration`, in units of speed a step of the loop; up to ± the full scale. The
    /// integrator makes up for what is beyond the limit of the current, and would brake when so much of it ends.
    #[inline(always)]
    pub const fn feed_forward(&self, acceleration: i32) -> i32 {
        let wide = acceleration as i64 * self.inertia as i64;
        // Of what is beyond, the upper half says enough.
        let upper = (wide >> 32) as i32;
        let clamped = clamp(upper, FULL_SCALE);
        if clamped == upper { (wide >> 24) as i32 } else { clamped << 8 }
    }

    /// A quarter of the current that changes the speed so much within 512 steps.
    #[inline(always)]
    pub(crate) const fn quarter_of_impulse(&self, change: i32) -> i32 {
        high(change, self.inertia)
    }

    /// Current per speed, in 2⁻³².
    pub const fn proportional(&self) -> i32 {
        self.proportional
    }
}

/// What the speed controller makes of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Current, whatever the window.
    pub asked: i32,
    /// … within it.
    pub current: i32,
}

/// The speed controller's integrator: a current in 2⁻³².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Integrator(i64);

impl Integrator {
    /// Nothing.
    pub const ZERO: Self = Self(0);

    /// One that asks for a current without an error of the speed.
    pub const fn holding(current: i32) -> Self {
        Self((current as i64) << 32)
    }

    /// One that asks for a current at an error of the speed.
    pub const fn asking(gains: &Gains, current: i32, error: i32) -> Self {
        let proportional = clamp(error, gains.far) as i64 * gains.proportional as i64;
        Self(((current as i64) << 32).wrapping_sub(proportional))
    }

    /// One step: the current that makes the `measured` speed the `reference` one, beside what is fed `forward`;
    /// within the window. Speeds are up to 2²⁹, currents up to 2¹⁵.
    #[inline(always)]
    pub const fn step(
        &mut self,
        gains: &Gains,
        reference: i32,
        measured: i32,
        forward: i32,
        window: &Window,
    ) -> Request {
        let error = clamp(reference.wrapping_sub(measured), gains.far);
        let asked = ((self.0 + error as i64 * gains.proportional as i64) >> 32) as i32 + forward;
        let current = window.cut(asked);
        // What is taken back is more than what is added, so it needs no limit of its own.
        self.0 += error as i64 * gains.integral as i64 + (current - asked) as i64 * gains.back as i64;
        Request { asked, current }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOTOR: Motor =
        Motor { resistance_ohm: 3.75, inductance_h: 0.36e-3, saliency: 1.0, flux_linkage_wb: 5e-3, inertia_kgm2: 1e-5 };
    const SCALE: Scale = Scale { step_hz: 40e3, amperes: 8.25, volts: 36.3, pole_pairs: 4.0 };

    /// An inertia without friction: largest and last speed in units after a step to 100 rad/s against a load.
    fn turn(most_a: f32, load_nm: f32) -> (f32, f32) {
        let gains = Gains::new(&MOTOR, 50.0, SCALE.step_hz, &SCALE).unwrap();
        let mut integrator = Integrator::default();
        let (mut speed, mut largest) = (0.0_f32, 0.0_f32);
        let window = Window::symmetric((most_a * SCALE.per_ampere()) as i32);
        for _ in 0..20_000 {
            let measured = (speed * SCALE.per_radian_s()) as i32;
            let reference = (100.0 * SCALE.per_radian_s()) as i32;
            let current = integrator.step(&gains, reference, measured, 0, &window).current as f32 / SCALE.per_ampere();
            speed += (0.03 * current - load_nm) / 1e-5 * 25e-6;
            largest = largest.max(speed);
        }
        (largest, speed)
    }

    #[test]
    fn reaches_the_speed_against_a_load() {
        let (largest, last) = turn(6.0, 0.02);
        assert!((last - 100.0).abs() < 0.1 && largest < 116.0, "{largest} {last}");
    }

    #[test]
    fn a_limited_current_does_not_wind_up() {
        let (largest, last) = turn(0.2, 0.0);
        assert!((last - 100.0).abs() < 0.1 && largest < 110.0, "{largest} {last}");
    }

    /// After other gains it asks for the same, but for a rounding.
    #[test]
    fn goes_on_with_the_current_whatever_the_gains() {
        let window = Window::symmetric(20_000);
        for (bandwidth, error) in [(0.5, 3_000_000), (60.0, -40_000), (250.0, 7), (250.0, i32::MAX), (10.0, i32::MIN)] {
            let gains = Gains::new(&MOTOR, bandwidth, SCALE.step_hz / 8.0, &SCALE).unwrap();
            for current in [-30_000, -1, 0, 12_345] {
                let asked = Integrator::asking(&gains, current, error).step(&gains, error, 0, 0, &window).asked;
                assert!((asked - current).abs() <= 1, "{bandwidth} Hz, {error}: {asked} instead of {current}");
            }
        }
    }

    #[test]
    fn the_acceleration_is_fed_forward() {
        let gains = Gains::new(&MOTOR, 50.0, SCALE.step_hz, &SCALE).unwrap();
        // 2000 rad/s² take 20 mN·m: 0.667 A.
        let acceleration = (2000.0 * SCALE.per_radian_s() / SCALE.step_hz) as i32;
        let current = gains.feed_forward(acceleration) as f32 / SCALE.per_ampere();
        assert!((current - 0.6667).abs() < 1e-3, "{current}");
    }

    #[test]
    fn halved_gains_are_those_for_half_of_the_inertia() {
        for inertia_kgm2 in [1e-6, 1e-5, 5e-4] {
            let [whole, half] = [1.0, 0.5].map(|share| {
                let motor = Motor { inertia_kgm2: share * inertia_kgm2, ..MOTOR };
                Gains::new(&motor, 50.0, SCALE.step_hz, &SCALE).unwrap()
            });
            let found = whole.halved();
            assert!((found.proportional - half.proportional).abs() <= 1, "{found:?} {half:?}");
            assert!((found.integral - half.integral).abs() <= 1 && (found.inertia - half.inertia).abs() <= 1);
            assert!((found.far - half.far).abs() <= 2 && found.back == half.back, "{found:?} {half:?}");
        }
    }

    /// What heavy rotors are asked for by a ramp that they cannot follow drives them on, all the way to the speed.
    #[test]
    fn a_feed_forward_beyond_the_limit_never_turns_the_current_round() {
        let window = Window::symmetric((3.0 * SCALE.per_ampere()) as i32);
        for (inertia, acceleration, bandwidth) in [
            (1e-4, 5e4, 60.0),
            (1e-4, 2e4, 60.0),
            (5e-4, 5e3, 60.0),
            (1e-3, 5e3, 30.0),
            (1e-3, 1e4, 30.0),
            (1.5e-3, 1e6, 5.0),
        ] {
            let gains =
                Gains::new(&Motor { inertia_kgm2: inertia, ..MOTOR }, bandwidth, SCALE.step_hz, &SCALE).unwrap();
            let mut integrator = Integrator::default();
            let target = (450.0 * SCALE.per_radian_s()) as i32;
            let most = (acceleration * SCALE.per_radian_s() / SCALE.step_hz) as i32;
            let (mut speed, mut reference, mut largest) = (0.0_f32, 0, 0.0_f32);
            // Until it is there: 3 A make 90 mN·m.
            for step in 0..(1.3 * 450.0 * inertia / 0.09 * SCALE.step_hz) as u32 {
                let change = (target - reference).min(most);
                reference += change;
                let measured = (speed * SCALE.per_radian_s()) as i32;
                let forward = gains.feed_forward(change);
                assert!(forward >= 0, "{inertia} {acceleration}: {forward}");
                let current = integrator.step(&gains, reference, measured, forward, &window).current;
                assert!(current >= 0 || speed > 400.0, "{inertia} {acceleration} {bandwidth} {step}: {current}");
                speed += 0.03 * current as f32 / SCALE.per_ampere() / inertia / SCALE.step_hz;
                largest = largest.max(speed);
            }
            assert!((430.0..480.0).contains(&speed) && largest < 490.0, "{inertia} {acceleration}: {speed} {largest}");
        }
    }
}
