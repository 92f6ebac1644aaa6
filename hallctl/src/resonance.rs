//! A load on a shaft that twists, found in the response of the rotor to its torque.
//!
//! Beside that of a stiff shaft, the response is `(b0 + b1·s + b2·s²)/(1 + a1·s + a2·s²)`: where the numerator is
//! least, the load takes all of the motion (anti-resonance); where the denominator is, rotor and load swing against each
//! other (resonance).

use num_complex::Complex64;
use std::ops::RangeInclusive;

/// A load on a shaft that twists.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Resonance {
    /// Where the rotor stands still and the load swings.
    pub antiresonance_hz: f64,
    /// Where they swing against each other.
    pub resonance_hz: f64,
    /// Damping ratio of that.
    pub damping: f64,
}

/// What turns.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Load {
    /// Inertia of all of it, in that of the settings.
    pub inertia: f64,
    /// Where the shaft twists.
    pub resonance: Option<Resonance>,
    /// What that leaves of a point, in its variance: 1 where nothing but noise.
    pub misfit: f64,
}

/// The response at a frequency, in that of a stiff shaft and the inertia of the settings.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Hz
    pub hz: f64,
    /// Response.
    pub value: Complex64,
    /// Standard error of that.
    pub error: f64,
}

/// Points known worse than this share say nothing.
const DOUBT: f64 = 0.3;
/// No point is better known than to this share: the model of the loop is not exact.
const MODEL: f64 = 0.03;
/// Damping ratio from which on a load does not swing.
const DAMPED: f64 = 0.4;
/// The two frequencies, at least, one in the other.
const APART: f64 = 1.08;
/// A twist explains so many times more than a stiff shaft, at least.
const BETTER: f64 = 3.0;
/// Inertia in that of the settings, within which it is theirs.
const SAME: RangeInclusive<f64> = 0.7..=1.4;
/// What leaves more than this of a point, in its variance, explains nothing.
const WRONG: f64 = 50.0;
/// What leaves more than this says nothing of the inertia: a light rotor that cogs, or one whose current the supply limits,
/// answers as one of another inertia would.
const VAGUE: f64 = 4.0;
/// Of the weights, which depend on the denominator.
const ROUNDS: usize = 12;

impl Load {
    /// What explains a response; none if it is known too badly.
    pub fn of(points: &[Point]) -> Option<Self> {
        let points: Vec<_> = points.iter().filter(|point| point.error < DOUBT * point.value.norm()).copied().collect();
        if points.len() < 2 * UNKNOWN {
            return None;
        }
        let scale_hz = (points[0].hz * points[points.len() - 1].hz).sqrt();
        let stiff = Fit::of(&points, scale_hz, 0)?;
        let twists = Fit::of(&points, scale_hz, 2).filter(|fit| fit.left * BETTER < stiff.left);
        let resonance = twists.and_then(|fit| fit.resonance(&points));
        let fit = twists.filter(|_| resonance.is_some()).unwrap_or(stiff);
        // A swing that is known too badly is no stiff shaft.
        let misfit = fit.left / points.len() as f64;
        let explains = misfit < WRONG && fit.numerator[0] > 0.0;
        explains.then(|| Self { inertia: 1.0 / fit.numerator[0], resonance, misfit })
    }

    /// Whether the settings have another inertia.
    pub fn is_off(&self) -> bool {
        self.misfit < VAGUE && !SAME.contains(&self.inertia)
    }
}

/// Coefficients: b0, b1, b2, a1, a2.
const UNKNOWN: usize = 5;

/// A rational function of `s` in `scale_hz`.
#[derive(Clone, Copy, Debug)]
struct Fit {
    scale_hz: f64,
    numerator: [f64; 3],
    denominator: [f64; 3],
    /// Sum of the squares that it leaves unexplained.
    left: f64,
}

impl Fit {
    /// Least squares, with polynomials of order 2; or of order 0, a constant. What is linear in the unknown is the
    /// error times the denominator, which the weights of the next round take out again (Sanathanan and Koerner).
    fn of(points: &[Point], scale_hz: f64, order: usize) -> Option<Self> {
        let used: &[usize] = if order == 0 { &[0] } else { &[0, 1, 2, 3, 4] };
        let mut fit = Self { scale_hz, numerator: [1.0, 0.0, 0.0], denominator: [1.0, 0.0, 0.0], left: 0.0 };
        for _ in 0..ROUNDS {
            let mut squares = vec![vec![0.0; used.len() + 1]; used.len()];
            for point in points {
                let s = Complex64::new(0.0, point.hz / scale_hz);
                let weight = 1.0 / (deviation(point) * at(&fit.denominator, s).norm()).powi(2);
                let columns = [Complex64::ONE, s, s * s, -point.value * s, -point.value * s * s];
                for (row, &i) in used.iter().enumerate() {
                    for (column, &j) in used.iter().enumerate() {
                        squares[row][column] += weight * (columns[i].conj() * columns[j]).re;
                    }
                    squares[row][used.len()] += weight * (columns[i].conj() * point.value).re;
                }
            }
            let found = solve(squares)?;
            let get = |k: usize| found.get(k).copied().unwrap_or(0.0);
            fit.numerator = [get(0), get(1), get(2)];
            fit.denominator = [1.0, get(3), get(4)];
        }
        fit.left =
            points.iter().map(|point| ((fit.at(point.hz) - point.value).norm() / deviation(point)).powi(2)).sum();
        Some(fit)
    }

    fn at(&self, hz: f64) -> Complex64 {
        let s = Complex64::new(0.0, hz / self.scale_hz);
        at(&self.numerator, s) / at(&self.denominator, s)
    }

    /// What swings, where the points tell of it.
    fn resonance(&self, points: &[Point]) -> Option<Resonance> {
        let (antiresonance_hz, anti_damping) = self.swing(&self.numerator)?;
        let (resonance_hz, damping) = self.swing(&self.denominator)?;
        let within = antiresonance_hz > points[0].hz && resonance_hz < points[points.len() - 1].hz;
        let swings = damping.abs() < DAMPED && anti_damping.abs() < DAMPED;
        (within && swings && resonance_hz > APART * antiresonance_hz).then_some(Resonance {
            antiresonance_hz,
            resonance_hz,
            damping: damping.max(0.0),
        })
    }

    /// Natural frequency and damping ratio of a polynomial.
    fn swing(&self, [constant, linear, square]: &[f64; 3]) -> Option<(f64, f64)> {
        let omega = (constant / square).sqrt();
        omega.is_finite().then(|| (omega * self.scale_hz, linear / (2.0 * (constant * square).sqrt())))
    }
}

fn deviation(point: &Point) -> f64 {
    point.error.max(MODEL * point.value.norm())
}

fn at(polynomial: &[f64; 3], s: Complex64) -> Complex64 {
    polynomial[0] + s * (polynomial[1] + s * polynomial[2])
}

/// Linear equations by Gauss and Jordan, of a matrix that is positive definite; none if it is not.
fn solve(mut rows: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let count = rows.len();
    for k in 0..count {
        let pivot = rows[k].clone();
        if pivot[k].is_nan() || pivot[k] <= 0.0 {
            return None;
        }
        for (_, row) in rows.iter_mut().enumerate().filter(|(other, _)| *other != k) {
            let factor = row[k] / pivot[k];
            row.iter_mut().zip(&pivot).for_each(|(value, above)| *value -= factor * above);
        }
    }
    Some((0..count).map(|k| rows[k][count] / rows[k][k]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frequency::grid;
    use std::f64::consts::TAU;

    /// The response of a rotor with a load so many times as heavy, in that of the rotor alone.
    fn two_masses(times: f64, resonance_hz: f64, damping: f64, hz: f64) -> Complex64 {
        let s = Complex64::new(0.0, TAU * hz);
        let omega = TAU * resonance_hz;
        let (spring, damper) = (omega * omega / (1.0 + times), 2.0 * damping * omega / (1.0 + times));
        (s * s + damper * s + spring) / (s * s + (1.0 + times) * (damper * s + spring))
    }

    /// With 3 % of noise.
    fn response(value: impl Fn(f64) -> Complex64) -> Vec<Point> {
        let mut seed = 1_u32;
        let mut noise = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed) / f64::from(u32::MAX) - 0.5
        };
        grid(8.0, 500.0, 64)
            .into_iter()
            .map(|hz| {
                let value = value(hz) * Complex64::new(1.0 + 0.1 * noise(), 0.1 * noise());
                Point { hz, value, error: 0.03 * value.norm() }
            })
            .collect()
    }

    #[test]
    fn two_masses_are_found() {
        for (times, hz, damping) in [(3.0, 100.0, 0.02), (1.0, 60.0, 0.05), (8.0, 200.0, 0.01), (0.5, 150.0, 0.02)] {
            let found = Load::of(&response(|at| two_masses(times, hz, damping, at))).unwrap();
            let resonance = found.resonance.unwrap();
            assert!((found.inertia / (1.0 + times) - 1.0).abs() < 0.1, "{found:?}");
            assert!((resonance.resonance_hz / hz - 1.0).abs() < 0.03, "{found:?}");
            let expected_hz = hz / (1.0 + times).sqrt();
            assert!((resonance.antiresonance_hz / expected_hz - 1.0).abs() < 0.03, "{found:?}");
            assert!((resonance.damping - damping).abs() < 0.02, "{found:?}");
        }
    }

    #[test]
    fn nothing_is_found_on_a_stiff_shaft() {
        let found = Load::of(&response(|_| Complex64::new(0.25, 0.0))).unwrap();
        assert!((found.inertia - 4.0).abs() < 0.1 && found.resonance.is_none(), "{found:?}");
        // So damped that it does not swing.
        let found = Load::of(&response(|hz| two_masses(1.0, 100.0, 0.9, hz)));
        assert!(found.is_none_or(|found| found.resonance.is_none()), "{found:?}");
        assert_eq!(Load::of(&[]), None);
    }
}
