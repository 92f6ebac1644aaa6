//! Braking into a supply that takes nothing back, and driving from one that gives little.

use crate::commissioned::{commissioned, motors, on_battery};
use crate::known;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{AmplifierFault, BackEmf, Cogging, PlantParameters};
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};

/// A motor and its supply as they are, and what the drive is told.
#[derive(Clone, Copy)]
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) plant: PlantParameters,
    pub(crate) settings: Settings,
    pub(crate) speed_rad_s: f32,
}

pub(crate) fn plain(control: Control) -> Control {
    // What is commanded once has to hold.
    let guard = GuardSettings { arming_check: false, command_timeout_s: 60.0, ..control.guard };
    Control { guard, ..control }
}

pub(crate) fn default_motor() -> Case {
    let control = Some(plain(Control { continuous_current_a: 3.0, ..Control::default() }));
    Case {
        name: "default",
        plant: PlantParameters::imperfect(1),
        settings: Settings { commutation: Commutation::FieldOriented, control, ..Settings::default() },
        speed_rad_s: 500.0,
    }
}

/// Amplifiers of ±60 A.
fn strong(plant: &mut PlantParameters, control: Control) -> Control {
    plant.current_sense.gain = 1.65 / 60.0;
    let guard = GuardSettings { over_current_a: 50.0, imbalance_a: 5.0, offset_a: 3.0, ..control.guard };
    let control = plain(Control { guard, ..control });
    Control { current_full_scale_a: 60.0, bridge_continuous_a: 50.0, ..control }
}

/// 50 mΩ, 15 µH, seven pole pairs, four lithium cells behind a diode, the capacitors of a small board.
pub(crate) fn drone() -> Case {
    let mut plant = PlantParameters::imperfect(2).with_pole_pairs(7);
    plant.motor.resistance_ohm = 0.05;
    plant.motor.inductance_h = 15e-6;
    plant.motor.back_emf = BackEmf::sinusoidal(8e-4);
    plant.motor.inertia_kgm2 = 1e-5;
    plant.motor.cogging = [Cogging::NONE; 2];
    plant.inverter.switch_ohm = 2e-3;
    plant.bus.supply_v = 14.8;
    plant.bus.source_ohm = 0.02;
    plant.bus.capacitance_f = 220e-6;
    let control = strong(
        &mut plant,
        Control {
            resistance_ohm: 0.052,
            inductance_h: 15e-6,
            flux_linkage_wb: 8e-4,
            inertia_kgm2: 1e-5,
            max_current_a: 25.0,
            continuous_current_a: 20.0,
            max_speed_rad_s: 1200.0,
            dead_time_ramp_a: 0.5,
            guard: GuardSettings { under_voltage_v: 9.0, over_voltage_v: 20.0, ..GuardSettings::default() },
            ..Control::default()
        },
    );
    Case {
        name: "drone",
        plant,
        settings: Settings {
            commutation: Commutation::FieldOriented,
            pole_pairs: 7,
            max_electrical_hz: 1990.0,
            calibration_modulation: 0.08,
            control: Some(control),
            ..Settings::default()
        },
        speed_rad_s: 1150.0,
    }
}

/// A wheel: 0.1 Ω, 0.2 mH, 15 pole pairs, 0.05 kg·m².
pub(crate) fn wheel() -> PlantParameters {
    let mut plant = PlantParameters::imperfect(3).with_pole_pairs(15);
    plant.motor.resistance_ohm = 0.1;
    plant.motor.inductance_h = 0.2e-3;
    plant.motor.back_emf = BackEmf::sinusoidal(0.018);
    plant.motor.inertia_kgm2 = 0.05;
    plant.motor.cogging = [Cogging::NONE; 2];
    plant
}

pub(crate) fn hub() -> Case {
    let mut plant = wheel();
    plant.inverter.switch_ohm = 4e-3;
    plant.bus.capacitance_f = 1000e-6;
    let control = strong(
        &mut plant,
        Control {
            resistance_ohm: 0.104,
            inductance_h: 0.2e-3,
            flux_linkage_wb: 0.018,
            inertia_kgm2: 0.05,
            max_current_a: 25.0,
            continuous_current_a: 20.0,
            max_speed_rad_s: 40.0,
            max_acceleration_rad_s2: 150.0,
            speed_bandwidth_hz: 5.0,
            position_bandwidth_hz: 1.0,
            dead_time_ramp_a: 0.5,
            ..Control::default()
        },
    );
    Case {
        name: "hub",
        plant,
        settings: Settings {
            commutation: Commutation::FieldOriented,
            pole_pairs: 15,
            calibration_modulation: 0.12,
            calibration_hz: 5.0,
            control: Some(control),
            ..Settings::default()
        },
        speed_rad_s: 38.0,
    }
}

/// What the drive is not told: resistance, flux linkage and capacitor, times these.
const UNLIKE: [[f64; 3]; 5] = [[1.0, 1.0, 1.0], [0.75, 1.2, 1.0], [1.25, 0.8, 1.0], [0.75, 0.8, 0.5], [0.75, 1.2, 0.5]];

pub(crate) fn armed(case: &Case, unlike: [f64; 3]) -> Rig {
    let mut plant = case.plant;
    plant.motor.resistance_ohm *= unlike[0];
    plant.motor.back_emf.flux_linkage_vs *= unlike[1];
    plant.bus.capacitance_f *= unlike[2];
    let mut rig = known::rig(&plant, &case.settings, 1).unwrap();
    rig.wait(0.1);
    rig.command(Command::Arm).unwrap();
    rig
}

pub(crate) fn speed(rig: &mut Rig, radians_s: f32) {
    rig.command(Command::Speed(rig.control().unwrap().speed(radians_s).unwrap())).unwrap();
}

/// Largest bus voltage on the way to rest, and how long it took, of so many seconds.
fn stop(rig: &mut Rig, seconds: f64) -> (f64, Option<f64>) {
    speed(rig, 0.0);
    highest(rig, seconds)
}

/// Largest bus voltage in so many seconds, and when the rotor came to rest.
fn highest(rig: &mut Rig, seconds: f64) -> (f64, Option<f64>) {
    let (mut most, mut rest, mut time) = (0.0_f64, None, 0.0);
    rig.run(seconds, |rig, period| {
        time += rig.period_s();
        most = most.max(period.truth.bus_v);
        if rest.is_none() && period.truth.speed_rad_s.abs() < 1.0 {
            rest = Some(time);
        }
    });
    (most, rest)
}

#[test]
fn from_full_speed_to_rest_the_bus_stays_within_its_limit() {
    for case in [default_motor(), drone(), hub()] {
        let over = f64::from(case.settings.control.unwrap().guard.over_voltage_v);
        for (number, unlike) in UNLIKE.into_iter().enumerate() {
            for direction in sim::either(number, [1.0, -1.0]) {
                let mut rig = armed(&case, unlike);
                let mut rising = 0.0_f64;
                speed(&mut rig, direction * case.speed_rad_s);
                // Its overshoot brakes, too.
                rig.run(2.0, |_, period| rising = rising.max(period.truth.bus_v));
                let reached = rig.plant.truth().speed_rad_s;
                let (most, rest) = stop(&mut rig, 3.0);
                println!(
                    "{} {unlike:?}: from {reached:.0} rad/s in {rest:.3?} s, bus {rising:.2} and {most:.2} V",
                    case.name
                );
                assert_eq!(rig.drive.mode(), Mode::Running);
                assert!((reached / f64::from(direction * case.speed_rad_s) - 1.0).abs() < 0.02);
                assert!(rising.max(most) < over && rest.is_some_and(|time| time < 1.0));
            }
        }
    }
}

#[test]
fn a_torque_that_brakes_for_ever_returns_nothing() {
    for case in [default_motor(), drone(), hub()] {
        let control = case.settings.control.unwrap();
        for (unlike, direction) in [(UNLIKE[1], 1.0), (UNLIKE[3], -1.0)] {
            let mut rig = armed(&case, unlike);
            for percent in 0..80 {
                rig.plant.set_dyno(Some(f64::from(direction * 0.01 * percent as f32 * case.speed_rad_s))).unwrap();
                rig.wait(0.005);
            }
            let current = rig.control().unwrap().current(-direction * control.max_current_a).unwrap();
            rig.command(Command::Current(current)).unwrap();
            let (mut most, mut longest, mut limited, mut torque) = (0.0_f64, 0.0_f64, true, 0.0);
            // What limits is told every 26 ms.
            rig.wait(0.06);
            rig.run(0.3, |rig, period| {
                let length = period.truth.currents_a.iter().map(|i| i * i).sum::<f64>() / 1.5;
                (most, longest) = (most.max(period.truth.bus_v), longest.max(length.sqrt()));
                limited &= rig.drive.limits().contains(Limits::SUPPLY.with(Limits::CURRENT));
                torque += period.truth.torque_nm / f64::from(rig.periods(0.3));
            });
            let max_current = f64::from(control.max_current_a);
            println!("{}: {most:.2} V, {:.3} of the current, {torque:.4} N·m", case.name, longest / max_current);
            assert_eq!(rig.drive.mode(), Mode::Running);
            assert!(most < f64::from(control.guard.over_voltage_v) && limited);
            assert!(longest < 1.1 * max_current && torque * f64::from(direction) < 0.0);
        }
    }
}

#[test]
fn what_the_settings_do_not_tell_is_left_to_the_bus_voltage() {
    // Said to be a battery, but there is a diode before it.
    let case = default_motor();
    let control = Control { max_regeneration_a: 10.0, ..case.settings.control.unwrap() };
    let case = Case { settings: Settings { control: Some(control), ..case.settings }, ..case };
    let mut rig = armed(&case, UNLIKE[0]);
    speed(&mut rig, case.speed_rad_s);
    rig.wait(2.0);
    let (most, rest) = stop(&mut rig, 5.0);
    println!("{}: {most:.2} V, {rest:.3?} s, {:?}", case.name, rig.drive.mode());
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!(most > 28.0 && most < 32.0 && rest.is_some());
}

/// No current along d burns anything there: on a full bus a motor brakes by what draws, or not at all.
#[test]
fn with_local_feedback_the_bus_stays_within_its_limit() {
    for commutation in [Commutation::Sinusoidal, Commutation::Block] {
        for case in [default_motor(), drone(), hub()] {
            let over = f64::from(case.settings.control.unwrap().guard.over_voltage_v);
            let case = Case { settings: Settings { commutation, ..case.settings }, ..case };
            for (number, unlike) in UNLIKE.into_iter().enumerate() {
                for direction in sim::either(number, [1.0, -1.0]) {
                    let mut rig = armed(&case, unlike);
                    speed(&mut rig, direction * case.speed_rad_s);
                    rig.wait(2.0);
                    let reached = rig.plant.truth().speed_rad_s;
                    let (most, rest) = stop(&mut rig, sim::of(3.0, 15.0));
                    let left = rig.plant.truth().speed_rad_s / reached;
                    println!(
                        "{} {commutation:?} {unlike:?}: {reached:.0} rad/s, {most:.2} V, {rest:.3?} s, {left:.2}",
                        case.name
                    );
                    assert_eq!(rig.drive.mode(), Mode::Running);
                    assert!(most < over && (case.name != "default" || rest.is_some()));
                }
            }
        }
    }
}

/// A supply that is always where nothing brakes any more: a slow speed is held all the same, and not by jerks for which the
/// noise of the measured speed asks.
#[test]
fn with_local_feedback_a_speed_is_held_just_below_the_limit_of_the_bus() {
    motors("paper 20mohm gimbal-loose").into_par_iter().for_each(|motor| {
        let (mut rig, _) = commissioned(motor, &on_battery(motor, 1), 1);
        rig.command(Command::Commutate(Commutation::Sinusoidal)).unwrap();
        rig.plant.set_supply(31.0).unwrap();
        rig.arm().unwrap();
        for share in [0.02_f32, 0.1] {
            let wanted = share * rig.control().unwrap().largest_speed_rad_s();
            speed(&mut rig, wanted);
            rig.wait(1.5);
            let (periods, mut mean, mut square) = (f64::from(rig.periods(0.5)), 0.0, 0.0);
            rig.run(0.5, |_, period| {
                let share = period.truth.speed_rad_s / f64::from(wanted);
                mean += share / periods;
                square += share * share / periods;
            });
            let ripple = (square - mean * mean).max(0.0).sqrt();
            println!("{} at {share}: {mean:.3} of it, ripple {:.2} %", motor.name, 100.0 * ripple);
            assert!((mean - 1.0).abs() < 0.02 && ripple < if share < 0.1 { 0.1 } else { 0.02 });
        }
    });
}

/// What takes up the energy of the windings' largest current between the voltage above which nothing brakes, a sixteenth
/// of the range below `over_voltage_v`, and that: the rule of docs/hardware.md. At least that of a small board.
fn small_capacitor(motor: &Motor) -> f64 {
    let GuardSettings { under_voltage_v, over_voltage_v, .. } = motor.settings().control.unwrap().guard;
    let end_v = f64::from(over_voltage_v - (over_voltage_v - under_voltage_v) / 16.0);
    let energy_j = 0.75 * motor.henry * f64::from(motor.limit_a).powi(2);
    (2.0 * energy_j / (f64::from(over_voltage_v).powi(2) - end_v.powi(2))).max(470e-6)
}

/// Reversals and stops of commissioned motors; a heavy drone motor coasts. The short form has the strongest, and the one with the
/// largest inductance for its current.
#[test]
fn commissioned_motors_brake_with_local_feedback() {
    let chosen = |motor: &&Motor| sim::of(["20mohm", "hub"].contains(&motor.name), true);
    let motors: Vec<_> = MOTORS.iter().filter(chosen).collect();
    let rows: Vec<_> = motors
        .par_iter()
        .flat_map_iter(|motor| {
            let mut plant = motor.plant(1);
            plant.bus.capacitance_f = small_capacitor(motor);
            let (mut rig, _) = commissioned(motor, &plant, 1);
            let most = rig.control().unwrap().largest_speed_rad_s();
            let mut rows = vec![];
            for commutation in [Commutation::Sinusoidal, Commutation::Block] {
                // Refused where the bridge is off already.
                let _ = rig.command(Command::Disarm);
                rig.wait(0.1);
                rig.command(Command::Commutate(commutation)).unwrap();
                rig.arm().unwrap();
                for (from, to) in [(0.3, -0.3), (0.7, 0.0), (1.0, -1.0), (1.0, 0.0)] {
                    // A laboratory supply that is turned down to what it was empties the capacitor.
                    rig.plant.set_supply(motor.bus_v).unwrap();
                    speed(&mut rig, from * most);
                    rig.wait(sim::of(2.0, 6.0));
                    if rig.drive.mode() != Mode::Running {
                        let speed = rig.plant.truth().speed_rad_s;
                        rows.push((
                            format!("{} {commutation:?} to {from}: {:?} at {speed:.1}", motor.name, rig.drive.mode()),
                            false,
                        ));
                        return rows;
                    }
                    speed(&mut rig, to * most);
                    let (bus, _) = highest(&mut rig, sim::of(2.0, 10.0));
                    let name = format!("{} {commutation:?} {from} to {to}: {bus:.1} V", motor.name);
                    rows.push((name, rig.drive.mode() == Mode::Running && bus < 32.0));
                    if rig.drive.mode() != Mode::Running {
                        return rows;
                    }
                }
            }
            rows
        })
        .collect();
    for (row, _) in &rows {
        println!("{row}");
    }
    assert!(rows.iter().all(|(_, good)| *good));
}

/// Up to the voltage at which the bridge opens, what flows unseen through a blocked motor is found.
#[test]
fn dead_amplifiers_are_found_up_to_the_highest_voltage() {
    let case = default_motor();
    for commutation in [Commutation::Sinusoidal, Commutation::Block, Commutation::FieldOriented] {
        for supply_v in [24.0, 28.0, 29.5, 30.0, 30.4, 30.8, 31.2, 31.6] {
            let mut plant = case.plant;
            plant.bus.supply_v = supply_v;
            let mut rig = known::rig(&plant, &Settings { commutation, ..case.settings }, 1).unwrap();
            rig.plant.set_dyno(Some(0.0)).unwrap();
            rig.arm().unwrap();
            let current = rig.control().unwrap().current(1.0).unwrap();
            rig.command(Command::Current(current)).unwrap();
            rig.wait(0.05);
            assert_eq!(rig.drive.mode(), Mode::Running, "{commutation:?} {supply_v} V");
            (0..3).for_each(|leg| rig.plant.set_amplifier_fault(leg, Some(AmplifierFault::Dead)).unwrap());
            rig.wait(0.3);
            assert!(
                matches!(rig.drive.mode(), Mode::Faulted(_)),
                "{commutation:?} {supply_v} V: {:?}",
                rig.drive.mode()
            );
        }
    }
}

/// Mean current from the supply, A, over a time; the bus is taken for steady.
fn drawn(rig: &mut Rig, seconds: f64) -> f64 {
    let periods = f64::from(rig.periods(seconds));
    let mut sum = 0.0;
    rig.run(seconds, |_, period| sum += period.truth.last.map_or(0.0, |slice| slice.bus_a));
    sum / periods
}

#[test]
fn a_battery_is_charged_with_what_it_may_be() {
    for (allowed, least) in [(0.0, -0.05), (0.5, -0.5), (1.0, -1.0)] {
        let mut case = default_motor();
        case.plant.bus.regenerative = true;
        let control = Control { max_regeneration_a: allowed, ..case.settings.control.unwrap() };
        case.settings.control = Some(control);
        let mut rig = armed(&case, UNLIKE[1]);
        rig.plant.set_dyno(Some(400.0)).unwrap();
        rig.wait(0.1);
        rig.command(Command::Current(rig.control().unwrap().current(-1.5).unwrap())).unwrap();
        rig.wait(0.05);
        let current = drawn(&mut rig, 0.1);
        println!("{allowed} A allowed: {current:.3} A");
        assert!(current > least, "{current}");
        assert!(allowed == 0.0 || current < -0.1, "{current}");
    }
}

#[test]
fn the_supply_gives_no_more_than_it_may() {
    for unlike in [UNLIKE[0], UNLIKE[1], UNLIKE[2]] {
        let mut case = default_motor();
        case.settings.control = Some(Control { max_supply_a: 0.6, ..case.settings.control.unwrap() });
        let mut rig = armed(&case, unlike);
        for turning in [0.0, 100.0, 300.0] {
            rig.plant.set_dyno(Some(turning)).unwrap();
            rig.wait(0.1);
            rig.command(Command::Current(rig.control().unwrap().current(3.0).unwrap())).unwrap();
            rig.wait(0.05);
            let current = drawn(&mut rig, 0.1);
            println!("{unlike:?} {turning} rad/s: {current:.3} A");
            assert!(current < 0.6 && current > 0.3, "{current}");
            assert!(rig.drive.limits().contains(Limits::SUPPLY));
        }
    }
}

/// A load that turns the rotor along, as one that is let down, held at speeds at which half of the short-circuit current is
/// this share of the largest.
#[test]
fn a_load_that_drives_is_held_on_a_supply_that_takes_nothing_back() {
    let mut worst = (0.0_f64, 0.0_f64);
    for case in [default_motor(), light(), drone(), hub()] {
        let control = case.settings.control.unwrap();
        let (most_a, over_v) = (f64::from(control.max_current_a), f64::from(control.guard.over_voltage_v));
        let pairs = f64::from(case.settings.pole_pairs);
        for unlike in UNLIKE.into_iter().step_by(sim::of(3, 1)) {
            let flux_vs = case.plant.motor.back_emf.flux_linkage_vs * unlike[1];
            for (share, load) in [(0.08, 0.3), (0.15, 0.4), (0.3, 0.3), (0.3, -0.5)] {
                let radians_s = 2.0 * share * most_a * f64::from(control.resistance_ohm) / flux_vs / pairs;
                let radians_s = radians_s.min(case.speed_rad_s.into()).copysign(load);
                let mut rig = armed(&case, unlike);
                speed(&mut rig, radians_s as f32);
                rig.wait(0.2 + radians_s.abs() / f64::from(control.max_acceleration_rad_s2));
                // With the motion.
                let load_nm = -load * most_a * 1.5 * pairs * flux_vs;
                for part in 1..=20 {
                    rig.plant.set_load(f64::from(part) / 20.0 * load_nm).unwrap();
                    rig.wait(0.02);
                }
                rig.wait(0.2);
                let (mut off, mut bus_v) = (0.0_f64, 0.0_f64);
                rig.run(2.0, |_, period| {
                    off = off.max((period.truth.speed_rad_s / radians_s - 1.0).abs());
                    bus_v = bus_v.max(period.truth.bus_v / over_v);
                });
                let mode = rig.drive.mode();
                println!(
                    "{} {unlike:?} at {radians_s:.0} rad/s, {load}: off by {:.1} %, bus {bus_v:.2}, {mode:?}",
                    case.name,
                    100.0 * off
                );
                assert!(
                    mode == Mode::Running
                        && off * radians_s.abs() < 0.1 * radians_s.abs() + 0.02 * f64::from(case.speed_rad_s)
                        && bus_v < 0.95,
                    "{} {unlike:?} {radians_s} {load}: {off} {bus_v} {mode:?}",
                    case.name
                );
                worst = (worst.0.max(off), worst.1.max(bus_v));
            }
        }
    }
    println!("worst: off by {:.1} %, bus {:.2} of its limit", 100.0 * worst.0, worst.1);
}

/// A small rotor at a large current: its measured speed is noisy.
fn light() -> Case {
    let mut case = default_motor();
    case.name = "light";
    case.plant.motor.resistance_ohm = 1.0;
    case.plant.motor.inductance_h = 1e-3;
    let control = case.settings.control.unwrap();
    let guard = GuardSettings { over_current_a: 8.0, ..control.guard };
    case.settings.control = Some(Control {
        resistance_ohm: 1.02,
        inductance_h: 1e-3,
        continuous_current_a: 6.0,
        max_current_a: 6.0,
        guard,
        ..control
    });
    case
}
