//! What the tests share: an idealised drive that knows the truth, and Fourier sums.

use plant::{Leg, Legs, Plant, PlantParameters, Slice};
use std::f64::consts::{PI, TAU};

pub const BUS_V: f64 = 24.0;
pub const R: f64 = 3.75;
pub const L: f64 = 0.36e-3;
pub const TAU_E: f64 = L / R;
pub const FLUX: f64 = 5e-3;
pub const PAIRS: f64 = 4.0;
pub const J: f64 = 1e-5;

pub fn ideal() -> Plant {
    Plant::new(&PlantParameters::ideal(), 0).unwrap()
}

/// Duties that put a voltage of this amplitude on the q axis (a quarter turn ahead of the flux)
/// during the period after next, where a preloaded command acts.
pub fn on_q_axis(plant: &Plant, amplitude_v: f64) -> Legs {
    let truth = plant.truth();
    let delay = 1.5 * plant.period_s() * PAIRS * truth.speed_rad_s;
    let angle = truth.electrical_angle_rad + delay;
    let duty = |shift: f64| 0.5 - amplitude_v / truth.bus_v * (angle + shift).sin();
    Legs::pwm([duty(0.0), duty(-TAU / 3.0), duty(TAU / 3.0)])
}

/// Loads a constant command and lets it act for some periods.
pub fn hold(plant: &mut Plant, legs: Legs, periods: usize) {
    for _ in 0..=periods {
        plant.advance(&legs);
    }
}

/// One leg high, one low, one open.
pub fn two_of_three(high: usize, low: usize, duty: f64) -> Legs {
    let mut legs = [Leg::Open; 3];
    legs[high] = Leg::Pwm(duty);
    legs[low] = Leg::Pwm(0.0);
    Legs::new(legs)
}

/// Sine and cosine coefficients of a harmonic over one turn.
pub fn fourier(of: impl Fn(f64) -> f64, harmonic: f64) -> (f64, f64) {
    let n = 7200;
    let (mut sin, mut cos) = (0.0, 0.0);
    for i in 0..n {
        let angle = TAU * (i as f64 + 0.5) / n as f64;
        let value = of(angle);
        sin += value * (harmonic * angle).sin();
        cos += value * (harmonic * angle).cos();
    }
    (2.0 * sin / n as f64, 2.0 * cos / n as f64)
}

pub fn deg(angle_rad: f64) -> f64 {
    angle_rad * 180.0 / PI
}

pub fn last(plant: &Plant) -> Slice {
    plant.truth().last.unwrap()
}

#[track_caller]
pub fn close(value: f64, expected: f64, tolerance: f64) {
    assert!((value - expected).abs() <= tolerance, "{value} is not {expected} ± {tolerance}");
}
