//! Moves to positions on a supply that takes nothing back, which leaves less torque to brake with than to drive.

use crate::commissioned::{commissioned, here_turns, judge, lift_limits, motors, on_battery};
use crate::supply::{Case, armed, drone, hub, speed};
use hallservo::commutation::Commutation;
use hallservo::control::impedance::{Motion, Request};
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::{Control, Settings};
use plant::{PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::Rig;
use rig::motors::MOTORS;
use std::f64::consts::TAU;

/// Resistance, flux linkage, capacitor, source resistance and inertia as they are, times what is told; friction as a
/// share of the torque of the largest current.
#[derive(Clone, Copy, Debug)]
struct Unlike {
    resistance: f64,
    flux: f64,
    capacitor: f64,
    source: f64,
    inertia: f64,
    friction: f64,
}

const LIKE: Unlike = Unlike { resistance: 1.0, flux: 1.0, capacitor: 1.0, source: 1.0, inertia: 1.0, friction: 0.0 };
const UNLIKE: [Unlike; 7] = [
    LIKE,
    Unlike { resistance: 0.75, flux: 1.2, capacitor: 0.5, ..LIKE },
    Unlike { resistance: 1.25, flux: 0.8, ..LIKE },
    Unlike { inertia: 1.4, source: 3.0, ..LIKE },
    Unlike { inertia: 0.7, capacitor: 5.0, ..LIKE },
    Unlike { friction: 0.1, capacitor: 0.5, ..LIKE },
    Unlike { resistance: 1.25, inertia: 1.4, flux: 0.8, ..LIKE },
];

fn default_motor() -> Case {
    let control = Some(crate::supply::plain(Control { continuous_current_a: 3.0, ..Control::default() }));
    let settings = Settings { commutation: Commutation::FieldOriented, control, ..Settings::default() };
    Case { name: "default", plant: PlantParameters::imperfect(1), settings, speed_rad_s: 500.0 }
}

/// Light, so that it is fast at once.
fn fast_drone() -> Case {
    let mut case = drone();
    case.name = "fast drone";
    case.settings.control.as_mut().unwrap().max_acceleration_rad_s2 = 10_000.0;
    case
}

fn other(mut case: Case, unlike: &Unlike) -> Case {
    let motor = &mut case.plant.motor;
    let control = case.settings.control.as_mut().unwrap();
    let constant = 1.5 * f64::from(case.settings.pole_pairs) * f64::from(control.flux_linkage_wb);
    let torque = f64::from(control.max_current_a) * constant;
    // What can be done if the motor is as told, and also if it is not.
    let most = if unlike.inertia > 1.0 { 0.35 } else { 0.6 } * torque / f64::from(control.inertia_kgm2);
    control.max_acceleration_rad_s2 = control.max_acceleration_rad_s2.min(most as f32);
    let friction = unlike.friction * torque;
    motor.friction.coulomb_nm += friction;
    motor.friction.breakaway_nm += friction;
    motor.resistance_ohm *= unlike.resistance;
    motor.back_emf.flux_linkage_vs *= unlike.flux;
    motor.inertia_kgm2 *= unlike.inertia;
    case.plant.bus.capacitance_f *= unlike.capacitor;
    case.plant.bus.source_ohm *= unlike.source;
    case
}

fn go(rig: &mut Rig, turns: f64) {
    let position = rig.control().unwrap().position(turns).unwrap();
    rig.command(Command::Position(position)).unwrap();
}

/// What a move came to.
#[derive(Debug)]
struct Way {
    mode: Mode,
    /// Turns beyond the goal, seen from where it began; and then to the other side of it, and so on.
    swings: Vec<f64>,
    /// Turns from the goal, at the end.
    left: f64,
    /// Time after which it stayed within a hundredth of a turn.
    settled_s: f64,
    bus_v: f64,
}

impl Way {
    fn overshoot(&self) -> f64 {
        self.swings.first().copied().unwrap_or(0.0)
    }

    /// Whether each swing is smaller than the one before, but for some of ten degrees.
    fn shrinks(&self) -> bool {
        self.swings.windows(2).all(|pair| pair[1] < 0.85 * pair[0] + 0.03)
    }
}

/// Goes to a position and looks on for a time.
fn travel(rig: &mut Rig, goal: f64, seconds: f64) -> Way {
    let pairs = f64::from(rig.config.pole_pairs.get());
    let turning = rig.plant.truth().speed_rad_s;
    let ahead = goal - here_turns(rig);
    let forward = if ahead.abs() < 1e-3 { turning > 0.0 } else { ahead > 0.0 };
    go(rig, goal);
    let mut way = Way { mode: Mode::Running, swings: vec![], left: 0.0, settled_s: 0.0, bus_v: 0.0 };
    let (mut side, mut most, mut time) = (forward, 0.0_f64, 0.0);
    rig.run(seconds, |rig, period| {
        let beyond = rig.drive.tracker().position().to_turns() / pairs - goal;
        time += rig.period_s();
        way.bus_v = way.bus_v.max(period.truth.bus_v);
        if beyond.abs() > 0.01 {
            way.settled_s = time;
        }
        if (beyond > 0.0) == side {
            most = most.max(beyond.abs());
        } else if most > 0.01 {
            way.swings.push(most);
            (side, most) = (!side, 0.0);
        }
    });
    if most > 0.01 {
        way.swings.push(most);
    }
    (way.mode, way.left) = (rig.drive.mode(), here_turns(rig) - goal);
    way
}

/// Turns from a speed to rest, with a constant torque.
fn stopping_turns(case: &Case) -> f64 {
    let control = case.settings.control.unwrap();
    f64::from(case.speed_rad_s).powi(2) / 2.0 / f64::from(control.max_acceleration_rad_s2) / TAU
}

/// The short form has every kind of unlike once, and every case.
fn jobs() -> Vec<(Case, Unlike)> {
    let cases = [default_motor(), drone(), fast_drone(), hub()];
    let jobs = cases.iter().flat_map(|case| UNLIKE.map(|unlike| (*case, unlike)));
    jobs.step_by(sim::of(4, 1)).collect()
}

/// From near ones to those that reach the largest speed; the short form makes two of the four ways, in turn.
#[test]
fn a_move_ends_at_its_goal() {
    let rows = jobs().into_par_iter().enumerate().flat_map_iter(|(number, (case, unlike))| {
        let mut rig = armed(&other(case, &unlike), [1.0; 3]);
        rig.wait(0.3);
        let full = stopping_turns(&case);
        let mut rows = vec![];
        let ways = [1.0, 0.3 * full, -full, 2.5 * full].into_iter();
        for turns in ways.skip(sim::of(number % 2, 0)).step_by(sim::of(2, 1)) {
            let goal = here_turns(&rig) + turns;
            let seconds = 3.0 + turns.abs() * TAU / f64::from(case.speed_rad_s);
            let way = travel(&mut rig, goal, seconds);
            let good = way.mode == Mode::Running
                && way.left.abs() < 0.01
                && way.shrinks()
                && way.overshoot() < 0.5 + 0.22 * turns.abs();
            rows.push((format!("{} {unlike:?} {turns:.1} turns: {way:.3?}", case.name), good));
            if way.mode != Mode::Running {
                break;
            }
        }
        rows
    });
    judge(&rows.collect::<Vec<_>>());
}

/// It brakes as a stop does, and comes back. The short form makes it from the one speed and from the other in turn.
#[test]
fn a_position_commanded_at_speed_is_come_back_to() {
    let rows = jobs().into_par_iter().enumerate().flat_map_iter(|(number, (case, unlike))| {
        let mut rows = vec![];
        for (share, direction) in sim::either(number, [(0.4, 1.0_f32), (1.0, -1.0)]) {
            let case = other(case, &unlike);
            let mut rig = armed(&case, [1.0; 3]);
            let mut stop = f64::NAN;
            for ahead in [f64::NAN, 0.0, 1.0, -3.0] {
                speed(&mut rig, share * direction * case.speed_rad_s);
                rig.wait(2.5);
                let from = here_turns(&rig);
                if ahead.is_nan() {
                    speed(&mut rig, 0.0);
                    rig.wait(3.0);
                    stop = (here_turns(&rig) - from).abs();
                    continue;
                }
                let way = travel(&mut rig, from + f64::from(direction) * ahead, 6.0);
                let good = way.mode == Mode::Running && way.left.abs() < 0.01 && way.shrinks();
                let beyond = if ahead < 0.0 { 0.0 } else { way.overshoot() };
                let brakes = beyond < (1.6 * stop - ahead).max(0.0) + 0.5;
                rows.push((
                    format!(
                        "{} {unlike:?} from {share} {direction}, {ahead} ahead, stops in {stop:.2}: {way:.3?}",
                        case.name
                    ),
                    good && brakes,
                ));
                if way.mode != Mode::Running {
                    break;
                }
            }
        }
        rows
    });
    judge(&rows.collect::<Vec<_>>());
}

/// A commanded speed that a rotor cannot follow at once waits for it; a position that is commanded meanwhile does not. The
/// short form begins in the one direction and in the other in turn.
#[test]
fn a_position_follows_a_speed_that_waits() {
    for (number, (case, unlike)) in jobs().iter().filter(|(case, _)| case.name != "default").enumerate() {
        let case = other(*case, unlike);
        let mut rig = armed(&case, [1.0; 3]);
        for direction in sim::either(number, [1.0, -1.0]) {
            speed(&mut rig, direction * case.speed_rad_s);
            rig.wait(2.5);
            speed(&mut rig, -direction * case.speed_rad_s);
            rig.run(
                0.2 * f64::from(case.speed_rad_s / case.settings.control.unwrap().max_acceleration_rad_s2),
                |_, _| (),
            );
            let goal = here_turns(&rig);
            let way = travel(&mut rig, goal, 6.0);
            println!("{} {unlike:?} {direction}: {way:.3?}", case.name);
            assert_eq!(way.mode, Mode::Running, "{} {unlike:?} {direction}: {way:.3?}", case.name);
        }
    }
}

/// Light and heavy ones, of a low resistance, with the settings that commissioning has left. The short form has the
/// lightest and the heaviest.
#[test]
fn commissioned_motors_reach_their_goals() {
    let names = sim::of("drone-20uh hub", "drone-15uh drone-20uh drone-loose 20mohm hub");
    let names = std::env::var("MOTORS").unwrap_or(names.into());
    let motors = if names == "all" { MOTORS.iter().collect() } else { motors(&names) };
    let rows = motors.into_par_iter().flat_map_iter(|motor| {
        let (mut rig, mut settings) = commissioned(motor, &motor.plant(5), 5);
        settings.commutation = Commutation::FieldOriented;
        rig.configure(&settings).unwrap();
        rig.arm().unwrap();
        let control = rig.control().unwrap();
        let (most, acceleration) = (f64::from(control.largest_speed_rad_s()), {
            f64::from(settings.control.unwrap().max_acceleration_rad_s2)
        });
        let full = most * most / acceleration / TAU;
        let mut rows = vec![];
        for turns in [0.2 * full, -full - 1.0, 1.5 * full + 1.0] {
            let goal = here_turns(&rig) + turns;
            let way = travel(&mut rig, goal, 4.0 + turns.abs() * TAU / most + 8.0 * most / acceleration);
            let good = way.mode == Mode::Running && way.left.abs() < 0.05 && way.overshoot() < 0.5 && way.shrinks();
            rows.push((
                format!("{} {most:.0} rad/s {acceleration:.0} rad/s², {turns:.1} turns: {way:.3?}", motor.name),
                good,
            ));
            if way.mode != Mode::Running {
                return rows;
            }
        }
        speed(&mut rig, most as f32);
        rig.wait(2.0 + 2.0 * most / acceleration);
        let goal = here_turns(&rig);
        let way = travel(&mut rig, goal, 4.0 + 20.0 * most / acceleration);
        let good = way.mode == Mode::Running && way.left.abs() < 0.05 && way.shrinks();
        rows.push((format!("{} stop at full speed: {way:.3?}", motor.name), good));
        rows
    });
    judge(&rows.collect::<Vec<_>>());
}

/// Uneven magnets make the measured speed of a heavy rotor swing, which is neither a wrong commutation nor a rotor that is lost.
/// The short form has one rotor, and stops it three times instead of twelve: from each speed, on the way to each.
#[test]
fn a_heavy_rotor_of_uneven_magnets_is_stopped_by_a_position() {
    let motors = motors("paper-heavy drone-heavy");
    let jobs = motors.iter().flat_map(|motor| (1..5).map(move |seed| (*motor, seed)));
    let jobs: Vec<_> = jobs.step_by(sim::of(8, 1)).collect();
    let rows = jobs.par_iter().flat_map_iter(|&(motor, seed)| {
        let magnets = Unevenness { rated_a: motor.limit_a.into(), ..Unevenness::CHEAP };
        let mut plant = motor.plant(seed).with_unevenness(&magnets, seed);
        plant.bus.regenerative = seed % 2 == 0;
        let (mut rig, _) = commissioned(motor, &plant, seed);
        rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
        rig.arm().unwrap();
        let most = rig.control().unwrap().largest_speed_rad_s();
        let mut rows = vec![];
        for k in 0..sim::of(3, 12_u8) {
            let share = [0.25, -0.25, 0.6, -0.6][usize::from(k % 4)];
            speed(&mut rig, share * most);
            rig.wait(3.0);
            speed(&mut rig, [0.0, most, -most][usize::from(k % 3)]);
            rig.wait(0.01 * f64::from(k * 2));
            let from = rig.plant.truth().speed_rad_s;
            let goal = here_turns(&rig);
            go(&mut rig, goal);
            rig.wait(1.0);
            rows.push((
                format!("{} {seed} {k} from {from:.1} of {most:.1}: {:?}", motor.name, rig.drive.mode()),
                rig.drive.mode() == Mode::Running,
            ));
            if rig.drive.mode() != Mode::Running {
                break;
            }
        }
        rows
    });
    judge(&rows.collect::<Vec<_>>());
}

/// The inertia of the settings or three times that, and a supply of the motor's voltage or 0.6 of it: a heavy rotor speeds up
/// and brakes with a third of what is planned for, goes too far, and comes to its goal all the same, by smaller and smaller
/// swings. The short form has two motors.
#[test]
fn a_load_that_the_settings_do_not_know_comes_to_its_goal() {
    let names = sim::of("paper drone-15uh", "paper drone-15uh drone-60a 20mohm 20ohm gimbal-7 slotless");
    let motors = motors(names);
    let jobs: Vec<_> = motors.iter().flat_map(|motor| [(motor, 1.0), (motor, 3.0)]).collect();
    let rows = jobs.par_iter().flat_map_iter(|&(motor, heavier)| {
        let mut plant = on_battery(motor, 5);
        plant.motor.inertia_kgm2 *= heavier;
        let (mut rig, mut settings) = commissioned(motor, &plant, 5);
        let control = settings.control.as_mut().unwrap();
        control.inertia_kgm2 /= heavier as f32;
        control.max_acceleration_rad_s2 *= heavier as f32;
        let acceleration = f64::from(control.max_acceleration_rad_s2);
        let least_v = 1.2 * f64::from(control.guard.under_voltage_v);
        let mut rows = vec![];
        for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
            settings.commutation = commutation;
            rig.configure(&settings).unwrap();
            rig.arm().unwrap();
            let most = f64::from(rig.control().unwrap().largest_speed_rad_s());
            let full = most * most / acceleration / TAU;
            for (volts, turns) in [(1.0, 0.4 * full), (0.6, -1.3 * full)] {
                rig.plant.set_supply((volts * motor.bus_v).max(least_v)).unwrap();
                let goal = here_turns(&rig) + turns;
                let way = travel(&mut rig, goal, 5.0 + 3.0 * turns.abs() * TAU / most + 20.0 * most / acceleration);
                let most_beyond = if heavier > 1.0 { 2.5 * full } else { 0.5 };
                let good = way.mode == Mode::Running && way.left.abs() < 0.05 && way.overshoot() < most_beyond;
                rows.push((
                    format!("{} ×{heavier} {commutation:?} {volts} V, {turns:.1} turns: {way:.2?}", motor.name),
                    good,
                ));
                if way.mode != Mode::Running {
                    return rows;
                }
            }
            rig.command(Command::Disarm).unwrap();
            rig.wait(3.0);
        }
        rows
    });
    judge(&rows.collect::<Vec<_>>());
}

/// A load that comes on the way, as a rope that takes the weight, along the motion and against it; on a supply that takes
/// back what braking returns; by a position, and by a spring. What the motor can hold ends at the goal; by more than its torque the rotor is dragged away, and
/// the bridge is off before it is far: the reference is not taken along for ever.
#[test]
fn a_rotor_that_is_dragged_away_is_not_followed_for_ever() {
    let names = sim::of("hub paper-heavy", "hub paper paper-heavy drone-15uh drone-heavy hoverboard");
    let motors = motors(names);
    let loads = [-1.3, -0.3, 0.3, 1.3].into_iter().flat_map(|load| [(load, false), (load, true)]);
    let jobs: Vec<_> =
        motors.iter().flat_map(|motor| loads.clone().map(move |(load, spring)| (motor, load, spring))).collect();
    let rows = jobs.par_iter().map(|&(motor, load, spring)| {
        let (mut rig, mut settings) = commissioned(motor, &on_battery(motor, 5), 5);
        lift_limits(&mut settings);
        let control = settings.control.unwrap();
        let constant = 1.5 * f64::from(settings.pole_pairs) * f64::from(control.flux_linkage_wb);
        let torque = constant * f64::from(control.max_current_a);
        let (fastest, acceleration) = (f64::from(control.max_speed_rad_s), f64::from(control.max_acceleration_rad_s2));
        rig.configure(&settings).unwrap();
        rig.arm().unwrap();
        let (start, turns) = (here_turns(&rig), (2.0 * fastest * fastest / acceleration / TAU).clamp(2.0, 40.0));
        if spring {
            let request = Request { motion: Motion::to(start + turns), timeout_s: Some(60.0), ..Request::default() };
            let impedance = rig.config.impedance(&request).unwrap();
            rig.command(Command::Impedance(Box::leak(Box::new(impedance)))).unwrap();
        } else {
            go(&mut rig, start + turns);
        }
        while here_turns(&rig) < start + turns / 5.0 {
            rig.wait(0.01);
        }
        rig.plant.set_load(load * torque).unwrap();
        let (mut off, mut farthest) = (false, [0.0_f64; 2]);
        for _ in 0..4000 {
            rig.wait(0.01);
            off |= rig.drive.mode() != Mode::Running;
            if off {
                break;
            }
            let beyond = here_turns(&rig) - start - turns;
            farthest = [farthest[0].min(beyond), farthest[1].max(beyond)];
        }
        let left = here_turns(&rig) - start - turns;
        // Or faster than it may be, before it is so far away.
        let good = match load.abs() < 1.0 {
            // A soft spring gives way.
            true => !off && (spring || left.abs() < 0.05),
            false => off && farthest[0] > -turns && farthest[1] < 3.0,
        };
        let text = format!(
            "{} {load}, spring {spring}: {turns:.1} turns, {:?}, {farthest:.2?} beyond, {left:.2} left",
            motor.name,
            rig.drive.mode()
        );
        (text, good)
    });
    judge(&rows.collect::<Vec<_>>());
}

/// A commanded speed, and a load of more than the motor's torque that turns it the other way, no faster than it may turn.
#[test]
fn a_motor_that_is_dragged_against_its_speed_is_a_following_error() {
    let names = sim::of("hub", "hub hoverboard direct-drive paper gimbal-7");
    let motors = motors(names);
    let rows = motors.par_iter().map(|motor| {
        let (mut rig, mut settings) = commissioned(motor, &on_battery(motor, 5), 5);
        let control = settings.control.as_mut().unwrap();
        control.max_regeneration_a = 1000.0;
        let constant = 1.5 * f64::from(settings.pole_pairs) * f64::from(control.flux_linkage_wb);
        let torque = constant * f64::from(control.max_current_a);
        let (fastest, acceleration) = (f64::from(control.max_speed_rad_s), f64::from(control.max_acceleration_rad_s2));
        rig.configure(&settings).unwrap();
        rig.arm().unwrap();
        speed(&mut rig, (0.5 * fastest) as f32);
        rig.wait(1.0 + fastest / acceleration);
        let mut time_s = 0.0;
        while rig.drive.mode() == Mode::Running && time_s < 20.0 {
            // It falls at 0.9 of the largest speed against all of the motor's torque.
            let share = 1.4 + 0.4 * rig.plant.truth().speed_rad_s / (0.9 * fastest);
            rig.plant.set_load(share * torque).unwrap();
            rig.wait(0.002);
            time_s += 0.002;
        }
        let good = rig.drive.mode() == Mode::Faulted(Fault::FollowingError) && time_s < 4.0;
        (format!("{}: {:?} after {time_s:.2} s", motor.name, rig.drive.mode()), good)
    });
    judge(&rows.collect::<Vec<_>>());
}
