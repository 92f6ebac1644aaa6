//! The firmware with an encoder on the virtual Nucleo-G474RE, two rings over the heads at its pins.
//!
//! The tests that are `ignored` are long forms of their neighbours: minutes each, all of them by
//! `cargo test --release -p virtual --test encoder -- --ignored --nocapture`.

#[path = "../common/mod.rs"]
mod common;
mod machine;

use chip::Disturbance;
use common::run;
use hallservo_protocol::{Ask, EncoderAsk, Problem};
use machine::{Calibrated, disturb, done, encoder, shaft_rad, status};
use plant::heads::Defect;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;
use virtual_board::outcome::Outcome;

/// Pole pairs of ring 1.
const REFERENCE: f64 = 37.0;

fn power_ups(count: usize) {
    let prepared = Calibrated::new();
    let mut random = Pcg64::seed_from_u64(1);
    let errors: Vec<f64> = (0..count)
        .map(|number| {
            let mut session = prepared.powered_up_at(random.random_range(-TAU..TAU), None);
            let found = encoder(&mut session);
            assert!(found.absolute, "{number}: {found:?}");
            prepared.error_deg(&mut session)
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let rms = (errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
    let largest = errors.iter().fold(0.0_f64, |most, error| most.max((error - mean).abs()));
    println!("{} power-ups: constant {mean:.4}°, {rms:.4}° RMS, {largest:.4}° at most beyond that", errors.len());
    assert!(rms <= 0.005 && largest <= 0.02, "{rms} {largest}");
}

#[test]
fn the_position_is_absolute_after_power_up_without_motion() {
    power_ups(40);
}

#[test]
#[ignore = "three minutes"]
fn the_position_is_absolute_after_each_of_a_thousand_power_ups() {
    power_ups(1000);
}

/// From slips that hardly show to ones of several pole pairs, and those of whole pole pairs.
fn slip_rad(random: &mut Pcg64) -> f64 {
    let sign = if random.random() { 1.0 } else { -1.0 };
    let size = if random.random() {
        10_f64.powf(random.random_range(-3.0..-0.4))
    } else {
        f64::from(random.random_range(1..5)) * TAU / REFERENCE
    };
    sign * size
}

/// A defect of each kind in turn, with the shaft at an angle.
fn defect(random: &mut Pcg64, number: usize, shaft_rad: f64) -> Defect {
    let ring = random.random_range(0..2);
    match number % 4 {
        0 => Defect::Stuck(ring, random.random_range(0..2)),
        1 => Defect::Slipped(ring, slip_rad(random)),
        2 => Defect::BothSlipped(slip_rad(random)),
        _ => Defect::Chipped(0, (shaft_rad.rem_euclid(TAU) / TAU * REFERENCE) as usize),
    }
}

/// A defect that the Halls cannot see at rest moves the position by less than a quarter of a pole pair.
const UNSEEN_DEG: f64 = 1.3;

/// Whatever is broken when the power comes, the position is right or it is said to be none.
fn broken_at_power_up(count: usize) {
    let prepared = Calibrated::new();
    let mut random = Pcg64::seed_from_u64(2);
    let mut told = [0; 4];
    for number in 0..count {
        let shaft_rad = random.random_range(0.0..TAU);
        let defect = defect(&mut random, number, shaft_rad);
        let mut session = prepared.powered_up_at(shaft_rad, Some(defect));
        if encoder(&mut session).absolute {
            let error = prepared.error_deg(&mut session).abs();
            assert!(error < UNSEEN_DEG, "{number} {defect:?}: {error}");
        } else {
            told[number % 4] += 1;
        }
    }
    println!("of {} each told at power-up: stuck, slipped, both slipped, chipped {told:?}", count / 4);
    assert!(told.iter().all(|&told| told > 0), "{told:?}");
}

#[test]
fn at_power_up_no_defect_makes_a_wrong_pole_pair() {
    broken_at_power_up(40);
}

#[test]
#[ignore = "two minutes"]
fn at_power_up_none_of_many_defects_makes_a_wrong_pole_pair() {
    broken_at_power_up(600);
}

/// What breaks while the shaft turns switches off, or does not move the position by a pole pair.
fn broken_in_motion(count: usize) {
    const SPEED_RAD_S: f64 = 8.0;
    let prepared = Calibrated::new();
    let mut running = prepared.fork();
    disturb(&mut running, &Disturbance::Hold(None));
    done(&mut running, Ask::Set { name: "command_timeout_s", value: 60.0 });
    run(&mut running, 0.1);
    done(&mut running, Ask::Arm);
    done(&mut running, Ask::Speed(SPEED_RAD_S as f32));
    run(&mut running, 0.8);
    let mut random = Pcg64::seed_from_u64(3);
    let mut found = [0; 4];
    for number in 0..count {
        let mut session = running.fork();
        run(&mut session, random.random_range(0.0..0.2));
        let ahead = shaft_rad(&session) + random.random_range(0.3..2.0);
        let defect = defect(&mut random, number, ahead);
        disturb(&mut session, &Disturbance::Encoder(Some(defect)));
        let mut drives = true;
        for _ in 0..14 {
            run(&mut session, 0.05);
            drives = status(&mut session).mode.drives();
            if !drives {
                break;
            }
            // An answer takes up to 4 ms.
            let (late, slipped) = (360.0 / TAU * SPEED_RAD_S * 4e-3, tolerated_deg(defect));
            let error = prepared.error_deg(&mut session).abs();
            assert!(error < late + slipped, "{number} {defect:?}: {error}");
        }
        found[number % 4] += usize::from(!drives);
        done(&mut session, Ask::Disarm);
        // It comes to rest, and encoder and Halls are compared once more.
        run(&mut session, 0.8);
        if encoder(&mut session).absolute {
            let error = prepared.error_deg(&mut session).abs();
            assert!(error < UNSEEN_DEG, "{number} {defect:?}: {error} at rest");
        }
    }
    println!("of {} each a fault in motion: stuck, slipped, both slipped, chipped {found:?}", count / 4);
    assert!(found[0] == count / 4 && found[2] > 0 && found[3] > 0, "{found:?}");
}

/// How far both rings may slip before the Halls of a turning motor say so: 30° electrical, of four pole pairs.
fn tolerated_deg(defect: Defect) -> f64 {
    if matches!(defect, Defect::BothSlipped(_)) { 30.0 / 4.0 } else { UNSEEN_DEG }
}

#[test]
fn in_motion_no_defect_makes_a_wrong_pole_pair() {
    broken_in_motion(8);
}

#[test]
#[ignore = "four minutes"]
fn in_motion_none_of_many_defects_makes_a_wrong_pole_pair() {
    broken_in_motion(80);
}

/// A position is reached and held by the encoder; a head that is stuck switches off, or the Halls take over.
#[test]
fn a_position_is_held_and_a_lost_encoder_does_as_set() {
    let prepared = Calibrated::new();
    for falls_back in [false, true] {
        let mut session = prepared.fork();
        disturb(&mut session, &Disturbance::Hold(None));
        done(&mut session, Ask::Set { name: "encoder_on_loss", value: u8::from(falls_back).into() });
        done(&mut session, Ask::Set { name: "command_timeout_s", value: 60.0 });
        run(&mut session, 0.1);
        done(&mut session, Ask::Arm);
        done(&mut session, Ask::Position(0.4));
        run(&mut session, 1.4);
        let there = ((shaft_rad(&session) - prepared.zero_rad) / TAU - 0.4) * 360.0;
        let whole = (there / 360.0).round();
        assert!((there - 360.0 * whole).abs() < 0.05, "{there}");
        done(&mut session, Ask::Speed(15.0));
        run(&mut session, 0.3);
        assert!(encoder(&mut session).used);
        disturb(&mut session, &Disturbance::Encoder(Some(Defect::Stuck(1, 0))));
        run(&mut session, 0.2);
        let (mode, lost) = (status(&mut session).mode, encoder(&mut session));
        assert!(!lost.used && lost.last_fault.is_some(), "{lost:?}");
        assert_eq!(mode.drives(), falls_back, "{mode:?} {lost:?}");
        // At rest, for an answer takes its time.
        if falls_back {
            done(&mut session, Ask::Speed(0.0));
        }
        run(&mut session, 1.0);
        let error = prepared.error_deg(&mut session).abs();
        assert!(error < UNSEEN_DEG, "{error}");
        assert_eq!(Outcome::of(&session).faults, [""; 0]);
    }
}

/// The zero is the old one or the new one, wherever the power goes; of the operations of the flash that saving takes,
/// every so many are tried.
fn cut_while_saving(every: usize) {
    let prepared = Calibrated::new();
    let held = || prepared.powered_up_at(prepared.zero_rad + 1.0, None);
    let mut whole = held();
    let before = whole.machine.system.facts().flash_operations;
    done(&mut whole, Ask::Encoder(EncoderAsk::Zero));
    run(&mut whole, 0.2);
    let operations = whole.machine.system.facts().flash_operations - before;
    let mut outcomes = [0; 2];
    for operation in (0..=operations).rev().step_by(every) {
        let mut session = held();
        let before = encoder(&mut session).angle_deg;
        disturb(&mut session, &Disturbance::PowerCut(operation));
        done(&mut session, Ask::Encoder(EncoderAsk::Zero));
        run(&mut session, 0.2);
        assert_eq!(session.resets.len(), 1 + usize::from(operation < operations), "{operation} of {operations}");
        let found = encoder(&mut session);
        let (old, new) = ((found.angle_deg - before).abs() < 0.1, found.angle_deg.abs() < 0.1);
        assert!(found.absolute && (old || new) && found.stored == Problem::None, "{operation}: {found:?}");
        outcomes[usize::from(new)] += 1;
    }
    println!(
        "a save takes {operations} operations of the flash; cut in one of them, the zero is {} times the old one, {} \
         times the new one",
        outcomes[0], outcomes[1]
    );
    assert!(outcomes.iter().all(|&count| count > 0), "{outcomes:?}");
}

#[test]
fn the_zero_survives_a_power_cut() {
    cut_while_saving(16);
}

#[test]
#[ignore = "two minutes"]
fn the_zero_survives_a_power_cut_at_any_moment() {
    cut_while_saving(1);
}

/// Field-oriented, with telemetry, by the encoder: the control interrupt keeps to what the board promises.
#[test]
fn turns_at_40_khz() {
    let mut session = Calibrated::new().session;
    let promised = session.board().promises.encoder_cycles.expect("a promise");
    done(&mut session, Ask::Set { name: "command_timeout_s", value: 60.0 });
    run(&mut session, 0.1);
    assert!(encoder(&mut session).used);
    common::rate::turns_at(&mut session, 40e3, promised);
    assert!(encoder(&mut session).used);
}
