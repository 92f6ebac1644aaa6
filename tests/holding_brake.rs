//! A holding brake, as vertical axes have: closed while nothing is powered, opened when the drive has armed.

use crate::commissioned::{commissioned, here_turns, judge, lift_limits, on_battery, torque_nm};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};
use std::f64::consts::TAU;

/// A commissioned motor whose brake is closed.
fn braked(motor: &Motor, seed: u64) -> Rig {
    let (mut rig, mut settings) = commissioned(motor, &on_battery(motor, seed), seed);
    lift_limits(&mut settings);
    rig.configure(&settings).unwrap();
    rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig
}

#[derive(Clone, Copy, Debug)]
enum Hold {
    Position,
    Still,
}

fn hold(rig: &mut Rig, how: Hold) {
    let control = *rig.control().unwrap();
    let command = match how {
        Hold::Position => Command::Position(control.position(here_turns(rig)).unwrap()),
        Hold::Still => Command::Speed(control.speed(0.0).unwrap()),
    };
    rig.command(command).unwrap();
}

/// Held where it is or at a standstill for 0.2 s, then the brake is opened, and what hangs at the shaft turns it until the
/// current holds it. The short form has four motors.
#[test]
fn a_load_that_a_brake_lets_go_is_no_wrong_commutation() {
    let jobs: Vec<_> = MOTORS
        .iter()
        .step_by(sim::of(5, 1))
        .flat_map(|motor| [-0.3, 0.8].map(|load| (motor, load)))
        .flat_map(|(motor, load)| [Hold::Position, Hold::Still].map(|how| (motor, load, how)))
        .collect();
    let rows = jobs.par_iter().map(|&(motor, load, how)| {
        let mut rig = braked(motor, 3);
        rig.arm().unwrap();
        hold(&mut rig, how);
        rig.wait(0.2);
        let from = rig.plant.truth().mechanical_angle_rad;
        rig.plant.set_load(load * torque_nm(motor, rig.control().unwrap().largest_current_a().into())).unwrap();
        rig.plant.set_dyno(None).unwrap();
        let mut farthest = 0.0_f64;
        rig.run(2.0, |rig, _| farthest = farthest.max((rig.plant.truth().mechanical_angle_rad - from).abs()));
        let still = rig.plant.truth().speed_rad_s.abs() < 0.1 * f64::from(rig.control().unwrap().largest_speed_rad_s());
        let (turns, mode) = (farthest / TAU, rig.drive.mode());
        (format!("{} {load} {how:?}: {mode:?}, {turns:.2} turns", motor.name), still && mode == Mode::Running)
    });
    judge(&rows.collect::<Vec<_>>());
}

/// Off, without a fault, at rest behind the closed brake.
fn rest(rig: &mut Rig, angle_rad: f64) {
    if rig.drive.mode() == Mode::Running {
        rig.command(Command::Disarm).unwrap();
    }
    rig.plant.set_load(0.0).unwrap();
    rig.plant.place(angle_rad, 0.0).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.wait(0.2);
    if rig.drive.mode() != Mode::Ready {
        rig.command(Command::Clear).unwrap();
    }
    rig.wait(0.05);
}

/// Arms with a load at the shaft, opens the brake in the middle of the check, and commands a speed of zero after it. How the
/// check ends, and whether the load is held.
fn open_during_check(motor: &Motor, rig: &mut Rig, load: f64, ms: u32) -> (Mode, Mode, bool) {
    rest(rig, 0.3 + 0.01 * f64::from(ms));
    rig.plant.set_load(load * torque_nm(motor, rig.control().unwrap().largest_current_a().into())).unwrap();
    rig.command(Command::Arm).unwrap();
    rig.wait(1e-3 * f64::from(ms));
    rig.plant.set_dyno(None).unwrap();
    for _ in 0..100 {
        if rig.drive.limits().contains(Limits::CHECKING) {
            rig.wait(0.01);
        }
    }
    let checked = rig.drive.mode();
    if checked == Mode::Running {
        hold(rig, Hold::Still);
        rig.wait(1.0);
    }
    let slow = rig.plant.truth().speed_rad_s.abs() < 0.1 * f64::from(rig.control().unwrap().largest_speed_rad_s());
    let held = slow && rig.drive.mode() == Mode::Running;
    (checked, rig.drive.mode(), held)
}

/// Opened while the drive still checks the rotor, the load falls: that proves nothing, and a speed of zero catches it. The
/// lightest rotors fall faster than their largest speed before. The short form has four motors.
#[test]
fn a_brake_that_opens_during_the_check_is_no_wrong_commutation() {
    let motors: Vec<_> = MOTORS.iter().step_by(sim::of(5, 1)).collect();
    let rows = motors.par_iter().map(|motor| {
        let mut rig = braked(motor, 3);
        let mut ends = Vec::new();
        for load in [-0.6, 0.3, 0.6] {
            for ms in (0..=200).step_by(sim::of(40, 20)) {
                ends.push(open_during_check(motor, &mut rig, load, ms));
            }
        }
        (motor.name, ends)
    });
    let rows: Vec<_> = rows.collect();
    let (mut all, mut dropped) = (0, 0);
    for (name, ends) in rows {
        all += ends.len();
        let bad: Vec<_> = ends.into_iter().filter(|(.., held)| !held).collect();
        println!("{name}: {bad:?}");
        dropped += bad.len();
    }
    println!("{dropped} of {all}");
    assert!(dropped <= sim::of(3, 12), "{dropped} of {all}");
}
