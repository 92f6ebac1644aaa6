//! Another switching frequency: the drive moves as it is told, its time and its settings are right, nothing is lost.

use crate::tool::{arm, ask, calibrated, done, drive, rings, run, status, wait};
use hallservo::drive;
use hallservo::mode::Mode;
use hallservo::settings::Error;
use hallservo_protocol::{Answer, Ask, Refusal};
use simulator::Simulator;
use simulator::flash::Flash;
use std::f64::consts::TAU;

fn set(drive: &mut Simulator, name: &str, value: f32) -> Result<(), Refusal<'static>> {
    ask(drive, Ask::Set { name, value }, |answer| match answer {
        Answer::Setting(setting) => {
            assert_eq!((setting.value, setting.fixed), (value, false));
            Ok(())
        }
        Answer::Refused(Refusal::Setting(Error::Fixed)) => Err(Refusal::Setting(Error::Fixed)),
        Answer::Refused(Refusal::Drive(refusal)) => Err(Refusal::Drive(refusal)),
        other => panic!("{name}: {other:?}"),
    })
}

fn switch(drive: &mut Simulator, pwm_hz: f32) {
    if pwm_hz < 40e3 {
        set(drive, "max_electrical_hz", pwm_hz / 20.0).unwrap();
    }
    set(drive, "pwm_hz", pwm_hz).unwrap();
    assert!((drive.plant.period_s() * f64::from(pwm_hz) - 1.0).abs() < 1e-3, "{}", drive.plant.period_s());
}

/// Turns both ways and goes to a position, as the motor really does.
fn moves(drive: &mut Simulator) {
    let zero = offset_turns(drive);
    arm(drive);
    for speed in [100.0, -30.0] {
        done(drive, Ask::Speed(speed));
        run(drive, 900);
        let (from, from_ms) = (drive.plant.truth().mechanical_angle_rad, drive.now_ms());
        // Both over the same time: cogging and noise ripple what is told at one instant.
        let told: f64 = (0..40).map(|_| f64::from(status(drive).speed_rad_s) / 40.0).sum();
        let found = 1e3 * (drive.plant.truth().mechanical_angle_rad - from) / (drive.now_ms() - from_ms) as f64;
        assert!((found / f64::from(speed) - 1.0).abs() < 0.03, "{found} rad/s of {speed}");
        assert!((told / found - 1.0).abs() < 0.03, "{told} rad/s told of {found}");
    }
    let to = status(drive).position_turns + 3.0;
    done(drive, Ask::Position(to));
    for _ in 0..4 {
        run(drive, 400);
        done(drive, Ask::Position(to));
    }
    let found = drive.plant.truth().mechanical_angle_rad / TAU + zero;
    assert!((found - to).abs() < 0.003, "{found} turns of {to}");
    done(drive, Ask::Disarm);
    run(drive, 300);
}

/// How far the drive's count is ahead of the shaft.
fn offset_turns(drive: &mut Simulator) -> f64 {
    status(drive).position_turns - drive.plant.truth().mechanical_angle_rad / TAU
}

#[test]
fn a_drive_switches_as_it_is_set_and_moves_as_it_is_told() {
    for pwm_hz in sim::of(&[20e3, 80e3][..], &[20e3, 27.3e3, 33e3, 57e3, 80e3]) {
        let (mut drive, _) = calibrated();
        switch(&mut drive, *pwm_hz);
        moves(&mut drive);
        done(&mut drive, Ask::Save);
        run(&mut drive, 100);
        // From power-up on it is so, with the calibration of before and with one of its own.
        let mut drive = drive_of(drive.flash());
        assert!((drive.plant.period_s() * f64::from(*pwm_hz) - 1.0).abs() < 1e-3);
        moves(&mut drive);
        done(&mut drive, Ask::Calibrate);
        wait(&mut drive);
        moves(&mut drive);
        // Back to the board's own.
        done(&mut drive, Ask::Restore);
        assert_eq!(drive.plant.period_s(), 1.0 / 40e3);
        moves(&mut drive);
    }
}

fn drive_of(flash: Vec<u8>) -> Simulator {
    let mut drive = drive(Flash::of(flash));
    run(&mut drive, 10);
    drive
}

/// It waits for the bridge to be off, and does not lose count of a shaft that somebody turns meanwhile.
#[test]
fn the_frequency_changes_with_the_bridge_off_only_and_no_turn_is_lost() {
    let (mut drive, _) = calibrated();
    arm(&mut drive);
    done(&mut drive, Ask::Speed(50.0));
    run(&mut drive, 300);
    let refused = set(&mut drive, "pwm_hz", 80e3);
    assert_eq!(refused, Err(Refusal::Drive(drive::Refusal::Mode(Mode::Running))));
    assert_eq!(drive.plant.period_s(), 1.0 / 40e3);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 300);
    let zero = offset_turns(&mut drive);
    set(&mut drive, "max_electrical_hz", 1000.0).unwrap();
    drive.turn_by_hand(5.0).unwrap();
    for pwm_hz in [80e3, 20e3, 80e3, 33e3, 20e3, 40e3] {
        set(&mut drive, "pwm_hz", pwm_hz).unwrap();
        run(&mut drive, 300);
        let moved = offset_turns(&mut drive) - zero;
        assert!(moved.abs() < 0.01, "{moved} turns at {pwm_hz} Hz");
        assert_eq!(drive.drive().mode(), Mode::Ready);
    }
    while drive.plant.truth().speed_rad_s.abs() > 0.1 {
        run(&mut drive, 100);
    }
    moves(&mut drive);
}

/// The vernier's share in the steps is planned for one frequency.
#[test]
fn a_drive_with_rings_keeps_its_frequency() {
    let mut drive = rings::powered_up(Flash::blank(), 0.3, 1);
    run(&mut drive, 10);
    assert_eq!(set(&mut drive, "pwm_hz", 20e3), Err(Refusal::Setting(Error::Fixed)));
}
