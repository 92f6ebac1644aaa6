//! Two rings on the shaft: from calibration to a thousand power-ups.

use crate::tool::rings::{CALIBRATED, at, calibrate, calibrated, encoder, error_deg, powered_up};
use crate::tool::{self, arm, ask, done, run, status, wait};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::vernier::rings::RingsError;
use hallservo::vernier::settings;
use hallservo_protocol::{Activity, Answer, Ask, EncoderAsk, EncoderCalibration, EncoderRefusal, Problem, Refusal};
use plant::PlantParameters;
use plant::heads::Defect;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use simulator::Simulator;
use simulator::flash::Flash;
use std::f64::consts::TAU;

fn random(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// The short form has 150.
#[test]
fn the_position_is_absolute_after_each_of_a_thousand_power_ups_without_motion() {
    let mut random = random(1);
    let mut errors = Vec::new();
    for number in 0..sim::of(150, 1000) {
        let shaft_rad = random.random_range(-TAU..TAU);
        let mut drive = calibrated(shaft_rad, number);
        // A brake holds the shaft.
        drive.plant.set_dyno(Some(0.0)).unwrap();
        run(&mut drive, 25);
        assert!(encoder(&mut drive).absolute, "{number}");
        assert!((-0.501..0.501).contains(&status(&mut drive).position_turns));
        errors.push(error_deg(&mut drive));
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let without: Vec<f64> = errors.iter().map(|error| error - mean).collect();
    let rms = (without.iter().map(|error| error * error).sum::<f64>() / without.len() as f64).sqrt();
    let largest = without.iter().fold(0.0_f64, |most, error| most.max(error.abs()));
    println!("{} power-ups: constant {mean:.4}°, {rms:.4}° RMS, {largest:.4}° at most beyond that", errors.len());
    assert!(rms <= 0.005 && largest <= 0.02, "{rms} {largest}");
}

/// The short form breaks 25 drives in each of the four ways, not 100.
#[test]
fn at_power_up_no_defect_makes_a_wrong_pole_pair() {
    let mut random = random(2);
    let mut told = [0; 4];
    let each = sim::of(25, 100);
    for number in 0..4 * each {
        let mut drive = calibrated(random.random_range(0.0..TAU), number);
        let ring = random.random_range(0..2);
        let kind = number as usize % 4;
        let defect = match kind {
            0 => Defect::Stuck(ring, random.random_range(0..2)),
            1 => Defect::Slipped(ring, random.random_range(-0.4..0.4)),
            2 => Defect::BothSlipped(random.random_range(-0.4..0.4)),
            _ => {
                // The one under a head.
                let turns = drive.plant.truth().mechanical_angle_rad / TAU;
                Defect::Chipped(0, (turns.rem_euclid(1.0) * 37.0) as usize)
            }
        };
        drive.rings().unwrap().suffer(defect);
        run(&mut drive, 60);
        let status = encoder(&mut drive);
        let refused = ask(&mut drive, Ask::Position(0.0), |answer| matches!(answer, Answer::Refused(_)));
        if status.absolute {
            // Half of a pole pair is 4.9°; what the Halls do not see is a quarter of that.
            let error = error_deg(&mut drive).abs();
            assert!(error < 1.3, "{number} {defect:?}: {error}");
        } else {
            told[kind] += 1;
            assert!(refused, "{number} {defect:?}");
        }
    }
    println!(
        "of {each} each told at power-up: stuck {}, slipped {}, both slipped {}, chipped {}",
        told[0], told[1], told[2], told[3]
    );
    assert!(told.iter().all(|&told| told > 3 * each / 10), "{told:?}");
}

/// Multi-turn position of the drive, mechanical degrees off.
fn off_deg(drive: &Simulator, origin_turns: f64) -> f64 {
    let position = drive.drive().tracker().smoothed().to_turns() / 4.0 - origin_turns;
    360.0 * (position - (drive.plant.truth().mechanical_angle_rad - CALIBRATED.1) / TAU)
}

/// Armed and turning, with the electrical position at the zero in mechanical turns.
fn turning(shaft_rad: f64, seed: u64, speed: f32) -> (Simulator, f64) {
    let mut drive = calibrated(shaft_rad, seed);
    run(&mut drive, 30);
    let origin = drive.drive().tracker().position().to_turns() / 4.0 - status(&mut drive).position_turns;
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(speed));
    run(&mut drive, 200);
    (drive, origin)
}

#[test]
fn in_motion_no_defect_makes_a_wrong_pole_pair() {
    let mut random = random(3);
    let mut found = [0; 4];
    for number in 0..80 {
        let speed = if random.random() { 15.0 } else { -15.0 };
        let (mut drive, origin) = turning(random.random_range(0.0..6.0), number, speed);
        let whole = off_deg(&drive, origin) / 360.0;
        let ring = random.random_range(0..2);
        let kind = number as usize % 4;
        drive.rings().unwrap().suffer(match kind {
            0 => Defect::Stuck(ring, random.random_range(0..2)),
            1 => Defect::Slipped(ring, random.random_range(-0.4..0.4)),
            2 => Defect::BothSlipped(random.random_range(0.15..0.4)),
            _ => Defect::Chipped(ring, random.random_range(0..37)),
        });
        for _ in 0..25 {
            run(&mut drive, 20);
            done(&mut drive, Ask::Status);
            if drive.drive().mode() != Mode::Running {
                break;
            }
            let off = off_deg(&drive, origin) - 360.0 * whole.round();
            assert!(off.abs() < 1.0, "{number}: {off}");
        }
        if let Mode::Faulted(fault) = drive.drive().mode() {
            assert!(matches!(fault, Fault::Encoder | Fault::Turns), "{number}: {fault:?}");
            found[kind] += 1;
        }
    }
    println!(
        "of 20 each a fault in motion: stuck {}, slipped {}, both slipped {}, chipped {}",
        found[0], found[1], found[2], found[3]
    );
    // A slip of one ring that is within the residual's limit changes the angle by nothing to speak of.
    assert!(found[0] == 20 && found[2] == 20 && found[1] > 15 && found[3] > 10, "{found:?}");
}

#[test]
fn a_drive_may_go_on_by_its_halls() {
    let mut drive = calibrated(1.0, 7);
    done(&mut drive, Ask::Set { name: "encoder_on_loss", value: 1.0 });
    run(&mut drive, 60);
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(15.0));
    run(&mut drive, 300);
    let before = status(&mut drive).position_turns;
    let travelled = drive.plant.truth().mechanical_angle_rad / TAU - before;
    drive.rings().unwrap().suffer(Defect::Stuck(0, 1));
    for mended in [false, true] {
        for _ in 0..50 {
            done(&mut drive, Ask::Speed(15.0));
            run(&mut drive, 20);
            let off = status(&mut drive).position_turns + travelled - drive.plant.truth().mechanical_angle_rad / TAU;
            assert_eq!(drive.drive().mode(), Mode::Running);
            // What the Halls are off.
            assert!(off.abs() < 0.004, "{off}");
        }
        let status = encoder(&mut drive);
        assert_eq!(status.used, mended, "{status:?}");
        drive.rings().unwrap().mend();
    }
}

#[test]
fn the_zero_survives_a_power_cut_at_any_moment() {
    let mut outcomes = [0; 2];
    for operations in 0..70 {
        let flash = Flash::of(CALIBRATED.0.clone());
        let mut drive = powered_up(flash.clone(), 2.0, 1);
        run(&mut drive, 30);
        let before = encoder(&mut drive).angle_deg;
        flash.cut_after(operations);
        done(&mut drive, Ask::Encoder(EncoderAsk::Zero));
        run(&mut drive, 50);
        let mut again = powered_up(Flash::of(drive.flash()), 2.0, 2);
        run(&mut again, 30);
        let status = encoder(&mut again);
        assert!(status.absolute && status.stored == Problem::None, "{operations}: {status:?}");
        let (old, new) = ((status.angle_deg - before).abs() < 0.1, status.angle_deg.abs() < 0.1);
        assert!(old || new, "{operations}: {status:?}");
        outcomes[usize::from(new)] += 1;
    }
    println!("{} times the old zero, {} times the new one", outcomes[0], outcomes[1]);
    assert!(outcomes.iter().all(|&count| count > 0), "{outcomes:?}");
}

#[test]
fn a_record_that_is_corrupt_is_told_and_not_used() {
    let mut bytes = CALIBRATED.0.clone();
    // Both copies.
    for block in [2, 3] {
        bytes[2048 * block + 100] ^= 1;
    }
    let mut drive = powered_up(Flash::of(bytes), 1.0, 1);
    run(&mut drive, 40);
    let status = encoder(&mut drive);
    assert!(!status.calibrated && !status.absolute && status.stored == Problem::Corrupt, "{status:?}");
    assert_eq!(tool::status(&mut drive).incidents, 1);
    // The Halls alone do as without rings.
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Position(0.2));
}

#[test]
fn settings_and_refusals() {
    let mut drive = calibrated(1.0, 1);
    run(&mut drive, 40);
    let refused = |drive: &mut Simulator, what| {
        ask(drive, what, |answer| match answer {
            Answer::Refused(Refusal::Encoder(why)) => why,
            other => panic!("{what:?}: {other:?}"),
        })
    };
    let common = EncoderRefusal::Setting(settings::Error::Rings(RingsError::CommonDivisor(9)));
    assert_eq!(refused(&mut drive, Ask::Encoder(EncoderAsk::Rings { reference: 36, vernier: 45 })), common);
    assert_eq!(refused(&mut drive, Ask::Set { name: "encoder_reference_pairs", value: 36.0 }), common);
    assert!(encoder(&mut drive).calibrated);
    // All of them are listed, and read as they were set.
    let count = ask(&mut drive, Ask::Hello, |answer| match answer {
        Answer::Hello(hello) => hello.settings,
        other => panic!("{other:?}"),
    });
    let last = ask(&mut drive, Ask::Setting(count - 1), |answer| match answer {
        Answer::Setting(setting) => setting.name.to_string(),
        other => panic!("{other:?}"),
    });
    assert_eq!(last, "encoder_on_loss");
    done(&mut drive, Ask::Set { name: "encoder_pole_pair_mm", value: 3.0 });
    // Not while the bridge is on.
    done(&mut drive, Ask::Arm);
    for what in [Ask::Encoder(EncoderAsk::Zero), Ask::Set { name: "encoder_on_loss", value: 1.0 }] {
        ask(&mut drive, what, |answer| assert!(matches!(answer, Answer::Refused(Refusal::Drive(_))), "{answer:?}"));
    }
    done(&mut drive, Ask::Disarm);
    // Other rings have to be calibrated; without a calibration there is no zero to set.
    done(&mut drive, Ask::Encoder(EncoderAsk::Rings { reference: 45, vernier: 37 }));
    assert_eq!(refused(&mut drive, Ask::Encoder(EncoderAsk::Zero)), EncoderRefusal::NotCalibrated);
    run(&mut drive, 100);
    let mut again = powered_up(Flash::of(drive.flash()), 1.0, 1);
    run(&mut again, 40);
    let status = encoder(&mut again);
    assert!(!status.calibrated && status.pairs == [45, 37], "{status:?}");
    // A board without heads has no such settings.
    let mut halls = tool::drive(Flash::blank());
    assert_eq!(refused(&mut halls, Ask::Encoder(EncoderAsk::Status)), EncoderRefusal::None);
    ask(&mut halls, Ask::Get("encoder_on_loss"), |answer| {
        assert!(matches!(answer, Answer::Refused(Refusal::Setting(_))))
    });
}

#[test]
fn rings_that_turned_on_the_shaft_keep_the_bridge_off() {
    let mut drive = calibrated(1.0, 1);
    drive.rings().unwrap().suffer(Defect::BothSlipped(0.05));
    run(&mut drive, 60);
    ask(&mut drive, Ask::Arm, |answer| match answer {
        // 0.05 rad of four pole pairs.
        Answer::Refused(Refusal::Encoder(EncoderRefusal::NotAbsolute(Some(ahead)))) => {
            assert!((ahead + 11.5).abs() < 1.0, "{ahead}");
        }
        other => panic!("{other:?}"),
    });
    // A new calibration puts it right, and keeps the zero where the rings have it.
    let status = calibrate(&mut drive);
    assert!(status.absolute, "{status:?}");
    done(&mut drive, Ask::Arm);
}

/// A flash at a motor whose Halls have been turned since, electrical degrees.
fn with_halls_turned(flash: Vec<u8>, degrees: f64) -> Simulator {
    let mut plant = PlantParameters::imperfect(1);
    for hall in &mut plant.halls {
        hall.placement_rad += degrees.to_radians();
    }
    let mut drive = at(&plant, Flash::of(flash), 1.0, 1);
    run(&mut drive, 60);
    drive
}

#[test]
fn the_halls_take_their_zero_from_the_encoder_without_motion() {
    for degrees in [-25.0, -3.0, 8.0, 25.0] {
        let mut drive = with_halls_turned(CALIBRATED.0.clone(), degrees);
        let before = encoder(&mut drive);
        assert_eq!(before.absolute, degrees.abs() < 4.8, "{degrees}: {before:?}");
        let shaft_rad = drive.plant.truth().mechanical_angle_rad;
        done(&mut drive, Ask::Encoder(EncoderAsk::Align));
        run(&mut drive, 100);
        let after = encoder(&mut drive);
        println!("{degrees}°: {:+.3}° before, {:+.3}° after", before.halls_ahead_deg, after.halls_ahead_deg);
        assert!((f64::from(before.halls_ahead_deg).abs() - degrees.abs()).abs() < 1.0);
        assert!(after.absolute && after.halls_ahead_deg.abs() < 0.5, "{after:?}");
        assert_eq!(drive.plant.truth().mechanical_angle_rad, shaft_rad);
        assert!(error_deg(&mut drive).abs() < 0.1);
        // It is stored: after power-up, too, it commutates without motion before.
        let mut again = with_halls_turned(drive.flash(), degrees);
        assert!(encoder(&mut again).absolute);
        let apart = current_deg(&mut again);
        assert!((apart - 90.0).abs() < 2.0, "{degrees}: the current is {apart}° ahead of the rotor");
    }
}

/// Electrical degrees by which the current leads the rotor's field while it drives a load: 90 as it should.
fn current_deg(drive: &mut Simulator) -> f64 {
    arm(drive);
    done(drive, Ask::Speed(20.0));
    run(drive, 100);
    drive.plant.set_load(0.02).unwrap();
    run(drive, 200);
    let [mut d, mut q] = [0.0; 2];
    for _ in 0..200 {
        run(drive, 1);
        let truth = drive.plant.truth();
        let [a, b, _] = truth.currents_a;
        let (along, across) = (a, (a + 2.0 * b) / 3.0_f64.sqrt());
        let (sin, cos) = truth.electrical_angle_rad.sin_cos();
        d += along * cos + across * sin;
        q += across * cos - along * sin;
    }
    assert_eq!(drive.drive().mode(), Mode::Running);
    f64::atan2(q, d).to_degrees()
}

#[test]
fn what_trimmed_the_last_zero_of_the_halls_does_not_trim_the_next() {
    let mut drive = with_halls_turned(CALIBRATED.0.clone(), 4.0);
    done(&mut drive, Ask::Arm);
    for _ in 0..100 {
        done(&mut drive, Ask::Speed(150.0));
        run(&mut drive, 20);
    }
    let trimmed = drive.drive().trim().to_degrees();
    assert!(trimmed.abs() > 0.1, "{trimmed}");
    done(&mut drive, Ask::Speed(0.0));
    run(&mut drive, 500);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 500);
    done(&mut drive, Ask::Encoder(EncoderAsk::Align));
    run(&mut drive, 100);
    assert_eq!(drive.drive().trim().to_degrees(), 0.0);
    assert!(encoder(&mut drive).halls_ahead_deg.abs() < 0.5);
}

#[test]
fn halls_that_are_too_far_from_the_encoder_keep_their_zero() {
    let refused = |drive: &mut Simulator| {
        ask(drive, Ask::Encoder(EncoderAsk::Align), |answer| match answer {
            Answer::Refused(why) => format!("{why:?}"),
            other => panic!("{other:?}"),
        })
    };
    let mut drive = with_halls_turned(CALIBRATED.0.clone(), 40.0);
    assert!(refused(&mut drive).contains("HallsTooFar"));
    // Nor is it done while the bridge is on, or a hand turns the shaft.
    let mut drive = with_halls_turned(CALIBRATED.0.clone(), 0.0);
    drive.plant.set_dyno(Some(5.0)).unwrap();
    run(&mut drive, 50);
    assert!(refused(&mut drive).contains("NotAbsolute(None)"));
    drive.plant.set_dyno(None).unwrap();
    run(&mut drive, 500);
    done(&mut drive, Ask::Arm);
    assert!(refused(&mut drive).contains("NotAbsolute(None)"));
}

#[test]
fn the_bounds_of_the_position_count_from_the_zero_either_way() {
    for reversed in [0.0, 1.0] {
        let mut drive = calibrated(CALIBRATED.1 + 0.1, 1);
        run(&mut drive, 30);
        done(&mut drive, Ask::Set { name: "reversed", value: reversed });
        done(&mut drive, Ask::Set { name: "min_position_turns", value: -0.1 });
        done(&mut drive, Ask::Set { name: "max_position_turns", value: 0.1 });
        run(&mut drive, 50);
        let sign = 1.0 - 2.0 * f64::from(reversed);
        let here = status(&mut drive).position_turns;
        let shaft = (drive.plant.truth().mechanical_angle_rad - CALIBRATED.1) / TAU;
        assert!((here - sign * shaft).abs() < 1e-3, "{here} {shaft}");
        done(&mut drive, Ask::Arm);
        for (turns, allowed) in [(0.098, true), (0.102, false), (-0.098, true), (-0.102, false)] {
            ask(&mut drive, Ask::Position(turns), |answer| {
                assert_eq!(matches!(answer, Answer::Done), allowed, "{turns}: {answer:?}");
            });
        }
        for _ in 0..50 {
            done(&mut drive, Ask::Position(-0.09));
            run(&mut drive, 20);
        }
        let shaft = (drive.plant.truth().mechanical_angle_rad - CALIBRATED.1) / TAU;
        assert!((shaft + sign * 0.09).abs() < 1e-3, "{shaft}");
    }
}

#[test]
fn a_hand_can_turn_it() {
    let mut drive = powered_up(Flash::blank(), 0.3, 1);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    done(&mut drive, Ask::Encoder(EncoderAsk::Calibrate { by_hand: true }));
    // First to and fro: not fit.
    drive.turn_by_hand(1.5).unwrap();
    (0..80).for_each(|_| assert_ne!(status_after(&mut drive, 20), Activity::None));
    drive.turn_by_hand(-1.5).unwrap();
    (0..80).for_each(|_| assert_ne!(status_after(&mut drive, 20), Activity::None));
    let EncoderCalibration::Running(Some(why)) = encoder(&mut drive).calibration else { panic!("it has seen nothing") };
    println!("{why}");
    drive.turn_by_hand(10.0).unwrap();
    while status_after(&mut drive, 20) != Activity::None {}
    let status = encoder(&mut drive);
    assert!(matches!(status.calibration, EncoderCalibration::Done(_)), "{status:?}");
    run(&mut drive, 5000);
    assert!(encoder(&mut drive).absolute);
}

fn status_after(drive: &mut Simulator, milliseconds: u32) -> Activity {
    run(drive, milliseconds);
    status(drive).activity
}
