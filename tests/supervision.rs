//! Supervision of a running drive: nothing turns the wrong way, runs away, or pretends to follow.

use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{AmplifierFault, PlantParameters, Wires};
use sim::rig::Rig;

const COMMUTATIONS: [Commutation; 3] = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];

fn settings(commutation: Commutation, arming_check: bool) -> Settings {
    let guard = GuardSettings { arming_check, ..GuardSettings::default() };
    Settings { commutation, control: Some(Control { guard, ..Control::default() }), ..Settings::default() }
}

/// Calibrated and at rest.
fn ready(parameters: &PlantParameters, settings: &Settings, seed: u64) -> Rig {
    let mut rig = Rig::new(parameters, settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.run(0.1, |_, _| ());
    rig.plant.set_dyno(None).unwrap();
    rig
}

/// What came of something that is wrong: the fault, after so long, the way in mechanical degrees, and the largest
/// phase current.
#[derive(Debug)]
#[expect(dead_code, reason = "a failure prints them")]
struct Outcome {
    mode: Mode,
    time_s: f64,
    way_deg: f64,
    current_a: f64,
}

fn outcome(rig: &mut Rig, longest_s: f64) -> Outcome {
    let start = rig.plant.truth().mechanical_angle_rad;
    let (mut time_s, mut way, mut current_a) = (0.0, 0.0_f64, 0.0_f64);
    rig.run(longest_s, |rig, period| {
        if rig.drive.mode() == Mode::Running {
            time_s += rig.period_s();
            way = way.max((period.truth.mechanical_angle_rad - start).abs());
            current_a = period.truth.currents_a.iter().fold(current_a, |most, one| most.max(one.abs()));
        }
    });
    Outcome { mode: rig.drive.mode(), time_s, way_deg: way.to_degrees(), current_a }
}

#[derive(Clone, Copy, Debug)]
enum Follow {
    Torque(f32),
    Speed(f32),
    Position(f64),
}

fn follow(rig: &mut Rig, what: Follow) {
    let control = *rig.control().unwrap();
    let here = rig.drive.tracker().position().to_turns() / f64::from(rig.config.pole_pairs.get());
    rig.command(match what {
        Follow::Torque(current) => Command::Current(control.current(current).unwrap()),
        Follow::Speed(speed) => Command::Speed(control.speed(speed).unwrap()),
        Follow::Position(turns) => Command::Position(control.position(here + turns).unwrap()),
    })
    .unwrap();
}

const FOLLOWED: [Follow; 7] = [
    Follow::Torque(0.5),
    Follow::Torque(-3.0),
    Follow::Torque(0.2),
    Follow::Speed(10.0),
    Follow::Speed(-100.0),
    Follow::Position(0.2),
    Follow::Position(-5.0),
];

/// Without the check at arming, as where the rotor was held then.
#[test]
fn wires_moved_on_by_one_turn_no_rotor_the_wrong_way_for_long() {
    for commutation in COMMUTATIONS {
        for (seed, what) in FOLLOWED.into_iter().enumerate() {
            for inertia in [1.0, 10.0] {
                for on in [1, 2] {
                    let mut parameters = PlantParameters::imperfect(seed as u64);
                    parameters.motor.inertia_kgm2 *= inertia;
                    let mut rig = ready(&parameters, &settings(commutation, false), seed as u64);
                    rig.plant.set_motor_wires(Wires::moved_on(on));
                    rig.command(Command::Arm).unwrap();
                    follow(&mut rig, what);
                    let outcome = outcome(&mut rig, 0.5);
                    println!("{commutation:?} {what:?} J x {inertia} {on}: {outcome:?}");
                }
            }
        }
    }
}

#[test]
fn defects_while_running() {
    for commutation in COMMUTATIONS {
        for (seed, what) in FOLLOWED.into_iter().enumerate() {
            for defect in 0..4 {
                let parameters = PlantParameters::imperfect(seed as u64);
                let mut rig = ready(&parameters, &settings(commutation, true), seed as u64);
                rig.command(Command::Arm).unwrap();
                follow(&mut rig, what);
                rig.run(0.2, |_, _| ());
                if rig.drive.mode() != Mode::Running {
                    println!("{commutation:?} {what:?}: {:?} before", rig.drive.mode());
                    continue;
                }
                match defect {
                    0 => rig.plant.set_phase_open(seed % 3, true),
                    1 => rig.plant.set_amplifier_fault(seed % 3, Some(AmplifierFault::Dead)).unwrap(),
                    2 => (0..3).for_each(|k| rig.plant.set_amplifier_fault(k, Some(AmplifierFault::Dead)).unwrap()),
                    _ => {}
                }
                let outcome = outcome(&mut rig, 0.5);
                println!("{commutation:?} {what:?} defect {defect}: {outcome:?}");
                if defect == 3 {
                    assert_eq!(outcome.mode, Mode::Running);
                }
            }
        }
    }
}

#[test]
fn nothing_is_wrong_with_other_motors() {
    for commutation in COMMUTATIONS {
        for (r, l, flux) in [(0.7, 0.8, 0.85), (1.3, 1.2, 1.15), (1.0, 1.0, 1.0)] {
            for (seed, what) in FOLLOWED.into_iter().enumerate() {
                let mut parameters = PlantParameters::imperfect(seed as u64);
                parameters.motor.resistance_ohm *= r;
                parameters.motor.inductance_h *= l;
                parameters.motor.back_emf.flux_linkage_vs *= flux;
                let mut rig = ready(&parameters, &settings(commutation, true), seed as u64);
                rig.command(Command::Arm).unwrap();
                follow(&mut rig, what);
                rig.run(0.5, |_, _| ());
                let mode = rig.drive.mode();
                if mode != Mode::Running {
                    println!("{commutation:?} {what:?} R {r} L {l} λ {flux}: {mode:?} {:?}", rig.plant.truth());
                }
            }
        }
    }
    let _ = Fault::Commutation;
}
