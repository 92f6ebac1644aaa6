//! The field of the windings in what the Halls see: how far a current along q turns the angle that they show.
//!
//! The torque of a rotor at rest steps up. The rotor cannot leap: its angle goes on as a parabola. What the Halls show
//! leaps with the current. From recordings of such steps, each a regression of the angle that the Halls show:
//!
//! `θ = θ₀ + ω t + ½ a t² + c i_q + κ ∬ i_q dt²`
//!
//! with the coil field's c, in degrees an ampere, what the current accelerates by, κ, and what else moves the rotor. The
//! result is the mean of c over the recordings; their scatter is its error, which thereby contains what depends on where
//! the rotor rested: Halls that do not see the windings alike.
//!
//! Not on the chip: the tool records, computes, and sets `hall_coil_deg_a`.

use super::identify::{AMPERES, Estimate, Fit, MOST};
use crate::control::Config;

/// A row of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Time since the step, s; before it negative.
    pub time_s: f32,
    /// Angle that the Halls show, electrical degrees; without leaps of whole turns.
    pub angle_deg: f32,
    /// Current along q, A.
    pub current_a: f32,
}

/// Rows of a recording, one a control period: what the smallest scope holds.
pub const ROWS: usize = 128;
/// How many of them are before the step.
pub const BEFORE: u16 = 48;
/// Steps to record.
pub const STEPS: u32 = 40;

/// How the steps are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    size_a: f32,
    /// Whether a step turns the rotor up so fast that the speed control has to stop it before the next one. It then rests
    /// elsewhere each time, as the position control has it. A heavy rotor drifts on by steps alone: where the coil field
    /// is large, its loops would swing.
    pub is_light: bool,
}

impl Plan {
    /// Steps to half of the largest current.
    pub fn new(control: &Config) -> Self {
        let Config { scale, motor, .. } = control;
        let size_a = SIZE * control.largest_current_a();
        let torque_nm = size_a * motor.torque_constant(scale.pole_pairs);
        Self { size_a, is_light: scale.pole_pairs * torque_nm / motor.inertia_kgm2 * LASTS_S > FAST_RAD_S }
    }

    /// Current along q of a step, A.
    pub fn step_a(&self, step: u32) -> f32 {
        // A heavy rotor is turned up, and stopped by as many steps the other way.
        let pace = if self.is_light { 1 } else { 2 };
        if (step / pace).is_multiple_of(2) { self.size_a } else { -self.size_a }
    }

    /// Where a light rotor rests before a step, in electrical turns from where it was at first.
    pub fn place(&self, step: u32) -> f64 {
        (ON * f64::from(step)) % 1.0
    }
}

/// Share of the largest current.
const SIZE: f32 = 0.5;
/// From step to step a light rotor goes on by this share of an electrical turn, so that it rests everywhere.
const ON: f64 = 0.381_966;
/// Until a tool has ended a step, s; and what a heavy rotor turns up by meanwhile at most, electrical rad/s.
const LASTS_S: f32 = 0.02;
const FAST_RAD_S: f32 = 60.0;
/// Fewest recordings for a result.
pub const LEAST: usize = 4;
/// A rotor that has turned farther since the step, electrical degrees, is under other magnets.
const FAR_DEG: f32 = 20.0;
/// Fewest rows after the step.
const LEAST_ROWS: usize = 24;

/// What recordings of steps tell, to and fro, all with the same times: electrical degrees an ampere. `None` where there
/// are fewer than [`LEAST`] that tell anything.
pub fn field(recordings: &[&[Row]]) -> Option<Estimate> {
    let current_a = mean_current(recordings);
    let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
    for leap in recordings.iter().filter_map(|rows| leap(rows, &current_a)) {
        count += 1.0;
        sum += leap;
        square += leap * leap;
    }
    if count < LEAST as f32 {
        return None;
    }
    let value = sum / count;
    let variance = (square / count - value * value).max(0.0) / (count - 1.0);
    Some(Estimate { value, error: 3.0 * crate::float::root(variance) }.beside(AMPERES + SHAPE))
}

/// Share by which the noise of the current and its shape may mislead.
const SHAPE: f32 = 0.03;

/// The current of a step to positive: the mean of all recordings, and once it has settled what it is in the end. The noise
/// of a regressor would make its coefficient too small.
fn mean_current(recordings: &[&[Row]]) -> [f32; ROWS] {
    let mut mean = [0.0; ROWS];
    for rows in recordings {
        for (mean, row) in mean.iter_mut().zip(*rows) {
            *mean += side(rows) * row.current_a / recordings.len() as f32;
        }
    }
    let Some(rows) = recordings.first().map(|rows| rows.get(..ROWS).unwrap_or(rows)) else { return mean };
    let Some(step) = rows.iter().position(|row| row.time_s >= 0.0) else { return mean };
    let (before, after) = mean[..rows.len()].split_at_mut(step);
    before.fill(average(before));
    let end = average(&after[after.len() / 2..]);
    if let Some(rise) = after.iter().position(|current| *current >= RISEN * end) {
        after.iter_mut().skip(SETTLED * (rise + 1)).for_each(|current| *current = end);
    }
    mean
}

fn average(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len().max(1) as f32
}

/// Share of the current in the end that it rises to in a time, and how many times that it takes to settle.
const RISEN: f32 = 0.8;
const SETTLED: usize = 3;

/// Whether a step goes to positive or to negative.
fn side(rows: &[Row]) -> f32 {
    rows.iter().map(|row| row.current_a).sum::<f32>().signum()
}

/// Degrees an ampere by which the angle leaps with the current of a step.
fn leap(rows: &[Row], current_a: &[f32; ROWS]) -> Option<f32> {
    let step = rows.iter().position(|row| row.time_s >= 0.0)?;
    let before = rows.get(..step).filter(|before| !before.is_empty())?;
    let rest_deg = before.iter().map(|row| row.angle_deg).sum::<f32>() / step as f32;
    let is_near = |row: &&Row| row.time_s < 0.0 || (row.angle_deg - rest_deg).abs() <= FAR_DEG;
    let count = rows.iter().take_while(is_near).count();
    let rows = rows.get(..count.max(step + LEAST_ROWS))?;
    // All regressors about one, for single precision.
    let span_s = rows.last()?.time_s;
    let largest_a = current_a.iter().fold(0.0_f32, |most, current| most.max(current.abs()));
    if !(span_s > 0.0 && largest_a > 0.0) {
        return None;
    }
    let mut fit = Fit::default();
    let (mut impulse, mut way, mut last) = (0.0, 0.0, 0.0);
    for (row, current_a) in rows.iter().zip(current_a) {
        let (time, current) = (row.time_s / span_s, current_a / largest_a);
        if time > 0.0 {
            impulse += current * (time - last);
            way += impulse * (time - last);
            last = time;
        }
        let regressors: [f32; MOST] = [1.0, time, time * time, current, way];
        fit.push(regressors, row.angle_deg - rest_deg, 1.0);
    }
    let [.., leap, _] = fit.solve(MOST)?;
    Some(side(rows) * leap.value / largest_a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    extern crate std;
    use std::vec::Vec;

    /// A step to `size_a` at a rotor that it accelerates by `acceleration` (°/s² an ampere), with `friction` taken off,
    /// at Halls that show `field_deg_a` too much. Rows of 25 µs.
    fn step(
        random: &mut Pcg64,
        size_a: f64,
        acceleration: f64,
        friction: f64,
        field_deg_a: f64,
        noise: f64,
    ) -> Vec<Row> {
        let rise_s = 160e-6;
        let drift = random.random_range(-50.0..50.0);
        (-48..80)
            .map(|k| {
                let time_s = f64::from(k) * 25e-6;
                let since = time_s.max(0.0);
                let decayed = libm::exp(-since / rise_s);
                let current = size_a * (1.0 - decayed);
                // The integrals of that current, and a friction that begins with the motion.
                let way = size_a * (since * since / 2.0 - rise_s * since + rise_s * rise_s * (1.0 - decayed));
                let moved = acceleration * way - friction * size_a.signum() * since * since / 2.0;
                let mut noisy = |size: f64| size * (random.random_range(-1.0..1.0) + random.random_range(-1.0..1.0));
                Row {
                    time_s: time_s as f32,
                    angle_deg: (77.0 + drift * time_s + moved + field_deg_a * current + noisy(noise)) as f32,
                    current_a: current as f32,
                }
            })
            .collect()
    }

    fn found(seed: u64, acceleration: f64, friction: f64, field_deg_a: f64, noise: f64) -> Estimate {
        found_with(seed, acceleration, friction, field_deg_a, noise, 0.02)
    }

    fn found_with(seed: u64, acceleration: f64, friction: f64, field_deg_a: f64, noise: f64, noise_a: f64) -> Estimate {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut steps = (0..24).map(|k| {
            let size_a = if k % 2 == 0 { 1.5 } else { -1.5 };
            let mut rows = step(&mut random, size_a, acceleration, friction, field_deg_a, noise);
            rows.iter_mut().for_each(|row| row.current_a += random.random_range(-noise_a..noise_a) as f32);
            rows
        });
        let steps: [_; 24] = core::array::from_fn(|_| steps.next().unwrap());
        field(&steps.each_ref().map(Vec::as_slice)).unwrap()
    }

    #[test]
    fn tells_the_leap_from_what_the_rotor_moves() {
        for (seed, field_deg_a) in (1..).zip([-3.0, -0.4, 0.0, 0.4, 3.0, 12.0]) {
            // From what hardly moves to what moves 20° within the recording.
            for acceleration in [1e2, 1e5, 6e5, 6e6] {
                let Estimate { value, error } = found(seed, acceleration, 0.1 * acceleration, field_deg_a, 0.4);
                let off = (f64::from(value) - field_deg_a).abs();
                assert!(off <= f64::from(error), "{field_deg_a} {acceleration}: {value} ± {error}");
                assert!(f64::from(error) < 0.25 + 0.06 * field_deg_a.abs(), "{field_deg_a} {acceleration}: ± {error}");
            }
        }
    }

    #[test]
    fn noise_of_the_current_makes_nothing_of_it_smaller() {
        // As much noise as current: a gimbal motor at a board for a hundred times its current.
        let Estimate { value, error } = found_with(9, 1e5, 0.0, 3.0, 0.4, 0.75);
        assert!((value - 3.0).abs() < error && error < 0.5, "{value} ± {error}");
    }

    #[test]
    fn recordings_that_tell_nothing_are_not_taken() {
        let still: Vec<_> = (-50..50).map(|k| Row { time_s: k as f32, ..Row::default() }).collect();
        let lost: Vec<_> = still.iter().map(|row| Row { angle_deg: f32::NAN, current_a: 1.0, ..*row }).collect();
        for rows in [&[][..], &[Row::default(); 100], &still, &lost] {
            assert_eq!(field(&[rows; 9]), None);
        }
        assert_eq!(field(&[]), None);
    }
}
