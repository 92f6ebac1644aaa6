//! The check when the bridge is switched on: wires, amplifiers and commutation.

use hallservo::board::Sample;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, Settings};
use plant::PlantParameters;
use sim::rig::Rig;

fn calibrated(seed: u64, commutation: Commutation) -> Rig {
    let settings = Settings { commutation, control: Some(Control::default()), ..Settings::default() };
    let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.run(0.1, |_, _| ());
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

#[test]
fn a_blind_amplifier_is_named() {
    for (phase, fault) in [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC].into_iter().enumerate() {
        let mut rig = calibrated(phase as u64, Commutation::FieldOriented);
        rig.disturb = Some(Box::new(move |sample: &mut Sample| sample.currents[phase] = 2050));
        rig.run(0.1, |_, _| ());
        let (_, moved_deg, current_a) = check(&mut rig);
        println!("{moved_deg:.2}° {current_a:.2} A");
        assert_eq!(rig.drive.mode(), Mode::Faulted(fault));
    }
}

#[test]
fn halls_moved_on_by_one_are_found() {
    for seed in 0..20 {
        let mut rig = calibrated(seed, Commutation::FieldOriented);
        let on = 1 + seed as usize % 2;
        rig.disturb = Some(Box::new(move |sample: &mut Sample| sample.halls.rotate_left(on)));
        rig.run(0.1, |_, _| ());
        let (time_s, moved_deg, current_a) = check(&mut rig);
        println!("{seed}: {:.1} ms {moved_deg:.2}° {current_a:.2} A {:?}", 1e3 * time_s, rig.drive.mode());
    }
}
