//! Motors whose inductances along and across the magnets' field differ: what is measured of them, and what is made of it.

use crate::commissioned::judge;
use crate::standstill::measured;
use crate::supply::{self, Case, speed};
use crate::weakening::length;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::service::identification::Plan;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{Iron, PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::motors::MOTORS;

/// Lq/Ld of the physics.
fn saliency(iron: &Iron) -> f64 {
    (1.0 + iron.salience) / (1.0 - iron.salience)
}

/// Every motor of the list, with magnets on its rotor and inside it, iron that saturates by a third at the limit, uneven
/// magnets, and rotors that cogging holds beside the axis. The short form has every third motor with another of the saliencies.
#[test]
fn the_saliency_is_measured_within_its_error() {
    let jobs: Vec<_> = MOTORS
        .iter()
        .enumerate()
        .step_by(sim::of(3, 1))
        .flat_map(|(number, case)| {
            let saliences = [-0.2, 0.0, 0.1, 0.2, 0.4].into_iter().skip(sim::of(2 * number % 5, 0)).take(sim::of(1, 5));
            saliences.map(move |salience| (case, salience, number as u64 + 1))
        })
        .collect();
    let results: Vec<_> = jobs
        .par_iter()
        .map(|&(case, salience, seed)| {
            let uneven = Unevenness { rated_a: case.limit_a.into(), ..Unevenness::CHEAP };
            let mut plant = case.plant(seed).with_unevenness(&uneven, seed);
            let saturation_a = if seed % 2 == 0 { 2.0 * f64::from(case.limit_a) } else { f64::INFINITY };
            plant.motor.iron = Iron { salience, saturation_a };
            let exact = saliency(&plant.motor.iron);
            match measured(case, &plant, seed) {
                Err(error) => (format!("{} {salience}: {error}", case.name), false),
                Ok(found) => {
                    let (value, error) = (f64::from(found.saliency.value), f64::from(found.saliency.error));
                    let known = f64::from(found.known_saliency());
                    let text = format!(
                        "{:14} {salience:4}: {value:.3} ± {error:.3}, is {exact:.3}; set {known:.3}",
                        case.name
                    );
                    let set = if salience == 0.0 { known == 1.0 } else { (known / exact - 1.0).abs() < 0.12 };
                    (text, (value - exact).abs() <= error && error < 0.2 * value && set)
                }
            }
        })
        .collect();
    judge(&results);
}

/// Magnets inside the rotor: 0.6 mH along them and 1.4 mH across, of which the drive knows what it is told.
fn inside(told: f32) -> Case {
    let mut plant = PlantParameters::imperfect(3);
    plant.motor.resistance_ohm = 1.0;
    plant.motor.inductance_h = 1e-3;
    plant.motor.iron = Iron { salience: 0.4, saturation_a: f64::INFINITY };
    let control = supply::plain(Control {
        resistance_ohm: 1.02,
        inductance_h: if told == 1.0 { 1e-3 } else { 0.6e-3 },
        saliency: told,
        continuous_current_a: 6.0,
        max_current_a: 6.0,
        max_speed_rad_s: 300.0,
        max_acceleration_rad_s2: 1000.0,
        guard: GuardSettings { over_current_a: 8.0, ..GuardSettings::default() },
        ..Control::default()
    });
    let settings = Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() };
    Case { name: "inside", plant, settings, speed_rad_s: 0.0 }
}

/// Mean length of the current and mean torque of the windings, turning steadily against a load.
fn steady(case: &Case, rad_s: f32, load_nm: f64) -> (f64, f64) {
    let mut rig = supply::armed(case, [1.0; 3]);
    speed(&mut rig, rad_s);
    rig.wait(0.5);
    for tenths in 1..=10 {
        rig.plant.set_load(f64::from(tenths) / 10.0 * load_nm * f64::from(rad_s.signum())).unwrap();
        rig.wait(0.05);
    }
    rig.wait(1.0);
    let (mut sum_a, mut torque, mut count) = (0.0, 0.0, 0.0);
    rig.run(0.5, |_, period| {
        let truth = &period.truth;
        sum_a += length(&truth.currents_a);
        torque += truth.torque_nm;
        count += 1.0;
    });
    assert_eq!(rig.drive.mode(), Mode::Running, "{} at {rad_s}", case.name);
    let off = (rig.plant.truth().speed_rad_s / f64::from(rad_s) - 1.0).abs();
    assert!(off < 0.03, "{} at {rad_s}: {off}", case.name);
    (sum_a / count, torque / count)
}

/// The shortest current that makes a torque, by search over the physics.
fn shortest(case: &Case, torque_nm: f64) -> f64 {
    let motor = &case.plant.motor;
    let difference_h = 2.0 * motor.iron.salience * motor.inductance_h;
    let constant = 1.5 * f64::from(motor.pole_pairs);
    (0..6000)
        .map(|k| f64::from(k) / 1000.0)
        .map(|d| d.hypot(torque_nm / (constant * (motor.back_emf.flux_linkage_vs + difference_h * d))))
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn the_current_for_a_torque_is_the_shortest_where_the_saliency_is_known() {
    for rad_s in [100.0_f32, -60.0, 20.0] {
        let case = inside(1.4 / 0.6);
        let (current_a, torque_nm) = steady(&case, rad_s, 0.14);
        let least_a = shortest(&case, torque_nm.abs());
        let (without_a, same_nm) = steady(&inside(1.0), rad_s, 0.14);
        println!(
            "{rad_s}: {current_a:.3} A, shortest {least_a:.3} A; {without_a:.3} A unless known ({torque_nm:.4} {same_nm:.4} N·m)"
        );
        assert!(current_a < 1.04 * least_a, "{rad_s}: {current_a} {least_a}");
        assert!((same_nm / torque_nm - 1.0).abs() < 0.02, "{rad_s}: {same_nm} {torque_nm}");
        // Faster, the alignment's trim takes what the inductance is wrong by for an error of the angle, and turns the current
        // towards −d: by luck about as far.
        if rad_s == 20.0 {
            assert!(without_a > 1.1 * current_a, "{without_a} {current_a}");
        }
    }
}

/// Whoever tells a wrong saliency gets a longer current, not another speed, a fault or more than the largest current. The
/// short form turns at the one speed and at the other in turn.
#[test]
fn a_wrong_saliency_costs_current_only() {
    for told in [0.25, 1.5, 8.0].into_iter().step_by(sim::of(2, 1)) {
        for (number, salience) in [0.0, -0.2, 0.4].into_iter().enumerate() {
            for rad_s in sim::either(number, [150.0, -20.0]) {
                let mut case = inside(told);
                case.plant.motor.iron.salience = salience;
                let (current_a, torque_nm) = steady(&case, rad_s, 0.08);
                let least_a = shortest(&case, torque_nm.abs());
                println!(
                    "{told} for {:.2}, {rad_s}: {current_a:.2} A, shortest {least_a:.2} A",
                    saliency(&case.plant.motor.iron)
                );
                assert!(current_a < 6.1, "{told} {salience} {rad_s}: {current_a}");
            }
        }
    }
}

/// A torque that begins at once, as of a drive that is told a step.
#[test]
fn a_step_of_torque_stays_within_the_largest_current() {
    for told in [1.0, 1.4 / 0.6, 8.0] {
        let case = inside(told);
        let mut rig = supply::armed(&case, [1.0; 3]);
        rig.plant.set_dyno(Some(20.0)).unwrap();
        let most_a = f64::from(case.settings.control.unwrap().max_current_a);
        let mut largest_a = 0.0_f64;
        for share in [1.0_f32, -1.0, 0.3, 1.0] {
            rig.command(Command::Current(rig.control().unwrap().current(share * most_a as f32).unwrap())).unwrap();
            rig.run(0.05, |_, period| largest_a = largest_a.max(length(&period.truth.currents_a)));
        }
        println!("{told}: {:.2} of the largest current", largest_a / most_a);
        assert!(rig.drive.mode() == Mode::Running && largest_a < 1.2 * most_a, "{told}: {largest_a} A");
    }
}

/// A drive that is commissioned is asked once more.
#[test]
fn a_salient_motor_is_identified_again() {
    let case = inside(1.4 / 0.6);
    let mut rig = supply::armed(&case, [1.0; 3]);
    rig.command(Command::Disarm).unwrap();
    rig.wait(0.5);
    let report = rig.identify(&Plan::new(&rig.config).unwrap()).unwrap();
    let motor = &case.plant.motor;
    let resistance_ohm = motor.resistance_ohm + case.plant.inverter.switch_ohm;
    for (name, found, exact) in [
        ("R", report.resistance_ohm, resistance_ohm),
        ("Ld", report.inductance_h, motor.inductance_h * (1.0 - motor.iron.salience)),
        ("flux linkage", report.flux_linkage_wb, motor.back_emf.flux_linkage_vs),
        ("inertia", report.inertia_kgm2, motor.inertia_kgm2),
    ] {
        let (value, error) = (f64::from(found.value), f64::from(found.error));
        println!("{name}: {value:.4e} ± {error:.1e}, is {exact:.4e}");
        assert!((value - exact).abs() <= error && error < 0.3 * exact, "{name}: {value} ± {error}, is {exact}");
    }
}
