//! Rotors as they are: what uneven magnets do to the angle, and what is left of it with the map of the turn.

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::Statistics;
use anyhow::{Context, Result};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::service::mapping;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::{Rig, error_deg};
use serde::Serialize;
use std::f64::consts::TAU;

/// Mechanical speed at which the angle is judged, rad/s.
const SPEED_RAD_S: f32 = 100.0;

/// A kind of rotor.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// What it is called in the table.
    pub name: &'static str,
    /// What its magnets are drawn from.
    pub unevenness: Unevenness,
    /// Bandwidth of the Halls, Hz.
    pub bandwidth_hz: Option<f64>,
}

/// Every kind of unevenness for itself.
pub fn kinds() -> Vec<Kind> {
    let gain = |gain| Unevenness { gain, ..Unevenness::NONE };
    let pitch = |pitch_deg| Unevenness { pitch_deg, ..Unevenness::NONE };
    let once = |size| Unevenness { modulation: [size, 0.0], ..Unevenness::NONE };
    let second = |size| Unevenness { harmonics: [size, 0.0, 0.0, 0.0, 0.0, 0.0], ..Unevenness::NONE };
    let kind = |name, unevenness| Kind { name, unevenness, bandwidth_hz: None };
    vec![
        kind("even poles", Unevenness::NONE),
        kind("once-per-turn gain up to 3 %", once(0.03)),
        kind("once-per-turn gain up to 10 %", once(0.1)),
        kind("once-per-turn gain up to 20 %", once(0.2)),
        kind("gain from pole to pole ±10 %", gain(0.1)),
        kind("gain from pole to pole ±20 %", gain(0.2)),
        kind("pole pitch ±5°", pitch(5.0)),
        kind("pole pitch ±10°", pitch(10.0)),
        kind("second harmonic up to 3 %", second(0.03)),
        kind("second harmonic up to 5 %", second(0.05)),
        kind("second harmonic up to 10 %", second(0.1)),
        Kind { name: "Halls of 2 kHz bandwidth", unevenness: Unevenness::NONE, bandwidth_hz: Some(2000.0) },
        kind("all of a cheap rotor", Unevenness::CHEAP),
    ]
}

impl Kind {
    /// A motor of this kind.
    pub fn plant(&self, seed: u64) -> PlantParameters {
        // The field of the windings is meant at the largest current.
        let unevenness = Unevenness { rated_a: Control::default().max_current_a.into(), ..self.unevenness };
        let mut plant = PlantParameters::imperfect(seed).with_unevenness(&unevenness, seed);
        for hall in &mut plant.halls {
            hall.bandwidth_hz = self.bandwidth_hz;
        }
        plant
    }
}

/// The settings of the drive: field-oriented, otherwise as they come.
pub fn settings() -> Settings {
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control = Control { guard, ..Control::default() };
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

/// Error of the tracked angle, electrical degrees.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Error {
    /// At constant speed.
    pub steady_deg_rms: f64,
    /// Mean of the same.
    pub mean_deg: f64,
    /// What of it does not come again at the same angle of the shaft: noise, which no map takes off.
    pub noise_deg_rms: f64,
    /// While it reverses and changes its speed, as fast as the settings allow.
    pub reversing_deg_rms: f64,
}

impl Error {
    /// How many times its noise the error is.
    fn times_noise(&self) -> f64 {
        self.steady_deg_rms / self.noise_deg_rms
    }

    /// The same about its mean, which is the alignment's.
    fn times_noise_about_mean(&self) -> f64 {
        (self.steady_deg_rms.powi(2) - self.mean_deg.powi(2)).sqrt() / self.noise_deg_rms
    }
}

/// A calibrated and armed drive at such a motor.
///
/// # Errors
/// A drive that refuses.
pub fn armed(plant: &PlantParameters, seed: u64) -> Result<Rig> {
    let mut rig = Rig::new(plant, &settings(), seed)?;
    rig.calibrate(|_| ())?;
    rig.arm()?;
    Ok(rig)
}

/// A calibrated and armed drive that has learnt the map of its rotor.
///
/// # Errors
/// A drive that refuses.
pub fn mapped(plant: &PlantParameters, seed: u64) -> Result<Rig> {
    let mut rig = Rig::new(plant, &settings(), seed)?;
    rig.calibrate(|_| ())?;
    rig.learn_map(&mapping::Plan::new(&rig.config)?)?;
    rig.arm()?;
    Ok(rig)
}

/// The error while the drive turns steadily.
///
/// # Errors
/// A drive that refuses.
pub fn steady(rig: &mut Rig) -> Result<Error> {
    rig.command(Command::Speed(rig.control()?.speed(SPEED_RAD_S)?))?;
    rig.wait(1.0);
    let mut errors = Statistics::default();
    let mut parts = vec![Statistics::default(); PARTS];
    rig.run(1.0, |rig, period| {
        let error = error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad);
        errors.push(error);
        parts[part(period.truth.mechanical_angle_rad)].push(error);
    });
    let mut reversing = Statistics::default();
    for speed in [-SPEED_RAD_S, SPEED_RAD_S, 0.3 * SPEED_RAD_S, -0.3 * SPEED_RAD_S] {
        rig.command(Command::Speed(rig.control()?.speed(speed)?))?;
        rig.run(0.25, |rig, period| {
            reversing.push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
        });
    }
    // A turn sees each part once, so the mean over so many turns has taken one of them off the noise.
    let turns = f64::from(SPEED_RAD_S) / TAU;
    let noise = parts.iter().map(|part| part.count() * part.variance()).sum::<f64>() / errors.count();
    Ok(Error {
        steady_deg_rms: errors.rms(),
        mean_deg: errors.mean(),
        noise_deg_rms: (noise * turns / (turns - 1.0)).sqrt(),
        reversing_deg_rms: reversing.rms(),
    })
}

/// Parts of the mechanical turn over which its picture takes means.
const PARTS: usize = 360;

/// The part of the turn at an angle of the shaft.
fn part(mechanical_rad: f64) -> usize {
    ((mechanical_rad / TAU).rem_euclid(1.0) * PARTS as f64) as usize % PARTS
}

/// A quantity over the mechanical turn, in degrees, by the mean of each part.
fn over_the_turn(name: &str, rig: &mut Rig, of: impl Fn(&Rig, f64) -> f64) -> Result<Series> {
    rig.command(Command::Speed(rig.control()?.speed(SPEED_RAD_S)?))?;
    rig.wait(1.0);
    let mut parts = vec![Statistics::default(); PARTS];
    rig.run(1.0, |rig, period| {
        parts[part(period.truth.mechanical_angle_rad)].push(of(rig, period.truth.electrical_angle_rad));
    });
    let degrees = |part: usize| (part as f64 + 0.5) * 360.0 / PARTS as f64;
    Ok(Series::new(name, parts.iter().enumerate().map(|(part, mean)| (degrees(part), mean.mean()))))
}

/// The map of a rotor over its turn, beside what it is to correct and what it leaves.
///
/// # Errors
/// A drive that refuses.
pub fn picture(kind: &Kind, seed: u64) -> Result<Plot> {
    let plant = kind.plant(seed);
    let tracked = |rig: &Rig, truth_rad: f64| error_deg(rig.drive.tracker().angle(), truth_rad);
    let before = over_the_turn("error as calibrated", &mut armed(&plant, seed)?, tracked)?;
    let mut rig = Rig::new(&plant, &settings(), seed)?;
    rig.calibrate(|_| ())?;
    let map = rig.learn_map(&mapping::Plan::new(&rig.config)?)?;
    rig.arm()?;
    let after = over_the_turn("error with the map", &mut rig, tracked)?;
    let learnt = |rig: &Rig, _| f64::from(map.error(rig.drive.tracker().position()).to_degrees());
    let learnt = over_the_turn("the map that was learnt", &mut rig, learnt)?;
    let title = format!("The map of a rotor: {}", kind.name);
    Ok(Plot::new(&title, "angle of the shaft / °", "angle / ° electrical", vec![before, learnt, after]))
}

/// The figures of `magnets --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Kind of rotor.
    pub name: &'static str,
    /// Of each rotor.
    pub rotors: Vec<Error>,
    /// The same with the map.
    pub mapped: Vec<Error>,
}

impl Row {
    fn cells(&self) -> Vec<String> {
        let over = |rotors: &[Error], of: fn(&Error) -> f64| rotors.iter().map(of).collect::<Statistics>();
        let value = |degrees: f64| format!("{degrees:.2}");
        let of = |rotors: &[Error]| {
            let [steady, reversing] =
                [over(rotors, |error| error.steady_deg_rms), over(rotors, |error| error.reversing_deg_rms)];
            [value(steady.rms()), value(steady.max_abs()), value(reversing.rms()), value(reversing.max_abs())]
        };
        let times = [Error::times_noise, Error::times_noise_about_mean].map(|times| {
            let times = over(&self.mapped, times);
            [value(times.mean()), value(times.max_abs())]
        });
        [vec![self.name.into()], of(&self.rotors).to_vec(), of(&self.mapped).to_vec(), times.concat()].concat()
    }
}

/// Kinds of which the page shows a rotor's map.
const PICTURED: [&str; 3] = ["all of a cheap rotor", "pole pitch ±10°", "second harmonic up to 5 %"];
const CAPTION: &str = "One rotor at 100 rad/s over a mechanical turn: how far the tracked angle is ahead of the rotor \
                       without a map, what the drive has learnt of that without an encoder, and what is left with it.";

/// Options of `magnets`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Rotors of each kind
    #[arg(long, default_value_t = 20)]
    rotors: u64,
    /// Only the kinds whose name contains this
    #[arg(long)]
    kind: Option<String>,
}

/// `magnets`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let seeds = options.common.seed..options.common.seed + options.rotors;
    let is_chosen = |kind: &Kind| options.kind.as_ref().is_none_or(|name| kind.name.contains(name));
    let chosen: Vec<Kind> = kinds().into_iter().filter(is_chosen).collect();
    let rows: Vec<Row> = chosen.iter().map(|kind| measure(kind, seeds.clone())).collect::<Result<_>>()?;
    println!("Error of the tracked angle at uneven magnets, electrical degrees RMS, {} rotors each:\n", options.rotors);
    let title = [
        "",
        "steady",
        "worst",
        "changing",
        "worst",
        "map: steady",
        "worst",
        "changing",
        "worst",
        "over noise",
        "worst",
        "about mean",
        "worst",
    ]
    .map(String::from)
    .to_vec();
    let table: Vec<_> = std::iter::once(title).chain(rows.iter().map(Row::cells)).collect();
    print_table(&table);
    println!();
    let mut report = Report::new("Uneven magnets");
    report.lead(
        "No two magnets of a rotor are alike, and the angle suffers. A map of the whole turn, learnt without an encoder, \
         takes nearly all of it off.",
    );
    for kind in chosen.iter().filter(|kind| PICTURED.contains(&kind.name)) {
        report.plot(&picture(kind, options.common.seed)?, CAPTION)?;
    }
    report.heading("All kinds of rotors");
    report.text(
        "Error of the tracked angle, electrical degrees RMS, as calibrated and with the map: at a steady speed, and while \
         the speed changes; of all rotors of a kind, and of the worst. Then how many times its own noise the steady one \
         is, which no map takes off, and the same about its mean, which is the alignment's.",
    );
    options.common.finish("magnets", &rows, report.table(&table))
}

/// Measures rotors of a kind.
///
/// # Errors
/// A drive that refuses.
pub fn measure(kind: &Kind, seeds: std::ops::Range<u64>) -> Result<Row> {
    let rotor = |seed| steady(&mut armed(&kind.plant(seed), seed)?);
    let mapped = |seed| {
        let error = mapped(&kind.plant(seed), seed).and_then(|mut rig| steady(&mut rig));
        error.with_context(|| format!("{}, seed {seed}", kind.name))
    };
    Ok(Row {
        name: kind.name,
        rotors: seeds.clone().into_par_iter().map(rotor).collect::<Result<_>>()?,
        mapped: seeds.into_par_iter().map(mapped).collect::<Result<_>>()?,
    })
}
