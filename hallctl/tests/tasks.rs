//! The tasks of a drive: watchdog, time-out, storage, procedures.

use crate::tool::{self, arm, ask, calibrated, done, drive, run, status, wait};
use hallservo::board::Legs;
use hallservo::drive::Refusal as DriveRefusal;
use hallservo::mode::Mode;
use hallservo_app::{Identity, Memory, Readings, Supervisor};
use hallservo_protocol::{Answer, Ask, Cause, Decoder, Learning, Problem, Procedure, Record, Refusal, Reply};
use plant::{HallFault, PlantParameters, Rail};
use simulator::flash::Flash;
use simulator::{Simulator, defaults, fault};

#[test]
fn the_watchdog_is_fed_only_while_the_control_interrupt_comes() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 1000);
    let fed = drive.fed();
    // Every 20 ms.
    assert!((45..=50).contains(&fed), "{fed}");
    (0..1000).for_each(|_| drive.stall());
    assert!(drive.fed() <= fed + 1);
    run(&mut drive, 100);
    assert!(drive.fed() > fed + 1);
}

#[test]
fn a_dead_control_interrupt_is_told_and_nothing_waits_for_ever() {
    let (mut drive, _) = calibrated();
    drive.write(&tool::request(7, Ask::Arm));
    (0..200).for_each(|_| drive.stall());
    let reply = drive.read();
    let mut decoder = Decoder::new();
    let silent = reply.iter().any(|&byte| {
        let message = decoder.push::<Reply<'_>>(byte);
        matches!(message, Some(Ok(reply)) if reply.answer == Answer::Refused(Refusal::NoAnswer))
    });
    assert!(silent);
    // Its answer comes late and is nobody's; what is asked for then is answered as it should.
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Running);
    done(&mut drive, Ask::Disarm);
    assert_eq!(drive.drive().mode(), Mode::Ready);
}

#[test]
fn disarm_is_obeyed_though_an_answer_is_owed_and_the_queue_full() {
    // More than the queue of commands holds, and none.
    for disarms in [1, 12] {
        let (mut drive, _) = calibrated();
        drive.write(&tool::request(7, Ask::Arm));
        (0..150).for_each(|_| drive.stall());
        for id in 0..disarms {
            drive.write(&tool::request(id, Ask::Disarm));
            (0..150).for_each(|_| drive.stall());
        }
        run(&mut drive, 20);
        assert_eq!(drive.drive().mode(), Mode::Ready);
        // Every late answer was counted: the next ones are whose they are.
        done(&mut drive, Ask::Arm);
        assert_eq!(drive.drive().mode(), Mode::Running);
        done(&mut drive, Ask::Disarm);
        assert_eq!(drive.drive().mode(), Mode::Ready);
    }
}

#[test]
fn disarm_acts_though_the_tasks_do_nothing() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(60.0));
    run(&mut drive, 100);
    // Behind what has its turn before.
    let asked = [Ask::Status, Ask::Speed(20.0), Ask::Disarm].map(|ask| tool::request(1, ask));
    drive.write(&asked.concat());
    drive.neglect();
    assert_eq!(drive.drive().mode(), Mode::Ready);
    // What was asked for before the next one has its turn, and does nothing.
    let asked = [Ask::Arm, Ask::Speed(60.0), Ask::Disarm].map(|ask| tool::request(2, ask));
    drive.write(&asked.concat());
    for _ in 0..50 {
        drive.step();
        assert_eq!(drive.output().legs, Legs::NONE);
    }
    assert_eq!(drive.drive().mode(), Mode::Ready);
    // Half a request is none.
    done(&mut drive, Ask::Arm);
    drive.write(&tool::request(3, Ask::Disarm)[3..]);
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Running);
}

#[test]
fn requests_are_read_though_nobody_takes_the_answers() {
    let memory = Box::leak(Box::new(Memory::new()));
    let identity = Identity { board: "test", firmware: "test", serial: [1, 2, 3] };
    let (_drive, supervisor) = Supervisor::start(identity, defaults(), Flash::blank(), 0, memory).unwrap();
    let status = tool::request(1, Ask::Status);
    while supervisor.receive(&status) > 0 {}
    for now_ms in 0..200 {
        supervisor.tick(now_ms, Readings::default());
    }
    let disarm = tool::request(2, Ask::Disarm);
    assert_eq!(supervisor.receive(&disarm), disarm.len());
}

#[test]
fn the_direction_is_reversed_while_faulted_too() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Arm);
    drive.happen(fault::Kind::Bus(60.0)).unwrap();
    run(&mut drive, 50);
    assert!(matches!(drive.drive().mode(), Mode::Faulted(_)));
    drive.happen(fault::Kind::Bus(24.0)).unwrap();
    run(&mut drive, 50);
    done(&mut drive, Ask::Set { name: "reversed", value: 1.0 });
    run(&mut drive, 10);
    // Without a wait for the answers.
    let asked = [Ask::Clear, Ask::Arm, Ask::Speed(60.0)].map(|ask| tool::request(1, ask));
    drive.write(&asked.concat());
    run(&mut drive, 800);
    let speed = drive.plant.truth().speed_rad_s;
    assert!((speed + 60.0).abs() < 5.0, "{speed}, {:?}", drive.drive().mode());
}

#[test]
fn a_lost_hall_is_not_forgotten_before_a_calibration() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "run_on_two_halls", value: 1.0 });
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(60.0));
    run(&mut drive, 300);
    drive.plant.set_hall_fault(0, Some(HallFault::Open(Rail::Low)));
    run(&mut drive, 300);
    assert_eq!(drive.drive().mode(), Mode::Running);
    done(&mut drive, Ask::Disarm);
    // The wire has contact again.
    drive.plant.set_hall_fault(0, None);
    run(&mut drive, 500);
    let refused = |drive: &mut Simulator, why| {
        ask(drive, Ask::Arm, |answer| assert_eq!(answer, Answer::Refused(Refusal::Drive(why))));
    };
    refused(&mut drive, DriveRefusal::HallLost);
    for value in [1.0, 0.0] {
        done(&mut drive, Ask::Set { name: "reversed", value });
        run(&mut drive, 20);
        refused(&mut drive, DriveRefusal::HallLost);
    }
    // Nor by one that has failed.
    done(&mut drive, Ask::Calibrate);
    run(&mut drive, 50);
    drive.happen(fault::Kind::Bus(60.0)).unwrap();
    run(&mut drive, 50);
    drive.happen(fault::Kind::Bus(24.0)).unwrap();
    run(&mut drive, 50);
    done(&mut drive, Ask::Clear);
    run(&mut drive, 500);
    refused(&mut drive, DriveRefusal::HallLost);
    // Nor by one that was broken off, with a model that is installed then.
    done(&mut drive, Ask::Calibrate);
    run(&mut drive, 50);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 20);
    done(&mut drive, Ask::Set { name: "reversed", value: 1.0 });
    run(&mut drive, 500);
    refused(&mut drive, DriveRefusal::HallLost);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    done(&mut drive, Ask::Arm);
}

#[test]
fn a_tool_of_another_version_is_told_the_drives() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    // COBS of the version after ours and its CRC, which has no zero in it.
    drive.write(&[0, 6, 15, 0x1c, 0xf2, 0xbd, 0x42, 0]);
    run(&mut drive, 10);
    let mut decoder = Decoder::new();
    let hello = drive.read().iter().any(|&byte| {
        let message = decoder.push::<Reply<'_>>(byte);
        matches!(message, Some(Ok(Reply { id: 0, answer: Answer::Hello(hello) })) if hello.board == "simulated")
    });
    assert!(hello);
    assert_eq!(status(&mut drive).garbage, 1);
}

#[test]
fn what_is_off_is_disarmed() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    done(&mut drive, Ask::Disarm);
    assert_eq!(drive.drive().mode(), Mode::Unarmed);
}

#[test]
fn a_motor_whose_tool_has_died_stops() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(100.0));
    run(&mut drive, 900);
    assert!((drive.plant.truth().speed_rad_s - 100.0).abs() < 5.0);
    run(&mut drive, 500);
    assert!(drive.plant.truth().speed_rad_s.abs() < 2.0);
    assert_eq!(hallctl::words::limits(status(&mut drive).limits), ["stopped: no command came for too long"]);
}

#[test]
fn a_calibration_outlives_the_power_and_a_corrupt_one_is_named() {
    let (first, flash) = calibrated();
    drop(first);
    let mut second = drive(Flash::of(flash.clone()));
    run(&mut second, 10);
    assert!(status(&mut second).calibrated);
    done(&mut second, Ask::Arm);
    drop(second);

    let mut broken = flash;
    broken[40] ^= 4;
    let mut third = drive(Flash::of(broken));
    run(&mut third, 10);
    let status = status(&mut third);
    assert_eq!((status.calibrated, status.stored[0], status.incidents), (false, Problem::Corrupt, 1));
    ask(&mut third, Ask::History(0), |answer| match answer {
        Answer::History(history) => {
            let cause = history.entry.map(|incident| incident.cause);
            assert_eq!(cause, Some(Cause::Stored(Record::Sensors, Problem::Corrupt)));
        }
        other => panic!("{other:?}"),
    });
    ask(&mut third, Ask::Arm, |answer| {
        assert_eq!(answer, Answer::Refused(Refusal::Drive(DriveRefusal::NotCalibrated)))
    });
}

#[test]
fn settings_are_saved_while_the_bridge_is_off_only() {
    let (mut first, _) = calibrated();
    let set = Ask::Set { name: "stall_s", value: 2.5 };
    done(&mut first, set);
    done(&mut first, Ask::Arm);
    ask(&mut first, set, |answer| {
        assert!(matches!(answer, Answer::Refused(Refusal::Drive(DriveRefusal::Mode(_)))), "{answer:?}")
    });
    // Not even read: there is nothing, which would be told otherwise.
    ask(&mut first, Ask::Load, |answer| {
        assert!(matches!(answer, Answer::Refused(Refusal::Drive(DriveRefusal::Mode(_)))), "{answer:?}")
    });
    let before = first.flash();
    ask(&mut first, Ask::Save, |answer| assert_eq!(answer, Answer::Saved { waits: true }));
    run(&mut first, 50);
    assert!(first.flash() == before, "written while the bridge was on");
    done(&mut first, Ask::Disarm);
    run(&mut first, 50);
    let flash = first.flash();
    assert!(flash != before && !status(&mut first).unsaved);
    drop(first);

    let mut second = drive(Flash::of(flash));
    run(&mut second, 10);
    ask(&mut second, Ask::Get("stall_s"), |answer| match answer {
        Answer::Setting(setting) => assert_eq!((setting.value, setting.default), (2.5, 0.5)),
        other => panic!("{other:?}"),
    });
    done(&mut second, Ask::Restore);
    ask(&mut second, Ask::Get("stall_s"), |answer| {
        assert!(matches!(answer, Answer::Setting(setting) if setting.value == 0.5));
    });
    done(&mut second, Ask::Load);
    ask(&mut second, Ask::Get("stall_s"), |answer| {
        assert!(matches!(answer, Answer::Setting(setting) if setting.value == 2.5));
    });
}

/// A model a turn, of which there are forty a second, would keep the tasks of a small chip from all else.
#[test]
fn the_drive_is_given_what_is_learnt_once_a_second() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Arm);
    let before = status(&mut drive);
    for _ in 0..50 {
        done(&mut drive, Ask::Speed(60.0));
        run(&mut drive, 100);
    }
    let after = status(&mut drive);
    let (models, ms) = (u64::from(after.learnt - before.learnt), after.uptime_ms - before.uptime_ms);
    assert!((ms / 1000 - 1..=ms / 1000 + 1).contains(&models), "{models} in {ms} ms");
}

#[test]
fn what_is_learnt_is_saved_after_the_next_disarming_and_not_too_often() {
    let (mut first, flash) = calibrated();
    drop(first);
    // The second sensor fades as it warms up, by a tenth in 20 K.
    let mut parameters = PlantParameters::imperfect(1);
    parameters.halls[1].amplitude_drift_k = -0.005;
    first = Simulator::at(&parameters, 1, Flash::of(flash.clone()), Vec::new()).unwrap();
    run(&mut first, 10);
    let mut warm = |to_c: f64, saves: bool| {
        arm(&mut first);
        run(&mut first, 200);
        let before = first.flash();
        for step in 0..150 {
            first.plant.set_temperature(to_c - 20.0 * (1.0 - (f64::from(step) / 100.0).min(1.0))).unwrap();
            done(&mut first, Ask::Speed(60.0));
            run(&mut first, 20);
        }
        let learnt = status(&mut first);
        assert_eq!((learnt.learning, learnt.unsaved), (Learning::On, true));
        assert!(first.flash() == before, "written while the bridge was on");
        done(&mut first, Ask::Disarm);
        run(&mut first, 50);
        assert!(first.flash() == before, "written while the rotor ran out");
        run(&mut first, 2000);
        assert_eq!((first.flash() != before, !status(&mut first).unsaved), (saves, saves));
    };
    warm(45.0, true);
    warm(65.0, false);
    let learnt = first.flash();
    drop(first);
    // After a power-up it begins from what was learnt: nothing is left to be saved.
    parameters.halls[1].amplitude_v *= 0.9;
    parameters.halls[1].amplitude_drift_k = 0.0;
    let mut second = Simulator::at(&parameters, 1, Flash::of(learnt), Vec::new()).unwrap();
    run(&mut second, 10);
    done(&mut second, Ask::Arm);
    for _ in 0..50 {
        done(&mut second, Ask::Speed(60.0));
        run(&mut second, 20);
    }
    assert!(!status(&mut second).unsaved);
}

#[test]
fn the_drive_measures_its_motor_and_balances_its_cogging() {
    let (mut first, _) = calibrated();
    done(&mut first, Ask::Set { name: "resistance_ohm", value: 4.5 });
    done(&mut first, Ask::Identify);
    ask(&mut first, Ask::Arm, |answer| assert!(matches!(answer, Answer::Refused(Refusal::Busy(_))), "{answer:?}"));
    wait(&mut first);
    ask(&mut first, Ask::Identification, |answer| match answer {
        Answer::Identification(Procedure::Done(motor)) => {
            assert!((motor.resistance_ohm.value / 3.77 - 1.0).abs() < 0.1, "{motor:?}");
            assert_eq!(motor.configured.resistance_ohm, 4.5);
        }
        other => panic!("{other:?}"),
    });
    ask(&mut first, Ask::Get("resistance_ohm"), |answer| {
        assert!(matches!(answer, Answer::Setting(setting) if (setting.value / 3.77 - 1.0).abs() < 0.1), "{answer:?}");
    });
    ask(&mut first, Ask::AntiCogging(true), |answer| assert_eq!(answer, Answer::Refused(Refusal::NoTable)));
    done(&mut first, Ask::LearnCogging);
    wait(&mut first);
    assert!(status(&mut first).anti_cogging);
    ask(&mut first, Ask::Cogging, |answer| match answer {
        Answer::Cogging(Procedure::Done(cogging)) => assert!(cogging.rms_a > 0.01, "{cogging:?}"),
        other => panic!("{other:?}"),
    });
    let flash = first.flash();
    drop(first);
    let mut second = drive(Flash::of(flash));
    run(&mut second, 20);
    assert!(status(&mut second).anti_cogging);
    done(&mut second, Ask::AntiCogging(false));
    run(&mut second, 10);
    assert!(!status(&mut second).anti_cogging);
}

#[test]
fn a_procedure_is_ended_by_disarming() {
    let (mut drive, _) = calibrated();
    for procedure in [Ask::Identify, Ask::LearnCogging, Ask::Calibrate] {
        done(&mut drive, procedure);
        run(&mut drive, 300);
        assert!(drive.drive().mode().drives(), "{procedure:?}");
        drive.write(&tool::request(1, Ask::Disarm));
        run(&mut drive, 5);
        assert!(!drive.drive().mode().drives(), "{procedure:?}");
        wait(&mut drive);
        assert!(!drive.drive().mode().drives(), "{procedure:?}");
    }
}

#[test]
fn every_fault_is_in_the_history_with_its_text() {
    let kinds =
        [("hall-open", "end of the ADC"), ("bus-60V", "too high"), ("hot", "too hot"), ("late", "without a step")];
    let flash = calibrated().1;
    for (name, text) in kinds {
        let planned: fault::ScheduledEvent = format!("{name}@0.1s").parse().unwrap();
        let mut drive = Simulator::new(1, Flash::of(flash.clone()), vec![planned]).unwrap();
        run(&mut drive, 10);
        done(&mut drive, Ask::Arm);
        run(&mut drive, 150);
        ask(&mut drive, Ask::History(0), |answer| match answer {
            Answer::History(history) => {
                let (found, _) = hallctl::words::incident(&history.entry.unwrap());
                assert!(found.contains(text), "{name}: {found}");
            }
            other => panic!("{other:?}"),
        });
        assert!(matches!(drive.drive().mode(), Mode::Faulted(_)), "{name}");
    }
}
