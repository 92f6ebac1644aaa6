//! A load on a shaft that twists, against closed formulas.
use crate::common::*;
use plant::{Friction, Legs, LoadParameters, Plant, PlantParameters, Truth};
use std::f64::consts::{PI, TAU};

/// An ideal motor with a load, coasting.
fn with(load: LoadParameters) -> Plant {
    let mut parameters = PlantParameters::ideal();
    parameters.motor.load = Some(load);
    Plant::new(&parameters, 0).unwrap()
}

fn coast(plant: &mut Plant, periods: usize) {
    (0..periods).for_each(|_| plant.advance(&Legs::OFF));
}

fn twist_rad(truth: &Truth) -> f64 {
    truth.mechanical_angle_rad - truth.load_angle_rad
}

/// Kinetic and spring.
fn energy_j(truth: &Truth, load: &LoadParameters) -> f64 {
    let twist = load.twist_rad(twist_rad(truth));
    0.5 * J * truth.speed_rad_s.powi(2)
        + 0.5 * load.inertia_kgm2 * truth.load_speed_rad_s.powi(2)
        + 0.5 * load.stiffness_nm_rad * twist * twist
}

/// Times of the upward zeros of the twist's speed, s.
fn zeros_s(plant: &mut Plant, periods: usize) -> Vec<f64> {
    let mut zeros = Vec::new();
    let mut before = 0.0;
    for _ in 0..periods {
        coast(plant, 1);
        let truth = plant.truth();
        let now = truth.speed_rad_s - truth.load_speed_rad_s;
        if before < 0.0 && now >= 0.0 {
            zeros.push(truth.time_s - plant.period_s() * now / (now - before));
        }
        before = now;
    }
    zeros
}

fn mean_hz(zeros: &[f64]) -> f64 {
    (zeros.len() - 1) as f64 / (zeros[zeros.len() - 1] - zeros[0])
}

/// Free rotor: ω² = k·(1/J + 1/Jl). Locked rotor: ω² = k/Jl, which the rotor's own response has as its antiresonance. The
/// leapfrog is fast by (ω·dt)²/24, 4e-4 at most.
#[test]
fn both_frequencies_are_those_of_the_formula() {
    for (times, hz) in [(0.2, 30.0), (1.0, 300.0), (5.0, 600.0), (2.0, 5000.0)] {
        let load = LoadParameters::resonant(J, times * J, hz, 0.0);
        let mut plant = with(load);
        plant.set_load(1e-2).unwrap();
        coast(&mut plant, 40);
        plant.set_load(0.0).unwrap();
        close(mean_hz(&zeros_s(&mut plant, 12_000)), hz, 1e-3 * hz);
        plant.set_dyno(Some(0.0)).unwrap();
        let locked_hz = (load.stiffness_nm_rad / load.inertia_kgm2).sqrt() / TAU;
        close(locked_hz, hz / (1.0 + times).sqrt(), 1e-9 * hz);
        close(mean_hz(&zeros_s(&mut plant, 12_000)), locked_hz, 1e-3 * hz);
    }
}

/// From swing to swing by exp(−2π·ζ/√(1 − ζ²)); the energy by its square.
#[test]
fn the_swing_decays_by_its_damping_ratio() {
    for (hz, damping) in [(300.0, 0.01), (80.0, 0.05), (2000.0, 0.2)] {
        let load = LoadParameters::resonant(J, 3.0 * J, hz, damping);
        let mut plant = with(load);
        plant.set_load(1e-2).unwrap();
        coast(&mut plant, 20);
        plant.set_load(0.0).unwrap();
        let swing = |plant: &Plant| {
            let (truth, reduced) = (plant.truth(), 0.75 * J);
            let rate = truth.speed_rad_s - truth.load_speed_rad_s;
            0.5 * reduced * rate * rate + 0.5 * load.stiffness_nm_rad * twist_rad(&truth).powi(2)
        };
        let before = swing(&plant);
        // Ten swings.
        let periods = (10.0 * 40e3 / (hz * (1.0 - damping * damping).sqrt())).round();
        coast(&mut plant, periods as usize);
        let expected = (-2.0 * damping * TAU * hz * periods / 40e3).exp();
        close(swing(&plant) / before, expected, 0.01 * expected);
    }
}

/// Undamped, ten thousand swings neither gain nor lose energy, with play or without; momentum is exact.
#[test]
fn undamped_it_keeps_energy_and_momentum() {
    for backlash_rad in [0.0, 0.5 * PI / 180.0] {
        let load = LoadParameters { backlash_rad, ..LoadParameters::resonant(J, 2.0 * J, 400.0, 0.0) };
        let mut plant = with(load);
        plant.set_load(5e-2).unwrap();
        coast(&mut plant, 60);
        plant.set_load(0.0).unwrap();
        let start = plant.truth();
        let momentum = |truth: &Truth| J * truth.speed_rad_s + 2.0 * J * truth.load_speed_rad_s;
        close(momentum(&start), -5e-2 * 60.0 / 40e3, 1e-15);
        let (mut least, mut most) = (f64::MAX, 0.0_f64);
        for _ in 0..1_000_000 {
            coast(&mut plant, 1);
            let energy = energy_j(&plant.truth(), &load);
            (least, most) = (least.min(energy), most.max(energy));
        }
        close(momentum(&plant.truth()), momentum(&start), 1e-12 * momentum(&start).abs() * 1e3);
        let before = energy_j(&start, &load);
        assert!(least > 0.995 * before && most < 1.005 * before, "{backlash_rad}: {least} {before} {most}");
    }
}

/// Work of the load's torque = energy stored + losses, with everything at once.
#[test]
fn energy_balances_with_damping_friction_and_play() {
    let friction = Friction { viscous_nms: 1e-6, coulomb_nm: 1e-3, breakaway_nm: 1.5e-3 };
    let load = LoadParameters { backlash_rad: 0.01, friction, ..LoadParameters::resonant(J, 2.0 * J, 200.0, 0.02) };
    let mut plant = with(load);
    let (mut input, mut lost) = (0.0, 0.0);
    for period in 0..40_000 {
        let load_nm = if period % 4000 < 2000 { 1e-2 } else { -1e-2 };
        plant.set_load(load_nm).unwrap();
        plant.advance_with(&Legs::OFF, |slice| {
            input -= load_nm * slice.load_turned_rad;
            lost += slice.load_lost_j;
        });
    }
    let stored = energy_j(&plant.truth(), &load);
    assert!(lost > 0.0 && input > 1e-3, "{input} {lost}");
    close(input - lost, stored, 1e-3 * input);
}

/// Within the play the load does not feel the rotor; then it takes it along. Turned by hand to and fro, so slowly that
/// it stops where it is let go, the load lags by the play.
#[test]
fn the_play_is_free() {
    let gap = 1.0 * PI / 180.0;
    let friction = Friction { viscous_nms: 0.0, coulomb_nm: 1e-4, breakaway_nm: 1e-4 };
    let load = LoadParameters { backlash_rad: gap, friction, ..LoadParameters::resonant(J, J, 500.0, 0.2) };
    let mut plant = with(load);
    let mut turn = |rad: f64| {
        plant.set_dyno(Some(rad.signum() * 0.02)).unwrap();
        coast(&mut plant, (rad.abs() / 0.02 * 40e3).round() as usize);
        plant.truth()
    };
    let inside = turn(0.49 * gap);
    assert_eq!((inside.load_angle_rad, inside.load_speed_rad_s), (0.0, 0.0));
    let forth = turn(2.0 * gap);
    close(twist_rad(&forth), 0.5 * gap, 0.01 * gap);
    let back = turn(-0.98 * gap);
    close(back.load_angle_rad, forth.load_angle_rad, 0.01 * gap);
    let back = turn(-2.0 * gap);
    close(twist_rad(&back), -0.5 * gap, 0.01 * gap);
}

#[test]
fn what_cannot_be_is_refused() {
    let good = LoadParameters::resonant(J, J, 300.0, 0.01);
    for (load, field) in [
        (LoadParameters { inertia_kgm2: 0.0, ..good }, "motor.load.inertia_kgm2"),
        (LoadParameters { stiffness_nm_rad: f64::NAN, ..good }, "motor.load.stiffness_nm_rad"),
        (LoadParameters { damping_nms_rad: -1.0, ..good }, "motor.load.damping_nms_rad"),
        (LoadParameters { backlash_rad: -1.0, ..good }, "motor.load.backlash_rad"),
        (LoadParameters::resonant(J, J, 50e3, 0.0), "motor.load.stiffness_nm_rad"),
    ] {
        let mut parameters = PlantParameters::ideal();
        parameters.motor.load = Some(load);
        assert_eq!(Plant::new(&parameters, 0).unwrap_err().field, field);
    }
}
