use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

extern crate std;
use std::vec::Vec;

const DEGREES: fn(f32) -> ElectricalAngle = ElectricalAngle::from_degrees;

/// Unequal sensors: placement errors, amplitudes, offsets and harmonics as large as they come.
fn imperfect(spacing: f32, adc_bits: u8, swing: f32, harmonics: bool) -> Model {
    let full = (1_u32 << adc_bits) as f32;
    let sensor = |k: usize| Sensor {
        offset: full * 0.5 + swing * [0.05, -0.04, 0.03][k],
        amplitude: swing * 0.5 * [1.0, 0.7, 1.3][k] * 0.7,
        placement: DEGREES(spacing * k as f32 + [0.0, 8.0, -8.0][k]),
        third: if harmonics { [0.05, 0.04, 0.06][k] } else { 0.0 },
        fifth: if harmonics { -0.01 } else { 0.0 },
    };
    Model { sensors: [sensor(0), sensor(1), sensor(2)], alignment: DEGREES(33.0), reversed: spacing > 100.0 }
}

use crate::hall::model::Sensor;

/// Errors in degrees over the turn, for codes made from exact sines in f64.
fn errors(model: &Model, estimator: &Estimator, mut disturb: impl FnMut(usize, f64) -> f64) -> Vec<f64> {
    (0..7200)
        .map(|k| {
            let electrical = ElectricalAngle::from_bits((k as u32).wrapping_mul(596_523) as i32);
            let hall = f64::from(model.hall(electrical).to_bits()) / 4_294_967_296.0 * std::f64::consts::TAU;
            let mut codes = [0; 3];
            for (channel, code) in codes.iter_mut().enumerate() {
                let s = &model.sensors[channel];
                let x = hall - f64::from(s.placement.to_bits()) / 4_294_967_296.0 * std::f64::consts::TAU;
                let wave = x.sin() + f64::from(s.third) * (3.0 * x).sin() + f64::from(s.fifth) * (5.0 * x).sin();
                let exact = f64::from(s.offset) + f64::from(s.amplitude) * (wave + disturb(channel, x));
                *code = exact.round() as u16;
            }
            let angle = estimator.angle(&codes).unwrap();
            f64::from((angle - electrical).to_bits()) / 4_294_967_296.0 * 360.0
        })
        .collect()
}

fn max(errors: &[f64]) -> f64 {
    errors.iter().fold(0.0, |max, e| max.max(e.abs()))
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn inverts_the_model_at_both_spacings_in_either_order() {
    for spacing in [120.0, 60.0, -120.0, -60.0] {
        for harmonics in [false, true] {
            let model = imperfect(spacing, 16, 60_000.0, harmonics);
            let estimator = Estimator::new(&model, 16).unwrap();
            let worst = max(&errors(&model, &estimator, |_, _| 0.0)).to_radians();
            std::println!("{spacing}°, harmonics {harmonics}: {worst:.2e} rad");
            assert!(worst < 1.5e-4, "{spacing}° {harmonics}: {worst:e} rad");
        }
    }
}

#[test]
fn twelve_full_scale_bits_are_good_to_their_quantisation() {
    let model = Model::nominal(12, 2040.0 / 1.05, ElectricalAngle::THIRD);
    let estimator = Estimator::new(&model, 12).unwrap();
    let worst = max(&errors(&model, &estimator, |_, _| 0.0)).to_radians();
    std::println!("{worst:.2e} rad");
    assert!(worst < 3.5e-4, "{worst:e} rad");
}

#[test]
fn what_is_common_does_not_reach_the_angle() {
    let model = Model::nominal(16, 20_000.0, ElectricalAngle::THIRD);
    let estimator = Estimator::new(&model, 16).unwrap();
    let offset = max(&errors(&model, &estimator, |_, _| 0.05));
    let third = max(&errors(&model, &estimator, |_, x| 0.05 * (3.0 * x).sin()));
    assert!(offset < 0.01 && third < 0.01, "{offset} {third}");
    // With misplaced sensors a common offset still does not; an unknown third harmonic does, so it is calibrated.
    let model = imperfect(120.0, 16, 50_000.0, true);
    let estimator = Estimator::new(&model, 16).unwrap();
    let offset = max(&errors(&model, &estimator, |_, _| 0.05));
    assert!(offset < 0.1, "{offset}");
}

#[test]
fn noise_stays_at_the_bound() {
    let mut random = Pcg64::seed_from_u64(1);
    let mut gauss = move || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
    // 1 % noise on three sensors: σ·√(2/3) rad is the Cramér-Rao bound.
    let bound = (0.01 * (2.0_f64 / 3.0).sqrt()).to_degrees();
    assert!((bound - 0.468).abs() < 5e-4);
    for (model, limit) in [
        (Model::nominal(16, 20_000.0, ElectricalAngle::THIRD), 1.02),
        (Model::nominal(16, 20_000.0, DEGREES(60.0)), 1.02),
        (imperfect(120.0, 16, 50_000.0, true), 1.1),
        (imperfect(-60.0, 16, 50_000.0, true), 1.1),
    ] {
        let estimator = Estimator::new(&model, 16).unwrap();
        let ratio = rms(&errors(&model, &estimator, |_, _| 0.01 * gauss())) / bound;
        std::println!("noise {ratio:.3} of the bound");
        assert!(ratio < limit, "{ratio}");
    }
}

#[test]
fn no_code_in_the_windows_overflows() {
    let mut random = Pcg64::seed_from_u64(2);
    for adc_bits in [8, 12, 16] {
        for spacing in [60.0, 120.0, -60.0, -120.0] {
            let model = imperfect(spacing, adc_bits, 0.9 * (1_u32 << adc_bits) as f32, true);
            let estimator = Estimator::new(&model, adc_bits).unwrap();
            for _ in 0..100_000 {
                let (low, high) = estimator.window.bounds();
                let codes = [0; 3].map(|_| random.random_range(low..=high));
                let limit = (estimator.disagreement_span / 2) as i32;
                for (row, raised) in [(&estimator.cosine, 0), (&estimator.sine, 0), (&estimator.disagreement, limit)] {
                    let offsets = [0, 1, 2].map(|k| f64::from(model.sensors[k].offset));
                    let exact: f64 = (0..3).map(|k| f64::from(row.gains[k]) * (f64::from(codes[k]) - offsets[k])).sum();
                    assert!(
                        exact.abs() < 2_147_483_648.0
                            && (exact - f64::from(row.dot(&codes).wrapping_sub(raised))).abs() < 2e6
                    );
                }
            }
        }
    }
}

#[test]
fn implausible_codes_are_named() {
    let model = Model::nominal(12, 500.0, ElectricalAngle::THIRD);
    let estimator = Estimator::new(&model, 12).unwrap();
    let codes = model.codes(DEGREES(20.0));
    let with = |channel: usize, code: u16| {
        let mut codes = codes;
        codes[channel] = code;
        estimator.angle(&codes)
    };
    for channel in 0..3 {
        let name = Channel(channel as u8);
        assert_eq!(with(channel, 0), Err(Implausible::AtRail(name)));
        assert_eq!(with(channel, 4095), Err(Implausible::AtRail(name)));
        assert_eq!(with(channel, u16::MAX), Err(Implausible::AtRail(name)));
        assert_eq!(with(channel, 2048 + 751), Err(Implausible::OutOfRange(name)));
        assert_eq!(with(channel, 2048 - 751), Err(Implausible::OutOfRange(name)));
        assert_eq!(with(channel, if codes[channel] > 2048 { 1600 } else { 2500 }), Err(Implausible::Inconsistent));
    }
    assert_eq!(estimator.angle(&[2048; 3]), Err(Implausible::Weak));
    let strong = Model::nominal(12, 749.0, ElectricalAngle::THIRD);
    assert!(estimator.angle(&strong.codes(DEGREES(20.0))).is_ok());
}

#[test]
fn impossible_models_are_refused() {
    let good = Model::nominal(12, 500.0, ElectricalAngle::THIRD);
    let with = |change: fn(&mut Model)| {
        let mut model = good;
        change(&mut model);
        Estimator::new(&model, 12).map(|_| ())
    };
    let bad = |channel| Err(BadModel::Sensor(Channel(channel)));
    assert_eq!(with(|_| {}), Ok(()));
    assert_eq!(Estimator::new(&good, 17).map(|_| ()), Err(BadModel::AdcBits(17)));
    assert_eq!(with(|m| m.sensors[1].amplitude = f32::NAN), bad(1));
    assert_eq!(with(|m| m.sensors[2].amplitude = -3.0), bad(2));
    assert_eq!(with(|m| m.sensors[0].offset = 5000.0), bad(0));
    assert_eq!(with(|m| m.sensors[0].offset = f32::NAN), bad(0));
    assert_eq!(with(|m| m.sensors[0].third = f32::INFINITY), bad(0));
    for twin in [0.0, 180.0, 20.0] {
        let mut model = good;
        model.sensors[1].placement = DEGREES(twin);
        model.sensors[2].placement = DEGREES(2.0 * twin);
        assert!(matches!(Estimator::new(&model, 12), Err(BadModel::Placement { .. })), "{twin}");
    }
}

#[test]
fn two_sensors_give_the_same_angle_as_three() {
    for spacing in [60.0, 120.0, -60.0, -120.0] {
        let mut model = Model::nominal(16, 16_000.0, ElectricalAngle::from_degrees(spacing));
        for (k, sensor) in model.sensors.iter_mut().enumerate() {
            sensor.placement += ElectricalAngle::from_degrees([0.0, 8.0, -8.0][k]);
            sensor.amplitude *= [1.0, 0.7, 1.2][k];
            sensor.third = 0.05;
        }
        for lost in 0..3 {
            let estimator = Estimator::without(Channel(lost), &model, 16).unwrap();
            let mut worst = 0.0_f32;
            for k in 0..3600 {
                let angle = ElectricalAngle::from_degrees(k as f32 / 10.0);
                let mut codes = model.codes(angle);
                codes[usize::from(lost)] = [0, 65535, 12345][k % 3];
                let error = estimator.angle(&codes).unwrap() - angle;
                worst = worst.max(error.to_radians().abs());
            }
            assert!(worst < 5e-4, "{spacing} without {lost}: {worst}");
            let three = Estimator::new(&model, 16).unwrap();
            assert_eq!((three.lost(), estimator.lost()), (None, Some(Channel(lost))));
            let mut worst = 0.0_f32;
            for k in 0..3600 {
                let angle = ElectricalAngle::from_degrees(k as f32 / 10.0);
                let (rough, strength) = three.angle_without(Channel(lost), &model.codes(angle)).unwrap();
                assert!((700..1400).contains(&strength), "{spacing} without {lost}: {strength}");
                worst = worst.max((rough - angle).to_degrees().abs());
            }
            assert!((2.0..7.0).contains(&worst), "{spacing} without {lost}: {worst}°");
            assert_eq!(estimator.angle_without(Channel(lost), &[30_000; 3]), None);
        }
    }
}

/// Two sensors, so far apart, unequal and with a third harmonic.
fn two(spacing: f32, third: f32) -> Model {
    let mut model = Model::nominal(12, 1000.0, ElectricalAngle::from_degrees(spacing)).of_two();
    model.sensors[1].amplitude = 800.0;
    model.sensors[0].third = third;
    model.sensors[1].third = third;
    model
}

#[test]
fn a_model_of_two_sensors_gives_the_angle_whatever_is_at_the_third_input() {
    for spacing in [60.0, -75.0, 90.0, 105.0, -120.0] {
        let model = two(spacing, 0.05);
        let estimator = Estimator::new(&model, 12).unwrap();
        assert_eq!(estimator.lost(), Some(Channel::THIRD));
        for k in 0..3600 {
            let angle = ElectricalAngle::from_degrees(k as f32 / 10.0);
            let mut codes = model.codes(angle);
            codes[2] = [0, 4095, 1234][k % 3];
            let error = (estimator.angle(&codes).unwrap() - angle).to_degrees();
            assert!(error.abs() < 0.1, "{spacing} {angle:?}: {error}");
        }
    }
}

#[test]
fn a_model_of_two_sensors_cannot_lose_another() {
    for lost in [0, 1] {
        assert_eq!(
            Estimator::without(Channel(lost), &two(90.0, 0.0), 12).map(|_| ()),
            Err(BadModel::Sensor(Channel::THIRD))
        );
    }
}

#[test]
fn two_sensors_in_opposite_phase_are_refused() {
    let mut model = Model::nominal(12, 1000.0, ElectricalAngle::from_degrees(120.0));
    model.sensors[1].placement = ElectricalAngle::from_degrees(175.0);
    assert!(matches!(Estimator::without(Channel(2), &model, 12), Err(BadModel::Placement { .. })));
    assert!(Estimator::without(Channel(1), &model, 12).is_ok());
}
