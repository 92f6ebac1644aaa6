//! Fig. 11: the filter that finds the sensors while the motor turns.

use super::claim::{Claim, Figure, Paper};
use crate::experiment::adapt::trial::{self, Motion, Start, Trial};
use crate::experiment::adapt::{HZ, ensemble, figure_11};
use crate::statistics::Statistics;
use anyhow::Result;
use ensemble::{Convergence, PARTS, STEADY_TURNS};
use rayon::prelude::*;

const MOTORS: u64 = 100;

/// Fig. 11(a) to (d).
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn claims(seed: u64) -> Result<Vec<Claim>> {
    let courses: Vec<_> =
        (seed..seed + MOTORS).into_par_iter().map(|seed| ensemble::converge(seed, HZ)).collect::<Result<_>>()?;
    let over = |of: fn(&Convergence) -> &Vec<Statistics>| ensemble::over_time(&courses, of);
    let (ours, paper, bound) = (over(|c| &c.errors), over(|c| &c.paper), over(|c| &c.bound));
    let steady = |parts: &[f64]| parts[PARTS * STEADY_TURNS..].iter().copied().collect::<Statistics>().rms();
    let turns = ensemble::convergence_turns(&ours);
    let diverged = courses.iter().filter(|course| course.diverged).count();
    Ok(vec![Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 11(a) to (d)",
        title: "the sensors found while the motor turns",
        seen: "An extended Kalman filter starts from the data sheet and finds offset, amplitude and placement of \
               each Hall while the motor turns. So nobody has to mount them exactly, and what drifts with the \
               temperature is followed.",
        equation: "x = [θ, θ̇, offset_i, amplitude_i, ψ_1, ψ_2, h_3]\n\
                   P ← F P Fᵀ + Q,  F = [[1, dt], [0, 1 − dt·damping]]\n\
                   K = P hᵀ / (h P hᵀ + Ω),  h = ∂r/∂x, one sensor after the other",
        conditions: "A hundred motors with placement errors up to 8°, ±30 % amplitude, ±10 % offset, 5 % third \
                     harmonic, 1 % noise; 10 Hz electrical, 1000 samples a second; the curves are those of the first \
                     motor. Unknown of the paper's: speed, noise and initial errors. It says “less than 400 ms” and, \
                     of the parameters, “approximately two seconds”.",
        conclusion: format!(
            "At 10 Hz electrical 400 ms are four turns: the error of all motors together is below 0.5° RMS after {} \
             turns, and stays at {:.2} times what any filter could reach. The paper's filter with the least \
             corrections that make it run, given the true minima and maxima, angle and speed, ends at {:.1}° RMS: \
             its variances ignore how the angle and the sensors' parameters depend on each other.",
            turns.map_or("no".into(), |turns| format!("{turns:.2}")),
            steady(&ours) / steady(&bound),
            steady(&paper)
        ),
        erratum: Some(
            "(11): the variance of θ grows by 2θ̇σ, without bound at speed. (12): a factor θ̇ that makes every gain \
             zero at rest. (10) to (15): minimum and maximum are states without gain, and never change; one variance \
             a state ignores what makes them observable. (14): r₁ for each sensor, σ of θ for that of θ̇. And φ is a \
             state, though Halls alone show only θ − φ. Corrected: a joint covariance; φ from the alignment.",
        ),
        figures: vec![
            Figure::new("converged after", "ms", turns.map_or(f64::INFINITY, |turns| 1e3 * turns / HZ))
                .beside_unknown(400.0),
            Figure::new("error, steady, electrical RMS", "°", steady(&ours)).improves_on(steady(&paper)),
            Figure::new("least that any filter can reach, electrical RMS", "°", steady(&bound)),
            Figure::new("filters of a hundred that diverged", "", diverged as f64),
            Figure::new("Hall signals reconstructed to, RMS", "% of the amplitude", reconstruction_pct(seed)?),
        ],
        table: Vec::new(),
        plots: figure_11(seed)?,
    }])
}

/// Signals less what the filter's parameters and angle make of them, the noise included, after a second.
fn reconstruction_pct(seed: u64) -> Result<f64> {
    let mut trial = Trial::new(seed, trial::halls(seed), Motion::Constant(HZ), Start::Nominal)?;
    let mut errors = Statistics::default();
    while trial.time_s() < 2.0 {
        let step = trial.step();
        let model = trial.adapter.current();
        if trial.time_s() > 1.0 {
            for (code, sensor) in step.codes.iter().zip(&model.sensors) {
                let expected = sensor.code(trial.adapter.hall_angle());
                errors.push(100.0 * f64::from((f32::from(*code) - expected) / sensor.amplitude));
            }
        }
    }
    Ok(errors.rms())
}
