//! Bandwidths of the loops changed while the motor turns under load: no jump of the current, whatever is asked for.

use crate::tool::{arm, ask, calibrated, done, drive, run, status};
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Setup, State, Trigger};
use hallservo::settings::Error;
use hallservo_protocol::{Answer, Ask, ROWS_AT_ONCE, Refusal, ScopeAsk, ScopeStatus};
use simulator::Simulator;
use simulator::flash::Flash;
use std::sync::LazyLock;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

/// A third of the largest torque.
const LOAD_NM: f64 = 0.03;
/// Rows before the change, and of the record.
const BEFORE: usize = 256;
const ROWS: usize = 512;

fn running() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    arm(&mut drive);
    drive
}

fn loaded(demand: Ask<'_>) -> Simulator {
    let mut drive = running();
    done(&mut drive, demand);
    run(&mut drive, 200);
    drive.plant.set_load(LOAD_NM).unwrap();
    done(&mut drive, demand);
    run(&mut drive, 500);
    assert_eq!(drive.drive().mode(), Mode::Running);
    drive
}

fn set(drive: &mut Simulator, name: &str, value: f32) {
    done(drive, Ask::Set { name, value });
}

/// The current's reference about a command, a row for each period.
fn currents_about(drive: &mut Simulator, command: impl FnOnce(&mut Simulator)) -> Vec<f64> {
    let channels = [Some(Channel::ReferenceQ), None, None, None];
    let (before, rows) = (BEFORE as u16, ROWS as u16);
    let setup = Setup { channels, every: 1, rows, before, trigger: Trigger::Command };
    done(drive, Ask::Scope(ScopeAsk::End));
    done(drive, Ask::Scope(ScopeAsk::Begin { id: 1, setup }));
    run(drive, 10);
    command(drive);
    let status = |drive: &mut Simulator| {
        ask(drive, Ask::Scope(ScopeAsk::Status), |answer| match answer {
            Answer::Scope(status) => status,
            other => panic!("{other:?}"),
        })
    };
    while status(drive).state != State::Done {}
    let ScopeStatus { scales, .. } = status(drive);
    let mut raw = Vec::new();
    for first in (0..rows).step_by(ROWS_AT_ONCE) {
        ask(drive, Ask::Scope(ScopeAsk::Rows { id: 1, first }), |answer| match answer {
            Answer::ScopeRows(rows) => raw.extend(rows.rows.map(|row| row[0])),
            other => panic!("{other:?}"),
        });
    }
    raw[..ROWS].iter().map(|raw| f64::from(*raw) * f64::from(scales[0])).collect()
}

/// Largest change from one step of the outer loops to the next.
fn largest_step(currents: &[f64]) -> f64 {
    currents.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
}

/// The loops are faster and slower by four, and the current does not jump by more than it does by itself: its noise is
/// that of the bandwidth before or after.
#[test]
fn the_current_does_not_jump() {
    let demands = [Ask::Speed(60.0), Ask::Speed(-150.0), Ask::Torque(0.045), Ask::Position(1.0)];
    for demand in demands {
        let mut drive = loaded(demand);
        for (name, values) in [
            ("speed_bandwidth_hz", [30.0, 120.0, 60.0]),
            ("position_bandwidth_hz", [4.0, 16.0, 15.0]),
            ("current_bandwidth_hz", [500.0, 2000.0, 1000.0]),
            ("tracking_bandwidth_hz", [140.0, 560.0, 280.0]),
        ] {
            for value in values {
                let currents = currents_about(&mut drive, |drive| set(drive, name, value));
                // The change is carried out within the first steps after the trigger.
                let step = largest_step(&currents[BEFORE - 1..BEFORE + 64]);
                let [before, after] = [&currents[..BEFORE], &currents[BEFORE + 64..]].map(largest_step);
                // The noise differs over an electrical turn, of which a record is half: the same value changes nothing.
                let again =
                    [(); 2].map(|()| largest_step(&currents_about(&mut drive, |drive| set(drive, name, value))));
                let usual = again.into_iter().fold(before.max(after), f64::max);
                println!("{demand:?} {name} {value}: {step:.4} A; usual {usual:.4} A");
                assert!(step < 2.0 * usual + 0.02, "{demand:?} {name} {value}: {step} A, usual {usual} A");
            }
        }
        assert_eq!(drive.drive().mode(), Mode::Running);
    }
}

/// To the limits and back every 10 ms: the motor goes on turning.
#[test]
fn hostile_changes_do_not_stop_the_motor() {
    let mut drive = loaded(Ask::Speed(60.0));
    let changes = [
        ("position_bandwidth_hz", [30.0, 0.1]),
        ("speed_bandwidth_hz", [0.5, 120.0]),
        ("current_bandwidth_hz", [500.0, 2000.0]),
    ];
    for (name, values) in changes {
        let (mut least, mut most) = (f32::MAX, f32::MIN);
        for k in 0..200 {
            set(&mut drive, name, values[k % 2]);
            run(&mut drive, 8);
            let status = status(&mut drive);
            assert_eq!(status.mode, Mode::Running, "{name} {k}");
            (least, most) = (least.min(status.speed_rad_s), most.max(status.speed_rad_s));
        }
        println!("{name}: {least} to {most} rad/s");
        assert!(least > 44.0 && most < 76.0, "{name}: {least} to {most} rad/s");
        set(&mut drive, name, values[1]);
    }
}

/// A tracker that is as slow as it may be leaves the loops without a speed: whatever comes of that is within the limits.
#[test]
fn a_hostile_tracker_is_within_the_limits() {
    let mut drive = loaded(Ask::Speed(60.0));
    for k in 0..200 {
        set(&mut drive, "tracking_bandwidth_hz", [5.0, 5000.0][k % 2]);
        for _ in 0..8 {
            drive.step();
            let (mode, state) = (drive.drive().mode(), drive.drive().state());
            assert!(matches!(mode, Mode::Running | Mode::Faulted(_)), "{mode:?}");
            // 3 A of 8.25 A.
            assert!(state.current_reference.abs() <= 11_916, "{k}: {state:?}");
        }
    }
    println!("{:?}", drive.drive().mode());
}

#[test]
fn what_is_out_of_range_is_refused_and_changes_nothing() {
    let mut drives = [loaded(Ask::Speed(60.0)), loaded(Ask::Speed(60.0))];
    let wrong = [
        ("speed_bandwidth_hz", f32::NAN),
        ("speed_bandwidth_hz", 0.49),
        ("speed_bandwidth_hz", 251.0),
        ("position_bandwidth_hz", 30.1),
        ("position_bandwidth_hz", -1.0),
        ("current_bandwidth_hz", 239.0),
        ("current_bandwidth_hz", f32::INFINITY),
        ("current_bandwidth_hz", 2001.0),
        ("tracking_bandwidth_hz", 4.0),
        ("tracking_bandwidth_hz", f32::NEG_INFINITY),
    ];
    for (name, value) in wrong {
        for (asks, drive) in drives.iter_mut().enumerate() {
            let what = if asks == 0 { Ask::Set { name, value } } else { Ask::Get(name) };
            ask(drive, what, |answer| match answer {
                Answer::Refused(Refusal::Setting(Error::OutOfRange { .. })) if asks == 0 => {}
                Answer::Setting(_) if asks == 1 => {}
                other => panic!("{name} {value}: {other:?}"),
            });
        }
    }
    drives.iter_mut().for_each(|drive| run(drive, 300));
    let [mut asked, other] = drives;
    assert_eq!(asked.drive().mode(), Mode::Running);
    assert_eq!(asked.digest(), other.digest());
    // What is no bandwidth is refused as ever.
    ask(&mut asked, Ask::Set { name: "max_current_a", value: 1.0 }, |answer| {
        assert!(matches!(answer, Answer::Refused(Refusal::Drive(_))), "{answer:?}");
    });
}

/// The speed follows faster with a larger bandwidth that was set while turning.
#[test]
fn a_change_while_turning_is_in_effect() {
    let mut drive = loaded(Ask::Speed(60.0));
    let dip = |drive: &mut Simulator| {
        drive.plant.set_load(LOAD_NM).unwrap();
        run(drive, 400);
        done(drive, Ask::Speed(60.0));
        run(drive, 400);
        drive.plant.set_load(0.0).unwrap();
        let most = (0..100).map(|_| status(drive).speed_rad_s).fold(f32::MIN, f32::max);
        done(drive, Ask::Speed(60.0));
        most - 60.0
    };
    let before = dip(&mut drive);
    set(&mut drive, "speed_bandwidth_hz", 30.0);
    let slower = dip(&mut drive);
    set(&mut drive, "speed_bandwidth_hz", 120.0);
    let faster = dip(&mut drive);
    println!("{slower} {before} {faster} rad/s");
    assert!(slower > 1.5 * before && faster < 0.85 * before, "{slower} {before} {faster}");
}
