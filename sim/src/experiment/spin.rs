//! Calibrates an imperfect motor and turns it through start, reversal, slow and fast.

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::{ByAngle, Statistics};
use anyhow::Result;
use baseline::halls::{Normalizer, Signal, single_sensor};
use hallservo::angle::ElectricalAngle;
use hallservo::drive::Command;
use hallservo::hall::Channel;
use hallservo::hall::calibrate::Calibration;
use hallservo::settings::Settings;
use hallservo::trig;
use indicatif::{ProgressBar, ProgressStyle};
use plant::PlantParameters;
use rig::{Period, Rig, error_deg};
use serde::Serialize;
use std::f64::consts::TAU;

/// The figures of `spin --json`. Angles are electrical degrees.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Summary {
    /// Seed of the motor and its noise.
    pub seed: u64,
    /// Arcsine of one sensor with the data sheet's offset and amplitude, less its mean: Simpkins and Todorov, eq. (5).
    pub raw_error_deg_rms: f64,
    /// Calibrated angle of single samples, without tracking.
    pub angle_error_deg_rms: f64,
    /// Largest of these errors.
    pub angle_error_deg_max: f64,
    /// Their mean: the error of the alignment.
    pub angle_bias_deg: f64,
    /// Largest mean in any of 36 parts of the turn: what calibration leaves of harmonics and placement.
    pub angle_bias_worst_deg: f64,
    /// Tracked angle at constant speed.
    pub tracked_error_deg_rms: f64,
    /// Tracked angle throughout, acceleration and reversal included.
    pub tracked_error_all_deg_rms: f64,
    /// Cramér–Rao bound for three well-placed sensors with one per cent of noise, √(2/3) · 1 %.
    pub crlb_deg: f64,
    /// The bound for this motor's own placements and harmonics.
    pub crlb_placed_deg: f64,
    /// Electrical turns that the turn counter lost or gained.
    pub turns_lost: i64,
    /// Electrical turns made, both directions.
    pub turns_made: f64,
    /// Largest speed, electrical.
    pub fastest_hz: f64,
}

/// Modulation and duration of each part of the run.
const SCRIPT: [(&str, f64, f64); 5] =
    [("start", 0.2, 0.5), ("reversal", -0.25, 0.5), ("slow", 0.06, 0.7), ("fast", 0.9, 0.7), ("stop", 0.0, 0.3)];

/// A run and everything seen of it.
pub struct Run {
    /// What the calibration found.
    pub calibration: Calibration,
    /// The figures.
    pub summary: Summary,
    trace: Vec<Row>,
    by_angle: ByAngle,
}

/// What is plotted of a period.
#[derive(Clone, Copy, Debug)]
struct Row {
    period: Period,
    raw_deg: f64,
    angle_deg: f64,
    tracked_deg: f64,
    part: usize,
    /// Whether the speed hardly changes.
    steady: bool,
}

/// `spin`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses its sensors.
pub fn main(common: &Common) -> Result<()> {
    common.prepare()?;
    let bar = ProgressBar::new(1000).with_style(ProgressStyle::with_template("{msg:12} {wide_bar} {percent:>3} %")?);
    let run = run(common.seed, &PlantParameters::imperfect(common.seed), |what, part| {
        bar.set_message(what);
        bar.set_position((1000.0 * part) as u64);
    })?;
    bar.finish_and_clear();
    println!(
        "An imperfect motor, calibrated and turned by the code of the control interrupt (seed {}):\n",
        common.seed
    );
    print_table(&run.table());
    println!();
    print_table(&run.sensor_table());
    println!();
    common.finish("spin", &run.summary, &run.report()?)
}

/// Calibrates and turns a motor; `progress` hears what is going on and how far it is.
///
/// # Errors
/// The drive refuses the sensors or a command.
pub fn run(seed: u64, plant: &PlantParameters, mut progress: impl FnMut(&'static str, f32)) -> Result<Run> {
    let settings = Settings::default();
    let mut rig = Rig::new(plant, &settings, seed)?;
    let calibration = rig.calibrate(|part| progress("calibrating", part))?;
    rig.command(Command::Arm)?;
    let mut trace = Vec::new();
    let start_turns = truth_turns(&rig, plant) - rig.drive.tracker().position().to_turns();
    for (part, (name, modulation, seconds)) in SCRIPT.into_iter().enumerate() {
        rig.drive_with(modulation)?;
        let periods = rig.periods(seconds);
        for k in 0..periods {
            if k % 40 == 0 {
                progress(name, k as f32 / periods as f32);
                rig.serve();
            }
            trace.push(observe(&mut rig, &calibration, part, f64::from(k) / f64::from(periods)));
        }
    }
    let lost = truth_turns(&rig, plant) - rig.drive.tracker().position().to_turns() - start_turns;
    rig.command(Command::Disarm)?;
    let mut by_angle = ByAngle::new(36);
    for row in &trace {
        by_angle.push(row.period.truth.electrical_angle_rad.to_degrees(), row.angle_deg);
    }
    let summary = summary(seed, plant, &trace, &by_angle, lost.round() as i64);
    Ok(Run { calibration, summary, trace, by_angle })
}

fn truth_turns(rig: &Rig, plant: &PlantParameters) -> f64 {
    rig.plant.truth().mechanical_angle_rad * f64::from(plant.motor.pole_pairs) / TAU
}

fn observe(rig: &mut Rig, calibration: &Calibration, part: usize, done: f64) -> Row {
    let period = rig.step();
    let truth = period.truth.electrical_angle_rad;
    let single = rig.drive.estimator().and_then(|estimator| estimator.angle(&period.sample.halls).ok());
    let baseline = calibration.model.electrical(uncalibrated(&period));
    Row {
        period,
        raw_deg: error_deg(baseline, truth),
        // A sample without an angle counts as wholly wrong.
        angle_deg: single.map_or(180.0, |angle| error_deg(angle, truth)),
        tracked_deg: error_deg(rig.drive.tracker().angle(), truth),
        part,
        steady: done > 0.6,
    }
}

/// The baseline: one sensor, and a second for the quadrant, as the data sheet promises them.
fn uncalibrated(period: &Period) -> ElectricalAngle {
    let signal = |channel: usize| {
        let normalizer = Normalizer::new(Channel(channel as u8), 2048.0 - 250.0, 2048.0 + 250.0, 12);
        normalizer.and_then(|n| n.normalize(period.sample.halls[channel]).ok()).unwrap_or(Signal::ZERO)
    };
    single_sensor(signal(0), signal(1), ElectricalAngle::THIRD)
}

fn summary(seed: u64, plant: &PlantParameters, trace: &[Row], by_angle: &ByAngle, turns_lost: i64) -> Summary {
    let over = |of: fn(&Row) -> f64| trace.iter().map(of).collect::<Statistics>();
    let (raw, angle) = (over(|row| row.raw_deg), over(|row| row.angle_deg));
    let steady = trace.iter().filter(|row| row.steady);
    let electrical_hz = |row: &Row| row.period.truth.speed_rad_s * f64::from(plant.motor.pole_pairs) / TAU;
    let noise = plant.halls[0].noise;
    Summary {
        seed,
        raw_error_deg_rms: (raw.rms().powi(2) - raw.mean().powi(2)).sqrt(),
        angle_error_deg_rms: angle.rms(),
        angle_error_deg_max: angle.max_abs(),
        angle_bias_deg: angle.mean(),
        angle_bias_worst_deg: by_angle.means(200.0).fold(0.0, |worst, (_, mean)| mean.abs().max(worst)),
        tracked_error_deg_rms: steady.map(|row| row.tracked_deg).collect::<Statistics>().rms(),
        tracked_error_all_deg_rms: over(|row| row.tracked_deg).rms(),
        crlb_deg: (noise * (2.0_f64 / 3.0).sqrt()).to_degrees(),
        crlb_placed_deg: bound_deg(plant),
        turns_lost,
        turns_made: trace.iter().map(|row| electrical_hz(row).abs() / 40e3).sum(),
        fastest_hz: trace.iter().fold(0.0, |fastest, row| electrical_hz(row).abs().max(fastest)),
    }
}

/// Cramér–Rao bound with everything but the angle known: 1 / Σ (slope / noise)², averaged over the turn.
pub fn bound_deg(plant: &PlantParameters) -> f64 {
    let variance = |angle: f64| {
        let information = |hall: &plant::HallParameters| {
            let x = angle - hall.placement_rad;
            let slope = x.cos() + 3.0 * hall.third * (3.0 * x).cos() + 5.0 * hall.fifth * (5.0 * x).cos();
            (slope / hall.noise).powi(2)
        };
        1.0 / plant.halls.iter().filter(|hall| hall.amplitude_v > 0.0).map(information).sum::<f64>()
    };
    let mean = (0..3600).map(|k| variance(TAU * f64::from(k) / 3600.0)).sum::<f64>() / 3600.0;
    mean.sqrt().to_degrees()
}

impl Run {
    fn table(&self) -> Vec<Vec<String>> {
        let s = &self.summary;
        let row = |name: &str, value: String| vec![name.to_string(), value];
        vec![
            row("electrical angle", "error".into()),
            row("one sensor, arcsine, uncalibrated", format!("{:.2}° RMS", s.raw_error_deg_rms)),
            row("three sensors, calibrated, single samples", format!("{:.3}° RMS", s.angle_error_deg_rms)),
            row("    what no estimator can beat (Cramér–Rao)", format!("{:.3}° RMS", s.crlb_placed_deg)),
            row("    largest", format!("{:.2}°", s.angle_error_deg_max)),
            row("    mean", format!("{:+.3}°", s.angle_bias_deg)),
            row("    largest mean in 10° of the turn", format!("{:.3}°", s.angle_bias_worst_deg)),
            row("tracked, constant speed", format!("{:.3}° RMS", s.tracked_error_deg_rms)),
            row("tracked, with start, stop and reversal", format!("{:.3}° RMS", s.tracked_error_all_deg_rms)),
            row(
                &format!("electrical turns lost of {:.0}, up to {:.0} Hz", s.turns_made, s.fastest_hz),
                s.turns_lost.to_string(),
            ),
        ]
    }

    fn sensor_table(&self) -> Vec<Vec<String>> {
        let report = &self.calibration.report;
        let head = ["found by the calibration", "swing LSB", "offset", "placed", "3rd harm.", "noise"];
        let mut rows = vec![head.map(String::from).to_vec()];
        for (k, sensor) in report.sensors.iter().enumerate() {
            rows.push(vec![
                Channel(k as u8).to_string(),
                format!("{:.1}", sensor.swing),
                format!("{:.1}", sensor.offset),
                format!("{:+.2}°", sensor.placement_error.to_degrees()),
                format!("{:.2} %", sensor.third_pct),
                format!("{:.2} %", sensor.noise_pct),
            ]);
        }
        rows
    }

    fn report(&self) -> Result<Report> {
        let mut report = Report::new("An imperfect motor, calibrated and turned");
        report.lead(
            "Three cheap, badly mounted Halls know the angle of a turning motor to a fraction of a degree, once they \
             are calibrated: accurate enough for smooth torque.",
        );
        report.text(
            "Three linear Halls with placement errors up to 8°, amplitudes off by up to 30 % and offsets by up to \
             10 %, 5 % third harmonic and 1 % noise at a 12-bit ADC; friction, cogging and dead time. The control code \
             is the one that runs on the chip; the motor is simulated in double precision.",
        );
        for finding in self.calibration.report.findings() {
            report.text(&format!("The calibration notes: {finding}."));
        }
        report.plot(&self.speed(), "Start, reversal, slow, fast and stop, commanded as a voltage.")?;
        report
            .plot(&self.angles(), "The reversal: the rotor's true electrical angle and what the drive knows of it.")?;
        report.plot(
            &self.errors(),
            "Single samples scatter by their noise; the tracker smooths it and follows through the reversal.",
        )?;
        report.plot(
            &self.bias(),
            "What remains when the noise is averaged away: placement, amplitude, offset, harmonics and alignment \
             together.",
        )?;
        report.plot(&self.signals(), "Two electrical turns, as in Fig. 4(b) of Simpkins and Todorov.")?;
        report.plot(
            &self.arcsines(),
            "The arcsine of each signal, the paper's way to an angle: it repeats within the turn, and the peaks are \
             cut.",
        )?;
        report.plot(&self.duties(), "Share of the PWM period for which each phase's upper transistor conducts.")?;
        report.plot(&self.torque(), "Torque of the motor; cogging and friction not subtracted.")?;
        report.heading("Figures").table(&self.table()).table(&self.sensor_table());
        Ok(report)
    }

    fn seconds(&self, index: usize) -> f64 {
        index as f64 / 40e3
    }

    fn all(&self, name: &str, of: impl Fn(&Row) -> f64) -> Series {
        Series::new(name, self.trace.iter().enumerate().map(|(k, row)| (self.seconds(k), of(row))))
    }

    /// With marks where the command changes.
    fn marked(&self, plot: Plot) -> Plot {
        let parts = SCRIPT.iter().enumerate();
        parts.fold(plot, |plot, (part, (name, ..))| plot.event(self.seconds(self.begin(part)), name))
    }

    /// A part of the trace in milliseconds, from its start.
    fn window(&self, name: &str, from: usize, periods: usize, of: impl Fn(&Row) -> f64) -> Series {
        let rows = self.trace.iter().skip(from).take(periods).enumerate();
        Series::new(name, rows.map(|(k, row)| (1e3 * self.seconds(k), of(row))))
    }

    /// Where a part of the script begins.
    fn begin(&self, part: usize) -> usize {
        self.trace.iter().position(|row| row.part == part).unwrap_or(0)
    }

    fn speed(&self) -> Plot {
        let rpm = self.all("speed", |row| row.period.truth.speed_rad_s * 60.0 / TAU);
        self.marked(Plot::new("Speed", "time / s", "speed / rpm", vec![rpm]))
    }

    fn angles(&self) -> Plot {
        let begin = self.begin(1) + 600;
        let truth = self.window("true", begin, 2400, |row| row.period.truth.electrical_angle_rad.to_degrees());
        let tracked = self.window("tracked", begin, 2400, |row| {
            let angle = row.period.truth.electrical_angle_rad.to_degrees() + row.tracked_deg;
            angle - 360.0 * (angle / 360.0).round()
        });
        Plot::new("Angle", "time / ms", "angle / ° electrical", vec![truth, tracked])
    }

    fn errors(&self) -> Plot {
        let single = self.all("single samples", |row| row.angle_deg);
        let tracked = self.all("tracked", |row| row.tracked_deg);
        self.marked(Plot::new("Error of the angle", "time / s", "error / ° electrical", vec![single, tracked]))
    }

    fn bias(&self) -> Plot {
        let series = Series::new("mean error", self.by_angle.means(50.0));
        Plot::new("Mean error over the turn", "electrical angle / °", "error / ° electrical", vec![series])
    }

    /// Begin and length of two electrical turns in the middle of the fast part.
    fn two_turns(&self) -> (usize, usize) {
        let begin = self.begin(3) + 14_000;
        let turns: Vec<_> = (begin + 1..self.trace.len())
            .filter(|&k| {
                self.trace[k].period.truth.electrical_angle_rad < self.trace[k - 1].period.truth.electrical_angle_rad
            })
            .take(3)
            .collect();
        match turns[..] {
            [first, _, third] => (first, third - first),
            _ => (begin, 400),
        }
    }

    fn signals(&self) -> Plot {
        let (begin, length) = self.two_turns();
        let halls = (0..3).map(|k| {
            self.window(&Channel(k as u8).to_string(), begin, length, |row| row.period.sample.halls[k].into())
        });
        Plot::new("Hall signals", "time / ms", "signal / ADC codes", halls.collect())
    }

    fn arcsines(&self) -> Plot {
        let (begin, length) = self.two_turns();
        let halls = (0..3).map(|k| {
            let sensor = self.calibration.model.sensors[k];
            self.window(&Channel(k as u8).to_string(), begin, length, |row| {
                let signal = (f32::from(row.period.sample.halls[k]) - sensor.offset) / sensor.amplitude;
                f64::from(trig::asin(fixed::types::I2F30::saturating_from_num(signal)).to_degrees())
            })
        });
        Plot::new("Arcsines", "time / ms", "arcsine / °", halls.collect())
    }

    fn duties(&self) -> Plot {
        let (begin, length) = self.two_turns();
        let phases = [0, 1, 2].map(|k| {
            self.window(["A", "B", "C"][k], begin, length, |row| f64::from(row.period.output.compare[k]) / 2125.0)
        });
        Plot::new("Duties", "time / ms", "duty / 1", phases.to_vec())
    }

    fn torque(&self) -> Plot {
        Plot::new(
            "Torque",
            "time / s",
            "torque / mN·m",
            vec![self.all("torque", |row| 1e3 * row.period.truth.torque_nm)],
        )
    }
}
