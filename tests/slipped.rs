//! What the Halls see turns on the shaft while the motor runs, or the Halls' board about it: a joint that fails. All three
//! signals stay as good as they were.

use crate::commissioned::{commissioned, here_turns, motors, on_battery};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::Motor;

/// What the motor does meanwhile: shares of its largest speed and current.
#[derive(Clone, Copy, Debug)]
enum Does {
    Rest,
    Speed(f32),
    Torque(f32),
}

/// One slip of a motor.
#[derive(Clone, Copy, Debug)]
struct Slip {
    commutation: Commutation,
    does: Does,
    over_s: f64,
    degrees: f64,
}

/// What came of it.
#[derive(Debug)]
struct Outcome {
    end: Mode,
    /// Fastest against the command, or at all where the motor is to stand still, as a share of the largest speed.
    wrong_share: f64,
    /// Farthest the wrong way, turns.
    wrong_turns: f64,
}

fn slips() -> Vec<Slip> {
    let does = [Does::Rest, Does::Speed(0.02), Does::Speed(0.3), Does::Torque(0.25), Does::Torque(0.06)];
    let mut slips = Vec::new();
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal] {
        for does in does {
            for over_s in [2e-4, 0.5] {
                for degrees in sim::of(&[-150.0, 180.0][..], &[-100.0, 120.0, -150.0, 180.0]) {
                    slips.push(Slip { commutation, does, over_s, degrees: *degrees });
                }
            }
        }
    }
    slips
}

/// Glued together again, at rest, and armed.
fn mend(rig: &mut Rig, commutation: Commutation) {
    // What its alignment was trimmed by is forgotten with a fault.
    if rig.drive.mode() == Mode::Running {
        rig.command(Command::Trip(Fault::Stall)).unwrap();
    }
    if matches!(rig.drive.mode(), Mode::Faulted(_)) {
        rig.command(Command::Clear).unwrap();
    }
    rig.plant.set_slip(0.0).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.wait(0.2);
    rig.plant.set_dyno(None).unwrap();
    rig.command(Command::Commutate(commutation)).unwrap();
    rig.command(Command::Arm).unwrap();
    rig.wait(0.9);
}

fn outcome(rig: &mut Rig, [largest_rad_s, largest_a]: [f32; 2], slip: Slip) -> Outcome {
    mend(rig, slip.commutation);
    let control = *rig.control().unwrap();
    let (command, sign) = match slip.does {
        Does::Rest => (Command::Position(control.position(here_turns(rig)).unwrap()), 0.0),
        Does::Speed(share) => (Command::Speed(control.speed(share * largest_rad_s).unwrap()), 1.0),
        Does::Torque(share) => (Command::Current(control.current(share * largest_a).unwrap()), 1.0),
    };
    rig.command(command).unwrap();
    rig.wait(if matches!(slip.does, Does::Torque(_)) { 0.15 } else { 0.8 });
    assert_eq!(rig.drive.mode(), Mode::Running, "{slip:?}");
    let (start, step_s) = (rig.plant.truth().mechanical_angle_rad, rig.period_s());
    let (mut after_s, mut wrong, mut far) = (0.0, 0.0_f64, 0.0_f64);
    while rig.drive.mode() == Mode::Running && after_s < 1.5 {
        rig.plant.set_slip(slip.degrees.to_radians() * f64::min(after_s / slip.over_s, 1.0)).unwrap();
        rig.wait(step_s);
        after_s += step_s;
        let truth = rig.plant.truth();
        let against = |value: f64| if sign == 0.0 { value.abs() } else { -sign * value };
        wrong = wrong.max(against(truth.speed_rad_s));
        far = far.max(against(truth.mechanical_angle_rad - start));
    }
    let wrong_share = wrong / f64::from(largest_rad_s);
    Outcome { end: rig.drive.mode(), wrong_share, wrong_turns: far / std::f64::consts::TAU }
}

fn each(motor: &Motor) -> Vec<(Slip, Outcome)> {
    let (mut rig, settings) = commissioned(motor, &on_battery(motor, 3), 3);
    let control = settings.control.as_ref().unwrap();
    let largest = [control.max_speed_rad_s, control.max_current_a];
    slips().into_iter().map(|slip| (slip, outcome(&mut rig, largest, slip))).collect()
}

/// A commutation that the check at arming has proven may be wrong now: the rotor has to turn before its back-EMF says so.
/// What it does not find, the following error and over-speed end.
#[test]
fn magnets_that_slip_make_few_motors_run_away() {
    let names = sim::of("drone-15uh hub", "gimbal-7 drone-15uh hub paper drone-stiff direct-drive 20mohm 22-pairs");
    let found: Vec<_> = motors(names).into_par_iter().map(|motor| (motor.name, each(motor))).collect();
    let outcomes: Vec<_> =
        found.iter().flat_map(|(name, outcomes)| outcomes.iter().map(move |one| (name, one))).collect();
    outcomes.iter().for_each(|(name, outcome)| println!("{name} {outcome:?}"));
    let count = |is: &dyn Fn(&Slip, &Outcome) -> bool| outcomes.iter().filter(|(_, (slip, end))| is(slip, end)).count();
    let named = count(&|_, outcome| outcome.end == Mode::Faulted(Fault::Commutation));
    let fast = count(&|_, outcome| outcome.wrong_share > 0.5);
    let fastest = outcomes.iter().fold(0.0_f64, |most, (_, (_, outcome))| most.max(outcome.wrong_share));
    let all = outcomes.len();
    println!("{named} of {all} named, {fast} faster than half of the largest speed, {fastest:.2} of it at most");
    assert!(10 * named > 4 * all && 10 * fast < all && fastest < 1.25, "{named}, {fast} of {all}, {fastest}");
    // What turns on is slow.
    assert_eq!(count(&|_, outcome| outcome.end == Mode::Running && outcome.wrong_share > 0.45), 0);
    assert_eq!(count(&|slip, outcome| matches!(slip.does, Does::Rest) && outcome.wrong_turns > 2.0), 0);
}
