//! Impedance control at simulated motors: stiffness and damping as commanded, and passive at a hard wall, whatever rotor,
//! load and bearings.

use hallservo::commutation::Commutation;
use hallservo::control::impedance::{Motion, Request};
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{Friction, PlantParameters};
use rayon::prelude::*;
use sim::rig::Rig;
use std::f64::consts::{PI, TAU};

/// Rotors that are tried.
const ROTORS: u64 = 8;

fn settings(inertia_kgm2: f64) -> Settings {
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control = Control { guard, inertia_kgm2: inertia_kgm2 as f32, ..Control::default() };
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

/// The imperfect motor with a seed of its own, and so many times its inertia; without friction on request, which would
/// damp by itself.
fn rotor(seed: u64, load: f64, friction: bool) -> PlantParameters {
    let mut plant = PlantParameters::imperfect(seed);
    plant.motor.inertia_kgm2 *= load;
    if !friction {
        plant.motor.friction = Friction::NONE;
    }
    plant
}

/// Calibrated and armed. The settings know `known` times the inertia of the bare rotor. A rotor without friction gets its
/// bearings' for the calibration by a plant of its own.
fn armed(seed: u64, load: f64, known: f64, friction: bool) -> Rig {
    let bare = PlantParameters::imperfect(seed).motor.inertia_kgm2;
    let settings = settings(known * bare);
    let mut with_friction = Rig::new(&rotor(seed, 1.0, true), &settings, seed).unwrap();
    let model = with_friction.calibrate(|_| ()).unwrap().model;
    let mut rig = Rig::new(&rotor(seed, load, friction), &settings, seed).unwrap();
    rig.run(0.02, |_, _| ());
    rig.service.install(&model).unwrap();
    rig.run(0.02, |_, _| ());
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.command(Command::Arm).unwrap();
    rig.plant.set_dyno(None).unwrap();
    while rig.drive.limits().contains(hallservo::fault::Limits::CHECKING) {
        rig.step();
    }
    rig
}

fn follow(rig: &mut Rig, request: &Request) {
    let impedance = rig.config.impedance(request).unwrap_or_else(|error| panic!("{error}"));
    rig.command(Command::Impedance(Box::leak(Box::new(impedance)))).unwrap();
}

fn here_turns(rig: &Rig) -> f64 {
    rig.drive.tracker().position().to_turns() / f64::from(rig.config.pole_pairs.get())
}

/// A spring at a place in turns, at once.
fn spring(kp: f64, kd: f64, turns: f64) -> Request {
    Request {
        kp_nm_rad: Some(kp as f32),
        kd_nms_rad: Some(kd as f32),
        motion: Motion::To {
            position_turns: Some(turns),
            speed_rad_s: 0.0,
            stop_turns: None,
            max_speed_rad_s: Some(f32::INFINITY),
            max_acceleration_rad_s2: Some(f32::INFINITY),
        },
        ..Request::default()
    }
}

/// The largest gains that a rig takes.
fn largest(rig: &Rig) -> [f64; 2] {
    let gains = rig.config.largest_impedance().unwrap();
    [f64::from(gains.kp_nm_rad), f64::from(gains.kd_nms_rad)]
}

/// Worst of the rotors.
fn worst(figure: impl Fn(u64) -> f64 + Send + Sync) -> f64 {
    (1..=ROTORS).into_par_iter().map(figure).reduce(|| 0.0, f64::max)
}

#[test]
fn the_stiffness_is_as_commanded() {
    for share in [0.05, 0.3] {
        let error = worst(|seed| {
            let mut rig = armed(seed, 1.0, 1.0, true);
            let kp = share * largest(&rig)[0];
            let origin = rig.plant.truth().mechanical_angle_rad;
            let turns = here_turns(&rig);
            follow(&mut rig, &spring(kp, 0.0, turns));
            // Slowly there and back through ± 0.3 rad, or as far as three quarters of the largest torque reach.
            let most = (0.75 * 0.09 / kp).min(0.3);
            let slope = |rig: &mut Rig, speed: f64| {
                let (mut products, mut squares, mut torques, mut angles, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
                rig.plant.set_dyno(Some(speed)).unwrap();
                rig.run(2.0 * most / speed.abs(), |_, period| {
                    let angle = period.truth.mechanical_angle_rad - origin;
                    let torque = period.truth.torque_nm;
                    (products, squares) = (products + angle * torque, squares + angle * angle);
                    (torques, angles, count) = (torques + torque, angles + angle, count + 1.0);
                });
                (products - angles * torques / count) / (squares - angles * angles / count)
            };
            rig.plant.set_dyno(Some(-1.0)).unwrap();
            rig.run(most, |_, _| ());
            let stiffness = [1.0, -1.0].map(|speed| -slope(&mut rig, speed));
            assert_eq!(rig.drive.mode(), Mode::Running);
            stiffness.map(|found| (found / kp - 1.0).abs()).into_iter().fold(0.0, f64::max)
        });
        println!("kp {share} of the largest: worst error of the stiffness {:.2} %", 100.0 * error);
        assert!(error < 0.03, "{share}: {error}");
    }
}

#[test]
fn the_damping_is_as_commanded() {
    // Shares of the largest kp and kd; Hz.
    for (kp, kd, hz) in [(0.0, 0.2, 5.0), (0.3, 0.3, 5.0), (0.3, 0.8, 5.0), (0.8, 0.2, 10.0), (0.05, 0.5, 15.0)] {
        let error = worst(|seed| {
            let mut rig = armed(seed, 1.0, 1.0, true);
            let most = largest(&rig);
            let (kp, kd) = (kp * most[0], kd * most[1]);
            let turns = here_turns(&rig);
            follow(&mut rig, &spring(kp, kd, turns));
            // Half of the largest torque, at most half a radian.
            let omega = TAU * hz;
            let amplitude = (0.045 / kp.hypot(kd * omega)).min(0.5);
            let (mut work, cycles) = (0.0, 6);
            let steps = rig.periods(1.0 / hz);
            for k in 0..steps * (cycles + 1) {
                let speed = amplitude * omega * (omega * f64::from(k) * rig.period_s()).cos();
                rig.plant.set_dyno(Some(speed)).unwrap();
                let period = rig.step();
                if k >= steps {
                    work -= period.truth.torque_nm * speed * rig.period_s();
                }
                if k % 40 == 0 {
                    rig.serve();
                }
            }
            assert_eq!(rig.drive.mode(), Mode::Running);
            let damping = work / f64::from(cycles) / (PI * omega * amplitude * amplitude);
            (damping / kd - 1.0).abs()
        });
        println!("kp {kp}, kd {kd} of the largest, {hz} Hz: worst error of the damping {:.2} %", 100.0 * error);
        assert!(error < 0.05, "{kp} {kd} {hz}: {error}");
    }
}

/// Energies at a wall: rotor, spring and wall; the largest of each tenth of a second.
fn impact(rig: &mut Rig, load: f64, kp: f64, kd: f64, wall_nm_rad: f64) -> Vec<f64> {
    let origin = rig.plant.truth().mechanical_angle_rad;
    let inertia = load * PlantParameters::imperfect(1).motor.inertia_kgm2;
    let turns = here_turns(rig);
    // The reference lies 0.15 rad behind the wall, or what half of the largest torque makes.
    let behind = (0.045 / kp).min(0.15);
    follow(rig, &spring(kp, kd, turns + (behind + 0.2) / TAU));
    let mut most = vec![0.0_f64; 12];
    let steps = rig.periods(1.2);
    for k in 0..steps {
        let truth = rig.plant.truth();
        let angle = truth.mechanical_angle_rad - origin;
        // In the middle of the coming period: held over it, a wall would give energy away.
        let depth = angle + 0.5 * rig.period_s() * truth.speed_rad_s - 0.2;
        rig.plant.set_load(wall_nm_rad * depth.max(0.0)).unwrap();
        // Against rest at the wall.
        let rest = kp * behind / (kp + wall_nm_rad);
        let depth = angle - 0.2;
        let energy = |depth: f64| 0.5 * wall_nm_rad * depth.max(0.0).powi(2) + 0.5 * kp * (behind - depth).powi(2);
        let total = 0.5 * inertia * truth.speed_rad_s.powi(2) + energy(depth) - energy(rest);
        let window = (k * 12 / steps) as usize;
        most[window] = most[window].max(total);
        rig.step();
        if k % 40 == 0 {
            rig.serve();
        }
    }
    assert_eq!(rig.drive.mode(), Mode::Running);
    rig.plant.set_load(0.0).unwrap();
    most
}

/// Whether the energy at a wall never grows, and what is left of it is no limit cycle: less than a hundredth, or what
/// noise and cogging do.
fn is_passive(most: &[f64]) -> bool {
    let floor = 2e-5;
    let grows = most.windows(2).any(|pair| pair[1] > 1.02 * pair[0] + floor);
    !grows && most[11] < (0.01 * most[0]).max(floor)
}

fn shown(energies: &[f64]) -> String {
    energies.iter().map(|energy| format!("{energy:.0e} ")).collect()
}

#[test]
#[ignore = "a search, for the figures"]
fn stiffest_wall() {
    for load in [1.0, 3.0, 10.0] {
        for (kp, kd) in [(0.2, 0.2), (0.2, 0.5), (0.2, 0.9), (0.8, 0.9)] {
            for wall in [0.3, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 50.0, 200.0] {
                let mut rig = armed(1, load, 1.0, false);
                let [most_kp, most_kd] = largest(&rig);
                let energies = impact(&mut rig, load, kp * most_kp, kd * most_kd, wall);
                println!("load {load} kp {kp} kd {kd} wall {wall}: {} {}", is_passive(&energies), shown(&energies));
            }
        }
    }
}
