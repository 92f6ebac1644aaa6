//! Fig. 9(d): the field of the windings at a Hall, over the angle at which the Hall is mounted.

use super::claim::{Claim, Figure, Paper};
use crate::experiment::adapt::{HZ, coupling};
use crate::report::{Plot, Series};
use crate::statistics::Statistics;
use anyhow::Result;
use plant::{HallParameters, Noise, PlantParameters};

/// Field of the windings at rated current over the magnet's.
const SHARE: f64 = 0.02;
/// Trials at each orientation, as in the paper: "approximately fifteen".
const TRIALS: u32 = 15;
/// Readings averaged in a trial.
const READINGS: u32 = 200;
/// How much the apparatus lets the sensor's orientation vary, degrees.
const LOOSE_DEG: f64 = 3.0;

/// Fig. 9(d).
///
/// # Errors
/// Parameters that the filter refuses.
pub fn claims(seed: u64) -> Result<Vec<Claim>> {
    let orientations: Vec<f64> = (0..=36).map(|k| 2.5 * f64::from(k)).collect();
    let mut noise = Noise::new(seed);
    let mut curve = |current_a: f64, constant_a: f64| -> [Vec<(f64, f64)>; 2] {
        let trials = |orientation: &f64, noise: &mut Noise| {
            let trials: Vec<_> = (0..TRIALS).map(|_| trial(*orientation, current_a, constant_a, noise)).collect();
            (trials[0], trials.iter().sum::<f64>() / f64::from(TRIALS))
        };
        let both: Vec<_> = orientations.iter().map(|orientation| trials(orientation, &mut noise)).collect();
        let points = |of: fn(&(f64, f64)) -> f64| orientations.iter().copied().zip(both.iter().map(of)).collect();
        [points(|both| both.0), points(|both| both.1)]
    };
    let ([white, white_mean], [none, none_mean]) = (curve(1.0, 0.0), curve(0.0, 0.0));
    let [_, constant] = curve(0.0, 1.0);
    let shift = |with: &[(f64, f64)]| {
        with.iter().zip(&none_mean).map(|(with, without)| with.1 - without.1).collect::<Statistics>().mean().abs()
    };
    let (white_shift, constant_shift) = (shift(&white_mean), shift(&constant));
    let runs = (0..8).map(|k| coupling::run(seed + k, HZ, SHARE)).collect::<Result<Vec<_>>>()?;
    let [without, with] = [coupling::rms(&runs, |run| run.without), coupling::rms(&runs, |run| run.with)];
    let series = vec![
        Series::new("white noise, one trial (WN)", white),
        Series::new("no input, one trial (NI)", none),
        Series::new("white noise, averaged (AWN)", white_mean),
        Series::new("no input, averaged (ANI)", none_mean),
        Series::new("constant rated current, averaged", constant),
    ];
    Ok(vec![Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 9(d)",
        title: "the field of the windings at a Hall",
        seen: "White noise through the coils hardly moves the average voltage of a Hall, however it is turned. But \
               noise has no mean: its field averages out whatever its size. A current that makes torque does not.",
        equation: "voltage = offset + amplitude · cos γ + share · amplitude · sin γ · current / rated current",
        conditions: "γ from 0° (in line with the magnet, across the coil) to 90°; currents of rated RMS; fifteen \
                     trials of 200 readings, the sensor loose by up to 3°; coils with 2 % of the magnet's field at \
                     rated current. The paper gives neither the current nor the coil's share nor a number.",
        conclusion: format!(
            "The averages with and without noise differ by {white_shift:.2} % of the magnet's field over all \
             orientations, as the loose sensor makes them. The same coils with constant rated current differ by \
             {constant_shift:.1} %, and the angle of a drive under torque errs by {without:.2}° electrical RMS: what \
             the figure would have to show, and does not. A correction by the measured currents would leave \
             {with:.2}°."
        ),
        erratum: None,
        figures: vec![
            Figure::new("mean change by white noise", "% of the magnet's field", white_shift),
            Figure::new("mean change by constant rated current", "% of the magnet's field", constant_shift),
            Figure::new("error of the angle under torque, electrical RMS", "°", without),
        ],
        table: Vec::new(),
        plots: vec![(
            Plot::new("Fig. 9(d): average voltage of a Hall", "orientation / °", "% of the magnet's field", series),
            "The rotor stands still; the Hall is turned from the magnet's direction to the coil's.",
        )],
    }])
}

/// Average reading of a trial in per cent of the magnet's field: white noise of this RMS and a constant current, in
/// rated currents.
fn trial(orientation_deg: f64, white: f64, constant: f64, noise: &mut Noise) -> f64 {
    let HallParameters { noise: own, .. } = PlantParameters::imperfect(1).halls[0];
    let (sin, cos) = (orientation_deg + LOOSE_DEG * noise.uniform()).to_radians().sin_cos();
    let mut reading = || cos + SHARE * sin * (noise.scaled(white) + constant) + noise.scaled(own);
    100.0 * (0..READINGS).map(|_| reading()).sum::<f64>() / f64::from(READINGS)
}
