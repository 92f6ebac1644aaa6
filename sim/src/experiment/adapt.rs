//! The adaptation: unknown sensors found while the motor turns (Figure 11 of Simpkins and Todorov), a temperature ramp
//! followed, the field of the windings, a sensor lost.

pub mod coupling;
pub mod drift;
pub mod ensemble;
pub mod loss;
pub mod rotors;
pub mod trial;

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::Statistics;
use anyhow::{Result, ensure};
use drift::Drift;
use ensemble::{Convergence, PARTS};
use loss::Loss;
use rayon::prelude::*;
use serde::Serialize;
use trial::{Motion, PERIOD_S, Start, Trial};

/// Electrical speed: a hundred samples a turn.
pub const HZ: f64 = 10.0;

/// Options of `adapt`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Number of motors
    #[arg(long, default_value_t = 1000)]
    motors: u64,
}

/// The figures of `adapt --json`; angles are electrical.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Seed of the first motor.
    pub seed: u64,
    /// How many motors.
    pub motors: u64,
    /// Constant speed, electrical.
    pub speed_hz: f64,
    /// Samples a second.
    pub update_hz: f64,
    /// Turns from the data sheet until the error of all motors stays below 0.5° RMS.
    pub convergence_electrical_turns: Option<f64>,
    /// RMS over the eighth of a turn that follows the first turn.
    pub error_after_one_turn_deg_rms: f64,
    /// After four turns.
    pub error_deg_rms: f64,
    /// 99 of 100 errors after four turns are smaller.
    pub error_deg_p99: f64,
    /// Least RMS that any filter can have, after four turns.
    pub posterior_bound_deg: f64,
    /// After two turns, from rest to [`HZ`] in a second.
    pub ramp_error_deg_rms: f64,
    /// The bound for it.
    pub ramp_bound_deg: f64,
    /// After two turns, between ±[`HZ`].
    pub reversal_error_deg_rms: f64,
    /// The bound for it.
    pub reversal_bound_deg: f64,
    /// Motors of all three motions that failed, gave no number, or were off by more than 5°.
    pub diverged: usize,
    /// The paper's filter, which is given the true minima and maxima, angle and speed; none if never below 0.5°.
    pub paper_filter_convergence_turns: Option<f64>,
    /// After four turns.
    pub paper_filter_error_deg_rms: f64,
    /// Motors followed over the temperature ramp.
    pub drift_motors: u64,
    /// Worst motor's RMS over the ramp.
    pub drift_error_deg_rms: f64,
    /// The same without adaptation.
    pub drift_error_without_adaptation_deg_rms: f64,
    /// Worst motor's systematic error of the interrupt's estimator at the end of the ramp, RMS over the turn.
    pub drift_bias_deg_rms: f64,
    /// The same without adaptation.
    pub drift_bias_without_adaptation_deg_rms: f64,
    /// Field of the windings at the Halls at rated current, relative to the magnet's.
    pub coupling_shares: [f64; 3],
    /// Error of the filter's angle for each of them, under rated torque of both signs.
    pub coupling_error_without_deg_rms: [f64; 3],
    /// The same if the codes are corrected by the currents, with a coupling known to 10 %.
    pub coupling_error_with_deg_rms: [f64; 3],
    /// What is not corrected, without the shift of the whole turn, which follows the torque and no Hall can see.
    pub coupling_ripple_deg_rms: [f64; 3],
    /// Motors that lost a sensor.
    pub losses: usize,
    /// Losses found, with the right sensor named.
    pub losses_named: usize,
    /// Slowest detection.
    pub loss_detection_turns: f64,
    /// Largest error of the filter's angle after a loss.
    pub loss_error_deg_max: f64,
    /// RMS of the untracked angle from two sensors.
    pub loss_two_sensors_error_deg_rms: f64,
}

/// All runs.
pub struct Run {
    /// The figures.
    pub summary: Summary,
    courses: Vec<Convergence>,
    drift: Drift,
    loss: Loss,
}

/// `adapt`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written.
pub fn main(options: &Options) -> Result<()> {
    let common = &options.common;
    common.prepare()?;
    let run = run(common.seed, options.motors)?;
    println!("Adaptation of {} motors at {HZ} Hz electrical, 1000 samples a second:\n", options.motors);
    print_table(&run.summary.table());
    println!();
    common.finish("adapt", &run.summary, &run.report()?)
}

/// All motors.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn run(seed: u64, motors: u64) -> Result<Run> {
    ensure!(motors >= 1, "--motors must be at least 1");
    let seeds = || (seed..seed.saturating_add(motors)).into_par_iter();
    let courses = seeds().map(|seed| ensemble::converge(seed, HZ)).collect::<Result<Vec<_>>>()?;
    let [ramps, reversals] = [Motion::Ramp(HZ), Motion::Reversals(HZ)]
        .map(|motion| seeds().map(|seed| ensemble::track(seed, motion)).collect::<Result<Vec<_>>>());
    let (ramps, reversals) = (ramps?, reversals?);
    let drift_motors = motors.min(24);
    let drift_seeds = || (seed..seed.saturating_add(drift_motors)).into_par_iter();
    let drifts = drift_seeds().map(|seed| drift::run(seed, HZ)).collect::<Result<Vec<_>>>()?;
    let couplings = coupling::SHARES
        .map(|share| drift_seeds().map(|seed| coupling::run(seed, HZ, share)).collect::<Result<Vec<_>>>());
    let [none, some, much] = couplings;
    let couplings = [none?, some?, much?];
    let losses = seeds().map(|seed| loss::run(seed, HZ)).collect::<Result<Vec<_>>>()?;

    let errors = ensemble::over_time(&courses, |course| &course.errors);
    let paper = ensemble::over_time(&courses, |course| &course.paper);
    let bound = ensemble::over_time(&courses, |course| &course.bound);
    let steady = PARTS * ensemble::STEADY_TURNS;
    let rms = |parts: &[f64]| parts.iter().copied().collect::<Statistics>().rms();
    let mut all: Vec<f64> = courses.iter().flat_map(|course| course.steady.iter().map(|error| error.abs())).collect();
    all.sort_by(f64::total_cmp);
    let tracking_rms =
        |runs: &[ensemble::Tracking], of: fn(&ensemble::Tracking) -> f64| rms(&runs.iter().map(of).collect::<Vec<_>>());
    let worst = |of: fn(&Drift) -> f64| drifts.iter().map(of).fold(0.0, f64::max);
    let summary = Summary {
        seed,
        motors,
        speed_hz: HZ,
        update_hz: 1.0 / PERIOD_S,
        convergence_electrical_turns: ensemble::convergence_turns(&errors),
        error_after_one_turn_deg_rms: errors[PARTS],
        error_deg_rms: rms(&errors[steady..]),
        error_deg_p99: all[(all.len() - 1) * 99 / 100],
        posterior_bound_deg: rms(&bound[steady..]),
        ramp_error_deg_rms: tracking_rms(&ramps, |run| run.error.rms()),
        ramp_bound_deg: tracking_rms(&ramps, |run| run.bound.rms()),
        reversal_error_deg_rms: tracking_rms(&reversals, |run| run.error.rms()),
        reversal_bound_deg: tracking_rms(&reversals, |run| run.bound.rms()),
        diverged: courses.iter().filter(|course| course.diverged).count()
            + ramps.iter().chain(&reversals).filter(|run| run.diverged).count()
            + drifts.iter().filter(|drift| drift.diverged).count(),
        paper_filter_convergence_turns: ensemble::convergence_turns(&paper),
        paper_filter_error_deg_rms: rms(&paper[steady..]),
        drift_motors,
        drift_error_deg_rms: worst(|drift| drift.adapted.rms()),
        drift_error_without_adaptation_deg_rms: worst(|drift| drift.untouched.rms()),
        drift_bias_deg_rms: worst(|drift| drift.bias_adapted.rms()),
        drift_bias_without_adaptation_deg_rms: worst(|drift| drift.bias_untouched.rms()),
        coupling_shares: coupling::SHARES,
        coupling_error_without_deg_rms: couplings.each_ref().map(|runs| coupling::rms(runs, |run| run.without)),
        coupling_error_with_deg_rms: couplings.each_ref().map(|runs| coupling::rms(runs, |run| run.with)),
        coupling_ripple_deg_rms: couplings.each_ref().map(|runs| coupling::rms(runs, |run| run.ripple)),
        losses: losses.len(),
        losses_named: losses.iter().filter(|loss| loss.named && loss.detected_turns.is_some()).count(),
        loss_detection_turns: losses.iter().filter_map(|loss| loss.detected_turns).fold(0.0, f64::max),
        loss_error_deg_max: losses.iter().map(|loss| loss.error.max_abs()).fold(0.0, f64::max),
        loss_two_sensors_error_deg_rms: rms(&losses.iter().map(|loss| loss.two_sensors.rms()).collect::<Vec<_>>()),
    };
    let (drift, loss) = (drifts.into_iter().next(), losses.into_iter().next());
    match (drift, loss) {
        (Some(drift), Some(loss)) => Ok(Run { summary, courses, drift, loss }),
        _ => unreachable!("there is at least one motor"),
    }
}

impl Summary {
    fn table(&self) -> Vec<Vec<String>> {
        let row = |name: &str, ours: String, other: String| vec![name.to_string(), ours, other];
        let degrees = |x: f64| format!("{x:.3}°");
        let coupled = |k: usize| {
            row(
                &format!("windings' field {} % of the magnet's", 100.0 * self.coupling_shares[k]),
                degrees(self.coupling_error_without_deg_rms[k]),
                format!(
                    "corrected: {}, without the shift: {}",
                    degrees(self.coupling_error_with_deg_rms[k]),
                    degrees(self.coupling_ripple_deg_rms[k])
                ),
            )
        };
        let turns = |x: Option<f64>| x.map_or("never".to_string(), |x| format!("{x:.2} turns"));
        vec![
            row("electrical degrees RMS", "adapted".into(), "to compare".into()),
            row(
                "below 0.5° after",
                turns(self.convergence_electrical_turns),
                format!("paper's filter: {}", turns(self.paper_filter_convergence_turns)),
            ),
            row("after one turn", degrees(self.error_after_one_turn_deg_rms), String::new()),
            row(
                "steady",
                degrees(self.error_deg_rms),
                format!(
                    "bound: {}, paper's filter: {}",
                    degrees(self.posterior_bound_deg),
                    degrees(self.paper_filter_error_deg_rms)
                ),
            ),
            row(
                "after a ramp from rest",
                degrees(self.ramp_error_deg_rms),
                format!("bound: {}", degrees(self.ramp_bound_deg)),
            ),
            row(
                "while reversing",
                degrees(self.reversal_error_deg_rms),
                format!("bound: {}", degrees(self.reversal_bound_deg)),
            ),
            row("diverged", self.diverged.to_string(), String::new()),
            row(
                "amplitude −20 %, offset +5 % in 60 s (worst motor)",
                degrees(self.drift_error_deg_rms),
                format!("without adaptation: {}", degrees(self.drift_error_without_adaptation_deg_rms)),
            ),
            row(
                "    systematic, in the control interrupt",
                degrees(self.drift_bias_deg_rms),
                format!("without adaptation: {}", degrees(self.drift_bias_without_adaptation_deg_rms)),
            ),
            coupled(0),
            coupled(1),
            coupled(2),
            row(
                "sensors lost, found and named",
                format!("{} of {}", self.losses_named, self.losses),
                format!("at the latest after {:.2} turns", self.loss_detection_turns),
            ),
            row(
                "    two sensors, without tracking",
                degrees(self.loss_two_sensors_error_deg_rms),
                format!("the filter's angle at most {}", degrees(self.loss_error_deg_max)),
            ),
        ]
    }
}

impl Run {
    /// The page.
    ///
    /// # Errors
    /// A plot without data.
    pub fn report(&self) -> Result<Report> {
        let mut report = Report::new("Adaptation: the sensors found while the motor turns");
        report.lead(
            "Nobody has to mount or measure the Halls exactly: a filter finds them within a turn, follows what drifts, \
             and notices a sensor that is lost.",
        );
        for (plot, caption) in figure_11(self.summary.seed)? {
            report.plot(&plot, caption)?;
        }
        report.plot(
            &self.convergence(),
            "RMS over all motors of each eighth of a turn, from the data sheet's parameters.",
        )?;
        let drift =
            Plot::new("Temperature ramp: error of the angle", "time / s", "error / ° electrical", self.drift.series());
        report.plot(
            &drift,
            "Amplitude −20, −15 and −10 %, offset +5, +3.75 and +2.5 % of the amplitude over a minute.",
        )?;
        let loss = Series::new("adapted", self.loss.plot.iter().copied());
        let loss = Plot::new(
            "A sensor is lost: error of the angle",
            "time since the loss / s",
            "error / ° electrical",
            vec![loss],
        );
        report.plot(&loss, "The filter names the sensor and goes on with the other two.")?;
        report.heading("Figures").table(&self.summary.table());
        Ok(report)
    }

    fn convergence(&self) -> Plot {
        let curve = |name: &str, rms: Vec<f64>| {
            let points = rms.into_iter().enumerate().map(|(k, rms)| ((k + 1) as f64 / PARTS as f64, rms));
            Series::new(name, points)
        };
        let series = vec![
            curve("adapted", ensemble::over_time(&self.courses, |course| &course.errors)),
            curve("bound", ensemble::over_time(&self.courses, |course| &course.bound)),
            curve("paper's filter", ensemble::over_time(&self.courses, |course| &course.paper)),
        ];
        Plot::new("Error of the angle from unknown sensors", "electrical turns", "error / ° electrical, RMS", series)
            .logarithmic()
    }
}

/// Figure 11 of the paper for both filters: Halls, covariances, parameters, angle error.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn figure_11(seed: u64) -> Result<Vec<(Plot, &'static str)>> {
    let mut trial = Trial::new(seed, trial::halls(seed), Motion::Constant(HZ), Start::Nominal)?;
    let mut paper = ensemble::paper_filter(&trial, HZ);
    let names = |kind: &str| (0..3).map(|k| format!("Hall {}, {kind}", k + 1)).collect::<Vec<_>>();
    let mut halls = vec![Vec::new(); 6];
    let mut deviations = vec![Vec::new(); 5];
    let mut parameters = vec![Vec::new(); 6];
    let mut errors = vec![Vec::new(); 2];
    while trial.time_s() < 0.5 {
        let step = trial.step();
        paper.step(step.codes, trial::DAMPING_1_S * std::f64::consts::TAU * HZ, trial::DAMPING_1_S, PERIOD_S);
        let (t, model) = (trial.time_s(), trial.adapter.current());
        let known = trial.adapter.deviations();
        for k in 0..3 {
            halls[k].push((t, f64::from(step.codes[k])));
            halls[k + 3].push((t, f64::from(model.sensors[k].code(trial.adapter.hall_angle()))));
            let truth = trial::exact_model(&trial.halls).sensors[k];
            parameters[k].push((t, f64::from((model.sensors[k].amplitude / truth.amplitude - 1.0) * 100.0)));
            let placement = (model.sensors[k].placement - truth.placement).to_degrees();
            parameters[k + 3].push((t, f64::from(placement)));
        }
        let spreads = [
            known.angle.to_degrees(),
            known.placement[1].to_degrees(),
            100.0 * known.amplitude[0],
            100.0 * known.offset[0],
            100.0 * known.third,
        ];
        for (points, spread) in deviations.iter_mut().zip(spreads) {
            points.push((t, f64::from(spread)));
        }
        errors[0].push((t, step.error_deg));
        errors[1].push((t, trial::wrapped_deg(paper.angle - trial.hall_rad())));
    }
    let series = |names: Vec<String>, points: Vec<Vec<(f64, f64)>>| {
        names.into_iter().zip(points).map(|(name, points)| Series::new(name, points)).collect::<Vec<_>>()
    };
    let hall_names = [names("measured"), names("estimated")].concat();
    let kinds = ["angle / °", "placement / °", "amplitude / %", "offset / %", "third harmonic / %"];
    let parameter_names = [names("amplitude / %"), names("placement / °")].concat();
    Ok(vec![
        (
            Plot::new(
                "Figure 11(a): Halls, measured and estimated",
                "time / s",
                "signal / ADC codes",
                series(hall_names, halls),
            ),
            "Estimated from the filter's parameters and angle, starting from the data sheet.",
        ),
        (
            Plot::new(
                "Figure 11(b): what the filter believes not to know",
                "time / s",
                "standard deviation / ° or %",
                series(kinds.map(String::from).to_vec(), deviations),
            )
            .logarithmic(),
            "Square roots of the covariance's diagonal; offset and amplitude of Hall 1, placement of Hall 2.",
        ),
        (
            Plot::new(
                "Figure 11(c): errors of the parameters",
                "time / s",
                "error / % or °",
                series(parameter_names, parameters),
            ),
            "Amplitudes and placements less the true ones.",
        ),
        (
            Plot::new(
                "Figure 11(d): error of the angle",
                "time / s",
                "error / ° electrical",
                series(vec!["adapted".into(), "paper's filter".into()], errors),
            ),
            "The paper's filter is given the true minima and maxima, angle and speed.",
        ),
    ])
}
