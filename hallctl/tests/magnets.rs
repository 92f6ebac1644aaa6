//! The map of the rotor's magnets in a drive: learnt, stored, found again after power-up, dropped where it does not fit.

use crate::process::Drive;
use crate::tool::{ask, done, run, status, wait};
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::service::magnets::Use;
use hallservo_protocol::*;
use plant::{PlantParameters, Unevenness};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rig::error_deg;
use rig::motors::MOTORS;
use simulator::flash::Flash;
use simulator::{self, Simulator};
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::rc::Rc;
use std::sync::LazyLock;

pub fn at(plant: &PlantParameters, seed: u64, flash: Flash) -> Simulator {
    Simulator::at(plant, seed, flash, Vec::new()).unwrap()
}

pub fn magnets(drive: &mut Simulator) -> MagnetsStatus {
    ask(drive, Ask::Magnets(MagnetsAsk::Status), |answer| match answer {
        Answer::Magnets(status) => status,
        other => panic!("{other:?}"),
    })
}

/// A motor whose magnets are so many times as uneven as those of a cheap one.
pub fn uneven(seed: u64, times: f64) -> PlantParameters {
    simulator::uneven(PlantParameters::imperfect(seed), times, seed)
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

/// A flash with a calibration and a map of a cheap rotor.
pub static LEARNT: LazyLock<Vec<u8>> = LazyLock::new(|| learnt(1));

fn learnt(seed: u64) -> Vec<u8> {
    learnt_of(&uneven(seed, 1.0), seed)
}

fn learnt_of(plant: &PlantParameters, seed: u64) -> Vec<u8> {
    let mut drive = calibrated(plant, seed);
    let status = learn(&mut drive);
    assert_eq!((status.state, status.stored), (Use::Used, Problem::None));
    drive.flash()
}

/// Powered up at an angle, the map not found yet.
pub fn powered_up(plant: &PlantParameters, flash: Vec<u8>, angle_rad: f64) -> Simulator {
    let mut drive = at(plant, 1, Flash::of(flash));
    drive.plant.place(angle_rad, 0.0).unwrap();
    run(&mut drive, 20);
    drive
}

/// Turns until the map is used, or gives up after a time.
pub fn find(drive: &mut Simulator, rad_s: f32, longest_ms: u64) -> bool {
    let from_ms = drive.now_ms();
    while magnets(drive).state != Use::Used && drive.now_ms() < from_ms + longest_ms {
        turn(drive, rad_s, 100);
    }
    magnets(drive).state == Use::Used
}

/// The short form leaves out one of two cheap rotors, and a second power-up of each.
#[test]
fn a_map_is_learnt_used_stored_and_found_again_after_power_up() {
    let mut random = Pcg64::seed_from_u64(1);
    for (seed, times) in [(1, 1.0), (2, 1.0), (3, 0.25)].into_iter().step_by(sim::of(2, 1)) {
        let plant = uneven(seed, times);
        let mut drive = calibrated(&plant, seed);
        arm(&mut drive);
        let before = error(&mut drive, 100.0);
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 3000);
        let learnt = learn(&mut drive);
        assert_eq!((learnt.state, learnt.stored), (Use::Used, Problem::None));
        assert!(learnt.report.kept && learnt.report.found_again);
        arm(&mut drive);
        let after = error(&mut drive, 100.0);
        let MagnetsReport { without_deg, with_deg, .. } = learnt.report;
        println!("{seed}: {before:.2}° becomes {after:.2}°, said to be {without_deg:.2}° and {with_deg:.2}°");
        assert!(before > 2.0 * times && after < 0.2, "{seed}: {before} {after}");
        // What is said is the magnets' part; noise and the alignment are in what is measured.
        let (said, kept) = (f64::from(without_deg), f64::from(with_deg));
        assert!((said - before).abs() < 0.15 * before + 0.05 && (kept - after).abs() < 0.05, "{seed}");
        let flash = drive.flash();
        for _ in 0..sim::rotors(sim::of(1, 2)).min(4) {
            let mut drive = at(&plant, seed, Flash::of(flash.clone()));
            drive.plant.place(random.random_range(0.0..TAU), 0.0).unwrap();
            run(&mut drive, 20);
            assert_eq!(magnets(&mut drive).state, Use::Searching);
            arm(&mut drive);
            let speed = if random.random() { 100.0 } else { -100.0 };
            let from = drive.plant.truth().mechanical_angle_rad;
            assert!(find(&mut drive, speed, 5000), "{:?}", magnets(&mut drive));
            let turns = (drive.plant.truth().mechanical_angle_rad - from).abs() / TAU;
            let after = error(&mut drive, speed);
            println!("  found again after {turns:.1} turns: {after:.2}°, fit {:.2}", magnets(&mut drive).fit);
            assert!(after < 0.2, "{seed}: {after}");
        }
    }
}

/// The short form goes over every other speed and time between the reversals.
#[test]
fn a_map_is_found_while_the_motor_reverses_and_never_at_a_wrong_pole() {
    let plant = uneven(1, 1.0);
    let ways = [(100.0, 2), (60.0, 5), (30.0, 10), (200.0, 3), (10.0, 40), (100.0, 1)];
    for (number, (speed, period)) in ways.into_iter().enumerate().skip(sim::of(1, 0)).step_by(sim::of(2, 1)) {
        let mut drive = powered_up(&plant, LEARNT.clone(), 1.7 * number as f64);
        arm(&mut drive);
        let mut found = false;
        for k in 0..100 {
            let direction = if k / period % 2 == 0 { 1.0 } else { -1.0 };
            turn(&mut drive, direction * speed, 100);
            found = magnets(&mut drive).state == Use::Used;
        }
        let after = error(&mut drive, 100.0);
        println!("±{speed} rad/s for {period}00 ms: found {found}, {after:.2}°");
        assert!(!found || after < 0.2, "{after}");
    }
}

#[test]
fn even_magnets_need_no_map() {
    let mut drive = calibrated(&uneven(1, 0.0), 1);
    let status = learn(&mut drive);
    println!("{status:?}");
    assert!(matches!(status.learning, Procedure::Done(MagnetsReport { kept: false, .. })));
    assert_eq!((status.state, status.pole_pairs, status.stored), (Use::None, 0, Problem::Blank));
}

#[test]
fn the_map_of_another_rotor_is_never_used() {
    // The same Halls over other magnets.
    let cheap = Unevenness { rated_a: 6.0, ..Unevenness::CHEAP };
    for seed in 2..2 + sim::rotors(2) {
        let plant = PlantParameters::imperfect(1).with_unevenness(&cheap, seed);
        let mut drive = powered_up(&plant, LEARNT.clone(), seed as f64);
        arm(&mut drive);
        for speed in [100.0, -40.0, 200.0] {
            assert!(!find(&mut drive, speed, 5000), "{seed}");
        }
        println!("{seed}: {:?}", magnets(&mut drive));
    }
    let mut drive = powered_up(&uneven(1, 0.0), LEARNT.clone(), 1.0);
    arm(&mut drive);
    assert!(!find(&mut drive, 100.0, 10_000));
}

#[test]
fn a_rotor_swapped_while_the_map_is_at_work_ends_it() {
    // The turns are counted by the Halls: a rotor that slips by a magnet behind their back is at another pole.
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.4);
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000));
    let truth = drive.plant.truth();
    drive.plant.place(truth.mechanical_angle_rad + TAU / 4.0, truth.speed_rad_s).unwrap();
    let mut ended = 0;
    for tenth in 0..50 {
        turn(&mut drive, 100.0, 100);
        if magnets(&mut drive).state != Use::Used && ended == 0 {
            ended = tenth;
        }
    }
    println!("ended after {ended} tenths of a second; then {:?}", magnets(&mut drive));
    assert!((1..20).contains(&ended));
    // It is found again, at the right pole.
    assert!(find(&mut drive, 100.0, 5000));
    assert!(error(&mut drive, 100.0) < 0.2);
}

/// What shakes the rotor faster than its torque is measured tells nothing of the map.
fn a_map_stays_in_use_while_it_is_shaken(options: &[&str], prepare: &[&str], shaken: &[&[&str]]) {
    let drive = Drive::start(options);
    drive.ok(prepare);
    drive.ok(&["magnets", "learn"]);
    for shaken in shaken {
        drive.ok(shaken);
        let shown = drive.ok(&["magnets", "show"]);
        assert!(shown.contains("The map is in use"), "{options:?} {shaken:?}: {shown}");
    }
}

const SHAKEN: [&[&str]; 4] = [&["tune"], &["chirp", "speed"], &["tune"], &["tune"]];

/// The short form tunes once, not three times.
#[test]
fn a_map_stays_in_use_while_the_loops_are_tuned_and_swept() {
    a_map_stays_in_use_while_it_is_shaken(&["--uneven", "1"], &["calibrate"], &SHAKEN[..sim::of(2, 4)]);
}

/// The short form only sweeps it: steps are made at the motor above.
#[test]
fn a_map_stays_in_use_while_a_light_motor_is_tuned_and_swept() {
    let commission = ["commission", "--max-current", "2", "--pole-pairs", "11", "--yes"];
    let gimbal = ["--uneven", "1", "--motor", "gimbal-11"];
    a_map_stays_in_use_while_it_is_shaken(&gimbal, &commission, sim::of(&SHAKEN[1..2], &SHAKEN));
}

#[test]
fn a_map_with_a_right_crc_of_another_motor_is_foreign() {
    let (mut flash, other) = (LEARNT.clone(), learnt(2));
    let from = flash.len() - 2 * 2048;
    flash[from..].copy_from_slice(&other[from..]);
    let mut drive = powered_up(&uneven(1, 1.0), flash, 0.0);
    let status = magnets(&mut drive);
    assert_eq!((status.state, status.stored), (Use::None, Problem::Foreign));
    let incident = ask(&mut drive, Ask::History(0), |answer| match answer {
        Answer::History(history) => history.entry.unwrap().cause,
        other => panic!("{other:?}"),
    });
    assert_eq!(incident, Cause::Stored(Record::Magnets, Problem::Foreign));
    arm(&mut drive);
    assert!(!find(&mut drive, 100.0, 3000));
}

#[test]
fn a_calibration_gives_the_map_up_and_so_does_forgetting_it() {
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.0);
    assert_eq!(magnets(&mut drive).state, Use::Searching);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    assert_eq!((magnets(&mut drive).state, magnets(&mut drive).stored), (Use::None, Problem::Blank));
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.0);
    done(&mut drive, Ask::Magnets(MagnetsAsk::Forget));
    run(&mut drive, 100);
    let mut drive = powered_up(&uneven(1, 1.0), drive.flash(), 0.0);
    assert_eq!((magnets(&mut drive).state, magnets(&mut drive).stored), (Use::None, Problem::Blank));
}

/// A setting that is tried and not saved takes nothing out of the flash.
#[test]
fn a_trial_of_other_pole_pairs_leaves_the_map() {
    let plant = uneven(1, 1.0);
    let mut drive = powered_up(&plant, LEARNT.clone(), 0.0);
    done(&mut drive, Ask::Set { name: "pole_pairs", value: 5.0 });
    run(&mut drive, 200);
    assert_eq!((magnets(&mut drive).state, magnets(&mut drive).stored), (Use::None, Problem::Foreign));
    let mut cut = powered_up(&plant, drive.flash(), 2.0);
    for drive in [&mut cut, &mut drive] {
        done(drive, Ask::Set { name: "pole_pairs", value: 4.0 });
        run(drive, 200);
        assert_eq!(magnets(drive).stored, Problem::None);
        arm(drive);
        assert!(find(drive, 100.0, 5000), "{:?}", magnets(drive));
    }
}

#[test]
fn a_lost_hall_ends_the_map_and_the_drive_runs_on() {
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.0);
    done(&mut drive, Ask::Set { name: "run_on_two_halls", value: 1.0 });
    run(&mut drive, 20);
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000));
    drive.plant.set_hall_fault(1, Some(plant::HallFault::Open(plant::Rail::Low)));
    turn(&mut drive, 100.0, 1000);
    let status = status(&mut drive);
    assert_eq!(status.mode, Mode::Running);
    assert!(status.limits.contains(Limits::TWO_HALLS));
    assert_ne!(magnets(&mut drive).state, Use::Used);
    assert!(!find(&mut drive, 100.0, 3000));
}

#[test]
fn a_map_counts_the_other_way_when_the_drive_does() {
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 2.0);
    done(&mut drive, Ask::Set { name: "reversed", value: 1.0 });
    run(&mut drive, 20);
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000), "{:?}", magnets(&mut drive));
    assert!(magnets(&mut drive).fit > 0.5, "{:?}", magnets(&mut drive));
    turn(&mut drive, -100.0, 2000);
    assert_eq!(magnets(&mut drive).state, Use::Used);
}

/// The short form cuts the power before, in the middle of and near the end of what is written.
#[test]
fn a_power_cut_while_the_map_is_saved_leaves_the_one_before_or_the_new_one() {
    let plant = uneven(1, 1.0);
    for cut in [0, 1, 2, 40, 80, 130, 131, 132, 140].into_iter().step_by(sim::of(3, 1)) {
        let flash = Flash::of(LEARNT.clone());
        let mut drive = at(&plant, 1, flash.clone());
        run(&mut drive, 20);
        flash.cut_after(cut);
        let again = learn(&mut drive);
        assert_eq!(again.state, Use::Used);
        let mut drive = powered_up(&plant, flash.bytes(), 1.0);
        assert!(status(&mut drive).calibrated);
        let status = magnets(&mut drive);
        assert_eq!((status.state, status.stored), (Use::Searching, Problem::None), "{cut}");
        arm(&mut drive);
        assert!(find(&mut drive, 100.0, 5000), "{cut}");
    }
}

/// Rotors of any unevenness up to half as much again as cheap ones, powered up anywhere and turned at random. The form
/// for a night: `ROTORS=1000 cargo test -p hallctl --test all many -- --ignored --nocapture`.
#[test]
#[ignore = "two seconds a rotor"]
fn many_rotors_are_never_used_at_a_wrong_pole() {
    let rotors = sim::rotors(20);
    let (mut kept, mut found, mut told) = (0, 0, 0);
    for seed in 1..=rotors {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = uneven(seed, random.random_range(0.1..1.5));
        let mut drive = calibrated(&plant, seed);
        let report = learn(&mut drive).report;
        kept += u32::from(report.kept);
        told += u32::from(report.found_again);
        let mut drive = powered_up(&plant, drive.flash(), random.random_range(0.0..TAU));
        arm(&mut drive);
        for _ in 0..10 {
            let speed = random.random_range(-300.0..300.0);
            turn(&mut drive, speed, 100 * random.random_range(1..10));
        }
        if magnets(&mut drive).state == Use::Used {
            found += 1;
            let after = error(&mut drive, 100.0);
            assert!(after < 0.25, "{seed}: {after} {:?}", magnets(&mut drive));
        }
    }
    println!("{rotors} rotors: {kept} maps kept, {told} whose pole can be told, {found} found, none at a wrong pole");
    assert!(found > rotors as u32 / 2);
}

/// Mechanical turns that the rotor makes until the map is in use; `None` where it is not after so many.
fn turns_until_found(drive: &mut Simulator, most: f64, mut go_on: impl FnMut(&mut Simulator)) -> Option<f64> {
    let angle = |drive: &Simulator| drive.plant.truth().mechanical_angle_rad;
    let (mut last, mut turned) = (angle(drive), 0.0);
    while turned < most {
        if magnets(drive).state == Use::Used {
            return Some(turned);
        }
        go_on(drive);
        turned += (angle(drive) - last).abs() / TAU;
        last = angle(drive);
    }
    None
}

/// The bridge is off, and something else turns the shaft for a time.
fn turn_by_hand(drive: &mut Simulator, rad_s: f64, milliseconds: u32) {
    drive.plant.set_dyno(Some(rad_s)).unwrap();
    run(drive, milliseconds);
}

/// Cogging moves a slow rotor by more than the map has, and at other places under load: the pole is not told by motion.
#[test]
fn a_slow_rotor_has_its_pole_after_a_turn() {
    for (seed, times) in [(1, 1.0), (2, 1.0), (3, 0.25)] {
        let plant = uneven(seed, times);
        let flash = if seed == 1 { LEARNT.clone() } else { learnt_of(&plant, seed) };
        for (speed, load) in [(1.0, 0.0), (-5.0, 0.006), (20.0, -0.006)] {
            let mut drive = powered_up(&plant, flash.clone(), 1.3 * seed as f64);
            arm(&mut drive);
            turn(&mut drive, speed, 500);
            drive.plant.set_load(load).unwrap();
            let turns = turns_until_found(&mut drive, 3.0, |drive| turn(drive, speed, 100));
            drive.plant.set_load(0.0).unwrap();
            let after = error(&mut drive, 100.0);
            println!("{seed}: {speed} rad/s, {load} N·m: {turns:.1?} turns, {after:.2}°");
            assert!(turns.is_some_and(|turns| turns < 1.5) && after < 0.2, "{seed} {speed}");
        }
    }
}

#[test]
fn a_shaft_that_is_turned_by_hand_tells_its_pole_in_pieces_and_with_warm_halls() {
    for (celsius, strokes) in [(25.0, &[3.0][..]), (85.0, &[-2.0, 1.0]), (-20.0, &[4.0, -9.0, 0.0])] {
        let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 2.2);
        drive.plant.set_temperature(celsius).unwrap();
        let mut hand = strokes.iter().cycle();
        let turns = turns_until_found(&mut drive, 6.0, |drive| turn_by_hand(drive, *hand.next().unwrap(), 700));
        turn_by_hand(&mut drive, 0.0, 200);
        drive.plant.set_dyno(None).unwrap();
        arm(&mut drive);
        let after = error(&mut drive, 100.0);
        println!("{celsius} °C, {strokes:?}: {turns:.1?} turns, {after:.2}°");
        assert!(turns.is_some(), "{celsius} {strokes:?}");
        assert!(celsius != 25.0 || after < 0.2);
    }
}

#[test]
fn a_slow_rotor_that_slips_by_a_magnet_loses_its_map() {
    let mut drive = powered_up(&uneven(1, 1.0), LEARNT.clone(), 0.4);
    arm(&mut drive);
    assert!(turns_until_found(&mut drive, 2.0, |drive| turn(drive, 10.0, 100)).is_some());
    let truth = drive.plant.truth();
    drive.plant.place(truth.mechanical_angle_rad + TAU / 4.0, truth.speed_rad_s).unwrap();
    let mut ended = false;
    let mut turns = 0.0;
    while !ended && turns < 10.0 {
        turn(&mut drive, 10.0, 100);
        turns += 1.0 / TAU;
        ended = magnets(&mut drive).state != Use::Used;
    }
    println!("ended after {turns:.1} turns");
    assert!(ended && turns > 1.0);
    assert!(turns_until_found(&mut drive, 3.0, |drive| turn(drive, 10.0, 100)).is_some());
    assert!(error(&mut drive, 100.0) < 0.2);
}

/// A direct drive: its reference is late by so many times as much of an electrical turn, the noise of its currents moves it by
/// degrees, a map has fewer points in each electrical turn, and there are fewer turns to learn it in.
#[test]
fn a_map_of_many_poles_is_true_and_its_pole_found_after_a_turn() {
    for (pole_pairs, seed, left) in [(21, 1, 0.4), (21, 2, 0.48), (36, 1, 1.3), (44, 1, 1.3)] {
        let (before, turns, after, said) = direct_drive(pole_pairs, seed);
        println!(
            "{pole_pairs} pole pairs, {seed}: {before:.2}°; {turns:.1?} turns, {after:.2}° where {said:.2}° are said"
        );
        assert!(turns.is_some_and(|turns| turns < 1.5), "{turns:?}");
        assert!(before > 2.5 && after < left, "{before} {after} {said}");
        // The error between so few points as there are then is not among what is said.
        assert!(pole_pairs > 32 || after < said + 0.2, "{after} {said}");
    }
}

/// Degrees before and after such a motor has learnt its map, found again after so many turns, and what it says of itself.
fn direct_drive(pole_pairs: u8, seed: u64) -> (f64, Option<f64>, f64, f64) {
    let motor = MOTORS.iter().find(|motor| motor.name == "direct-drive").unwrap();
    let alike = f64::from(motor.pairs) / f64::from(pole_pairs);
    let mut settings = simulator::of_motor(motor);
    settings.pole_pairs = pole_pairs;
    let control = settings.control.as_mut().unwrap();
    (control.resistance_ohm, control.inductance_h) = (motor.ohm as f32, motor.henry as f32);
    (control.flux_linkage_wb, control.inertia_kgm2) = ((motor.flux_vs * alike) as f32, motor.inertia_kgm2 as f32);
    (control.max_current_a, control.max_speed_rad_s) = (motor.limit_a, 30.0);
    let mut plant = motor.plant(1);
    plant.motor.pole_pairs = pole_pairs;
    plant.motor.back_emf.flux_linkage_vs *= alike;
    let plant = simulator::uneven(plant, 1.0, seed);
    let mut drive = Simulator::with(settings, &plant, 1, Flash::blank(), Vec::new()).unwrap();
    run(&mut drive, 10);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    arm(&mut drive);
    let before = error(&mut drive, 10.0);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 3000);
    done(&mut drive, Ask::Magnets(MagnetsAsk::Learn));
    // Longer than `wait` waits.
    while status(&mut drive).activity != Activity::None {
        run(&mut drive, 50);
    }
    let learnt = magnets(&mut drive);
    assert_eq!(learnt.state, Use::Used, "{learnt:?}");
    let mut drive = Simulator::with(settings, &plant, 1, Flash::of(drive.flash()), Vec::new()).unwrap();
    drive.plant.place(2.0, 0.0).unwrap();
    run(&mut drive, 20);
    arm(&mut drive);
    let turns = turns_until_found(&mut drive, 4.0, |drive| turn(drive, 3.0, 100));
    let after = error(&mut drive, 10.0);
    (before, turns, after, f64::from(learnt.report.with_deg))
}

/// A second harmonic that all poles have alike: a map takes it off, and there is no signature of one pole against another.
#[test]
fn a_map_of_poles_that_are_alike_is_found_and_watched_by_the_rotors_motion() {
    let mut harmonics = Unevenness::NONE.harmonics;
    harmonics[0] = 0.05;
    let plant = PlantParameters::imperfect(1).with_unevenness(&Unevenness { harmonics, ..Unevenness::NONE }, 1);
    let mut drive = powered_up(&plant, learnt_of(&plant, 1), 1.0);
    arm(&mut drive);
    assert!(find(&mut drive, 100.0, 5000), "{:?}", magnets(&mut drive));
    let found_after = magnets(&mut drive).turns;
    turn(&mut drive, 100.0, 2000);
    let status = magnets(&mut drive);
    assert_eq!(status.state, Use::Used);
    // What watches it has something to compare with.
    assert!(status.turns > found_after && status.fit > 0.5 && status.left_deg < 1.0, "{status:?}");
    assert!(error(&mut drive, 100.0) < 0.2);
}
