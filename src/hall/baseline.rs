//! The angle estimates of Simpkins and Todorov, eq. (4) to (6), with the errata: the yardstick for [`super::estimate`].
//!
//! The arcsine of one signal is ambiguous and steepens without bound at the peaks, where it amplifies noise; and a
//! signal beyond ±1 has none. That is in the method, so it stays.

use crate::angle::ElectricalAngle;
use crate::hall::normalize::Signal;
use crate::trig;
use fixed::types::I2F30;

/// Arcsine of a signal; beyond ±1 it stays at ±90°.
fn arcsine(signal: Signal) -> ElectricalAngle {
    trig::asin(I2F30::saturating_from_num(signal))
}

/// Eq. (5), (6): the Hall angle from the first sensor alone. The second, at the given placement 0° < ψ < 180°, only
/// decides the quadrant: on the rising half of the first sensor's wave it is below its value at the other candidate.
pub fn single_sensor(first: Signal, second: Signal, placement: ElectricalAngle) -> ElectricalAngle {
    resolve(first, |candidate| {
        let expected = trig::sin(candidate - placement);
        distance(second, expected)
    })
}

/// Eq. (4): the mean of the three arcsines, each in the quadrant that fits the other two signals best.
pub fn three_sensors(signals: [Signal; 3], placements: [ElectricalAngle; 3]) -> ElectricalAngle {
    let angle_of = |own: usize| {
        let rising = resolve(signals[own], |candidate| {
            let hall = candidate + placements[own];
            (0..3).map(|other| distance(signals[other], trig::sin(hall - placements[other]))).sum()
        });
        rising + placements[own]
    };
    let first = angle_of(0);
    // Mean of the differences, for the mean of angles is not defined across the wrap.
    let rest: i64 = [1, 2].map(|own| i64::from((angle_of(own) - first).to_bits())).iter().sum();
    first + ElectricalAngle::from_bits((rest / 3) as i32)
}

/// The arcsine, or 180° less it: whichever has the smaller cost.
fn resolve(signal: Signal, cost: impl Fn(ElectricalAngle) -> i64) -> ElectricalAngle {
    let rising = arcsine(signal);
    let falling = ElectricalAngle::HALF - rising;
    if cost(rising) <= cost(falling) { rising } else { falling }
}

/// How far a signal is from an expected one.
fn distance(signal: Signal, expected: I2F30) -> i64 {
    (i64::from(signal.to_bits()) - i64::from(expected.to_bits() >> 2)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ideal signals all around, at spacings of 60° and 120° in either order.
    fn worst_error(estimate: impl Fn([Signal; 3], [ElectricalAngle; 3]) -> ElectricalAngle) -> f32 {
        let mut worst = 0.0_f32;
        for spacing in [60.0, 120.0, -60.0, -120.0] {
            let placements = [0.0, spacing, 2.0 * spacing].map(ElectricalAngle::from_degrees);
            for k in 0..3600 {
                let hall = ElectricalAngle::from_degrees(k as f32 / 10.0);
                let signals = placements.map(|placement| Signal::from_num(trig::sin(hall - placement)));
                worst = worst.max((estimate(signals, placements) - hall).to_degrees().abs());
            }
        }
        worst
    }

    #[test]
    fn single_sensor_finds_ideal_angles() {
        // The error at the peaks is that of the sine table, 4e-5, under the square root: √(2 · 4e-5) rad = 0.51°.
        let worst = worst_error(|signals, placements| single_sensor(signals[0], signals[1], placements[1]));
        assert!(worst < 0.52, "{worst}");
    }

    #[test]
    fn three_sensors_find_ideal_angles() {
        let worst = worst_error(three_sensors);
        assert!(worst < 0.2, "{worst}");
    }

    #[test]
    fn signals_beyond_one_stay_at_the_peak() {
        let beyond = Signal::from_num(1.3);
        let angle = single_sensor(beyond, Signal::from_num(-0.5), ElectricalAngle::THIRD);
        assert_eq!(angle, ElectricalAngle::QUARTER);
    }
}
