//! Pulse-width modulation: counts, dead time, resolution, and the choice of the frequency.
//!
//! The timer counts up and down (centre-aligned), so one PWM period is twice `period` counts; the currents are sampled
//! in the valley, while the lower transistors conduct, and the ripple has twice the switching frequency.

use crate::float::{ceil, nearest, whole_u16};
use core::fmt;
use fixed::types::I1F15;

/// A voltage command as a fraction of what the bridge can do without over-modulation: the amplitude of the phase
/// voltages is `M · V_bus / 2`.
pub type Modulation = I1F15;

/// A fraction as a [`Modulation`], the nearest there is; zero for what is not a number.
#[inline(never)]
pub fn modulation(share: f32) -> Modulation {
    // −1 has a number, 1 has none: both ends are the same.
    Modulation::from_bits(crate::float::nearest(share * 32_768.0).clamp(-32_767, 32_767) as i16)
}

/// What is wrong with a PWM setting.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// The timer would need this many counts for half a period; it can have 16 to 65,535.
    Period(f32),
    /// The dead time takes this fraction of the period; at most a tenth is sensible.
    DeadTime(f32),
    /// Between the lower and the upper limit there is no room around one half.
    Limits {
        /// Lowest compare value.
        low: u16,
        /// Highest compare value.
        high: u16,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Period(counts) => {
                write!(
                    f,
                    "the PWM frequency needs {counts:.0} timer counts for half a period: 16 to 65535 are possible"
                )
            }
            Self::DeadTime(fraction) => {
                write!(f, "the dead time is {:.0} % of the PWM period: at most 10 % is allowed", 100.0 * fraction)
            }
            Self::Limits { low, high } => {
                write!(f, "compare values from {low} to {high} leave no room around one half")
            }
        }
    }
}

impl core::error::Error for Error {}

/// Timer counts for half a PWM period of a centre-aligned timer, its auto-reload value.
///
/// # Errors
/// [`Error::Period`] below 16 or above 65,535 counts, or for a frequency that is not positive and finite.
pub fn period_counts(timer_hz: f32, pwm_hz: f32) -> Result<u16, Error> {
    let counts = timer_hz / (2.0 * pwm_hz);
    match nearest(counts) {
        whole @ 16..=65_535 => Ok(whole as u16),
        _ => Err(Error::Period(counts)),
    }
}

/// Timer counts of at least a dead time, rounded up: a count too many costs a thousandth of the voltage, a count too
/// few a transistor.
///
/// # Errors
/// [`Error::DeadTime`] for more than a tenth of the PWM period, or a time that is negative or not a number.
pub fn dead_time_counts(timer_hz: f32, pwm_hz: f32, dead_time_s: f32) -> Result<u16, Error> {
    let fraction = dead_time_s * pwm_hz;
    if !(0.0..=0.1).contains(&fraction) {
        return Err(Error::DeadTime(fraction));
    }
    // A product a rounding error above a whole count means that count.
    Ok(whole_u16(ceil(dead_time_s * timer_hz * (1.0 - f32::EPSILON) - 1e-4)))
}

/// The largest compare value that leaves the lower transistors conducting for `window_s` in each valley, for sampling
/// their shunts, after a dead time. Both are subtracted once: half of the time before, half after the valley.
pub fn highest_compare(period: u16, timer_hz: f32, window_s: f32, dead_time_s: f32) -> u16 {
    let reserved = ceil((window_s + dead_time_s) * timer_hz / 2.0);
    whole_u16(f32::from(period) - reserved)
}

/// The range of compare values, and what a full command may be within it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    half: u16,
    largest: i32,
    low: u16,
    high: u16,
    top: u16,
}

impl Limits {
    /// Memory for some.
    pub(crate) const BLANK: Self = Self { half: 0, largest: 0, low: 0, high: 0, top: 0 };

    /// For a timer of `period` counts whose compare values must stay from `low` to `high`.
    ///
    /// # Errors
    /// [`Error::Limits`] when no vector fits.
    pub const fn new(period: u16, low: u16, high: u16) -> Result<Self, Error> {
        let half = period / 2;
        // The table's sines exceed one by 4e-5, the third phase by twice that; rounding adds up to two counts.
        let below = half as i32 - low as i32;
        let above = high as i32 - half as i32;
        let room = if below < above { below } else { above } - 2;
        if room < 4 || high > period {
            return Err(Error::Limits { low, high });
        }
        Ok(Self {
            half,
            largest: (room << Amplitude::FRACTION) - (room << Amplitude::FRACTION) / 8192,
            low,
            high,
            top: high,
        })
    }

    /// The same for a range that begins at zero, but one phase may go up to `top` at a time: the one whose current follows
    /// from the other two. Only [`svpwm`](crate::commutation::svpwm) makes use of it.
    #[must_use]
    pub const fn with_top(self, top: u16) -> Self {
        // A count less, for rounding.
        if self.low == 0 && top > self.high { Self { top, high: self.high - 1, ..self } } else { self }
    }

    /// Highest compare value of a phase whose current is sampled.
    pub const fn high(&self) -> u16 {
        self.high
    }

    /// Compare value of one half.
    pub const fn half(&self) -> u16 {
        self.half
    }

    /// Middle of the allowed range in counts with a fraction of so many bits, and half a count for rounding.
    #[inline(always)]
    pub const fn middle(&self, fraction: u32) -> i32 {
        ((self.low as i32 + self.high as i32 + 1) << fraction) >> 1
    }

    /// The compare value nearest to a number of counts.
    #[inline(always)]
    pub const fn nearest(&self, counts: i32) -> u16 {
        if counts < self.low as i32 {
            self.low
        } else if counts > self.high as i32 {
            self.high
        } else {
            counts as u16
        }
    }

    /// Length in counts of the longest voltage vector that fits the range in every direction with
    /// [`svpwm`](crate::commutation::svpwm), after what the dead time takes from a line voltage. With two counts for
    /// rounding: the largest line voltage, √3 of it, fits below the top, and the voltage from the lowest to the middle
    /// phase, up to 3/2 of it, below what is sampled.
    pub fn longest_vector(&self, dead_time: u16) -> f32 {
        let room = |highest: u16| f32::from(highest - self.low - 2) - f32::from(dead_time);
        (room(self.top) / SQRT_3).min(room(self.high) / 1.5)
    }

    /// The amplitude that a command asks for, or the largest that the limits allow.
    #[inline(always)]
    pub const fn amplitude(&self, command: Modulation) -> Amplitude {
        // Half of the period in counts is a command of one: 15 + 15 bits.
        let asked = (self.half as i32 * command.to_bits() as i32) >> (15 - Amplitude::FRACTION as i32);
        Amplitude(if asked > self.largest {
            self.largest
        } else if asked < -self.largest {
            -self.largest
        } else {
            asked
        })
    }

    /// Whether [`Self::amplitude`] cuts a command off.
    pub const fn limits(&self, command: Modulation) -> bool {
        let asked = (self.half as i32 * command.to_bits() as i32) >> (15 - Amplitude::FRACTION as i32);
        asked > self.largest || asked < -self.largest
    }
}

/// Amplitude of the compare values around one half, in 2⁻¹⁴ counts, signed. Only [`Limits`] makes one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Amplitude(i32);

impl Amplitude {
    /// Bits of the fraction.
    pub const FRACTION: u32 = 14;
    /// No voltage: all legs at one half.
    pub const ZERO: Self = Self(0);

    /// In 2⁻¹⁴ counts.
    #[inline(always)]
    pub const fn to_bits(self) -> i32 {
        self.0
    }

    /// In whole counts, rounded.
    #[inline(always)]
    pub const fn counts(self) -> i32 {
        (self.0 + (1 << (Self::FRACTION - 1))) >> Self::FRACTION
    }

    /// In counts.
    pub fn to_counts(self) -> f64 {
        f64::from(self.0) / f64::from(1 << Self::FRACTION)
    }
}

/// √3.
pub(crate) const SQRT_3: f32 = 1.732_050_8;

/// Effective resolution of the duty in bits: Simpkins and Todorov, eq. (19), `log₂(2 T_PWM / T_CY)` with the timer's
/// cycle T_CY.
pub fn resolution_bits(pwm_hz: f32, cycle_s: f32) -> f32 {
    libm::log2f(2.0 / (pwm_hz * cycle_s))
}

/// Ripple of the current in per cent of its mean at half duty: the inverse of eq. (18), `P = 100 (1 − e^(−R/2Lf))`. The
/// paper's 1 % at 51.8 kHz is 9.6 % by its own formula (errata).
pub fn ripple_percent(resistance_ohm: f32, inductance_h: f32, ripple_hz: f32) -> f32 {
    -100.0 * libm::expm1f(-resistance_ohm / (2.0 * inductance_h * ripple_hz))
}

/// The frequency at which the ripple has a given percentage: eq. (18), `f = −R / (2 L ln(1 − P/100))`.
///
/// For a centre-aligned timer this is the frequency of the ripple, twice that of the switching.
pub fn ripple_frequency(resistance_ohm: f32, inductance_h: f32, percent: f32) -> f32 {
    -resistance_ohm / (2.0 * inductance_h * libm::log1pf(-percent / 100.0))
}

/// Copper loss of a current that swings by ± `deviation` (relative to its mean) as a square wave, over that of its
/// mean: eq. (16), (17). The square wave between zero and twice the mean, deviation 1, costs twice the loss.
pub fn square_wave_loss(deviation: f32) -> f32 {
    1.0 + deviation * deviation
}

/// What bounds the choice of the PWM frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrequencyNeeds {
    /// Resistance of a phase in ohm.
    pub resistance_ohm: f32,
    /// Inductance of a phase in henry.
    pub inductance_h: f32,
    /// Ripple wanted, in per cent.
    pub ripple_percent: f32,
    /// Cycle of the timer in seconds.
    pub cycle_s: f32,
    /// Smallest resolution of the duty in bits.
    pub least_bits: f32,
    /// Highest frequency of the bridge's switching.
    pub highest_hz: f32,
    /// Lowest frequency, above hearing as a rule.
    pub lowest_hz: f32,
}

/// A PWM frequency and what comes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrequencyChoice {
    /// Switching frequency, centre-aligned.
    pub pwm_hz: f32,
    /// Ripple of the current, at twice that frequency, in per cent.
    pub ripple_percent: f32,
    /// Resolution of the duty in bits.
    pub bits: f32,
    /// Whether the ripple wanted is reached.
    pub reached: bool,
}

impl FrequencyNeeds {
    /// The lowest frequency that gives the ripple wanted, as far as the bridge and the resolution allow; switching
    /// faster than needed heats the transistors. `None` when a need is not positive and finite or the needs contradict
    /// each other.
    pub fn choose(&self) -> Option<FrequencyChoice> {
        let positive =
            [self.resistance_ohm, self.inductance_h, self.cycle_s, self.least_bits, self.highest_hz, self.lowest_hz];
        let valid = positive.iter().all(|x| *x > 0.0 && x.is_finite())
            && self.ripple_percent > 0.0
            && self.ripple_percent < 100.0;
        let wanted = ripple_frequency(self.resistance_ohm, self.inductance_h, self.ripple_percent) / 2.0;
        let finest = 2.0 / (self.cycle_s * libm::exp2f(self.least_bits));
        let highest = self.highest_hz.min(finest);
        if !valid || highest < self.lowest_hz {
            return None;
        }
        let pwm_hz = wanted.clamp(self.lowest_hz, highest);
        Some(FrequencyChoice {
            pwm_hz,
            ripple_percent: ripple_percent(self.resistance_ohm, self.inductance_h, 2.0 * pwm_hz),
            bits: resolution_bits(pwm_hz, self.cycle_s),
            reached: pwm_hz >= wanted,
        })
    }
}

#[cfg(test)]
mod tests;
