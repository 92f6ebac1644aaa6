//! `hallctl tune`: which bandwidth of the speed control this motor, its load and its noise stand.

use super::motion;
use super::response::Wanted;
use super::session::Session;
use super::settings::set_all;
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::response::{Point, Step};
use crate::say;
use crate::units::{self, Quantity};
use hallservo::mode::Mode;
use hallservo_protocol::Ask;
use serde_json::json;

const NAMES: [&str; 2] = ["speed_bandwidth_hz", "position_bandwidth_hz"];
/// Times the bandwidth as it is.
const FACTORS: [f32; 5] = [0.5, 0.7, 1.0, 1.4, 2.0];
/// Position's bandwidth in that of the speed, at most.
const INNER_TO_OUTER: f32 = 4.0;
/// Largest overshoot, per cent.
const OVERSHOOT_PCT: f64 = 10.0;
/// Largest noise of the current, as a share of the largest current.
const NOISE: f64 = 0.05;
/// From the step on, s.
const RECORD_S: f64 = 0.4;
/// Telemetry, Hz.
const HZ: f32 = 500.0;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options {
    /// Size of the steps that are tried; a fifth of max_speed_rad_s, if it is not given
    #[arg(long, value_parser = units::speed)]
    step: Option<Quantity>,
    /// Speed before them; a quarter of the step, if it is not given
    #[arg(long, value_parser = units::speed)]
    from: Option<Quantity>,
    /// Take what is proposed; otherwise all is as before in the end. `hallctl settings save` keeps it for good
    #[arg(long)]
    keep: bool,
}

/// Steps as usual, and what is proposed is taken.
pub(super) const KEEP: Options = Options { step: None, from: None, keep: true };

/// A bandwidth that was tried.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Trial {
    bandwidth_hz: f32,
    step: Step,
    /// RMS about the mean in the end, A.
    current_noise_a: f64,
}

impl Trial {
    fn is_good(&self, max_current_a: f64) -> bool {
        let Self { step, current_noise_a, .. } = self;
        // Not a number where no current is measured.
        step.settling_s.is_some()
            && step.overshoot_pct <= OVERSHOOT_PCT
            && (current_noise_a.is_nan() || *current_noise_a <= NOISE * max_current_a)
    }
}

pub(super) fn tune(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    let mut get = |name| client.setting(Ask::Get(name), |setting| setting.value);
    let before = [get(NAMES[0])?, get(NAMES[1])?];
    let max_current_a = f64::from(get("max_current_a")?);
    let of =
        |quantity: Option<Quantity>, usual| quantity.map_or(usual, |quantity| quantity.value(out.units.speed.rad_s()));
    let step = of(options.step, f64::from(get("max_speed_rad_s")?) / 5.0);
    let wanted = Wanted::speed(of(options.from, step / 4.0), step);
    let (from, to) = wanted.ends();
    say!(out, "The motor steps between {from:.1} and {to:.1} rad/s.")?;
    let found = client.status()?;
    if found.mode != Mode::Running {
        client.arm()?;
    }
    let tried = try_all(client, &wanted, before);
    let proposed = tried.as_ref().ok().and_then(|trials| {
        let good = trials.iter().filter(|trial| trial.is_good(max_current_a));
        good.max_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz)).map(|trial| trial.bandwidth_hz)
    });
    // Whatever has happened, a signal included.
    client.carry_on();
    let kept = proposed.filter(|_| options.keep);
    let restored = set(client, kept.map_or(before, |hz| with_position(hz, before)));
    if found.mode != Mode::Running {
        motion::rest(client)?;
        client.order(Ask::Disarm)?;
    }
    restored?;
    show(&tried?, before[0], proposed, kept.is_some(), out)
}

/// Both bandwidths, with one of the speed.
fn with_position(speed_hz: f32, before: [f32; 2]) -> [f32; 2] {
    [speed_hz, before[1].min(speed_hz / INNER_TO_OUTER)]
}

fn set(client: &mut Client, values: [f32; 2]) -> Result<()> {
    set_all(client, NAMES.into_iter().zip(values).collect())
}

fn try_all(client: &mut Client, wanted: &Wanted, before: [f32; 2]) -> Result<Vec<Trial>> {
    let mut trials = Vec::new();
    for factor in FACTORS {
        let bandwidth_hz = before[0] * factor;
        match set(client, with_position(bandwidth_hz, before)) {
            // Beyond what the settings allow.
            Err(Error::Refused(_)) if factor != 1.0 => continue,
            result => result?,
        }
        trials.push(try_one(client, wanted, bandwidth_hz)?);
    }
    Ok(trials)
}

fn try_one(client: &mut Client, wanted: &Wanted, bandwidth_hz: f32) -> Result<Trial> {
    let ((), trace) = Session::run(client, HZ, |session| wanted.step(session, RECORD_S))?;
    let began_s = wanted.began_s(&trace);
    let since: Vec<_> = trace.iter().filter(|row| row.time_s >= began_s).collect();
    let points: Vec<Point> = since.iter().map(|row| (row.time_s - began_s, row.measured)).collect();
    let tail = &since[since.len() - since.len() / 4..];
    let mean = tail.iter().map(|row| row.current_a).sum::<f64>() / tail.len() as f64;
    let square = tail.iter().map(|row| (row.current_a - mean).powi(2)).sum::<f64>() / tail.len() as f64;
    let (from, to) = wanted.ends();
    Ok(Trial { bandwidth_hz, step: Step::of(&points, from, to), current_noise_a: square.sqrt() })
}

fn show(trials: &[Trial], before_hz: f32, proposed: Option<f32>, kept: bool, out: Out) -> Result<()> {
    let time = |time: Option<f64>| time.map_or_else(|| "never".into(), |time| format!("{:.1} ms", 1e3 * time));
    let head = ["bandwidth", "overshoot", "settled", "speed noise", "current noise", ""].map(String::from).to_vec();
    let rows = trials.iter().map(|Trial { bandwidth_hz, step, current_noise_a }| {
        let mark = match () {
            () if Some(*bandwidth_hz) == proposed => "proposed",
            () if *bandwidth_hz == before_hz => "as it was",
            () => "",
        };
        vec![
            format!("{bandwidth_hz:.1} Hz"),
            format!("{:.1} %", step.overshoot_pct),
            time(step.settling_s),
            format!("{:.3} rad/s", step.noise),
            if current_noise_a.is_nan() { "-".into() } else { format!("{current_noise_a:.4} A") },
            mark.into(),
        ]
    });
    out.table(&std::iter::once(head).chain(rows).collect::<Vec<_>>())?;
    match proposed {
        None => say!(out, "None of them is good: overshoot, settling and noise of the current; all is as it was.")?,
        Some(hz) if kept => say!(out, "{} is {hz:.1} now; `hallctl settings save` keeps it.", NAMES[0])?,
        Some(hz) => say!(out, "{hz:.1} Hz is proposed; all is as it was. `hallctl tune --keep` takes it.")?,
    }
    out.value(&json!({ "trials": trials, "before_hz": before_hz, "proposed_hz": proposed, "kept": kept }))
}
