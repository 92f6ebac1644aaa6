//! Sweeps over the whole input range against f64. The tolerances are two-sided: an improvement must update the number.

use super::*;

extern crate std;
use std::f64::consts;

/// Collects the largest and the RMS error.
#[derive(Default)]
struct Errors {
    max: f64,
    square: f64,
    count: f64,
}

impl Errors {
    fn add(&mut self, error: f64) {
        self.max = self.max.max(error.abs());
        self.square += error * error;
        self.count += 1.0;
    }

    #[track_caller]
    fn assert(&self, name: &str, max: f64, rms: f64) {
        let found = (self.square / self.count).sqrt();
        std::println!("{name}: max {:.3e}, rms {found:.3e}", self.max);
        assert!(
            self.max <= max && self.max > 0.5 * max,
            "{name}: largest error {:.3e}, documented {max:.1e}",
            self.max
        );
        assert!(found <= rms && found > 0.5 * rms, "{name}: RMS error {found:.3e}, documented {rms:.1e}");
    }
}

/// Difference of an angle from an exact one in radians, wrapped.
fn angle_error(angle: ElectricalAngle, exact: f64) -> f64 {
    let error = f64::from(angle.to_bits()) / 4_294_967_296.0 - exact / consts::TAU;
    (error - error.round()) * consts::TAU
}

#[test]
fn sine_and_cosine_over_the_whole_turn() {
    let (mut sines, mut cosines) = (Errors::default(), Errors::default());
    for k in 0..1 << 24 {
        // An odd stride visits every residue of the low bits as well.
        let angle = ElectricalAngle::from_bits((k as u32).wrapping_mul(257) as i32);
        let exact = f64::from(angle.to_bits()) / 4_294_967_296.0 * consts::TAU;
        sines.add(sin(angle).to_num::<f64>() - exact.sin());
        cosines.add(cos(angle).to_num::<f64>() - exact.cos());
    }
    sines.assert("sin", 4e-5, 1.9e-5);
    cosines.assert("cos", 4e-5, 1.9e-5);
}

#[test]
fn arcsine_over_all_arguments() {
    let mut errors = Errors::default();
    let one = 1i64 << 30;
    let near_one = (0..1 << 16).map(|k| one - k);
    for bits in (-one..=one).step_by(127).chain(near_one) {
        let exact = (bits as f64 / one as f64).asin();
        errors.add(angle_error(asin(I2F30::from_bits(bits as i32)), exact));
    }
    errors.assert("asin", 1e-4, 2.6e-5);
    for bits in [one as i32 + 1, i32::MAX] {
        assert_eq!(asin(I2F30::from_bits(bits)), ElectricalAngle::QUARTER);
        assert_eq!(asin(I2F30::from_bits(-bits)), -ElectricalAngle::QUARTER);
    }
    assert_eq!(asin(I2F30::MIN), -ElectricalAngle::QUARTER);
}

/// Every direction at many lengths, and the corners of the range.
fn vectors() -> impl Iterator<Item = (i32, i32)> {
    let turn = (0..1 << 20).flat_map(|k| {
        let angle = f64::from(k) / f64::from(1 << 20) * consts::TAU;
        (4..31).step_by(3).map(move |bits| {
            let length = (1u64 << bits) as f64 * (1.0 + f64::from(k % 1000) / 1001.0);
            ((length * angle.sin()) as i32, (length * angle.cos()) as i32)
        })
    });
    let corners = [i32::MIN, i32::MIN + 1, -2, -1, 0, 1, 2, i32::MAX];
    turn.chain(corners.into_iter().flat_map(move |y| corners.into_iter().map(move |x| (y, x))))
}

#[test]
fn arctangent_of_any_vector() {
    let (mut divided, mut undivided) = (Errors::default(), Errors::default());
    for (y, x) in vectors().filter(|&v| v != (0, 0)) {
        let exact = f64::from(y).atan2(f64::from(x));
        divided.add(angle_error(atan2(y, x), exact));
        undivided.add(angle_error(atan2_without_division(y, x), exact));
    }
    divided.assert("atan2", 8.5e-5, 2.8e-5);
    undivided.assert("atan2_without_division", 1.3e-4, 3.3e-5);
    // The null vector has no angle; what matters is that asking is harmless.
    assert!(angle_error(atan2(0, 0), 0.0).abs() < 1e-4);
}

#[test]
fn compile_time_functions_match_the_library() {
    for k in 0..=1000 {
        let x = f64::from(k) / 1000.0;
        assert!((sine(x * 10.0 - 3.0) - (x * 10.0 - 3.0).sin()).abs() < 1e-14);
        assert!((atan(x) - x.atan()).abs() < 1e-14);
        assert!((arcsine(x) - x.asin()).abs() < 1e-13, "{x}");
    }
}

#[test]
fn one_quadrant_gives_what_four_give() {
    for (quadrant, ratio) in (0..4).flat_map(|quadrant| (0..1 << 16).map(move |ratio| (quadrant, ratio))) {
        let (one, four) = (folded_angle(quadrant, ratio), segment_angle(quadrant, ratio, &ATAN2));
        assert_eq!(one, four, "{quadrant} {ratio}");
    }
}

#[test]
fn half_a_wave_gives_what_the_whole_gives() {
    for (segment, offset) in (0..256_u32).flat_map(|segment| (0..SINE_STEPS).map(move |offset| (segment, offset))) {
        let whole = SINE[segment as usize].at(offset);
        assert_eq!(folded_sine(segment << 24 | offset << SINE_OFFSET_LOW), whole, "{segment} {offset}");
    }
}
