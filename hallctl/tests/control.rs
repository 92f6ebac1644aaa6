//! Who may say what: one tool controls, others read, anyone stops; and what begins without a tool that lives ends.

use crate::tool::{arm, ask, ask_as, calibrated, done, drive, request_of, run, status, wait};
use hallservo::hall::adapt::{Fault, Parameter};
use hallservo::mode::Mode;
use hallservo::settings::{self, Settings};
use hallservo_protocol::*;
use plant::PlantParameters;
use simulator::flash::Flash;
use simulator::{Simulator, defaults};
use std::sync::LazyLock;

const FIRST: u32 = 1;
const SECOND: u32 = 2;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

fn ready() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    drive
}

fn refused(drive: &mut Simulator, client: u32, what: Ask<'_>, why: Refusal<'_>) {
    ask_as(client, drive, what, |answer| assert_eq!(answer, Answer::Refused(why), "{what:?}"));
}

fn done_by(drive: &mut Simulator, client: u32, what: Ask<'_>) {
    ask_as(client, drive, what, |answer| assert!(!matches!(answer, Answer::Refused(_)), "{what:?}: {answer:?}"));
}

#[test]
fn one_tool_controls_others_read_and_anyone_stops() {
    let mut drive = ready();
    done_by(&mut drive, FIRST, Ask::Arm);
    done_by(&mut drive, FIRST, Ask::Speed(60.0));
    let set = Ask::Set { name: "stall_s", value: 1.0 };
    let controlling = [
        Ask::Arm,
        Ask::Clear,
        Ask::Voltage(0.0),
        Ask::Torque(0.0),
        Ask::Speed(0.0),
        Ask::Position(0.0),
        Ask::Calibrate,
        Ask::Identify,
        Ask::LearnCogging,
        Ask::AntiCogging(false),
        set,
        Ask::Save,
        Ask::Load,
        Ask::Restore,
        Ask::Accept,
    ];
    for what in controlling {
        assert!(what.controls());
        refused(&mut drive, SECOND, what, Refusal::Controlled);
    }
    for what in [Ask::Hello, Ask::Status, Ask::Get("stall_s"), Ask::Setting(0), Ask::History(0), Ask::Calibration] {
        assert!(!what.controls());
        done_by(&mut drive, SECOND, what);
    }
    assert_eq!(status(&mut drive).client, FIRST);
    assert_eq!(drive.drive().mode(), Mode::Running);
    done_by(&mut drive, SECOND, Ask::Disarm);
    assert_eq!(drive.drive().mode(), Mode::Ready);
}

#[test]
fn control_ends_by_release_by_disarming_and_by_silence() {
    let mut drive = ready();
    let ends: [fn(&mut Simulator); 3] = [
        |drive| done_by(drive, FIRST, Ask::Release),
        |drive| done_by(drive, SECOND, Ask::Disarm),
        |drive| run(drive, 1010),
    ];
    for end in ends {
        done_by(&mut drive, FIRST, Ask::Set { name: "stall_s", value: 0.7 });
        // Another's release is none.
        done_by(&mut drive, SECOND, Ask::Release);
        refused(&mut drive, SECOND, Ask::Arm, Refusal::Controlled);
        end(&mut drive);
        done_by(&mut drive, SECOND, Ask::Arm);
        refused(&mut drive, FIRST, Ask::Arm, Refusal::Controlled);
        done_by(&mut drive, SECOND, Ask::Disarm);
    }
    // Requests of any kind are a sign of life, another's are none.
    done_by(&mut drive, FIRST, Ask::Arm);
    for _ in 0..20 {
        run(&mut drive, 100);
        done_by(&mut drive, FIRST, Ask::Status);
    }
    refused(&mut drive, SECOND, Ask::Arm, Refusal::Controlled);
    for _ in 0..11 {
        run(&mut drive, 100);
        done_by(&mut drive, SECOND, Ask::Status);
    }
    done_by(&mut drive, SECOND, Ask::Disarm);
    done_by(&mut drive, SECOND, Ask::Arm);
}

#[test]
fn a_procedure_ends_bridge_off_when_its_tool_falls_silent() {
    for procedure in [Ask::Calibrate, Ask::Identify, Ask::LearnCogging] {
        let mut drive = ready();
        // What is sent by itself is no sign of life, nor are the looks of another tool.
        drive.write(&request_of(FIRST, false, 5, Ask::Telemetry(500.0)));
        done_by(&mut drive, FIRST, procedure);
        let mut silent_ms = 0;
        while silent_ms < 900 {
            silent_ms += 90;
            drive.write(&request_of(SECOND, false, 7, Ask::Status));
            run(&mut drive, 90);
        }
        assert!(drive.drive().mode().drives(), "{procedure:?}: {:?}", drive.drive().mode());
        run(&mut drive, 110);
        assert!(!drive.drive().mode().drives(), "{procedure:?}");
        run(&mut drive, 1000);
        assert!(!drive.drive().mode().drives(), "{procedure:?}");
        let found = status(&mut drive);
        assert_eq!((found.activity, found.incidents), (Activity::None, 1), "{procedure:?}");
        ask(&mut drive, Ask::History(0), |answer| match answer {
            Answer::History(History { entry: Some(incident), .. }) => {
                assert!(matches!(incident.cause, Cause::Abandoned(_)), "{incident:?}");
                assert!(hallctl::words::incident(&incident).0.contains("fell silent"));
            }
            other => panic!("{other:?}"),
        });
    }
}

/// The inertia of the settings is a tenth of the rotor's, as where a mass has been mounted since.
#[test]
fn a_rotor_that_is_much_heavier_than_known_is_told() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "command_timeout_s", value: 60.0 });
    let inertia_kgm2 = ask(&mut drive, Ask::Get("inertia_kgm2"), |answer| match answer {
        Answer::Setting(setting) => setting.value,
        other => panic!("{other:?}"),
    });
    for (share, incidents) in [(1.0, 0), (0.1, 1)] {
        done(&mut drive, Ask::Set { name: "inertia_kgm2", value: share * inertia_kgm2 });
        arm(&mut drive);
        for turns in [1.0, 0.0] {
            done(&mut drive, Ask::Position(turns));
            run(&mut drive, 4000);
        }
        let found = status(&mut drive);
        assert_eq!((found.mode, found.incidents), (Mode::Running, incidents), "{share} of the inertia");
        done(&mut drive, Ask::Disarm);
    }
    ask(&mut drive, Ask::History(0), |answer| match answer {
        Answer::History(History { entry: Some(incident), .. }) => {
            assert_eq!(incident.cause, Cause::Heavier);
            let (what, advice) = hallctl::words::incident(&incident);
            assert!(what.contains("heavier than inertia_kgm2") && advice.contains("commission"), "{what} {advice}");
        }
        other => panic!("{other:?}"),
    });
}

/// The inertia of the settings is that of a shaft with something on it that was taken off since.
#[test]
fn a_rotor_that_is_much_lighter_than_known_is_told_until_it_is_armed_again() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "command_timeout_s", value: 60.0 });
    for (share, incidents) in [(1.0, 0), (10.0, 1), (1.0, 2), (10.0, 3)] {
        done(&mut drive, Ask::Set { name: "inertia_kgm2", value: share * 1e-5 });
        arm(&mut drive);
        let rest = |drive: &mut Simulator, incidents| {
            for (rad_s, milliseconds) in [(20.0, 1000), (0.0, 12_000)] {
                done(drive, Ask::Speed(rad_s));
                run(drive, milliseconds);
            }
            let found = status(drive);
            assert_eq!((found.mode, found.incidents), (Mode::Running, incidents), "{share} times the inertia");
        };
        rest(&mut drive, incidents);
        if share > 1.0 {
            // Other gains, which swing it as well, are told anew.
            done(&mut drive, Ask::Set { name: "speed_bandwidth_hz", value: 59.0 + f32::from(incidents) });
            rest(&mut drive, incidents + 1);
        }
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 100);
    }
    ask(&mut drive, Ask::History(0), |answer| match answer {
        Answer::History(History { entry: Some(incident), .. }) => {
            assert_eq!(incident.cause, Cause::Lighter);
            let (what, advice) = hallctl::words::incident(&incident);
            assert!(what.contains("lighter than inertia_kgm2") && advice.contains("commission"), "{what} {advice}");
        }
        other => panic!("{other:?}"),
    });
}

#[test]
fn a_procedure_goes_on_with_a_living_tool_or_unattended() {
    for unattended in [false, true] {
        let mut drive = drive(Flash::blank());
        run(&mut drive, 10);
        drive.write(&request_of(FIRST, unattended, 1, Ask::Calibrate));
        for _ in 0..100 {
            run(&mut drive, 90);
            if !unattended {
                done_by(&mut drive, FIRST, Ask::Status);
            }
        }
        assert_eq!(drive.drive().mode(), Mode::Ready, "{unattended}");
        assert_eq!(status(&mut drive).incidents, 0);
    }
}

#[test]
fn settings_that_could_not_be_taken_over_are_confirmed_before_the_bridge_is_on() {
    // Saved by a firmware whose board had no ceilings.
    let other = Settings { ceilings: &[], ..defaults() };
    let flash = Flash::of(FLASH.clone());
    let mut before = Simulator::with(other, &PlantParameters::imperfect(1), 1, flash, Vec::new()).unwrap();
    run(&mut before, 10);
    done(&mut before, Ask::Set { name: "over_current_a", value: 8.0 });
    done(&mut before, Ask::Set { name: "max_current_a", value: 2.0 });
    done(&mut before, Ask::Save);
    let foreign = before.flash();
    drop(before);
    let mut corrupt = foreign.clone();
    let value = 8.0_f32.to_le_bytes();
    let place = corrupt.windows(4).rposition(|bytes| bytes == value).expect("over_current_a");
    corrupt[place] ^= 1;
    for (flash, problem) in [(foreign, Problem::Foreign), (corrupt, Problem::Corrupt)] {
        for confirm in [Ask::Accept, Ask::Save] {
            let mut drive = drive(Flash::of(flash.clone()));
            run(&mut drive, 10);
            let found = status(&mut drive);
            assert!(found.unconfirmed && found.stored[2] == problem, "{found:?}");
            for what in [Ask::Arm, Ask::Calibrate, Ask::Identify, Ask::LearnCogging] {
                refused(&mut drive, FIRST, what, Refusal::Unconfirmed(problem));
            }
            let words = hallctl::words::refusal(&Refusal::Unconfirmed(problem));
            assert!(words.contains("less strict") && words.contains("settings save"), "{words}");
            done(&mut drive, confirm);
            done(&mut drive, Ask::Arm);
            let kept = drive.flash();
            drop(drive);
            // Only a save is for good.
            let mut again = self::drive(Flash::of(kept));
            run(&mut again, 10);
            assert_eq!(status(&mut again).unconfirmed, confirm == Ask::Accept);
        }
    }
    // Settings that are the board's, or as they were saved, need nobody.
    assert!(!status(&mut ready()).unconfirmed);
}

#[test]
fn a_ceiling_is_named_and_changes_nothing() {
    let mut drive = ready();
    for (field, most) in defaults().ceilings.iter().copied() {
        // A ceiling of zero leaves out what the board has not.
        let value = 1.01 * most + 0.01;
        let why = settings::Error::Ceiling { field, value, most };
        refused(&mut drive, FIRST, Ask::Set { name: field, value }, Refusal::Setting(why));
        assert!(hallctl::words::refusal(&Refusal::Setting(why)).contains("ceiling"));
        ask(&mut drive, Ask::Get(field), |answer| {
            assert!(matches!(answer, Answer::Setting(setting) if setting.max == most), "{answer:?}");
        });
    }
    for (name, value) in [("stall_s", 100.0), ("command_timeout_s", f32::INFINITY), ("over_voltage_v", 36.3)] {
        ask(&mut drive, Ask::Set { name, value }, |answer| {
            assert!(matches!(answer, Answer::Refused(Refusal::Setting(_))), "{name}: {answer:?}");
        });
    }
}

#[test]
fn cogging_is_balanced_in_the_other_direction_too() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::LearnCogging);
    wait(&mut drive);
    // Held at rest by nothing but the table, the torque that is left is small in either direction.
    let mut left = [0.0, 0.0];
    for (value, left) in [0.0, 1.0].into_iter().zip(&mut left) {
        done(&mut drive, Ask::Set { name: "reversed", value });
        run(&mut drive, 100);
        done(&mut drive, Ask::Arm);
        done(&mut drive, Ask::Speed(3.0));
        let mut sum = 0.0;
        for step in 0..2000 {
            run(&mut drive, 1);
            if step % 200 == 0 {
                done(&mut drive, Ask::Speed(3.0));
            }
            if step > 500 {
                sum += (drive.plant.truth().speed_rad_s.abs() - 3.0).powi(2);
            }
        }
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 1000);
        *left = (sum / 1500.0).sqrt();
    }
    println!("speed ripple, RMS: {left:?} rad/s");
    assert!(left[1] < 1.3 * left[0], "{left:?}");
}

/// The second sensor fades by a tenth from power-up to power-up, which each finds within a second.
#[test]
fn power_ups_do_not_let_what_is_learnt_wander_off() {
    let mut flash = FLASH.clone();
    let mut parameters = PlantParameters::imperfect(1);
    for boot in 1..=9 {
        parameters.halls[1].amplitude_v *= 0.9;
        let mut drive = Simulator::at(&parameters, 1, Flash::of(flash), Vec::new()).unwrap();
        run(&mut drive, 10);
        done(&mut drive, Ask::Arm);
        let mut learning = Learning::On;
        for _ in 0..25 {
            ask(&mut drive, Ask::Speed(60.0), |_| ());
            run(&mut drive, 100);
            learning = status(&mut drive).learning;
        }
        if let Learning::Ended(fault) = learning {
            // 0.9⁶ is below the limit of 0.55: said so, or found in the contradiction to the other two before.
            let weak = hallservo::hall::Channel(1);
            let expected = [Fault::Drifted(weak, Parameter::Amplitude), Fault::Lost(weak)];
            assert!(expected.contains(&fault) && (5..=7).contains(&boot), "{fault:?} after {boot}");
            return;
        }
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 3000);
        flash = drive.flash();
    }
    panic!("the amplitude went on and on");
}
