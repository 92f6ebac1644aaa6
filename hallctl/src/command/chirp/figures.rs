//! What is told of a loop: bandwidth, crossover and phase margin, each only where the records agree upon it.

use crate::frequency::{Estimate, crossover, sine};
use crate::response::{Sine, bandwidth};
use num_complex::Complex64;

/// A figure whose standard error is a larger share of it, or a margin that is known worse than so many radians, is not
/// told.
const DOUBT: f64 = 0.1;

/// What is measured and what the model says, at the same frequencies.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Bode {
    pub(super) measured: Vec<Sine>,
    pub(super) model: Vec<Sine>,
    /// Standard error of what is measured, as a share of it.
    pub(super) doubt: Vec<f64>,
    /// What figures are read from: without a gap, and without what the records contradict each other in.
    #[serde(skip)]
    pub(super) sound: Vec<Sine>,
}

impl Bode {
    /// Figures are read from the `curve` where the records know what is measured to the share `doubt`.
    pub(super) fn of(
        frequencies: &[f64],
        found: &[Estimate],
        curve: &[Complex64],
        doubt: f64,
        model: impl Fn(f64) -> Complex64,
    ) -> Self {
        let sines = |values: &mut dyn Iterator<Item = Complex64>| -> Vec<_> {
            frequencies.iter().zip(values).map(|(&hz, value)| sine(hz, value)).collect()
        };
        let is_sound = |found: &Estimate| found.doubt() < doubt;
        let first = found.iter().position(is_sound).unwrap_or(found.len());
        let count = found[first..].iter().take_while(|found| is_sound(found)).count();
        Self {
            measured: sines(&mut found.iter().map(|found| found.value)),
            model: sines(&mut frequencies.iter().map(|&hz| model(hz))),
            doubt: found.iter().map(Estimate::doubt).collect(),
            sound: sines(&mut curve.iter().copied())[first..first + count].to_vec(),
        }
    }
}

/// Figures of one of the two.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(super) struct Figures {
    /// −3 dB of what follows the reference.
    pub(super) bandwidth_hz: Option<f64>,
    /// Where the open loop's gain is one.
    pub(super) crossover_hz: Option<f64>,
    pub(super) phase_margin_deg: Option<f64>,
}

impl Figures {
    pub(super) fn of(closed: &[Sine], open: &[Sine]) -> Self {
        let cross = crossover(open);
        Self {
            bandwidth_hz: bandwidth(closed).0,
            crossover_hz: cross.map(|cross| cross.0),
            phase_margin_deg: cross.map(|cross| cross.1),
        }
    }

    /// What is known well enough, from what is found without each part of the records. The error at a frequency does not
    /// tell that of a figure: where a gain falls slowly, 10 % of it are 20 % of the bandwidth.
    pub(super) fn told(self, without: &[Self]) -> Self {
        let known = |of: fn(&Self) -> Option<f64>, error: &dyn Fn(f64) -> f64| {
            of(&self).filter(|&value| standard_error(without, of).is_some_and(|found| found < error(value)))
        };
        let share = |value| DOUBT * value;
        let crossover_hz = known(|figures| figures.crossover_hz, &share);
        Self {
            bandwidth_hz: known(|figures| figures.bandwidth_hz, &share),
            crossover_hz,
            phase_margin_deg: crossover_hz
                .and_then(|_| known(|figures| figures.phase_margin_deg, &|_| DOUBT.to_degrees())),
        }
    }
}

/// The jackknife's standard error; none where nothing is found without one of the parts.
fn standard_error(without: &[Figures], of: fn(&Figures) -> Option<f64>) -> Option<f64> {
    let values: Vec<_> = without.iter().map(of).collect::<Option<_>>()?;
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    Some(((count - 1.0) / count * squares).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frequency::{grid, ratio, smoothed};
    use std::f64::consts::TAU;

    const ROW_S: f64 = 75e-6;

    /// A step through a first order of 1 kHz, as a scope of 128 rows sees it, with noise of 3 % RMS.
    fn step(up: bool, noise: &mut dyn FnMut() -> f64) -> [Vec<f64>; 2] {
        let size = if up { 1.0 } else { -1.0 };
        let set: Vec<_> = (0..128).map(|row| if row < 16 { 0.0 } else { size }).collect();
        let left = |row: usize| (-TAU * 1000.0 * ROW_S * (row as f64 - 16.0)).exp();
        let found = (0..128).map(|row| if row < 16 { 0.0 } else { size * (1.0 - left(row)) } + 0.03 * noise());
        let found = found.collect();
        [set, found]
    }

    fn figures(records: &[&[Vec<f64>; 2]]) -> Figures {
        let views: Vec<_> = records.iter().map(|[set, found]| [&set[..], &set[..], &found[..]]).collect();
        let frequencies = grid(240.0, 4000.0, 48);
        let found: Vec<_> = frequencies.iter().map(|&hz| ratio(&views, ROW_S, hz)).collect();
        let closed = Bode::of(&frequencies, &found, &smoothed(&frequencies, &found), 0.3, |_| Complex64::ONE);
        Figures::of(&closed.sound, &[])
    }

    #[test]
    fn what_is_told_through_noise_is_near_the_truth() {
        let mut seed = 3_u32;
        let mut uniform = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            12_f64.sqrt() * (f64::from(seed) / f64::from(u32::MAX) - 0.5)
        };
        let told: Vec<_> = (0..40)
            .filter_map(|_| {
                let records: Vec<_> = (0..8).map(|k| step(k % 2 == 0, &mut uniform)).collect();
                let all: Vec<_> = records.iter().collect();
                let without: Vec<_> =
                    (0..8).map(|left_out| figures(&[&all[..left_out], &all[left_out + 1..]].concat())).collect();
                figures(&all).told(&without).bandwidth_hz
            })
            .collect();
        let (least, most) = told.iter().fold((f64::MAX, 0.0_f64), |(a, b), &hz| (a.min(hz), b.max(hz)));
        let mean = told.iter().sum::<f64>() / told.len() as f64;
        println!("{} of 40 told, {least:.0} to {most:.0} Hz, {mean:.0} in the mean", told.len());
        assert!(told.len() > 24 && least > 750.0 && most < 1300.0 && (mean / 1000.0 - 1.0).abs() < 0.05, "{told:?}");
    }

    #[test]
    fn a_figure_that_hangs_on_one_part_is_not_told() {
        let of = |hz| Figures { bandwidth_hz: hz, crossover_hz: Some(1000.0), phase_margin_deg: Some(70.0) };
        let all = of(Some(1300.0));
        let told = |without: [Option<f64>; 4]| all.told(&without.map(of)).bandwidth_hz;
        assert_eq!(told([1300.0, 1290.0, 1310.0, 1280.0].map(Some)), Some(1300.0));
        // Without the last part the others say 1000 Hz.
        assert_eq!(told([1300.0, 1300.0, 1300.0, 1000.0].map(Some)), None);
        assert_eq!(told([Some(1300.0), Some(1300.0), Some(1300.0), None]), None);
        assert_eq!(all.told(&[of(None); 4]).crossover_hz, Some(1000.0));
    }
}
