//! R and L at standstill, where the rotor does not stand still: a heavy one swings about each phase for long.

use crate::commissioned::judge;
use hallservo::service::commission::Commission;
use hallservo::service::procedure::{Serve, State};
use hallservo::service::standstill::{Electrical, Standstill};
use plant::PlantParameters;
use rayon::prelude::*;
use rig::Rig;
use rig::motors::{MOTORS, Motor};

/// What is measured before anything but the largest current is known.
pub(crate) fn measured(case: &Motor, plant: &PlantParameters, seed: u64) -> Result<Electrical, String> {
    let settings = *Commission::new(case.settings(), Some(case.limit_a)).unwrap().settings();
    let mut rig = Rig::new(plant, &settings, seed).unwrap();
    let mut standstill = Standstill::new(&rig.config).unwrap();
    for ms in 0..60_000 {
        match standstill.serve(&mut rig.service, ms) {
            State::Running => rig.wait(1e-3),
            State::Done => return Ok(*standstill.report().unwrap()),
            State::Failed(error) => return Err(format!("{error:?}")),
        }
    }
    Err("endless".into())
}

/// What a heavy rotor's swing induces in the phase that pulls it is no voltage of the resistance. Every motor of the list
/// with 10, 30 and 100 times its inertia; the short form has every fourth one with one of them.
#[test]
fn the_resistance_is_that_of_a_rotor_at_rest() {
    let jobs: Vec<_> = MOTORS
        .iter()
        .enumerate()
        .step_by(sim::of(4, 1))
        .flat_map(|(number, case)| {
            let times = [30.0, 10.0, 100.0].into_iter().take(sim::of(1, 3));
            times.map(move |times| (case, times, number as u64 + 21))
        })
        .collect();
    let results: Vec<_> = jobs
        .par_iter()
        .map(|&(case, times, seed)| {
            let mut plant = case.plant(seed);
            plant.motor.inertia_kgm2 *= times;
            let exact = plant.motor.resistance_ohm + plant.inverter.switch_ohm;
            match measured(case, &plant, seed) {
                Err(error) => (format!("{:14} x{times:3}: {error}", case.name), false),
                Ok(found) => {
                    let (value, error) = (f64::from(found.resistance_ohm.value), f64::from(found.resistance_ohm.error));
                    let text = format!("{:14} x{times:3}: {value:.4} ± {error:.4}, is {exact:.4}", case.name);
                    (text, (value - exact).abs() <= error && error < 0.16 * exact)
                }
            }
        })
        .collect();
    judge(&results);
}
