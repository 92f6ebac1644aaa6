//! Motors whose magnets differ: the ripple of a low speed without a table against cogging, with one that is alike at all
//! poles, and with all of it; and after a power-up, until the pole is found.

use super::OfMotors;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::Statistics;
use anyhow::{Context, Result, anyhow};
use hallservo::angle::PolePairs;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::service::learning::Plan;
use hallservo::turn::{Table, Use};
use plant::Cogging;
use rayon::prelude::*;
use rig::Rig;
use rig::commissioning::{Bench, commission};
use rig::motors::{MOTORS, Motor};
use serde::Serialize;
use std::f64::consts::TAU;

/// Speed at which the ripple is judged, and the one at which the pole is looked for, turns a second.
pub const SPEEDS_HZ: [f64; 2] = [0.5, 1.0];
/// Cogging by the slots, as a share of that by the poles.
pub const SHARE: f64 = 0.5;
/// Longest search for the pole, in turns.
const LONGEST_TURNS: f64 = 64.0;
/// Points of a curve.
const POINTS: usize = 720;

/// Slots that a motor of so many pole pairs has: a magnet that is stronger than the others cogs so often in a turn.
pub fn slots(pole_pairs: u8) -> Option<u16> {
    [(4, 9), (7, 12), (11, 24), (15, 27), (21, 36), (22, 48)]
        .into_iter()
        .find_map(|(pairs, slots)| (pairs == pole_pairs).then_some(slots))
}

/// Motors that have slots and magnets that cog.
pub fn motors() -> Vec<&'static Motor> {
    MOTORS.iter().filter(|motor| motor.cogging > 0.0 && slots(motor.pairs).is_some()).collect()
}

/// A motor commissioned by itself, whose magnets differ.
///
/// # Errors
/// What failed.
pub fn commissioned(motor: &Motor, slots: u16, share: f64, seed: u64) -> Result<Rig> {
    let mut plant = motor.plant(seed);
    let amplitude_nm = share * plant.motor.cogging[0].amplitude_nm;
    plant.motor.cogging[1] = Cogging { amplitude_nm, cycles_per_turn: slots, phase_rad: seed as f64 };
    let mut bench = Bench::new(Rig::new(&plant, &motor.settings(), seed)?);
    commission(&mut bench, motor.settings(), motor.limit_a).map_err(|why| anyhow!("{}: {why}", motor.name))?;
    Ok(bench.rig)
}

/// Turns at a speed in turns a second for a time, armed at first where the bridge is off.
///
/// # Errors
/// A drive that refuses.
pub fn turn(rig: &mut Rig, hz: f64, seconds: f64) -> Result<()> {
    if rig.drive.mode() != Mode::Running {
        rig.command(Command::Commutate(Commutation::FieldOriented))?;
        rig.arm()?;
    }
    rig.command(Command::Speed(rig.control()?.speed((TAU * hz) as f32)?))?;
    rig.wait(seconds);
    Ok(())
}

/// The true speed over two turns: the RMS of its deviation in per cent of the mean, and a curve over the turn.
///
/// # Errors
/// A drive that refuses.
pub fn ripple(rig: &mut Rig, hz: f64) -> Result<(f64, Vec<(f64, f64)>)> {
    turn(rig, hz, 1.5)?;
    let mut speeds = Statistics::default();
    let mut curve = vec![Statistics::default(); POINTS];
    rig.run(2.0 / hz, |_, period| {
        let share = (period.truth.mechanical_angle_rad / TAU).rem_euclid(1.0);
        speeds.push(period.truth.speed_rad_s);
        curve[(share * POINTS as f64) as usize % POINTS].push(period.truth.speed_rad_s);
    });
    let mean = speeds.mean();
    let deviation = (speeds.rms().powi(2) - mean * mean).max(0.0).sqrt();
    let curve = curve.iter().enumerate().filter(|(_, speeds)| speeds.mean().is_finite());
    let curve = curve.map(|(k, speeds)| (360.0 * k as f64 / POINTS as f64, speeds.mean() / mean)).collect();
    Ok((100.0 * deviation / mean.abs(), curve))
}

/// At rest, the bridge off.
///
/// # Errors
/// A drive that refuses.
pub fn stop(rig: &mut Rig) -> Result<()> {
    turn(rig, 0.0, 1.0)?;
    rig.command(Command::Disarm)?;
    rig.wait(0.2);
    Ok(())
}

/// As after a power-up, from which on the drive counts its turns from another pole: where that is, in electrical turns
/// from the one before.
pub fn forget_pole(rig: &mut Rig) -> Option<i32> {
    let table = *rig.by_pole.table()?;
    let pairs = usize::from(table.pole_pairs());
    let begin = pairs / 2 + 1;
    let (before, after) = table.points().split_at(begin * table.points().len() / pairs);
    let points: Vec<i16> = after.iter().chain(before).copied().collect();
    rig.by_pole.set(Table::of_points(PolePairs::new(table.pole_pairs())?, points.into_iter()));
    Some(begin as i32)
}

/// Turns until the pole is found; after how many turns.
///
/// # Errors
/// A drive that refuses.
pub fn find_pole(rig: &mut Rig) -> Result<Option<f64>> {
    let begun = rig.plant.truth().mechanical_angle_rad;
    loop {
        turn(rig, SPEEDS_HZ[1], 0.05)?;
        let turns = (rig.plant.truth().mechanical_angle_rad - begun).abs() / TAU;
        if rig.by_pole.state() == Use::Used {
            return Ok(Some(turns));
        }
        if turns > LONGEST_TURNS {
            return Ok(None);
        }
    }
}

/// A motor.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Its name.
    pub motor: &'static str,
    /// Pole pairs.
    pub pole_pairs: u8,
    /// Slots.
    pub slots: u16,
    /// RMS of the speed's deviation without anything against cogging, per cent.
    pub without_pct: f64,
    /// With the table that is alike at all poles, as after a power-up.
    pub alike_pct: f64,
    /// With all that was learnt.
    pub learnt_pct: f64,
    /// Whether something that differs from pole to pole stood out.
    pub differs: bool,
    /// Turns until the pole is found after a power-up, if it is.
    pub found_turns: Option<f64>,
    /// Whether that is the right one, or one that is alike.
    pub found_right: bool,
    /// With all that was learnt, the pole found.
    pub found_pct: f64,
    /// The speed over its mean, over the turn in degrees: without, alike, and all.
    #[serde(skip)]
    pub curves: [Vec<(f64, f64)>; 3],
}

/// Commissions a motor, learns its cogging, and forgets and finds its pole.
///
/// # Errors
/// A drive that refuses.
pub fn trial(motor: &Motor, seed: u64) -> Result<Trial> {
    let slots = slots(motor.pairs).context("a motor with slots")?;
    let mut rig = commissioned(motor, slots, SHARE, seed)?;
    let (without_pct, without) = ripple(&mut rig, SPEEDS_HZ[0])?;
    stop(&mut rig)?;
    rig.learn(&Plan::new(&rig.config)?)?;
    let (learnt_pct, learnt) = ripple(&mut rig, SPEEDS_HZ[0])?;
    let table = rig.by_pole.table().copied();
    let begin = forget_pole(&mut rig);
    rig.wait(0.1);
    let (alike_pct, alike) = ripple(&mut rig, SPEEDS_HZ[0])?;
    // What it has turned so far is no part of the search.
    let moved = rig.by_pole.table().copied();
    rig.by_pole.set(moved);
    let found_turns = if begin.is_some() { find_pole(&mut rig)? } else { None };
    let (found_pct, _) = ripple(&mut rig, SPEEDS_HZ[0])?;
    let found_right = match (table, begin, rig.by_pole.pole()) {
        (Some(table), Some(begin), Some(pole)) => table.difference(pole + begin) <= 0.05 * table.square(),
        _ => false,
    };
    let (motor, pole_pairs, differs) = (motor.name, motor.pairs, table.is_some());
    let curves = [without, alike, learnt];
    Ok(Trial {
        motor,
        pole_pairs,
        slots,
        without_pct,
        alike_pct,
        learnt_pct,
        differs,
        found_turns,
        found_right,
        found_pct,
        curves,
    })
}

/// Trials of motors, in their order.
///
/// # Errors
/// A drive that refuses.
pub fn trials(motors: &[&Motor], seed: u64) -> Result<Vec<Trial>> {
    motors.par_iter().map(|motor| trial(motor, seed).with_context(|| motor.name)).collect()
}

impl Trial {
    fn row(&self) -> Vec<String> {
        let pct = |value: f64| format!("{value:.2} %");
        vec![
            self.motor.into(),
            format!("{} / {}", self.pole_pairs, self.slots),
            pct(self.without_pct),
            pct(self.alike_pct),
            pct(self.learnt_pct),
            format!("{:.1}", self.without_pct / self.learnt_pct),
            match self.found_turns {
                Some(turns) => format!("{turns:.1} turns"),
                None if self.differs => format!("not in {LONGEST_TURNS} turns"),
                None => "nothing stands out".into(),
            },
            pct(self.found_pct),
        ]
    }
}

/// `cogging`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses.
pub fn main(options: &OfMotors) -> Result<()> {
    options.common.prepare()?;
    let mut motors = motors();
    motors.retain(|motor| options.has(motor));
    let trials = trials(&motors, options.common.seed)?;
    let rough =
        trials.iter().max_by(|a, b| a.without_pct.total_cmp(&b.without_pct)).context("no motor has this name")?;
    println!("Ripple of the speed at {} turns a second, RMS of its deviation over the mean:\n", SPEEDS_HZ[0]);
    let head = [
        "motor",
        "pole pairs / slots",
        "without",
        "same at all poles",
        "with all of it",
        "times less",
        "pole found after",
        "ripple then",
    ];
    let table: Vec<_> = std::iter::once(head.map(String::from).into()).chain(trials.iter().map(Trial::row)).collect();
    print_table(&table);
    println!();
    let mut report = Report::new("Cogging");
    report.lead(&format!(
        "Motors commissioned by the drive alone, whose magnets differ: beside the cogging that repeats with the poles, half \
         as much repeats with the slots. The drive learns both while it turns slowly. After a power-up it uses what is \
         alike at all poles, until the current that the rest takes, turning with {} turn a second, has shown its pole.",
        SPEEDS_HZ[1]
    ));
    let names = ["without", "with what is alike at all poles", "with all of it"];
    let series = names.iter().zip(&rough.curves).map(|(name, curve)| Series::new(*name, curve.iter().copied()));
    report.plot(
        &Plot::new(
            &format!("Speed over a turn, {}", rough.motor),
            "mechanical angle / °",
            "speed / its mean",
            series.collect(),
        ),
        "The motor with the most cogging: two turns averaged.",
    )?;
    report.heading("Ripple of the speed");
    report.text(&format!(
        "RMS of the true speed's deviation over its mean, at {} turns a second. Where little is left, it is the noise of the \
         Halls, which the speed control follows.",
        SPEEDS_HZ[0]
    ));
    report.table(&table);
    options.common.finish("cogging", &trials, &report)
}
