//! `hallctl chirp`: the frequency response of the current or the speed control, beside the model's. What excites the
//! loop is a number of small steps, which hold all frequencies; the scope records each.

mod figures;
pub(super) mod load;

use super::motion::{self, Target};
use crate::client::{Client, SHORT};
use crate::error::{Error, Result};
use crate::frequency::{Estimate, Model, closed, grid, ratio, smoothed};
use crate::out::{self, Out, is_stream};
use crate::response::Sine;
use crate::scope::{self, Recording, four};
use crate::{say, units};
use figures::{Bode, Figures};
use hallservo::commutation::Commutation;
use hallservo::hall::track;
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Setup, Trigger};
use hallservo_protocol::Ask;
use num_complex::Complex64;
use plots::{Plot, Report, Series};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Which loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Loop {
    /// Of the current along q, by torques that begin at rest
    Current,
    /// Of the speed
    Speed,
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// Which loop
    which: Loop,
    /// Size of a step: A (from as much to twice as much), or rad/s and the like; without, a third of the largest current
    /// or a tenth of the largest speed
    #[arg(long)]
    size: Option<String>,
    /// Speed in the middle of the steps; for the speed alone
    #[arg(long, value_parser = units::speed, default_value = "0", allow_negative_numbers = true)]
    from: units::Quantity,
    /// Number of steps
    #[arg(long, default_value_t = 16, value_parser = crate::units::whole::<u32>(2..=200))]
    steps: u32,
    /// Into this file, .csv, .json or .html, - for CSV on the standard output; may be given more than once
    #[arg(long, short, value_name = "FILE", value_parser = out::table)]
    pub(super) out: Vec<PathBuf>,
}

/// One of so many rows is before a step.
const BEFORE: u16 = 8;
/// Periods of the bandwidth in a record.
const PERIODS: f64 = 8.0;
/// Periods of the bandwidth until a current has settled.
const SETTLED: f64 = 3.0;
/// Longest wait for a record, s.
const LONGEST_S: f64 = 3.0;
/// A rotor that is slower is at rest, rad/s.
const AT_REST_RAD_S: f32 = 5.0;
/// Where the standard error of a response is a larger share of it, no figures are read from it.
const DOUBT: f64 = 0.1;
/// The same of a response that is smoothed over its neighbours afterwards, which takes most of its noise away.
const DOUBT_UNSMOOTHED: f64 = 0.3;
/// Into so many parts the steps are divided, at most, for the standard error of what is found.
const PARTS: usize = 16;
/// A current that is further from its reference in the end, as a share of it, has not followed.
const MISSED: f64 = 0.15;
/// From a step to the next, at least: the rotor comes to rest.
const PAUSE_MS: u64 = 20;

/// How the loop is excited and recorded.
struct Plan {
    setup: Setup,
    row_s: f64,
    which: Loop,
    /// Middle and size of the steps, rad/s; or zero and a torque, N·m.
    from: f64,
    size: f64,
    /// Current of that torque, A.
    size_a: f64,
    /// Bandwidth as set.
    hz: f64,
    /// Largest current, A.
    largest_a: f64,
}

/// Shares of the size. A ramp holds nothing of some frequencies, which are others for each size.
const SHARES: [f64; 4] = [1.0, 0.4, 0.7, 0.5];

impl Plan {
    /// Before a step of the current: the rotor comes to rest.
    const REST: Target = Target::Speed(0.0);

    /// From where a step of the current goes on, beyond what the dead time does about zero.
    fn bias(&self, step: u32) -> Option<Target> {
        let side = if step.is_multiple_of(2) { self.size } else { -self.size };
        (self.which == Loop::Current).then_some(Target::Torque(side as f32))
    }

    /// The recording of a step. That of a current waits for the current's reference, past the bias: begun before, nothing
    /// but the step is left to be asked for while the torque speeds the rotor up.
    fn setup(&self, step: u32) -> Setup {
        let rising = step.is_multiple_of(2);
        let level = 1.5 * if rising { self.size_a } else { -self.size_a };
        let trigger = match self.which {
            Loop::Current => Trigger::Level { channel: Channel::ReferenceQ, level: level as f32, rising },
            Loop::Speed => Trigger::Command,
        };
        Setup { trigger, ..self.setup }
    }

    /// What a step goes to.
    fn target(&self, step: u32) -> Target {
        let side = if step.is_multiple_of(2) { self.size } else { -self.size };
        match self.which {
            Loop::Current => Target::Torque(2.0 * side as f32),
            Loop::Speed => {
                let share = SHARES[step as usize % SHARES.len()];
                Target::Speed((self.from + share * side / 2.0) as f32)
            }
        }
    }
}

pub(super) fn chirp(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    options.out.iter().try_for_each(|path| out::probe(path))?;
    let model = model(client)?;
    let plan = plan(client, options, &model, out)?;
    let found = client.status()?;
    if found.commutation != Commutation::FieldOriented {
        return Err(Error::Refused("there is no current along q: `hallctl commutation field-oriented` first".into()));
    }
    if found.mode != Mode::Running {
        client.arm()?;
    }
    let records = records(client, options.steps, &plan);
    let interrupted = matches!(records, Err(Error::Interrupted));
    if interrupted {
        client.carry_on();
        motion::brake(client)?;
    } else {
        motion::rest(client)?;
    }
    if interrupted || found.mode != Mode::Running {
        client.order(Ask::Disarm)?;
    }
    let records = records?;
    followed(&records, &plan)?;
    let responses = |records: &[&Recording]| responses(options.which, records, &plan, &model);
    let (closed, open) = responses(&records.iter().collect::<Vec<_>>());
    let parts = records.len().min(PARTS);
    let without: Vec<_> = (0..parts)
        .map(|part| {
            let is_left = |step: usize| step * parts / records.len() != part;
            let rest: Vec<_> =
                records.iter().enumerate().filter(|(step, _)| is_left(*step)).map(|(_, of)| of).collect();
            let (closed, open) = responses(&rest);
            Figures::of(&closed.sound, &open.sound)
        })
        .collect();
    let measured = Figures::of(&closed.sound, &open.sound).told(&without);
    let found = load::Found::of(&records, &plan, &model);
    report(&closed, &open, &measured, &found, options, out)
}

fn model(client: &mut Client) -> Result<Model> {
    let mut get = |name| client.setting(Ask::Get(name), |setting| f64::from(setting.value));
    let (flux, pole_pairs, inertia) = (get("flux_linkage_wb")?, get("pole_pairs")?, get("inertia_kgm2")?);
    let (tracking, held_s) = (get("tracking_bandwidth_hz")?, get("halls_held_s")?);
    let (current_hz, speed_hz) = (get("current_bandwidth_hz")?, get("speed_bandwidth_hz")?);
    let step_hz = client.identity().step_hz;
    let smoothing = track::Config::smoothing_for(tracking as f32, step_hz as f32);
    let tracking_hz = step_hz / f64::from(1_u32 << smoothing) / 8.886;
    Ok(Model {
        step_hz,
        delay_periods: 1.5 - held_s * step_hz,
        current_hz,
        speed_hz,
        tracking_hz,
        acceleration: 1.5 * pole_pairs * flux / inertia,
    })
}

fn plan(client: &mut Client, options: &Options, model: &Model, out: Out) -> Result<Plan> {
    let mut get = |name| client.setting(Ask::Get(name), |setting| f64::from(setting.value));
    let constant = 1.5 * get("pole_pairs")? * get("flux_linkage_wb")?;
    let (largest_a, largest_rad_s) = (get("max_current_a")?, get("max_speed_rad_s")?);
    let (channels, hz, size) = match options.which {
        Loop::Current => (vec![Channel::ReferenceQ, Channel::CurrentQ], model.current_hz, largest_a / 3.0),
        Loop::Speed => {
            let channels = vec![Channel::SpeedReference, Channel::Speed, Channel::ReferenceQ];
            (channels, model.speed_hz, largest_rad_s / 10.0)
        }
    };
    let size = match (&options.size, options.which) {
        (None, _) => size,
        (Some(text), Loop::Speed) => units::speed(text).map_err(Error::Refused)?.value(out.units.speed.rad_s()),
        (Some(text), Loop::Current) => {
            let number = text.trim_end_matches('A').trim().parse::<f64>().ok().filter(|size| size.is_finite());
            number.ok_or_else(|| Error::Refused(format!("{text:?} is no current")))?
        }
    };
    if size <= 0.0 {
        return Err(Error::Refused("a size above 0 is wanted".into()));
    }
    let rows = scope::status(client)?.capacity;
    let before = rows / BEFORE;
    // Outer loops work every eighth period, and a row of theirs is as new.
    let usual = PERIODS / hz * model.step_hz / f64::from(rows - before);
    let every = match options.which {
        Loop::Current => usual.round().max(1.0) as u16,
        Loop::Speed => 8 * (usual / 8.0).round().max(1.0) as u16,
    };
    let setup = Setup { channels: four(&channels), every, rows, before, trigger: Trigger::Command };
    let row_s = f64::from(every) / model.step_hz;
    Ok(match options.which {
        Loop::Current => {
            Plan { setup, row_s, which: options.which, from: 0.0, size: size * constant, size_a: size, hz, largest_a }
        }
        Loop::Speed => {
            let from = options.from.value(out.units.speed.rad_s());
            Plan { setup, row_s, which: options.which, from, size, size_a: 0.0, hz, largest_a }
        }
    })
}

/// A record of each step.
fn records(client: &mut Client, count: u32, plan: &Plan) -> Result<Vec<Recording>> {
    let mut records = Vec::new();
    for step in 0..count {
        // The speed's first step has one before it.
        let before = if plan.which == Loop::Current { Plan::REST } else { plan.target(1) };
        if step == 0 {
            client.order(before.ask())?;
        } else if plan.which == Loop::Current {
            client.repeat(before.ask()).map_err(|error| motion::fallen(client, error))?;
        }
        settle(client, plan)?;
        if plan.which == Loop::Current {
            // What holds the rotor asks for currents by itself.
            client.repeat(Target::Torque(0.0).ask())?;
        }
        let id = scope::begin(client, plan.setup(step))?;
        let before_ms = (1000.0 * plan.row_s * f64::from(plan.setup.before)) as u64 + 2;
        client.wait_ms(before_ms)?;
        client.still_controls()?;
        if let Some(bias) = plan.bias(step) {
            client.order(bias.ask())?;
            // Until the current is there, and the rows before the step are of nothing else. On the wall: to ask a drive
            // for its time may take so long that the torque has turned the rotor up meanwhile.
            client.listen(Duration::from_secs_f64(SETTLED / plan.hz).max(Duration::from_millis(before_ms)))?;
        }
        client.order(plan.target(step).ask()).map_err(|error| motion::fallen(client, error))?;
        // The torque would go on while the rows are read.
        let after = |client: &mut Client| match plan.which {
            Loop::Current => client.order(Plan::REST.ask()),
            Loop::Speed => Ok(()),
        };
        records.push(scope::finish_with(client, id, LONGEST_S, after)?);
    }
    Ok(records)
}

/// The loop comes to rest, in the drive's time, and the rotor where torques have turned it.
fn settle(client: &mut Client, plan: &Plan) -> Result<()> {
    let began_ms = client.status()?.uptime_ms;
    let settles_ms = PAUSE_MS + (1000.0 * PERIODS / plan.hz) as u64;
    let mut look = (Instant::now(), began_ms);
    loop {
        let status = client.status()?;
        let passed_ms = status.uptime_ms.saturating_sub(began_ms);
        let turns = plan.which == Loop::Current && status.speed_rad_s.abs() > AT_REST_RAD_S;
        if passed_ms >= settles_ms && (!turns || passed_ms as f64 > 1000.0 * LONGEST_S) {
            return Ok(());
        }
        client.pause(&mut look, &status, SHORT)?;
    }
}

/// The end of a record: mean, and standard error of that.
struct Tail {
    mean: f64,
    error: f64,
}

impl Tail {
    fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        Self { mean, error: square.sqrt() / count }
    }
}

/// A current that does not get to its reference has no voltage left: what it does then is no response of the loop.
fn followed(records: &[Recording], plan: &Plan) -> Result<()> {
    if plan.which == Loop::Speed {
        return Ok(());
    }
    for record in records {
        let [wanted, found] = [Channel::ReferenceQ, Channel::CurrentQ].map(|channel| {
            let values = record.of(channel);
            Tail::of(&values[values.len() - values.len() / 4..])
        });
        let (wanted, noise, found) = (wanted.mean, found.error, found.mean);
        if (found - wanted).abs() > (MISSED * wanted.abs()).max(5.0 * noise) {
            return Err(Error::Failed(format!(
                "the current does not follow: {found:.2} A instead of {wanted:.2} A at the end of a step\n  \
                 The voltage is at its limit, or the rotor runs away: a smaller --size, or more inertia at the shaft."
            )));
        }
    }
    Ok(())
}

/// What follows the reference, and the open loop.
fn responses(which: Loop, records: &[&Recording], plan: &Plan, model: &Model) -> (Bode, Bode) {
    let of = |channel| records.iter().map(move |record| record.of(channel));
    let pairs = |reference, from, to| -> Vec<_> {
        of(reference).zip(of(from)).zip(of(to)).map(|((a, b), c)| [a, b, c]).collect()
    };
    let least_hz = 2.0 / (plan.row_s * f64::from(plan.setup.rows - plan.setup.before));
    let frequencies = grid(least_hz.max(plan.hz / 8.0), (4.0 * plan.hz).min(0.4 / plan.row_s), 48);
    let bode = |measured: &dyn Fn(f64) -> Estimate, model: &dyn Fn(f64) -> Complex64| {
        let found: Vec<_> = frequencies.iter().map(|&hz| measured(hz)).collect();
        match which {
            // A winding has no resonance that neighbours could hide.
            Loop::Current => Bode::of(&frequencies, &found, &smoothed(&frequencies, &found), DOUBT_UNSMOOTHED, model),
            Loop::Speed => {
                let curve: Vec<_> = found.iter().map(|found| found.value).collect();
                Bode::of(&frequencies, &found, &curve, DOUBT, model)
            }
        }
    };
    match which {
        Loop::Current => {
            let pairs = pairs(Channel::ReferenceQ, Channel::ReferenceQ, Channel::CurrentQ);
            let follows = |hz| ratio(&pairs, plan.row_s, hz);
            let ideal = |hz| model.current_loop(hz);
            (bode(&follows, &|hz| closed(ideal(hz))), bode(&|hz| follows(hz).opened(), &ideal))
        }
        Loop::Speed => {
            let (reference, speed) = (Channel::SpeedReference, Channel::Speed);
            let follows = pairs(reference, reference, speed);
            let plant = pairs(reference, Channel::ReferenceQ, speed);
            let open = |hz| ratio(&plant, plan.row_s, hz).times(model.speed_control(hz));
            let ideal = |hz| model.speed_control(hz) * model.speed_plant(hz);
            // The torque of the acceleration is fed forward, which makes more of the plant than the loop does.
            let forward = |hz: f64| {
                let torque = Complex64::new(0.0, std::f64::consts::TAU * hz) / model.acceleration;
                (model.speed_control(hz) + torque) * model.speed_plant(hz) / (1.0 + ideal(hz))
            };
            (bode(&|hz| ratio(&follows, plan.row_s, hz), &forward), bode(&open, &ideal))
        }
    }
}

fn report(
    closed: &Bode,
    open: &Bode,
    measured: &Figures,
    found: &load::Found,
    options: &Options,
    out: Out,
) -> Result<()> {
    if !options.out.iter().any(|path| is_stream(path)) {
        tell(closed, open, measured, found, out)?;
    }
    // One that cannot be written costs none of the others.
    let saved: Vec<_> = options.out.iter().map(|path| save(path, closed, open)).collect();
    saved.into_iter().collect()
}

fn tell(closed: &Bode, open: &Bode, measured: &Figures, found: &load::Found, out: Out) -> Result<()> {
    let model = Figures::of(&closed.model, &open.model);
    let row = |name: &str, of: fn(&Figures) -> Option<f64>, unit: &str| {
        let show = |figures| of(figures).map_or_else(|| "not found".into(), |value| format!("{value:.1} {unit}"));
        vec![name.into(), show(measured), show(&model)]
    };
    out.table(&[
        ["", "measured", "model"].map(String::from).to_vec(),
        row("bandwidth, −3 dB", |figures| figures.bandwidth_hz, "Hz"),
        row("open loop's gain is one at", |figures| figures.crossover_hz, "Hz"),
        row("phase margin", |figures| figures.phase_margin_deg, "°"),
    ])?;
    say!(out, "The model has the motor and the bandwidths of the settings.")?;
    found.tell(out)?;
    if open.sound.first().is_some_and(|lowest| lowest.gain < 1.0) {
        say!(out, "The open loop's gain is below one at all frequencies that were measured.")?;
    } else if measured.crossover_hz.is_none() && found.swings_a.is_none() {
        say!(out, "The steps differ by too much to tell the rest: a larger --size, or more --steps.")?;
    }
    out.value(&json!({
        "measured": measured,
        "model": model,
        "found": found,
        "closed_loop": closed,
        "open_loop": open,
    }))
}

fn save(path: &Path, closed: &Bode, open: &Bode) -> Result<()> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => plot(path, closed, open),
        Some("json") => {
            let value = json!({ "closed_loop": closed, "open_loop": open });
            out::save(path, format!("{value}\n"))
        }
        _ => table(path, closed, open),
    }
}

fn table(path: &Path, closed: &Bode, open: &Bode) -> Result<()> {
    let mut text = String::from("hz");
    for name in ["closed", "closed_model", "open", "open_model"] {
        text += &format!(",{name}_gain,{name}_phase_deg");
    }
    text += ",closed_doubt,open_doubt";
    for row in 0..closed.measured.len() {
        text += &format!("\n{:.3}", closed.measured[row].hz);
        for curve in [&closed.measured, &closed.model, &open.measured, &open.model] {
            text += &format!(",{:.6},{:.3}", curve[row].gain, curve[row].phase_deg);
        }
        text += &format!(",{:.4},{:.4}", closed.doubt[row], open.doubt[row]);
    }
    out::save(path, text + "\n")
}

fn plot(path: &Path, closed: &Bode, open: &Bode) -> Result<()> {
    let mut report = Report::new("Frequency response of a hallservo drive");
    report.lead("How fast a loop follows its reference, and how far it is from swinging by itself, beside the model.");
    for (title, bode) in [("closed loop", closed), ("open loop", open)] {
        let of = |name: &str, curve: &[Sine], value: fn(&Sine) -> f64| {
            Series::new(name, curve.iter().map(|sine| (sine.hz.log10(), value(sine))))
        };
        let both = |value| vec![of("measured", &bode.measured, value), of("model", &bode.model, value)];
        let x = "logarithm of the frequency in Hz";
        let gain = both(|sine| 20.0 * sine.gain.log10());
        report.plot(&Plot::new(&format!("Gain, {title}"), x, "gain / dB", gain), "")?;
        let phase = both(|sine| sine.phase_deg);
        report.plot(&Plot::new(&format!("Phase, {title}"), x, "phase / °", phase), "")?;
    }
    out::save(path, report.html())
}
