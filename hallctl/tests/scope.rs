//! The scope: what it records about a trigger, whose it is, and that the drive does not notice.

use crate::tool::{arm, ask, ask_as, calibrated, done, drive, run};
use hallctl::scope::Recording;
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Error, ROWS, Setup, State, Trigger};
use hallservo_protocol::{Answer, Ask, ROWS_AT_ONCE, Refusal, ScopeAsk, ScopeRefusal, ScopeStatus};
use simulator::Simulator;
use simulator::fault::Kind;
use simulator::flash::Flash;
use std::sync::LazyLock;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

const ID: u32 = 0xfeed_beef;
const SETUP: Setup = Setup {
    channels: [Some(Channel::CurrentQ), Some(Channel::Speed), Some(Channel::Angle), Some(Channel::Position)],
    every: 1,
    rows: ROWS as u16,
    before: 128,
    trigger: Trigger::Now,
};
/// Periods a second of the simulated drive.
const STEP_HZ: f64 = 40e3;

fn ready() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    drive
}

/// Armed, checked, and turning at a speed.
fn turning(rad_s: f32) -> Simulator {
    let mut drive = ready();
    arm(&mut drive);
    done(&mut drive, Ask::Speed(rad_s));
    run(&mut drive, 300);
    drive
}

fn begin(drive: &mut Simulator, setup: Setup) {
    done(drive, Ask::Scope(ScopeAsk::Begin { id: ID, setup }));
}

fn refused(drive: &mut Simulator, client: u32, what: ScopeAsk, why: ScopeRefusal) {
    ask_as(client, drive, Ask::Scope(what), |answer| {
        assert_eq!(answer, Answer::Refused(Refusal::Scope(why)), "{what:?}");
    });
}

fn status(drive: &mut Simulator) -> ScopeStatus {
    ask(drive, Ask::Scope(ScopeAsk::Status), |answer| match answer {
        Answer::Scope(status) => status,
        other => panic!("{other:?}"),
    })
}

/// Waits until it is complete, and reads it out by another tool.
fn read(drive: &mut Simulator) -> Recording {
    while status(drive).state != State::Done {
        assert_ne!(status(drive).state, State::None);
    }
    let ScopeStatus { setup, scales, id, .. } = status(drive);
    let (setup, mut rows) = (setup.unwrap(), Vec::new());
    for first in (0..setup.rows).step_by(ROWS_AT_ONCE) {
        let some = ask_as(2, drive, Ask::Scope(ScopeAsk::Rows { id, first }), |answer| match answer {
            Answer::ScopeRows(rows) => rows,
            other => panic!("{other:?}"),
        });
        assert_eq!((some.id, some.first), (ID, first));
        rows.extend(some.rows);
    }
    assert!(rows.drain(usize::from(setup.rows)..).all(|row| row == [0; 4]));
    Recording::new(&setup, &scales, &rows, STEP_HZ)
}

#[test]
fn every_period_is_recorded_as_it_was() {
    let mut drive = turning(60.0);
    begin(&mut drive, SETUP);
    let recording = read(&mut drive);
    assert_eq!((recording.time_s.len(), recording.time_s[0]), (ROWS, 0.0));
    let (angles, speeds) = (recording.of(Channel::Angle), recording.of(Channel::Speed));
    for (k, pair) in angles.windows(2).enumerate() {
        let moved = (pair[1] - pair[0] + 540.0).rem_euclid(360.0) - 180.0;
        // Four pole pairs; the tracked angle and its speed.
        let expected = 4.0 * speeds[k].to_degrees() / STEP_HZ;
        assert!((moved - expected).abs() < 0.2, "{k}: {moved} {expected}");
    }
    let positions = recording.of(Channel::Position);
    let turned = positions[ROWS - 1] - positions[0];
    let expected = speeds.iter().sum::<f64>() / STEP_HZ / std::f64::consts::TAU;
    assert!((turned - expected).abs() < 2e-3, "{turned} {expected}");
    assert!(speeds.iter().all(|speed| (speed - 60.0).abs() < 5.0), "{speeds:?}");
}

#[test]
fn currents_duties_and_halls_are_those_of_the_step() {
    let mut drive = turning(60.0);
    let channels = [Channel::PhaseA, Channel::PhaseB, Channel::PhaseC, Channel::DutyA].map(Some);
    begin(&mut drive, Setup { channels, ..SETUP });
    let currents = read(&mut drive);
    for row in 0..ROWS {
        let sum: f64 = (0..3).map(|phase| currents.values[phase][row]).sum();
        // Kirchhoff, but for the noise of three amplifiers.
        assert!(sum.abs() < 0.2, "{sum}");
        assert!((0.0..=1.0).contains(&currents.values[3][row]));
    }
    let channels = [Channel::Hall1, Channel::Bus, Channel::ReferenceQ, Channel::VoltageQ].map(Some);
    begin(&mut drive, Setup { channels, ..SETUP });
    // The same number again is the same recording.
    assert_eq!(read(&mut drive).channels, currents.channels);
    done(&mut drive, Ask::Scope(ScopeAsk::End));
    begin(&mut drive, Setup { channels, ..SETUP });
    let others = read(&mut drive);
    assert!(others.of(Channel::Hall1).iter().all(|code| (1000.0..3000.0).contains(code)));
    assert!(others.of(Channel::Bus).iter().all(|volts| (volts - 24.0).abs() < 1.0));
    // 60 rad/s · 4 · 5 mWb, and what the current takes.
    let mean = others.of(Channel::VoltageQ).iter().sum::<f64>() / ROWS as f64;
    assert!((0.8..3.0).contains(&mean), "{mean}");
}

#[test]
fn a_level_is_crossed_where_the_trigger_is() {
    let mut drive = turning(40.0);
    for (level, target, rising) in [(50.0, 60.0, true), (30.0, 20.0, false)] {
        let trigger = Trigger::Level { channel: Channel::Speed, level, rising };
        begin(&mut drive, Setup { every: 4, trigger, ..SETUP });
        run(&mut drive, 60);
        assert_eq!(status(&mut drive).state, State::Waiting);
        done(&mut drive, Ask::Speed(target));
        let recording = read(&mut drive);
        let speeds = recording.of(Channel::Speed);
        let (before, after) = (speeds[127] - f64::from(level), speeds[128] - f64::from(level));
        let way = if rising { 1.0 } else { -1.0 };
        assert!(way * before < 0.0 && way * after >= 0.0, "{before} {after}");
        assert_eq!(recording.time_s[128], 0.0);
        done(&mut drive, Ask::Speed(40.0));
        run(&mut drive, 300);
        done(&mut drive, Ask::Scope(ScopeAsk::End));
    }
}

#[test]
fn a_command_and_a_fault_are_triggers() {
    let mut drive = turning(40.0);
    begin(&mut drive, Setup { trigger: Trigger::Command, ..SETUP });
    run(&mut drive, 50);
    assert_eq!(status(&mut drive).state, State::Waiting);
    done(&mut drive, Ask::Torque(0.03));
    let currents = read(&mut drive);
    let mean = |rows: &[f64]| rows.iter().sum::<f64>() / rows.len() as f64;
    let current = currents.of(Channel::CurrentQ);
    assert!(mean(&current[384..]) > mean(&current[..128]) + 0.5, "{current:?}");
    done(&mut drive, Ask::Scope(ScopeAsk::End));
    begin(&mut drive, Setup { trigger: Trigger::Fault, before: 500, ..SETUP });
    run(&mut drive, 50);
    assert_eq!(status(&mut drive).state, State::Waiting);
    drive.happen(Kind::Bus(60.0)).unwrap();
    run(&mut drive, 20);
    assert!(matches!(drive.drive().mode(), Mode::Faulted(_)));
    assert_eq!(status(&mut drive).state, State::Done);
    // What is faulted already is no trigger.
    done(&mut drive, Ask::Scope(ScopeAsk::End));
    begin(&mut drive, Setup { trigger: Trigger::Fault, before: 0, ..SETUP });
    run(&mut drive, 50);
    assert_eq!(status(&mut drive).state, State::Waiting);
}

#[test]
fn what_cannot_be_recorded_is_refused_and_leaves_the_recording_before() {
    let mut drive = ready();
    begin(&mut drive, SETUP);
    let before = read(&mut drive);
    let level = |level| Trigger::Level { channel: Channel::CurrentQ, level, rising: true };
    let [i_q, ..] = SETUP.channels;
    let wrong = [
        (Setup { channels: [None; 4], ..SETUP }, Error::Empty),
        (Setup { channels: [None, i_q, None, i_q], ..SETUP }, Error::Twice(Channel::CurrentQ)),
        (Setup { every: 0, ..SETUP }, Error::Every),
        (Setup { rows: 0, before: 0, ..SETUP }, Error::Rows(ROWS as u16)),
        (Setup { rows: 513, ..SETUP }, Error::Rows(ROWS as u16)),
        (Setup { before: 512, ..SETUP }, Error::Before),
        (Setup { before: u16::MAX, ..SETUP }, Error::Before),
        (Setup { trigger: level(f32::NAN), ..SETUP }, Error::Level(33.0)),
        (Setup { trigger: level(f32::INFINITY), ..SETUP }, Error::Level(33.0)),
        (Setup { trigger: level(-34.0), ..SETUP }, Error::Level(33.0)),
    ];
    for (setup, why) in wrong {
        refused(&mut drive, 1, ScopeAsk::Begin { id: 7, setup }, ScopeRefusal::Setup(why));
    }
    assert_eq!(read(&mut drive), before);
    for (id, first) in [(ID + 1, 0), (0, 0)] {
        refused(&mut drive, 1, ScopeAsk::Rows { id, first }, ScopeRefusal::Gone);
    }
    // Beyond the end there is nothing.
    ask(&mut drive, Ask::Scope(ScopeAsk::Rows { id: ID, first: u16::MAX }), |answer| {
        assert!(matches!(answer, Answer::ScopeRows(rows) if rows.rows == [[0; 4]; ROWS_AT_ONCE]), "{answer:?}");
    });
}

#[test]
fn a_recording_is_its_tools_until_that_is_gone() {
    let mut drive = ready();
    // Nothing crosses this.
    let trigger = Trigger::Level { channel: Channel::Bus, level: 30.0, rising: true };
    begin(&mut drive, Setup { trigger, ..SETUP });
    run(&mut drive, 500);
    let second = ScopeAsk::Begin { id: 9, setup: SETUP };
    refused(&mut drive, 2, second, ScopeRefusal::Busy);
    refused(&mut drive, 2, ScopeAsk::End, ScopeRefusal::Busy);
    refused(&mut drive, 2, ScopeAsk::Rows { id: ID, first: 0 }, ScopeRefusal::Gone);
    // Its own tool ends it, and may begin anew at once, also without ending it.
    done(&mut drive, Ask::Scope(ScopeAsk::End));
    assert_eq!(status(&mut drive).client, 0);
    refused(&mut drive, 1, ScopeAsk::Rows { id: ID, first: 0 }, ScopeRefusal::Gone);
    begin(&mut drive, Setup { trigger, ..SETUP });
    done(&mut drive, Ask::Scope(ScopeAsk::Begin { id: 8, setup: Setup { trigger, ..SETUP } }));
    begin(&mut drive, SETUP);
    assert_eq!(read(&mut drive).time_s.len(), ROWS);
    // Another tool may read it, and has it two seconds after the last question of the first.
    refused(&mut drive, 2, second, ScopeRefusal::Busy);
    run(&mut drive, 2010);
    ask_as(2, &mut drive, Ask::Scope(second), |answer| assert_eq!(answer, Answer::Done));
    refused(&mut drive, 1, ScopeAsk::Rows { id: ID, first: 0 }, ScopeRefusal::Gone);
    refused(&mut drive, 1, ScopeAsk::End, ScopeRefusal::Busy);
}

#[test]
fn after_a_reset_there_is_no_recording() {
    let mut drive = ready();
    begin(&mut drive, SETUP);
    read(&mut drive);
    let mut drive = ready();
    assert_eq!(status(&mut drive).state, State::None);
    refused(&mut drive, 1, ScopeAsk::Rows { id: ID, first: 11 }, ScopeRefusal::Gone);
    // One that another tool has begun since is not taken for it.
    ask_as(2, &mut drive, Ask::Scope(ScopeAsk::Begin { id: 9, setup: SETUP }), |answer| {
        assert_eq!(answer, Answer::Done);
    });
    run(&mut drive, 30);
    refused(&mut drive, 1, ScopeAsk::Rows { id: ID, first: 11 }, ScopeRefusal::Gone);
}

#[test]
fn the_drive_does_not_notice() {
    let mut drives = [turning(40.0), turning(40.0)];
    let other = Setup { trigger: Trigger::Command, ..SETUP };
    for (drive, asks) in drives.iter_mut().zip([[SETUP, other].map(Some), [None; 2]]) {
        for setup in asks {
            let ask = setup.map_or(Ask::Status, |setup| Ask::Scope(ScopeAsk::Begin { id: ID, setup }));
            done(drive, ask);
            run(drive, 50);
            done(drive, Ask::Speed(60.0));
            run(drive, 50);
        }
    }
    let [recorded, plain] = drives;
    assert_eq!(recorded.digest(), plain.digest());
}
