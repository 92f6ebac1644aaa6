//! Fig. 10: the speed under block and sinusoidal commutation, and its spectrum.

use super::claim::{Claim, Figure, Paper};
use crate::experiment::commutation;
use anyhow::Result;

/// A line of the spectrum counts from this amplitude, per cent of the mean speed.
const LINE_PCT: f64 = 0.1;

/// Fig. 10(a), (b).
///
/// # Errors
/// A simulated drive that refuses its sensors.
pub fn claims(seed: u64) -> Result<Vec<Claim>> {
    let run = commutation::run(seed)?;
    let summary = run.summary;
    let [block_lines, sine_lines] = run.spectra().map(|spectrum| lines(&spectrum));
    Ok(vec![Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 10(a), (b)",
        title: "the ripple of the speed, block and sinusoidal",
        seen: "At a constant command the motor turns in jerks under block commutation, six to an electrical turn, and \
               nearly without under sinusoidal commutation: that is what the exact angle is for.",
        equation: "(8) corrected: duty_A = ½ + M/2 · sin θe, B and C a third of a turn later; the three sum to a \
                   constant\n(9) reversal: the complement of each duty",
        conditions: "100 rpm against 40 mN·m without feedback, dead time of 0.5 µs, calibrated imperfect Halls, no \
                     cogging. Unknown of the paper's: speed, load, inertia, supply; its figures have no number in the \
                     text. It takes its sensors as symmetrical, and blames their phase for what is left.",
        conclusion: format!(
            "The ripple with block commutation is {:.1} times that with sinusoidal commutation; what is left there is \
             the dead time. With cogging both have more: {:.1} and {:.1} %.",
            summary.block_speed_ripple_pct / summary.sine_speed_ripple_pct,
            summary.block_speed_ripple_cogging_pct,
            summary.sine_speed_ripple_cogging_pct
        ),
        erratum: Some(
            "(8) and (9) send signed sines to a PWM that has no sign, and leave out the factor n. Corrected: duties \
             about one half, of the electrical angle.",
        ),
        figures: vec![
            Figure::new("ripple of the speed, block, peak to peak", "%", summary.block_speed_ripple_pct),
            Figure::new("ripple of the speed, sinusoidal, peak to peak", "%", summary.sine_speed_ripple_pct),
            Figure::new("ripple of the torque, block, peak to peak", "%", summary.block_torque_ripple_pct),
            Figure::new("ripple of the torque, sinusoidal, peak to peak", "%", summary.sine_torque_ripple_pct),
            Figure::new("lines above 0.1 % below 800 Hz, block", "", block_lines as f64),
            Figure::new("lines above 0.1 % below 800 Hz, sinusoidal", "", sine_lines as f64),
        ],
        table: Vec::new(),
        plots: run.speed_plots().to_vec(),
    }])
}

/// Local maxima of a spectrum.
fn lines(spectrum: &[(f64, f64)]) -> usize {
    let peak = |three: &&[(f64, f64)]| three[1].1 > LINE_PCT && three[1].1 > three[0].1 && three[1].1 >= three[2].1;
    spectrum.windows(3).filter(peak).count()
}
