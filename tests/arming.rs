//! The check when the bridge is switched on: wires, amplifiers and commutation.

use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, Settings};
use plant::PlantParameters;
use plant::{AmplifierFault, Transistor, Wires};
use sim::rig::Rig;

fn calibrated(seed: u64, commutation: Commutation) -> Rig {
    let settings = Settings { commutation, control: Some(Control::default()), ..Settings::default() };
    let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.run(0.1, |_, _| ());
    rig.plant.set_dyno(None).unwrap();
    rig
}

/// Arms; the time that the check takes in seconds, how far the rotor went, in mechanical degrees, and the largest
/// phase current.
fn check(rig: &mut Rig) -> (f64, f64, f64) {
    let start = rig.plant.truth().mechanical_angle_rad;
    rig.command(Command::Arm).unwrap();
    let (mut time_s, mut farthest, mut current) = (0.0, 0.0_f64, 0.0_f64);
    rig.run(0.15, |rig, period| {
        if rig.drive.limits().contains(Limits::CHECKING) {
            time_s += rig.period_s();
        }
        farthest = farthest.max((period.truth.mechanical_angle_rad - start).abs());
        current = period.truth.currents_a.iter().fold(current, |most, one| most.max(one.abs()));
    });
    (time_s, farthest.to_degrees(), current)
}

#[test]
fn a_sound_motor_passes_and_hardly_moves() {
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
        for seed in 0..10 {
            let mut rig = calibrated(seed, commutation);
            let (time_s, moved_deg, current_a) = check(&mut rig);
            println!("{commutation:?} {seed}: {:.1} ms, {moved_deg:.2}°, {current_a:.2} A", 1e3 * time_s);
            assert_eq!(rig.drive.mode(), Mode::Running);
        }
    }
}

/// Breaks something on a number of motors, arms, and returns what the drive said of each.
fn broken(motors: u64, mut break_it: impl FnMut(&mut Rig, usize)) -> Vec<Mode> {
    let mut modes = Vec::new();
    for seed in 0..motors {
        let mut rig = calibrated(seed, Commutation::FieldOriented);
        break_it(&mut rig, seed as usize % 3);
        rig.run(0.1, |_, _| ());
        let (time_s, moved_deg, current_a) = check(&mut rig);
        println!("{seed}: {:.1} ms {moved_deg:.2}° {current_a:.2} A {:?}", 1e3 * time_s, rig.drive.mode());
        assert!(current_a < 3.2, "{current_a} A");
        modes.push(rig.drive.mode());
    }
    modes
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
fn swapped_motor_wires() {
    let moved = broken(12, |rig, phase| rig.plant.set_motor_wires(Wires::swapped(phase)));
    println!("{moved:?}");
}
