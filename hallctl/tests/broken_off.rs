//! A calibration that comes to nothing leaves the one before and its map of the magnets, in use and in the flash.

use crate::magnets::{self, LEARNT, find, powered_up, uneven};
use crate::tool::{arm, ask, calibrated, done, drive, request_of, run, status, wait};
use hallservo::drive::Refusal as DriveRefusal;
use hallservo::drive::standstill::Probe;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::service::magnets::Use;
use hallservo::storage::{self, Store, cogging, settings};
use hallservo_protocol::*;
use plant::{HallFault, Rail};
use simulator::Simulator;
use simulator::fault::Kind;
use simulator::flash::Flash;

/// What ends it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    Disarmed,
    Braked,
    Silent,
    Faulted,
    /// The samples show no calibration.
    Refused,
}

const ENDS: [End; 5] = [End::Disarmed, End::Braked, End::Silent, End::Faulted, End::Refused];

/// Begins a calibration and lets it end before it has succeeded, after so many milliseconds.
fn break_off(drive: &mut Simulator, end: End, after_ms: u32) {
    done(drive, Ask::Calibrate);
    for _ in 0..after_ms / 10 {
        run(drive, 8);
        status(drive);
    }
    assert!(matches!(drive.drive().mode(), Mode::Aligning | Mode::Calibrating), "{end:?}");
    match end {
        End::Disarmed => done(drive, Ask::Disarm),
        End::Braked => {
            done(drive, Ask::Speed(0.0));
            run(drive, 60);
            done(drive, Ask::Disarm);
        }
        End::Silent => run(drive, 1200),
        End::Faulted => {
            drive.happen(Kind::Bus(60.0)).unwrap();
            run(drive, 50);
            drive.happen(Kind::Bus(24.0)).unwrap();
        }
        // Held by a hand, the rotor shows the Halls nothing.
        End::Refused => {
            drive.plant.set_dyno(Some(0.0)).unwrap();
            wait(drive);
            assert_eq!(status(drive).mode, Mode::Faulted(Fault::Calibration));
            drive.plant.set_dyno(None).unwrap();
        }
    }
    run(drive, 50);
    if matches!(end, End::Faulted | End::Refused) {
        assert!(matches!(status(drive).mode, Mode::Faulted(_)), "{end:?}");
        done(drive, Ask::Clear);
    }
}

fn outcome(drive: &mut Simulator) -> Calibration {
    ask(drive, Ask::Calibration, |answer| match answer {
        Answer::Calibration(outcome) => outcome,
        other => panic!("{other:?}"),
    })
}

fn turns(drive: &mut Simulator) {
    arm(drive);
    for _ in 0..8 {
        done(drive, Ask::Speed(60.0));
        run(drive, 98);
    }
    let speed = drive.plant.truth().speed_rad_s;
    assert!((speed - 60.0).abs() < 5.0, "{speed}, {:?}", status(drive).mode);
}

/// The short form ends each while the rotor is swept, the full one while it is aligned, too.
#[test]
fn the_calibration_before_is_taken_up_again() {
    for end in ENDS {
        for after_ms in [2000, 200].into_iter().take(sim::of(1, 2)) {
            let (mut drive, flash) = calibrated();
            break_off(&mut drive, end, after_ms);
            let outcome = outcome(&mut drive);
            assert!(matches!(outcome, Calibration::Ended | Calibration::Failed(_)), "{end:?}: {outcome:?}");
            // At once.
            turns(&mut drive);
            done(&mut drive, Ask::Disarm);
            run(&mut drive, 3000);
            let found = status(&mut drive);
            assert_eq!((found.mode, found.stored[0]), (Mode::Ready, Problem::None), "{end:?}");
            assert!(drive.flash() == flash, "{end:?}: the flash was written");
        }
    }
}

/// So is the one of a drive whose windings were being measured, and in the direction that is set.
#[test]
fn a_measurement_at_standstill_leaves_the_calibration() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "reversed", value: 1.0 });
    run(&mut drive, 20);
    done(&mut drive, Ask::Measure { begins: true, probe: Probe::default() });
    run(&mut drive, 100);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 50);
    arm(&mut drive);
    done(&mut drive, Ask::Disarm);
    break_off(&mut drive, End::Disarmed, 500);
    run(&mut drive, 50);
    arm(&mut drive);
    done(&mut drive, Ask::Speed(60.0));
    run(&mut drive, 800);
    let speed = drive.plant.truth().speed_rad_s;
    assert!((speed + 60.0).abs() < 5.0, "{speed}");
}

/// The other direction may be set when a calibration is there already, and before the next one comes to nothing.
#[test]
fn the_calibration_before_counts_the_way_that_is_set_since() {
    for (before, during) in [(true, false), (false, true), (true, true)] {
        let (mut drive, _) = calibrated();
        let reverse = |drive: &mut Simulator, value| {
            done(drive, Ask::Set { name: "reversed", value });
            run(drive, 20);
        };
        if before {
            reverse(&mut drive, 1.0);
        }
        break_off(&mut drive, if during { End::Faulted } else { End::Disarmed }, 500);
        if during {
            reverse(&mut drive, if before { 0.0 } else { 1.0 });
        }
        run(&mut drive, 50);
        arm(&mut drive);
        done(&mut drive, Ask::Speed(60.0));
        run(&mut drive, 800);
        let wanted = if before == during { 60.0 } else { -60.0 };
        let speed = drive.plant.truth().speed_rad_s;
        assert!((speed - wanted).abs() < 5.0, "{before} {during}: {speed}, {:?}", status(&mut drive).mode);
    }
}

#[test]
fn a_drive_that_was_never_calibrated_is_not_by_one_that_was_broken_off() {
    for end in [End::Disarmed, End::Faulted] {
        let mut drive = drive(Flash::blank());
        run(&mut drive, 10);
        break_off(&mut drive, end, 500);
        run(&mut drive, 500);
        ask(&mut drive, Ask::Arm, |answer| {
            assert_eq!(answer, Answer::Refused(Refusal::Drive(DriveRefusal::NotCalibrated)), "{end:?}");
        });
        assert!(!status(&mut drive).calibrated);
    }
}

/// A Hall's wire that had no contact may have none again: only a calibration that succeeds trusts it.
#[test]
fn a_lost_hall_stays_lost() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "run_on_two_halls", value: 1.0 });
    arm(&mut drive);
    done(&mut drive, Ask::Speed(60.0));
    run(&mut drive, 300);
    drive.plant.set_hall_fault(0, Some(HallFault::Open(Rail::Low)));
    run(&mut drive, 300);
    done(&mut drive, Ask::Disarm);
    drive.plant.set_hall_fault(0, None);
    run(&mut drive, 1500);
    break_off(&mut drive, End::Refused, 500);
    run(&mut drive, 500);
    ask(&mut drive, Ask::Arm, |answer| {
        assert_eq!(answer, Answer::Refused(Refusal::Drive(DriveRefusal::HallLost)));
    });
}

#[test]
fn the_map_of_the_magnets_is_found_again() {
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.0);
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000));
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 3000);
    break_off(&mut drive, End::Disarmed, 2000);
    run(&mut drive, 3000);
    let found = magnets::magnets(&mut drive);
    assert_eq!((found.state, found.stored), (Use::Searching, Problem::None));
    assert!(drive.flash() == *LEARNT, "the flash was written");
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000), "{:?}", magnets::magnets(&mut drive));
}

/// What the flash holds of the sensors.
fn sensors(flash: &[u8]) -> Vec<u8> {
    const LONGEST: usize = if settings::LONGEST > cogging::LONGEST { settings::LONGEST } else { cogging::LONGEST };
    let mut place = [0; LONGEST];
    let mut store = Store::<_, { storage::size(LONGEST) }>::new(Flash::of(flash.to_vec()), 0, 0, 0x0102).unwrap();
    let length = store.load(&mut place).unwrap();
    place[..length].to_vec()
}

/// Whatever the moment: never the old calibration without its map, nor the new one with the old one's.
#[test]
fn a_power_cut_leaves_the_old_calibration_with_its_map_or_the_new_one() {
    let plant = uneven(1, 1.0);
    let flash = Flash::of(LEARNT.clone());
    let mut drive = Simulator::at(&plant, 2, flash.clone(), Vec::new()).unwrap();
    run(&mut drive, 20);
    flash.note_states();
    let old = sensors(&flash.bytes());
    begin_unattended(&mut drive);
    wait(&mut drive);
    let new = sensors(&flash.bytes());
    assert_ne!(old, new);
    let (mut olds, mut news) = (0, 0);
    for state in flash.states().into_iter().chain([flash.bytes()]) {
        let found = sensors(&state);
        assert!(found == old || found == new);
        let mut drive = powered_up(&plant, state, 1.0);
        let map = magnets::magnets(&mut drive);
        assert!(status(&mut drive).calibrated);
        if found == old {
            olds += 1;
            assert_eq!((map.state, map.stored), (Use::Searching, Problem::None), "{olds}");
        } else {
            news += 1;
            assert_eq!(map.state, Use::None, "{news}");
        }
    }
    assert!(olds > 10 && news > 2, "{olds} {news}");
}

fn begin_unattended(drive: &mut Simulator) {
    drive.write(&request_of(1, true, 1, Ask::Calibrate));
    run(drive, 3);
}

/// One that no erase could keep yet, for something turns the rotor, is the one before all the same, and kept when it can be.
#[test]
fn a_calibration_that_is_not_saved_yet_is_taken_up_again() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    begin_unattended(&mut drive);
    while matches!(drive.drive().mode(), Mode::Aligning | Mode::Calibrating) {
        drive.step();
    }
    drive.plant.set_dyno(Some(15.0)).unwrap();
    wait(&mut drive);
    assert!(matches!(outcome(&mut drive), Calibration::Done(_)) && status(&mut drive).unsaved);
    break_off(&mut drive, End::Disarmed, 500);
    drive.plant.set_dyno(None).unwrap();
    run(&mut drive, 3000);
    let found = status(&mut drive);
    assert_eq!((found.mode, found.stored[0], found.unsaved), (Mode::Ready, Problem::None, false));
    turns(&mut drive);
    let mut again = crate::tool::drive(Flash::of(drive.flash()));
    run(&mut again, 10);
    assert!(status(&mut again).calibrated);
}
