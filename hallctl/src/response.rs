//! What a motor makes of a step or a sine that it is told to follow.

use std::f64::consts::TAU;

/// A time in seconds, and a value.
pub type Point = (f64, f64);

/// A motion with limited speed and acceleration from rest to rest, or from speed to speed: what the drive's own
/// trajectory asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    from: f64,
    to: f64,
    /// Time of the acceleration, and of constant speed, s.
    ramp_s: f64,
    hold_s: f64,
    /// Whether the value is a position, which is accelerated and braked.
    position: bool,
}

impl Profile {
    /// From one speed to another.
    pub fn speed(from: f64, to: f64, acceleration: f64) -> Self {
        Self { from, to, ramp_s: (to - from).abs() / acceleration, hold_s: 0.0, position: false }
    }

    /// From one position to another, both at rest.
    pub fn position(from: f64, to: f64, acceleration: f64, fastest: f64) -> Self {
        let distance = (to - from).abs();
        let ramp_s = (distance / acceleration).sqrt().min(fastest / acceleration);
        let hold_s = if ramp_s > 0.0 { (distance / (acceleration * ramp_s) - ramp_s).max(0.0) } else { 0.0 };
        Self { from, to, ramp_s, hold_s, position: true }
    }

    /// After a time.
    pub fn at(&self, time_s: f64) -> f64 {
        let Self { from, to, ramp_s, hold_s, position } = *self;
        let share = match position {
            _ if time_s <= 0.0 => 0.0,
            _ if ramp_s == 0.0 => 1.0,
            false => (time_s / ramp_s).min(1.0),
            true => {
                let (end_s, whole) = (2.0 * ramp_s + hold_s, ramp_s * (ramp_s + hold_s));
                let half = |time: f64| time * time / 2.0;
                let way = if time_s < ramp_s {
                    half(time_s)
                } else if time_s < ramp_s + hold_s {
                    ramp_s * (time_s - ramp_s / 2.0)
                } else {
                    whole - half((end_s - time_s).max(0.0))
                };
                way / whole
            }
        };
        from + share * (to - from)
    }
}

/// Figures of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Step {
    /// From 10 to 90 %, s; none where it does not get there.
    pub rise_s: Option<f64>,
    /// Beyond the target, in per cent of the step; below the noise it is none.
    pub overshoot_pct: f64,
    /// Until it stays within 5 % of the step, or within the noise; none where it does not.
    pub settling_s: Option<f64>,
    /// How far the mean of the last quarter is off the target.
    pub error: f64,
    /// RMS about that mean.
    pub noise: f64,
}

/// Band of a settled value, as a share of the step.
const SETTLED: f64 = 0.05;
/// Peaks of a noise, in its RMS.
const PEAKS: f64 = 4.0;

impl Step {
    /// Of points from the time of the step on, which is zero.
    pub fn of(points: &[Point], from: f64, to: f64) -> Self {
        let size = to - from;
        let tail = &points[points.len() - points.len() / 4..];
        if tail.is_empty() || size == 0.0 {
            return Self::default();
        }
        let mean = tail.iter().map(|point| point.1).sum::<f64>() / tail.len() as f64;
        let noise = (tail.iter().map(|point| (point.1 - mean).powi(2)).sum::<f64>() / tail.len() as f64).sqrt();
        let share = |value: f64| (value - from) / size;
        let reached = |wanted: f64| points.iter().find(|point| share(point.1) >= wanted).map(|point| point.0);
        let most = points.iter().map(|point| share(point.1)).fold(f64::MIN, f64::max);
        let beyond = (most - 1.0) * size.abs() - PEAKS * noise;
        let band = (SETTLED * size.abs()).max(PEAKS * noise);
        let outside = points.iter().rposition(|point| (point.1 - to).abs() > band);
        let settled = outside.map_or(points.first(), |last| points.get(last + 1));
        Self {
            rise_s: reached(0.1).zip(reached(0.9)).map(|(low, high)| high - low),
            overshoot_pct: if beyond > 0.0 { 100.0 * (most - 1.0) } else { 0.0 },
            settling_s: settled.map(|point| point.0),
            error: mean - to,
            noise,
        }
    }

    /// The same with an overshoot only as far as it is beyond the noise: that of after the step, and what there was of it
    /// at rest before, which of a small step is a large share.
    pub fn beyond_noise(self, size: f64, before: &[Point]) -> Self {
        let mean = before.iter().map(|point| point.1).sum::<f64>() / before.len() as f64;
        let peak = before.iter().map(|point| (point.1 - mean).abs()).fold(0.0, f64::max);
        let noise_pct = 100.0 * peak.max(PEAKS * self.noise) / size.abs();
        Self { overshoot_pct: (self.overshoot_pct - noise_pct).max(0.0), ..self }
    }

    /// Whether the noise is as large as the step.
    pub fn is_lost(&self, size: f64) -> bool {
        PEAKS * self.noise >= size.abs()
    }

    /// The same without times where they are those of the noise.
    pub fn unless_lost(self, size: f64) -> Self {
        if self.is_lost(size) { Self { rise_s: None, settling_s: None, ..self } } else { self }
    }
}

/// Gain and phase at a frequency.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Sine {
    /// Hz
    pub hz: f64,
    /// Amplitude over that of the set-point.
    pub gain: f64,
    /// Phase against it, degrees; behind is negative.
    pub phase_deg: f64,
}

impl Sine {
    /// Of what was set and what was measured at the same times: least squares of a sine with a mean each. Nothing where
    /// set-points or frames came too seldom: less than half of the amplitude `size` was set then.
    pub fn of(set: &[Point], measured: &[Point], hz: f64, size: f64) -> Option<Self> {
        let (set, measured) = (phasor(set, hz)?, phasor(measured, hz)?);
        let norm = set.0 * set.0 + set.1 * set.1;
        if norm.is_nan() || norm < (size / 2.0).powi(2) {
            return None;
        }
        let ratio =
            ((measured.0 * set.0 + measured.1 * set.1) / norm, (measured.1 * set.0 - measured.0 * set.1) / norm);
        let phase_deg = ratio.1.atan2(ratio.0).to_degrees();
        Some(Self { hz, gain: ratio.0.hypot(ratio.1), phase_deg })
    }

    /// Phase margin of the loop, degrees, if this is where its gain is one: from closed loop T to open loop T/(1 − T).
    pub fn open_loop(&self) -> (f64, f64) {
        let (sin, cos) = self.phase_deg.to_radians().sin_cos();
        let (re, im) = (self.gain * cos, self.gain * sin);
        let norm = (1.0 - re).powi(2) + im * im;
        let open = ((re * (1.0 - re) - im * im) / norm, im / norm);
        (open.0.hypot(open.1), open.1.atan2(open.0).to_degrees())
    }
}

/// Amplitude along cosine and minus sine.
fn phasor(points: &[Point], hz: f64) -> Option<(f64, f64)> {
    points.first()?;
    let mut squares = [[0.0; 4]; 3];
    for &(time_s, value) in points {
        let (sin, cos) = (TAU * hz * time_s).sin_cos();
        let row = [1.0, cos, -sin];
        for i in 0..3 {
            for j in 0..3 {
                squares[i][j] += row[i] * row[j];
            }
            squares[i][3] += row[i] * value;
        }
    }
    for k in 0..3 {
        let pivot = squares[k];
        if pivot[k].abs() < 1e-9 * points.len() as f64 {
            return None;
        }
        for i in 0..3 {
            if i != k {
                let factor = squares[i][k] / pivot[k];
                (0..4).for_each(|j| squares[i][j] -= factor * pivot[j]);
            }
        }
    }
    Some((squares[1][3] / squares[1][1], squares[2][3] / squares[2][2]))
}

/// −3 dB.
pub const LOW: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Bandwidth: the frequency at which the gain falls below −3 dB, between two that were measured; and the phase margin
/// of the open loop, where its gain is one.
pub fn bandwidth(sines: &[Sine]) -> (Option<f64>, Option<f64>) {
    let between = |a: f64, b: f64, wanted: f64| (a.ln() - wanted.ln()) / (a.ln() - b.ln());
    let bandwidth_hz = sines.windows(2).find(|pair| pair[0].gain >= LOW && pair[1].gain < LOW).map(|pair| {
        let share = between(pair[0].gain, pair[1].gain, LOW);
        pair[0].hz * (pair[1].hz / pair[0].hz).powf(share)
    });
    let open: Vec<_> = sines.iter().map(Sine::open_loop).collect();
    let margin_deg = open.windows(2).find(|pair| pair[0].0 >= 1.0 && pair[1].0 < 1.0).map(|pair| {
        let share = between(pair[0].0, pair[1].0, 1.0);
        180.0 + pair[0].1 + share * (pair[1].1 - pair[0].1)
    });
    (bandwidth_hz, margin_deg)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A response of second order, 200 Hz of bandwidth, sampled with 10 kHz.
    fn second_order(damping: f64) -> Vec<Point> {
        let (mut value, mut speed, omega, step_s) = (0.0, 0.0, TAU * 20.0, 1e-4);
        (0..5000)
            .map(|k| {
                let point = (f64::from(k) * step_s, 3.0 + 2.0 * value);
                for _ in 0..10 {
                    speed += omega * (omega * (1.0 - value) - 2.0 * damping * speed) * step_s / 10.0;
                    value += speed * step_s / 10.0;
                }
                point
            })
            .collect()
    }

    #[test]
    fn a_step_of_second_order_has_the_figures_of_the_textbook() {
        for damping in [0.3_f64, 0.5, 0.7] {
            let step = Step::of(&second_order(damping), 3.0, 5.0);
            let overshoot = 100.0 * (-std::f64::consts::PI * damping / (1.0 - damping * damping).sqrt()).exp();
            assert!((step.overshoot_pct - overshoot).abs() < 0.5, "{damping}: {step:?}, not {overshoot}");
            assert!(step.error.abs() < 1e-3 && step.settling_s.is_some(), "{step:?}");
        }
        let rise_s = Step::of(&second_order(0.7), 3.0, 5.0).rise_s.unwrap();
        assert!((rise_s * TAU * 20.0 - 2.13).abs() < 0.05, "{rise_s}");
    }

    /// A peak now and then, of five times the RMS, as cogging and uneven magnets make them.
    #[test]
    fn noise_is_no_overshoot() {
        let noise = |k: i32| if k.rem_euclid(50) == 7 { 1.0 } else { 0.14 * f64::from(k.rem_euclid(3) - 1) };
        let points = |from: i32, to: f64| -> Vec<Point> {
            (from..from + 250).map(|k| (f64::from(k) * 2e-3, to + noise(k))).collect()
        };
        let before = points(-250, 0.0);
        let found = Step::of(&points(0, 2.0), 0.0, 2.0);
        assert!(found.overshoot_pct > 45.0, "{found:?}");
        let found = found.beyond_noise(2.0, &before);
        assert!(found.overshoot_pct < 2.0, "{found:?}");
        // Of the step itself, it is told.
        let mut beyond = points(0, 20.0);
        beyond.iter_mut().take(100).for_each(|point| point.1 += 8.0);
        let found = Step::of(&beyond, 0.0, 20.0).beyond_noise(20.0, &before);
        assert!((36.0..44.0).contains(&found.overshoot_pct), "{found:?}");
        // Without any, it is as it was.
        let quiet = Step::of(&second_order(0.3), 3.0, 5.0);
        assert!((quiet.beyond_noise(2.0, &[]).overshoot_pct - quiet.overshoot_pct).abs() < 0.1, "{quiet:?}");
    }

    #[test]
    fn what_does_not_follow_has_no_rise() {
        let flat: Vec<_> = (0..100).map(|k| (f64::from(k) * 0.01, 0.0)).collect();
        let step = Step::of(&flat, 0.0, 1.0);
        assert!(step.rise_s.is_none() && step.settling_s.is_none() && (step.error + 1.0).abs() < 1e-12);
        assert_eq!(Step::of(&[], 0.0, 1.0), Step::default());
    }

    #[test]
    fn a_profile_keeps_its_limits_and_arrives() {
        for (distance, fastest) in [(2.0, 100.0), (-50.0, 3.0)] {
            let profile = Profile::position(1.0, 1.0 + distance, 10.0, fastest);
            let at = |k: i32| profile.at(f64::from(k) * 1e-3);
            assert_eq!(at(-1), 1.0);
            assert!((profile.at(1e3) - 1.0 - distance).abs() < 1e-9);
            for k in 1..40_000 {
                let speed = (at(k) - at(k - 1)) / 1e-3;
                let acceleration = (at(k + 1) - 2.0 * at(k) + at(k - 1)) / 1e-6;
                assert!(speed.abs() <= fastest * 1.001 && acceleration.abs() <= 10.01, "{k}: {speed} {acceleration}");
            }
        }
        assert!((Profile::speed(0.0, 100.0, 1000.0).at(0.05) - 50.0).abs() < 1e-9);
    }

    #[test]
    fn a_sine_behind_a_first_order_lag_is_as_in_the_textbook() {
        let lag_hz = 10.0_f64;
        let sines: Vec<_> = [1.0, 2.0, 5.0, 10.0, 20.0, 40.0]
            .into_iter()
            .map(|hz| {
                let ratio = hz / lag_hz;
                let (gain, phase) = (1.0 / (1.0 + ratio * ratio).sqrt(), -f64::atan(ratio));
                let time = |k: i32| f64::from(k) * 1.3e-3;
                let set: Vec<_> = (0..3000).map(|k| (time(k), 4.0 + 2.0 * (TAU * hz * time(k)).sin())).collect();
                let found: Vec<_> =
                    (0..3000).map(|k| (time(k), 4.1 + 2.0 * gain * (TAU * hz * time(k) + phase).sin())).collect();
                let sine = Sine::of(&set, &found, hz, 1.0).unwrap();
                assert!(
                    (sine.gain - gain).abs() < 1e-6 && (sine.phase_deg - phase.to_degrees()).abs() < 1e-4,
                    "{sine:?}"
                );
                sine
            })
            .collect();
        let (bandwidth_hz, margin_deg) = bandwidth(&sines);
        assert!((bandwidth_hz.unwrap() - lag_hz).abs() < 0.3, "{bandwidth_hz:?}");
        // An integrator alone: 90 degrees, at the same frequency.
        assert!((margin_deg.unwrap() - 90.0).abs() < 1.0, "{margin_deg:?}");
        assert_eq!(Sine::of(&[], &[], 1.0, 1.0), None);
    }
}
