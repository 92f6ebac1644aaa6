//! From ADC codes to turns, through a million random accelerations and reversals.

use hallservo::angle::ElectricalAngle;
use hallservo::hall::Codes;
use hallservo::hall::estimate::Estimator;
use hallservo::hall::model::{Model, Sensor};
use hallservo::hall::track::{Config, Tracker};
use plant::Noise;
use std::f64::consts::TAU;

const SAMPLE_HZ: f64 = 40_000.0;
const PLACEMENTS_DEG: [f64; 3] = [0.0, 128.0, 233.0];
const AMPLITUDES: [f64; 3] = [250.0, 180.0, 320.0];
const OFFSETS: [f64; 3] = [2048.0, 2070.0, 2030.0];

fn model() -> Model {
    let sensor = |k: usize| Sensor {
        third: 0.05,
        ..Sensor::sinusoidal(
            OFFSETS[k] as f32,
            AMPLITUDES[k] as f32,
            ElectricalAngle::from_degrees(PLACEMENTS_DEG[k] as f32),
        )
    };
    Model { sensors: [sensor(0), sensor(1), sensor(2)], alignment: ElectricalAngle::ZERO, reversed: false }
}

/// Imperfect sensors with one per cent of noise at 12 bit.
fn codes(turns: f64, noise: &mut Noise) -> Codes {
    [0, 1, 2].map(|k| {
        let x = TAU * (turns.fract() - PLACEMENTS_DEG[k] / 360.0);
        let sine = x.sin();
        let third = 0.05 * sine * (3.0 - 4.0 * sine * sine);
        (OFFSETS[k] + AMPLITUDES[k] * (sine + third + noise.scaled(0.01))).round() as u16
    })
}

#[test]
fn no_turn_is_lost_in_a_million_accelerations_and_reversals() {
    let estimator = Estimator::new(&model(), 12).unwrap();
    let config = Config::new(4, ElectricalAngle::from_degrees(38.0), 1.5).unwrap();
    let mut noise = Noise::new(9);
    let mut tracker = Tracker::at(ElectricalAngle::ZERO);
    let (mut turns, mut speed, mut reversals, mut fastest) = (0.0_f64, 0.0_f64, 0, 0.0_f64);
    for _ in 0..1_000_000 {
        // From any speed to any other up to 2 kHz electrical, within 25 µs to 0.25 ms.
        let target = 2000.0 / SAMPLE_HZ * noise.uniform();
        let samples = 1.0 + (5.0 * (1.0 + noise.uniform())).floor();
        reversals += u32::from(target * speed < 0.0);
        let acceleration = (target - speed) / samples;
        for _ in 0..samples as u32 {
            speed += acceleration;
            turns += speed;
            let angle = estimator.angle(&codes(turns, &mut noise)).unwrap();
            tracker.step(&config, angle).unwrap();
        }
        fastest = fastest.max(speed.abs() * SAMPLE_HZ);
        let error = tracker.position().to_turns() - turns;
        assert!(error.abs() < 4.0 / 360.0, "{error}");
    }
    println!("{reversals} reversals, up to {fastest:.0} Hz");
    assert!(reversals > 400_000 && fastest > 1990.0);
}
