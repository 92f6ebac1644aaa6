//! The pole pairs of a motor whose drive was told other ones, counted by a hand on the shaft.

use hallservo::drive::Command;
use hallservo::service::pole_pairs::{ByHand, Error};
use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::Rig;
use std::f64::consts::{PI, TAU};

/// Turns the shaft in strokes with rests between, to `turns` and `off_deg`.
fn turn_by_hand(rig: &mut Rig, count: &mut ByHand, turns: f64, off_deg: f64) {
    let strokes = 5 * turns.abs() as u32;
    let stroke = TAU * (turns + off_deg / 360.0) / f64::from(strokes);
    for _ in 0..strokes {
        for ms in 0..500 {
            // 300 ms of motion, the speed a half wave, and 200 ms of rest.
            let speed = if ms < 300 { stroke / 0.3 * PI / 2.0 * (PI * f64::from(ms) / 300.0).sin() } else { 0.0 };
            rig.plant.set_dyno(Some(speed)).unwrap();
            for _ in 0..40 {
                rig.step();
            }
            while let Some(event) = rig.service.poll() {
                count.event(&event);
            }
        }
    }
}

fn calibrated(pole_pairs: u8) -> Rig {
    let plant = PlantParameters::imperfect(3).with_pole_pairs(pole_pairs);
    let calibration_hz = if pole_pairs < 20 { 10.0 } else { 20.0 };
    // Told four, whatever there are.
    let mut rig = Rig::new(&plant, &Settings { calibration_hz, ..Settings::default() }, 5).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.wait(0.5);
    rig
}

#[test]
fn a_hand_on_the_shaft_tells_the_pole_pairs() {
    for (pole_pairs, turns) in [(2, 1.0), (4, 1.0), (7, -1.0), (14, 1.0), (21, -2.0), (40, 3.0)] {
        for off_deg in [-4.0, 4.0] {
            let mut rig = calibrated(pole_pairs);
            let mut count = ByHand::new(f64::abs(turns) as u8);
            turn_by_hand(&mut rig, &mut count, turns, off_deg);
            let found = count.finish().unwrap();
            println!("{found}");
            assert_eq!(found.pole_pairs.get(), pole_pairs);
            assert!((f64::from(found.off_deg) - 4.0).abs() < 1.0, "{found}");
        }
    }
}

#[test]
fn what_one_turn_does_not_tell_more_do() {
    let mut rig = calibrated(40);
    let mut count = ByHand::new(1);
    turn_by_hand(&mut rig, &mut count, 1.0, 3.0);
    let Err(Error::Ambiguous { turns_needed, .. }) = count.finish() else { panic!("{:?}", count.finish()) };
    assert_eq!(turns_needed, 3);
    let mut count = ByHand::new(turns_needed);
    turn_by_hand(&mut rig, &mut count, f64::from(turns_needed), 3.0);
    assert_eq!(count.finish().unwrap().pole_pairs.get(), 40);
}

#[test]
fn a_drive_that_is_not_ready_counts_nothing() {
    let mut uncalibrated = Rig::new(&PlantParameters::imperfect(3), &Settings::default(), 5).unwrap();
    let mut count = ByHand::new(1);
    turn_by_hand(&mut uncalibrated, &mut count, 1.0, 0.0);
    assert_eq!(count.finish(), Err(Error::NotReady));

    let mut rig = calibrated(4);
    rig.command(Command::Arm).unwrap();
    let mut count = ByHand::new(1);
    turn_by_hand(&mut rig, &mut count, 1.0, 0.0);
    assert_eq!(count.finish(), Err(Error::NotReady));

    // A Hall that comes loose for a moment on the way.
    let mut rig = calibrated(4);
    let mut count = ByHand::new(2);
    turn_by_hand(&mut rig, &mut count, 1.0, 0.0);
    rig.disturb = Some(Box::new(|sample| sample.halls[1] = 0));
    turn_by_hand(&mut rig, &mut count, 1.0, 0.0);
    rig.disturb = None;
    assert_eq!(count.finish(), Err(Error::NotReady));
}
