//! A field of constant voltage that turns by itself: what flows is bounded by no resistance.
use crate::common::*;
use plant::{Legs, Plant};
use std::f64::consts::TAU;

/// Turns a field of a voltage by some periods, its speed changing evenly; the largest current of a phase.
fn turn(plant: &mut Plant, angle_rad: &mut f64, volts: f64, hz: [f64; 2], periods: usize) -> f64 {
    let mut largest = 0.0_f64;
    for period in 0..periods {
        let now = hz[0] + (hz[1] - hz[0]) * period as f64 / periods as f64;
        *angle_rad += TAU * now * plant.period_s();
        let duty = |shift: f64| 0.5 + volts / BUS_V * (*angle_rad + shift).cos();
        plant.advance(&Legs::pwm([duty(0.0), duty(-TAU / 3.0), duty(TAU / 3.0)]));
        let currents = plant.truth().currents_a;
        largest = currents.iter().fold(largest, |largest, current| largest.max(current.abs()));
    }
    largest
}

/// It holds the rotor with 3 A. When it turns back while the rotor runs on, the back-EMF adds to it.
#[test]
fn a_field_of_a_voltage_bounds_no_current() {
    let (mut plant, mut angle_rad) = (ideal(), 0.0);
    let volts = 3.0 * R;
    turn(&mut plant, &mut angle_rad, volts, [0.0; 2], 40_000);
    let at_rest = turn(&mut plant, &mut angle_rad, volts, [0.0; 2], 40);
    assert!((at_rest - 3.0).abs() < 0.01, "{at_rest}");
    turn(&mut plant, &mut angle_rad, volts, [0.0, 300.0], 120_000);
    let follows_hz = PAIRS * plant.truth().speed_rad_s / TAU;
    assert!((follows_hz - 300.0).abs() < 10.0, "{follows_hz}");
    let turned_back = turn(&mut plant, &mut angle_rad, volts, [-300.0; 2], 4000);
    assert!((5.0..5.2).contains(&turned_back), "{turned_back}");
}
