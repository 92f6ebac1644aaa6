//! Angle, speed and turns from the angles of successive samples.
//!
//! Turns are counted on the measured angle: the shorter way from sample to sample, the corrected jump detector of
//! Simpkins and Todorov, eq. (4). A jump beyond the plausible speed is refused and the rotor is taken to have gone on
//! as before. Angle and speed are smoothed by an α-β filter, the steady-state Kalman filter of a rotor whose speed
//! wanders: no lag at constant speed, damping ratio 0.71, natural frequency `f_sample · 2⁻ᵃ / 8.9` with `α = 2⁻ᵃ` and
//! `β = 2⁻²ᵃ⁻¹`. At acceleration A it lags by `A · 2²ᵃ⁺¹ / f²`.

use crate::angle::{ElectricalAngle, Position, TURN};
use crate::math::high;

/// How the tracker smooths and what it believes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// α and β in 2⁻³².
    gains: [i32; 2],
    largest_jump: u32,
    delay: i32,
}

impl Config {
    /// Smoothing exponents that make sense: below, noise passes; above, a motor outruns it.
    pub const SMOOTHING: core::ops::RangeInclusive<u32> = 2..=10;

    /// Memory for one.
    pub(crate) const BLANK: Self = Self { gains: [0; 2], largest_jump: 0, delay: 0 };

    /// A tracker with `α = 2^−smoothing`, which refuses jumps of more than `largest_jump` between two samples and
    /// predicts over `delay` samples (0 to 16, in steps of 1/256).
    ///
    /// `None` when the smoothing is not in [`Self::SMOOTHING`], the jump not above zero and below half a turn, or the
    /// delay out of range.
    pub fn new(smoothing: u32, largest_jump: ElectricalAngle, delay: f32) -> Option<Self> {
        let valid = Self::SMOOTHING.contains(&smoothing) && largest_jump.to_bits() > 0 && (0.0..=16.0).contains(&delay);
        valid.then(|| Self {
            gains: [1 << (32 - smoothing), 1 << (31 - 2 * smoothing)],
            largest_jump: largest_jump.to_bits() as u32,
            delay: crate::float::nearest(delay * 256.0),
        })
    }

    /// What the smoothed angle lags by at a constant acceleration, in samples².
    pub(crate) fn lag(&self) -> f32 {
        TURN / self.gains[1] as f32
    }

    /// What the smoothed speed lags by, in samples.
    pub(crate) fn speed_lag(&self) -> f32 {
        self.gains[0] as f32 / self.gains[1] as f32
    }

    /// The share of the noise of single samples that the smoothed angle has at constant speed.
    pub fn noise_gain(&self) -> f32 {
        let [alpha, beta] = self.gains.map(|gain| gain as f32 / TURN);
        crate::float::root(
            (2.0 * alpha * alpha + 2.0 * beta - 3.0 * alpha * beta) / (alpha * (4.0 - 2.0 * alpha - beta)),
        )
    }

    /// The smoothing exponent whose natural frequency is nearest to `bandwidth_hz`, within [`Self::SMOOTHING`].
    pub fn smoothing_for(bandwidth_hz: f32, sample_hz: f32) -> u32 {
        // To the nearest: rounded down after half an octave more.
        let exponent = crate::float::exponent(core::f32::consts::SQRT_2 * sample_hz / (8.886 * bandwidth_hz));
        exponent.clamp(*Self::SMOOTHING.start() as i32, *Self::SMOOTHING.end() as i32) as u32
    }
}

/// What the tracker knows. It starts to track with the first angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tracker {
    position: Position,
    angle: ElectricalAngle,
    speed: i32,
}

/// The angle moved farther within one sample than the motor can turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Jump;

impl Tracker {
    /// A rotor at rest at an angle.
    pub const fn at(angle: ElectricalAngle) -> Self {
        Self { position: Position::from_angle(angle), angle, speed: 0 }
    }

    /// Takes up the next measured angle.
    ///
    /// # Errors
    /// [`Jump`]; the tracker then has gone on at its speed, as [`Self::coast`].
    #[inline(always)]
    pub const fn step(&mut self, config: &Config, measured: ElectricalAngle) -> Result<(), Jump> {
        if self.follow(config, measured) {
            return Ok(());
        }
        self.coast();
        Err(Jump)
    }

    /// Takes up the next measured angle, if it is plausible; otherwise nothing changes.
    #[inline(always)]
    pub const fn follow(&mut self, config: &Config, measured: ElectricalAngle) -> bool {
        let last = self.position.to_bits();
        let jump = measured.to_bits().wrapping_sub(last as i32);
        if jump.wrapping_add(config.largest_jump as i32) as u32 > 2 * config.largest_jump {
            return false;
        }
        self.position = Position::from_bits(last.wrapping_add(jump as i64));
        let predicted = self.angle.to_bits().wrapping_add(self.speed);
        let error = measured.to_bits().wrapping_sub(predicted);
        let [alpha, beta] = config.gains;
        self.angle = ElectricalAngle::from_bits(predicted.wrapping_add(high(error, alpha)));
        self.speed = self.speed.wrapping_add(high(error, beta));
        true
    }

    /// Goes on at the present speed, for want of a measurement.
    #[inline(always)]
    pub const fn coast(&mut self) {
        self.position = Position::from_bits(self.position.to_bits().wrapping_add(self.speed as i64));
        self.angle = ElectricalAngle::from_bits(self.angle.to_bits().wrapping_add(self.speed));
    }

    /// Moves to a position, however far, and goes on at the present speed.
    pub(crate) const fn put_at(&mut self, position: Position) {
        self.position = position;
        self.angle = position.angle();
    }

    /// Counts on from a position farther by whole turns, in 2⁻³².
    pub(crate) const fn count_on(&mut self, turns: i64) {
        self.position = Position::from_bits(self.position.to_bits().wrapping_add(turns));
    }

    /// The smoothed angle at the last sample.
    pub const fn angle(&self) -> ElectricalAngle {
        self.angle
    }

    /// The smoothed angle, extrapolated over the configured delay.
    #[inline(always)]
    pub const fn predicted(&self, config: &Config) -> ElectricalAngle {
        let ahead = (self.speed >> 8).wrapping_mul(config.delay);
        ElectricalAngle::from_bits(self.angle.to_bits().wrapping_add(ahead))
    }

    /// The measured position with its turns.
    pub const fn position(&self) -> Position {
        self.position
    }

    /// The smoothed position with its turns.
    #[inline(always)]
    pub const fn smoothed(&self) -> Position {
        self.position.advance_to(self.angle)
    }

    /// The smoothed speed in 2⁻³² electrical turns a sample.
    pub const fn speed(&self) -> i32 {
        self.speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    extern crate std;

    const SAMPLE_HZ: f64 = 40_000.0;
    const TURN: f64 = crate::angle::TURN as f64;

    fn config() -> Config {
        Config::new(4, ElectricalAngle::from_degrees(60.0), 1.5).unwrap()
    }

    fn angle(turns: f64) -> ElectricalAngle {
        ElectricalAngle::from_bits((turns * TURN) as i64 as i32)
    }

    #[test]
    fn constant_speed_is_followed_without_lag_and_predicted() {
        for hz in [-2000.0, -3.0, 0.5, 400.0] {
            let mut tracker = Tracker::at(ElectricalAngle::ZERO);
            for k in 0..4000 {
                tracker.step(&config(), angle(hz / SAMPLE_HZ * f64::from(k))).unwrap();
            }
            let lag = tracker.angle() - angle(hz / SAMPLE_HZ * 3999.0);
            let ahead = tracker.predicted(&config()) - angle(hz / SAMPLE_HZ * 4000.5);
            let speed = f64::from(tracker.speed()) / TURN * SAMPLE_HZ;
            assert!(lag.to_degrees().abs() < 1e-3, "{hz} {lag}");
            assert!(ahead.to_degrees().abs() < 1e-3, "{hz} {ahead}");
            assert!((speed - hz).abs() < 0.01, "{hz} {speed}");
        }
    }

    #[test]
    fn acceleration_lags_by_the_documented_angle() {
        let acceleration = 20_000.0 / SAMPLE_HZ / SAMPLE_HZ;
        let mut tracker = Tracker::at(ElectricalAngle::ZERO);
        let mut truth = 0.0;
        for k in 0..4000 {
            truth = 0.5 * acceleration * f64::from(k) * f64::from(k);
            tracker.step(&config(), angle(truth)).unwrap();
        }
        let lag = (angle(truth) - tracker.angle()).to_degrees();
        let documented = 360.0 * acceleration as f32 * 512.0;
        assert!((lag / documented - 1.0).abs() < 0.1, "{lag} {documented}");
    }

    #[test]
    fn a_move_keeps_speed_and_turns() {
        let mut tracker = Tracker::at(ElectricalAngle::ZERO);
        for k in 0..4000 {
            tracker.step(&config(), angle(0.01 * f64::from(k))).unwrap();
        }
        let speed = tracker.speed();
        tracker.put_at(Position::from_turns(40.2));
        assert_eq!((tracker.speed(), tracker.position().turns()), (speed, 40));
        assert_eq!(tracker.angle(), angle(40.2));
    }

    #[test]
    fn an_implausible_jump_is_refused_and_coasted_over() {
        let mut tracker = Tracker::at(ElectricalAngle::ZERO);
        for k in 0..4000 {
            tracker.step(&config(), angle(0.01 * f64::from(k))).unwrap();
        }
        assert_eq!(tracker.step(&config(), angle(0.01 * 4000.0 + 0.2)), Err(Jump));
        let error = tracker.position().to_turns() - 40.0;
        assert!(error.abs() < 1e-3, "{error}");
        assert_eq!(tracker.step(&config(), angle(0.01 * 4001.0)), Ok(()));
    }

    #[test]
    fn smoothing_reduces_white_noise_as_theory_says() {
        let mut random = Pcg64::seed_from_u64(3);
        let mut tracker = Tracker::at(ElectricalAngle::ZERO);
        let (mut square, mut input) = (0.0, 0.0);
        for _ in 0..200_000 {
            let noise = random.random_range(-1.0..1.0);
            tracker.step(&config(), angle(noise / 360.0)).unwrap();
            square += f64::from(tracker.angle().to_degrees()).powi(2);
            input += noise * noise;
        }
        // (2α² + 2β − 3αβ) / (α (4 − 2α − β)) of the power.
        let (alpha, beta) = (1.0_f64 / 16.0, 1.0 / 512.0);
        let theory = (2.0 * alpha * alpha + 2.0 * beta - 3.0 * alpha * beta) / (alpha * (4.0 - 2.0 * alpha - beta));
        assert!((square / input / theory - 1.0).abs() < 0.1, "{} {theory}", square / input);
    }

    #[test]
    fn refuses_settings_without_sense() {
        let jump = ElectricalAngle::from_degrees(60.0);
        assert_eq!(Config::new(0, jump, 1.5), None);
        assert_eq!(Config::new(11, jump, 1.5), None);
        assert_eq!(Config::new(4, ElectricalAngle::ZERO, 1.5), None);
        assert_eq!(Config::new(4, ElectricalAngle::HALF, 1.5), None);
        assert_eq!(Config::new(4, jump, f32::NAN), None);
        assert_eq!(Config::smoothing_for(281.0, 40_000.0), 4);
        assert_eq!(Config::smoothing_for(1e9, 40_000.0), 2);
        assert_eq!(Config::smoothing_for(0.0, 40_000.0), 10);
    }
}
