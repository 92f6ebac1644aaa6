//! What a lost Hall does while the drive runs on the other two: it gets stuck where it is as the motor turns slowly, it
//! wanders, heals, or is lost among bad samples.

use crate::commissioned::{commissioned, here_turns, lift_limits, on_battery};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use plant::{HallFault, PlantParameters};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};
use std::f64::consts::TAU;

/// Its magnets are too uneven for a calibration without a map.
const UNEVEN: &str = "gimbal-11";

/// The ADC's full scale, V.
const REFERENCE_V: f64 = 3.3;

struct Found {
    mode: Mode,
    /// What the drive counts more than the rotor has turned since, electrical turns.
    slipped: f64,
    /// Mean speed in the last of four seconds, share of the one that was asked for.
    speed: f64,
}

/// The motors, every so many in the short form.
fn motors(step: usize) -> impl ParallelIterator<Item = &'static Motor> {
    MOTORS.iter().filter(|motor| motor.name != UNEVEN).step_by(sim::of(step, 1)).par_bridge()
}

/// A motor, and the settings of a drive that has commissioned it and may run on two Halls.
fn on_two_halls(motor: &Motor) -> (PlantParameters, Settings) {
    let plant = on_battery(motor, 5);
    let (_, mut settings) = commissioned(motor, &plant, 5);
    settings.commutation = Commutation::FieldOriented;
    settings.run_on_two_halls = true;
    lift_limits(&mut settings);
    (plant, settings)
}

/// What the drive counts more than the rotor has turned, electrical turns.
fn ahead(rig: &Rig) -> f64 {
    let turns = rig.plant.truth().mechanical_angle_rad / TAU * f64::from(rig.config.pole_pairs.get());
    rig.drive.tracker().position().to_turns() - turns
}

/// At a speed, as a share of the largest, or at rest in its position. Other noise by seed.
fn turning(plant: &PlantParameters, settings: &Settings, seed: u64, share: f64) -> (Rig, f64) {
    let mut rig = Rig::new(plant, settings, 100 + seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.arm().unwrap();
    let asked = share * f64::from(settings.control.unwrap().max_speed_rad_s);
    let control = rig.control().unwrap();
    let here = here_turns(&rig);
    rig.command(if share == 0.0 {
        Command::Position(control.position(here).unwrap())
    } else {
        Command::Speed(control.speed(asked as f32).unwrap())
    })
    .unwrap();
    rig.wait(1.0 + 0.0137 * seed as f64);
    (rig, asked)
}

/// Four seconds with what has happened.
fn see(mut rig: Rig, asked: f64) -> Found {
    let before = ahead(&rig);
    rig.wait(3.0);
    let (mut sum, mut count) = (0.0, 0.0);
    rig.run(1.0, |_, period| {
        sum += period.truth.speed_rad_s;
        count += 1.0;
    });
    Found { mode: rig.drive.mode(), slipped: ahead(&rig) - before, speed: sum / count / asked }
}

/// Other Halls by seed.
fn stuck(plant: &PlantParameters, settings: &Settings, seed: u64, share: f64) -> Found {
    let (mut rig, asked) = turning(plant, settings, seed, share);
    let sensor = (seed % 3) as usize;
    let code = f64::from(rig.step().sample.halls[sensor]);
    let full = f64::from(1_u32 << settings.adc_bits);
    rig.plant.set_hall_fault(sensor, Some(HallFault::StuckAt(code / full * REFERENCE_V)));
    see(rig, asked)
}

/// It goes on at its speed and has lost no turn, or it stops by a fault. Which Hall is lost does not show at once: one
/// drive in eleven took a wrong one first, and lost a turn when it found that out. The short form has three motors.
#[test]
fn a_hall_that_gets_stuck_costs_no_turn() {
    let rows = motors(7).flat_map(|motor| {
        let (plant, settings) = on_two_halls(motor);
        (0..sim::of(6, 12)).into_par_iter().map(move |seed| {
            let share = [0.02, -0.05, 0.1, -0.2, 0.15, -0.03, 0.07][seed as usize % 7];
            (motor.name, seed, share, stuck(&plant, &settings, seed, share))
        })
    });
    let rows: Vec<_> = rows.collect();
    let (mut on, mut bad) = (0, 0);
    for (name, seed, share, Found { mode, slipped, speed }) in &rows {
        let runs = *mode == Mode::Running;
        let good = runs && slipped.abs() < 0.3 && *speed > 0.7;
        on += usize::from(good);
        bad += u32::from(runs && !good);
        if !good {
            println!("{name} {seed} at {share}: {mode:?}, {slipped:.2} electrical turns, {speed:.2} of its speed");
        }
    }
    println!("{on} of {} go on", rows.len());
    assert_eq!(bad, 0);
    assert!(on > rows.len() * 4 / 5, "{on} of {}", rows.len());
}

/// Its wire breaks, and the input then floats about: slowly through where a healthy one would be.
#[test]
fn a_lost_hall_that_wanders_moves_no_rotor_at_rest() {
    motors(7).for_each(|motor| {
        let (plant, settings) = on_two_halls(motor);
        for seed in 0..sim::of(2, 3) {
            let (mut rig, _) = turning(&plant, &settings, seed, 0.0);
            let sensor = (seed % 3) as usize;
            let hall = plant.halls[sensor];
            let to_codes = f64::from(1_u32 << settings.adc_bits) / REFERENCE_V;
            let mut t = 0.0;
            rig.disturb = Some(Box::new(move |sample| {
                t += 1.0 / 40e3;
                let far = hall.amplitude_v * (TAU * 0.4 * t).sin();
                sample.halls[sensor] = if t < 0.05 { 0 } else { ((hall.offset_v + far) * to_codes) as u16 };
            }));
            let (pairs, start) = (f64::from(motor.pairs), rig.plant.truth().mechanical_angle_rad);
            let mut farthest = 0.0_f64;
            rig.run(4.0, |_, period| {
                let moved = (period.truth.mechanical_angle_rad - start) * pairs;
                farthest = farthest.max(moved.to_degrees().abs());
            });
            assert_eq!(rig.drive.mode(), Mode::Running, "{} {seed}", motor.name);
            // One of 21 goes by 28°, as heavy as a person; the others by 12° at most.
            assert!(farthest < 30.0, "{} {seed}: {farthest}° electrical", motor.name);
        }
    });
}

/// A contact that opens for a while. What a pair with that Hall in it has counted is of no use when another is lost.
#[test]
fn a_hall_that_heals_costs_no_turn_when_another_is_lost() {
    motors(7).for_each(|motor| {
        let (plant, settings) = on_two_halls(motor);
        for seed in 0..sim::of(2, 3) {
            let (mut rig, asked) = turning(&plant, &settings, seed, [0.1, -0.05, 0.2][seed as usize]);
            let mut step = 0;
            rig.disturb = Some(Box::new(move |sample| {
                step += 1;
                let lost = if step < 12_000 { Some(seed) } else { (step > 60_000).then_some(seed + 1) };
                if let Some(lost) = lost {
                    sample.halls[(lost % 3) as usize] = 0;
                }
            }));
            let Found { mode, slipped, speed } = see(rig, asked);
            let what = format!("{} {seed}: {slipped:.2} electrical turns, {speed:.2} of its speed", motor.name);
            assert_eq!(mode, Mode::Running, "{what}");
            assert!(slipped.abs() < 0.3 && speed > 0.7, "{what}");
        }
    });
}

/// One in a hundred of each Hall's samples is any code, as fast as the motor turns. It may stop by a fault: then it
/// coasts uncounted.
#[test]
fn bad_samples_after_a_loss_cost_no_turn() {
    motors(7).for_each(|motor| {
        let (plant, settings) = on_two_halls(motor);
        for seed in 0..sim::of(2, 3) {
            let (mut rig, asked) = turning(&plant, &settings, seed, [1.0, -1.0, 0.5][seed as usize]);
            let mut random = Pcg64::seed_from_u64(seed);
            rig.disturb = Some(Box::new(move |sample| {
                for (k, code) in (0..).zip(&mut sample.halls) {
                    if k == seed % 3 {
                        *code = 0;
                    } else if random.random_bool(0.01) {
                        *code = random.random_range(0..4096);
                    }
                }
            }));
            let Found { mode, slipped, speed } = see(rig, asked);
            let good = mode != Mode::Running || slipped.abs() < 0.3;
            assert!(good, "{} {seed}: {mode:?}, {slipped:.2} electrical turns, {speed:.2}", motor.name);
        }
    });
}
