//! Halls whose signals are late: what `cargo run --release -- delay` measures on many motors.

use hallservo::drive::Command;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::settings::{Control, Settings};
use plant::{HallFault, Rail, Unevenness};
use rayon::prelude::*;
use rig::{Rig, error_deg};
use sim::experiment::delay::{Late, SPEEDS_RAD_S, trial};
use sim::experiment::magnets;
use sim::statistics::Statistics;

#[test]
fn the_drive_measures_how_late_its_halls_are_and_takes_it_off() {
    for (seed, late) in (1..).zip([Late::LowPass(2e3), Late::Delay(50.0), Late::LowPass(1e4)]) {
        let trial = trial(late, &Unevenness::NONE, false, seed).unwrap();
        println!("{late:?}: {trial:?}");
        let off_us = (trial.found_us - trial.true_us).abs();
        assert!(off_us <= trial.error_us && trial.error_us < 8.0 + 0.2 * trial.true_us, "{late:?}: {trial:?}");
        for ((before, after), speed) in trial.before.iter().zip(&trial.after).zip(SPEEDS_RAD_S) {
            let turned_deg = (4.0 * f64::from(speed) * trial.true_us * 1e-6).to_degrees();
            // Late it is, or there would be nothing to take off.
            assert!((before.mean_deg + turned_deg).abs() < 0.2 + 0.1 * turned_deg, "{late:?} at {speed}: {before:?}");
            // An eighth is left: the three are not equally late, which no common delay corrects.
            assert!(after.rms_deg < 0.2 + 0.125 * turned_deg, "{late:?} at {speed}: {after:?}");
        }
    }
}

#[test]
fn halls_in_time_are_left_as_they_are() {
    for (maps, most_us) in [(false, 40.0), (true, 6.0)] {
        let trial = trial(Late::Not, &Unevenness::CHEAP, maps, 4).unwrap();
        // The error is two standard deviations: one motor may be a little beyond.
        assert!(trial.found_us.abs() <= 1.25 * trial.error_us && trial.error_us < most_us, "{maps}: {trial:?}");
    }
}

/// A calibrated drive that is told its delay, running at a speed.
fn running(late: Late, settings: &Settings, speed_rad_s: f32) -> Rig {
    let (plant, true_us) = late.plant(&Unevenness::NONE, 3);
    let control = settings.control.map(|control| Control { hall_delay_us: true_us as f32, ..control });
    let mut rig = Rig::new(&plant, &Settings { control, ..*settings }, 3).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    let speed = rig.control().unwrap().speed(speed_rad_s).unwrap();
    rig.command(Command::Speed(speed)).unwrap();
    rig.wait(0.8);
    rig
}

#[test]
fn a_known_delay_is_taken_off_while_the_speed_changes() {
    for late in [Late::LowPass(1e3), Late::Delay(50.0), Late::Not] {
        let mut rig = running(late, &magnets::settings(), 200.0);
        let mut errors = Statistics::default();
        for speed in [-200.0, 200.0, 30.0] {
            let speed = rig.control().unwrap().speed(speed).unwrap();
            rig.command(Command::Speed(speed)).unwrap();
            rig.run(0.2, |rig, period| {
                errors.push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
            });
        }
        println!("{late:?}: {:.2}° RMS, {:.2}° at most", errors.rms(), errors.max_abs());
        // Uncompensated 160 µs at 200 rad/s would be 7°.
        assert!(errors.rms() < 0.8, "{late:?}: {}", errors.rms());
    }
}

/// With late Halls the two that are left see a rotor that has gone on since: 13° at this speed. How far the angle is off
/// until that is known depends on where the rotor is when the Hall is lost.
#[test]
fn a_hall_that_is_lost_at_speed_is_replaced_by_two_late_ones() {
    let settings = Settings { run_on_two_halls: true, ..magnets::settings() };
    let jobs: Vec<_> = (0..3).flat_map(|sensor| (0..sim::of(3, 12)).map(move |place| (sensor, place))).collect();
    let worst = jobs.par_iter().map(|&(sensor, place)| {
        let mut rig = running(Late::Delay(150.0), &settings, 390.0);
        rig.wait(0.33e-3 * f64::from(place));
        rig.plant.set_hall_fault(sensor, Some(HallFault::Open(Rail::Low)));
        let mut worst = 0.0_f64;
        rig.run(0.2, |rig, period| {
            worst = worst.max(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad).abs());
        });
        assert_eq!(rig.drive.mode(), Mode::Running, "Hall {}", sensor + 1);
        assert!(rig.drive.limits().contains(Limits::TWO_HALLS), "Hall {}", sensor + 1);
        worst
    });
    let worst = worst.reduce(|| 0.0, f64::max);
    println!("{worst:.1}° at most, of {}", jobs.len());
    assert!(worst < 12.0, "{worst}");
}
