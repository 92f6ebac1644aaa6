//! Motors of every impedance, from the default settings and a current limit to speed control.

use crate::commissioned::{here_turns, judge, motor, on_battery};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::drive::standstill::Probe;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::service::commission::Commission;
use hallservo::service::identify::Estimate;
use hallservo::service::procedure::{Error, Procedure, Serve, State};
use hallservo::service::standstill::Standstill;
use hallservo::settings::{Control, Settings};
use plant::{HallFault, Iron};
use rayon::prelude::*;
use rig::Rig;
use rig::commissioning::{Bench, Outcome, commission};
use rig::motors::{MOTORS, Motor};
use std::f32::consts::TAU;

/// Speed reached at a share of the largest, relative to what was asked for, and its ripple.
fn turn(bench: &mut Bench, settings: &Settings, share: f64) -> Result<(f64, f64), String> {
    let control = settings.control.unwrap();
    let asked = share * f64::from(control.max_speed_rad_s);
    let rig = &mut bench.rig;
    rig.command(Command::Commutate(Commutation::FieldOriented)).map_err(|error| error.to_string())?;
    rig.command(Command::Arm).map_err(|error| error.to_string())?;
    let speed = rig.control().unwrap().speed(asked as f32).unwrap();
    rig.command(Command::Speed(speed)).map_err(|error| error.to_string())?;
    let settling_s = 1.0 + 2.0 / f64::from(control.speed_bandwidth_hz);
    let time_s = settling_s + asked.abs() / f64::from(control.max_acceleration_rad_s2);
    bench.wait(time_s);
    let [count, millisecond] = [0.2, 1e-3].map(|seconds| bench.rig.periods(seconds));
    let (mut sum, mut square) = (0.0, 0.0);
    for k in 0..count {
        bench.step();
        if k.is_multiple_of(millisecond) {
            bench.rig.serve();
        }
        let speed = bench.rig.plant.truth().speed_rad_s / asked;
        sum += speed;
        square += speed * speed;
    }
    let mode = bench.rig.drive.mode();
    if mode != Mode::Running {
        return Err(format!("{mode:?}"));
    }
    let stop = bench.rig.control().unwrap().speed(0.0).unwrap();
    bench.rig.command(Command::Speed(stop)).map_err(|error| error.to_string())?;
    // A supply that takes nothing back makes braking slow.
    for _ in 0..300 {
        bench.wait(0.1);
        if bench.rig.plant.truth().speed_rad_s.abs() < 1.0 {
            break;
        }
    }
    bench.rig.command(Command::Disarm).map_err(|error| error.to_string())?;
    let mean = sum / f64::from(count);
    Ok((mean, (square / f64::from(count) - mean * mean).max(0.0).sqrt()))
}

/// What a board comes with where it switches with another frequency, which bounds the speeds.
fn switching(case: &Motor, pwm_hz: f32) -> Settings {
    let settings = case.settings();
    let max_electrical_hz = settings.max_electrical_hz.min(pwm_hz / 20.0);
    let largest_rad_s = 0.8 * max_electrical_hz * TAU / f32::from(case.pairs);
    let slower = |control: Control| Control { max_speed_rad_s: control.max_speed_rad_s.min(largest_rad_s), ..control };
    let control = settings.control.map(slower);
    Settings { pwm_hz, max_electrical_hz, calibration_record_hz: 20e3, control, ..settings }
}

/// How far off what is found may be, per cent: R; L and Lq/Ld; flux linkage; inertia; the largest current beyond its limit;
/// a fast and a slow speed.
struct Most {
    resistance: f64,
    inductance: f64,
    flux: f64,
    inertia: f64,
    current: f64,
    speeds: [f64; 2],
}

const MOST: Most =
    Most { resistance: 5.0, inductance: 5.0, flux: 10.0, inertia: 20.0, current: 20.0, speeds: [2.0, 5.0] };

fn attempt(case: &Motor, seed: u64, iron: Iron, settings: &Settings, most: &Most) -> (String, bool) {
    let mut plant = case.plant(seed);
    plant.motor.iron = iron;
    plant.inverter.pwm_hz = settings.pwm_hz.into();
    let rig = Rig::new(&plant, settings, seed).unwrap();
    let mut bench = Bench::new(rig);
    let outcome = commission(&mut bench, *settings, case.limit_a);
    let share = |found: f64, exact: f64| 100.0 * (found / exact - 1.0);
    let name = format!("{:16} {seed}", case.name);
    let largest = 100.0 * bench.largest_a / f64::from(case.limit_a);
    let outcome = match outcome {
        Err(error) => return (format!("{name} {largest:4.0} % of the limit; {error}"), false),
        Ok(outcome) => outcome,
    };
    let Outcome { settings, electrical, sensors, tries, rough, seconds, .. } = outcome;
    let motor = &plant.motor;
    let control = settings.control.unwrap();
    let off = [
        share(electrical.resistance_ohm.value.into(), motor.resistance_ohm + plant.inverter.switch_ohm),
        // The rotor stands along the field that measures.
        share(electrical.inductance_h.value.into(), motor.inductance_h * (1.0 - iron.salience)),
        share(control.flux_linkage_wb.into(), motor.back_emf.flux_linkage_vs),
        share(control.inertia_kgm2.into(), motor.inertia_kgm2),
        share(control.saliency.into(), (1.0 + iron.salience) / (1.0 - iron.salience)),
    ];
    let turned = turn(&mut bench, &settings, 0.5).and_then(|forward| Ok((forward, turn(&mut bench, &settings, -0.1)?)));
    let largest = 100.0 * bench.largest_a / f64::from(case.limit_a);
    let rough = [
        share(rough.flux_linkage_wb.into(), motor.back_emf.flux_linkage_vs),
        share(rough.inertia_kgm2.into(), motor.inertia_kgm2),
    ];
    let text = format!(
        "{name} {largest:4.0} % of the limit, {seconds:3.0} s; R {:+.1} L {:+.1} λ {:+.1} J {:+.1} Lq/Ld {:+.1} % (rough {:+.0} \
         {:+.0} %); {tries} × {} Hz, lag {:.0}° swing {:.1}° residual {:.2} %; {:.0} {:.1} Hz, {:.0} rad/s, {:.0} rad/s²: {turned:.3?}",
        off[0],
        off[1],
        off[2],
        off[3],
        off[4],
        rough[0],
        rough[1],
        settings.calibration_hz,
        sensors.lag.to_degrees().abs(),
        sensors.hunting_deg,
        sensors.residual_pct,
        control.current_bandwidth_hz,
        control.speed_bandwidth_hz,
        control.max_speed_rad_s,
        control.max_acceleration_rad_s2,
    );
    let allowed = [most.resistance, most.inductance, most.flux, most.inertia, most.inductance];
    let wrong = |speed: (f64, f64)| 100.0 * (speed.0 - 1.0).abs();
    // A rotor that swings in another rhythm than the field turns is smeared over the calibration's sums.
    let good = sensors.residual_pct < 1.0
        && off.iter().zip(allowed).all(|(off, most)| off.abs() <= most)
        && largest <= 100.0 + most.current
        && turned.is_ok_and(|(fast, slow)| wrong(fast) < most.speeds[0] && wrong(slow) < most.speeds[1]);
    (text, good)
}

/// The short form has two of them.
#[test]
fn any_motor_is_commissioned_by_its_current_limit() {
    let hoverboard = motor("hoverboard");
    // At the tenth, the voltage that turned a current round looked like a back-EMF: a heavy rotor was not reached.
    let jobs = MOTORS.iter().flat_map(|case| [1, 2].map(|seed| (case, seed))).step_by(sim::of(20, 1));
    let jobs: Vec<_> = jobs.chain([(hoverboard, 10)]).collect();
    let results: Vec<_> =
        jobs.par_iter().map(|(case, seed)| attempt(case, *seed, Iron::NONE, &case.settings(), &MOST)).collect();
    judge(&results);
}

/// Coils without iron: L/R is as long as a control period and shorter, so the current settles before the next edge of the wave
/// that measures the inductance. It is told to be at most so large then, and the ± hold. The short form has one of them.
#[test]
fn coils_whose_current_settles_within_a_few_periods_are_commissioned() {
    let windings = [(1.0, 25e-6, 4.0), (1.0, 35e-6, 4.0), (0.8, 12e-6, 4.0), (5.0, 15e-6, 1.0), (10.0, 20e-6, 0.6)];
    let good: Vec<_> = windings[..sim::of(1, 5)]
        .par_iter()
        .map(|&(ohm, seconds, limit_a)| {
            let case = Motor { ohm, henry: ohm * seconds, limit_a, ..*motor("slotless") };
            let (settings, plant) = (case.settings(), case.plant(1));
            let mut bench = Bench::new(Rig::new(&plant, &settings, 1).unwrap());
            let Outcome { settings, electrical, .. } = commission(&mut bench, settings, limit_a).unwrap();
            let (fast, slow) = (turn(&mut bench, &settings, 0.5).unwrap(), turn(&mut bench, &settings, -0.1).unwrap());
            println!("{ohm} Ω, {:.0} µs: {electrical} {fast:.4?} {slow:.4?} {:.2} A", 1e6 * seconds, bench.largest_a);
            let within = |found: Estimate, exact: f64| (f64::from(found.value) - exact).abs() <= f64::from(found.error);
            let says = within(electrical.resistance_ohm, ohm + plant.inverter.switch_ohm)
                && within(electrical.inductance_h, case.henry)
                && within(electrical.saliency, 1.0);
            let turns = [fast, slow].iter().all(|(mean, ripple)| (mean - 1.0).abs() < 0.02 && *ripple < 0.05);
            says && turns && bench.largest_a <= 1.2 * f64::from(limit_a)
        })
        .collect();
    assert!(good.iter().all(|good| *good), "{good:?}");
}

/// At 80 kHz dead times of 0.8 µs are 6 % of a period. The short form has one of 40.
#[test]
fn any_motor_is_commissioned_at_twenty_and_at_eighty_kilohertz() {
    let jobs = MOTORS.iter().flat_map(|case| [20e3, 80e3].map(|pwm_hz| (case, pwm_hz))).skip(sim::of(17, 0));
    let jobs: Vec<_> = jobs.take(sim::of(1, usize::MAX)).collect();
    let most = Most { resistance: 7.0, inductance: 8.0, current: 25.0, speeds: [5.0, 5.0], ..MOST };
    let results: Vec<_> =
        jobs.par_iter().map(|(case, pwm_hz)| attempt(case, 1, Iron::NONE, &switching(case, *pwm_hz), &most)).collect();
    for ((text, good), (_, pwm_hz)) in results.iter().zip(&jobs) {
        println!("{} {:2.0} kHz {text}", if *good { " " } else { "!" }, pwm_hz / 1e3);
    }
    assert!(results.iter().all(|(_, good)| *good));
}

/// A rotor that follows the voltages of the check at arming: at 20 kHz they stand twice as long, and its back-EMF takes most of
/// a phase's current. That was taken for an open phase in a third of the checks. The short form has one drive of six.
#[test]
fn a_light_rotor_of_many_pole_pairs_arms_wherever_it_rests() {
    let case = motor("22-pairs");
    (1..=sim::of(1, 6)).into_par_iter().for_each(|seed| {
        let board = switching(case, 20e3);
        let mut plant = case.plant(seed);
        plant.inverter.pwm_hz = board.pwm_hz.into();
        let mut bench = Bench::new(Rig::new(&plant, &board, seed).unwrap());
        let settings = commission(&mut bench, board, case.limit_a).unwrap().settings;
        for k in 0..sim::of(8, 30) {
            turn(&mut bench, &settings, 0.01 * f64::from(5 + 7 * k % 29))
                .unwrap_or_else(|why| panic!("{seed} {k}: {why}"));
            bench.wait(0.02 * f64::from(k % 8));
        }
    });
}

/// The short form has a light motor, and leaves out those with many pole pairs and the larger inductance along the magnets.
#[test]
fn a_motor_whose_inductances_differ_and_saturate_is_commissioned_as_well() {
    let jobs = sim::of(&[("paper", 0.2)][..], &[("hub", 0.2), ("22-pairs", 0.2), ("paper", -0.1)]);
    let jobs = jobs.iter().map(|(name, salience)| (motor(name), *salience));
    let results: Vec<_> = jobs
        .par_bridge()
        .map(|(case, salience)| {
            let iron = Iron { salience, saturation_a: 2.0 * f64::from(case.limit_a) };
            attempt(case, 1, iron, &case.settings(), &Most { inductance: 8.0, ..MOST })
        })
        .collect();
    for (text, good) in &results {
        assert!(good, "{text}");
    }
}

/// What commissioning says of a motor with which something is wrong.
fn complaint(case: &Motor, break_it: impl FnOnce(&mut Rig)) -> String {
    let mut rig = Rig::new(&case.plant(1), &case.settings(), 1).unwrap();
    break_it(&mut rig);
    let mut bench = Bench::new(rig);
    let Err(error) = commission(&mut bench, case.settings(), case.limit_a) else { panic!("nothing was wrong") };
    assert!(!bench.rig.drive.mode().drives() && bench.largest_a <= 1.2 * f64::from(case.limit_a), "{error}");
    error
}

/// It rocks at two speeds as if the same Hall were dead, and turns at another.
#[test]
fn a_heavy_rotor_that_rocks_is_not_taken_for_a_dead_hall() {
    let heavy = motor("paper-heavy");
    let heavier = Motor { inertia_kgm2: 3.0 * heavy.inertia_kgm2, ..*heavy };
    let mut bench = Bench::new(Rig::new(&heavier.plant(1), &heavier.settings(), 1).unwrap());
    commission(&mut bench, heavier.settings(), heavier.limit_a).unwrap();
}

#[test]
fn what_is_wrong_is_said() {
    let paper = &MOTORS[8];
    let disconnected = Motor { ohm: 1e6, ..*paper };
    let error = complaint(&disconnected, |_| ());
    assert!(error.contains("NoCurrent"), "{error}");
    let error = complaint(paper, |rig| rig.plant.set_dyno(Some(0.0)).unwrap());
    assert!(error.contains("no Hall sees the magnet turn"), "{error}");
    let error = complaint(paper, |rig| rig.plant.set_hall_fault(1, Some(plant::HallFault::StuckAt(1.65))));
    assert!(error.contains("Hall 2"), "{error}");
    // An amplifier that shows nothing, at each phase, on a board that does not notice by the sum of the currents.
    for phase in 0..3 {
        let error = complaint(&Motor { full_scale_a: 16.0, limit_a: 2.0, ..*paper }, |rig| {
            rig.disturb = Some(Box::new(move |sample| sample.currents[phase] = 2048));
        });
        assert!(error.contains("Uneven") || error.contains("NoCurrent"), "{error}");
    }
    // A shorted winding as far as the current limit goes: nothing leaps.
    let shorted = Motor { ohm: 0.5e-3, henry: 0.5e-6, ..MOTORS[6] };
    println!("{}", complaint(&shorted, |_| ()));
}

#[test]
fn a_measurement_at_standstill_ends_with_the_bridge_off() {
    type Meddle = fn(&mut Rig, &mut Standstill);
    let cases: [(Error, Meddle); 3] = [
        (Error::Cancelled, |_, standstill| standstill.cancel()),
        (Error::Disarmed, |rig, _| rig.service.send(Command::Disarm).unwrap()),
        (Error::Fault(Fault::OverVoltage), |rig, _| rig.disturb = Some(Box::new(|sample| sample.bus = 4000))),
    ];
    for (expected, meddle) in cases {
        let settings = limited(&MOTORS[8]);
        let mut rig = Rig::new(&MOTORS[8].plant(1), &settings, 1).unwrap();
        let mut standstill = Standstill::new(&rig.config).unwrap();
        let mut end = State::Running;
        for ms in 0..1000 {
            if ms == 300 {
                assert_eq!(rig.drive.mode(), Mode::Aligning);
                meddle(&mut rig, &mut standstill);
            }
            end = standstill.serve(&mut rig.service, ms);
            rig.wait(1e-3);
        }
        assert_eq!(end, State::Failed(expected));
        assert!(!rig.drive.mode().drives());
    }
}

#[test]
fn a_drive_that_nobody_asks_any_more_ends_the_measurement_by_itself() {
    let mut rig = Rig::new(&MOTORS[8].plant(1), &limited(&MOTORS[8]), 1).unwrap();
    rig.command(Command::Measure {
        begins: true,
        probe: Probe { phase: 0, current: 1000, ripple: 0, across: false, swings_across: false },
    })
    .unwrap();
    rig.wait(0.3);
    assert_eq!(rig.drive.mode(), Mode::Aligning);
    rig.wait(0.2);
    assert_eq!(rig.drive.mode(), Mode::Unarmed);
    // It is not begun again by going on, nor with more than the largest current.
    for (begins, current) in [(false, 1000), (true, 32_000)] {
        assert!(
            rig.command(Command::Measure {
                begins,
                probe: Probe { phase: 0, current, ripple: 0, across: false, swings_across: false }
            })
            .is_err()
        );
    }
    assert_eq!(rig.drive.mode(), Mode::Unarmed);
}

fn limited(case: &Motor) -> Settings {
    *Commission::new(case.settings(), Some(case.limit_a)).unwrap().settings()
}

#[test]
fn a_calibration_with_the_settings_of_another_motor_keeps_the_current_limit() {
    let shares: Vec<_> = MOTORS
        .par_iter()
        .map(|case| {
            let rig = Rig::new(&case.plant(3), &limited(case), 3).unwrap();
            let mut bench = Bench::new(rig);
            // It may fail, but by what it says of the sensors and not by a fault.
            let result = bench.calibrate().unwrap().map(|report| report.hunting_deg);
            (case.name, bench.largest_a / f64::from(case.limit_a), result)
        })
        .collect();
    for (name, share, result) in shares {
        println!("{name:16} {:4.0} % of the limit: {result:?}", 100.0 * share);
        assert!(share <= 1.0, "{name}");
    }
}

/// A current of two thirds of what the motor takes speeds it up and brakes it for so much longer. The short form has one of
/// two rotors.
#[test]
fn a_heavy_motor_is_commissioned_by_a_small_current() {
    let heavy = motor("drone-heavy");
    [5, 1][..sim::of(1, 2)].par_iter().for_each(|&seed| {
        let heavy = Motor { limit_a: 10.0, ..*heavy };
        let (text, good) = attempt(&heavy, seed, Iron::NONE, &heavy.settings(), &MOST);
        assert!(good, "{text}");
        println!("{text}");
    });
}

/// What calibrating says of a motor whose rotor is so many times as heavy, with one Hall dead or none.
fn calibrated(case: &Motor, times: f64, seed: u64, dead: Option<usize>) -> Result<(), String> {
    let mut plant = case.plant(seed);
    plant.motor.inertia_kgm2 *= times;
    let mut rig = Rig::new(&plant, &case.settings(), seed).unwrap();
    if let Some(hall) = dead {
        let level_v = [1.65, 0.3, 3.0][seed as usize % 3];
        rig.plant.set_hall_fault(hall, Some(HallFault::StuckAt(level_v)));
    }
    rig.calibrate(|_| ()).map(drop).map_err(|error| error.to_string())
}

/// Rotors that are too heavy for the field rock: then no Hall is at fault. Where the rotor turns, a dead one is named. The
/// short form has some.
#[test]
fn a_hall_is_blamed_where_it_is_dead_and_not_where_a_heavy_rotor_rocks() {
    let inertias = [1.0, 3.0, 10.0, 30.0, 100.0, 1000.0];
    let jobs = MOTORS.iter().flat_map(|case| inertias.map(|times| (case, times)));
    let jobs: Vec<_> = jobs.flat_map(|job| [1, 2, 3].map(|seed| (job, seed))).step_by(sim::of(29, 1)).collect();
    let rows = jobs.par_iter().map(|&((case, times), seed)| {
        let name = format!("{} {times} times as heavy, {seed}", case.name);
        let healthy = calibrated(case, times, seed, None);
        if let Err(said) = healthy {
            assert!(!said.contains("sees no magnet turning"), "{name}: {said}");
            return (format!("{name}: {said}"), false);
        }
        for hall in 0..3 {
            let said = calibrated(case, times, seed, Some(hall)).unwrap_err();
            assert!(said.contains(&format!("Hall {} sees no magnet turning", hall + 1)), "{name}, {hall} dead: {said}");
        }
        (name, true)
    });
    let rows: Vec<_> = rows.collect();
    rows.iter().filter(|(_, turns)| !turns).for_each(|(said, _)| println!("{said}"));
    let turning = rows.iter().filter(|(_, turns)| *turns).count();
    println!("{turning} of {} turn", rows.len());
    assert!((rows.len() / 6..rows.len()).contains(&turning));
}

/// Rotors that are not turned by any sweep: of a hundred times what the motor has its current for.
const TOO_HEAVY: [(&str, f64); 5] = [
    ("paper-heavy", 10.0),
    ("paper-heavy", 30.0),
    ("paper-heavy", 100.0),
    ("gimbal-stiff", 100.0),
    ("hoverboard", 100.0),
];

/// Every motor with 10, 30 and 100 times its inertia, up to 9 kg·m², and a move of half a turn with the settings that come of
/// it. The short form has one of ten motors, and one of the inertias.
#[test]
fn a_heavy_load_on_the_shaft_is_commissioned_with_it() {
    let jobs: Vec<_> = MOTORS
        .iter()
        .enumerate()
        .skip(sim::of(7, 0))
        .step_by(sim::of(10, 1))
        .flat_map(|(number, case)| {
            [100.0, 30.0, 10.0].into_iter().take(sim::of(1, 3)).map(move |times| (number, case, times))
        })
        .filter(|(_, case, times)| !TOO_HEAVY.contains(&(case.name, *times)))
        .collect();
    let rows: Vec<_> =
        jobs.par_iter().map(|&(number, case, times)| with_inertia(case, times, number as u64 + 21)).collect();
    judge(&rows);
}

fn with_inertia(case: &Motor, times: f64, seed: u64) -> (String, bool) {
    let mut plant = on_battery(case, seed);
    plant.motor.inertia_kgm2 *= times;
    let mut bench = Bench::new(Rig::new(&plant, &case.settings(), seed).unwrap());
    let found = match commission(&mut bench, case.settings(), case.limit_a) {
        Ok(found) => found,
        Err(why) => return (format!("{} x{times}: {why}", case.name), false),
    };
    let (mut rig, mut settings) = (bench.rig, found.settings);
    let control = settings.control.unwrap();
    let flux = f64::from(control.flux_linkage_wb) / case.flux_vs;
    let inertia = f64::from(control.inertia_kgm2) / plant.motor.inertia_kgm2;
    settings.commutation = Commutation::FieldOriented;
    rig.configure(&settings).unwrap();
    rig.arm().unwrap();
    let goal = here_turns(&rig) + 0.5;
    rig.command(Command::Position(rig.control().unwrap().position(goal).unwrap())).unwrap();
    let mut farthest = f64::NEG_INFINITY;
    for _ in 0..200 {
        rig.wait(0.1);
        farthest = farthest.max(here_turns(&rig) - goal);
    }
    let off = here_turns(&rig) - goal;
    let text = format!(
        "{} x{times}: flux {flux:.3} and inertia {inertia:.3} times the true ones, {} s, {farthest:.4} turns beyond, {off:.4} off in the end, {:?}",
        case.name,
        found.seconds as u32,
        rig.drive.mode()
    );
    let known = if found.report.is_some() { [0.02, 0.1] } else { [0.16, 0.25] };
    let good = (flux - 1.0).abs() < known[0] && (inertia - 1.0).abs() < known[1];
    (text, good && farthest < 0.03 && off.abs() < 0.03 && rig.drive.mode() == Mode::Running)
}
