//! The field of the windings in the Halls' signals: the drive measures it and takes it off, at motors whose Halls do not
//! see it alike.

use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::settings::{Control, Settings};
use plant::PlantParameters;
use rayon::prelude::*;
use rig::motors::MOTORS;
use rig::motors::with_windings;
use rig::{Rig, error_deg};
use sim::experiment::coil::{Trial, trial, true_deg_a};
use sim::experiment::magnets;
use sim::statistics::Statistics;

/// Light, heavy, and with a noisy current.
const CHOSEN: [&str; 4] = ["paper", "drone-heavy", "gimbal-7", "drone-20uh"];

fn trials(names: &[&str], share: f64) -> Vec<Trial> {
    let chosen: Vec<_> = MOTORS.iter().filter(|motor| names.contains(&motor.name)).collect();
    chosen.par_iter().map(|motor| trial(motor, share, 7).unwrap()).inspect(|trial| println!("{trial:?}")).collect()
}

/// The short form leaves out those with a noisy current.
#[test]
fn it_is_measured_within_its_error_and_taken_off() {
    for trial in trials(&CHOSEN[..sim::of(2, 4)], 0.05) {
        let off_deg = (trial.found_deg - trial.true_deg).abs();
        assert!(off_deg <= trial.error_deg && trial.error_deg < 1.0, "{trial:?}");
        // Seven tenths of what it turns the angle by at the largest current; what is left is the Halls' differences.
        assert!(trial.before.loaded_deg > 0.6 * trial.true_deg, "{trial:?}");
        assert!(trial.after.loaded_deg < 0.4, "{trial:?}");
        assert!(trial.after.torque_deg < trial.before.torque_deg.max(1.2), "{trial:?}");
    }
}

/// The short form has two of the motors, of which one has a noisy current.
#[test]
fn where_there_is_none_nothing_is_taken_off() {
    for trial in trials(&CHOSEN[sim::of(2, 0)..], 0.0) {
        assert!(trial.found_deg.abs() <= trial.error_deg && trial.error_deg < 1.0, "{trial:?}");
        assert!((trial.after.loaded_deg - trial.before.loaded_deg).abs() < 0.05, "{trial:?}");
    }
}

/// A calibrated drive that knows the field of its windings, at a tenth of the magnets'.
fn compensated() -> Rig {
    let plant = with_windings(PlantParameters::imperfect(3), 0.1, 3.0, 3);
    let settings = magnets::settings();
    let hall_coil_deg_a = true_deg_a(&plant) as f32;
    let control = settings.control.map(|control| Control { hall_coil_deg_a, ..control });
    let mut rig = Rig::new(&plant, &Settings { control, ..settings }, 3).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig
}

#[test]
fn nothing_is_taken_off_once_the_current_is_gone() {
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
        let mut rig = compensated();
        rig.command(Command::Commutate(commutation)).unwrap();
        rig.arm().unwrap();
        rig.plant.set_dyno(Some(3.0)).unwrap();
        rig.command(Command::Current(rig.control().unwrap().current(2.5).unwrap())).unwrap();
        rig.wait(0.2);
        let mut errors = [Statistics::default(); 3];
        let mut look = |rig: &mut Rig, which: usize| {
            rig.run(0.5, |rig, period| {
                errors[which].push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
            });
        };
        look(&mut rig, 0);
        // By a modulation, whose current is not looked at; then the bridge is off.
        rig.drive_with(0.0).unwrap();
        rig.wait(0.05);
        look(&mut rig, 1);
        rig.command(Command::Disarm).unwrap();
        rig.wait(0.05);
        look(&mut rig, 2);
        println!("{commutation:?}: {errors:?}");
        // 5.3° if it were not taken off, or still. Block commutation has a current along d as well.
        for (error, most_deg) in errors.iter().zip([1.0, 0.3, 0.3]) {
            assert!(error.mean().abs() < most_deg, "{commutation:?}: {errors:?}");
        }
    }
}

#[test]
fn more_than_a_twelfth_of_a_turn_at_the_largest_current_is_refused() {
    for (deg_a, fits) in [(9.9, true), (10.1, false), (-9.9, true), (-10.1, false), (f32::NAN, false)] {
        let control = Control { hall_coil_deg_a: deg_a, ..Control::default() };
        let result = Settings { control: Some(control), ..Settings::default() }.validate();
        assert_eq!(result.is_ok(), fits, "{deg_a}");
        if let Err(error) = result {
            assert!(error.to_string().contains("hall_coil_deg_a"), "{error}");
        }
    }
}
