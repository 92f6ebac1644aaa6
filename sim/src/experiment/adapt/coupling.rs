//! What the field of the windings does to the Halls, and what it helps to know of it.

use super::trial::{self, LSB_V, Motion, PERIOD_S, Start, Trial};
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::hall::adapt::Observation;
use plant::HallParameters;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Fields of the windings at rated current, relative to the magnet's.
pub const SHARES: [f64; 3] = [0.0, 0.02, 0.05];
/// A. Only the product with the coupling matters.
const RATED_A: f64 = 1.0;
/// Each sensor's distance from the teeth differs.
const UNEVEN: [f64; 3] = [1.0, 0.7, 1.3];
/// How much of the coupling is known: nobody measures it exactly.
const KNOWN: f64 = 0.9;
/// The torque is rated, forwards for so long and then backwards.
const LOAD_S: f64 = 0.5;
const LENGTH_S: f64 = 6.0;

/// Errors of the filter's angle, electrical degrees.
#[derive(Clone, Copy, Debug, Default)]
pub struct Coupling {
    /// All of it, with codes as sampled.
    pub without: Statistics,
    /// All of it, with the currents' known share subtracted from the codes.
    pub with: Statistics,
    /// Systematic over the turn, apart from a shift of the whole turn, at rated current.
    pub ripple: Statistics,
}

/// A calibrated motor of the seed that holds its speed against a torque of both signs.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn run(seed: u64, hz: f64, share: f64) -> Result<Coupling> {
    let (without, ripple) = one(seed, hz, share, 0.0)?;
    let (with, _) = one(seed, hz, share, KNOWN)?;
    Ok(Coupling { without, with, ripple })
}

fn one(seed: u64, hz: f64, share: f64, known: f64) -> Result<(Statistics, Statistics)> {
    let mut halls = trial::halls(seed);
    for (hall, uneven) in halls.iter_mut().zip(UNEVEN) {
        *hall = hall.with_windings(share * uneven, RATED_A, 0.0);
    }
    let mut trial = Trial::new(seed, halls, Motion::Constant(hz), Start::Calibrated)?;
    let torque_nm = trial::DAMPING_NMS * TAU * hz / trial::POLE_PAIRS;
    let (mut all, mut parts) = (Statistics::default(), [[Statistics::default(); 36]; 2]);
    while trial.time_s() < LENGTH_S {
        let backwards = usize::from(trial.time_s().rem_euclid(2.0 * LOAD_S) >= LOAD_S);
        // A quarter of a turn before the rotor's flux or behind it; the load takes the torque.
        let quadrature_a = if backwards == 0 { RATED_A } else { -RATED_A };
        let currents_a = phases(quadrature_a, trial.next_angle_rad());
        trial.bench.set_currents(currents_a);
        let codes = trial.sample(torque_nm);
        let corrected = [0, 1, 2].map(|k| corrected(codes[k], &halls[k], &currents_a, known));
        trial.adapter.update(&Observation { codes: corrected, elapsed: 1, torque_nm: torque_nm as f32 });
        let error = trial.error_deg();
        if trial.time_s() > 2.0 * LOAD_S {
            all.push(error);
            let part = (trial.bench.angle_rad() / TAU).rem_euclid(1.0) * 36.0;
            parts[backwards][(part as usize).min(35)].push(error);
        }
    }
    let mut ripple = Statistics::default();
    for turn in parts {
        let shift = turn.iter().map(Statistics::mean).sum::<f64>() / 36.0;
        turn.iter().for_each(|part| ripple.push(part.mean() - shift));
    }
    Ok((all, ripple))
}

/// Currents of the phases for a current along q.
fn phases(quadrature_a: f64, angle_rad: f64) -> [f64; 3] {
    [0.0, 1.0, 2.0].map(|phase| quadrature_a * (angle_rad + FRAC_PI_2 - phase * TAU / 3.0).cos())
}

/// A code without what is known of the currents' share.
fn corrected(code: u16, hall: &HallParameters, currents_a: &[f64; 3], known: f64) -> u16 {
    let volts: f64 = hall.coupling_v_a.iter().zip(currents_a).map(|(coupling, current)| coupling * current).sum();
    (f64::from(code) - known * volts / LSB_V).round() as u16
}

/// RMS over all motors.
pub fn rms(runs: &[Coupling], of: impl Fn(&Coupling) -> Statistics) -> f64 {
    runs.iter().map(|run| of(run).rms()).collect::<Statistics>().rms()
}

impl Trial {
    /// The electrical angle at the next sample, but for the unknown torque of one period.
    fn next_angle_rad(&self) -> f64 {
        self.bench.angle_rad() + PERIOD_S * self.bench.speed_rad_s()
    }
}
