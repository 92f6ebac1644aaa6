//! What turns the rotor is over when the rotor is at rest and the result is final, not before; and never takes for
//! ever.

use crate::tool::{ask, begin, calibrated, done, drive, run, status, wait};
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Answer, Ask, Calibration, Problem, Procedure, Refusal, Status};
use plant::{Cogging, Friction, HallFault, PlantParameters, Rail};
use simulator::Simulator;
use simulator::flash::Flash;

/// Longest wait beyond what a procedure itself takes, ms, and what looks at it add.
const LONGEST_MS: u64 = 5000 + 10;

fn refused(drive: &mut Simulator, what: Ask<'_>) {
    ask(drive, what, |answer| assert!(matches!(answer, Answer::Refused(Refusal::Busy(_))), "{what:?}: {answer:?}"));
}

/// Lets time pass until the bridge is off and the drive knows its angle, which is when the wait begins.
fn swept(drive: &mut Simulator) -> Status {
    begin(drive, Ask::Calibrate);
    for _ in 0..20_000 {
        drive.step();
        if drive.drive().mode() == Mode::Ready {
            return status(drive);
        }
    }
    panic!("it calibrates on and on");
}

/// Waits, and says for how long.
fn waited_ms(drive: &mut Simulator) -> u64 {
    let began = status(drive);
    assert_ne!(began.activity, Activity::None);
    wait(drive);
    status(drive).uptime_ms - began.uptime_ms
}

/// What the shaft turns by within a second, degrees.
fn drift_deg(drive: &mut Simulator) -> f64 {
    let angle_deg = |drive: &Simulator| drive.plant.truth().mechanical_angle_rad.to_degrees();
    let before = angle_deg(drive);
    run(drive, 1000);
    (angle_deg(drive) - before).abs()
}

#[test]
fn every_procedure_leaves_the_rotor_at_rest() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    for procedure in [Ask::Calibrate, Ask::Swing, Ask::Identify, Ask::LearnCogging] {
        done(&mut drive, procedure);
        wait(&mut drive);
        let status = status(&mut drive);
        let learnt = procedure == Ask::LearnCogging;
        let stored = [Problem::None, if learnt { Problem::None } else { Problem::Blank }];
        assert!(status.calibrated && status.stored[..2] == stored, "{procedure:?}: {status:?}");
        assert_eq!(status.anti_cogging, learnt);
        // At four pole pairs the wait allows 2.5° in 200 ms, from where friction stops it at once.
        let drift_deg = drift_deg(&mut drive);
        assert!(drift_deg < 0.5, "{procedure:?}: {drift_deg}°");
        done(&mut drive, Ask::Arm);
        done(&mut drive, Ask::Disarm);
    }
}

#[test]
fn a_result_is_told_when_it_is_final() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    let coasting = swept(&mut drive);
    assert!(coasting.speed_rad_s.abs() > 2.0 && coasting.activity == Activity::Calibration, "{coasting:?}");
    assert_eq!(coasting.progress, 1.0);
    ask(&mut drive, Ask::Calibration, |answer| assert_eq!(answer, Answer::Calibration(Calibration::Running)));
    for what in [Ask::Arm, Ask::Calibrate, Ask::Identify, Ask::Set { name: "pole_pairs", value: 7.0 }] {
        refused(&mut drive, what);
    }
    wait(&mut drive);
    ask(&mut drive, Ask::Calibration, |answer| assert!(matches!(answer, Answer::Calibration(Calibration::Done(_)))));
    // A procedure is over as soon as it is told so.
    done(&mut drive, Ask::Identify);
    for _ in 0..20_000 {
        let over = status(&mut drive).activity == Activity::None;
        let told =
            ask(&mut drive, Ask::Identification, |answer| matches!(answer, Answer::Identification(Procedure::Done(_))));
        assert!(told || !over);
        if over {
            return;
        }
    }
    panic!("it goes on and on");
}

#[test]
fn a_heavy_rotor_without_friction_is_not_waited_for_for_ever() {
    let mut parameters = PlantParameters::imperfect(1);
    // It would turn for half a minute.
    parameters.motor.friction = Friction { viscous_nms: 1e-6, ..Friction::NONE };
    parameters.motor.cogging = [Cogging::NONE; 2];
    parameters.motor.inertia_kgm2 *= 3.0;
    let mut drive = Simulator::at(&parameters, 1, Flash::blank(), Vec::new()).unwrap();
    run(&mut drive, 10);
    swept(&mut drive);
    let waited = waited_ms(&mut drive);
    assert!((4900..LONGEST_MS + 50).contains(&waited), "{waited} ms");
    let status = status(&mut drive);
    assert!(status.calibrated && status.speed_rad_s.abs() > 1.0, "{status:?}");
    done(&mut drive, Ask::Arm);
}

#[test]
fn a_hand_that_turns_the_shaft_makes_it_longer() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    swept(&mut drive);
    drive.turn_by_hand(1.5).unwrap();
    let waited = waited_ms(&mut drive);
    assert!((1500..2500).contains(&waited), "{waited} ms");
    // On and on.
    done(&mut drive, Ask::Disarm);
    swept(&mut drive);
    drive.turn_by_hand(-30.0).unwrap();
    let waited = waited_ms(&mut drive);
    assert!((4900..LONGEST_MS + 50).contains(&waited), "{waited} ms");
}

#[test]
fn a_disarming_ends_the_wait_and_keeps_the_result() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    swept(&mut drive);
    done(&mut drive, Ask::Disarm);
    assert_eq!(status(&mut drive).activity, Activity::None);
    ask(&mut drive, Ask::Calibration, |answer| assert!(matches!(answer, Answer::Calibration(Calibration::Done(_)))));
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 1000);
    assert!(!status(&mut drive).unsaved);
}

#[test]
fn who_disarms_a_procedure_waits_for_nothing() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Identify);
    // Once the bridge is checked, it turns.
    let turns = (0..100).any(|_| {
        run(&mut drive, 10);
        drive.plant.truth().speed_rad_s.abs() > 10.0
    });
    assert!(turns);
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 20);
    assert_eq!(status(&mut drive).activity, Activity::None);
    done(&mut drive, Ask::Arm);
    assert!(drive.plant.truth().speed_rad_s.abs() > 2.0, "it coasts");
}

#[test]
fn what_goes_wrong_meanwhile_does_not_hold_it_up() {
    // A hand turns the shaft against the field: no calibration comes of it.
    let mut first = drive(Flash::blank());
    run(&mut first, 10);
    begin(&mut first, Ask::Calibrate);
    run(&mut first, 1000);
    first.turn_by_hand(2.3).unwrap();
    wait(&mut first);
    ask(&mut first, Ask::Calibration, |answer| {
        assert!(matches!(answer, Answer::Calibration(Calibration::Failed(_))), "{answer:?}");
    });
    assert!(matches!(first.drive().mode(), Mode::Faulted(_)));
    drop(first);
    // A Hall breaks while the rotor runs out.
    let mut second = drive(Flash::blank());
    run(&mut second, 10);
    swept(&mut second);
    second.plant.set_hall_fault(0, Some(HallFault::Open(Rail::High)));
    let waited = waited_ms(&mut second);
    assert!(waited < LONGEST_MS + 50, "{waited} ms");
    ask(&mut second, Ask::Arm, |answer| assert!(matches!(answer, Answer::Refused(_)), "{answer:?}"));
}
