//! A calibration that does not fit the settings any more, or that another one was to replace, arms nothing.

use super::*;
use crate::settings::Control;

const COMMUTATIONS: [Commutation; 3] = [Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented];

fn settings(commutation: Commutation, reversed: bool) -> Settings {
    Settings { commutation, reversed, control: Some(Control::default()), ..Settings::default() }
}

/// Installed, in one direction; and in which state the other direction is set.
fn bench(commutation: Commutation, faulted: bool) -> Bench {
    let mut bench = Bench::new(&settings(commutation, false));
    bench.healthy = true;
    bench.install().unwrap();
    if faulted {
        bench.command(Command::Arm).unwrap();
        bench.command(Command::Trip(Fault::Disabled)).unwrap();
        assert_eq!(bench.mode(), Mode::Faulted(Fault::Disabled));
    }
    bench
}

fn configure(bench: &mut Bench, settings: &Settings) -> Reply {
    bench.service.configure(Box::leak(Box::new(settings.validate().unwrap()))).unwrap();
    bench.reply()
}

#[test]
fn another_direction_arms_nothing_before_the_model_is_installed_for_it() {
    for commutation in COMMUTATIONS {
        for faulted in [false, true] {
            let mut bench = bench(commutation, faulted);
            configure(&mut bench, &settings(commutation, true)).unwrap();
            if faulted {
                bench.command(Command::Clear).unwrap();
            }
            assert_eq!(bench.mode(), Mode::Unarmed, "{commutation:?} {faulted}");
            assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
            // The model still says the old direction; the service makes the estimator for that of the settings.
            assert!(!bench.model.reversed);
            bench.install().unwrap();
            assert_eq!(bench.mode(), Mode::Ready);
            let angle = bench.drive.tracker().angle() + bench.rotor;
            assert!(angle.to_degrees().abs() < 0.2, "{angle:?}");
            bench.command(Command::Arm).unwrap();
        }
    }
}

#[test]
fn an_estimator_on_its_way_when_the_direction_changes_is_refused() {
    let mut bench = bench(Commutation::Sinusoidal, false);
    let other = Box::leak(Box::new(settings(Commutation::Sinusoidal, true).validate().unwrap()));
    // Both are queued before the drive takes up either: the estimator was made for the direction before.
    bench.service.configure(other).unwrap();
    bench.service.install(&bench.model.clone()).unwrap();
    let installed = loop {
        match bench.service.poll() {
            Some(service::Event::Installed(reply)) => break reply,
            Some(_) => {}
            None => drop(bench.step()),
        }
    };
    assert_eq!((installed, bench.mode()), (Err(Refusal::NotCalibrated), Mode::Unarmed));
}

#[test]
fn settings_of_the_same_direction_leave_the_calibration() {
    let mut bench = bench(Commutation::Sinusoidal, false);
    configure(&mut bench, &Settings { pole_pairs: 7, ..settings(Commutation::Sinusoidal, false) }).unwrap();
    assert_eq!(bench.mode(), Mode::Ready);
    bench.command(Command::Arm).unwrap();
}

#[test]
fn the_control_and_the_rest_of_the_settings_know_one_direction() {
    for reversed in [false, true] {
        for control in [None, Some(Control::default())] {
            let config = Settings { reversed, control, ..Settings::default() }.validate().unwrap();
            assert_eq!(config.is_reversed(), reversed);
        }
    }
}

#[test]
fn a_calibration_that_came_to_nothing_does_not_leave_the_one_before() {
    let ends: [fn(&mut Bench); 3] = [
        // It is broken off.
        |bench| bench.command(Command::Disarm).unwrap(),
        // A fault ends it.
        |bench| bench.command(Command::Trip(Fault::Disabled)).unwrap(),
        // The samples make no model.
        |bench| loop {
            bench.step_with([2048, 2040, 2060]);
            if let Some(service::Event::Refused(_)) = bench.service.poll() {
                for _ in 0..4 {
                    bench.step();
                }
                break;
            }
        },
    ];
    for (k, end) in ends.into_iter().enumerate() {
        let mut bench = bench(Commutation::Sinusoidal, false);
        bench.command(Command::Calibrate).unwrap();
        end(&mut bench);
        if let Mode::Faulted(_) = bench.mode() {
            bench.command(Command::Clear).unwrap();
        }
        assert_eq!(bench.mode(), Mode::Unarmed, "{k}");
        assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated), "{k}");
    }
}

#[test]
fn samples_lost_by_tasks_that_poll_too_rarely_are_told_as_that() {
    // Of 63 records in the queue, and from none of the calibration to hardly any.
    for every in [1_000, 1_000_000] {
        let mut bench = Bench::new(&Settings::default());
        bench.command(Command::Calibrate).unwrap();
        let mut steps = 0;
        let error = loop {
            bench.rotor = bench.drive.tracker().angle();
            bench.step();
            steps += 1;
            // Aligned is seen; after that somebody else has the processor.
            if steps < 20_000 || steps % every == 0 {
                match bench.service.poll() {
                    Some(service::Event::Refused(error)) => break error,
                    Some(service::Event::Calibrated(_)) => panic!("calibrated on {every}"),
                    _ => {}
                }
            }
        };
        let crate::hall::calibrate::Error::SamplesLost { percent } = error else { panic!("{error}") };
        assert!(percent > 80, "{percent}");
        assert!(std::format!("{error}").contains("poll too rarely"));
    }
}
