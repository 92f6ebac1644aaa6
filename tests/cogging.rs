//! The drive learns the cogging and balances it, against what the simulated motor's magnets do.

use hallservo::angle::PolePairs;
use hallservo::commutation::Commutation;
use hallservo::control::cogging::Table;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::service::learning::Plan;
use hallservo::settings::{Control, GuardSettings, Settings};
use hallservo::turn::{Table as TurnTable, Use};
use plant::{Cogging, Friction, PlantParameters};
use rayon::prelude::*;
use sim::commissioning::{Bench, commission};
use sim::motors::MOTORS;
use sim::rig::Rig;
use sim::statistics::Statistics;
use std::f64::consts::TAU;

/// Bandwidths of the speed control and the tracker: for turning evenly, and the default for holding against loads.
const SMOOTH: [f32; 2] = [20.0, 140.0];
const STIFF: [f32; 2] = [60.0, 280.0];

fn calibrated(plant: &PlantParameters, [speed_hz, tracking_hz]: [f32; 2], seed: u64) -> Rig {
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control =
        Control { guard, speed_bandwidth_hz: speed_hz, position_bandwidth_hz: speed_hz / 4.0, ..Control::default() };
    let settings = Settings { control: Some(control), tracking_bandwidth_hz: tracking_hz, ..Settings::default() };
    let mut rig = Rig::new(plant, &settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    // The amplifiers' zeros are averaged while the bridge is off.
    rig.run(0.05, |_, _| ());
    rig
}

/// RMS of the torque of currents and cogging, at zero command and turned slowly.
fn net_torque(rig: &mut Rig) -> f64 {
    rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    rig.arm().unwrap();
    rig.command(Command::Current(rig.control().unwrap().current(0.0).unwrap())).unwrap();
    rig.plant.set_dyno(Some(3.0)).unwrap();
    rig.run(0.1, |_, _| ());
    // The mean over the angle, for the currents are noisy.
    let mut by_angle = sim::statistics::ByAngle::new(360);
    rig.run(TAU / 3.0, |_, period| {
        let truth = &period.truth;
        by_angle.push(truth.electrical_angle_rad.to_degrees(), truth.torque_nm + truth.cogging_nm);
    });
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.run(0.05, |_, _| ());
    rig.plant.set_dyno(None).unwrap();
    rig.command(Command::Disarm).unwrap();
    by_angle.means(1.0).map(|(_, torque)| torque).collect::<Statistics>().rms()
}

#[test]
fn the_procedure_balances_the_cogging_and_ends_at_rest() {
    for (seed, bandwidths) in [(1, SMOOTH), (2, SMOOTH), (3, STIFF)] {
        let mut plant = PlantParameters::imperfect(seed);
        // Twice the friction: it must not get into the table.
        plant.motor.friction = Friction { viscous_nms: 2e-6, coulomb_nm: 1e-3, breakaway_nm: 1.2e-3 };
        let mut rig = calibrated(&plant, bandwidths, seed);
        let off = net_torque(&mut rig);
        let table = rig.learn(&Plan::new(&rig.config).unwrap()).unwrap();
        assert_eq!(rig.drive.mode(), Mode::Ready);
        assert!(rig.plant.truth().speed_rad_s.abs() < 1.0);
        let on = net_torque(&mut rig);
        println!("seed {seed}: {:.3} mN·m without, {:.3} with, {:.1}", 1e3 * off, 1e3 * on, off / on);
        assert!(off / on > 5.0, "seed {seed}: {off} {on}");
        // No longer, and again, as after a power-up.
        rig.service.set_anti_cogging(None).unwrap();
        rig.run(0.01, |_, _| ());
        let again = net_torque(&mut rig);
        assert!(again > 0.85 * off, "{again} {off}");
        rig.service.set_anti_cogging(Some(&table)).unwrap();
        rig.run(0.05, |_, _| ());
        let again = net_torque(&mut rig);
        assert!(again < 1.5 * on, "{again} {on}");
    }
}

#[test]
fn lent_tables_are_two_and_come_back() {
    let mut rig = calibrated(&PlantParameters::imperfect(1), STIFF, 1);
    let add_table = |rig: &mut Rig| rig.service.add_table(Box::leak(Box::new(Table::ZERO)));
    assert!(rig.service.set_anti_cogging(Some(&Table::ZERO)).is_err());
    assert!(add_table(&mut rig).is_none() && add_table(&mut rig).is_none());
    assert!(add_table(&mut rig).is_some());
    for _ in 0..20 {
        rig.service.set_anti_cogging(Some(&Table::ZERO)).unwrap();
        rig.run(0.001, |_, _| ());
    }
}

/// Motors of [`MOTORS`] by name, and slots that such a motor has: a magnet that is stronger than the others cogs so
/// often in a turn.
const SLOTTED: [(&str, u16); 12] = [
    ("gimbal-7", 12),
    ("drone-15uh", 12),
    ("direct-drive", 36),
    ("22-pairs", 48),
    ("gimbal-11", 24),
    ("drone-20uh", 12),
    ("drone-60a", 12),
    ("drone-stiff", 12),
    ("gimbal-stiff", 12),
    ("20mohm-32a", 9),
    ("20mohm", 12),
    ("20ohm", 9),
];

/// A commissioned motor with half as much cogging by its slots as by its poles.
fn slotted(name: &str, slots: u16, share: f64, seed: u64) -> Rig {
    let case = MOTORS.iter().find(|motor| motor.name == name).unwrap();
    let mut plant = case.plant(seed);
    let amplitude_nm = share * plant.motor.cogging[0].amplitude_nm;
    plant.motor.cogging[1] = Cogging { amplitude_nm, cycles_per_turn: slots, phase_rad: seed as f64 };
    let mut bench = Bench::new(Rig::new(&plant, &case.settings(), seed).unwrap());
    commission(&mut bench, case.settings(), case.limit_a).unwrap();
    bench.rig
}

/// Begins to turn, in turns a second.
fn turn(rig: &mut Rig, hz: f64, seconds: f64) {
    if rig.drive.mode() != Mode::Running {
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        rig.arm().unwrap();
    }
    let speed = rig.control().unwrap().speed((TAU * hz) as f32).unwrap();
    rig.command(Command::Speed(speed)).unwrap();
    rig.run(seconds, |_, _| ());
}

/// RMS of the true speed's deviation over two turns, in per cent of the mean.
fn ripple(rig: &mut Rig, hz: f64) -> f64 {
    turn(rig, hz, 1.5);
    let mut speeds = Statistics::default();
    rig.run(2.0 / hz, |_, period| speeds.push(period.truth.speed_rad_s));
    100.0 * (speeds.rms().powi(2) - speeds.mean().powi(2)).sqrt() / speeds.mean()
}

/// At rest, the bridge off.
fn stop(rig: &mut Rig) {
    turn(rig, 0.0, 1.0);
    rig.command(Command::Disarm).unwrap();
    rig.run(0.2, |_, _| ());
}

#[test]
fn what_differs_from_pole_to_pole_is_balanced_and_its_pole_found_after_power_up() {
    let count = (sim::rotors(4) as usize).min(SLOTTED.len());
    SLOTTED[..count].par_iter().for_each(|&(name, slots)| {
        let mut rig = slotted(name, slots, 0.5, 3);
        let before = ripple(&mut rig, 0.5);
        stop(&mut rig);
        rig.learn(&Plan::new(&rig.config).unwrap()).unwrap();
        assert_eq!(rig.by_pole.state(), Use::Used, "{name}");
        let learnt = ripple(&mut rig, 0.5);
        // After a power-up the position counts from another pole.
        let table = *rig.by_pole.table().unwrap();
        let pairs = i32::from(table.pole_pairs());
        let begin = pairs / 2 + 1;
        let points = table.points();
        let by = begin as usize * points.len() / pairs as usize;
        let moved = points[by..].iter().chain(&points[..by]).copied().collect::<Vec<_>>();
        let moved = TurnTable::of_points(PolePairs::new(pairs as u8).unwrap(), moved.into_iter()).unwrap();
        rig.by_pole.set(Some(moved), None);
        turn(&mut rig, 1.0, 1.0);
        let without = ripple(&mut rig, 0.5);
        let mut seconds = 0.0;
        while rig.by_pole.state() != Use::Used && seconds < 20.0 {
            turn(&mut rig, 1.0, 0.1);
            seconds += 0.1;
        }
        let found = rig.by_pole.pole().map(|pole| (pole + begin).rem_euclid(pairs));
        let after = ripple(&mut rig, 0.5);
        println!(
            "{name}: {before:.2} % without, {learnt:.2} % learnt; not found {without:.2} %, after {seconds:.1} s more {after:.2} %"
        );
        assert!(found.is_some_and(|pole| table.difference(pole) <= 0.05 * table.square()), "{name} {found:?}");
        assert!(before / learnt > 5.0 && after < 1.3 * learnt + 0.1, "{name}: {before} {learnt} {after}");
    });
}

#[test]
fn what_is_alike_at_all_poles_is_not_taken_for_different() {
    let names = ["gimbal-loose", "paper-heavy", "drone-heavy", "20ohm", "gimbal-7", "hub", "hoverboard", "paper"];
    let count = (sim::rotors(4) as usize).min(names.len());
    names[..count].par_iter().for_each(|name| {
        let mut rig = slotted(name, 9, 0.0, 1);
        rig.learn(&Plan::new(&rig.config).unwrap()).unwrap();
        let rms = rig.by_pole.table().map_or(0.0, |table| table.square().sqrt());
        println!("{name}: {rms:.1} of 32768");
        assert!(rms < 10.0, "{name}: {rms}");
    });
}

/// The table of another motor, at a motor with cogging of its own, at one without, and one that a load swings.
#[test]
fn a_table_of_another_motor_is_not_used_for_long() {
    let mut rig = slotted("gimbal-7", 12, 0.5, 3);
    rig.learn(&Plan::new(&rig.config).unwrap()).unwrap();
    let table = *rig.by_pole.table().unwrap();
    let cases = [(9, 0.5), (15, 0.5), (12, 0.0), (3, 1.0)];
    let count = (sim::rotors(2) as usize).min(cases.len());
    cases[..count].par_iter().for_each(|&(slots, share)| {
        let mut rig = slotted("gimbal-7", slots, share, 4);
        rig.by_pole.set(Some(table), None);
        let mut used = 0;
        for _ in 0..300 {
            turn(&mut rig, 1.0, 0.1);
            used += u32::from(rig.by_pole.state() == Use::Used);
        }
        println!("{slots} slots, {share}: used for {used} tenths of a second of 300; {:?}", rig.by_pole.state());
        assert!(used < 60, "{slots} {share}: {used}");
    });
}
