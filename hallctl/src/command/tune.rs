//! `hallctl tune`: which bandwidths of the speed and position control this motor, its load and its noise stand.

mod hold;
mod judge;
mod recover;
mod trial;
mod words;

use super::chirp::load::{self, Found};
use super::motion;
use super::response::Wanted;
use super::settings::set_all;
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::say;
use crate::units::{self, Quantity};
use crate::words::short;
use hallservo::commutation::Commutation;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Learning};
pub(super) use hold::quieten;
use judge::Judge;
use recover::unless_it_swings;
use trial::Trial;

const NAMES: [&str; 2] = ["speed_bandwidth_hz", "position_bandwidth_hz"];
/// Times the bandwidth as it is, until one swings.
const UP: [f32; 5] = [0.5, 0.7, 1.0, 1.4, 2.0];
/// The same where those are not calm, until one is good.
const DOWN: [f32; 7] = [0.35, 0.25, 0.18, 0.125, 0.09, 0.06, 0.04];
/// Least step, as a share of the largest speed.
const LEAST_STEP: f64 = 0.01;
/// Position's bandwidth in that of the speed, at most.
const INNER_TO_OUTER: f32 = 4.0;
/// Share of a position's bandwidth from which on it is as good as that.
const SAME: f32 = 0.9;
/// How often a bandwidth is tried: what swung before may have left the drive far from its reference.
const ATTEMPTS: usize = 2;
/// How often the position's bandwidth is halved, at most, until it does not overshoot.
const HALVINGS: usize = 3;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options {
    /// Size of the steps that are tried; a fifth of max_speed_rad_s, if it is not given
    #[arg(long, value_parser = |text: &str| units::not_zero(units::speed(text)?))]
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

/// Of speed and position.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
struct Bandwidths {
    speed_hz: f32,
    position_hz: f32,
}

impl Bandwidths {
    /// Those that are set.
    fn get(client: &mut Client) -> Result<Self> {
        let mut get = |name| client.setting(Ask::Get(name), |setting| setting.value);
        Ok(Self { speed_hz: get(NAMES[0])?, position_hz: get(NAMES[1])? })
    }

    /// Both, with another one of the speed; `slower` is how many times slower the speed's loop is than it should be.
    fn with_speed(self, speed_hz: f32, slower: f32) -> Self {
        Self { speed_hz, position_hz: self.position_hz.min(speed_hz / (INNER_TO_OUTER * slower)) }
    }

    fn set(self, client: &mut Client) -> Result<()> {
        set_all(client, NAMES.into_iter().zip([self.speed_hz, self.position_hz]).collect())
    }
}

/// What came of it.
struct Outcome {
    judge: Judge,
    trials: Vec<Trial>,
    /// The slowest that swings.
    swings: Option<Trial>,
    proposed: Option<Trial>,
    /// Whether that is good, and not merely calm.
    good: bool,
    /// Whether uneven magnets look like a loop that swings.
    uneven: bool,
    /// Whether they do though a map of them is in use.
    mapped: bool,
    found: Found,
}

impl Outcome {
    fn stood_quietly(&self, before: Bandwidths) -> bool {
        let is_same = |trial: &Trial| {
            trial.bandwidth_hz == before.speed_hz && trial.position_bandwidth_hz > SAME * before.position_hz
        };
        let stood = |trial: &Trial| is_same(trial) && !self.judge.swings(trial, &self.trials);
        self.proposed.is_some() || self.trials.iter().any(stood)
    }
}

/// Whether what is proposed, or else what is set, has held a position quietly as one of the trials.
pub(super) fn tune(client: &mut Client, options: &Options, out: Out) -> Result<bool> {
    let before = Bandwidths::get(client)?;
    let mut get = |name| client.setting(Ask::Get(name), |setting| setting.value);
    let max_current_a = f64::from(get("max_current_a")?);
    let of =
        |quantity: Option<Quantity>, usual| quantity.map_or(usual, |quantity| quantity.value(out.units.speed.rad_s()));
    let fastest = f64::from(get("max_speed_rad_s")?);
    let step = of(options.step, fastest / 5.0);
    // What follows a smaller one is noise, of which any bandwidth could be made.
    let least = LEAST_STEP * fastest;
    if !(least..=fastest).contains(&step.abs()) {
        let unit = out.units.speed;
        let [step, least, fastest] = [step, least, fastest].map(|rad_s| short((rad_s / unit.rad_s()) as f32));
        let unit = unit.name();
        return Err(Error::Refused(format!(
            "--step: {step} {unit} tells nothing of this motor: it must be {least} to {fastest} {unit}, by max_speed_rad_s"
        )));
    }
    let wanted = Wanted::speed(of(options.from, step / 4.0), step);
    let (from, to) = wanted.ends();
    let (from, to) = (from / out.units.speed.rad_s(), out.units.speed_to(to, 1));
    let (turns, unit) = (trial::TURNS / out.units.position.turns(), out.units.position.name());
    say!(out, "The motor steps between {from:.1} and {to}, and by {} {unit}.", short(turns as f32))?;
    let judge = Judge { max_current_a, size_rad_s: step.abs() };
    let proposed = |outcome: &Outcome| outcome.proposed.map(|trial| trial.bandwidths());
    let kept = |outcome: &Outcome| proposed(outcome).filter(|_| options.keep);
    let outcome = armed(client, before, |client| find(client, &wanted, judge, before), kept)?;
    words::show(&outcome, before, kept(&outcome).is_some(), out)?;
    Ok(outcome.stood_quietly(before))
}

/// Does work that tries bandwidths, and leaves those that it has found, else those of before; armed for it, if need be.
fn armed<T>(
    client: &mut Client,
    before: Bandwidths,
    work: impl FnOnce(&mut Client) -> Result<T>,
    kept: impl FnOnce(&T) -> Option<Bandwidths>,
) -> Result<T> {
    let found = client.status()?;
    if found.mode != Mode::Running {
        client.arm()?;
    }
    let outcome = work(client);
    // Whatever has happened, a signal included.
    client.carry_on();
    let interrupted = matches!(outcome, Err(Error::Interrupted));
    if interrupted {
        motion::brake(client)?;
    }
    let restored = outcome.as_ref().ok().and_then(kept).unwrap_or(before).set(client);
    if interrupted || found.mode != Mode::Running {
        motion::rest(client)?;
        client.order(Ask::Disarm)?;
    }
    restored?;
    outcome
}

fn find(client: &mut Client, wanted: &Wanted, judge: Judge, before: Bandwidths) -> Result<Outcome> {
    let first = look(client, wanted, before)?;
    // More inertia than the settings have makes the speed's loop slower.
    let slower = first.load.map_or(1.0, |load| load.inertia.max(1.0) as f32);
    let is_off = first.load.is_some_and(|load| load.is_off());
    let bandwidths = |factor| before.with_speed(before.speed_hz * factor, slower);
    let trials = try_all(client, wanted, &judge, is_off, bandwidths)?;
    let swings = judge.lowest_swinging(&trials).copied();
    let (best, calm) = (judge.best(&trials), judge.calmest(&trials));
    let is_calm = swings.is_none_or(|swings| before.speed_hz < swings.bandwidth_hz);
    // What swings is not left so, though nothing better is good.
    let proposed = best.or(calm.filter(|_| !is_calm)).map(|trial| settled(client, trial)).transpose()?;
    let is_open = first.load.is_none_or(|load| load.resonance.is_none() && swings.is_some());
    let found = match proposed.as_ref().or(calm) {
        Some(calm) if is_open => look(client, wanted, calm.bandwidths())?,
        _ => first,
    };
    let uneven = client.status()?.learning == Learning::Uneven && judge.swings_by_turning(&trials);
    let mapped = uneven && super::magnets::are_mapped(client)?;
    // What repeats with the poles looks like a shaft that twists.
    let found = if uneven { Found::default() } else { found };
    Ok(Outcome { judge, swings, proposed, good: best.is_some(), uneven, mapped, found, trials })
}

/// What turns, by steps of the speed; nothing where no current along q is asked for, or the loop swings.
fn look(client: &mut Client, wanted: &Wanted, bandwidths: Bandwidths) -> Result<Found> {
    if client.status()?.commutation != Commutation::FieldOriented {
        return Ok(Found::default());
    }
    bandwidths.set(client)?;
    let (from, to) = wanted.ends();
    let found = unless_it_swings(client, |client| {
        let found = load::look(client, (from + to) / 2.0, to - from)?;
        motion::rest(client).map(|()| found)
    })?;
    Ok(found.map_or_else(Found::default, |found| Found { swings_a: None, ..found }))
}

fn try_all(
    client: &mut Client,
    wanted: &Wanted,
    judge: &Judge,
    is_off: bool,
    bandwidths: impl Fn(f32) -> Bandwidths,
) -> Result<Vec<Trial>> {
    let mut trials = Vec::new();
    for factor in UP {
        if judge.lowest_swinging(&trials).is_some() {
            break;
        }
        trials.extend(try_one(client, wanted, bandwidths(factor))?);
    }
    for factor in DOWN {
        // What overshoots by a wrong inertia does so at any bandwidth.
        if judge.best(&trials).is_some() || is_off && judge.calmest(&trials).is_some() {
            break;
        }
        trials.extend(try_one(client, wanted, bandwidths(factor))?);
    }
    trials.sort_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz));
    Ok(trials)
}

/// None where the settings do not allow it.
fn try_one(client: &mut Client, wanted: &Wanted, bandwidths: Bandwidths) -> Result<Option<Trial>> {
    match bandwidths.set(client) {
        Err(Error::Refused(_)) => return Ok(None),
        result => result?,
    }
    for _ in 0..ATTEMPTS {
        let trial = unless_it_swings(client, |client| {
            recover::calm(client)?;
            Trial::of(client, wanted, bandwidths)
        })?;
        if trial.is_some() {
            return Ok(trial);
        }
    }
    Ok(Some(Trial::switched_off(bandwidths)))
}

/// The same with a position that does not overshoot; or the trial as it is, where slower ones do not help.
fn settled(client: &mut Client, trial: &Trial) -> Result<Trial> {
    let mut slower = *trial;
    slower.bandwidths().set(client)?;
    for _ in 0..HALVINGS {
        if judge::follows(&slower.position_step) {
            return Ok(slower);
        }
        let position_hz = slower.position_bandwidth_hz / 2.0;
        match (Bandwidths { position_hz, ..slower.bandwidths() }).set(client) {
            // Below what a position can be held with.
            Err(Error::Refused(_)) => break,
            result => result?,
        }
        match unless_it_swings(client, |client| slower.with_position(client, position_hz))? {
            Some(trial) => slower = trial,
            None => break,
        }
    }
    Ok(if judge::follows(&slower.position_step) { slower } else { *trial })
}
