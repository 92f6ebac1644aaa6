//! What goes wrong while a procedure turns the motor: it always ends, with the bridge off, and says why.

use hallservo::commutation::Commutation;
use hallservo::control::cogging::Table;
use hallservo::drive::{Command, Refusal};
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::service::identification::{self, Identification};
use hallservo::service::learning::{self, Learning};
use hallservo::service::procedure::{Error, Procedure, Serve, State};
use hallservo::service::swings::Swings;
use hallservo::settings::Settings;
use hallservo::settings::{Control, GuardSettings};
use plant::PlantParameters;
use rig::Rig;

fn settings() -> Settings {
    Settings { control: Some(Control::default()), ..Settings::default() }
}

fn rig(settings: &Settings) -> Rig {
    let mut rig = Rig::new(&PlantParameters::imperfect(1), settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    // The field has let go of a turning rotor.
    rig.wait(0.5);
    for _ in 0..2 {
        assert!(rig.service.add_table(Box::leak(Box::new(Table::ZERO))).is_none());
    }
    rig
}

fn both(rig: &Rig) -> [Box<dyn Procedure>; 2] {
    let identification = identification::Plan::new(&rig.config).unwrap();
    let learning = learning::Plan::new(&rig.config).unwrap();
    [
        Box::new(Identification::new(&rig.config, &identification).unwrap()),
        Box::new(Learning::new(&rig.config, &learning).unwrap()),
    ]
}

/// Runs until the end, at most a minute; `meddle` hears the milliseconds. The end, and how long it took.
fn run(
    rig: &mut Rig,
    procedure: &mut dyn Procedure,
    mut meddle: impl FnMut(&mut Rig, &mut dyn Procedure, u32),
) -> (State, u32) {
    let mut progress = 0.0;
    for ms in 0..60_000_u32 {
        meddle(rig, procedure, ms);
        // A clock that wraps on the way.
        let state = procedure.serve(&mut rig.service, ms.wrapping_sub(1500));
        assert!(procedure.progress() >= progress && procedure.progress() <= 1.0);
        progress = procedure.progress();
        if state != State::Running {
            assert_eq!(procedure.serve(&mut rig.service, ms.wrapping_sub(1499)), state, "an end is the end");
            return (state, ms);
        }
        for _ in 0..40 {
            rig.step();
        }
    }
    panic!("stuck at {progress}");
}

fn ready(rig: &Rig) -> bool {
    (rig.drive.mode(), rig.drive.commutation()) == (Mode::Ready, Commutation::Sinusoidal)
}

#[test]
fn undisturbed_they_come_to_their_end_at_rest_and_as_the_drive_was() {
    let mut rig = rig(&settings());
    for mut procedure in both(&rig) {
        let (state, ms) = run(&mut rig, procedure.as_mut(), |_, _, _| ());
        println!("{ms} ms");
        assert_eq!((state, procedure.progress()), (State::Done, 1.0));
        procedure.cancel();
        assert_eq!(procedure.serve(&mut rig.service, ms), State::Done);
        assert!(ready(&rig) && rig.plant.truth().speed_rad_s.abs() < 1.0);
    }
}

#[test]
fn a_fault_ends_them_and_is_named() {
    let mut rig = rig(&settings());
    for mut procedure in both(&rig) {
        let (state, ms) = run(&mut rig, procedure.as_mut(), |rig, _, ms| {
            if ms == 2000 {
                rig.disturb = Some(Box::new(|sample| sample.bus = 4000));
            }
        });
        assert_eq!(state, State::Failed(Error::Fault(Fault::OverVoltage)));
        assert!(ms < 2050, "{ms}");
        assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::OverVoltage));
        assert_eq!(rig.drive.commutation(), Commutation::Sinusoidal);
        rig.disturb = None;
        // Not cleared: refused at once.
        for mut again in both(&rig) {
            let refusal = Refusal::Mode(Mode::Faulted(Fault::OverVoltage));
            assert_eq!(run(&mut rig, again.as_mut(), |_, _, _| ()).0, State::Failed(Error::Refused(refusal)));
        }
        rig.command(Command::Clear).unwrap();
        rig.plant.set_dyno(Some(0.0)).unwrap();
        rig.wait(0.05);
        rig.plant.set_dyno(None).unwrap();
    }
}

#[test]
fn a_refusal_ends_them_and_leaves_the_drive_as_it_was() {
    let mut uncalibrated = Rig::new(&PlantParameters::imperfect(1), &settings(), 1).unwrap();
    for mut procedure in both(&uncalibrated) {
        let state = run(&mut uncalibrated, procedure.as_mut(), |_, _, _| ()).0;
        assert_eq!(state, State::Failed(Error::Refused(Refusal::NotCalibrated)));
        assert_eq!(
            (uncalibrated.drive.mode(), uncalibrated.drive.commutation()),
            (Mode::Unarmed, Commutation::Sinusoidal)
        );
    }
    let mut rig = rig(&settings());
    rig.command(Command::Arm).unwrap();
    for mut procedure in both(&rig) {
        let state = run(&mut rig, procedure.as_mut(), |_, _, _| ()).0;
        assert_eq!(state, State::Failed(Error::Refused(Refusal::Mode(Mode::Running))));
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
}

#[test]
fn somebody_may_switch_the_bridge_off() {
    let mut rig = rig(&settings());
    for mut procedure in both(&rig) {
        let state = run(&mut rig, procedure.as_mut(), |rig, _, ms| {
            if ms == 1234 {
                rig.service.send(Command::Disarm).unwrap();
            }
        })
        .0;
        assert_eq!(state, State::Failed(Error::Disarmed));
        assert!(ready(&rig));
        rig.wait(1.0);
    }
}

/// Whose drive answers is not called silent for it.
#[test]
fn somebody_may_switch_the_bridge_off_during_the_check_at_arming() {
    for k in 0..2 {
        let mut rig = rig(&settings());
        let mut procedure = both(&rig).into_iter().nth(k).unwrap();
        let mut checked = false;
        let state = run(&mut rig, procedure.as_mut(), |rig, _, _| {
            if !checked && rig.drive.limits().contains(Limits::CHECKING) {
                checked = true;
                rig.service.send(Command::Disarm).unwrap();
            }
        })
        .0;
        assert!(checked);
        assert_eq!(state, State::Failed(Error::Disarmed));
        assert!(ready(&rig));
    }
}

#[test]
fn a_drive_that_stops_to_answer_is_told() {
    for after_ms in [0, 1, 5, 1000] {
        for k in 0..2 {
            let mut rig = rig(&settings());
            let mut procedure = both(&rig).into_iter().nth(k).unwrap();
            let mut state = State::Running;
            for ms in 0..after_ms + 300 {
                state = procedure.serve(&mut rig.service, ms);
                for _ in 0..if ms < after_ms { 40 } else { 0 } {
                    rig.step();
                }
            }
            assert_eq!(state, State::Failed(Error::NoAnswer));
            // Should it come to itself, it finds that it is to switch off.
            rig.wait(0.01);
            assert!(!rig.drive.mode().drives());
        }
    }
}

#[test]
fn a_blocked_rotor_ends_in_time() {
    let mut rig = rig(&settings());
    for mut procedure in both(&rig) {
        rig.plant.set_dyno(Some(0.0)).unwrap();
        let (state, ms) = run(&mut rig, procedure.as_mut(), |_, _, _| ());
        // The drive finds a stall by itself when the current is at its limit.
        assert!(matches!(state, State::Failed(Error::NotReached | Error::Fault(Fault::Stall))), "{state:?}");
        assert!(ms < 15_000, "{ms}");
        assert!(!rig.drive.mode().drives());
        rig.plant.set_dyno(None).unwrap();
        if rig.drive.mode() != Mode::Ready {
            rig.command(Command::Clear).unwrap();
        }
    }
}

/// Nor do the swings of commissioning go on for as long as with a heavy rotor.
#[test]
fn a_blocked_rotor_ends_the_swings_in_time() {
    for seed in 1..sim::of(3, 9) {
        let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings(), seed).unwrap();
        rig.calibrate(|_| ()).unwrap();
        rig.wait(0.5);
        rig.plant.set_dyno(Some(0.0)).unwrap();
        let mut swings = Swings::new(&rig.config).unwrap();
        let (state, ms) = run(&mut rig, &mut swings, |_, _, _| ());
        println!("{seed}: {state:?} after {ms} ms");
        assert!(state != State::Done && ms < 20_000, "{seed}: {state:?} after {ms} ms");
        assert!(!rig.drive.mode().drives());
    }
}

#[test]
fn cancelling_brakes_first() {
    for at_ms in [0, 1, 3, 700, 3000] {
        let mut rig = rig(&settings());
        for mut procedure in both(&rig) {
            let (state, ms) = run(&mut rig, procedure.as_mut(), |_, procedure, ms| {
                if ms == at_ms {
                    procedure.cancel();
                }
            });
            assert_eq!(state, State::Failed(Error::Cancelled));
            assert!(ms < at_ms + 500, "{ms}");
            assert!(
                ready(&rig) && rig.plant.truth().speed_rad_s.abs() < 2.0,
                "{at_ms} {:?}",
                rig.plant.truth().speed_rad_s
            );
        }
    }
}

#[test]
fn commands_that_must_keep_coming_do() {
    let guard = GuardSettings { command_timeout_s: 0.01, ..GuardSettings::default() };
    let control = Control { guard, ..Control::default() };
    let mut rig = rig(&Settings { control: Some(control), ..settings() });
    for mut procedure in both(&rig) {
        assert_eq!(run(&mut rig, procedure.as_mut(), |_, _, _| ()).0, State::Done);
    }
}

#[test]
fn too_few_records_for_all_points_are_told() {
    let mut rig = rig(&Settings { record_hz: 100.0, ..settings() });
    let [_, mut learning] = both(&rig);
    assert_eq!(run(&mut rig, learning.as_mut(), |_, _, _| ()).0, State::Failed(Error::Inconclusive));
}

#[test]
fn tables_must_be_lent() {
    let mut rig = Rig::new(&PlantParameters::imperfect(1), &settings(), 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    let [_, mut learning] = both(&rig);
    assert_eq!(run(&mut rig, learning.as_mut(), |_, _, _| ()).0, State::Failed(Error::NoTable));
    assert!(ready(&rig));
}

#[test]
fn what_cannot_be_is_refused_before_anything_turns() {
    let voltage = Settings::default().validate().unwrap();
    assert_eq!(identification::Plan::new(&voltage).err(), Some(Error::NoControl));
    assert_eq!(learning::Plan::new(&voltage).err(), Some(Error::NoControl));
    let config = settings().validate().unwrap();
    let slow = Settings { record_hz: 95.0, ..settings() }.validate().unwrap();
    let plan = identification::Plan::new(&config).unwrap();
    assert_eq!(Identification::new(&slow, &plan).err(), Some(Error::FewRecords));
    assert_eq!(Identification::new(&voltage, &plan).err(), Some(Error::NoControl));
    for (field, bad) in [
        ("speed_rad_s", identification::Plan { speed_rad_s: f32::NAN, ..plan }),
        ("current_a", identification::Plan { current_a: 0.0, ..plan }),
    ] {
        assert_eq!(Identification::new(&config, &bad).err(), Some(Error::Plan { field }));
    }
    let fast = identification::Plan { speed_rad_s: 1e4, ..plan };
    assert!(matches!(Identification::new(&config, &fast), Err(Error::Demand(_))));
    let plan = learning::Plan::new(&config).unwrap();
    for (field, bad) in [
        ("speed_rad_s", learning::Plan { speed_rad_s: -1.0, ..plan }),
        ("turns", learning::Plan { turns: 0, ..plan }),
        ("passes", learning::Plan { passes: 5, ..plan }),
        ("harmonics", learning::Plan { harmonics: 64, ..plan }),
    ] {
        assert_eq!(Learning::new(&config, &bad).err(), Some(Error::Plan { field }));
    }
}
