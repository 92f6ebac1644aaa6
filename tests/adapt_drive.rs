//! The adaptation at a drive that turns a simulated motor: new parameters and lost Halls while it runs.

use hallservo::commutation::Commutation;
use hallservo::drive::{Command, Refusal};
use hallservo::fault::{Fault, Limits};
use hallservo::hall::Channel;
use hallservo::hall::adapt;
use hallservo::mode::Mode;
use hallservo::service::Event;
use hallservo::service::adaptation::{Adaptation, torque_nm};
use hallservo::settings::Control;
use hallservo::settings::Settings;
use plant::{HallFault, PlantParameters, Rail};
use rayon::prelude::*;
use rig::{Rig, error_deg};
use sim::statistics::{ByAngle, Statistics};

/// A rig with an adaptation.
struct Adapted {
    rig: Rig,
    adaptation: Adaptation,
    published: u32,
    steps: u32,
}

/// A calibrated, running motor of about 30 Hz electrical.
fn running(plant: &PlantParameters, settings: &Settings, seed: u64) -> Adapted {
    let mut rig = Rig::new(plant, settings, seed).unwrap();
    let calibration = rig.calibrate(|_| ()).unwrap();
    rig.command(Command::Arm).unwrap();
    rig.drive_with(0.1).unwrap();
    // Cogging is a torque that is not told.
    let torque_noise_nm_rthz = 4e-5;
    let noise_codes = [0, 1, 2].map(|k| 0.01 * calibration.model.sensors[k].amplitude);
    let halls = calibration.model.halls();
    let config = adapt::Settings { halls, noise_codes, torque_noise_nm_rthz, ..adapt::Settings::default() };
    let config = config.validate().unwrap();
    let adaptation = Adaptation::new(&config, &calibration.model, rig.config.record_every()).unwrap();
    Adapted { rig, adaptation, published: 0, steps: 0 }
}

impl Adapted {
    /// One control period; the tasks look once a millisecond, and make an estimator if `publish`.
    fn step(&mut self, publish: bool) -> f64 {
        let period = self.rig.step();
        self.steps += 1;
        if self.steps.is_multiple_of(40) {
            while let Some(event) = self.rig.service.poll() {
                if let Event::Record(record) = event {
                    self.adaptation.take(&record, 0.0);
                }
            }
            if publish && self.adaptation.publish(&mut self.rig.service) == Ok(true) {
                self.published += 1;
            }
        }
        error_deg(self.rig.drive.tracker().angle(), period.truth.electrical_angle_rad)
    }
}

/// Systematic error of the tracked angle over the last of twelve seconds in which the Halls warm by 60 K, degrees.
fn warmed(mut plant: PlantParameters, settings: &Settings, seed: u64, publish: bool) -> (Statistics, u32) {
    for (hall, share) in plant.halls.iter_mut().zip([1.0, 0.75, 0.5]) {
        hall.amplitude_drift_k = -0.2 * share / 60.0;
        hall.offset_drift_v_k = 0.05 * share * hall.amplitude_v / 60.0;
    }
    let mut adapted = running(&plant, settings, seed);
    let mut by_angle = ByAngle::new(36);
    for k in 0..480_000 {
        adapted.rig.plant.set_temperature(25.0 + 60.0 * (f64::from(k) / 440_000.0).min(1.0)).unwrap();
        let error = adapted.step(publish);
        assert_eq!(adapted.rig.drive.mode(), Mode::Running, "seed {seed} at {k}");
        if k > 440_000 {
            by_angle.push(adapted.rig.plant.truth().electrical_angle_rad.to_degrees(), error);
        }
    }
    assert_eq!(adapted.adaptation.adapter().fault(), None, "seed {seed}");
    (by_angle.means(20.0).map(|(_, mean)| mean).collect(), adapted.published)
}

/// The short form has two of four motors.
#[test]
fn a_running_drive_takes_up_what_is_learnt() {
    let warmed = |seed, publish| warmed(PlantParameters::imperfect(seed), &Settings::default(), seed, publish);
    let results =
        (1..sim::of(3, 5)).into_par_iter().map(|seed| (warmed(seed, true), warmed(seed, false))).collect::<Vec<_>>();
    for ((adapted, published), (untouched, _)) in results {
        println!("{published} models, systematic {:.3}°; without {:.3}°", adapted.rms(), untouched.rms());
        assert!(published > 100);
        assert!(adapted.rms() < 0.3 && adapted.rms() < 0.5 * untouched.rms());
    }
}

/// The short form has two of ten motors.
#[test]
fn a_running_drive_with_two_halls_takes_up_what_is_learnt() {
    let apart_deg = [90.0, -120.0, 120.0, -90.0, 60.0];
    let cases = (1..=sim::of(2, 10)).zip(apart_deg.into_iter().cycle()).collect::<Vec<_>>();
    let settings = Settings { halls: 2, ..Settings::default() };
    let results = cases.into_par_iter().map(|(seed, apart_deg)| {
        let warmed =
            |publish| warmed(PlantParameters::imperfect(seed).with_two_halls(apart_deg), &settings, seed, publish);
        (apart_deg, warmed(true), warmed(false))
    });
    for (apart_deg, (adapted, published), (untouched, _)) in results.collect::<Vec<_>>() {
        println!(
            "{apart_deg}° apart: {published} models, systematic {:.3}°; without {:.3}°",
            adapted.rms(),
            untouched.rms()
        );
        assert!(published > 100);
        assert!(adapted.rms() < 0.6 && adapted.rms() < 0.2 * untouched.rms());
    }
}

fn lost(seed: u64, fault: HallFault, commutation: Commutation) {
    let sensor = (seed % 3) as usize;
    let settings = Settings { run_on_two_halls: true, commutation, ..Settings::default() };
    let mut adapted = running(&PlantParameters::imperfect(seed), &settings, seed);
    (0..40_000 + 777 * seed).for_each(|_| _ = adapted.step(true));
    adapted.rig.plant.set_hall_fault(sensor, Some(fault));
    let (mut worst, mut astray, mut settled) = (0.0_f64, 0, Statistics::default());
    for k in 0..40_000 {
        let error = adapted.step(true);
        assert_eq!(adapted.rig.drive.mode(), Mode::Running, "seed {seed}, {fault:?} at {k}");
        worst = worst.max(error.abs());
        astray += u32::from(error.abs() > 45.0);
        if k > 12_000 {
            settled.push(error);
        }
    }
    let drive = &adapted.rig.drive;
    println!("seed {seed}, {fault:?}: at most {worst:.1}°, {astray} periods over 45°, then {:.2}° RMS", settled.rms());
    assert!(drive.limits().contains(Limits::TWO_HALLS));
    assert_eq!(drive.estimator().and_then(|estimator| estimator.lost()), Some(Channel(sensor as u8)));
    // A broken wire is seen at once. A stuck Hall first misleads the tracking until the three contradict each other,
    // and then the wrong one may be named for a moment.
    let (most, longest) = if matches!(fault, HallFault::Open(_)) { (10.0, 0) } else { (100.0, 200) };
    assert!(worst < most && astray <= longest, "seed {seed}, {fault:?}: {worst}°, {astray} periods over 45°");
    assert!(settled.rms() < 0.35, "seed {seed}, {fault:?}: {}°", settled.rms());
    // Stopped, it does not start again.
    adapted.rig.command(Command::Disarm).unwrap();
    let refused = adapted.rig.command(Command::Arm).unwrap_err();
    assert_eq!(refused.downcast_ref(), Some(&Refusal::HallLost), "{refused}");
}

#[test]
fn a_running_drive_goes_on_with_two_halls() {
    let faults =
        [HallFault::Open(Rail::Low), HallFault::Open(Rail::High), HallFault::StuckAt(1.65), HallFault::StuckAt(1.8)];
    (1..13).into_par_iter().for_each(|seed| {
        let commutation = if seed % 2 == 0 { Commutation::Sinusoidal } else { Commutation::Block };
        lost(seed, faults[(seed / 3 % 4) as usize], commutation);
    });
}

#[test]
fn without_being_asked_to_it_stops() {
    let mut adapted = running(&PlantParameters::imperfect(1), &Settings::default(), 1);
    (0..20_000).for_each(|_| _ = adapted.step(true));
    adapted.rig.plant.set_hall_fault(1, Some(HallFault::Open(Rail::Low)));
    (0..100).for_each(|_| _ = adapted.step(true));
    assert!(matches!(adapted.rig.drive.mode(), Mode::Faulted(Fault::Hall(_))));
}

/// Error of the filter's angle while the speed swings, degrees, and the mean torque told over that of the motor.
fn swinging(seed: u64, tell: bool) -> (Statistics, f64) {
    let settings =
        Settings { commutation: Commutation::FieldOriented, control: Some(Control::default()), ..Settings::default() };
    let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings, seed).unwrap();
    let calibration = rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    let noise_codes = [0, 1, 2].map(|k| 0.01 * calibration.model.sensors[k].amplitude);
    let update_hz = settings.pwm_hz / rig.config.record_every() as f32;
    let motor =
        adapt::Settings { update_hz, noise_codes, damping_nms: 1e-5, torque_noise_nm_rthz: 4e-5, ..Default::default() };
    let config = motor.validate().unwrap();
    let mut adaptation = Adaptation::new(&config, &calibration.model, rig.config.record_every()).unwrap();
    let (mut error, mut told, mut exact) = (Statistics::default(), 0.0, 0.0);
    let mut torque = 0.0;
    for k in 0..40 {
        let speed = if k % 2 == 0 { 60.0 } else { -60.0 };
        rig.command(Command::Speed(rig.control().unwrap().speed(speed).unwrap())).unwrap();
        for _ in 0..2000 {
            let truth = rig.step().truth;
            exact += truth.torque_nm.abs();
            while let Some(event) = rig.service.poll() {
                let Event::Record(record) = event else { continue };
                while let Some(measurement) = rig.service.measurement() {
                    torque = torque_nm(&measurement, rig.control().unwrap());
                }
                told += f64::from(torque).abs() * f64::from(rig.config.record_every());
                let outcome = adaptation.take(&record, if tell { torque } else { 0.0 });
                assert!(!matches!(outcome, adapt::Status::Failed(_)), "seed {seed}: {outcome:?}");
                if k > 4 {
                    error.push(error_deg(adaptation.adapter().angle(), truth.electrical_angle_rad));
                }
            }
        }
    }
    (error, told / exact)
}

/// The short form has two of four motors.
#[test]
fn the_current_s_torque_helps_to_follow() {
    let results = (1..sim::of(3, 5))
        .into_par_iter()
        .map(|seed| (swinging(seed, true), swinging(seed, false)))
        .collect::<Vec<_>>();
    for ((with, share), (without, _)) in results {
        println!("{:.3}°, torque {share:.3} of the motor's; not told {:.3}°", with.rms(), without.rms());
        assert!((share - 1.0).abs() < 0.03, "{share}");
        assert!(with.rms() < 0.25 * without.rms());
    }
}
