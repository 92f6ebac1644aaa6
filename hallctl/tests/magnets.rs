//! The map of the rotor's magnets in a drive: learnt, stored, found again after power-up, dropped where it does not fit.

mod tool;

use hallctl::simulate::Simulator;
use hallctl::simulate::flash::Flash;
use hallctl::simulate::uneven;
use hallservo::service::magnets::Use;
use hallservo_protocol::*;
use plant::PlantParameters;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sim::rig::error_deg;
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::rc::Rc;
use tool::{ask, done, run, status, wait};

fn at(plant: &PlantParameters, seed: u64, flash: Flash) -> Simulator {
    Simulator::at(plant, seed, flash, Vec::new()).unwrap()
}

fn magnets(drive: &mut Simulator) -> MagnetsStatus {
    ask(drive, Ask::Magnets(MagnetsAsk::Status), |answer| match answer {
        Answer::Magnets(status) => status,
        other => panic!("{other:?}"),
    })
}

fn calibrated(plant: &PlantParameters, seed: u64) -> Simulator {
    let mut drive = at(plant, seed, Flash::blank());
    run(&mut drive, 10);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    drive
}

fn learn(drive: &mut Simulator) -> MagnetsStatus {
    done(drive, Ask::Magnets(MagnetsAsk::Learn));
    assert_eq!(status(drive).activity, Activity::Magnets);
    wait(drive);
    magnets(drive)
}

/// Runs at a speed for a time; keeps the command alive.
fn turn(drive: &mut Simulator, rad_s: f32, milliseconds: u32) {
    for _ in 0..milliseconds / 100 {
        done(drive, Ask::Speed(rad_s));
        run(drive, 98);
    }
}

fn arm(drive: &mut Simulator) {
    done(drive, Ask::Arm);
    run(drive, 100);
}

/// RMS of the tracked angle's error over half a second at a speed, electrical degrees.
fn error(drive: &mut Simulator, rad_s: f32) -> f64 {
    turn(drive, rad_s, 500);
    let truth = Rc::new(RefCell::new(Vec::new()));
    let seen = truth.clone();
    drive.observe = Some(Box::new(move |_, truth| seen.borrow_mut().push(truth.electrical_angle_rad)));
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..500 {
        if k % 100 == 0 {
            turn(drive, rad_s, 100);
        }
        drive.step();
        let last = *truth.borrow().last().unwrap();
        sum += error_deg(drive.drive().tracker().angle(), last).powi(2);
        count += 1.0;
    }
    drive.observe = None;
    (sum / count).sqrt()
}

#[test]
fn a_map_is_learnt_used_stored_and_found_again_after_power_up() {
    let mut random = Pcg64::seed_from_u64(1);
    for seed in 1..4 {
        let plant = uneven(seed, 1.0);
        let mut drive = calibrated(&plant, seed);
        arm(&mut drive);
        let before = error(&mut drive, 100.0);
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 3000);
        let learnt = learn(&mut drive);
        println!("{seed}: {learnt:?}");
        assert_eq!((learnt.state, learnt.stored), (Use::Used, Problem::None));
        assert!(learnt.report.kept && learnt.report.found_again);
        arm(&mut drive);
        let after = error(&mut drive, 100.0);
        println!("{seed}: {before:.2}° becomes {after:.2}°");
        assert!(before > 1.0 && after < 0.25, "{seed}: {before} {after}");
        let flash = drive.flash();
        for _ in 0..4 {
            let mut drive = at(&plant, seed, Flash::of(flash.clone()));
            drive.plant.place(random.random_range(0.0..TAU), 0.0).unwrap();
            run(&mut drive, 20);
            assert_eq!(magnets(&mut drive).state, Use::Searching);
            arm(&mut drive);
            let speed = if random.random() { 100.0 } else { -100.0 };
            let mut turns = drive.plant.truth().mechanical_angle_rad / TAU;
            while magnets(&mut drive).state != Use::Used {
                turn(&mut drive, speed, 100);
                assert!(drive.now_ms() < 10_000, "{:?}", magnets(&mut drive));
            }
            turns = (drive.plant.truth().mechanical_angle_rad / TAU - turns).abs();
            let after = error(&mut drive, speed);
            println!("  found again after {turns:.1} turns: {after:.2}° {:?}", magnets(&mut drive));
            assert!(after < 0.25, "{seed}: {after}");
        }
    }
}
