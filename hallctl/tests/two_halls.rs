//! A drive with two Halls from the start: set up, armed, used, and what it does when one of the two fails.

use crate::tool::{arm, ask, done, run, status, wait};
use hallservo::drive::Refusal as DriveRefusal;
use hallservo::fault::Fault;
use hallservo::hall::Channel;
use hallservo::hall::calibrate;
use hallservo::hall::plausibility::Implausible;
use hallservo::mode::Mode;
use hallservo_protocol::*;
use plant::PlantParameters;
use rig::error_deg;
use script::HallWire;
use simulator::fault::Kind;
use simulator::flash::Flash;
use simulator::{self, Simulator};
use std::cell::RefCell;
use std::rc::Rc;

/// A motor whose two Halls are so far apart, besides errors of up to 8° each.
fn motor(apart_deg: f64, seed: u64) -> PlantParameters {
    PlantParameters::imperfect(seed).with_two_halls(apart_deg)
}

fn with_flash(plant: &PlantParameters, seed: u64, flash: Flash) -> Simulator {
    let mut drive = Simulator::at(plant, seed, flash, Vec::new()).unwrap();
    run(&mut drive, 20);
    drive
}

/// Told that it has two, and calibrated.
fn calibrated(plant: &PlantParameters, seed: u64) -> Simulator {
    let mut drive = with_flash(plant, seed, Flash::blank());
    done(&mut drive, Ask::Set { name: "halls", value: 2.0 });
    assert!(calibrate(&mut drive).is_ok());
    drive
}

fn calibrate(drive: &mut Simulator) -> Result<calibrate::Report, calibrate::Error> {
    done(drive, Ask::Calibrate);
    wait(drive);
    ask(drive, Ask::Calibration, |answer| match answer {
        Answer::Calibration(Calibration::Done(report)) => Ok(report),
        Answer::Calibration(Calibration::Failed(error)) => Err(error),
        other => panic!("{other:?}"),
    })
}

fn set_halls(drive: &mut Simulator, halls: f32) {
    done(drive, Ask::Set { name: "halls", value: halls });
    run(drive, 20);
}

fn arming_is_refused(drive: &mut Simulator) -> bool {
    ask(drive, Ask::Arm, |answer| match answer {
        Answer::Refused(Refusal::Drive(DriveRefusal::HallLost | DriveRefusal::NotCalibrated)) => true,
        Answer::Refused(other) => panic!("{other:?}"),
        _ => false,
    })
}

#[test]
fn a_drive_with_two_halls_is_set_up_stored_and_armed_again_after_power_up() {
    let plant = motor(90.0, 1);
    let mut drive = with_flash(&plant, 1, Flash::blank());
    // Not told, it misses the third, and says what to do.
    let error = calibrate(&mut drive).unwrap_err();
    assert_eq!(error, calibrate::Error::NoSignal(Channel::THIRD));
    assert!(error.to_string().contains("set `halls` to 2"));
    done(&mut drive, Ask::Clear);
    set_halls(&mut drive, 2.0);
    assert_eq!(calibrate(&mut drive).unwrap().present().len(), 2);
    done(&mut drive, Ask::Save);
    run(&mut drive, 100);
    let mut drive = with_flash(&plant, 1, Flash::of(drive.flash()));
    let now = status(&mut drive);
    assert!(now.calibrated && now.limits == hallservo::fault::Limits::NONE, "{now:?}");
    assert_eq!(now.learning, Learning::On);
    arm(&mut drive);
    done(&mut drive, Ask::Speed(100.0));
    run(&mut drive, 900);
    let speed = drive.plant.truth().speed_rad_s;
    assert!((speed - 100.0).abs() < 3.0, "{speed}");
    assert_eq!(status(&mut drive).mode, Mode::Running);
}

#[test]
fn the_number_of_halls_can_be_changed_where_that_is_safe() {
    // Three, of which the third is not used any more.
    let plant = PlantParameters::imperfect(2);
    let mut drive = with_flash(&plant, 2, Flash::blank());
    assert!(calibrate(&mut drive).is_ok());
    set_halls(&mut drive, 2.0);
    drive.happen(Kind::Hall(2, HallWire::Open)).unwrap();
    arm(&mut drive);
    keep(&mut drive, Ask::Speed(100.0), 4000);
    assert_eq!(status(&mut drive).mode, Mode::Running);
    assert!(status(&mut drive).learnt > 0);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 8000);
    // And again, as the calibration has it, whatever was learnt of two and stored; without power in between.
    let mut drive = with_flash(&plant, 2, Flash::of(drive.flash()));
    set_halls(&mut drive, 3.0);
    let of_three = error_at_speed(&mut drive);
    assert!(of_three < 0.5, "{of_three}");
    // Of two, the third is not known.
    let mut drive = calibrated(&motor(120.0, 2), 2);
    set_halls(&mut drive, 3.0);
    assert!(arming_is_refused(&mut drive));
    set_halls(&mut drive, 2.0);
    assert!(!arming_is_refused(&mut drive));
}

/// RMS of the tracked angle's error over half a second at 100 rad/s, electrical degrees.
fn error_at_speed(drive: &mut Simulator) -> f64 {
    arm(drive);
    keep(drive, Ask::Speed(100.0), 3000);
    let found = watch(drive, 100.0, 500);
    done(drive, Ask::Disarm);
    run(drive, 3000);
    found
}

fn watch(drive: &mut Simulator, rad_s: f32, milliseconds: u32) -> f64 {
    let truth = Rc::new(RefCell::new(0.0));
    let seen = truth.clone();
    drive.observe = Some(Box::new(move |_, truth| *seen.borrow_mut() = truth.electrical_angle_rad));
    let mut square = 0.0;
    for k in 0..milliseconds {
        if k % 100 == 0 {
            done(drive, Ask::Speed(rad_s));
        }
        drive.step();
        square += error_deg(drive.drive().tracker().angle(), *truth.borrow()).powi(2);
    }
    drive.observe = None;
    (square / f64::from(milliseconds)).sqrt()
}

#[test]
fn a_map_of_uneven_magnets_is_learnt_and_used_with_two_halls() {
    for (apart_deg, seed) in [(90.0, 11), (120.0, 12)] {
        let mut drive = calibrated(&simulator::uneven(motor(apart_deg, seed), 0.5, seed), seed);
        let before = error_at_speed(&mut drive);
        done(&mut drive, Ask::Magnets(MagnetsAsk::Learn));
        wait(&mut drive);
        let after = error_at_speed(&mut drive);
        println!("{apart_deg}° apart: {before:.2}° without, {after:.2}° with a map");
        assert!(before > 0.8 && after < before / 3.0, "{apart_deg}° apart: {before} {after}");
    }
}

/// What became of a running drive after a fault.
#[derive(Debug)]
struct Aftermath {
    mode: Mode,
    /// Until the bridge was off, or all of [`WATCHED_MS`].
    driven_s: f64,
    /// Largest error of the tracked angle meanwhile, electrical degrees.
    error_deg: f64,
    /// How far the shaft turned back meanwhile, degrees.
    back_deg: f64,
    /// The fastest that it turned, rad/s.
    fastest_rad_s: f64,
}

/// How long a running drive is watched after a fault.
const WATCHED_MS: u32 = 3000;

fn after(drive: &mut Simulator, kind: Kind, rad_s: f32) -> Aftermath {
    drive.happen(kind).unwrap();
    let from_ms = drive.now_ms();
    let (mut driven, mut worst_deg) = (0, 0.0_f64);
    let ways = Rc::new(RefCell::new((0.0_f64, 0.0_f64, 0.0_f64)));
    let (seen, along, period_s) = (ways.clone(), f64::from(rad_s.signum()), drive.plant.period_s());
    let (mut way, mut farthest) = (0.0, 0.0_f64);
    drive.observe = Some(Box::new(move |_, truth| {
        way += along * truth.speed_rad_s * period_s;
        farthest = farthest.max(way);
        let (angle, back, fastest) = &mut *seen.borrow_mut();
        *angle = truth.electrical_angle_rad;
        *back = back.max(farthest - way);
        *fastest = fastest.max(truth.speed_rad_s.abs());
    }));
    while drive.now_ms() < from_ms + u64::from(WATCHED_MS) {
        drive.step();
        if !drive.drive().mode().drives() {
            break;
        }
        driven = drive.now_ms() - from_ms;
        worst_deg = worst_deg.max(error_deg(drive.drive().tracker().angle(), ways.borrow().0).abs());
        if driven % 100 == 99 {
            // Refused where it has failed just then.
            ask(drive, Ask::Speed(rad_s), |_| ());
        }
    }
    drive.observe = None;
    let (_, back, fastest_rad_s) = *ways.borrow();
    let mode = drive.drive().mode();
    Aftermath {
        mode,
        driven_s: driven as f64 / 1000.0,
        error_deg: worst_deg,
        back_deg: back.to_degrees(),
        fastest_rad_s,
    }
}

/// The short form breaks each Hall at one place, the whole one at two. The form for a night:
/// `ROTORS=12 cargo test -p hallctl --test all two_halls -- --nocapture`.
#[test]
fn one_of_two_halls_that_fails_is_a_fault() {
    let (mut stuck, mut stalls, mut unnoticed, mut back_deg) = (0, 0, 0, 0.0_f64);
    for (apart_deg, seed) in [(90.0, 3), (-90.0, 4), (120.0, 5), (-120.0, 6), (60.0, 7)] {
        let plant = motor(apart_deg, seed);
        let flash = calibrated(&plant, seed).flash();
        for (hall, rad_s) in [0, 1].into_iter().flat_map(|hall| [1.0, -10.0, 60.0, -300.0].map(|speed| (hall, speed))) {
            for when in (0..sim::rotors(sim::of(1, 2))).map(|k| 7 * k as u32) {
                let running = |wire| {
                    let mut drive = with_flash(&plant, seed, Flash::of(flash.clone()));
                    done(&mut drive, Ask::Set { name: "halls", value: 2.0 });
                    run(&mut drive, 20);
                    arm(&mut drive);
                    done(&mut drive, Ask::Speed(rad_s));
                    run(&mut drive, 500 + when);
                    let found = after(&mut drive, Kind::Hall(hall, wire), rad_s);
                    println!("{apart_deg}° apart, Hall {} {wire:?} at {rad_s} rad/s: {found:?}", hall + 1);
                    found
                };
                for wire in [HallWire::Open, HallWire::Ground, HallWire::Supply] {
                    let found = running(wire);
                    let named = Fault::Hall(Implausible::AtRail(Channel(hall as u8)));
                    assert_eq!((found.mode, found.driven_s), (Mode::Faulted(named), 0.0), "{wire:?}");
                }
                let found = running(HallWire::Stuck);
                stuck += 1;
                stalls += u32::from(found.mode == Mode::Faulted(Fault::Stall));
                unnoticed += u32::from(found.mode == Mode::Running);
                back_deg = back_deg.max(found.back_deg);
                // It rocks or locks, but does not run away.
                assert!(found.fastest_rad_s < f64::from(rad_s.abs()) + 60.0 && found.back_deg < 45.0, "{found:?}");
            }
        }
    }
    println!("{stuck} stuck Halls: {stalls} a stall, {unnoticed} not noticed; {back_deg:.0}° turned back at most");
    assert!(unnoticed * 50 <= stuck, "{unnoticed} of {stuck}");
}

#[test]
fn what_is_at_the_third_input_does_not_matter() {
    let mut drive = calibrated(&motor(90.0, 8), 8);
    arm(&mut drive);
    for wire in [HallWire::Open, HallWire::Ground, HallWire::Supply, HallWire::Good] {
        let found = after(&mut drive, Kind::Hall(2, wire), 50.0);
        assert!(found.mode == Mode::Running && found.error_deg < 5.0, "{wire:?}: {found:?}");
    }
}

/// Runs on for a time with a command that is told again and again.
fn keep(drive: &mut Simulator, what: Ask<'_>, milliseconds: u32) {
    for _ in 0..milliseconds / 100 {
        done(drive, what);
        run(drive, 98);
    }
}

/// The short form has one rotor with its Halls 90° apart and one with 120°, not each in both directions.
#[test]
fn healthy_halls_at_uneven_magnets_and_loads_are_not_taken_for_broken() {
    for seed in 1..=sim::rotors(sim::of(2, 4)) {
        let apart_deg = [90.0, -90.0, 120.0, -120.0][seed as usize % 4];
        let plant = simulator::uneven(motor(apart_deg, seed), 0.5, seed);
        let mut drive = calibrated(&plant, seed);
        arm(&mut drive);
        for rad_s in [1.0, -5.0, 30.0, -100.0, 300.0, -300.0] {
            keep(&mut drive, Ask::Speed(rad_s), 1000);
        }
        // A load that comes and goes, up to two thirds of the motor's torque, for and against the motion.
        for load_nm in [0.03, -0.06, 0.06, 0.0] {
            drive.happen(Kind::Load(load_nm)).unwrap();
            for rad_s in [-20.0, 150.0] {
                keep(&mut drive, Ask::Speed(rad_s), 600);
            }
        }
        keep(&mut drive, Ask::Speed(0.0), 500);
        let here = status(&mut drive).position_turns;
        for turns in [3.0, -2.0, 2.2] {
            keep(&mut drive, Ask::Position(here + turns), 800);
        }
        // Blocked by hand and let go.
        for dyno in [Some(0.0), None] {
            drive.plant.set_dyno(dyno).unwrap();
            keep(&mut drive, Ask::Speed(40.0), 300);
        }
        assert_eq!(drive.drive().mode(), Mode::Running, "{apart_deg}° apart, rotor {seed}");
    }
}
