//! Gains of the speed control that are too large for what is on the shaft, and swing it at rest, at the largest current: a mass
//! was taken off after commissioning, or the shaft has become soft.

use crate::commissioned::{commissioned, here_turns, judge, lift_limits, on_battery, torque_nm};
use crate::known;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use plant::LoadParameters;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};

/// Those as heavy as wheels before anything is mounted: to commission them so many times as heavy takes long.
const SLOW: [&str; 4] = ["hub", "drone-heavy", "paper-heavy", "hoverboard"];

/// A motor that was commissioned with so many times its inertia, on a supply that takes back what braking returns or not.
fn lightened(motor: &Motor, times: f64, battery: bool, commutation: Commutation) -> Rig {
    let mut plant = if battery { on_battery(motor, 5) } else { motor.plant(5) };
    let own_kgm2 = plant.motor.inertia_kgm2;
    plant.motor.inertia_kgm2 *= times;
    let (mut rig, mut settings) = commissioned(motor, &plant, 5);
    if battery {
        lift_limits(&mut settings);
    }
    settings.commutation = commutation;
    rig.configure(&settings).unwrap();
    rig.command(Command::Commutate(commutation)).unwrap();
    rig.plant.set_inertia(own_kgm2).unwrap();
    rig.arm().unwrap();
    rig
}

/// Effective torque over half a second, as a share of that of the largest current.
fn effort(rig: &mut Rig, motor: &Motor) -> f64 {
    let largest_nm = torque_nm(motor, rig.control().unwrap().largest_current_a().into());
    let (mut square, mut count) = (0.0, 0.0);
    rig.run(0.5, |_, period| {
        square += (period.truth.torque_nm / largest_nm).powi(2);
        count += 1.0;
    });
    (square / count).sqrt()
}

/// Twenty seconds after it was told to rest, and then half a second after it was told to turn, to rest again and to go on by
/// a little. At its higher speed the paper's motor still hunts, by less than half of its torque. The short form has two motors.
#[test]
fn a_mass_that_is_taken_off_leaves_no_hum() {
    let motors = MOTORS.iter().filter(|motor| !SLOW.contains(&motor.name)).skip(2).step_by(sim::of(12, 1));
    let commutations = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];
    let jobs = motors.flat_map(|motor| [(6.0, false), (12.0, true)].map(|(times, battery)| (motor, times, battery)));
    let jobs: Vec<_> = jobs.zip(commutations.into_iter().cycle()).collect();
    let rows = jobs.par_iter().map(|&((motor, times, battery), commutation)| {
        let mut rig = lightened(motor, times, battery, commutation);
        let control = *rig.control().unwrap();
        let speed = |share: f32| Command::Speed(control.speed(share * control.largest_speed_rad_s()).unwrap());
        let mut efforts = Vec::new();
        let mut good = true;
        // A rotor that rests would begin to hum with its first motion only.
        for share in [0.1, 0.4] {
            rig.command(speed(share)).unwrap();
            rig.wait(0.5);
        }
        for (share, most) in [(Some(0.0), 0.25), (Some(0.1), 0.25), (Some(0.4), 0.5), (Some(0.0), 0.25), (None, 0.25)] {
            let goal = control.position(here_turns(&rig) + 0.02).unwrap();
            rig.command(share.map_or(Command::Position(goal), speed)).unwrap();
            rig.wait(if efforts.is_empty() { 20.0 } else { 0.5 });
            efforts.push(effort(&mut rig, motor));
            good &= rig.drive.mode() == Mode::Running && efforts.last().is_some_and(|&effort| effort < most);
            if rig.drive.mode() != Mode::Running {
                break;
            }
        }
        let (name, mode) = (motor.name, rig.drive.mode());
        let supply = if battery { "battery" } else { "supply" };
        (format!("{name} ×{times}, {supply}, {commutation:?}: {mode:?}, {efforts:.2?} of the largest torque"), good)
    });
    judge(&rows.collect::<Vec<_>>());
}

/// What hums may have another reason than a rotor that is lighter. With the smallest gains that come of it, and the fastest
/// position control that the settings allow, any rotor still goes where it is told: with an eighth of the gains, some swung
/// by tens of turns. The short form has two motors.
#[test]
fn smaller_gains_swing_no_rotor_that_is_not_lighter() {
    let motors: Vec<_> = MOTORS.iter().filter(|motor| !SLOW.contains(&motor.name)).step_by(sim::of(8, 1)).collect();
    let rows = motors.into_par_iter().map(|motor| {
        let (mut rig, mut settings) = commissioned(motor, &motor.plant(5), 5);
        let control = settings.control.as_mut().unwrap();
        control.position_bandwidth_hz = control.speed_bandwidth_hz / 2.0;
        rig.configure(&settings).unwrap();
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        rig.arm().unwrap();
        rig.command(Command::Speed(rig.control().unwrap().speed(0.0).unwrap())).unwrap();
        (0..5).for_each(|_| rig.command(Command::SlowDown).unwrap());
        let goal = here_turns(&rig) + 0.3;
        rig.command(Command::Position(rig.control().unwrap().position(goal).unwrap())).unwrap();
        rig.wait(4.0);
        let mut away = 0.0_f64;
        rig.run(1.0, |rig, _| away = away.max((here_turns(rig) - goal).abs()));
        let (mode, effort) = (rig.drive.mode(), effort(&mut rig, motor));
        let good = mode == Mode::Running && away < 0.02 && effort < 0.25;
        (format!("{}: {mode:?}, {away:.4} turns away, {effort:.2} of the largest torque", motor.name), good)
    });
    judge(&rows.collect::<Vec<_>>());
}

/// A load on a shaft that twists, of which the settings know nothing: so much of the inertia, swinging against the rotor at
/// so many hertz.
fn on_soft_shaft(motor: &Motor, share: f64, hz: f64, commutation: Commutation) -> Rig {
    let mut plant = motor.plant(5);
    let (_, mut settings) = commissioned(motor, &plant, 5);
    settings.commutation = commutation;
    let load_kgm2 = share * plant.motor.inertia_kgm2;
    plant.motor.inertia_kgm2 -= load_kgm2;
    plant.motor.load = Some(LoadParameters::resonant(plant.motor.inertia_kgm2, load_kgm2, hz, 0.01));
    let mut rig = known::rig(&plant, &settings, 5).unwrap();
    rig.arm().unwrap();
    rig
}

/// Turned to and fro, then told to rest. Most rotors swing then, some farther than a hum, and are calm twenty seconds later,
/// or nearly; nothing is called wrong, but one ends as over-current while it is turned. The short form has two of those that
/// swing far.
#[test]
fn a_soft_shaft_does_not_swing_for_ever() {
    let motors = MOTORS.iter().filter(|motor| !SLOW.contains(&motor.name)).skip(2);
    let jobs = motors.flat_map(|motor| [(0.6, 164.0), (0.4, 250.0)].map(|(share, hz)| (motor, share, hz)));
    let commutations = [Commutation::Sinusoidal, Commutation::Block, Commutation::FieldOriented];
    let jobs = jobs.zip(commutations.into_iter().cycle()).skip(sim::of(1, 0)).step_by(sim::of(5, 1));
    let jobs: Vec<_> = jobs.take(sim::of(2, usize::MAX)).collect();
    let rows = jobs.par_iter().map(|&((motor, share, hz), commutation)| {
        let mut rig = on_soft_shaft(motor, share, hz, commutation);
        let control = *rig.control().unwrap();
        for share in [0.7, -0.7, 0.7, -0.7, 0.7, -0.7, 0.0] {
            let speed = control.speed(share * control.largest_speed_rad_s()).unwrap();
            let _ = rig.command(Command::Speed(speed));
            rig.wait(0.06);
        }
        rig.wait(1.0);
        let before = effort(&mut rig, motor);
        rig.wait(20.0);
        let (name, mode, after) = (motor.name, rig.drive.mode(), effort(&mut rig, motor));
        let text =
            format!("{name}, {share} of the inertia at {hz} Hz, {commutation:?}: {mode:?}, {before:.2}, {after:.2}");
        (text, matches!(mode, Mode::Running | Mode::Faulted(Fault::OverCurrent)) && after < 0.3)
    });
    judge(&rows.collect::<Vec<_>>());
}
