//! Windings and back-EMF against closed formulas.
use crate::common::*;
use plant::{BackEmf, Leg, Legs, PhaseSequence, Plant, PlantParameters, Shape};
use std::f64::consts::{PI, TAU};

/// The solution over a step is exact, so only rounding is allowed.
#[test]
fn locked_rotor_step_is_exponential() {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    let legs = Legs::pwm([0.5, 0.2, 0.2]);
    plant.advance(&legs); // loads it
    let settled = 0.3 * BUS_V / (1.5 * R);
    for period in 1..=40 {
        plant.advance(&legs);
        let grown = 1.0 - (-f64::from(period) * plant.period_s() / TAU_E).exp();
        let [a, b, c] = plant.truth().currents_a;
        close(a, settled * grown, 1e-12);
        close(b, -0.5 * settled * grown, 1e-12);
        close(c, -0.5 * settled * grown, 1e-12);
    }
}

#[test]
fn stall_currents() {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    hold(&mut plant, two_of_three(0, 1, 1.0), 400);
    let [a, b, c] = plant.truth().currents_a;
    close(a, BUS_V / (2.0 * R), 1e-12);
    close(b, -BUS_V / (2.0 * R), 1e-12);
    assert_eq!(c, 0.0);
    hold(&mut plant, Legs::pwm([1.0, 0.0, 0.0]), 400);
    close(plant.truth().currents_a[0], BUS_V / (1.5 * R), 1e-12);
}

/// The same flux makes voltage and torque: e·i = T·ω holds as an identity, up to rounding.
#[test]
fn torque_constant_is_the_voltage_constant() {
    let mut parameters = PlantParameters::ideal();
    for (shape, fifth) in
        [(Shape::Sinusoidal, 0.0), (Shape::Sinusoidal, 0.04), (Shape::Trapezoidal { flat_deg: 120.0 }, -0.02)]
    {
        parameters.motor.back_emf.shape = shape;
        parameters.motor.back_emf.fifth = fifth;
        let mut plant = Plant::new(&parameters, 0).unwrap();
        for i in 0..200 {
            plant.set_dyno(Some(37.0 + f64::from(i))).unwrap();
            plant.advance(&on_q_axis(&plant, 8.0));
            let truth = plant.truth();
            let electrical: f64 = (0..3).map(|k| truth.back_emf_v[k] * truth.currents_a[k]).sum();
            close(electrical, truth.torque_nm * truth.speed_rad_s, 1e-12);
        }
    }
    // And in numbers: a sinusoidal machine gives 1.5·p·λ per ampere on the q axis.
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    plant.place(PI / 2.0 / PAIRS, 0.0).unwrap();
    hold(&mut plant, Legs::pwm([0.4, 0.6, 0.6]), 400);
    let truth = plant.truth();
    close(truth.torque_nm / -truth.currents_a[0], 1.5 * PAIRS * FLUX, 1e-12);
}

fn emf_of(back_emf: BackEmf, phase: usize, harmonic: f64) -> (f64, f64) {
    let mut parameters = PlantParameters::ideal();
    parameters.motor.back_emf = back_emf;
    let plant = Plant::new(&parameters, 0).unwrap();
    let at = |angle: f64| {
        let mut plant = plant.clone();
        plant.place(angle / PAIRS, 100.0).unwrap();
        plant.truth().back_emf_v[phase] / (100.0 * PAIRS * FLUX)
    };
    fourier(at, harmonic)
}

/// e_A = -λωe sin θe with the harmonics locked to it; B and C a third of a turn behind each.
/// The sums are exact for sinusoids: only rounding.
#[test]
fn back_emf_harmonics_are_as_asked() {
    let back_emf = BackEmf { third: 0.03, fifth: 0.05, seventh: -0.02, ..BackEmf::sinusoidal(FLUX) };
    for (harmonic, height) in [(1.0, 1.0), (2.0, 0.0), (3.0, 0.03), (5.0, 0.05), (7.0, -0.02), (9.0, 0.0)] {
        for (phase, lag) in [(0, 0.0), (1, TAU / 3.0), (2, -TAU / 3.0)] {
            let (sin, cos) = emf_of(back_emf, phase, harmonic);
            close(sin, -height * (harmonic * lag).cos(), 1e-12);
            close(cos, height * (harmonic * lag).sin(), 1e-12);
        }
    }
    let swapped = BackEmf { sequence: PhaseSequence::Acb, ..back_emf };
    assert_eq!(emf_of(swapped, 1, 5.0), emf_of(back_emf, 2, 5.0));
}

/// A trapezoid with flanks of r to each side of its zeros has b_n = 4 sin(n·r)/(π·r·n²) (odd n).
/// The sum over 7200 points resolves its corners to 1e-6.
#[test]
fn trapezoid_has_its_fourier_series() {
    for flat_deg in [0.0, 90.0, 120.0, 170.0] {
        let flank = (180.0 - flat_deg) * PI / 360.0;
        let back_emf = BackEmf { shape: Shape::Trapezoidal { flat_deg }, ..BackEmf::sinusoidal(FLUX) };
        for n in [1.0, 3.0, 5.0, 7.0] {
            let expected = 4.0 * (n * flank).sin() / (PI * flank * n * n);
            let (sin, cos) = emf_of(back_emf, 0, n);
            close(sin, -expected, 2e-6);
            close(cos, 0.0, 1e-9);
        }
    }
}

/// At 2 rad/s the back-EMF (40 mV) disturbs the current of 1.6 A by 0.3 %, which sets the
/// tolerance; the first millisecond of each step is the commutation and is left out.
#[test]
fn six_step_ripple_is_14_percent_of_the_mean() {
    let mut plant = ideal();
    plant.set_dyno(Some(2.0)).unwrap();
    let (mut most, mut least, mut sum, mut count) = (0.0f64, f64::MAX, 0.0, 0.0);
    let mut settled = 0;
    let mut before = usize::MAX;
    for _ in 0..(TAU / PAIRS / 2.0 / plant.period_s()) as usize {
        // Best pair: the EMF of `high` less that of `low` within 30° of its peak.
        let angle = plant.truth().electrical_angle_rad.rem_euclid(TAU);
        let sector = ((angle + PI / 3.0 - PI / 6.0) / (PI / 3.0)) as usize % 6;
        let (high, low) = [(1, 2), (1, 0), (2, 0), (2, 1), (0, 1), (0, 2)][sector];
        plant.advance(&two_of_three(high, low, 0.5));
        settled = if sector == before { settled + 1 } else { 0 };
        before = sector;
        if settled > 40 {
            let torque = plant.truth().torque_nm;
            most = most.max(torque);
            least = least.min(torque);
            sum += torque;
            count += 1.0;
        }
    }
    // (√3 - 3/2) / (√3·3/π)
    let expected = (3f64.sqrt() - 1.5) / (3f64.sqrt() * 3.0 / PI);
    close(expected, 0.1403, 1e-4);
    close((most - least) / (sum / count), expected, 0.003);
    close(sum / count, 1.6 * PAIRS * FLUX * 3f64.sqrt() * 3.0 / PI, 3e-4);
}

/// A→C carries V/2R when C is opened and B takes over: C's current dies through the upper diode
/// against V/3R, in τ·ln 2.5, then the terminal floats at the star point. The instant within a
/// step is exact: only rounding.
#[test]
fn an_opened_phase_freewheels_and_then_floats() {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    hold(&mut plant, two_of_three(0, 2, 1.0), 400);
    let legs = two_of_three(0, 1, 1.0);
    plant.advance(&legs);
    let (start, target) = (-BUS_V / (2.0 * R), BUS_V / (3.0 * R));
    let extinct_s = TAU_E * 2.5f64.ln();
    close(extinct_s / plant.period_s(), 3.5, 0.1); // in the middle of a step
    for period in 1..=10 {
        plant.advance(&legs);
        let time_s = f64::from(period) * plant.period_s();
        let current = plant.truth().currents_a[2];
        if time_s < extinct_s {
            close(current, target + (start - target) * (-time_s / TAU_E).exp(), 1e-12);
        } else {
            assert_eq!(current, 0.0);
        }
    }
    close(last(&plant).terminals_v[2], BUS_V / 2.0, 1e-9);
    let sum: f64 = plant.truth().currents_a.iter().sum();
    close(sum, 0.0, 1e-12);
}

/// The terminal of a floating phase shows the star point plus its back-EMF: what a sensorless
/// drive would look at.
#[test]
fn a_floating_terminal_shows_the_back_emf() {
    let mut plant = ideal();
    plant.set_dyno(Some(50.0)).unwrap();
    hold(&mut plant, two_of_three(0, 1, 0.5), 2);
    for _ in 0..2000 {
        plant.advance(&two_of_three(0, 1, 0.5));
        let slice = last(&plant);
        assert_eq!(slice.currents_a[2], 0.0);
        let star = 0.5 * (12.0 - slice.back_emf_v[0] - slice.back_emf_v[1]);
        close(slice.terminals_v[2], star + slice.back_emf_v[2], 1e-9);
    }
}

/// Off, a turning motor carries no current until the line-to-line EMF exceeds the bus; then it
/// feeds the bus through the diodes and brakes.
#[test]
fn coasting_rectifies_only_above_the_bus_voltage() {
    let mut plant = ideal();
    let limit = BUS_V / (3f64.sqrt() * FLUX * PAIRS);
    plant.set_dyno(Some(0.99 * limit)).unwrap();
    for _ in 0..2000 {
        plant.advance(&Legs::OFF);
        assert_eq!(plant.truth().currents_a, [0.0; 3]);
    }
    plant.set_dyno(Some(1.5 * limit)).unwrap();
    let (mut torque, mut bus) = (0.0, 0.0);
    for _ in 0..2000 {
        plant.advance(&Legs::OFF);
        let slice = last(&plant);
        torque += slice.torque_nm;
        bus += slice.bus_a;
        assert!(slice.terminals_v.iter().all(|v| (-1e-9..=24.0 + 1e-9).contains(v)));
    }
    assert!(torque / 2000.0 < -0.01 && bus / 2000.0 < -0.3);
    // Power into the bus is the braking power less the loss in the windings.
    assert!(-bus * BUS_V < -torque * 1.5 * limit);
}

/// A command acts in the period after the one it is given in; off acts at once and lasts until a
/// command has been loaded again.
#[test]
fn commands_act_one_period_later_and_off_at_once() {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    plant.advance(&Legs::pwm([0.5, 0.2, 0.2]));
    assert_eq!(plant.truth().currents_a, [0.0; 3]);
    plant.advance(&Legs::pwm([0.0, 0.5, 0.5]));
    close(last(&plant).terminals_v[0], 12.0, 0.0);
    plant.advance(&Legs::OFF);
    assert!(last(&plant).bus_a < 0.0); // freewheels into the bus
    plant.advance(&Legs::new([Leg::Pwm(0.3), Leg::Pwm(f64::NAN), Leg::Pwm(7.0)]));
    assert_ne!(last(&plant).terminals_v[0], 0.3 * BUS_V);
    plant.advance(&Legs::OFF);
    plant.advance(&Legs::new([Leg::Pwm(0.3), Leg::Pwm(f64::NAN), Leg::Pwm(7.0)]));
    plant.advance(&Legs::pwm([0.5; 3]));
    let volts = last(&plant).terminals_v;
    close(volts[0], 0.3 * BUS_V, 1e-12);
    assert_eq!((volts[1], volts[2]), (0.0, BUS_V));
}
