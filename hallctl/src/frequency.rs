//! The frequency response of a loop, from records of steps: what was asked for, and what came of it.

use crate::response::Sine;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// The transform of a record's differences, at a frequency. A step's differences begin and end at rest, so that no
/// window is needed.
fn transform(values: &[f64], row_s: f64, hz: f64) -> Complex64 {
    let step = Complex64::cis(-TAU * hz * row_s);
    let mut turned = Complex64::ONE;
    let mut sum = Complex64::ZERO;
    for pair in values.windows(2) {
        sum += turned * (pair[1] - pair[0]);
        turned *= step;
    }
    sum
}

/// A response at a frequency, and its standard error: by how much the records contradict each other.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// The response.
    pub value: Complex64,
    /// Standard error of that.
    pub error: f64,
}

impl Estimate {
    /// The same with a known part before or behind it.
    pub fn times(self, known: Complex64) -> Self {
        Self { value: known * self.value, error: known.norm() * self.error }
    }

    /// The open loop of a closed one.
    pub fn opened(self) -> Self {
        let rest = 1.0 - self.value;
        Self { value: self.value / rest, error: self.error / rest.norm_sqr() }
    }

    /// Standard error as a share of the response.
    pub fn doubt(&self) -> f64 {
        self.error / self.value.norm()
    }
}

/// From one signal to another in several records, at a frequency: least squares over the records, with what the
/// `instrument` has in common with both. That may be the first signal itself; in a closed loop it is what drives it
/// from outside, or noise that goes round the loop would count.
pub fn ratio(records: &[[&[f64]; 3]], row_s: f64, hz: f64) -> Estimate {
    let products = records.iter().map(|[instrument, first, second]| {
        let with = transform(instrument, row_s, hz).conj();
        [with * transform(first, row_s, hz), with * transform(second, row_s, hz)]
    });
    let [from, to] = products.clone().fold([Complex64::ZERO; 2], |sum, [from, to]| [sum[0] + from, sum[1] + to]);
    let value = to / from;
    let left = products.map(|[from, to]| (to - value * from).norm_sqr()).sum::<f64>();
    let count = records.len() as f64;
    Estimate { value, error: (left * count / (count - 1.0)).sqrt() / from.norm() }
}

/// From a frequency to the farthest that is smoothed with it.
const SMOOTHED: f64 = 1.4;

/// A response without a part of its noise: at each frequency what a straight line through the logarithms says, gain and
/// phase over the frequency, by how well each neighbour is known.
pub fn smoothed(frequencies: &[f64], found: &[Estimate]) -> Vec<Complex64> {
    let at = |hz: f64, middle: Complex64| {
        let neighbours = frequencies.iter().zip(found).map(move |(&other, found)| ((other / hz).ln(), found));
        let near = neighbours.filter(|(way, _)| way.abs() <= SMOOTHED.ln());
        let [mut sum, mut ways, mut squares] = [0.0; 3];
        let [mut values, mut moments] = [Complex64::ZERO; 2];
        for (way, found) in near {
            // What is known without any doubt would be the only one that counts.
            let (weight, value) = (found.doubt().max(1e-6).powi(-2), (found.value / middle).ln());
            sum += weight;
            ways += weight * way;
            squares += weight * way * way;
            values += weight * value;
            moments += weight * way * value;
        }
        middle * ((squares * values - ways * moments) / (squares * sum - ways * ways)).exp()
    };
    frequencies.iter().zip(found).map(|(&hz, found)| at(hz, found.value)).collect()
}

/// Frequencies from one to another, evenly over their logarithm.
pub fn grid(from_hz: f64, to_hz: f64, count: usize) -> Vec<f64> {
    (0..count).map(|k| from_hz * (to_hz / from_hz).powf(k as f64 / (count - 1) as f64)).collect()
}

/// Gain and phase of a response.
pub fn sine(hz: f64, response: Complex64) -> Sine {
    Sine { hz, gain: response.norm(), phase_deg: response.arg().to_degrees() }
}

/// A loop as the settings have it.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// Control periods a second.
    pub step_hz: f64,
    /// From a sample to the middle of the period that acts on it, periods.
    pub delay_periods: f64,
    /// Bandwidths as set.
    pub current_hz: f64,
    /// The same.
    pub speed_hz: f64,
    /// Natural frequency of the tracker.
    pub tracking_hz: f64,
    /// Acceleration per current: torque constant over inertia, rad/s² per A.
    pub acceleration: f64,
}

/// Control periods from step to step of the outer loops.
const OUTER: f64 = hallservo::drive::OUTER as f64;

impl Model {
    fn delayed(&self, periods: f64, hz: f64) -> Complex64 {
        Complex64::cis(-TAU * hz * periods / self.step_hz)
    }

    /// Open loop of the current: the zero of the PI cancels the winding's pole.
    pub fn current_loop(&self, hz: f64) -> Complex64 {
        self.current_hz / Complex64::new(0.0, hz) * self.delayed(self.delay_periods, hz)
    }

    /// From the speed's error to the current: a PI, and the time until its output acts.
    pub fn speed_control(&self, hz: f64) -> Complex64 {
        let proportional = TAU * self.speed_hz / self.acceleration;
        let integral = Complex64::new(1.0, -self.speed_hz / 4.0 / hz);
        proportional * integral * self.delayed(OUTER, hz)
    }

    /// From the current's reference to the tracked speed.
    pub fn speed_plant(&self, hz: f64) -> Complex64 {
        let current = closed(self.current_loop(hz));
        let share = Complex64::new(0.0, hz / self.tracking_hz);
        let tracker = (Complex64::ONE + std::f64::consts::SQRT_2 * share + share * share).inv();
        self.acceleration / Complex64::new(0.0, TAU * hz) * current * tracker
    }
}

/// A closed loop.
pub fn closed(open: Complex64) -> Complex64 {
    open / (Complex64::ONE + open)
}

/// Where the gain of an open loop falls through one, and the phase margin there, degrees. Behind a resonance it may fall
/// so again: the least margin counts.
pub fn crossover(open: &[Sine]) -> Option<(f64, f64)> {
    let falls = open.windows(2).filter(|pair| pair[0].gain >= 1.0 && pair[1].gain < 1.0);
    let crossings = falls.map(|pair| {
        let share = pair[0].gain.ln() / (pair[0].gain.ln() - pair[1].gain.ln());
        let hz = pair[0].hz * (pair[1].hz / pair[0].hz).powf(share);
        // Beyond a turn it is the phase that is nearest.
        let turned = (pair[1].phase_deg - pair[0].phase_deg + 540.0).rem_euclid(360.0) - 180.0;
        let phase_deg = pair[0].phase_deg + share * turned;
        (hz, (180.0 + phase_deg + 180.0).rem_euclid(360.0) - 180.0)
    });
    crossings.min_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::bandwidth;

    const MODEL: Model = Model {
        step_hz: 40e3,
        delay_periods: 1.5,
        current_hz: 1000.0,
        speed_hz: 60.0,
        tracking_hz: 281.0,
        acceleration: 3000.0,
    };

    #[test]
    fn a_loop_with_a_delay_has_the_margin_of_the_textbook() {
        let open: Vec<_> = grid(50.0, 5000.0, 60).into_iter().map(|hz| sine(hz, MODEL.current_loop(hz))).collect();
        let (hz, margin_deg) = crossover(&open).unwrap();
        // 90° less what a kilohertz turns in 37.5 µs.
        assert!((hz - 1000.0).abs() < 1.0 && (margin_deg - 76.5).abs() < 0.1, "{hz} {margin_deg}");
        let closed: Vec<_> = open.iter().map(|open| sine(open.hz, closed(MODEL.current_loop(open.hz)))).collect();
        let (_, from_closed) = bandwidth(&closed);
        assert!((from_closed.unwrap() - margin_deg).abs() < 0.2, "{from_closed:?}");
    }

    #[test]
    fn the_least_margin_counts() {
        let of = |hz, gain, phase_deg| Sine { hz, gain, phase_deg };
        let open = [of(10.0, 2.0, -120.0), of(20.0, 0.5, -120.0), of(40.0, 2.0, -150.0), of(50.0, 0.5, -170.0)];
        let (hz, margin_deg) = crossover(&open).unwrap();
        assert!((40.0..50.0).contains(&hz) && (margin_deg - 20.0).abs() < 1e-9, "{hz} {margin_deg}");
    }

    #[test]
    fn the_response_of_a_lag_is_found_through_noise() {
        // A first order of 300 Hz at 40 kHz, and another signal's noise on both.
        let (row_s, pole) = (25e-6, (-TAU * 300.0 * 25e-6_f64).exp());
        let mut seed = 1_u32;
        let mut noise = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed) / f64::from(u32::MAX) - 0.5
        };
        let records: Vec<[Vec<f64>; 2]> = (0..16)
            .map(|k| {
                let mut value = 0.0;
                let size = if k % 2 == 0 { 1.0 } else { -1.0 };
                let set: Vec<_> = (0..512).map(|row| if row < 64 { 0.0 } else { size }).collect();
                let found = set.iter().map(|set| {
                    let now = value;
                    value = set + (value - set) * pole;
                    now + 0.01 * noise()
                });
                let found = found.collect();
                [set, found]
            })
            .collect();
        let views: Vec<_> = records.iter().map(|[set, found]| [&set[..], &set[..], &found[..]]).collect();
        for hz in [100.0, 300.0, 600.0] {
            let Estimate { value: found, error } = ratio(&views, row_s, hz);
            let z = Complex64::cis(TAU * hz * row_s);
            let expected = (1.0 - pole) / (z - pole);
            assert!((found - expected).norm() < 0.02, "{hz}: {found} {expected}");
            // It knows how good it is.
            assert!((found - expected).norm() < 4.0 * error && error < 0.01, "{hz}: {found} ± {error} {expected}");
        }
    }

    #[test]
    fn smoothing_takes_noise_away_and_leaves_the_curve() {
        let frequencies = grid(200.0, 4000.0, 48);
        let ideal = |hz| closed(MODEL.current_loop(hz));
        let sure: Vec<_> = frequencies.iter().map(|&hz| Estimate { value: ideal(hz), error: 0.0 }).collect();
        let mut seed = 7_u32;
        let mut noise = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed) / f64::from(u32::MAX) - 0.5
        };
        let noisy: Vec<_> = frequencies
            .iter()
            .map(|&hz| Estimate { value: ideal(hz) + 0.2 * Complex64::new(noise(), noise()), error: 0.08 })
            .collect();
        let [smooth, quiet] = [&sure, &noisy].map(|found| smoothed(&frequencies, found));
        let rms =
            |values: &mut dyn Iterator<Item = f64>| (values.map(|value| value * value).sum::<f64>() / 48.0).sqrt();
        let ideals = || frequencies.iter().map(|&hz| ideal(hz));
        let bent = rms(&mut smooth.iter().zip(ideals()).map(|(found, ideal)| (found - ideal).norm()));
        let before = rms(&mut noisy.iter().zip(ideals()).map(|(found, ideal)| (found.value - ideal).norm()));
        let after = rms(&mut quiet.iter().zip(ideals()).map(|(found, ideal)| (found - ideal).norm()));
        println!("{before:.4} before, {after:.4} after, {bent:.4} of the curve's own");
        assert!(bent < 0.01 && after < 0.5 * before, "{bent} {before} {after}");
    }

    #[test]
    fn a_loop_that_is_opened_is_known_worse_where_it_follows_well() {
        let open = Complex64::new(0.0, -8.0);
        let opened = Estimate { value: closed(open), error: 0.01 }.opened();
        // The derivative of T/(1 − T).
        assert!((opened.value - open).norm() < 1e-9 && (opened.error - 0.01 * 65.0).abs() < 1e-9, "{opened:?}");
        assert!(opened.doubt() > 8.0 * Estimate { value: closed(open), error: 0.01 }.doubt());
    }
}
