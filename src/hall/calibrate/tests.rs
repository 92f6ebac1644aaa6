use super::*;
use crate::angle::PolePairs;
use crate::hall::estimate::{BadModel, Estimator};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

extern crate std;
use std::f64::consts::TAU;
use std::string::ToString;

/// A rotor dragged around, with everything that can be wrong with it, in f64.
#[derive(Clone)]
struct Bench {
    offsets: [f64; 3],
    amplitudes: [f64; 3],
    placements_deg: [f64; 3],
    third: [f64; 3],
    /// What the model lacks: second harmonic, and the part of the third that is not locked to the first.
    strange: [[f64; 2]; 3],
    alignment_deg: f64,
    lag_deg: f64,
    cogging_deg: f64,
    noise: f64,
    rail: f64,
    turns: u32,
}

impl Bench {
    fn imperfect(random: &mut Pcg64) -> Self {
        let mut within = |range: f64| random.random_range(-range..range);
        let spacing = [120.0, -120.0, 60.0, -60.0][(within(2.0) + 2.0) as usize];
        Self {
            offsets: [0; 3].map(|_| 2048.0 + 50.0 * within(1.0)),
            amplitudes: [0; 3].map(|_| 250.0 * (1.0 + within(0.3))),
            placements_deg: [0.0, 1.0, 2.0].map(|k| spacing * k + within(8.0)),
            third: [0; 3].map(|_| 0.05),
            strange: [[0.0; 2]; 3],
            alignment_deg: within(180.0),
            lag_deg: 4.0 + within(3.0),
            cogging_deg: 2.0,
            noise: 0.01,
            rail: 4095.0,
            turns: 8,
        }
    }

    /// A motor without vices.
    fn kind() -> Self {
        Self {
            offsets: [2048.0; 3],
            amplitudes: [250.0; 3],
            placements_deg: [0.0, 120.0, 240.0],
            third: [0.0; 3],
            strange: [[0.0; 2]; 3],
            alignment_deg: 40.0,
            lag_deg: 3.0,
            cogging_deg: 0.0,
            noise: 0.003,
            rail: 4095.0,
            turns: 4,
        }
    }

    fn codes(&self, rotor: f64, gauss: &mut impl FnMut() -> f64) -> Codes {
        core::array::from_fn(|k| {
            let x = rotor + (self.alignment_deg - self.placements_deg[k]).to_radians();
            let [second, third] = self.strange[k];
            let strange = second * (2.0 * x + 0.7).sin() + third * (3.0 * x).cos();
            let wave = x.sin() + self.third[k] * (3.0 * x).sin() + strange + self.noise * gauss();
            (self.offsets[k] + self.amplitudes[k] * wave).round().clamp(0.0, self.rail) as u16
        })
    }

    fn run(&self, random: &mut Pcg64) -> Collector {
        let mut gauss = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
        let mut collector = Collector::new(12);
        let samples = 4000;
        for (sweep, sign) in [(Sweep::Forward, 1.0), (Sweep::Backward, -1.0)] {
            for k in 0..self.turns * samples {
                let field = sign * TAU * f64::from(k) / f64::from(samples);
                let cogging = self.cogging_deg * (6.0 * field).sin() + 0.5 * self.cogging_deg * (2.0 * field).sin();
                let rotor = field + (cogging - sign * self.lag_deg).to_radians();
                let bits = (field / TAU * 4_294_967_296.0) as i64 as i32;
                collector.push(sweep, ElectricalAngle::from_bits(bits), &self.codes(rotor, &mut gauss), k);
            }
        }
        collector
    }

    /// Largest and mean error of the calibrated estimate over the turn, without noise, in degrees.
    fn angle_error(&self, calibration: &Calibration) -> (f64, f64) {
        let estimator = Estimator::new(&calibration.model, 12).unwrap();
        let exact = Self { noise: 0.0, ..self.clone() };
        let error = |k: u32| {
            let rotor = TAU * f64::from(k) / 3600.0;
            let angle = estimator.angle(&exact.codes(rotor, &mut || 0.0)).unwrap();
            let truth = ElectricalAngle::from_bits((rotor / TAU * 4_294_967_296.0) as i64 as i32);
            f64::from((angle - truth).to_degrees())
        };
        let errors = (0..3600).map(error);
        (errors.clone().fold(0.0, |max, e| e.abs().max(max)), errors.sum::<f64>() / 3600.0)
    }
}

/// Harmonics that the model lacks make the angle that fits best and the estimator's differ, also in the mean.
#[test]
fn the_alignment_is_of_the_angle_that_the_estimator_tells() {
    let mut random = Pcg64::seed_from_u64(12);
    let mut worst = 0.0_f64;
    for _ in 0..30 {
        let strange = [[0; 2]; 3].map(|pair| pair.map(|_| random.random_range(-0.03..0.03)));
        let bench = Bench { strange, cogging_deg: 0.0, ..Bench::imperfect(&mut random) };
        let calibration = bench.run(&mut random).finish(Halls::Three, false).unwrap();
        let (_, mean) = bench.angle_error(&calibration);
        worst = worst.max(mean.abs());
    }
    std::println!("mean error with strange harmonics: worst of 30 {worst:.4}°");
    assert!(worst < 0.04, "{worst}°");
}

#[test]
fn finds_imperfect_sensors_at_both_spacings_in_either_order() {
    let mut random = Pcg64::seed_from_u64(11);
    let (mut worst, mut worst_mean) = (0.0_f64, 0.0_f64);
    for _ in 0..100 {
        let bench = Bench::imperfect(&mut random);
        let calibration = bench.run(&mut random).finish(Halls::Three, false).unwrap();
        let (largest, mean) = bench.angle_error(&calibration);
        worst = worst.max(largest);
        worst_mean = worst_mean.max(mean.abs());
        for k in 0..3 {
            let (found, report) = (&calibration.model.sensors[k], &calibration.report.sensors[k]);
            assert!((f64::from(found.offset) - bench.offsets[k]).abs() < 0.3);
            assert!((f64::from(found.amplitude) / bench.amplitudes[k] - 1.0).abs() < 2e-3);
            assert!((found.third - 0.05).abs() < 2e-3, "{}", found.third);
            assert!((report.noise_pct - 1.0).abs() < 0.05, "{}", report.noise_pct);
            let relative = ElectricalAngle::from_degrees((bench.placements_deg[k] - bench.placements_deg[0]) as f32);
            assert!((found.placement - relative).to_degrees().abs() < 0.2);
        }
        let spacing = (bench.placements_deg[1] / 60.0).round() * 60.0;
        assert_eq!(f64::from(calibration.report.pattern.spacing), spacing.abs());
        assert_eq!(calibration.report.pattern.forward, spacing > 0.0);
        assert!((f64::from(calibration.report.lag.to_degrees()) - bench.lag_deg).abs() < 0.1);
        assert!((calibration.report.angle_noise_deg - 0.468).abs() < 0.02);
    }
    std::println!("largest angle error {worst:.3}°, mean {worst_mean:.3}°");
    // Of the largest, 0.25° is the quantisation of 350 codes' swing.
    assert!(worst < 0.5, "{worst}");
    assert!(worst_mean < 0.05, "{worst_mean}");
}

/// Two of the sensors, so many degrees apart but for an error of up to 8° each; at the third input there is nothing.
fn imperfect_of_two(spacing: f64, random: &mut Pcg64) -> Bench {
    let mut bench = Bench::imperfect(random);
    let mut error = || random.random_range(-8.0..8.0);
    bench.placements_deg = [error(), spacing + error(), 0.0];
    (bench.offsets[2], bench.amplitudes[2], bench.noise) = (4000.0, 0.0, 0.01);
    bench
}

#[test]
fn finds_two_imperfect_sensors_at_any_spacing() {
    let mut random = Pcg64::seed_from_u64(21);
    let mut worst = [0.0_f64; 2];
    for spacing in [90.0, -90.0, 120.0, -120.0, 60.0, -60.0] {
        for _ in 0..20 {
            let bench = imperfect_of_two(spacing, &mut random);
            let calibration = bench.run(&mut random).finish(Halls::Two, false).unwrap();
            let (largest, mean) = bench.angle_error(&calibration);
            let worst = &mut worst[usize::from(spacing.abs() != 90.0)];
            *worst = worst.max(largest);
            assert!(mean.abs() < 0.06, "{spacing}: {mean}");
            let report = &calibration.report;
            assert_eq!((f64::from(report.pattern.spacing), report.pattern.forward), (spacing.abs(), spacing > 0.0));
            assert_eq!(report.present().len(), 2);
            assert_eq!(calibration.model.sensors[2], crate::hall::model::Sensor::ABSENT);
            let apart = (bench.placements_deg[1] - bench.placements_deg[0]).to_radians();
            let expected = 0.573 / apart.sin().abs();
            assert!((f64::from(report.angle_noise_deg) / expected - 1.0).abs() < 0.03, "{}", report.angle_noise_deg);
            assert_eq!(report.findings().filter(Finding::refuses).count(), 0);
        }
    }
    std::println!("largest angle error of two: 90° {:.3}°, 60° and 120° {:.3}°", worst[0], worst[1]);
    assert!(worst.iter().all(|&worst| worst < 0.7), "{worst:?}");
}

#[test]
fn two_sensors_that_are_not_there_or_too_close_together_are_named() {
    let mut random = Pcg64::seed_from_u64(22);
    let bench = imperfect_of_two(90.0, &mut random);
    // The third alone has a signal.
    let mut none = bench.clone();
    none.amplitudes = [0.0, 0.0, 250.0];
    assert_eq!(none.run(&mut random).finish(Halls::Two, false).unwrap_err(), Error::NotTurning);
    let mut one = bench.clone();
    one.amplitudes[1] = 0.0;
    assert_eq!(one.run(&mut random).finish(Halls::Two, false).unwrap_err(), Error::NoSignal(Channel(1)));
    assert_eq!(bench.run(&mut random).finish(Halls::Three, false).unwrap_err(), Error::NoSignal(Channel(2)));
    for apart in [20.0, 165.0] {
        let close = Bench { placements_deg: [0.0, apart, 0.0], ..bench.clone() };
        let error = close.run(&mut random).finish(Halls::Two, false).unwrap_err();
        assert!(matches!(error, Error::Model(BadModel::Placement { .. })), "{apart}: {error:?}");
    }
    let far = Bench { placements_deg: [0.0, 143.0, 0.0], ..bench };
    let report = far.run(&mut random).finish(Halls::Two, false).unwrap().report;
    assert!(
        report
            .findings()
            .any(|finding| matches!(finding, Finding::Misplaced(_, degrees) if (degrees - 23.0).abs() < 1.0))
    );
}

#[test]
fn reversed_counts_the_other_way() {
    let mut random = Pcg64::seed_from_u64(12);
    let bench = Bench::kind();
    let collector = bench.run(&mut random);
    let (forward, reversed) =
        (collector.finish(Halls::Three, false).unwrap().model, collector.finish(Halls::Three, true).unwrap().model);
    for degrees in [0.0, 50.0, 200.0] {
        let angle = ElectricalAngle::from_degrees(degrees);
        assert_eq!(forward.electrical(angle), -reversed.electrical(angle));
    }
}

/// What `finish` says of a bench made worse by `change`.
fn verdict(change: impl Fn(&mut Bench)) -> Result<Calibration, Error> {
    let mut bench = Bench::kind();
    change(&mut bench);
    bench.run(&mut Pcg64::seed_from_u64(13)).finish(Halls::Three, false)
}

#[test]
fn a_kind_motor_has_no_findings() {
    let calibration = verdict(|_| {}).unwrap();
    assert_eq!(calibration.report.findings().count(), 0);
    assert_eq!(calibration.report.counts_per_electrical_turn().round(), 2000.0);
    assert_eq!(calibration.report.counts_per_turn(PolePairs::new(4).unwrap()).round(), 8000.0);
}

fn is_misplaced(error: &Error, hall: u8, degrees: f32) -> bool {
    matches!(*error, Error::Refused(Finding::Misplaced(channel, by)) if channel == Channel(hall) && (by - degrees).abs() < 1.0)
}

#[test]
fn bad_mountings_are_refused_in_words() {
    use Finding::*;
    type Change = fn(&mut Bench);
    type Expected = fn(&Error) -> bool;
    let refusals: [(Change, Expected, &str); 13] = [
        (|b| b.amplitudes[1] = 1.0, |e| *e == Error::NoSignal(Channel(1)), "Hall 2 sees no magnet"),
        (|b| b.amplitudes = [15.0; 3], |e| matches!(e, Error::Refused(TooFar(Channel(0), _))), "closer to the magnet"),
        (|b| b.amplitudes[2] = 2100.0, |e| matches!(e, Error::Refused(TooClose(Channel(2)))), "saturates"),
        (|b| b.third = [0.2; 3], |e| matches!(e, Error::Refused(TooClose(Channel(0)))), "saturates"),
        (|b| b.amplitudes[0] = 1500.0, |e| matches!(e, Error::Refused(Unequal(_))), "same distance"),
        (|b| b.amplitudes = [1.0; 3], |e| *e == Error::NotTurning, "slower"),
        (|b| b.placements_deg[1] = 155.0, |e| is_misplaced(e, 1, 35.0), "Hall 2 is 35° (electrical) away"),
        (|b| b.placements_deg[2] = 205.0, |e| is_misplaced(e, 2, 35.0), "Hall 3 is 35° (electrical) away"),
        // Nearest to a spacing of 60°.
        (|b| b.placements_deg = [0.0, 120.0, 120.0], |e| is_misplaced(e, 1, 60.0), "Hall 2 is 60° (electrical) away"),
        (
            |b| b.placements_deg = [0.0, 15.0, 30.0],
            |e| matches!(e, Error::Model(BadModel::Placement { .. })),
            "placed so",
        ),
        (|b| b.noise = 0.08, |e| matches!(e, Error::Refused(Noisy(Channel(0), _))), "shield"),
        (|b| b.lag_deg = 70.0, |e| matches!(e, Error::Refused(Lagging(_))), "raise the calibration current"),
        (|b| b.turns = 0, |e| *e == Error::Incomplete(Sweep::Forward), "too few samples"),
    ];
    for (change, expected, words) in refusals {
        let error = verdict(change).unwrap_err();
        assert!(expected(&error), "{error:?}");
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn a_slipping_rotor_is_refused() {
    // The field goes round, the rotor oscillates in place.
    let mut random = Pcg64::seed_from_u64(14);
    let mut collector = Collector::new(12);
    let bench = Bench::kind();
    for (sweep, sign) in [(Sweep::Forward, 1.0), (Sweep::Backward, -1.0)] {
        for k in 0..16_000_u32 {
            let field = sign * TAU * f64::from(k) / 4000.0;
            let codes = bench.codes(0.6 * field.sin(), &mut || random.random_range(-1.0..1.0));
            let bits = (field / TAU * 4_294_967_296.0) as i64 as i32;
            collector.push(sweep, ElectricalAngle::from_bits(bits), &codes, k);
        }
    }
    let error = collector.finish(Halls::Three, false).unwrap_err();
    assert!(matches!(error, Error::Refused(Finding::Unexplained(_)) | Error::NoFit), "{error:?}");
    assert!(error.to_string().contains("rotor"), "{error}");
}

#[test]
fn small_blemishes_are_told_but_accepted() {
    use Finding::*;
    let findings = |change: fn(&mut Bench)| {
        let calibration = verdict(change).unwrap();
        calibration.report.findings().collect::<std::vec::Vec<_>>()
    };
    assert!(matches!(findings(|b| b.amplitudes = [60.0; 3])[..], [TooFar(..), TooFar(..), TooFar(..)]));
    assert!(matches!(findings(|b| b.placements_deg[1] = 138.0)[..], [Misplaced(Channel(1), _)]));
    assert!(matches!(findings(|b| b.noise = 0.04)[..], [Noisy(..), Noisy(..), Noisy(..)]));
    assert!(matches!(findings(|b| b.amplitudes[1] = 100.0)[..], [Unequal(_)]));
    assert!(matches!(findings(|b| b.lag_deg = 40.0)[..], [Lagging(_)]));
}
