//! What the steps of the speed tell of the load: whether its shaft twists, what inertia turns, and whether the loop
//! swings by itself.

use super::{BEFORE, Loop, Plan, model, records};
use crate::client::Client;
use crate::error::{Error, Result};
use crate::frequency::{Model, grid, ratio};
use crate::out::Out;
use crate::resonance::{Load, Point};
use crate::say;
use crate::scope::{self, Recording, four};
use hallservo::scope::{Channel, Setup, Trigger};
use hallservo_protocol::Ask;

/// Noise of the current beyond which a loop swings by itself, as a share of the largest current.
pub(in crate::command) const SWINGS: f64 = 0.1;
/// Steps, where nobody says how many.
const STEPS: u32 = 12;
/// Time of a record, s: so long a load may swing to be seen.
const RECORD_S: f64 = 0.3;
/// Highest frequency that is looked at, in the tracker's.
const TRACKED: f64 = 1.5;
/// Frequencies that are looked at.
const FREQUENCIES: usize = 96;

/// What the steps tell.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(in crate::command) struct Found {
    /// What turns; none if the steps do not tell.
    pub load: Option<Load>,
    /// Noise of the current by which the loop swings without being asked to, A, RMS.
    pub swings_a: Option<f64>,
}

impl Found {
    pub(super) fn of(records: &[Recording], plan: &Plan, model: &Model) -> Self {
        if plan.which == Loop::Current {
            return Self::default();
        }
        let swings_a = Some(noise_a(records)).filter(|noise| *noise > SWINGS * plan.largest_a);
        // What swings by itself is no response to the steps.
        let load = if swings_a.is_none() { Load::of(&points(records, plan, model)) } else { None };
        Self { load, swings_a }
    }

    /// In words, with what can be done.
    pub(in crate::command) fn tell(&self, out: Out) -> Result<()> {
        if let Some(noise_a) = self.swings_a {
            say!(
                out,
                "The loop swings by itself: its current by {noise_a:.2} A (RMS) before a step. These are no responses to \
                 the steps; `hallctl tune` finds a speed_bandwidth_hz that is calm."
            )?;
        }
        let Some(load) = self.load else { return Ok(()) };
        if let Some(found) = load.resonance {
            say!(
                out,
                "The shaft twists: motor and load swing against each other at {:.0} Hz (resonance, damping ratio {:.2}); \
                 at {:.0} Hz the load takes up all of the motion (anti-resonance). A stiffer coupling, a shorter shaft or \
                 a load of less inertia shifts both up, and a larger bandwidth is calm.",
                found.resonance_hz,
                found.damping,
                found.antiresonance_hz
            )?;
        }
        if load.is_off() {
            say!(
                out,
                "What turns has {:.1} times the inertia of the setting inertia_kgm2: `hallctl identify` measures it.",
                load.inertia
            )?;
        }
        Ok(())
    }
}

/// RMS of the current's reference before the steps.
fn noise_a(records: &[Recording]) -> f64 {
    let squares = records.iter().map(|record| {
        let values = record.of(Channel::ReferenceQ);
        let before = &values[..values.len() / usize::from(BEFORE)];
        let mean = before.iter().sum::<f64>() / before.len() as f64;
        before.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / before.len() as f64
    });
    (squares.sum::<f64>() / records.len() as f64).sqrt()
}

/// From current to speed, in the response of a stiff shaft.
fn points(records: &[Recording], plan: &Plan, model: &Model) -> Vec<Point> {
    let channels = [Channel::SpeedReference, Channel::ReferenceQ, Channel::Speed];
    let signals: Vec<_> = records.iter().map(|record| channels.map(|channel| record.of(channel))).collect();
    let least_hz = 1.0 / (plan.row_s * f64::from(plan.setup.rows - plan.setup.before));
    let frequencies = grid(least_hz, (TRACKED * model.tracking_hz).min(0.4 / plan.row_s), FREQUENCIES);
    let point = |hz| {
        let found = ratio(&signals, plan.row_s, hz).times(model.speed_plant(hz).inv());
        Point { hz, value: found.value, error: found.error }
    };
    frequencies.into_iter().map(point).collect()
}

/// Steps to tell what turns, while the drive runs; nothing where it has no scope, or another tool records.
pub(in crate::command) fn look(client: &mut Client, from: f64, size: f64) -> Result<Found> {
    let model = model(client)?;
    let capacity = match scope::status(client) {
        Err(Error::Refused(_)) => return Ok(Found::default()),
        status => status?.capacity,
    };
    let before = capacity / BEFORE;
    let every = 8 * (RECORD_S * model.step_hz / f64::from(capacity - before) / 8.0).ceil() as u16;
    let channels = four(&[Channel::SpeedReference, Channel::Speed, Channel::ReferenceQ]);
    let plan = Plan {
        setup: Setup { channels, every, rows: capacity, before, trigger: Trigger::Command },
        row_s: f64::from(every) / model.step_hz,
        which: Loop::Speed,
        from,
        size,
        size_a: 0.0,
        hz: model.speed_hz,
        largest_a: client.setting(Ask::Get("max_current_a"), |setting| setting.value.into())?,
    };
    match records(client, STEPS, &plan) {
        Err(Error::Refused(_)) => Ok(Found::default()),
        records => Ok(Found::of(&records?, &plan, &model)),
    }
}
