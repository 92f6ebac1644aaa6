//! The vernier's self-calibration: what it makes of imperfect encoders on an unsteady shaft, and what it refuses.

use core::f64::consts::TAU;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::calibrate::{Calibrator, Refusal, Report};
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

type Outcome<const HEADS: usize> = Result<(Calibration<HEADS>, Report), Refusal>;

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

#[test]
fn opposite_heads_on_an_unsteady_shaft() {
    for seed in 0..5 {
        let mut construction = construction(&imperfect(), seed);
        for direction in [1.0, -1.0] {
            let mut shaft = UnsteadyShaft::new(direction * STEP, 0.05, seed);
            let (calibration, report) = calibrate::<2>(&mut construction, || shaft.turn(), 60_000).unwrap();
            let (wrong, rms, largest) = errors(&mut construction, &calibration);
            println!("{seed} {direction}: {report:?} {wrong} {rms} {largest}");
            assert_eq!(wrong, 0);
            assert!(rms < 0.005 && largest < 0.02, "{rms} {largest}");
        }
    }
}
