//! The drive's angle against the motor's: telemetry names the control period, the emulator knows when that was.

use bus::{Range, Trace};
use hallservo_protocol::Telemetry;
use serde::Serialize;

/// Error of the drive's electrical angle, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AngleError {
    /// Mean.
    pub mean_deg: f64,
    /// Root mean square about the mean.
    pub rms_deg: f64,
    /// Largest magnitude, about the mean.
    pub max_deg: f64,
    /// Telemetry frames that this is of.
    pub count: u64,
}

/// When control periods begin.
#[derive(Clone, Copy, Debug, Default)]
pub struct Periods {
    /// Beginnings so far.
    pub count: u64,
    /// The last one's sampling instant, seconds.
    pub last_s: f64,
    /// From one to the next, seconds.
    pub period_s: f64,
}

impl Periods {
    /// When period `step` sampled, the first one being 0.
    pub fn at_s(&self, step: u32) -> f64 {
        self.last_s - (self.count as f64 - 1.0 - f64::from(step)) * self.period_s
    }
}

/// Turns of the electrical angle at an instant, between the rows of a trace; `None` outside it.
fn electrical_turns(trace: &Trace, at_s: f64) -> Option<f64> {
    let column = |name: &str| trace.names.iter().position(|known| known == name);
    let turns = column("electrical angle / turns")?;
    let next = trace.rows.partition_point(|row| row[0] <= at_s);
    let (before, after) = (trace.rows.get(next.checked_sub(1)?)?, trace.rows.get(next)?);
    let part = (at_s - before[0]) / (after[0] - before[0]);
    // Less than half a turn from row to row: up to 2000 turns a second.
    let step = after[turns] - before[turns];
    let step = step - step.round();
    Some(before[turns] + part * step)
}

/// Over frames within a span of time, seconds; `None` where there are none.
pub fn error(
    frames: &[Telemetry],
    periods: &Periods,
    trace: &Trace,
    span_s: core::ops::Range<f64>,
) -> Option<AngleError> {
    let errors: Vec<_> = frames
        .iter()
        .filter_map(|frame| {
            let at_s = periods.at_s(frame.step);
            let truth = span_s.contains(&at_s).then(|| electrical_turns(trace, at_s))??;
            let turns = f64::from(frame.angle_deg) / 360.0 - truth;
            Some((turns - turns.round()) * 360.0)
        })
        .collect();
    let count = errors.len() as f64;
    let mean_deg = errors.iter().sum::<f64>() / count;
    let mut range = Range::default();
    errors.iter().for_each(|error| range.add((error - mean_deg).abs()));
    let squares: f64 = errors.iter().map(|error| (error - mean_deg).powi(2)).sum();
    (range.count > 0).then(|| AngleError {
        mean_deg,
        rms_deg: (squares / count).sqrt(),
        max_deg: range.max,
        count: range.count,
    })
}
