//! The cogging that differs from pole to pole, in a drive: learnt with the rest of it, stored, its pole found after
//! power-up, ended and counted the other way as the settings say.

use crate::tool::{ask, done, run, wait};
use hallservo::service::magnets::Use;
use hallservo_protocol::*;
use plant::{Cogging, PlantParameters};
use simulator::Simulator;
use simulator::flash::Flash;

/// A motor of four pole pairs whose magnets differ: a stronger one passes nine teeth in a turn.
fn plant(seed: u64) -> PlantParameters {
    let mut plant = PlantParameters::imperfect(seed);
    plant.motor.cogging[1] = Cogging { amplitude_nm: 0.5e-3, cycles_per_turn: 9, phase_rad: seed as f64 };
    plant
}

fn at(plant: &PlantParameters, flash: Flash) -> Simulator {
    let mut drive = Simulator::at(plant, 1, flash, Vec::new()).unwrap();
    run(&mut drive, 20);
    drive
}

fn by_pole(drive: &mut Simulator) -> CoggingByPole {
    ask(drive, Ask::Magnets(MagnetsAsk::Status), |answer| match answer {
        Answer::Magnets(status) => status.cogging,
        other => panic!("{other:?}"),
    })
}

/// Turns until the pole is found; how many tenths of a second that took.
fn found(drive: &mut Simulator, rad_s: f32) -> Option<u32> {
    (0..200).find(|_| {
        done(drive, Ask::Speed(rad_s));
        run(drive, 98);
        by_pole(drive).state == Use::Used
    })
}

/// RMS of the true speed's deviation at a low speed, rad/s.
fn ripple(drive: &mut Simulator, rad_s: f32) -> f64 {
    let mut squares = 0.0;
    for step in 0..5000 {
        if step % 400 == 0 {
            done(drive, Ask::Speed(rad_s));
        }
        run(drive, 1);
        if step >= 1000 {
            squares += (drive.plant.truth().speed_rad_s - f64::from(rad_s)).powi(2) / 4000.0;
        }
    }
    squares.sqrt()
}

#[test]
fn what_differs_from_pole_to_pole_is_learnt_stored_and_found_again() {
    let plant = plant(2);
    let mut drive = at(&plant, Flash::blank());
    assert_eq!(by_pole(&mut drive), CoggingByPole::default());
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    done(&mut drive, Ask::LearnCogging);
    wait(&mut drive);
    let learnt = by_pole(&mut drive);
    let largest_a = 0.5e-3 / (1.5 * 4.0 * 5e-3);
    assert!(
        learnt.state == Use::Used && (f64::from(learnt.rms_a) * 2_f64.sqrt() / largest_a - 1.0).abs() < 0.2,
        "{learnt:?}"
    );
    ask(&mut drive, Ask::Cogging, |answer| match answer {
        Answer::Cogging(Procedure::Done(cogging)) => assert_eq!(cogging.by_pole_a, learnt.rms_a),
        other => panic!("{other:?}"),
    });
    // Learnt again, while the first table is in use and watched, it is about the same.
    done(&mut drive, Ask::LearnCogging);
    wait(&mut drive);
    let again = by_pole(&mut drive);
    assert!(again.state == Use::Used && (again.rms_a / learnt.rms_a - 1.0).abs() < 0.1, "{again:?} {learnt:?}");
    let learnt = again;
    let flash = drive.flash();
    drop(drive);
    for (begin_rad, rad_s) in [(0.4, 8.0), (3.0, 8.0), (5.0, -8.0)] {
        let mut drive = at(&plant, Flash::of(flash.clone()));
        drive.plant.place(begin_rad, 0.0).unwrap();
        run(&mut drive, 20);
        assert_eq!(by_pole(&mut drive), CoggingByPole { state: Use::Searching, ..learnt });
        done(&mut drive, Ask::Arm);
        let without = ripple(&mut drive, rad_s / 2.0);
        let tenths = found(&mut drive, rad_s).unwrap();
        let with = ripple(&mut drive, rad_s / 2.0);
        // At the wrong pole it would be rougher than without.
        println!(
            "from {begin_rad}: found after {tenths} tenths of a second; ripple {without:.3} becomes {with:.3} rad/s"
        );
        assert!(with < 0.98 * without, "{with} {without}");
    }
}

#[test]
fn it_ends_with_the_rest_and_counts_the_other_way_with_the_angle() {
    let plant = plant(3);
    let mut drive = at(&plant, Flash::blank());
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    done(&mut drive, Ask::LearnCogging);
    wait(&mut drive);
    let learnt = by_pole(&mut drive);
    assert_eq!(learnt.state, Use::Used);
    // Other poles have no use for it, and it is gone.
    done(&mut drive, Ask::Set { name: "reversed", value: 1.0 });
    run(&mut drive, 20);
    assert_eq!(by_pole(&mut drive), CoggingByPole { state: Use::Searching, ..learnt });
    done(&mut drive, Ask::Arm);
    assert!(found(&mut drive, -8.0).is_some());
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 1500);
    done(&mut drive, Ask::Set { name: "pole_pairs", value: 5.0 });
    run(&mut drive, 20);
    assert_eq!(by_pole(&mut drive), CoggingByPole::default());
}
