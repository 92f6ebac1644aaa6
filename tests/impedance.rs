//! Impedance control at simulated motors: stiffness and damping as commanded, and passive at a hard wall, whatever rotor,
//! load and bearings.

use crate::commissioned::here_turns;
use crate::known;
use hallservo::commutation::Commutation;
use hallservo::control::impedance::{Motion, Request};
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, OnTimeout, Settings};
use plant::{Friction, PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::Rig;
use std::f64::consts::{PI, TAU};

/// Rotors that are tried: three in the short form, each with every gain.
fn rotors() -> u64 {
    sim::of(3, 8)
}

/// The same of those that meet a wall.
fn at_walls() -> u64 {
    sim::of(2, 4)
}

/// Stiffness of a wall per inertia up to which nothing swings on, N·m/rad per kg·m²: at 142 Hz. Beyond, the tracker turns
/// the damping about.
const WALL: f64 = 8e5;

fn settings(inertia_kgm2: f64) -> Settings {
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control = Control { guard, inertia_kgm2: inertia_kgm2 as f32, ..Control::default() };
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

/// What is wrong with the rotor beside what the calibration takes off.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Magnets {
    Even,
    /// Once a turn: Halls or magnets off the axis.
    Eccentric,
}

/// The imperfect motor with a seed of its own, and so many times its inertia; without friction on request, which would
/// damp by itself.
fn rotor(seed: u64, load: f64, friction: bool, magnets: Magnets) -> PlantParameters {
    let mut plant = PlantParameters::imperfect(seed);
    plant.motor.inertia_kgm2 *= load;
    if !friction {
        plant.motor.friction = Friction::NONE;
    }
    match magnets {
        Magnets::Even => plant,
        Magnets::Eccentric => plant.with_unevenness(&Unevenness { modulation: [0.05, 0.0], ..Unevenness::NONE }, seed),
    }
}

/// Armed, with the calibration of the bare rotor, whose inertia is in the settings.
fn armed(seed: u64, load: f64, friction: bool, magnets: Magnets, change: impl Fn(&mut Control)) -> Rig {
    let mut settings = settings(PlantParameters::imperfect(seed).motor.inertia_kgm2);
    settings.control.iter_mut().for_each(change);
    let model = known::model(&rotor(seed, 1.0, true, magnets), &settings, seed);
    let mut rig = Rig::new(&rotor(seed, load, friction, magnets), &settings, seed).unwrap();
    rig.wait(0.02);
    rig.service.install(&model).unwrap();
    rig.wait(0.02);
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.command(Command::Arm).unwrap();
    rig.plant.set_dyno(None).unwrap();
    while rig.drive.limits().contains(hallservo::fault::Limits::CHECKING) {
        rig.step();
    }
    rig
}

fn rig(seed: u64) -> Rig {
    armed(seed, 1.0, true, Magnets::Even, |_| ())
}

fn follow(rig: &mut Rig, request: &Request) {
    let impedance = rig.config.impedance(request).unwrap_or_else(|error| panic!("{error}"));
    rig.command(Command::Impedance(Box::leak(Box::new(impedance)))).unwrap();
}

/// A spring at a place in turns, at once.
fn spring(kp: f64, kd: f64, turns: f64) -> Request {
    Request {
        kp_nm_rad: Some(kp as f32),
        kd_nms_rad: Some(kd as f32),
        motion: Motion::To {
            position_turns: Some(turns),
            speed_rad_s: 0.0,
            stop_turns: None,
            max_speed_rad_s: Some(f32::INFINITY),
            max_acceleration_rad_s2: Some(f32::INFINITY),
        },
        ..Request::default()
    }
}

/// The largest gains that a rig takes.
fn largest(rig: &Rig) -> [f64; 2] {
    let gains = rig.config.largest_impedance().unwrap();
    [f64::from(gains.kp_nm_rad), f64::from(gains.kd_nms_rad)]
}

/// Worst of the rotors.
fn worst(rotors: u64, figure: impl Fn(u64) -> f64 + Send + Sync) -> f64 {
    (1..=rotors).into_par_iter().map(figure).reduce(|| 0.0, f64::max)
}

#[test]
fn the_stiffness_is_as_commanded() {
    for (share, magnets, most) in
        [(0.05, Magnets::Even, 0.03), (0.3, Magnets::Even, 0.03), (0.3, Magnets::Eccentric, 0.03)]
    {
        let error = worst(rotors(), |seed| {
            let mut rig = armed(seed, 1.0, true, magnets, |_| ());
            let kp = share * largest(&rig)[0];
            let origin = rig.plant.truth().mechanical_angle_rad;
            let turns = here_turns(&rig);
            follow(&mut rig, &spring(kp, 0.0, turns));
            // Slowly there and back through ± 0.3 rad, or as far as three quarters of the largest torque reach.
            let far = (0.75 * 0.09 / kp).min(0.3);
            let slope = |rig: &mut Rig, speed: f64| {
                let (mut products, mut squares, mut torques, mut angles, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
                rig.plant.set_dyno(Some(speed)).unwrap();
                rig.run(2.0 * far / speed.abs(), |_, period| {
                    let angle = period.truth.mechanical_angle_rad - origin;
                    let torque = period.truth.torque_nm;
                    (products, squares) = (products + angle * torque, squares + angle * angle);
                    (torques, angles, count) = (torques + torque, angles + angle, count + 1.0);
                });
                (products - angles * torques / count) / (squares - angles * angles / count)
            };
            rig.plant.set_dyno(Some(-1.0)).unwrap();
            rig.wait(far);
            let stiffness = [1.0, -1.0].map(|speed| -slope(&mut rig, speed));
            assert_eq!(rig.drive.mode(), Mode::Running);
            stiffness.map(|found| (found / kp - 1.0).abs()).into_iter().fold(0.0, f64::max)
        });
        println!("kp {share} of the largest, {magnets:?}: worst error of the stiffness {:.2} %", 100.0 * error);
        assert!(error < most, "{share} {magnets:?}: {error}");
    }
}

#[test]
fn the_damping_is_as_commanded() {
    // Shares of the largest kp and kd; Hz.
    for (kp, kd, hz, magnets, largest_error) in [
        (0.0, 0.2, 5.0, Magnets::Even, 0.05),
        (0.3, 0.3, 5.0, Magnets::Even, 0.05),
        (0.3, 0.8, 5.0, Magnets::Even, 0.05),
        (0.8, 0.2, 10.0, Magnets::Even, 0.05),
        (0.05, 0.5, 15.0, Magnets::Even, 0.05),
        (0.3, 0.3, 5.0, Magnets::Eccentric, 0.05),
    ] {
        let error = worst(rotors(), |seed| {
            let mut rig = armed(seed, 1.0, true, magnets, |_| ());
            let most = largest(&rig);
            let (kp, kd) = (kp * most[0], kd * most[1]);
            let turns = here_turns(&rig);
            follow(&mut rig, &spring(kp, kd, turns));
            // Half of the largest torque, at most half a radian.
            let omega = TAU * hz;
            let amplitude = (0.045 / kp.hypot(kd * omega)).min(0.5);
            let (mut work, cycles) = (0.0, 6);
            let steps = rig.periods(1.0 / hz);
            for k in 0..steps * (cycles + 1) {
                let speed = amplitude * omega * (omega * f64::from(k) * rig.period_s()).cos();
                rig.plant.set_dyno(Some(speed)).unwrap();
                let period = rig.step();
                if k >= steps {
                    work -= period.truth.torque_nm * speed * rig.period_s();
                }
                if k % 40 == 0 {
                    rig.serve();
                }
            }
            assert_eq!(rig.drive.mode(), Mode::Running);
            let damping = work / f64::from(cycles) / (PI * omega * amplitude * amplitude);
            (damping / kd - 1.0).abs()
        });
        let percent = 100.0 * error;
        println!("kp {kp}, kd {kd} of the largest, {hz} Hz, {magnets:?}: worst error of the damping {percent:.2} %");
        assert!(error < largest_error, "{kp} {kd} {hz} {magnets:?}: {error}");
    }
}

/// Energies at a wall: rotor, spring and wall; the largest of each tenth of a second.
fn impact(rig: &mut Rig, load: f64, kp: f64, kd: f64, wall_nm_rad: f64) -> Vec<f64> {
    let origin = rig.plant.truth().mechanical_angle_rad;
    let inertia = load * PlantParameters::imperfect(1).motor.inertia_kgm2;
    let turns = here_turns(rig);
    // The reference lies 0.15 rad behind the wall, or what half of the largest torque makes.
    let behind = (0.045 / kp).min(0.15);
    follow(rig, &spring(kp, kd, turns + (behind + 0.2) / TAU));
    let mut most = vec![0.0_f64; 12];
    let steps = rig.periods(1.2);
    for k in 0..steps {
        let truth = rig.plant.truth();
        let angle = truth.mechanical_angle_rad - origin;
        // In the middle of the coming period: held over it, a wall would give energy away.
        let depth = angle + 0.5 * rig.period_s() * truth.speed_rad_s - 0.2;
        rig.plant.set_load(wall_nm_rad * depth.max(0.0)).unwrap();
        // Against rest at the wall.
        let rest = kp * behind / (kp + wall_nm_rad);
        let depth = angle - 0.2;
        let energy = |depth: f64| 0.5 * wall_nm_rad * depth.max(0.0).powi(2) + 0.5 * kp * (behind - depth).powi(2);
        let total = 0.5 * inertia * truth.speed_rad_s.powi(2) + energy(depth) - energy(rest);
        let window = (k * 12 / steps) as usize;
        most[window] = most[window].max(total);
        rig.step();
        if k % 40 == 0 {
            rig.serve();
        }
    }
    assert_eq!(rig.drive.mode(), Mode::Running);
    rig.plant.set_load(0.0).unwrap();
    most
}

/// Whether the energy at a wall ever grows, by more than noise and cogging do.
fn grows(most: &[f64]) -> bool {
    most.windows(2).any(|pair| pair[1] > 1.02 * pair[0] + 2e-5)
}

#[test]
fn a_hard_wall_is_met_without_swinging_on() {
    // Bare and with loads that the settings do not know; shares of the largest gains.
    for load in [1.0, 3.0, 10.0] {
        for (kp, kd) in [(0.2, 0.2), (0.8, 0.9)] {
            let left = worst(at_walls(), |seed| {
                let mut rig = armed(seed, load, false, Magnets::Even, |_| ());
                let [most_kp, most_kd] = largest(&rig);
                let inertia = load * PlantParameters::imperfect(seed).motor.inertia_kgm2;
                let energies = impact(&mut rig, load, kp * most_kp, kd * most_kd, WALL * inertia);
                assert!(!grows(&energies), "rotor {seed}, load {load}, {kp} {kd}: {energies:?}");
                energies[11] / energies[0]
            });
            println!("load {load}, kp {kp}, kd {kd}: {:.3} % of the energy left", 100.0 * left);
            assert!(left < 0.004, "load {load}, {kp} {kd}: {left}");
        }
    }
}

#[test]
fn half_the_inertia_is_still_stable() {
    let left = worst(at_walls(), |seed| {
        let mut rig = armed(seed, 0.5, false, Magnets::Even, |_| ());
        let [kp, kd] = largest(&rig);
        let energies = impact(&mut rig, 0.5, kp, kd, 0.0);
        assert!(!grows(&energies), "rotor {seed}: {energies:?}");
        energies[11] / energies[0]
    });
    println!("half the inertia, largest gains: {:.4} % of the energy left", 100.0 * left);
    assert!(left < 0.004, "{left}");
}

#[test]
fn at_any_wall_the_shaft_hums_but_no_more() {
    let left = worst(at_walls(), |seed| {
        let mut rig = rig(seed);
        let [kp, kd] = largest(&rig);
        let energies = impact(&mut rig, 1.0, 0.2 * kp, 0.5 * kd, 200.0);
        assert!(!grows(&energies), "rotor {seed}: {energies:?}");
        energies[11] / energies[0]
    });
    println!("with friction at a wall of 200 N·m/rad: {:.2} % of the energy left", 100.0 * left);
    assert!(left < 0.02, "{left}");
}

#[test]
fn a_shaft_that_is_pushed_too_far_is_a_fault() {
    let mut rig = rig(1);
    let here = here_turns(&rig);
    follow(&mut rig, &spring(0.01, 0.0, here));
    rig.plant.set_dyno(Some(5.0)).unwrap();
    rig.wait(1.2);
    assert_eq!(rig.drive.mode(), Mode::Running);
    rig.wait(0.2);
    assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::FollowingError));
}

/// Goes some turns away at a supply that takes nothing back, told so again and again; how far it was past the place, turns.
fn overshoot(seed: u64, load: f64, kp: f64, kd: Option<f64>, turns: f64) -> f64 {
    let mut rig = armed(seed, load, true, Magnets::Even, |_| ());
    let there = here_turns(&rig) + turns;
    let request = Request {
        kp_nm_rad: Some(kp as f32),
        kd_nms_rad: kd.map(|kd| kd as f32),
        motion: Motion::to(there),
        ..Request::default()
    };
    let mut past = 0.0_f64;
    for _ in 0..10 {
        follow(&mut rig, &request);
        rig.run(0.4, |rig, _| past = past.max((here_turns(rig) - there) * turns.signum()));
    }
    let what = format!("rotor {seed}, load {load}, kp {kp}, kd {kd:?}, {turns} turns: {past:.2} turns past");
    println!("{what}");
    assert_eq!(rig.drive.mode(), Mode::Running, "{what}");
    // Friction and cogging over the stiffness.
    assert!((here_turns(&rig) - there).abs() < 0.02 + 5e-4 / kp, "{what}: {}", here_turns(&rig) - there);
    past
}

#[test]
fn a_free_motor_goes_any_way_by_a_weak_spring() {
    let mut ways = Vec::new();
    for (kp, kd) in [(0.02, None), (0.05, None), (0.1, None), (0.4, None), (0.4, Some(1e-3))] {
        for (turns, load) in
            [(3.0, 1.0), (-10.0, 1.0), (20.0, 1.0), (-60.0, 1.0), (3.0, 3.0), (20.0, 3.0), (10.0, 10.0)]
        {
            ways.push((kp, kd, turns, load));
        }
    }
    // The short form has every gain, every way, and the last, which swings past the farthest.
    let ways: Vec<_> = ways.into_iter().enumerate().rev().step_by(sim::of(5, 1)).collect();
    ways.into_par_iter().for_each(|(number, (kp, kd, turns, load))| {
        let past = overshoot(1 + number as u64 % 3, load, kp, kd, turns);
        // The weakest damper of these lets it swing past by 2.4 turns of ten; the others stay within one.
        assert!(past < 3.0 + 0.1 / kp, "kp {kp}, kd {kd:?}, {turns} turns, load {load}: {past}");
    });
}

#[test]
fn the_torque_respects_speed_and_bounds() {
    let push = |feed_forward_nm, kd| Request {
        kp_nm_rad: Some(0.0),
        kd_nms_rad: Some(kd),
        feed_forward_nm,
        ..Request::default()
    };
    let mut rig = armed(1, 1.0, true, Magnets::Even, |control| control.max_speed_rad_s = 100.0);
    follow(&mut rig, &push(0.05, 0.0));
    let mut fastest = 0.0_f64;
    rig.run(0.5, |_, period| fastest = fastest.max(period.truth.speed_rad_s));
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!((100.0..112.0).contains(&fastest), "{fastest}");

    let mut rig = armed(1, 1.0, true, Magnets::Even, |control| control.max_position_turns = 2.0);
    follow(&mut rig, &push(0.02, 2e-3));
    rig.wait(3.0);
    assert_eq!(rig.drive.mode(), Mode::Running);
    let there = here_turns(&rig);
    assert!((1.95..2.3).contains(&there), "{there}");

    // Without a damper.
    let mut rig = armed(1, 1.0, true, Magnets::Even, |control| control.max_position_turns = 8.0);
    follow(&mut rig, &push(0.02, 0.0));
    let mut farthest = 0.0_f64;
    rig.run(2.0, |rig, _| farthest = farthest.max(here_turns(rig)));
    println!("a torque alone leads to {farthest:.3} turns of 8");
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!((7.9..8.1).contains(&farthest), "{farthest}");
}

/// The way along which a spring leads the rotor is one on which it can stop.
#[test]
fn a_move_that_ends_at_a_bound_is_as_smooth_as_another() {
    for (kp, kd) in [(0.3, 0.3), (0.1, 0.1), (0.02, 0.3)] {
        let [free, bound] = [1e6, 4.0].map(|most| {
            let mut rig = armed(1, 1.0, true, Magnets::Even, |control| control.max_position_turns = most);
            let [largest_kp, largest_kd] = largest(&rig);
            let request = Request {
                kp_nm_rad: Some((kp * largest_kp) as f32),
                kd_nms_rad: Some((kd * largest_kd) as f32),
                motion: Motion::to(3.99),
                ..Request::default()
            };
            follow(&mut rig, &request);
            let (mut farthest, mut time_s, mut squares) = (0.0_f64, 0.0, 0.0);
            rig.run(1.0, |rig, period| {
                farthest = farthest.max(here_turns(rig));
                if here_turns(rig) < 3.95 {
                    time_s += rig.period_s();
                }
                squares += period.truth.currents_a.iter().map(|a| a * a).sum::<f64>();
            });
            assert_eq!(rig.drive.mode(), Mode::Running, "{kp} {kd} {most}");
            [farthest, time_s, squares]
        });
        println!("{kp} {kd}: farthest, time, squares of the current: {free:.3?}, with a bound {bound:.3?}");
        assert!(bound[0] < free[0] + 0.02 && bound[1] < 1.05 * free[1] && bound[2] < 1.2 * free[2], "{kp} {kd}");
    }
}

#[test]
fn a_load_is_braked_though_the_supply_takes_nothing_back() {
    let mut rig = armed(1, 10.0, true, Magnets::Even, |_| ());
    let [_, kd] = largest(&rig);
    let here = here_turns(&rig);
    follow(&mut rig, &spring(0.0, kd, here));
    rig.plant.set_dyno(Some(300.0)).unwrap();
    rig.wait(0.1);
    rig.plant.set_dyno(None).unwrap();
    let mut most = 0.0_f64;
    rig.run(2.0, |_, period| most = most.max(period.truth.bus_v));
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!(most < 31.0, "{most}");
    assert!(rig.plant.truth().speed_rad_s.abs() < 5.0);
}

#[test]
fn a_command_that_times_out_stops_the_shaft() {
    let mut rig = armed(1, 1.0, true, Magnets::Even, |control| control.guard.on_timeout = OnTimeout::Stop);
    let travel = Motion::To {
        position_turns: None,
        speed_rad_s: 50.0,
        stop_turns: None,
        max_speed_rad_s: None,
        max_acceleration_rad_s2: None,
    };
    follow(&mut rig, &Request { motion: travel, timeout_s: Some(0.3), ..Request::default() });
    rig.wait(0.29);
    assert!((rig.plant.truth().speed_rad_s - 50.0).abs() < 5.0, "{}", rig.plant.truth().speed_rad_s);
    rig.wait(0.2);
    assert!(rig.plant.truth().speed_rad_s.abs() < 3.0, "{}", rig.plant.truth().speed_rad_s);
    assert!(rig.drive.limits().contains(hallservo::fault::Limits::TIMEOUT));
    // The next command moves it on.
    follow(&mut rig, &Request { motion: travel, ..Request::default() });
    rig.wait(0.3);
    assert!((rig.plant.truth().speed_rad_s - 50.0).abs() < 5.0, "{}", rig.plant.truth().speed_rad_s);
}
