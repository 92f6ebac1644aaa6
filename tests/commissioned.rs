//! Motors of the list that the drive has commissioned by itself, and what the tests ask of them again and again.

use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::Rig;
use rig::commissioning::{Bench, commission};
use rig::motors::{MOTORS, Motor};

/// The motor of that name.
pub(crate) fn motor(name: &str) -> &'static Motor {
    MOTORS.iter().find(|motor| motor.name == name).unwrap()
}

/// Those of some names with spaces between them, in the order of the list.
pub(crate) fn motors(names: &str) -> Vec<&'static Motor> {
    let names: Vec<_> = names.split(' ').collect();
    let chosen: Vec<_> = MOTORS.iter().filter(|motor| names.contains(&motor.name)).collect();
    assert_eq!(chosen.len(), names.len(), "{names:?}");
    chosen
}

/// A motor on a supply that takes back what braking returns, as a battery does.
pub(crate) fn on_battery(motor: &Motor, seed: u64) -> PlantParameters {
    let mut plant = motor.plant(seed);
    plant.bus.regenerative = true;
    plant
}

/// A drive that has commissioned the motor of a plant, its bridge off, and the settings that came of it, which are in effect.
pub(crate) fn commissioned(motor: &Motor, plant: &PlantParameters, seed: u64) -> (Rig, Settings) {
    let board = motor.settings();
    let mut bench = Bench::new(Rig::new(plant, &board, seed).unwrap());
    let commissioned =
        commission(&mut bench, board, motor.limit_a).unwrap_or_else(|why| panic!("{}: {why}", motor.name));
    (bench.rig, commissioned.settings)
}

/// The largest current for as long as is liked, and no bound to what braking returns.
pub(crate) fn lift_limits(settings: &mut Settings) {
    let control = settings.control.as_mut().unwrap();
    control.continuous_current_a = control.max_current_a;
    control.max_regeneration_a = 1000.0;
}

/// Where the drive says that the rotor is, mechanical turns.
pub(crate) fn here_turns(rig: &Rig) -> f64 {
    rig.drive.tracker().position().to_turns() / f64::from(rig.config.pole_pairs.get())
}

/// Torque of the motor at a current along q, N·m.
pub(crate) fn torque_nm(motor: &Motor, current_a: f64) -> f64 {
    1.5 * f64::from(motor.pairs) * motor.flux_vs * current_a
}

/// Prints what came of each case, then fails if any was bad.
pub(crate) fn judge(rows: &[(String, bool)]) {
    for (text, good) in rows {
        println!("{} {text}", if *good { " " } else { "!" });
    }
    let bad = rows.iter().filter(|(_, good)| !good).count();
    assert_eq!(bad, 0, "of {}", rows.len());
}
