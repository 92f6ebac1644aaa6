//! Supervision of a running drive: nothing turns the wrong way, runs away, or pretends to follow.

use crate::commissioned::{commissioned, here_turns, motor, motors, torque_nm};
use crate::{known, supply};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, Error, GuardSettings, OnStopFailure, OnTimeout, Settings};
use plant::{AmplifierFault, PlantParameters, Wires};
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};

const COMMUTATIONS: [Commutation; 3] = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];

fn settings(commutation: Commutation, arming_check: bool) -> Settings {
    let guard = GuardSettings { arming_check, ..GuardSettings::default() };
    Settings { commutation, control: Some(Control { guard, ..Control::default() }), ..Settings::default() }
}

/// Calibrated and at rest.
fn ready(parameters: &PlantParameters, settings: &Settings, seed: u64) -> Rig {
    at_rest(known::rig(parameters, settings, seed).unwrap())
}

fn at_rest(mut rig: Rig) -> Rig {
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.wait(0.1);
    rig.plant.set_dyno(None).unwrap();
    rig
}

/// What came of something that is wrong: the fault, after so long, the way in mechanical degrees, and the largest
/// phase current.
#[derive(Debug)]
struct Outcome {
    mode: Mode,
    time_s: f64,
    way_deg: f64,
    current_a: f64,
}

fn outcome(rig: &mut Rig, longest_s: f64) -> Outcome {
    let start = rig.plant.truth().mechanical_angle_rad;
    let (mut time_s, mut way, mut current_a) = (0.0, 0.0_f64, 0.0_f64);
    rig.run(longest_s, |rig, period| {
        if rig.drive.mode() == Mode::Running {
            time_s += rig.period_s();
            way = way.max((period.truth.mechanical_angle_rad - start).abs());
            current_a = period.truth.currents_a.iter().fold(current_a, |most, one| most.max(one.abs()));
        }
    });
    Outcome { mode: rig.drive.mode(), time_s, way_deg: way.to_degrees(), current_a }
}

#[derive(Clone, Copy, Debug)]
enum Follow {
    Torque(f32),
    Speed(f32),
    Position(f64),
}

fn follow(rig: &mut Rig, what: Follow) {
    let control = *rig.control().unwrap();
    let here = here_turns(rig);
    rig.command(match what {
        Follow::Torque(current) => Command::Current(control.current(current).unwrap()),
        Follow::Speed(speed) => Command::Speed(control.speed(speed).unwrap()),
        Follow::Position(turns) => Command::Position(control.position(here + turns).unwrap()),
    })
    .unwrap();
}

const FOLLOWED: [Follow; 7] = [
    Follow::Torque(0.5),
    Follow::Torque(-3.0),
    Follow::Torque(0.2),
    Follow::Speed(10.0),
    Follow::Speed(-100.0),
    Follow::Position(0.2),
    Follow::Position(-5.0),
];

/// Without the check at arming, as where the rotor was held then. The short form has every other command with each
/// commutation, in turn.
#[test]
fn wrong_wires_turn_no_rotor_the_wrong_way_for_long() {
    let (mut longest_s, mut farthest_deg) = (0.0_f64, 0.0_f64);
    for (number, commutation) in COMMUTATIONS.into_iter().enumerate() {
        for (seed, what) in FOLLOWED.into_iter().enumerate().skip(sim::of(number % 2, 0)).step_by(sim::of(2, 1)) {
            for inertia in sim::either(seed / 2, [1.0, 3.0]) {
                // Two that are swapped let the rotor swing about where it has no torque.
                for on in [0, 1, 2] {
                    let mut parameters = PlantParameters::imperfect(seed as u64);
                    parameters.motor.inertia_kgm2 *= inertia;
                    // How far it turns depends on where a calibration of its own has left it.
                    let mut rig = Rig::new(&parameters, &settings(commutation, false), seed as u64).unwrap();
                    rig.calibrate(|_| ()).unwrap();
                    let mut rig = at_rest(rig);
                    rig.plant.set_motor_wires(if on == 0 { Wires::swapped(seed % 3) } else { Wires::moved_on(on) });
                    rig.command(Command::Arm).unwrap();
                    follow(&mut rig, what);
                    let outcome = outcome(&mut rig, 0.9);
                    let case = format!("{commutation:?} {what:?}, {inertia} x the inertia, by {on}: {outcome:?}");
                    println!("{case}");
                    let named = matches!(
                        outcome.mode,
                        Mode::Faulted(Fault::Commutation | Fault::FollowingError | Fault::CurrentModel | Fault::Stall)
                    );
                    assert!(named || on == 0 && outcome.mode == Mode::Running, "{case}");
                    assert!(outcome.way_deg < if on == 0 { 500.0 } else { 30.0 } && outcome.current_a < 4.0, "{case}");
                    if on == 0 {
                        continue;
                    }
                    longest_s = longest_s.max(outcome.time_s);
                    farthest_deg = farthest_deg.max(outcome.way_deg);
                }
            }
        }
    }
    println!("at most {longest_s:.3} s and {farthest_deg:.1}°");
}

#[test]
fn defects_while_running_are_named_or_harmless() {
    let open = |rig: &mut Rig, phase: usize| rig.plant.set_phase_open(phase, true);
    let dead = |rig: &mut Rig, phase: usize| rig.plant.set_amplifier_fault(phase, Some(AmplifierFault::Dead)).unwrap();
    let all_dead = |rig: &mut Rig, _: usize| (0..3).for_each(|k| dead(rig, k));
    let none = |_: &mut Rig, _: usize| ();
    type Defect<'a> = (&'a str, &'a dyn Fn(&mut Rig, usize));
    let defects: [Defect; 4] = [
        ("nothing", &none),
        ("an open phase", &open),
        ("a dead amplifier", &dead),
        ("three dead amplifiers", &all_dead),
    ];
    for commutation in COMMUTATIONS {
        for (seed, what) in FOLLOWED.into_iter().enumerate() {
            for (name, defect) in defects {
                let mut rig =
                    ready(&PlantParameters::imperfect(seed as u64), &settings(commutation, true), seed as u64);
                rig.command(Command::Arm).unwrap();
                follow(&mut rig, what);
                rig.wait(0.2);
                assert_eq!(rig.drive.mode(), Mode::Running, "{commutation:?} {what:?}");
                defect(&mut rig, seed % 3);
                let outcome = outcome(&mut rig, 0.6);
                let case = format!("{commutation:?} {what:?}, {name}: {outcome:?}");
                println!("{case}");
                // A fault, or a motor that does what it is told by currents within the limit.
                assert!(outcome.current_a < 5.0, "{case}");
                assert!(name != "nothing" || outcome.mode == Mode::Running, "{case}");
            }
        }
    }
}

/// The short form has every other command with each commutation and motor, in turn.
#[test]
fn nothing_is_wrong_with_other_motors() {
    for (number, commutation) in COMMUTATIONS.into_iter().enumerate() {
        for (motor, (r, l, flux)) in [(0.7, 0.8, 0.85), (1.3, 1.2, 1.15), (1.0, 1.0, 1.0)].into_iter().enumerate() {
            let followed = FOLLOWED.into_iter().enumerate();
            for (seed, what) in followed.skip(sim::of((number + motor) % 2, 0)).step_by(sim::of(2, 1)) {
                let mut parameters = PlantParameters::imperfect(seed as u64);
                parameters.motor.resistance_ohm *= r;
                parameters.motor.inductance_h *= l;
                parameters.motor.back_emf.flux_linkage_vs *= flux;
                let mut rig = ready(&parameters, &settings(commutation, true), seed as u64);
                rig.command(Command::Arm).unwrap();
                follow(&mut rig, what);
                rig.wait(0.5);
                // And back again.
                follow(&mut rig, FOLLOWED[(seed + 1) % FOLLOWED.len()]);
                rig.wait(0.4);
                let case = format!("{commutation:?} {what:?} R {r} L {l} λ {flux} {:?}", rig.plant.truth());
                assert_eq!(rig.drive.mode(), Mode::Running, "{case}");
            }
        }
    }
}

/// The short form has one of the two inertias with each flux linkage. At the voltage limit no current flows though one is asked for, as with dead amplifiers. The voltage then follows the
/// supply, which jumps here, and the flux linkage is not that of the settings.
#[test]
fn a_speed_beyond_the_supply_is_no_fault() {
    for commutation in COMMUTATIONS {
        for (seed, flux) in [0.5, 0.8, 1.0, 1.3, 2.0].into_iter().enumerate() {
            for inertia in sim::either(seed, [0.5, 4.0]) {
                let mut parameters = PlantParameters::imperfect(seed as u64);
                parameters.motor.back_emf.flux_linkage_vs *= flux;
                parameters.motor.inertia_kgm2 *= inertia;
                parameters.bus.regenerative = true;
                let mut with = settings(commutation, true);
                with.control = with.control.map(|control| Control {
                    max_speed_rad_s: 1500.0,
                    following_error_rad_s: 1e6,
                    ..control
                });
                let mut rig = ready(&parameters, &with, seed as u64);
                rig.arm().unwrap();
                let case = |rig: &Rig, volts: f64| {
                    let truth = rig.plant.truth();
                    format!(
                        "{commutation:?} flux {flux} inertia {inertia}, {volts} V, {:?} {truth:?}",
                        rig.drive.mode()
                    )
                };
                for volts in [24.0, 24.0, 24.0, 17.0, 24.0, 20.0, 28.0, 18.0] {
                    follow(&mut rig, Follow::Speed(1400.0));
                    rig.plant.set_supply(volts).unwrap();
                    rig.wait(0.2);
                    assert_eq!(rig.drive.mode(), Mode::Running, "{}", case(&rig, volts));
                }
            }
        }
    }
}

/// Ten motors that turn under a load of friction, and no amplifier shows a current any more: the loops swing, the current
/// beyond what is asked for. The short form has every other motor with each commutation, in turn.
#[test]
fn dead_amplifiers_at_speed_are_found() {
    for (number, commutation) in COMMUTATIONS.into_iter().enumerate() {
        for seed in (0..10).skip(sim::of(number % 2, 0)).step_by(sim::of(2, 1)) {
            let mut parameters = PlantParameters::imperfect(seed);
            parameters.motor.inertia_kgm2 *= [0.5, 1.0, 2.0, 5.0][seed as usize % 4];
            parameters.motor.friction.coulomb_nm = 5e-3;
            parameters.motor.friction.breakaway_nm = 6e-3;
            let mut rig = ready(&parameters, &settings(commutation, true), seed);
            rig.arm().unwrap();
            follow(&mut rig, Follow::Speed(if seed % 2 == 0 { 100.0 } else { -40.0 }));
            rig.wait(0.3);
            (0..3).for_each(|k| rig.plant.set_amplifier_fault(k, Some(AmplifierFault::Dead)).unwrap());
            let outcome = outcome(&mut rig, 0.6);
            let case = format!("{commutation:?}, seed {seed}: {outcome:?}");
            println!("{case}");
            // In the first moments it looks like a torque the wrong way.
            let named = matches!(outcome.mode, Mode::Faulted(Fault::CurrentModel | Fault::Commutation));
            assert!(named, "{case}");
        }
    }
}

#[test]
fn a_torque_does_not_run_away_from_the_largest_speed() {
    let control = Control { max_speed_rad_s: 100.0, ..Control::default() };
    let mut with = settings(Commutation::FieldOriented, true);
    with.control = Some(Control { guard: with.control.unwrap().guard, ..control });
    let mut rig = ready(&PlantParameters::imperfect(3), &with, 3);
    rig.command(Command::Arm).unwrap();
    follow(&mut rig, Follow::Torque(1.0));
    rig.wait(0.8);
    let speed = rig.plant.truth().speed_rad_s;
    assert!(rig.drive.mode() == Mode::Running && (95.0..112.0).contains(&speed), "{speed}");
    // Driven from outside, it is a fault.
    rig.plant.set_dyno(Some(150.0)).unwrap();
    rig.wait(0.05);
    assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::OverSpeed));
}

/// Neither with a load that helps, nor with one that would turn the rotor back, nor by a torque of zero; and the way to a
/// low limit takes nothing from the torque of a rotor that is held.
#[test]
fn a_torque_keeps_the_largest_speed_though_a_load_helps() {
    for (seed, commutation, sign) in [
        (1, Commutation::FieldOriented, 1.0),
        (2, Commutation::Sinusoidal, -1.0),
        (3, Commutation::Block, 1.0),
        (4, Commutation::FieldOriented, -1.0),
    ] {
        let mut with = settings(commutation, true);
        let control = Control { max_speed_rad_s: 60.0, ..with.control.unwrap() };
        with.control = Some(control);
        let mut rig = ready(&PlantParameters::imperfect(seed), &with, seed);
        rig.arm().unwrap();
        rig.plant.set_load(-0.008 * sign).unwrap();
        for torque in [2.0, 0.3, 0.0] {
            follow(&mut rig, Follow::Torque((torque * sign) as f32));
            let mut fastest = 0.0_f64;
            rig.run(0.4, |_, period| fastest = fastest.max(period.truth.speed_rad_s.abs()));
            let speed = rig.plant.truth().speed_rad_s.abs();
            println!("seed {seed}, {torque} A: {speed:.1} rad/s, {fastest:.1} at most");
            assert!(
                (60.0..69.0).contains(&speed) && fastest < 72.0,
                "seed {seed}, {torque} A: {speed}, {fastest} rad/s"
            );
            assert_eq!(rig.drive.mode(), Mode::Running, "seed {seed}, {torque} A");
        }
        rig.plant.set_dyno(Some(0.0)).unwrap();
        follow(&mut rig, Follow::Torque((2.0 * sign) as f32));
        rig.wait(0.1);
        let squares: f64 = rig.plant.currents_a().iter().map(|current| current * current).sum();
        let flows = (squares / 1.5).sqrt();
        assert!((flows - 2.0).abs() < 0.3, "seed {seed}: {flows} A at rest");
    }
}

#[test]
fn a_blocked_move_waits_and_does_not_shoot_afterwards() {
    let mut rig = ready(&PlantParameters::imperfect(2), &settings(Commutation::FieldOriented, true), 2);
    rig.arm().unwrap();
    follow(&mut rig, Follow::Position(3.0));
    rig.wait(0.05);
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.wait(0.3);
    rig.plant.set_dyno(None).unwrap();
    let start = rig.plant.truth().mechanical_angle_rad;
    rig.wait(0.005);
    let shot = (rig.plant.truth().mechanical_angle_rad - start).abs() / std::f64::consts::TAU;
    assert!(shot < 0.2, "{shot} turns");
    assert_eq!(rig.drive.mode(), Mode::Running);
}

/// Bounds of the position, by how much a rotor left them at most, in turns, and in which mode that ended.
fn left_its_bounds(rig: &mut Rig, [least, most]: [f64; 2], command: Follow, seconds: f64) -> (f64, Mode) {
    let mut farthest = 0.0_f64;
    // As a tool sends it again and again.
    for _ in 0..(seconds / 0.05) as u32 {
        if rig.drive.mode() == Mode::Running {
            follow(rig, command);
        }
        rig.run(0.05, |rig, _| farthest = farthest.max(here_turns(rig) - most).max(least - here_turns(rig)));
    }
    (farthest, rig.drive.mode())
}

#[test]
fn the_rotor_stays_within_its_bounds() {
    let (bounds, mut farthest) = ([-1.0, 1.5], 0.0_f64);
    for commutation in COMMUTATIONS {
        let mut with = settings(commutation, true);
        let control = with.control.unwrap();
        with.control = Some(Control { min_position_turns: -1.0, max_position_turns: 1.5, ..control });
        let mut rig = ready(&PlantParameters::imperfect(4), &with, 4);
        rig.arm().unwrap();
        let speeds = [20.0, -20.0, 60.0, -125.0, 450.0, -450.0].map(Follow::Speed);
        let torques = [0.1, -0.1, 0.5, -1.0, 3.0, -3.0].map(Follow::Torque);
        let both = [Follow::Speed(300.0), Follow::Torque(0.0), Follow::Speed(-300.0), Follow::Torque(-0.05)];
        for command in speeds.into_iter().chain(torques).chain(both) {
            let (left, mode) = left_its_bounds(&mut rig, bounds, command, 0.6);
            println!("{commutation:?} {command:?}: {left:.3} turns outside");
            assert_eq!(mode, Mode::Running, "{commutation:?} {command:?}");
            farthest = farthest.max(left);
        }
        let control = *rig.control().unwrap();
        assert!(rig.command(Command::Position(control.position(2.0).unwrap())).is_err());
    }
    println!("{farthest:.3} turns outside at most");
    assert!(farthest < 0.05, "{farthest}");
}

/// All of the torque, and the largest speed. Not the heavy rotor of a drone motor: its 125 J take so long to burn that the limit
/// of heat, of which no plan knows, leaves a quarter of the power meanwhile. The short form has one of five motors.
#[test]
fn any_rotor_stays_within_its_bounds() {
    let motors = MOTORS.iter().filter(|motor| motor.name != "drone-heavy");
    let jobs: Vec<_> = motors.skip(sim::of(2, 0)).step_by(sim::of(5, 1)).collect();
    jobs.par_iter().for_each(|motor| stays_within_its_bounds(motor, 3));
}

/// The torque that brakes it there alternates with the one that is commanded, which takes all of the voltage: the current
/// model knows it. The short form has the two of forty rotors that were switched off once.
#[test]
fn a_rotor_that_is_kept_within_its_bounds_is_no_fault() {
    let seeds = sim::of(vec![10, 35], (3..43).collect());
    seeds.par_iter().for_each(|&seed| stays_within_its_bounds(motor("hoverboard"), seed));
}

fn stays_within_its_bounds(motor: &Motor, seed: u64) {
    let (mut rig, mut settings) = commissioned(motor, &motor.plant(seed), seed);
    settings.commutation = Commutation::FieldOriented;
    let Control { max_speed_rad_s, max_acceleration_rad_s2, .. } = settings.control.unwrap();
    // A way in which the largest speed is reached.
    let way = f64::from(max_speed_rad_s.powi(2) / max_acceleration_rad_s2) / std::f64::consts::TAU + 2.0;
    let here = here_turns(&rig);
    let bounds = [here - way, here + way];
    let [min_position_turns, max_position_turns] = bounds.map(|bound| bound as f32);
    settings.control = settings.control.map(|control| Control { min_position_turns, max_position_turns, ..control });
    rig.configure(&settings).unwrap();
    rig.arm().unwrap();
    let seconds = 2.0 + 3.0 * f64::from(max_speed_rad_s / max_acceleration_rad_s2);
    let largest_a = rig.control().unwrap().largest_current_a();
    let speeds = [1.0, -1.0, 0.2].map(|share| Follow::Speed(share * max_speed_rad_s));
    let torques = [1.0, -1.0, 0.2, -0.1].map(|share| Follow::Torque(share * largest_a));
    for command in speeds.into_iter().chain(torques) {
        let (left, mode) = left_its_bounds(&mut rig, bounds, command, seconds);
        println!("{} {seed} {command:.1?}: {left:.3} turns outside of {way:.1}, {mode:?}", motor.name);
        assert_eq!(mode, Mode::Running, "{} {command:?}", motor.name);
        assert!(left < 0.15, "{} {command:?}: {left}", motor.name);
    }
}

/// Torques to and fro at motors whose current takes a large voltage to change, at any moment of the supervision's round,
/// also after a while without a current: none is taken for an open phase.
#[test]
fn a_torque_that_steps_is_no_open_phase() {
    let motors = motors("hub hoverboard paper gimbal-7");
    let jobs: Vec<_> =
        motors.iter().flat_map(|motor| [5, 8].map(|seed| (*motor, seed))).step_by(sim::of(3, 1)).collect();
    jobs.par_iter().for_each(|&(motor, seed)| {
        let (mut rig, _) = commissioned(motor, &motor.plant(seed), seed);
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        rig.arm().unwrap();
        let half_a = 0.5 * rig.control().unwrap().largest_current_a();
        for step in 0..200 {
            if step % 3 == 0 {
                rig.command(Command::Current(rig.control().unwrap().current(0.0).unwrap())).unwrap();
                rig.wait(0.08);
            }
            let current_a = if step % 2 == 0 { half_a } else { -half_a };
            rig.command(Command::Current(rig.control().unwrap().current(current_a).unwrap())).unwrap();
            // 64 steps are a part of the round.
            for _ in 0..480 + 7 * step % 64 {
                rig.step();
            }
            rig.serve();
            assert_eq!(rig.drive.mode(), Mode::Running, "{}, step {step}", motor.name);
            if step % 20 == 19 {
                rig.command(Command::Speed(rig.control().unwrap().speed(0.0).unwrap())).unwrap();
                rig.wait(0.3);
            }
        }
    });
}

/// A shaft that something else turns on, when the stop has had its time, is braked by shorted windings for as long as it
/// turns, and not let go.
#[test]
fn a_stop_that_fails_brakes_for_as_long_as_the_shaft_is_turned() {
    for case in [supply::default_motor(), supply::drone(), supply::hub()] {
        for arming_check in [false, true] {
            let control = case.settings.control.map(|control| {
                let guard = GuardSettings {
                    if_stop_fails: OnStopFailure::Brake,
                    on_timeout: OnTimeout::Stop,
                    command_timeout_s: 0.3,
                    stop_s: 0.1,
                    stall_s: 5.0,
                    arming_check,
                    ..control.guard
                };
                Control { guard, ..control }
            });
            let mut rig =
                supply::armed(&supply::Case { settings: Settings { control, ..case.settings }, ..case }, [1.0; 3]);
            rig.wait(0.25);
            let speed = rig.control().unwrap().speed(0.2 * case.speed_rad_s).unwrap();
            for _ in 0..30 {
                rig.command(Command::Speed(speed)).unwrap();
                rig.wait(0.05);
            }
            let turning = rig.plant.truth().speed_rad_s;
            rig.plant.set_dyno(Some(turning)).unwrap();
            rig.wait(2.0);
            let mut shorted = true;
            rig.run(2.0, |rig, period| {
                shorted &= period.output.compare == [0; 3] && rig.drive.mode() == Mode::Running;
            });
            let what = format!("{}, arming check {arming_check}: {:?}", case.name, rig.drive.mode());
            assert!(shorted && rig.drive.limits().contains(Limits::TIMEOUT), "{what}");
            // And it is to be had again.
            rig.plant.set_dyno(None).unwrap();
            rig.command(Command::Speed(speed)).unwrap();
            rig.wait(0.2);
            let speed = rig.plant.truth().speed_rad_s;
            assert!((speed / turning - 1.0).abs() < 0.1, "{what}, {speed}");
        }
    }
}

/// A commutation that was seen to be right is right for a rotor that has turned since: off and on again at speed, a load
/// that is stronger than the brake is no wrong commutation. The short form has every other motor.
#[test]
fn a_load_that_wins_after_off_and_on_at_speed_is_no_wrong_commutation() {
    for name in ["20mohm", "drone-heavy", "gimbal-11", "hub", "paper"].into_iter().step_by(sim::of(2, 1)) {
        let motor = motor(name);
        let (mut rig, _) = commissioned(motor, &motor.plant(1), 1);
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        rig.arm().unwrap();
        let control = *rig.control().unwrap();
        let slow = control.speed(0.06 * control.largest_speed_rad_s()).unwrap();
        rig.command(Command::Speed(slow)).unwrap();
        rig.wait(1.0);
        rig.command(Command::Disarm).unwrap();
        rig.wait(0.002);
        rig.arm().unwrap();
        let current_a = 0.3 * control.largest_current_a();
        rig.command(Command::Current(control.current(-current_a).unwrap())).unwrap();
        let torque_nm = torque_nm(motor, current_a.into());
        rig.plant.set_load(-2.0 * torque_nm).unwrap();
        let before = rig.plant.truth().speed_rad_s;
        while rig.plant.truth().speed_rad_s < 2.5 * before {
            rig.wait(0.001);
            assert_eq!(rig.drive.mode(), Mode::Running, "{name} at {} rad/s", rig.plant.truth().speed_rad_s);
        }
    }
}

/// Without the check at arming, and too slow for the back-EMF to tell: that the rotor has turned as it was driven to shows
/// that the commutation is right, and a load that is stronger than the brake is no wrong one.
#[test]
fn a_load_that_wins_after_some_turns_is_no_wrong_commutation() {
    for seed in 0..4 {
        let mut parameters = PlantParameters::imperfect(seed);
        parameters.motor.inertia_kgm2 *= 3.0;
        let mut rig = ready(&parameters, &settings(Commutation::FieldOriented, false), seed);
        rig.command(Command::Arm).unwrap();
        for slow in [30.0, -30.0] {
            follow(&mut rig, Follow::Speed(slow));
            rig.wait(0.2);
            rig.plant.set_load(f64::from(0.02_f32.copysign(slow))).unwrap();
            for _ in 0..8 {
                follow(&mut rig, Follow::Speed(slow));
                rig.wait(0.2);
            }
            follow(&mut rig, Follow::Torque(-0.5_f32.copysign(slow)));
            let before = rig.plant.truth().speed_rad_s;
            rig.plant.set_load(f64::from(-0.06_f32.copysign(slow))).unwrap();
            while rig.plant.truth().speed_rad_s.abs() < 3.0 * before.abs() {
                rig.wait(0.001);
                assert_eq!(rig.drive.mode(), Mode::Running, "{seed}, at {} rad/s", rig.plant.truth().speed_rad_s);
            }
            rig.plant.set_load(0.0).unwrap();
        }
    }
}

/// The rest of a stall follows from the inertia. One that is told a thousand times too large, as in other units, does not hide
/// a shaft that is blocked.
#[test]
fn a_blocked_shaft_is_a_stall_whatever_the_inertia_is_told_to_be() {
    let motors =
        motors(sim::of("slotless", "gimbal-7 drone-15uh hub paper 20ohm slotless direct-drive hoverboard 22-pairs"));
    motors.par_iter().for_each(|motor| {
        let (mut rig, mut settings) = commissioned(motor, &motor.plant(6), 6);
        let control = settings.control.as_mut().unwrap();
        control.inertia_kgm2 = (1000.0 * control.inertia_kgm2).min(100.0);
        (control.speed_bandwidth_hz, control.position_bandwidth_hz) = (0.5, 0.1);
        if let Err(Error::OutOfRange { field: "inertia_kgm2", max, .. }) = settings.validate() {
            settings.control.as_mut().unwrap().inertia_kgm2 = max;
        }
        settings.commutation = Commutation::FieldOriented;
        rig.configure(&settings).unwrap();
        rig.arm().unwrap();
        rig.plant.set_dyno(Some(0.0)).unwrap();
        let fastest = rig.control().unwrap().largest_speed_rad_s();
        rig.command(Command::Speed(rig.control().unwrap().speed(fastest).unwrap())).unwrap();
        let mut limited_s = 0.0;
        let most_a = f64::from(rig.control().unwrap().largest_current_a());
        for _ in 0..20_000 {
            rig.wait(1e-3);
            if rig.drive.mode() != Mode::Running {
                break;
            }
            let flows_a = rig.plant.currents_a().iter().fold(0.0_f64, |most, a| most.max(a.abs()));
            limited_s += if flows_a > 0.8 * most_a { 1e-3 } else { 0.0 };
        }
        println!("{}: {:?} after {limited_s:.2} s at the largest current", motor.name, rig.drive.mode());
        assert!(limited_s < 3.0 && rig.drive.mode() != Mode::Running, "{} {limited_s}", motor.name);
    });
}
