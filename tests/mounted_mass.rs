//! A mass that is mounted on the shaft after commissioning, which the settings do not know.

use crate::commissioned::{commissioned, here_turns, judge, motors, torque_nm};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};

/// Those that turn round within a second or two at most. The others are as heavy as wheels before anything is mounted, and
/// one swing with the largest current takes seconds.
const SLOW: [&str; 4] = ["hub", "drone-heavy", "paper-heavy", "hoverboard"];

/// Turns from the goal at most.
const AWAY: f64 = 0.03;

/// A commissioned motor whose inertia is now so many times what it was, and which is asked for so many times the
/// acceleration.
fn loaded(motor: &Motor, times: f64, faster: f32) -> Rig {
    let plant = motor.plant(5);
    let (mut rig, mut settings) = commissioned(motor, &plant, 5);
    let control = settings.control.as_mut().unwrap();
    control.continuous_current_a = control.max_current_a;
    control.max_acceleration_rad_s2 *= faster;
    rig.configure(&settings).unwrap();
    rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    rig.plant.set_inertia(times * plant.motor.inertia_kgm2).unwrap();
    rig
}

/// Goes so many turns on. How far from there it is at most in the last two of twelve seconds, and the effective current.
fn go(rig: &mut Rig, motor: &Motor, turns: f64) -> (f64, f64) {
    let goal = here_turns(rig) + turns;
    rig.command(Command::Position(rig.control().unwrap().position(goal).unwrap())).unwrap();
    rig.wait(10.0);
    let constant = torque_nm(motor, 1.0);
    let (mut away, mut square, mut count) = (0.0_f64, 0.0, 0.0);
    rig.run(2.0, |rig, period| {
        away = away.max((here_turns(rig) - goal).abs());
        square += (period.truth.torque_nm / constant).powi(2);
        count += 1.0;
    });
    (away, (square / count).sqrt())
}

/// With up to twelve times the inertia it comes to rest at its goal, and stays there in the next move, without a current to
/// speak of: light motors swung about it for ever, at the largest current. The short form has two.
#[test]
fn a_mass_that_is_mounted_later_does_not_swing_for_ever() {
    let motors = MOTORS.iter().filter(|motor| !SLOW.contains(&motor.name)).step_by(sim::of(6, 1));
    let jobs: Vec<_> = motors.flat_map(|motor| [4.0, 8.0, 12.0].map(|times| (motor, times))).collect();
    let rows = jobs.par_iter().map(|&(motor, times)| {
        let mut rig = loaded(motor, times, 1.0);
        rig.arm().unwrap();
        let most = f64::from(rig.control().unwrap().largest_current_a());
        let mut good = true;
        let mut text = format!("{} ×{times}:", motor.name);
        for turns in [0.5, -3.0, 0.1] {
            let (away, current) = go(&mut rig, motor, turns);
            good &= rig.drive.mode() == Mode::Running && away < AWAY && current < 0.25 * most;
            text += &format!(" {turns} turns: {:?}, {away:.3} away, {current:.2} of {most} A;", rig.drive.mode());
            if rig.drive.mode() != Mode::Running {
                break;
            }
        }
        (text, good)
    });
    judge(&rows.collect::<Vec<_>>());
}

/// Long moves to and fro against a friction of 0.3 of the torque, as of a machine with gears, are no swing: the eighth
/// takes as long as the first. Friction, too, makes a rotor seem heavier than it is.
#[test]
fn friction_is_no_mass() {
    let names = sim::of("paper", "paper drone-15uh gimbal-7 20ohm direct-drive");
    let rows = motors(names).into_par_iter().map(|motor| {
        let mut rig = loaded(motor, 1.0, 1.2);
        rig.arm().unwrap();
        let control = *rig.control().unwrap();
        let torque = torque_nm(motor, control.largest_current_a().into());
        let fastest = f64::from(control.largest_speed_rad_s());
        let (start, turns) = (here_turns(&rig), 3.0 * fastest / std::f64::consts::TAU);
        let times_s: Vec<_> = (0..8)
            .map(|k| {
                let goal = start + if k % 2 == 0 { turns } else { 0.0 };
                rig.command(Command::Position(control.position(goal).unwrap())).unwrap();
                let (mut time_s, mut arrived_s) = (0.0, 0.0);
                while time_s < 6.0 {
                    let speed = rig.plant.truth().speed_rad_s;
                    rig.plant.set_load(0.3 * torque * (speed / (1e-3 * fastest)).clamp(-1.0, 1.0)).unwrap();
                    rig.wait(5e-4);
                    time_s += 5e-4;
                    if (here_turns(&rig) - goal).abs() > AWAY {
                        arrived_s = time_s;
                    }
                }
                arrived_s
            })
            .collect();
        let good = rig.drive.mode() == Mode::Running && times_s[7] < 1.1 * times_s[1] + 0.05;
        (format!("{}: {:?}, {times_s:.3?} s", motor.name, rig.drive.mode()), good)
    });
    judge(&rows.collect::<Vec<_>>());
}
