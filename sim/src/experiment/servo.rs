//! The servo: current, speed and position control on the paper's motor with imperfect Halls.

mod identified;

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::{Statistics, ripple_pct};
use anyhow::{Context, Result, anyhow};
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::service::learning;
use hallservo::settings::{Control, GuardSettings, Settings};
use identified::identified;
pub use identified::{Compared, Identification};
use plant::{PlantParameters, Truth};
use rig::Rig;
use serde::Serialize;
use std::f64::consts::TAU;

/// The figures of `servo --json`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Summary {
    /// Seed of the sensors and the noise.
    pub seed: u64,
    /// 10 to 90 % of a current step of 1.5 A, rotor locked.
    pub current_rise_us: f64,
    /// Of the same step.
    pub current_overshoot_pct: f64,
    /// Frequency at which the current follows a sine with 1/√2 of its amplitude.
    pub current_bandwidth_hz: f64,
    /// Field-oriented speed control with the table of the cogging, 100 rpm against 40 mN·m: peak to peak over mean.
    pub speed_ripple_pct: f64,
    /// Sinusoidal commutation with local feedback, under the same speed control.
    pub sine_speed_ripple_pct: f64,
    /// Block commutation with local feedback, under the same speed control.
    pub block_speed_ripple_pct: f64,
    /// Block commutation at constant voltage, as far as it turns evenly at all.
    pub block_open_speed_ripple_pct: f64,
    /// Torque at the shaft of field orientation, peak to peak over mean.
    pub torque_ripple_pct: f64,
    /// The same of block commutation.
    pub block_torque_ripple_pct: f64,
    /// Copper loss of field orientation over that of block commutation, at the same speed and load.
    pub foc_copper_loss_vs_block: f64,
    /// RMS of the true position about its mean, holding without load.
    pub position_noise_deg: f64,
    /// True position less the commanded one, mean of the last quarter second under load: what the Halls are wrong by.
    pub position_hold_error_deg: f64,
    /// Largest deviation after a load step of 20 mN·m.
    pub load_step_deviation_deg: f64,
    /// From the load step until the position stays within 0.1° of where it was.
    pub load_step_recovery_ms: f64,
    /// RMS of the net torque of a slow turn at zero command without over that with the table.
    pub cogging_reduction: f64,
    /// What the drive finds its motor to be.
    pub identification: Identification,
}

/// Everything to plot.
pub struct Run {
    /// The figures.
    pub summary: Summary,
    current: Vec<(f64, f64)>,
    speed: Vec<Series>,
    ripple: Vec<Series>,
    moving: Vec<(f64, f64)>,
    loaded: Vec<(f64, f64)>,
    cogging: Vec<Series>,
}

/// `servo`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses.
pub fn main(common: &Common) -> Result<()> {
    common.prepare()?;
    let run = run(common.seed)?;
    println!("Current, speed and position control (seed {}):\n", common.seed);
    print_table(&run.table());
    println!();
    print_table(&run.summary.identification.table());
    println!();
    common.finish("servo", &run.summary, &run.report()?)
}

/// Bandwidths of the outer loops and of the tracker.
#[derive(Clone, Copy)]
struct Tuning {
    speed_hz: f32,
    position_hz: f32,
    tracking_hz: f32,
}

/// Against loads: the default.
const STIFF: Tuning = Tuning { speed_hz: 60.0, position_hz: 15.0, tracking_hz: 280.0 };
/// For turning evenly: the noise of the Halls hardly reaches the current.
const SMOOTH: Tuning = Tuning { speed_hz: 20.0, position_hz: 6.0, tracking_hz: 140.0 };

/// A calibrated and armed rig with current control.
fn armed(seed: u64, commutation: Commutation, tuning: Tuning) -> Result<Rig> {
    let Tuning { speed_hz, position_hz, tracking_hz } = tuning;
    // The experiments command once and measure for seconds.
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control =
        Control { guard, speed_bandwidth_hz: speed_hz, position_bandwidth_hz: position_hz, ..Control::default() };
    let settings =
        Settings { commutation, control: Some(control), tracking_bandwidth_hz: tracking_hz, ..Settings::default() };
    let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings, seed)?;
    rig.calibrate(|_| ())?;
    rig.arm()?;
    Ok(rig)
}

/// True current along q.
fn true_q(truth: &Truth) -> f64 {
    let [a, b, c] = truth.currents_a;
    let (sin, cos) = truth.electrical_angle_rad.sin_cos();
    let (alpha, beta) = ((2.0 * a - b - c) / 3.0, (b - c) / 3_f64.sqrt());
    beta * cos - alpha * sin
}

/// Measures everything.
///
/// # Errors
/// A drive that refuses.
pub fn run(seed: u64) -> Result<Run> {
    let current = current_step(seed)?;
    let settled = 1.5;
    let at = |share: f64| current.iter().find(|p| p.1 >= share * settled).map(|p| p.0).context("no current step");
    let peak = current.iter().map(|p| p.1).fold(0.0, f64::max);
    let foc = turn(seed, Commutation::FieldOriented)?;
    let sine = turn(seed, Commutation::Sinusoidal)?;
    let block = turn(seed, Commutation::Block)?;
    let hold = hold(seed)?;
    let (cogging, cogging_reduction) = cogging(seed)?;
    let summary = Summary {
        seed,
        current_rise_us: 1e3 * (at(0.9)? - at(0.1)?),
        current_overshoot_pct: 100.0 * (peak / settled - 1.0).max(0.0),
        current_bandwidth_hz: bandwidth(seed)?,
        speed_ripple_pct: ripple_pct(&foc.rpm),
        sine_speed_ripple_pct: ripple_pct(&sine.rpm),
        block_speed_ripple_pct: ripple_pct(&block.rpm),
        block_open_speed_ripple_pct: super::commutation::run(seed)?.summary.block_speed_ripple_cogging_pct,
        torque_ripple_pct: ripple_pct(&foc.torque),
        block_torque_ripple_pct: ripple_pct(&block.torque),
        foc_copper_loss_vs_block: foc.loss / block.loss,
        position_noise_deg: hold.noise_deg,
        position_hold_error_deg: hold.error_deg,
        load_step_deviation_deg: hold.deviation_deg,
        load_step_recovery_ms: hold.recovery_ms,
        cogging_reduction,
        identification: identified(seed)?,
    };
    let turns = [("field-oriented", foc), ("sinusoidal", sine), ("block", block)];
    let over_time = |values: &[f64]| values.iter().take(8000).enumerate().map(|(k, x)| (k as f64 / 40.0, *x)).collect();
    let ripple =
        turns.iter().map(|(name, turn)| Series { name: (*name).into(), points: over_time(&turn.rpm) }).collect();
    let speed = turns.into_iter().map(|(name, turn)| Series::new(name, turn.start)).collect();
    Ok(Run { summary, current, speed, ripple, moving: hold.moving, loaded: hold.loaded, cogging })
}

/// True current over the time in ms from the command on, rotor locked.
fn current_step(seed: u64) -> Result<Vec<(f64, f64)>> {
    let mut rig = armed(seed, Commutation::FieldOriented, SMOOTH)?;
    rig.plant.set_dyno(Some(0.0))?;
    rig.command(Command::Current(rig.control()?.current(0.0)?))?;
    rig.wait(0.02);
    let demand = rig.control()?.current(1.5)?;
    rig.service.send(Command::Current(demand))?;
    let mut currents = Vec::new();
    rig.run(0.01, |_, period| currents.push((currents.len() as f64 * 0.025, true_q(&period.truth))));
    Ok(currents)
}

/// The frequency at which a sine of 0.5 A about 1 A comes out with 1/√2 of its amplitude.
fn bandwidth(seed: u64) -> Result<f64> {
    let mut rig = armed(seed, Commutation::FieldOriented, SMOOTH)?;
    rig.plant.set_dyno(Some(0.0))?;
    let control = *rig.control()?;
    let mut last = 0.0;
    for hz in (500..4000).step_by(100) {
        let (mut sine, mut cosine) = (0.0, 0.0);
        // 10 ms to settle, 20 ms to measure: whole periods of multiples of 100 Hz.
        for k in 0..1200 {
            let phase = TAU * f64::from(hz) * f64::from(k) / 40e3;
            let demand = control.current((1.0 + 0.5 * phase.sin()) as f32)?;
            // A step that hands over a record obeys no command, so one in forty finds no room.
            let _ = rig.service.send(Command::Current(demand));
            let q = true_q(&rig.step().truth);
            rig.serve();
            if k >= 400 {
                sine += q * phase.sin() / 400.0;
                cosine += q * phase.cos() / 400.0;
            }
        }
        let gain = f64::hypot(sine, cosine) / 0.5;
        if gain < 0.5_f64.sqrt() {
            return Ok(f64::from(hz) - 100.0 * (0.5_f64.sqrt() - gain) / (last - gain));
        }
        last = gain;
    }
    Err(anyhow!("the current follows at any frequency"))
}

/// A turn under load.
struct Turn {
    /// Speed in rpm over the time in ms from the command on.
    start: Vec<(f64, f64)>,
    /// Settled.
    rpm: Vec<f64>,
    torque: Vec<f64>,
    /// Mean of the sum of the squares of the currents.
    loss: f64,
}

/// Load of the speed measurement.
const LOAD_NM: f64 = 0.04;
/// Its speed: 100 rpm.
const SLOW_RAD_S: f32 = 10.471_976;

fn turn(seed: u64, commutation: Commutation) -> Result<Turn> {
    let mut rig = armed(seed, commutation, SMOOTH)?;
    if commutation == Commutation::FieldOriented {
        learn(&mut rig)?;
    }
    rig.command(Command::Speed(rig.control()?.speed(0.0)?))?;
    rig.wait(0.3);
    rig.plant.set_load(LOAD_NM)?;
    rig.wait(0.3);
    rig.command(Command::Speed(rig.control()?.speed(SLOW_RAD_S)?))?;
    let rpm = |truth: &Truth| truth.speed_rad_s * 60.0 / TAU;
    let mut start = Vec::new();
    rig.run(0.1, |_, period| start.push((start.len() as f64 / 40.0, rpm(&period.truth))));
    rig.wait(0.5);
    let mut turn = Turn { start, rpm: Vec::new(), torque: Vec::new(), loss: 0.0 };
    rig.run(0.6, |_, period| {
        turn.rpm.push(rpm(&period.truth));
        turn.torque.push(period.truth.torque_nm);
        turn.loss += period.truth.currents_a.iter().map(|i| i * i).sum::<f64>();
    });
    turn.loss /= turn.rpm.len() as f64;
    Ok(turn)
}

/// What holding a position came to.
struct Hold {
    noise_deg: f64,
    error_deg: f64,
    deviation_deg: f64,
    recovery_ms: f64,
    moving: Vec<(f64, f64)>,
    loaded: Vec<(f64, f64)>,
}

fn hold(seed: u64) -> Result<Hold> {
    let mut rig = armed(seed, Commutation::FieldOriented, STIFF)?;
    let pole_pairs = f64::from(rig.config.pole_pairs.get());
    // The electrical turn that the drive counts as zero is one of the rotor's pole pairs.
    let counted = rig.drive.tracker().position().to_turns();
    let zero = ((rig.plant.truth().mechanical_angle_rad / TAU) * pole_pairs - counted).round();
    let here = (counted / pole_pairs).round();
    let target = here + 1.0;
    let true_deg = |truth: &Truth| 360.0 * (truth.mechanical_angle_rad / TAU - zero / pole_pairs - target);
    rig.command(Command::Position(rig.control()?.position(here)?))?;
    rig.wait(0.4);
    rig.command(Command::Position(rig.control()?.position(target)?))?;
    let mut position = Vec::new();
    rig.run(0.5, |_, period| position.push((position.len() as f64 / 40.0, true_deg(&period.truth))));
    let mut rest = Vec::new();
    rig.run(1.0, |_, period| rest.push(true_deg(&period.truth)));
    let mean = rest.iter().sum::<f64>() / rest.len() as f64;
    let noise: Statistics = rest.iter().map(|x| x - mean).collect();
    rig.plant.set_load(0.02)?;
    let mut loaded = Vec::new();
    rig.run(0.5, |_, period| loaded.push((loaded.len() as f64 / 40.0, true_deg(&period.truth))));
    let deviation: Statistics = loaded.iter().map(|p| p.1 - mean).collect();
    let recovered = loaded.iter().rposition(|p| (p.1 - mean).abs() > 0.1).map_or(0, |k| k + 1);
    let last: Statistics = loaded[loaded.len() / 2..].iter().map(|p| p.1).collect();
    Ok(Hold {
        noise_deg: noise.rms(),
        error_deg: last.mean().abs(),
        deviation_deg: deviation.max_abs(),
        recovery_ms: recovered as f64 / 40.0,
        moving: position,
        loaded,
    })
}

/// Speed of the dynamometer that measures the cogging, rad/s.
const TURNING_RAD_S: f64 = 3.0;

/// Has an armed drive learn the cogging, and arms it again.
fn learn(rig: &mut Rig) -> Result<()> {
    rig.command(Command::Disarm)?;
    rig.wait(0.3);
    rig.learn(&learning::Plan::new(&rig.config)?)?;
    rig.arm()
}

/// Net torque over the electrical angle without and with the table, and the quotient of their RMS.
fn cogging(seed: u64) -> Result<(Vec<Series>, f64)> {
    let mut rig = armed(seed, Commutation::FieldOriented, SMOOTH)?;
    let off = net_torque(&mut rig)?;
    learn(&mut rig)?;
    let on = net_torque(&mut rig)?;
    let rms = |torque: &[(f64, f64)]| torque.iter().map(|p| p.1).collect::<Statistics>().rms();
    let reduction = rms(&off) / rms(&on);
    Ok((vec![Series::new("off", off), Series::new("on", on)], reduction))
}

/// Torque of the currents and the cogging in mN·m over the electrical angle in degrees, at zero command and turned
/// slowly.
fn net_torque(rig: &mut Rig) -> Result<Vec<(f64, f64)>> {
    rig.command(Command::Current(rig.control()?.current(0.0)?))?;
    rig.plant.set_dyno(Some(TURNING_RAD_S))?;
    rig.wait(0.1);
    let mut by_angle = crate::statistics::ByAngle::new(360);
    rig.run(TAU / TURNING_RAD_S, |_, period| {
        let truth = &period.truth;
        by_angle.push(truth.electrical_angle_rad.to_degrees(), 1e3 * (truth.torque_nm + truth.cogging_nm));
    });
    rig.plant.set_dyno(None)?;
    Ok(by_angle.means(1.0).collect())
}

impl Run {
    fn table(&self) -> Vec<Vec<String>> {
        let s = &self.summary;
        let row = |name: &str, value: String| vec![name.to_string(), value];
        vec![
            row("", "measured".into()),
            row("current step of 1.5 A: rise, 10 to 90 %", format!("{:.0} µs", s.current_rise_us)),
            row("    overshoot", format!("{:.1} %", s.current_overshoot_pct)),
            row("    bandwidth, −3 dB", format!("{:.0} Hz", s.current_bandwidth_hz)),
            row(
                "speed ripple at 100 rpm, 40 mN·m: field-oriented, anti-cogging",
                format!("{:.2} %", s.speed_ripple_pct),
            ),
            row("    sinusoidal, local feedback", format!("{:.2} %", s.sine_speed_ripple_pct)),
            row("    block, local feedback", format!("{:.2} %", s.block_speed_ripple_pct)),
            row("    block, constant voltage", format!("{:.2} %", s.block_open_speed_ripple_pct)),
            row("torque ripple: field-oriented", format!("{:.2} %", s.torque_ripple_pct)),
            row("    block", format!("{:.2} %", s.block_torque_ripple_pct)),
            row("copper loss, field-oriented over block", format!("{:.3}", s.foc_copper_loss_vs_block)),
            row("position at rest: noise, RMS", format!("{:.4}°", s.position_noise_deg)),
            row("    error under load", format!("{:.3}°", s.position_hold_error_deg)),
            row("load step of 20 mN·m: deviation", format!("{:.2}°", s.load_step_deviation_deg)),
            row("    back within 0.1° after", format!("{:.0} ms", s.load_step_recovery_ms)),
            row("cogging: torque without over with the table", format!("{:.1}", s.cogging_reduction)),
        ]
    }

    fn report(&self) -> Result<Report> {
        let mut report = Report::new("Current, speed and position control");
        report.lead(
            "How fast, how evenly and how stiffly the drive follows a current, a speed and a position: what a servo is \
             bought for.",
        );
        report.text(
            "The paper's motor with imperfect Halls, dead time, friction and cogging, calibrated by the drive. \
             Torques, speeds and positions are the motor's true ones. Bandwidths of speed, position and tracker: 20, 6 \
             and 140 Hz for turning evenly, 60, 15 and 280 Hz for holding a position.",
        );
        let current = vec![Series::new("current along q", self.current.iter().take(120).copied())];
        let moving = vec![Series::new("position", self.moving.iter().take(100 * 40).copied())];
        let loaded = vec![Series::new("position", self.loaded.iter().take(150 * 40).copied())];
        let plots = [
            (
                "Current step, rotor locked",
                "time / ms",
                "current / A",
                &current,
                "Field-oriented, set for 1 kHz at 40 kHz PWM.",
            ),
            ("Speed step under load", "time / ms", "speed / rpm", &self.speed, "From 0 to 100 rpm against 40 mN·m."),
            (
                "Speed, settled",
                "time / ms",
                "speed / rpm",
                &self.ripple,
                "The three commutations under the same speed control.",
            ),
            ("Position: a move", "time / ms", "deviation from the target / °", &moving, "One turn."),
            (
                "Position: a load",
                "time / ms",
                "deviation from the target / °",
                &loaded,
                "A load of 20 mN·m is put on while it is held.",
            ),
            (
                "Cogging",
                "electrical angle / °",
                "net torque / mN·m",
                &self.cogging,
                "Turned slowly by a dynamometer at zero command, with the table off and on.",
            ),
        ];
        for (title, x, y, series, caption) in plots {
            report.plot(&Plot::new(title, x, y, series.clone()), caption)?;
        }
        report.heading("Figures").table(&self.table());
        report.heading("The motor as the drive has measured it").table(&self.summary.identification.table());
        Ok(report)
    }
}
