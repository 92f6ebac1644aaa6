//! The calibration, and what it leaves behind.

use super::*;

#[test]
fn a_calibration_can_be_stopped_and_repeated() {
    let mut bench = Bench::running();
    assert_eq!(bench.command(Command::Calibrate), Err(Refusal::Mode(Mode::Running)));
    bench.command(Command::Disarm).unwrap();
    for disarm_after in [10, 20_000, 60_000] {
        bench.command(Command::Calibrate).unwrap();
        for k in 0..disarm_after {
            bench.rotor = bench.drive.tracker().angle();
            bench.step();
            if k % 40 == 0 {
                while bench.service.poll().is_some() {}
            }
        }
        assert!(bench.mode().drives());
        bench.command(Command::Disarm).unwrap();
        assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Unarmed));
    }
    bench.command(Command::Calibrate).unwrap();
    let mut progress = 0.0;
    let calibration = loop {
        // An ideal rotor that follows the field 5° behind.
        bench.rotor = bench.drive.tracker().angle();
        bench.step();
        if bench.mode() == Mode::Calibrating {
            assert!(bench.service.progress() >= progress);
            progress = bench.service.progress();
        }
        match bench.service.poll() {
            Some(service::Event::Calibrated(calibration)) => break calibration,
            Some(service::Event::Refused(error)) => panic!("{error}"),
            _ => {}
        }
    };
    assert!(progress > 0.99, "{progress}");
    let alignment = calibration.model.electrical(ElectricalAngle::ZERO) - bench.model.electrical(ElectricalAngle::ZERO);
    assert!(alignment.to_degrees().abs() < 0.5, "{alignment}");
    // A command waits while a record is handed over.
    bench.step();
    bench.step();
    assert_eq!(bench.mode(), Mode::Ready);
    bench.command(Command::Arm).unwrap();
}

#[test]
fn a_voltage_of_zero_brakes_the_field_and_nothing_is_recorded() {
    for brake_after in [10, 20_000, 60_000] {
        let mut bench = Bench::new(&Settings::default());
        bench.command(Command::Calibrate).unwrap();
        let follow = |bench: &mut Bench, steps: u32| {
            let before = bench.rotor;
            for _ in 0..steps {
                bench.rotor = bench.drive.tracker().angle();
                bench.step();
                while bench.service.poll().is_some() {}
            }
            (bench.rotor - before).to_bits()
        };
        follow(&mut bench, brake_after);
        let mode = bench.mode();
        assert!(matches!(bench.command(Command::Drive(Modulation::from_num(0.1))), Err(Refusal::Mode(_))));
        bench.command(Command::Drive(Modulation::ZERO)).unwrap();
        // A quarter of a turn at most, and it stands; for ever.
        follow(&mut bench, 4000);
        assert_eq!((follow(&mut bench, 100_000), bench.mode()), (0, mode), "{brake_after}");
        bench.command(Command::Disarm).unwrap();
        assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Unarmed));
        assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
    }
}

#[test]
fn a_refused_calibrate_leaves_the_calibration_at_work_as_it_is() {
    let mut bench = Bench::new(&Settings::default());
    bench.command(Command::Calibrate).unwrap();
    let mut refused = false;
    loop {
        bench.rotor = bench.drive.tracker().angle();
        bench.step();
        let event = bench.service.poll();
        let progress = bench.service.progress();
        if !refused && progress > 0.3 {
            assert_eq!(bench.command(Command::Calibrate), Err(Refusal::Mode(Mode::Calibrating)));
            assert!(bench.service.progress() >= progress, "{} after {progress}", bench.service.progress());
            refused = true;
        }
        match event {
            Some(service::Event::Calibrated(_)) => break,
            Some(service::Event::Refused(error)) => panic!("{error}"),
            _ => {}
        }
    }
    assert!(refused);
}

#[test]
fn bad_samples_fail_the_calibration() {
    let mut bench = Bench::new(&Settings::default());
    bench.command(Command::Calibrate).unwrap();
    let error = loop {
        bench.step_with([2048, 2040, 2060]);
        match bench.service.poll() {
            Some(service::Event::Refused(error)) => break error,
            Some(service::Event::Calibrated(_)) => panic!("calibrated on nothing"),
            _ => {}
        }
    };
    assert_eq!(error, crate::hall::calibrate::Error::NotTurning);
    bench.step();
    bench.step();
    assert_eq!(bench.mode(), Mode::Faulted(Fault::Calibration));
    bench.command(Command::Clear).unwrap();
    assert_eq!(bench.mode(), Mode::Unarmed);
    assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
}

#[test]
fn estimators_come_back() {
    let mut bench = Bench::running();
    // While running, too: that is how the adaptation works.
    for k in 0..100 {
        bench.model.sensors[0].amplitude = 600.0 + k as f32;
        bench.install().unwrap();
        assert_eq!(bench.step().legs, Legs::ALL);
    }
}
