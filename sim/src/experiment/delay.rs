//! Halls whose signals are late: their delay as the drive measures it, and the tracked angle before and after.

use super::{Common, magnets};
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::Statistics;
use anyhow::{Context, Result};
use hallservo::drive::Command;
use hallservo::service::{identification, mapping};
use hallservo::settings::{Control, Settings};
use plant::{Noise, PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::{Rig, error_deg};
use serde::Serialize;
use std::f64::consts::TAU;

/// Mechanical speeds at which the angle is judged, rad/s; the motor has four pole pairs.
pub const SPEEDS_RAD_S: [f32; 4] = [25.0, 100.0, 200.0, 400.0];
/// How much the sensors of a motor differ from each other at most, as a share.
const APART: f64 = 0.2;

/// What makes the sensors late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Late {
    /// Nothing.
    Not,
    /// A first-order low pass, Hz.
    LowPass(f64),
    /// A delay of the whole signal, µs.
    Delay(f64),
}

impl Late {
    /// Those of the table.
    pub const ALL: [Self; 8] = [
        Self::Not,
        Self::LowPass(1e3),
        Self::LowPass(2e3),
        Self::LowPass(5e3),
        Self::LowPass(1e4),
        Self::Delay(10.0),
        Self::Delay(25.0),
        Self::Delay(50.0),
    ];

    /// What it is called in the table.
    pub fn name(self) -> String {
        match self {
            Self::Not => "not late".into(),
            Self::LowPass(hz) => format!("low pass of {} kHz", hz / 1e3),
            Self::Delay(us) => format!("{us} µs late"),
        }
    }

    /// A motor with such sensors, and the mean of their delays in µs.
    pub fn plant(self, unevenness: &Unevenness, seed: u64) -> (PlantParameters, f64) {
        let unevenness = Unevenness { rated_a: Control::default().max_current_a.into(), ..*unevenness };
        let mut plant = PlantParameters::imperfect(seed).with_unevenness(&unevenness, seed);
        let mut random = Noise::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let mut sum_us = 0.0;
        for hall in &mut plant.halls {
            let share = 1.0 + APART * random.uniform();
            match self {
                Self::Not => {}
                Self::LowPass(hz) => {
                    hall.bandwidth_hz = Some(hz / share);
                    sum_us += share * 1e6 / TAU / hz;
                }
                Self::Delay(us) => {
                    hall.delay_s = share * us * 1e-6;
                    sum_us += share * us;
                }
            }
        }
        (plant, sum_us / 3.0)
    }
}

/// Error of the tracked angle at a speed, electrical degrees.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Error {
    /// Root of the mean square.
    pub rms_deg: f64,
    /// Mean.
    pub mean_deg: f64,
}

/// A motor.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Trial {
    /// Mean delay of the sensors, µs.
    pub true_us: f64,
    /// As measured.
    pub found_us: f64,
    /// What that may be off by.
    pub error_us: f64,
    /// Error at each of [`SPEEDS_RAD_S`], uncompensated.
    pub before: [Error; 4],
    /// With the delay that was measured.
    pub after: [Error; 4],
}

/// The errors at all speeds, of a calibrated drive whose bridge is off.
///
/// # Errors
/// A drive that refuses.
pub fn errors(rig: &mut Rig) -> Result<[Error; 4]> {
    rig.arm()?;
    let mut all = [Error::default(); 4];
    for (error, speed) in all.iter_mut().zip(SPEEDS_RAD_S) {
        rig.command(Command::Speed(rig.control()?.speed(speed)?))?;
        rig.wait(0.4);
        let mut errors = Statistics::default();
        rig.run(0.5, |rig, period| {
            errors.push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
        });
        *error = Error { rms_deg: errors.rms(), mean_deg: errors.mean() };
    }
    rig.command(Command::Speed(rig.control()?.speed(0.0)?))?;
    rig.wait(0.3);
    rig.command(Command::Disarm)?;
    Ok(all)
}

/// Measures a motor's delay, and its angle before and after; with the map of its magnets in effect, if it `maps`.
///
/// # Errors
/// A drive that refuses.
pub fn trial(late: Late, unevenness: &Unevenness, maps: bool, seed: u64) -> Result<Trial> {
    let (plant, true_us) = late.plant(unevenness, seed);
    let mut settings = magnets::settings();
    let mut rig = Rig::new(&plant, &settings, seed)?;
    rig.calibrate(|_| ())?;
    if maps {
        rig.learn_map(&mapping::Plan::new(&rig.config)?)?;
    }
    let before = errors(&mut rig)?;
    let report = rig.identify(&identification::Plan::new(&rig.config)?)?;
    let delay = report.hall_delay_us;
    let hall_delay_us = delay.value.clamp(-20.0, 200.0);
    settings.control = settings.control.map(|control| Control { hall_delay_us, ..control });
    rig.configure(&Settings { ..settings })?;
    let after = errors(&mut rig)?;
    Ok(Trial { true_us, found_us: delay.value.into(), error_us: delay.error.into(), before, after })
}

/// The trials of a kind of sensor.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What makes the sensors late.
    pub name: String,
    /// Of each motor.
    pub trials: Vec<Trial>,
}

impl Row {
    /// Trials with motors of seeds.
    ///
    /// # Errors
    /// A drive that refuses.
    pub fn new(late: Late, unevenness: &Unevenness, maps: bool, seeds: std::ops::Range<u64>) -> Result<Self> {
        let trial = |seed| trial(late, unevenness, maps, seed).with_context(|| format!("{}, seed {seed}", late.name()));
        Ok(Self { name: late.name(), trials: seeds.into_par_iter().map(trial).collect::<Result<_>>()? })
    }

    /// Share of the trials whose delay is within what it may be off by.
    pub fn inside(&self) -> f64 {
        let inside = self.trials.iter().filter(|trial| (trial.found_us - trial.true_us).abs() <= trial.error_us);
        inside.count() as f64 / self.trials.len() as f64
    }

    /// Largest error of the delay, µs.
    pub fn worst_us(&self) -> f64 {
        self.trials.iter().map(|trial| (trial.found_us - trial.true_us).abs()).fold(0.0, f64::max)
    }

    /// Root mean square of the angle's error over all motors at a speed, and that of the worst.
    fn rms_deg(&self, errors: fn(&Trial) -> &[Error; 4], speed: usize) -> (f64, f64) {
        let rms: Statistics = self.trials.iter().map(|trial| errors(trial)[speed].rms_deg).collect();
        (rms.rms(), rms.max_abs())
    }

    /// Its row in the table of angles.
    fn angles(&self) -> Vec<String> {
        let of = |errors, speed| {
            let (rms, worst) = self.rms_deg(errors, speed);
            format!("{rms:.2} ({worst:.2})")
        };
        let speeds = 1..SPEEDS_RAD_S.len();
        let cells = speeds.flat_map(|speed| [of(|trial| &trial.before, speed), of(|trial| &trial.after, speed)]);
        std::iter::once(self.name.clone()).chain(cells).collect()
    }

    /// Its row in the table of delays.
    fn delays(&self) -> Vec<String> {
        let stated: Statistics = self.trials.iter().map(|trial| trial.error_us).collect();
        vec![
            self.name.clone(),
            format!("{:.1}", self.worst_us()),
            format!("{:.1}", stated.mean()),
            format!("{:.0} %", 100.0 * self.inside()),
        ]
    }
}

/// The error over the speed, a curve for each kind.
fn diagram(rows: &[Row]) -> Plot {
    let curves = |name: &'static str, errors: fn(&Trial) -> &[Error; 4]| {
        rows.iter().map(move |row| {
            let speeds = SPEEDS_RAD_S.iter().enumerate();
            Series::new(name, speeds.map(|(k, speed)| (f64::from(*speed), row.rms_deg(errors, k).0)))
        })
    };
    let as_calibrated = curves("as calibrated", |trial| &trial.before);
    let series = as_calibrated.chain(curves("with the delay set", |trial| &trial.after)).collect();
    Plot::new("Error of the angle over the speed", "speed / rad/s", "error / ° electrical, RMS", series).logarithmic()
}

/// Options of `delay`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Motors of each kind
    #[arg(long, default_value_t = 50)]
    motors: u64,
    /// With all poles alike
    #[arg(long)]
    even: bool,
    /// Without the map of the magnets
    #[arg(long)]
    without_map: bool,
    /// Only the kinds whose name contains this
    #[arg(long)]
    kind: Option<String>,
}

/// `delay`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let seeds = options.common.seed..options.common.seed + options.motors;
    let unevenness = if options.even { Unevenness::NONE } else { Unevenness::CHEAP };
    let chosen =
        Late::ALL.into_iter().filter(|late| options.kind.as_ref().is_none_or(|kind| late.name().contains(kind)));
    let rows: Vec<Row> =
        chosen.map(|late| Row::new(late, &unevenness, !options.without_map, seeds.clone())).collect::<Result<_>>()?;
    println!(
        "Error of the tracked angle, electrical degrees RMS (worst motor), {} motors each, ±20 % from Hall to Hall:\n",
        options.motors
    );
    let speeds = SPEEDS_RAD_S.iter().skip(1).flat_map(|speed| [format!("{speed} rad/s"), "delay set".into()]);
    let table = |head: Vec<String>, cells: fn(&Row) -> Vec<String>| -> Vec<Vec<String>> {
        std::iter::once(head).chain(rows.iter().map(cells)).collect()
    };
    let angles = table(std::iter::once("Halls".into()).chain(speeds).collect(), Row::angles);
    let delays =
        table(["Halls", "off by at most / µs", "± stated / µs", "within that"].map(String::from).into(), Row::delays);
    print_table(&angles);
    println!();
    print_table(&delays);
    println!();
    let mut report = Report::new("Late Halls");
    report.lead(
        "Filters and the sensors' own bandwidth make the Halls' signals late. The drive measures the delay against the \
         back-EMF while it turns its motor both ways, and takes it off at every speed.",
    );
    report.plot(&diagram(&rows), "A curve for each kind of Halls: of all its motors, before and after.")?;
    report.heading("Error of the tracked angle");
    report.text(&format!(
        "Electrical degrees RMS, in brackets those of the worst motor; {} motors of each kind, whose Halls differ from \
         one another by up to 20 % of the delay.",
        options.motors
    ));
    report.table(&angles).heading("The delay as it was measured");
    report
        .text("By how much it is off, what the drive says that it may be off by, and in how many trials it is within.");
    report.table(&delays);
    options.common.finish("delay", &rows, &report)
}
