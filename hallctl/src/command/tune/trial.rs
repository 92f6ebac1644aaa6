//! A pair of bandwidths that is tried: a step of the speed, and one of the position, after which the motor stands.

use super::Bandwidths;
use crate::client::Client;
use crate::command::response::Wanted;
use crate::command::session::{Session, Trace};
use crate::error::Result;
use crate::response::{Point, Step};
use std::f64::consts::TAU;

/// From the step on, s.
const RECORD_S: f64 = 0.4;
/// The same of the position: the motor stands long enough for a slow swing to be seen.
const STAND_S: f64 = 0.8;
/// Time constants of the position until a step of it has settled.
const SETTLED: f64 = 5.0;
/// Step of the position, turns.
pub(super) const TURNS: f64 = 0.1;
/// Telemetry, Hz.
const HZ: f32 = 500.0;

/// What a motor does that is asked for nothing new.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(super) struct Noise {
    /// RMS about the mean, rad/s.
    pub speed_rad_s: f64,
    /// The same, A; not a number where it is not measured.
    pub current_a: f64,
}

impl Noise {
    const UNKNOWN: Self = Self { speed_rad_s: f64::NAN, current_a: f64::NAN };

    fn of(tail: &[Trace]) -> Self {
        let rms = |value: fn(&Trace) -> f64| {
            let mean = tail.iter().map(value).sum::<f64>() / tail.len() as f64;
            (tail.iter().map(|row| (value(row) - mean).powi(2)).sum::<f64>() / tail.len() as f64).sqrt()
        };
        Self { speed_rad_s: rms(|row| row.speed_rad_s), current_a: rms(|row| row.current_a) }
    }
}

/// What came of it.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(super) struct Trial {
    pub bandwidth_hz: f32,
    pub position_bandwidth_hz: f32,
    /// Of the speed.
    pub step: Step,
    /// Of the position.
    pub position_step: Step,
    /// At the speed after the step, and standing.
    pub turning: Noise,
    pub standing: Noise,
    /// The loop swung so far that the drive switched off, and the rest is nothing.
    pub switched_off: bool,
}

impl Trial {
    /// With bandwidths that are set.
    pub fn of(client: &mut Client, wanted: &Wanted, bandwidths: Bandwidths) -> Result<Self> {
        let (step, turning) = made(client, RECORD_S, |_| *wanted)?;
        let (position_step, standing) = stand(client, bandwidths, STAND_S)?;
        let Bandwidths { speed_hz: bandwidth_hz, position_hz: position_bandwidth_hz } = bandwidths;
        Ok(Self { bandwidth_hz, position_bandwidth_hz, step, position_step, turning, standing, switched_off: false })
    }

    /// One at which the drive switched off.
    pub fn switched_off(bandwidths: Bandwidths) -> Self {
        Self {
            bandwidth_hz: bandwidths.speed_hz,
            position_bandwidth_hz: bandwidths.position_hz,
            step: Step::default(),
            position_step: Step::default(),
            turning: Noise::UNKNOWN,
            standing: Noise::UNKNOWN,
            switched_off: true,
        }
    }

    /// The same speed loop with another bandwidth of the position, which is set.
    pub fn with_position(&self, client: &mut Client, position_hz: f32) -> Result<Self> {
        let bandwidths = Bandwidths { speed_hz: self.bandwidth_hz, position_hz };
        let (position_step, standing) = stand(client, bandwidths, STAND_S)?;
        Ok(Self { position_bandwidth_hz: position_hz, position_step, standing, ..*self })
    }

    pub const fn bandwidths(&self) -> Bandwidths {
        Bandwidths { speed_hz: self.bandwidth_hz, position_hz: self.position_bandwidth_hz }
    }
}

/// A step of the position, after which the motor stands for so long at least.
pub(super) fn stand(client: &mut Client, bandwidths: Bandwidths, least_s: f64) -> Result<(Step, Noise)> {
    let seconds = least_s.max(2.0 * SETTLED / (TAU * f64::from(bandwidths.position_hz)));
    made(client, seconds, |session| Wanted::position(session.began_turns(), TURNS))
}

/// Makes a step: its figures, and the noise of its second half.
fn made(client: &mut Client, seconds: f64, wanted: impl Fn(&Session<'_>) -> Wanted) -> Result<(Step, Noise)> {
    let (wanted, trace) = Session::run(client, HZ, |session| {
        let wanted = wanted(session);
        wanted.step(session, seconds).map(|()| wanted)
    })?;
    let began_s = wanted.began_s(&trace);
    let since = &trace[trace.partition_point(|row| row.time_s < began_s)..];
    let points: Vec<Point> = since.iter().map(|row| (row.time_s - began_s, row.measured)).collect();
    let (from, to) = wanted.ends();
    Ok((Step::of(&points, from, to), Noise::of(&since[since.len() / 2..])))
}
