//! A recording of the drive's scope: begun, waited for, read out, and in the units of its channels.

use crate::client::{Client, SHORT, unexpected};
use crate::error::{Error, Result};
use crate::units::{self, Quantity, Units};
use anyhow::anyhow;
use hallservo::scope::{CHANNELS, Channel, Row, Setup, State, Trigger};
use hallservo_protocol::{Answer, Ask, ROWS_AT_ONCE, ScopeAsk, ScopeRows, ScopeStatus};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::Instant;

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

/// A channel by its name.
///
/// # Errors
/// What is wrong with it.
pub fn channel(text: &str) -> std::result::Result<Channel, String> {
    let found = Channel::ALL.iter().find(|(_, name)| *name == text);
    found.map(|(channel, _)| *channel).ok_or_else(|| {
        let names: Vec<_> = Channel::ALL.iter().map(|(_, name)| *name).collect();
        format!("one of {}", names.join(", "))
    })
}

/// What a recording waits for, as it was written: the unit of a level that has none is chosen elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Awaited {
    trigger: Trigger,
    level: Option<Quantity>,
}

impl Awaited {
    /// With a level in the drive's units.
    pub fn trigger(self, units: Units) -> Trigger {
        match (self.trigger, self.level) {
            (Trigger::Level { channel, rising, .. }, Some(level)) => {
                let usual = match channel {
                    Channel::Speed | Channel::SpeedReference => units.speed.rad_s(),
                    Channel::Position | Channel::PositionReference => units.position.turns(),
                    _ => 1.0,
                };
                Trigger::Level { channel, level: level.value(usual) as f32, rising }
            }
            (trigger, _) => trigger,
        }
    }
}

/// What a recording waits for: `now`, `command`, `fault`, or a channel that crosses a level: `i_q>1.5`.
///
/// # Errors
/// What is wrong with it.
pub fn trigger(text: &str) -> std::result::Result<Awaited, String> {
    let always = |trigger| Ok(Awaited { trigger, level: None });
    match text {
        "now" => return always(Trigger::Now),
        "command" => return always(Trigger::Command),
        "fault" => return always(Trigger::Fault),
        _ => {}
    }
    let at = text.find(['>', '<']).ok_or("now, command, fault, or a channel > or < a level, like i_q>1.5")?;
    let channel = channel(text[..at].trim())?;
    let value = text[at + 1..].trim();
    let level = match channel {
        Channel::Speed | Channel::SpeedReference => units::speed(value)?,
        Channel::Position | Channel::PositionReference => units::position(value)?,
        _ => units::plain(value.trim_end_matches('°')).map_err(|_| format!("{value:?} is no level"))?,
    };
    let rising = text.as_bytes()[at] == b'>';
    Ok(Awaited { trigger: Trigger::Level { channel, level: 0.0, rising }, level: Some(level) })
}

/// As the drive wants them.
pub fn four(channels: &[Channel]) -> [Option<Channel>; CHANNELS] {
    std::array::from_fn(|at| channels.get(at).copied())
}

/// What is to be recorded, with this share of the rows before the trigger.
///
/// # Errors
/// More channels than there is room for.
pub fn setup(channels: &[Channel], every: u16, rows: u16, before: f64, trigger: Trigger) -> Result<Setup> {
    if channels.len() > CHANNELS {
        return Err(Error::Refused(format!("{CHANNELS} channels at most can be recorded")));
    }
    let before = (f64::from(rows) * before) as u16;
    Ok(Setup { channels: four(channels), every, rows, before, trigger })
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

/// Gives the scope up.
///
/// # Errors
/// It is another tool's.
pub fn end(client: &mut Client) -> Result<()> {
    client.order(Ask::Scope(ScopeAsk::End))
}

/// Waits until a recording is complete, `seconds` of the drive's time at most, and reads it out. The scope is free then,
/// whatever happens.
///
/// # Errors
/// The time is over, or the drive was restarted.
pub fn finish(client: &mut Client, id: u32, seconds: f64) -> Result<Recording> {
    finish_with(client, id, seconds, |_| Ok(()))
}

/// The same; when all rows are there, and before they are read, which takes a while, `first` is done.
///
/// # Errors
/// As [`finish`], or why `first` was not done.
pub fn finish_with(
    client: &mut Client,
    id: u32,
    seconds: f64,
    first: impl FnOnce(&mut Client) -> Result<()>,
) -> Result<Recording> {
    let result = wait(client, id, seconds).and_then(|status| {
        first(client)?;
        read(client, &status)
    });
    if matches!(result, Err(Error::Interrupted)) {
        client.carry_on();
    }
    let ended = end(client);
    let recording = result?;
    ended.map(|()| recording)
}

/// A recording was not complete in time.
pub fn late(state: State, seconds: f64) -> Error {
    let why = if state == State::Waiting { "the trigger did not come" } else { "it was not complete" };
    Error::Failed(format!("{why} within {seconds} s"))
}

fn wait(client: &mut Client, id: u32, seconds: f64) -> Result<ScopeStatus> {
    let began_ms = client.status()?.uptime_ms;
    let mut look = (Instant::now(), began_ms);
    loop {
        let scope = status(client)?;
        if scope.id != id || scope.state == State::None {
            return Err(Error::Failed("the recording is gone: the drive was restarted or calibrated meanwhile".into()));
        }
        if scope.state == State::Done {
            return Ok(scope);
        }
        let now = client.status()?;
        if now.uptime_ms.saturating_sub(began_ms) as f64 > 1000.0 * seconds {
            return Err(late(scope.state, seconds));
        }
        client.pause(&mut look, &now, SHORT)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trigger_is_written_as_one_says_it() {
        let level = |channel, level, rising| Ok(Trigger::Level { channel, level, rising });
        let trigger = |text: &str| trigger(text).map(|awaited| awaited.trigger(Units::default()));
        assert_eq!(trigger("i_q>1.5"), level(Channel::CurrentQ, 1.5, true));
        assert_eq!(trigger("bus < 20V"), level(Channel::Bus, 20.0, false));
        assert_eq!(trigger("speed<-1turns/s"), level(Channel::Speed, -std::f32::consts::TAU, false));
        assert_eq!((trigger("now"), trigger("fault")), (Ok(Trigger::Now), Ok(Trigger::Fault)));
        for text in ["", "i_q", "i_q>", "i_q>nan", "iq>1", "speed>fast", "bus>inf"] {
            assert!(trigger(text).is_err(), "{text}");
        }
    }
}
