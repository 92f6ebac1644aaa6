//! A simulated drive with two rings on the shaft.

use super::{ask, done, run, status, wait};
use hallservo_protocol::{Activity, Answer, Ask, EncoderAsk, EncoderCalibration, EncoderStatus, Problem};
use plant::PlantParameters;
use plant::heads::Encoder;
use simulator::flash::Flash;
use simulator::{Simulator, defaults};
use std::f64::consts::TAU;
use std::sync::LazyLock;

const PAIRS: [usize; 2] = [37, 45];
/// Of the rings, mm.
const ECCENTRICITY_MM: f64 = 0.05;

/// A drive with rings, its shaft at an angle.
pub fn powered_up(flash: Flash, shaft_rad: f64, seed: u64) -> Simulator {
    at(&PlantParameters::imperfect(1), flash, shaft_rad, seed)
}

/// The same at another motor.
pub fn at(plant: &PlantParameters, flash: Flash, shaft_rad: f64, seed: u64) -> Simulator {
    let rings = Encoder::new(PAIRS, ECCENTRICITY_MM, 1);
    let mut drive = Simulator::with_rings(defaults(), plant, Some(rings), seed, flash, Vec::new()).unwrap();
    drive.plant.place(shaft_rad, 0.0).unwrap();
    drive
}

pub fn encoder(drive: &mut Simulator) -> EncoderStatus {
    ask(drive, Ask::Encoder(EncoderAsk::Status), |answer| match answer {
        Answer::Encoder(status) => status,
        other => panic!("{other:?}"),
    })
}

pub fn calibrate(drive: &mut Simulator) -> EncoderStatus {
    done(drive, Ask::Encoder(EncoderAsk::Calibrate { by_hand: false }));
    assert_eq!(status(drive).activity, Activity::Encoder);
    wait(drive);
    encoder(drive)
}

/// A flash with everything calibrated, and where the zero is, rad.
pub static CALIBRATED: LazyLock<(Vec<u8>, f64)> = LazyLock::new(|| {
    let mut drive = powered_up(Flash::blank(), 0.3, 1);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    let status = calibrate(&mut drive);
    println!("{status:?}");
    assert!(matches!(status.calibration, EncoderCalibration::Done(_)));
    done(&mut drive, Ask::Encoder(EncoderAsk::Zero));
    let zero_rad = drive.plant.truth().mechanical_angle_rad;
    run(&mut drive, 100);
    assert_eq!(encoder(&mut drive).stored, Problem::None);
    (drive.flash(), zero_rad)
});

pub fn calibrated(shaft_rad: f64, seed: u64) -> Simulator {
    powered_up(Flash::of(CALIBRATED.0.clone()), shaft_rad, seed)
}

/// Mechanical degrees that the position is off, whole turns aside.
pub fn error_deg(drive: &mut Simulator) -> f64 {
    let position = status(drive).position_turns;
    let error = position - (drive.plant.truth().mechanical_angle_rad - CALIBRATED.1) / TAU;
    360.0 * (error - error.round())
}
