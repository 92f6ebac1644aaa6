//! A recording of the drive's scope: begun, waited for, read out, and in the units of its channels.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use anyhow::anyhow;
use hallservo::scope::{CHANNELS, Channel, Row, Setup, State};
use hallservo_protocol::{Answer, Ask, ROWS_AT_ONCE, ScopeAsk, ScopeRows, ScopeStatus};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::Duration;

/// From look to look while nothing has happened.
const EVERY: Duration = Duration::from_millis(5);

/// What was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Its channels.
    pub channels: Vec<Channel>,
    /// Time of each row, s; that of the trigger is zero.
    pub time_s: Vec<f64>,
    /// Values of each channel in its unit.
    pub values: Vec<Vec<f64>>,
}

impl Recording {
    /// Of raw rows.
    pub fn new(setup: &Setup, scales: &[f32; CHANNELS], rows: &[Row], step_hz: f64) -> Self {
        let row_s = f64::from(setup.every) / step_hz;
        let recorded = setup.channels.iter().enumerate().filter_map(|(at, channel)| channel.map(|it| (at, it)));
        let before = if setup.trigger == hallservo::scope::Trigger::Now { 0 } else { setup.before };
        Self {
            channels: recorded.clone().map(|(_, channel)| channel).collect(),
            time_s: (0..rows.len()).map(|k| (k as f64 - f64::from(before)) * row_s).collect(),
            values: recorded
                .map(|(at, channel)| {
                    let raw = rows.iter().map(|row| row[at]);
                    let scale = f64::from(scales[at]);
                    if channel.is_position() {
                        unwrapped(raw, scale)
                    } else {
                        raw.map(|raw| f64::from(raw) * scale).collect()
                    }
                })
                .collect(),
        }
    }

    /// A channel's values.
    pub fn of(&self, channel: Channel) -> &[f64] {
        let at = self.channels.iter().position(|one| *one == channel);
        at.map_or(&[], |at| &self.values[at])
    }
}

/// Positions, whose raw numbers wrap.
fn unwrapped(raw: impl Iterator<Item = i32>, scale: f64) -> Vec<f64> {
    let mut last: Option<(i32, i64)> = None;
    raw.map(|raw| {
        let sum = last.map_or(i64::from(raw), |(before, sum)| sum + i64::from(raw.wrapping_sub(before)));
        last = Some((raw, sum));
        sum as f64 * scale
    })
    .collect()
}

/// The name that people use.
pub fn name(channel: Channel) -> &'static str {
    Channel::ALL.iter().find(|(one, _)| *one == channel).map_or("", |(_, name)| name)
}

/// How the scope is.
///
/// # Errors
/// There is none.
pub fn status(client: &mut Client) -> Result<ScopeStatus> {
    client.ask(Ask::Scope(ScopeAsk::Status), |answer| match answer {
        Answer::Scope(status) => Ok(status),
        other => unexpected(&other),
    })
}

/// Begins a recording, and returns its number.
///
/// # Errors
/// It is refused.
pub fn begin(client: &mut Client, setup: Setup) -> Result<u32> {
    status(client)?;
    let id = RandomState::new().build_hasher().finish() as u32;
    client.order(Ask::Scope(ScopeAsk::Begin { id, setup }))?;
    Ok(id)
}

/// Waits until a recording is complete, `seconds` of the drive's time at most, and reads it out. The scope is free then,
/// whatever happens.
///
/// # Errors
/// The time is over, or the drive was restarted.
pub fn finish(client: &mut Client, id: u32, seconds: f64) -> Result<Recording> {
    let result = wait(client, id, seconds).and_then(|status| read(client, &status));
    if matches!(result, Err(Error::Interrupted)) {
        client.carry_on();
    }
    let ended = client.order(Ask::Scope(ScopeAsk::End));
    let recording = result?;
    ended.map(|()| recording)
}

fn wait(client: &mut Client, id: u32, seconds: f64) -> Result<ScopeStatus> {
    let began_ms = client.status()?.uptime_ms;
    loop {
        let scope = status(client)?;
        if scope.id != id || scope.state == State::None {
            return Err(Error::Failed("the recording is gone: the drive was restarted meanwhile".into()));
        }
        if scope.state == State::Done {
            return Ok(scope);
        }
        let passed_ms = client.status()?.uptime_ms.saturating_sub(began_ms);
        if passed_ms as f64 > 1000.0 * seconds {
            let why = if scope.state == State::Waiting { "the trigger did not come" } else { "it was not complete" };
            return Err(Error::Failed(format!("{why} within {seconds} s")));
        }
        client.listen(EVERY)?;
    }
}

/// All rows. What is lost on the way is asked for again.
fn read(client: &mut Client, status: &ScopeStatus) -> Result<Recording> {
    let setup = status.setup.ok_or_else(|| anyhow!("the drive does not say what it has recorded"))?;
    let mut rows: Vec<Row> = Vec::new();
    while rows.len() < usize::from(setup.rows) {
        let (id, first) = (status.id, rows.len() as u16);
        let some = client.ask(Ask::Scope(ScopeAsk::Rows { id, first }), |answer| match answer {
            Answer::ScopeRows(rows) => Ok(rows),
            other => unexpected(&other),
        })?;
        // An answer that is not what was asked for leaves a gap, which is asked for again.
        if (some.id, some.first) == (id, first) {
            let ScopeRows { rows: more, .. } = some;
            rows.extend(more.iter().take(ROWS_AT_ONCE.min(usize::from(setup.rows) - rows.len())));
        }
    }
    Ok(Recording::new(&setup, &status.scales, &rows, client.identity().step_hz))
}
