//! Two magnetic rings with 37 and 45 pole pairs to the absolute angle of a shaft, and nothing else.
//!
//! ```console
//! $ cargo run --release --example vernier
//! ```
//!
//! The encoder calibrates itself in a few turns of the shaft, without a reference, and then tells the angle in the turn
//! from the very first sample after power-up.

use core::f64::consts::TAU;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::calibrate::Calibrator;
use hallservo::vernier::continuity::State;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use plant::construction::{Construction, Imperfections, UnsteadyShaft};
use std::error::Error;

/// Samples a turn while calibrating.
const SAMPLES: f64 = 8000.0;

fn main() -> Result<(), Box<dyn Error>> {
    // Rings 0.05 mm off their axis, 2 mm a pole pair, with heads on opposite sides; readings of 12 bits.
    let rings = Rings::new(37, 45, 12)?;
    let imperfect = Imperfections {
        eccentricity_mm: 0.05,
        harmonics_rad: [0.03, 0.03, 0.0, 0.0],
        noise: 1.0,
        ..Imperfections::NONE
    };
    let mut simulated = Construction::new([37, 45], 2.0, 40_f64.to_radians(), 12, &imperfect, 1);
    let mut sample = |shaft_rad| {
        let [reference, vernier] = simulated.digital::<2>(shaft_rad).map(|codes| codes.map(|code| rings.reading(code)));
        Reading { reference, vernier }
    };

    // 1. Turn the shaft, by about 5 % unevenly, until the calibration has seen enough.
    let mut calibrator = Calibrator::new(&rings, &Calibration::ideal(&rings));
    let mut shaft = UnsteadyShaft::new(TAU / SAMPLES, 0.05, 1);
    while !calibrator.push(sample(shaft.turn()))? {}
    let (calibration, report) = calibrator.finish()?;
    println!(
        "largest contradiction of the rings: {:.0} % of what is safe",
        percent(report.worst_residual, report.margin)
    );

    // 2. Power up at a thousand places: the first sample tells where the shaft is.
    let encoder = Encoder::new(&rings, &calibration, MechanicalAngle::from_degrees(1.0))?;
    let zero = encoder.step(&mut State::default(), sample(0.0))?.angle;
    let mut worst = 0.0_f32;
    for place in 0..1000 {
        let truth = TAU * f64::from(place) / 1000.0;
        let first = encoder.step(&mut State::default(), sample(truth))?;
        let error = first.angle - zero - MechanicalAngle::from_radians(truth as f32);
        worst = worst.max(error.to_degrees().abs());
    }
    println!("largest error of 1000 first samples: {worst:.3}°, mechanical");
    assert!(worst < 0.02, "{worst}");
    Ok(())
}

fn percent(part: u32, whole: u32) -> f64 {
    100.0 * f64::from(part) / f64::from(whole)
}
