//! A drive with two Halls from the start: what it knows of the angle after its own calibration.

use hallservo::drive::Command;
use hallservo::hall::Halls;
use hallservo::hall::calibrate::Finding;
use hallservo::hall::estimate::Estimator;
use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::{Period, Rig, error_deg};
use sim::experiment::{magnets, spin};
use sim::statistics::Statistics;

fn settings() -> Settings {
    Settings { halls: 2, ..magnets::settings() }
}

/// A motor whose two Halls are so far apart, besides errors of up to 8° each.
fn motor(apart_deg: f64, seed: u64) -> PlantParameters {
    PlantParameters::imperfect(seed).with_two_halls(apart_deg)
}

/// The noise of single samples at 10 Hz electrical over what no estimator can beat that knows everything but the angle,
/// and the tracked angle's error at 100 rad/s and while the speed changes, electrical degrees.
struct Quality {
    over_bound: f64,
    steady_deg: f64,
    changing_deg: f64,
}

fn quality(apart_deg: f64, seed: u64) -> Quality {
    let plant = motor(apart_deg, seed);
    let mut rig = Rig::new(&plant, &settings(), seed).unwrap();
    let calibration = rig.calibrate(|_| ()).unwrap();
    assert_eq!(calibration.model.halls(), Halls::Two);
    let report = &calibration.report;
    assert_eq!(f64::from(report.pattern.spacing), apart_deg.abs(), "{apart_deg} {seed}");
    assert!(!report.findings().any(|finding| Finding::refuses(&finding)));
    let estimator = Estimator::new(&calibration.model, 12).unwrap();
    rig.arm().unwrap();
    let mut single = Statistics::default();
    turn(&mut rig, 15.7, 0.5, |_, _| ());
    turn(&mut rig, 15.7, 1.0, |_, period| {
        let angle = estimator.angle(&period.sample.halls).unwrap();
        single.push(error_deg(angle, period.truth.electrical_angle_rad));
    });
    let (mut steady, mut changing) = <(Statistics, Statistics)>::default();
    turn(&mut rig, 100.0, 0.5, |_, _| ());
    turn(&mut rig, 100.0, 0.5, |rig, period| steady.push(tracked_deg(rig, period)));
    for rad_s in [-150.0, 20.0, 150.0] {
        turn(&mut rig, rad_s, 0.3, |rig, period| changing.push(tracked_deg(rig, period)));
    }
    let over_bound = single.rms() / spin::bound_deg(&plant);
    Quality { over_bound, steady_deg: steady.rms(), changing_deg: changing.rms() }
}

fn turn(rig: &mut Rig, rad_s: f32, seconds: f64, look: impl FnMut(&Rig, &Period)) {
    let speed = rig.control().unwrap().speed(rad_s).unwrap();
    rig.command(Command::Speed(speed)).unwrap();
    rig.run(seconds, look);
}

fn tracked_deg(rig: &Rig, period: &Period) -> f64 {
    error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad)
}

/// The short form has each angle between the Halls in one direction.
#[test]
fn two_halls_give_the_angle_at_their_own_bound() {
    for apart_deg in [90.0, -90.0, 120.0, -120.0, 60.0].into_iter().step_by(sim::of(2, 1)) {
        let (mut over_bound, mut steady, mut changing) = <(Statistics, Statistics, Statistics)>::default();
        for seed in 1..=sim::rotors(4) {
            let found = quality(apart_deg, seed);
            over_bound.push(found.over_bound);
            steady.push(found.steady_deg);
            changing.push(found.changing_deg);
        }
        println!(
            "{apart_deg}° apart: single samples {:.3} (worst {:.3}) of the bound, tracked {:.2}° ({:.2}°), while the speed \
             changes {:.2}° ({:.2}°)",
            over_bound.mean(),
            over_bound.max_abs(),
            steady.rms(),
            steady.max_abs(),
            changing.rms(),
            changing.max_abs()
        );
        // The rest is what it costs not to trust the strength of the magnet, and grows as they are farther from 90°.
        assert!(over_bound.mean() < 1.1 && over_bound.max_abs() < 1.25, "{apart_deg}");
        assert!(steady.rms() < 0.3 && changing.rms() < 0.5, "{apart_deg}");
    }
}
