//! Torque, speed and position control against the simulated motor.

use crate::commissioned::here_turns;
use hallservo::angle::ElectricalAngle;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use hallservo::settings::{Control, GuardSettings};
use plant::{PlantParameters, Unevenness};
use rig::{Rig, error_deg};

fn settings() -> Settings {
    let commutation = Commutation::FieldOriented;
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    Settings { commutation, control: Some(Control { guard, ..Control::default() }), ..Settings::default() }
}

fn armed(commutation: Commutation) -> Rig {
    // With local feedback, hardly anything brakes where the supply takes nothing back.
    let control = Control { max_regeneration_a: 100.0, ..Control::default() };
    let settings = Settings { commutation, control: Some(control), ..settings() };
    let mut plant = PlantParameters::imperfect(1);
    plant.bus.regenerative = true;
    let mut rig = Rig::new(&plant, &settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    rig
}

#[test]
fn every_commutation_controls_current_speed_and_position() {
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
        let mut rig = armed(commutation);
        rig.plant.set_dyno(Some(20.0)).unwrap();
        rig.command(Command::Current(rig.control().unwrap().torque(0.03).unwrap())).unwrap();
        rig.wait(0.05);
        let (mut torque, mut count) = (0.0, 0.0);
        rig.run(0.2, |_, period| (torque, count) = (torque + period.truth.torque_nm, count + 1.0));
        assert!((torque / count - 0.03).abs() < 0.0015, "{commutation:?} {}", torque / count);
        rig.plant.set_dyno(None).unwrap();

        rig.command(Command::Speed(rig.control().unwrap().speed(-100.0).unwrap())).unwrap();
        rig.wait(0.3);
        let (mut speed, mut count) = (0.0, 0.0);
        rig.run(0.2, |_, period| (speed, count) = (speed + period.truth.speed_rad_s, count + 1.0));
        assert!((speed / count + 100.0).abs() < 0.5, "{commutation:?} {}", speed / count);

        let here = here_turns(&rig);
        rig.command(Command::Position(rig.control().unwrap().position(here + 3.25).unwrap())).unwrap();
        rig.wait(0.8);
        let there = here_turns(&rig);
        assert!((there - here - 3.25).abs() < 1e-3, "{commutation:?} {} {:?}", there - here, rig.drive.mode());
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
}

#[test]
fn after_a_stall_the_drive_arms_again() {
    let guard = GuardSettings { stall_s: 0.02, ..GuardSettings::default() };
    let control = Control { guard, ..Control::default() };
    let mut rig =
        Rig::new(&PlantParameters::imperfect(1), &Settings { control: Some(control), ..settings() }, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    // At any step: only one in eight looks at the stall.
    for steps in 0..40 {
        for _ in 0..steps {
            rig.step();
        }
        rig.command(Command::Arm).unwrap();
        rig.command(Command::Speed(rig.control().unwrap().speed(100.0).unwrap())).unwrap();
        rig.wait(0.3);
        assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::Stall));
        rig.command(Command::Clear).unwrap();
    }
}

#[test]
fn a_wrong_alignment_heals_while_turning() {
    // The check at arming takes more than some 13° for a fault.
    for off_deg in [-12.0, 12.0] {
        let mut rig = Rig::new(&PlantParameters::imperfect(1), &settings(), 1).unwrap();
        let mut model = rig.calibrate(|_| ()).unwrap().model;
        model.alignment += ElectricalAngle::from_degrees(off_deg);
        rig.serve();
        rig.service.install(&model).unwrap();
        rig.wait(0.02);
        rig.command(Command::Arm).unwrap();
        for speed in [200.0, -200.0] {
            rig.command(Command::Speed(rig.control().unwrap().speed(speed).unwrap())).unwrap();
            let mut error = f64::NAN;
            rig.run(1.5, |rig, period| {
                let angle = rig.drive.tracker().angle() + rig.drive.trim();
                error = error_deg(angle, period.truth.electrical_angle_rad);
            });
            assert!(error.abs() < 0.5, "{off_deg} {speed}: {error}");
        }
    }
}

/// With the bridge off, the voltage of before tells nothing of the angle.
#[test]
fn off_at_speed_the_alignment_stays() {
    let plant = PlantParameters::imperfect(1).with_unevenness(&Unevenness::CHEAP, 1);
    let mut rig = Rig::new(&plant, &settings(), 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    for k in 0..20 {
        rig.command(Command::Speed(rig.control().unwrap().speed(300.0).unwrap())).unwrap();
        rig.wait(0.4 + 0.0013 * f64::from(k));
        rig.command(Command::Disarm).unwrap();
        let before = rig.drive.trim();
        rig.wait(0.1);
        assert_eq!(rig.drive.trim(), before, "{k}");
        rig.arm().unwrap();
    }
}
