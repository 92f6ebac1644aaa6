//! The vernier's self-calibration: what it makes of imperfect encoders on an unsteady shaft, and what it refuses.

use core::f64::consts::TAU;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::calibrate::{self, Calibrator, Report};
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use plant::construction::{Construction, Imperfections, UnsteadyShaft};

const STEP: f64 = TAU / 8_000.0;

fn imperfect() -> Imperfections {
    let degrees = f64::to_radians;
    Imperfections {
        eccentricity_mm: 0.05,
        misplacement_rad: degrees(1.0),
        harmonics_rad: [degrees(2.0), degrees(2.0), 0.0, 0.0],
        displacement_rad: 0.0,
        noise: 1.0,
    }
}

fn construction(imperfections: &Imperfections, seed: u64) -> Construction {
    let head_angle = 40.0_f64.to_radians();
    Construction::new([37, 45], 2.0, head_angle, 12, imperfections, seed)
}

fn paper() -> Rings {
    Rings::new(37, 45, 12).unwrap()
}

fn read<const HEADS: usize>(construction: &mut Construction, shaft: f64) -> Reading<HEADS> {
    let [reference, vernier] = construction.digital(shaft).map(|codes| codes.map(|code| paper().reading(code)));
    Reading { reference, vernier }
}

type Outcome<const HEADS: usize> = Result<(Calibration<HEADS>, Report), calibrate::Error>;

fn calibrate<const HEADS: usize>(
    construction: &mut Construction,
    mut shaft: impl FnMut() -> f64,
    samples: usize,
) -> Outcome<HEADS> {
    let mut calibrator = Calibrator::new(&paper(), &Calibration::ideal(&paper()));
    for _ in 0..samples {
        if calibrator.push(read(construction, shaft()))? {
            break;
        }
    }
    calibrator.finish()
}

/// Wrong pole pairs, RMS and largest error in degrees, without the constant part.
fn errors<const HEADS: usize>(construction: &mut Construction, calibration: &Calibration<HEADS>) -> (usize, f64, f64) {
    let step = MechanicalAngle::from_degrees(1.0);
    let encoder = Encoder::new(&paper(), calibration, step).unwrap();
    let mut errors: Vec<f64> = (0..10_000)
        .map(|index| {
            let shaft = f64::from(index) * 0.618_034 * TAU;
            let decoded = encoder.decode(read(construction, shaft));
            f64::from(decoded.angle.to_bits()) / 2f64.powi(32) - shaft / TAU
        })
        .collect();
    // The constant first to within a pole pair, then exactly.
    let first = errors[0];
    for error in &mut errors {
        *error -= first;
        *error = (*error - error.round()) * 360.0;
    }
    let right = |error: &&f64| error.abs() < 180.0 / 37.0;
    let wrong = errors.iter().filter(|error| !right(error)).count();
    let mean = errors.iter().filter(right).sum::<f64>() / (errors.len() - wrong) as f64;
    let (mut square, mut largest) = (0.0, 0.0_f64);
    for error in errors.iter().filter(right) {
        square += (error - mean).powi(2);
        largest = largest.max((error - mean).abs());
    }
    (wrong, (square / errors.len() as f64).sqrt(), largest)
}

fn unsteady(seed: u64) -> impl FnMut() -> f64 {
    let mut shaft = UnsteadyShaft::new(STEP, 0.05, seed);
    move || shaft.turn()
}

/// A shaft whose speed varies by the given share with one order of the turn.
fn rippled(ripple: f64, order: f64) -> impl FnMut() -> f64 {
    let mut angle = 0.3_f64;
    move || {
        angle += STEP * (1.0 + ripple * (order * angle).sin());
        angle
    }
}

#[test]
fn opposite_heads_in_both_directions() {
    for seed in 0..5 {
        let mut construction = construction(&imperfect(), seed);
        for direction in [1.0, -1.0] {
            let mut shaft = UnsteadyShaft::new(direction * STEP, 0.05, seed);
            let (calibration, report) = calibrate::<2>(&mut construction, || shaft.turn(), 60_000).unwrap();
            let (wrong, rms, largest) = errors(&mut construction, &calibration);
            assert_eq!(wrong, 0);
            assert!(rms < 0.0025 && largest < 0.008, "{rms} {largest}");
            // The report is about what follows: 2000 is 3 counts.
            assert!(report.worst_residual < 2000 && report.margin > 31_000, "{report:?}");
        }
    }
}

/// Ripple in step with a ring looks like its error to the constant-speed method alone: 5 % of 37 to a turn is 2.9°
/// electrical. The other ring is not in step, so the turn for the averages finds and removes it.
#[test]
fn ripple_in_step_with_the_pole_pairs_is_told_from_the_heads() {
    for order in [37.0, 45.0] {
        let mut construction = construction(&imperfect(), 3);
        let (calibration, report) = calibrate::<2>(&mut construction, rippled(0.05, order), 60_000).unwrap();
        let (wrong, rms, _) = errors(&mut construction, &calibration);
        assert_eq!(wrong, 0);
        println!("{order}: {rms} {report:?}");
        assert!(report.refinement > 400, "{report:?}");
        assert!(rms < 0.005, "{order} {rms}");
    }
}

#[test]
fn one_head_a_ring_knows_its_smaller_margin() {
    let mut construction = construction(&Imperfections { eccentricity_mm: 0.02, ..imperfect() }, 1);
    let (calibration, report) = calibrate::<1>(&mut construction, unsteady(1), 60_000).unwrap();
    assert!(report.margin > 10_000 && report.margin < 20_000, "{report:?}");
    assert!(report.worst_residual < report.margin / 3, "{report:?}");
    let (wrong, _, _) = errors(&mut construction, &calibration);
    assert_eq!(wrong, 0);
}

/// A perfect encoder has nothing to average: eq. (30) must not reject its noise.
#[test]
fn a_perfect_encoder_calibrates_to_nothing() {
    let mut construction = construction(&Imperfections { noise: 1.0, ..Imperfections::NONE }, 1);
    let (calibration, report) = calibrate::<1>(&mut construction, unsteady(1), 60_000).unwrap();
    assert_eq!(report.similar_percent, 100);
    let curves = calibration.reference.iter().chain(&calibration.vernier);
    assert!(curves.flat_map(|curve| curve.errors).all(|error| error.abs() <= 8));
    assert!(calibration.averages[..37].iter().all(|average| average.abs() < 200), "{:?}", calibration.averages);
}

/// Calibrating again from a calibration keeps its zero.
#[test]
fn the_zero_stays() {
    let mut construction = construction(&imperfect(), 7);
    let (first, _) = calibrate::<2>(&mut construction, unsteady(7), 60_000).unwrap();
    let mut again = Calibrator::new(&paper(), &first);
    let mut shaft = unsteady(8);
    while !again.push(read(&mut construction, shaft())).unwrap() {}
    let (second, _) = again.finish().unwrap();
    let step = MechanicalAngle::from_degrees(1.0);
    let [first, second] = [first, second].map(|calibration| Encoder::new(&paper(), &calibration, step).unwrap());
    for index in 0..1000 {
        let reading = read(&mut construction, f64::from(index));
        let apart = second.decode(reading).angle - first.decode(reading).angle;
        assert!(apart.to_degrees().abs() < 0.01, "{apart}");
    }
}

fn refusal<const HEADS: usize>(imperfections: &Imperfections, shaft: impl FnMut() -> f64) -> calibrate::Error {
    calibrate::<HEADS>(&mut construction(imperfections, 1), shaft, 60_000).unwrap_err()
}

#[test]
fn unfit_runs_are_refused_with_the_reason() {
    let perfect = Imperfections::NONE;
    let short = calibrate::<1>(&mut construction(&perfect, 1), unsteady(1), 20_000);
    assert_eq!(short.unwrap_err(), calibrate::Error::TooShort { turns: 2, of: 4 });
    let speed = |step: f64| {
        let mut angle = 0.0;
        move || {
            angle += step;
            angle
        }
    };
    assert_eq!(refusal::<1>(&imperfect(), speed(STEP * 8.0)), calibrate::Error::TooFast);
    assert_eq!(refusal::<1>(&imperfect(), speed(STEP * 80.0)), calibrate::Error::TooFast);
    let mut number = 0.0_f64;
    let turning_back = move || {
        number += 1.0;
        (number * 1e-4).sin()
    };
    assert_eq!(refusal::<1>(&imperfect(), turning_back), calibrate::Error::Reversed);
    let jerky = refusal::<1>(&Imperfections { eccentricity_mm: 0.0, ..imperfect() }, rippled(0.6, 23.0));
    assert!(matches!(jerky, calibrate::Error::Unsteady { kept, of: 37 } if kept < 28), "{jerky:?}");
}

#[test]
fn unfit_encoders_are_refused_with_the_reason() {
    let first = |degrees: f64| [degrees.to_radians(), 0.0, 0.0, 0.0];
    let bent = Imperfections { harmonics_rad: first(30.0), ..Imperfections::NONE };
    assert!(matches!(refusal::<1>(&bent, unsteady(1)), calibrate::Error::Nonlinear { head: 0, .. }));
    let eccentric = Imperfections { eccentricity_mm: 0.05, ..Imperfections::NONE };
    assert!(matches!(refusal::<1>(&eccentric, unsteady(1)), calibrate::Error::Margin { .. }));
    let very_eccentric = Imperfections { eccentricity_mm: 0.45, ..Imperfections::NONE };
    let refusal = refusal::<2>(&very_eccentric, unsteady(1));
    assert!(matches!(refusal, calibrate::Error::HeadsApart(_)), "{refusal:?}");
}

/// Heads whose outputs are cut off at the ends of the converter's range, and whose own status is not listened to.
#[test]
fn saturated_heads_are_refused() {
    let mut construction = construction(&Imperfections { noise: 1.0, ..Imperfections::NONE }, 1);
    let mut outcome = |amplitude: f64| {
        for head in construction.heads.iter_mut().flatten() {
            head.amplitudes = [amplitude * 2048.0; 2];
        }
        let mut shaft = unsteady(1);
        let mut calibrator = Calibrator::<1>::new(&paper(), &Calibration::ideal(&paper()));
        for _ in 0..60_000 {
            let readings = construction.analog::<1>(shaft()).map(|heads| {
                heads.map(|[sine, cosine]| {
                    let angle = (f64::from(sine) - 2048.0).atan2(f64::from(cosine) - 2048.0);
                    ((angle / TAU * 4096.0).floor().rem_euclid(4096.0) as u16) << 4
                })
            });
            let [reference, vernier] = readings;
            if calibrator.push(Reading { reference, vernier })? {
                break;
            }
        }
        calibrator.finish()
    };
    assert!(outcome(0.98).is_ok());
    assert!(matches!(outcome(1.5).unwrap_err(), calibrate::Error::Saturated { head: 0, .. }));
}
