//! A mass that is mounted on the shaft after commissioning, which the settings do not know.

use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use rayon::prelude::*;
use rig::Rig;
use rig::commissioning::{Bench, commission};
use rig::motors::{MOTORS, Motor};

/// Those that turn round within a second or two at most. The others are as heavy as wheels before anything is mounted, and
/// one swing with the largest current takes seconds.
const SLOW: [&str; 4] = ["hub", "drone-heavy", "paper-heavy", "hoverboard"];

/// Turns from the goal at most.
const AWAY: f64 = 0.03;

/// A commissioned motor whose inertia is now so many times what it was.
fn loaded(motor: &Motor, times: f64) -> Rig {
    let plant = motor.plant(5);
    let mut bench = Bench::new(Rig::new(&plant, &motor.settings(), 5).unwrap());
    let mut settings = commission(&mut bench, motor.settings(), motor.limit_a).unwrap().settings;
    let mut rig = bench.rig;
    let control = settings.control.as_mut().unwrap();
    control.continuous_current_a = control.max_current_a;
    rig.configure(&settings).unwrap();
    rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    rig.plant.set_inertia(times * plant.motor.inertia_kgm2).unwrap();
    rig
}

fn here(rig: &Rig) -> f64 {
    rig.drive.tracker().position().to_turns() / f64::from(rig.config.pole_pairs.get())
}

/// Goes so many turns on. How far from there it is at most in the last two of twelve seconds, and the effective current.
fn go(rig: &mut Rig, motor: &Motor, turns: f64) -> (f64, f64) {
    let goal = here(rig) + turns;
    rig.command(Command::Position(rig.control().unwrap().position(goal).unwrap())).unwrap();
    rig.wait(10.0);
    let constant = 1.5 * f64::from(motor.pairs) * motor.flux_vs;
    let (mut away, mut square, mut count) = (0.0_f64, 0.0, 0.0);
    rig.run(2.0, |rig, period| {
        away = away.max((here(rig) - goal).abs());
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
        let mut rig = loaded(motor, times);
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
    let rows: Vec<_> = rows.collect();
    for (text, good) in &rows {
        println!("{} {text}", if *good { " " } else { "!" });
    }
    assert!(rows.iter().all(|(_, good)| *good));
}
