//! The check when the bridge is switched on: wires, amplifiers and commutation.

use crate::commissioned::motor;
use crate::known;
use hallservo::board::Legs;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, OnTimeout, Settings};
use plant::{AmplifierFault, LoadParameters, PlantParameters, Transistor, Unevenness, Wires};
use rayon::prelude::*;
use rig::Rig;
use sim::experiment::cogging;

fn calibrated(seed: u64, commutation: Commutation) -> Rig {
    calibrated_as(&PlantParameters::imperfect(seed), commutation, seed).unwrap()
}

/// The same with another motor; the calibration may refuse it.
fn calibrated_as(parameters: &PlantParameters, commutation: Commutation, seed: u64) -> Result<Rig, String> {
    let settings = Settings { commutation, control: Some(Control::default()), ..Settings::default() };
    let mut rig = known::rig(parameters, &settings, seed)?;
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.wait(0.1);
    rig.plant.set_dyno(None).unwrap();
    Ok(rig)
}

/// Arms; the time that the check takes in seconds, how far the rotor went, in mechanical degrees, and the largest
/// phase current.
fn check(rig: &mut Rig) -> (f64, f64, f64) {
    let start = rig.plant.truth().mechanical_angle_rad;
    rig.command(Command::Arm).unwrap();
    let (mut time_s, mut farthest, mut current) = (0.0, 0.0_f64, 0.0_f64);
    rig.run(0.95, |rig, period| {
        if rig.drive.limits().contains(Limits::CHECKING) {
            time_s += rig.period_s();
        }
        farthest = farthest.max((period.truth.mechanical_angle_rad - start).abs());
        current = period.truth.currents_a.iter().fold(current, |most, one| most.max(one.abs()));
    });
    (time_s, farthest.to_degrees(), current)
}

/// Longest check of a sound motor of four pole pairs, s, and its farthest way, mechanical degrees.
const LONGEST_S: f64 = 0.35;
const FARTHEST_DEG: f64 = 14.0;
/// And of one of seven pole pairs that cogging carries on.
const LONGEST_CARRIED_S: f64 = 0.55;
const FARTHEST_CARRIED_DEG: f64 = 25.0;

#[test]
fn a_sound_motor_passes_and_hardly_moves() {
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
        for seed in 0..sim::of(4, 10) {
            let mut rig = calibrated(seed, commutation);
            for _ in 0..2 {
                let (time_s, moved_deg, current_a) = check(&mut rig);
                println!("{commutation:?} {seed}: {:.1} ms, {moved_deg:.2}°, {current_a:.2} A", 1e3 * time_s);
                assert_eq!(rig.drive.mode(), Mode::Running);
                assert!(time_s < LONGEST_S && moved_deg < FARTHEST_DEG && current_a < 2.0, "{seed}");
                rig.command(Command::Disarm).unwrap();
                rig.wait(0.1);
            }
        }
    }
}

/// A stop during the check leaves it to be done.
#[test]
fn a_check_that_was_broken_off_begins_anew() {
    let mut rig = calibrated(3, Commutation::FieldOriented);
    rig.command(Command::Arm).unwrap();
    rig.wait(0.05);
    assert!(rig.drive.limits().contains(Limits::CHECKING));
    rig.command(Command::Disarm).unwrap();
    rig.wait(0.1);
    let (time_s, ..) = check(&mut rig);
    assert!(rig.drive.mode() == Mode::Running && time_s > 0.1, "{time_s}");
}

/// Breaks something on a number of motors, arms, and returns what the drive said of each.
fn broken(motors: u64, mut break_it: impl FnMut(&mut Rig, usize)) -> Vec<Mode> {
    let mut modes = Vec::new();
    for seed in 0..motors {
        let mut rig = calibrated(seed, Commutation::FieldOriented);
        break_it(&mut rig, seed as usize % 3);
        rig.wait(0.1);
        let (time_s, moved_deg, current_a) = check(&mut rig);
        println!("{seed}: {:.1} ms {moved_deg:.2}° {current_a:.2} A {:?}", 1e3 * time_s, rig.drive.mode());
        assert!(current_a < 3.2, "{current_a} A");
        modes.push(rig.drive.mode());
    }
    modes
}

/// A gimbal motor at a board for fifty times its current, where `max_current_a` is some steps of the converter; an open phase
/// is named as far down as there is a check.
#[test]
fn a_small_largest_current_is_no_broken_amplifier() {
    let gimbal = motor("gimbal-7");
    let (plant, mut settings) = (gimbal.plant(5), gimbal.settings());
    let control = settings.control.as_mut().unwrap();
    (control.resistance_ohm, control.inductance_h, control.max_current_a) = (10.0, 5e-3, gimbal.limit_a);
    (control.flux_linkage_wb, control.inertia_kgm2) = (6e-3, 2e-5);
    (control.current_bandwidth_hz, control.speed_bandwidth_hz, control.position_bandwidth_hz) = (400.0, 20.0, 5.0);
    let model = known::model(&plant, &settings, 5);
    let jobs = [0.05, 0.06, 0.075, 0.085, 0.1, 0.12, 0.15].into_iter().flat_map(|most_a| {
        let seeds = 0..sim::of(5, 40);
        seeds.flat_map(move |seed| [None, Some(seed as usize % 3)].map(|open| (most_a, seed, open)))
    });
    let jobs: Vec<_> = jobs.collect();
    jobs.into_par_iter().for_each(|(most_a, seed, open)| {
        let mut control = settings.control.unwrap();
        control.max_current_a = most_a;
        let mut rig = Rig::new(&plant, &Settings { control: Some(control), ..settings }, seed).unwrap();
        rig.plant.place(0.7 * seed as f64, 0.0).unwrap();
        if let Some(phase) = open {
            rig.plant.set_phase_open(phase, true);
        }
        rig.wait(0.02);
        rig.service.install(&model).unwrap();
        rig.wait(0.05);
        rig.arm().unwrap();
        let expected = match open {
            Some(phase) if most_a > 0.08 => Mode::Faulted(OPEN[phase]),
            _ => Mode::Running,
        };
        assert_eq!(rig.drive.mode(), expected, "{most_a} A, {seed}");
    });
}

const BLIND: [Fault; 3] = [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC];
const OPEN: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];

/// The modes of motors each of which has another phase broken.
fn named(faults: [Fault; 3], motors: usize) -> Vec<Mode> {
    (0..motors).map(|motor| Mode::Faulted(faults[motor % 3])).collect()
}

#[test]
fn a_blind_amplifier_is_named() {
    let dead = broken(9, |rig, phase| rig.plant.set_amplifier_fault(phase, Some(AmplifierFault::Dead)).unwrap());
    assert_eq!(dead, named(BLIND, 9));
}

#[test]
fn three_blind_amplifiers_are_no_current() {
    let dead = broken(3, |rig, _| {
        for phase in 0..3 {
            rig.plant.set_amplifier_fault(phase, Some(AmplifierFault::Dead)).unwrap();
        }
    });
    assert!(dead.iter().all(|mode| *mode == Mode::Faulted(Fault::NoCurrent)));
}

#[test]
fn an_amplifier_with_the_wrong_sign_or_gain_is_found() {
    for gain in [-1.0, 0.5, 2.0] {
        let wrong =
            broken(3, |rig, phase| rig.plant.set_amplifier_fault(phase, Some(AmplifierFault::Gain(gain))).unwrap());
        for (phase, mode) in wrong.into_iter().enumerate() {
            assert!(matches!(mode, Mode::Faulted(fault) if fault == BLIND[phase] || fault == Fault::CurrentImbalance));
        }
    }
}

#[test]
fn an_open_phase_is_named() {
    assert_eq!(broken(9, |rig, phase| rig.plant.set_phase_open(phase, true)), named(OPEN, 9));
}

#[test]
fn a_dead_half_bridge_is_named() {
    for transistor in [Transistor::Upper, Transistor::Lower] {
        let dead = broken(3, |rig, phase| rig.plant.set_dead_transistor(phase, Some(transistor)));
        assert_eq!(dead, named(OPEN, 3), "{transistor:?}");
    }
}

#[test]
fn motor_wires_moved_on_by_one_are_found_at_once() {
    for on in [1, 2] {
        let moved = broken(12, |rig, _| rig.plant.set_motor_wires(Wires::moved_on(on)));
        assert!(moved.iter().all(|mode| *mode == Mode::Faulted(Fault::Commutation)), "{moved:?}");
    }
}

#[test]
fn swapped_motor_wires_are_found() {
    let moved = broken(24, |rig, phase| rig.plant.set_motor_wires(Wires::swapped(phase)));
    assert!(moved.iter().all(|mode| *mode == Mode::Faulted(Fault::Commutation)), "{moved:?}");
}

#[test]
fn swapped_halls_are_found() {
    for seed in 0..24 {
        let mut rig = calibrated(seed, Commutation::FieldOriented);
        rig.plant.set_hall_wires(Wires::swapped(seed as usize % 3));
        rig.wait(0.1);
        // Where they contradict each other, nothing is switched on.
        if rig.command(Command::Arm).is_ok() {
            rig.wait(0.95);
            let mode = rig.drive.mode();
            let told = matches!(mode, Mode::Faulted(Fault::Commutation | Fault::Hall(_) | Fault::AngleJump));
            assert!(told, "{seed}: {mode:?}");
        }
    }
}

/// What turns a sound rotor, or keeps it from turning, is no wrong commutation.
#[test]
fn no_sound_motor_is_refused() {
    let mut refused = Vec::new();
    for seed in (0..64).step_by(sim::of(3, 1)) {
        let pick = |choices: [f64; 4], digit: u32| choices[(seed as usize >> (2 * digit)) % 4];
        let mut parameters = PlantParameters::imperfect(seed);
        let motor = &mut parameters.motor;
        let (cogging, inertia, friction) =
            (pick([0.0, 1.0, 2.0, 3.0], 0), pick([0.3, 1.0, 5.0, 30.0], 1), pick([0.3, 1.0, 3.0, 6.0], 2));
        for component in &mut motor.cogging {
            component.amplitude_nm *= cogging;
        }
        motor.inertia_kgm2 *= inertia;
        motor.friction.coulomb_nm *= friction;
        motor.friction.breakaway_nm *= friction;
        let Ok(mut rig) = calibrated_as(&parameters, Commutation::FieldOriented, seed) else { continue };
        refused.extend(refusal(&mut rig, 4).map(|refusal| (seed, cogging, inertia, friction, refusal)));
    }
    assert!(refused.is_empty(), "{refused:?}");
}

/// Arms at places all around: the first at which it is refused, and why.
fn refusal(rig: &mut Rig, places: usize) -> Option<(usize, Mode)> {
    for place in 0..places {
        rig.arm().unwrap();
        if rig.drive.mode() != Mode::Running {
            return Some((place, rig.drive.mode()));
        }
        rig.command(Command::Disarm).unwrap();
        rig.plant.set_dyno(Some(30.0)).unwrap();
        rig.wait(0.037);
        rig.plant.set_dyno(Some(0.0)).unwrap();
        rig.wait(0.05);
        rig.plant.set_dyno(None).unwrap();
    }
    None
}

/// The field of the windings reaches the Halls: when the current turns round, the angle jumps, and a heavy rotor seems to
/// stand at once.
#[test]
fn no_heavy_rotor_is_refused_for_its_uneven_magnets() {
    let mut refused = Vec::new();
    for seed in 0..sim::of(12, 32) {
        let mut rig = flywheel(seed);
        refused.extend(refusal(&mut rig, 6).map(|refusal| (seed, refusal)));
    }
    assert!(refused.is_empty(), "{refused:?}");
}

/// A rotor with cheap magnets and a flywheel of up to 200 times its inertia, which was put on after the calibration.
fn flywheel(seed: u64) -> Rig {
    let times = [30.0, 60.0, 100.0, 200.0][seed as usize % 4];
    mounted_on(true, seed, |heavy| heavy.motor.inertia_kgm2 *= times)
}

/// A motor with cheap magnets or even ones, whose Halls were calibrated before something was mounted on its shaft.
fn mounted_on(cheap: bool, seed: u64, mount: impl FnOnce(&mut PlantParameters)) -> Rig {
    let settings =
        Settings { commutation: Commutation::FieldOriented, control: Some(Control::default()), ..Settings::default() };
    let mut parameters = PlantParameters::imperfect(seed);
    if cheap {
        parameters = parameters.with_unevenness(&Unevenness { rated_a: 3.0, ..Unevenness::CHEAP }, seed);
    }
    let model = known::model(&parameters, &settings, seed);
    mount(&mut parameters);
    let mut rig = Rig::new(&parameters, &settings, seed).unwrap();
    rig.wait(0.02);
    rig.service.install(&model).unwrap();
    rig.wait(0.1);
    rig
}

/// Motors that were calibrated before something was mounted on a shaft that twists: of so many times the rotor's inertia,
/// which swings at so many hertz, damped by 0.02, with play in mechanical degrees.
fn twisting(seed: u64, times: f64, hz: f64, play_deg: f64) -> Rig {
    mounted_on(false, seed, |parameters| {
        let rotor = parameters.motor.inertia_kgm2;
        let mut load = LoadParameters::resonant(rotor, times * rotor, hz, 0.02);
        load.backlash_rad = play_deg.to_radians();
        parameters.motor.load = Some(load);
    })
}

/// What such a load does to a test: of each of two motors. The short form has one motor, and each inertia and resonance with
/// two of the four plays.
fn each_twisting(mut test: impl FnMut(Rig, &str)) {
    for seed in 0..sim::of(1, 2) {
        for times in [0.3, 1.0, 3.0, 10.0] {
            for (number, hz) in [15.0, 25.0, 40.0, 60.0, 100.0, 200.0].into_iter().enumerate() {
                let plays_deg = [0.0, 0.5, 2.0, 5.0].into_iter();
                for play_deg in plays_deg.skip(sim::of(number % 2, 0)).step_by(sim::of(2, 1)) {
                    let name = format!("{seed}: {times} times, {hz} Hz, {play_deg}°");
                    test(twisting(seed, times, hz, play_deg), &name);
                }
            }
        }
    }
}

/// The rotor swings against a load behind a coupling or a gear while it is pushed, stopped and held, and from before. One of
/// 110 checks takes that for a wrong commutation.
#[test]
fn hardly_a_load_on_a_shaft_that_twists_is_refused() {
    let mut refused = Vec::new();
    each_twisting(|mut rig, name| refused.extend(refusal(&mut rig, 4).map(|refusal| (name.to_string(), refusal))));
    println!("{refused:?}");
    assert!(refused.len() <= sim::of(2, 7), "{refused:?}");
}

/// … nor when it is driven.
#[test]
fn hardly_a_load_on_a_shaft_that_twists_looks_wrong_when_driven() {
    let mut refused = Vec::new();
    let mut number = 0;
    each_twisting(|mut rig, name| {
        rig.arm().unwrap();
        if rig.drive.mode() != Mode::Running {
            return;
        }
        number += 1;
        for speed in [5.0, -20.0, 60.0, 0.0] {
            if rig.drive.mode() == Mode::Running {
                rig.command(Command::Speed(rig.control().unwrap().speed(speed).unwrap())).unwrap();
                rig.wait(0.4);
            }
        }
        if rig.drive.mode() != Mode::Running {
            refused.push((name.to_string(), rig.drive.mode()));
        }
    });
    println!("{} {refused:?}", refused.len());
    assert!(refused.len() <= sim::of(2, 7), "{refused:?}");
}

/// How far the rotor gets from where it was within a time, while the bridge is on, degrees.
fn driven_deg(rig: &mut Rig, seconds: f64, start_rad: f64) -> f64 {
    let mut farthest = 0.0_f64;
    rig.run(seconds, |_, period| {
        if period.output.legs != Legs::NONE {
            farthest = farthest.max((period.truth.mechanical_angle_rad - start_rad).to_degrees().abs());
        }
    });
    farthest
}

/// … and what is wrong is found with it, before it has turned far. One pair of swapped wires in fifty holds the rotor
/// against the field, and it falls and swings back as one that follows would: with a speed commanded, it stalls.
#[test]
fn wrong_wires_with_a_load_on_a_shaft_that_twists_are_found() {
    let (mut missed, mut stalled, mut farthest, mut number) = (Vec::new(), 0, 0.0_f64, 0);
    each_twisting(|mut rig, name| {
        number += 1;
        let wires = if number % 2 == 0 { Wires::swapped(number / 2 % 3) } else { Wires::moved_on(1 + number / 2 % 2) };
        rig.plant.set_motor_wires(wires);
        let start = rig.plant.truth().mechanical_angle_rad;
        let mut follow = |rig: &mut Rig, seconds| farthest = farthest.max(driven_deg(rig, seconds, start));
        rig.command(Command::Arm).unwrap();
        follow(&mut rig, 0.95);
        for _ in 0..4 {
            if rig.drive.mode() == Mode::Running {
                rig.command(Command::Speed(rig.control().unwrap().speed(20.0).unwrap())).unwrap();
                follow(&mut rig, 0.9);
            }
        }
        match rig.drive.mode() {
            Mode::Faulted(Fault::Commutation) => {}
            Mode::Faulted(Fault::Stall) => stalled += 1,
            mode => missed.push((name.to_string(), wires, mode)),
        }
    });
    println!("{farthest}°, {stalled} stalled");
    assert!(missed.is_empty() && stalled <= 3 && farthest < 30.0, "{farthest}°, {stalled} stalled, {missed:?}");
}

/// With wires that do not belong there it is found out at arming or, where the rotor is too heavy to be pushed, by what it
/// does with a speed that is commanded, before it has turned far.
#[test]
fn wrong_wires_at_a_flywheel_on_uneven_magnets_are_found() {
    let mut late = Vec::new();
    for seed in 0..sim::of(12, 32) {
        for wires in [Wires::swapped(seed as usize % 3), Wires::moved_on(1 + seed as usize % 2)] {
            let mut rig = flywheel(seed);
            rig.plant.set_motor_wires(wires);
            let start = rig.plant.truth().mechanical_angle_rad;
            let mut way = 0.0_f64;
            let mut follow = |rig: &mut Rig, seconds| way = way.max(driven_deg(rig, seconds, start));
            rig.command(Command::Arm).unwrap();
            follow(&mut rig, 0.95);
            let at_arming = rig.drive.mode();
            if at_arming == Mode::Running {
                rig.command(Command::Speed(rig.control().unwrap().speed(20.0).unwrap())).unwrap();
                follow(&mut rig, 0.95);
            }
            println!("{seed} {wires:?}: {at_arming:?} {:?} {way:.1}°", rig.drive.mode());
            if !matches!(rig.drive.mode(), Mode::Faulted(Fault::Commutation)) || way > 30.0 {
                late.push((seed, at_arming, rig.drive.mode(), way));
            }
        }
    }
    assert!(late.is_empty(), "{late:?}");
}

/// A check that has passed says nothing of the next one.
#[test]
fn what_was_changed_under_power_is_found() {
    let moved = broken(24, |rig, phase| {
        rig.arm().unwrap();
        assert_eq!(rig.drive.mode(), Mode::Running);
        rig.command(Command::Disarm).unwrap();
        rig.wait(0.1);
        rig.plant.set_motor_wires(Wires::swapped(phase));
    });
    assert!(moved.iter().all(|mode| *mode == Mode::Faulted(Fault::Commutation)), "{moved:?}");
}

/// Ready, with a time-out much shorter than the check, and what happens after it.
fn with_short_time_out(on_timeout: OnTimeout) -> Rig {
    let mut rig = calibrated(3, Commutation::FieldOriented);
    let mut control = Control::default();
    (control.guard.command_timeout_s, control.guard.on_timeout) = (0.05, on_timeout);
    rig.configure(&Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() })
        .unwrap();
    rig.wait(0.1);
    rig
}

/// The time-out is that of commands to the motor; the check is none.
#[test]
fn a_short_time_out_does_not_end_the_check() {
    let mut rig = with_short_time_out(OnTimeout::Fault);
    rig.arm().unwrap();
    assert_eq!(rig.drive.mode(), Mode::Running);
    rig.wait(0.06);
    assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::CommandTimeout));
}

/// What was commanded during the check is not done when its time is over.
#[test]
fn a_command_during_the_check_is_too_old_after_it() {
    for on_timeout in [OnTimeout::Fault, OnTimeout::Stop] {
        let mut rig = with_short_time_out(on_timeout);
        rig.command(Command::Arm).unwrap();
        let speed = rig.control().unwrap().speed(50.0).unwrap();
        rig.command(Command::Speed(speed)).unwrap();
        while rig.drive.limits().contains(Limits::CHECKING) {
            rig.step();
        }
        assert_eq!(rig.drive.mode(), Mode::Running);
        let mut fastest = 0.0_f64;
        rig.run(0.5, |_, period| fastest = fastest.max(period.truth.speed_rad_s.abs()));
        assert_eq!(rig.drive.mode() == Mode::Faulted(Fault::CommandTimeout), on_timeout == OnTimeout::Fault);
        assert!(fastest < 5.0, "{fastest} rad/s");
    }
}

/// One that goes on coming is.
#[test]
fn a_command_that_is_repeated_during_the_check_is_done_after_it() {
    let mut rig = with_short_time_out(OnTimeout::Stop);
    rig.command(Command::Arm).unwrap();
    for _ in 0..60 {
        let speed = rig.control().unwrap().speed(50.0).unwrap();
        rig.command(Command::Speed(speed)).unwrap();
        rig.wait(0.02);
    }
    let speed = rig.plant.truth().speed_rad_s;
    assert!(rig.drive.mode() == Mode::Running && (speed - 50.0).abs() < 5.0, "{speed}");
}

/// A hanging load pulls at the shaft while it is checked: that is no fault. What it does afterwards, when no current is
/// commanded, is not the check's.
#[test]
fn a_load_is_no_wrong_commutation() {
    for load_nm in [-0.04, -0.02, -0.01, -0.005, 0.005, 0.01, 0.02, 0.04] {
        for seed in 0..4 {
            let mut rig = calibrated(seed, Commutation::FieldOriented);
            rig.plant.set_load(load_nm).unwrap();
            rig.arm().unwrap();
            assert_eq!(rig.drive.mode(), Mode::Running, "{load_nm} N·m, {seed}");
        }
    }
}

/// What a test finds at drone motors with as much cogging by the slots as by the poles, 2 and 4.5 % of the largest torque each.
fn each_cogging_drone<T: Send>(test: impl Fn(&str, &mut Rig) -> T + Sync) -> Vec<T> {
    let drones = ["drone-20uh", "drone-60a", "drone-15uh", "drone-stiff"];
    let drones = &drones[..sim::of(2, 4)];
    let jobs: Vec<_> = drones.iter().flat_map(|name| (3..sim::of(4, 6)).map(move |seed| (*name, seed))).collect();
    let results = jobs.into_par_iter().map(|(name, seed)| {
        let motor = motor(name);
        let mut rig = cogging::commissioned(motor, cogging::slots(motor.pairs).unwrap(), 1.5, seed).unwrap();
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        test(&format!("{name} {seed}"), &mut rig)
    });
    results.collect()
}

fn clear(rig: &mut Rig) {
    match rig.drive.mode() {
        Mode::Faulted(_) => rig.command(Command::Clear).unwrap(),
        Mode::Running => rig.command(Command::Disarm).unwrap(),
        _ => {}
    }
}

/// Clears what may be, turns the motor at some speed for some time and lets it come to rest: at another place each time.
/// Whether it was armed; the check has to be over soon.
fn rest_elsewhere(rig: &mut Rig, number: u32) -> bool {
    let share = (0.618 * f64::from(number)).fract();
    clear(rig);
    let (time_s, moved_deg, _) = check(rig);
    // One that still turns is not checked.
    let moved_deg = if time_s > 0.01 { moved_deg } else { 0.0 };
    assert!(time_s < LONGEST_CARRIED_S && moved_deg < FARTHEST_CARRIED_DEG, "{time_s} s, {moved_deg}°");
    let armed = rig.drive.mode() == Mode::Running;
    if armed {
        let speed_rad_s = (3.0 + 40.0 * share as f32) * if number.is_multiple_of(2) { 1.0 } else { -1.0 };
        rig.command(Command::Speed(rig.control().unwrap().speed(speed_rad_s).unwrap())).unwrap();
        rig.wait(0.05 + 0.1 * (7.0 * share).fract());
        rig.command(Command::Disarm).unwrap();
    }
    rig.wait(0.002 + 0.3 * (11.0 * share).fract());
    armed
}

/// Cogging carries a rotor on where it was pushed, and out of a field along its own.
#[test]
fn cogging_is_no_wrong_commutation() {
    let armings = sim::of(50, 200);
    let refused = each_cogging_drone(|name, rig| {
        let refused = (0..armings).filter(|number| !rest_elsewhere(rig, *number)).count();
        println!("{name}: {refused} of {armings} refused");
        refused
    });
    assert!(refused.iter().sum::<usize>() <= sim::of(0, 2), "{refused:?}");
}

/// … and hides none: what passes the check though it is wrong stalls.
#[test]
fn wrong_wires_at_motors_that_cog_are_found() {
    let wires = [Wires::moved_on(1), Wires::swapped(0), Wires::moved_on(2), Wires::swapped(1), Wires::swapped(2)];
    let found = each_cogging_drone(|name, rig| {
        let (mut late, mut stalled, mut farthest) = (Vec::new(), 0, 0.0_f64);
        for number in 0..sim::of(20, 100) {
            rest_elsewhere(rig, number);
            rig.wait(0.3);
            clear(rig);
            let wires = wires[number as usize % wires.len()];
            rig.plant.set_motor_wires(wires);
            let start = rig.plant.truth().mechanical_angle_rad;
            rig.command(Command::Arm).unwrap();
            let mut way = driven_deg(rig, 0.95, start);
            let at_arming = rig.drive.mode();
            if at_arming == Mode::Running {
                rig.command(Command::Speed(rig.control().unwrap().speed(20.0).unwrap())).unwrap();
                way = way.max(driven_deg(rig, 0.95, start));
            }
            stalled += u32::from(rig.drive.mode() == Mode::Faulted(Fault::Stall));
            if !matches!(rig.drive.mode(), Mode::Faulted(Fault::Commutation | Fault::Stall)) || way > 30.0 {
                late.push(format!("{name}, {number}: {wires:?}, {at_arming:?}, {:?}, {way:.1}°", rig.drive.mode()));
            }
            farthest = farthest.max(way);
            rig.plant.set_motor_wires(Wires::STRAIGHT);
        }
        println!("{name}: {farthest:.1}°, {stalled} stalled");
        (late, stalled)
    });
    let (late, stalled): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    assert!(late.iter().all(Vec::is_empty), "{late:#?}");
    assert!(stalled.iter().sum::<u32>() <= sim::of(0, 3), "{stalled:?}");
}
