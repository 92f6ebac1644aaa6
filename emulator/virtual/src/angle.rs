//! The drive's angle against the motor's: telemetry names the control period, the emulator knows when that was.

use chip::Trace;
use hallservo::mode::Mode;
use hallservo_protocol::Telemetry;
use measure::Range;
use serde::Serialize;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Telemetry is of a period that is not longer ago than this, seconds.
const MEMORY_S: f64 = 0.5;
/// The speed is constant where it changes by less than this, rad/s² …
const STEADY_RAD_S2: f64 = 100.0;
/// … on average over so long before and after, seconds.
const STEADY_S: f64 = 0.05;

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

impl AngleError {
    /// Of errors in degrees; `None` where there are none.
    pub fn of(errors_deg: impl Iterator<Item = f64>) -> Option<Self> {
        let errors: Vec<_> = errors_deg.collect();
        let count = errors.len() as f64;
        let mean_deg = errors.iter().sum::<f64>() / count;
        let mut range = Range::default();
        errors.iter().for_each(|error| range.add((error - mean_deg).abs()));
        let squares: f64 = errors.iter().map(|error| (error - mean_deg).powi(2)).sum();
        (range.count > 0).then(|| Self {
            mean_deg,
            rms_deg: (squares / count).sqrt(),
            max_deg: range.max,
            count: range.count,
        })
    }
}

/// The error apart where the motor keeps its speed, and where it does not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AngleErrors {
    /// At constant speed, at rest too.
    pub constant_speed: Option<AngleError>,
    /// While the motor starts, stops, reverses.
    pub transients: Option<AngleError>,
}

impl AngleErrors {
    /// Both; `None` where there is neither.
    pub fn of(deviations: &[Deviation]) -> Option<Self> {
        let [constant_speed, transients] = [true, false]
            .map(|steady| AngleError::of(deviations.iter().filter(|one| one.steady == steady).map(|one| one.deg)));
        constant_speed.or(transients).map(|_| Self { constant_speed, transients })
    }
}

/// A frame of telemetry, and when the period that it is of was triggered, seconds.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// The trigger.
    pub at_s: f64,
    /// The frame.
    pub frame: Telemetry,
}

/// What one frame's angle was off by.
#[derive(Clone, Copy, Debug)]
pub struct Deviation {
    /// When the Halls were sampled, seconds.
    pub at_s: f64,
    /// Electrical degrees, −180 to 180: the drive's less the motor's.
    pub deg: f64,
    /// Whether the motor kept its speed about then.
    pub steady: bool,
}

/// When control periods were triggered. The drive numbers those that it saw, from 0 at each reset; while a flash
/// operation holds the core, triggers come that it does not see, so a number tells a time only by the numbers near it.
#[derive(Clone, Debug, Default)]
pub struct Periods {
    /// Number and trigger of some, in order.
    seen: VecDeque<(u32, f64)>,
}

impl Periods {
    /// A period, later than all before.
    pub fn saw(&mut self, number: u32, trigger_s: f64) {
        self.seen.push_back((number, trigger_s));
        while self.seen.front().is_some_and(|(_, at_s)| *at_s < trigger_s - MEMORY_S) {
            self.seen.pop_front();
        }
    }

    /// When a period was triggered, counted back from the next that is known, at periods of `period_s`.
    pub fn at_s(&self, number: u32, period_s: f64) -> Option<f64> {
        let (known, at_s) = *self.seen.get(self.seen.partition_point(|(known, _)| *known < number))?;
        Some(at_s - f64::from(known - number) * period_s)
    }
}

/// Angles that a trace gives between its rows.
struct Angles<'a> {
    trace: &'a Trace,
    electrical: usize,
    mechanical: usize,
}

impl<'a> Angles<'a> {
    fn of(trace: &'a Trace) -> Option<Self> {
        let column = |name: &str| trace.names.iter().position(|known| known == name);
        Some(Self { trace, electrical: column("electrical angle / turns")?, mechanical: column("angle / turns")? })
    }

    /// Rows about an instant, and how far from the first to the second it is; `None` outside the trace.
    fn about(&self, at_s: f64) -> Option<(&[f64], &[f64], f64)> {
        let next = self.trace.rows.partition_point(|row| row[0] <= at_s);
        let (before, after) = (self.trace.rows.get(next.checked_sub(1)?)?, self.trace.rows.get(next)?);
        Some((before, after, (at_s - before[0]) / (after[0] - before[0])))
    }

    fn electrical_turns(&self, at_s: f64) -> Option<f64> {
        let (before, after, part) = self.about(at_s)?;
        // Less than half a turn from row to row: up to 2000 turns a second.
        let step = after[self.electrical] - before[self.electrical];
        let step = step - step.round();
        Some(before[self.electrical] + part * step)
    }

    fn mechanical_turns(&self, at_s: f64) -> Option<f64> {
        let (before, after, part) = self.about(at_s)?;
        Some(before[self.mechanical] + part * (after[self.mechanical] - before[self.mechanical]))
    }

    /// Whether the speed is constant about an instant; not where the trace begins or ends.
    fn is_steady(&self, at_s: f64) -> bool {
        let turns = [at_s - STEADY_S, at_s, at_s + STEADY_S].map(|at_s| self.mechanical_turns(at_s));
        let [Some(before), Some(now), Some(after)] = turns else { return false };
        ((after - 2.0 * now + before) * TAU).abs() < STEADY_RAD_S2 * STEADY_S * STEADY_S
    }
}

/// What the angles of frames were off by whose Halls were sampled within a span of time, seconds; `held_s` after the
/// trigger. Only of a drive that knows its rotor: in a calibration it tells the field's angle.
pub fn deviations(told: &[Told], held_s: f64, trace: &Trace, span_s: core::ops::Range<f64>) -> Vec<Deviation> {
    let Some(angles) = Angles::of(trace) else { return Vec::new() };
    let knows = |told: &&Told| matches!(told.frame.mode, Mode::Ready | Mode::Running);
    told.iter()
        .filter(knows)
        .filter_map(|told| {
            let at_s = told.at_s + held_s;
            let truth = span_s.contains(&at_s).then(|| angles.electrical_turns(at_s))??;
            let turns = f64::from(told.frame.angle_deg) / 360.0 - truth;
            Some(Deviation { at_s, deg: (turns - turns.round()) * 360.0, steady: angles.is_steady(at_s) })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 50e-6;

    /// A trace of a motor, by its mechanical turns over time; two pole pairs.
    fn trace(turns: impl Fn(f64) -> f64) -> Trace {
        let rows = (0..8000).map(|row| {
            let (at_s, turns) = (f64::from(row) * 250e-6, turns(f64::from(row) * 250e-6));
            vec![at_s, turns, 2.0 * turns - (2.0 * turns).round()]
        });
        let names = ["time / s", "angle / turns", "electrical angle / turns"];
        Trace { names: names.map(String::from).to_vec(), rows: rows.collect() }
    }

    fn frame(turns: f64) -> Telemetry {
        let electrical = 2.0 * turns - (2.0 * turns).round();
        Telemetry { angle_deg: (360.0 * electrical) as f32, mode: Mode::Running, ..Telemetry::default() }
    }

    #[test]
    fn a_period_keeps_its_time_where_the_core_was_held() {
        let mut periods = Periods::default();
        // Every third is noticed. Before number 12, 440 triggers pass unseen: 22 ms.
        let at_s = |number: u32| f64::from(number + if number < 12 { 0 } else { 440 }) * PERIOD_S;
        for number in [2, 5, 8, 11, 14, 17] {
            periods.saw(number, at_s(number));
        }
        for number in 0..18 {
            let found_s = periods.at_s(number, PERIOD_S).unwrap();
            assert!((found_s - at_s(number)).abs() < 1e-12, "{number}: {found_s}");
        }
        assert_eq!(periods.at_s(18, PERIOD_S), None);
    }

    #[test]
    fn errors_are_told_apart_by_the_motor_s_acceleration() {
        // 5 turns a second until 1 s, then −5; the drive lags by 1° electrical, and by 3° about the reversal.
        let turns = |at_s: f64| if at_s < 1.0 { 5.0 * at_s } else { 10.0 - 5.0 * at_s };
        let held_s = 1.5e-6;
        let told = (100..1900).map(|ms| {
            let trigger_s = f64::from(ms) * 1e-3;
            let lag_deg = if (970..1030).contains(&ms) { 3.0 } else { 1.0 };
            Told { at_s: trigger_s, frame: frame(turns(trigger_s + held_s) - lag_deg / 720.0) }
        });
        let told: Vec<_> = told.collect();
        let found = deviations(&told, held_s, &trace(turns), 0.0..f64::INFINITY);
        assert_eq!(found.len(), 1800);
        let errors = AngleErrors::of(&found).unwrap();
        let (constant, transients) = (errors.constant_speed.unwrap(), errors.transients.unwrap());
        assert!((constant.mean_deg + 1.0).abs() < 1e-3 && constant.max_deg < 2e-3, "{constant:?}");
        // All of the 60 frames with 3°, and the others within 50 ms of the reversal.
        assert!((75..100).contains(&transients.count), "{transients:?}");
        assert!(transients.mean_deg < -2.0, "{transients:?}");
        assert!(deviations(&told, held_s, &trace(turns), 3.0..4.0).is_empty());
    }

    #[test]
    fn a_drive_that_tells_the_field_s_angle_is_not_judged() {
        let told = [Mode::Aligning, Mode::Calibrating, Mode::Unarmed, Mode::Ready, Mode::Running]
            .map(|mode| Told { at_s: 0.5, frame: Telemetry { mode, ..frame(0.0) } });
        assert_eq!(deviations(&told, 0.0, &trace(|at_s| at_s), 0.0..1.0).len(), 2);
    }
}
