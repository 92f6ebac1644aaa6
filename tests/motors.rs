//! Other motors and converters than the paper's, each calibrated and turned as it is.

use hallservo::hall::calibrate::Finding;
use hallservo::settings::Settings;
use plant::{AdcParameters, BackEmf, PlantParameters, Shape};
use rig::{Rig, error_deg};
use sim::statistics::Statistics;

/// RMS error of the tracked angle at a constant command, and the electrical turns made.
fn turn(plant: &PlantParameters, settings: &Settings, modulation: f64) -> (f64, f64) {
    let mut rig = Rig::new(plant, settings, 5).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    rig.drive_with(modulation).unwrap();
    let start = rig.plant.truth().mechanical_angle_rad;
    let (settle, periods) = (rig.periods(0.6), rig.periods(0.4));
    let mut errors = Statistics::default();
    for k in 0..settle + periods {
        let period = rig.step();
        if k > settle {
            errors.push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
        }
        if k % 40 == 0 {
            rig.serve();
        }
    }
    let turns = (rig.plant.truth().mechanical_angle_rad - start) / std::f64::consts::TAU;
    (errors.rms(), turns * f64::from(plant.motor.pole_pairs))
}

#[test]
fn any_number_of_pole_pairs() {
    for pole_pairs in [1, 2, 3, 7, 14, 21, 40, 64] {
        let plant = PlantParameters::imperfect(3).with_pole_pairs(pole_pairs);
        // Away from the resonance of rotor and field: many poles make a stiff spring and a small angle between them.
        let calibration_hz = if pole_pairs < 2 {
            5.0
        } else if pole_pairs < 20 {
            10.0
        } else {
            20.0
        };
        let settings = Settings { pole_pairs, calibration_hz, ..Settings::default() };
        for modulation in [0.15, -0.15] {
            let (rms, turns) = turn(&plant, &settings, modulation);
            println!("{pole_pairs} pole pairs, {modulation}: {rms:.3}° RMS, {turns:.0} turns");
            assert!(rms < 0.3, "{pole_pairs}: {rms}");
            assert!(turns * modulation.signum() > 2.0, "{pole_pairs}: {turns}");
        }
    }
}

#[test]
fn a_calibration_in_resonance_says_so() {
    let mut plant = PlantParameters::imperfect(3);
    plant.motor.cogging[0].amplitude_nm *= 1.5;
    let settings = Settings { calibration_hz: 2.5, ..Settings::default() };
    let calibration = Rig::new(&plant, &settings, 5).unwrap().calibrate(|_| ()).unwrap();
    assert!(calibration.report.findings().any(|finding| matches!(finding, Finding::Hunting(_))), "{calibration:?}");
}

#[test]
fn a_trapezoidal_back_emf() {
    let mut plant = PlantParameters::imperfect(4);
    plant.motor.back_emf = BackEmf { shape: Shape::Trapezoidal { flat_deg: 120.0 }, ..plant.motor.back_emf };
    let (rms, turns) = turn(&plant, &Settings::default(), 0.3);
    assert!(rms < 0.3 && turns > 20.0, "{rms} {turns}");
}

#[test]
fn converters_from_ten_to_sixteen_bits() {
    for adc_bits in [10, 12, 14, 16] {
        let mut plant = PlantParameters::imperfect(6);
        plant.adc = AdcParameters { bits: adc_bits, ..plant.adc };
        // The 500 codes of 12 bit are 125 of 10 bit, which a person is told of, but which works.
        let (rms, turns) = turn(&plant, &Settings { adc_bits, ..Settings::default() }, 0.2);
        println!("{adc_bits} bits: {rms:.3}° RMS");
        assert!(rms < 0.3 && turns > 20.0, "{adc_bits}: {rms} {turns}");
    }
}

#[test]
fn turning_against_the_phases() {
    let plant = PlantParameters::imperfect(7);
    let [forward, reversed] =
        [false, true].map(|reversed| turn(&plant, &Settings { reversed, ..Settings::default() }, 0.2).1);
    assert!(forward > 20.0 && (reversed / forward + 1.0).abs() < 0.1, "{forward} {reversed}");
}
