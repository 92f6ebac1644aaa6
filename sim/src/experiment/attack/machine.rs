//! The motor, its board and its sensors: physics that is richer than what the drive assumes.

use super::dice::Dice;
use super::scenario::Temper;
use crate::experiment::identify;
use hallservo::settings::Settings;
use plant::{HeatParameters, Iron, LoadParameters, PlantParameters, Unevenness};
use rig::motors::{MOTORS, Motor};

/// How much a winding warms by its continuous current for ever, K.
pub(super) const RISE_K: f64 = 80.0;
/// What copper's resistance is times as large by then.
const HOT: f64 = 1.0 + 0.00393 * RISE_K;
/// How far the second of two Halls may be from the first, electrical degrees.
const APART_DEG: [f64; 5] = [90.0, -90.0, 120.0, -120.0, 60.0];

/// A motor of the list, or one of which every number is drawn; one of this name, if there is any.
pub(super) fn motor(dice: &mut Dice, seed: u64, name: Option<&str>) -> Option<Motor> {
    let Some(name) = name else {
        return Some(if dice.chance(0.5) { dice.one_of(&MOTORS) } else { identify::any(seed) });
    };
    let named: Vec<_> = MOTORS.into_iter().filter(|motor| motor.name.contains(name)).collect();
    (!named.is_empty()).then(|| dice.one_of(&named))
}

/// What there is of it, before the settings are drawn; with two Halls or three.
pub(super) fn plant(dice: &mut Dice, motor: &Motor, temper: Temper, seed: u64, halls: u8) -> PlantParameters {
    let mut plant = motor.plant(seed);
    if halls == 2 {
        plant = plant.with_two_halls(dice.one_of(&APART_DEG));
    }
    let largest = if temper <= Temper::Driven { 0.5 } else { 1.0 };
    let uneven = if motor.pairs > 1 { dice.within(-largest, largest).max(0.0) } else { 0.0 };
    let cheap = Unevenness { rated_a: motor.limit_a.into(), ..Unevenness::CHEAP };
    plant = plant.with_unevenness(&cheap.scaled(uneven), seed);
    for hall in &mut plant.halls {
        hall.noise *= dice.within(0.3, 1.5);
        hall.amplitude_drift_k = -2e-3 * dice.within(0.0, 1.0);
        hall.offset_drift_v_k = 1e-4 * dice.share();
    }
    iron(dice, &mut plant, temper);
    shaft(dice, &mut plant, temper);
    supply(dice, &mut plant);
    plant.inverter.pwm_hz = dice.one_of(&[40e3, 40e3, 20e3, 30e3, 50e3]);
    plant.inverter.dead_time_s *= 1.0 + 0.3 * dice.share();
    plant
}

/// Salience and saturation.
fn iron(dice: &mut Dice, plant: &mut PlantParameters, temper: Temper) {
    if dice.chance(0.3) {
        let most = if temper <= Temper::Driven { 0.05 } else { 0.3 };
        let limit_a = 1.65 / plant.current_sense.gain;
        plant.motor.iron = Iron { salience: most * dice.share(), saturation_a: limit_a * dice.within(1.5, 6.0) };
    }
}

/// A load on a shaft that twists. The settings are not meant for it: SAFETY.md says what it does.
fn shaft(dice: &mut Dice, plant: &mut PlantParameters, temper: Temper) {
    if temper <= Temper::Driven || !dice.chance(0.25) {
        return;
    }
    let motor = &mut plant.motor;
    let load_kgm2 = motor.inertia_kgm2 * dice.between(0.2, 3.0);
    let mut load =
        LoadParameters::resonant(motor.inertia_kgm2, load_kgm2, dice.between(15.0, 400.0), dice.between(0.005, 0.1));
    if dice.chance(0.3) {
        load.backlash_rad = dice.between(1e-3, 0.05);
    }
    motor.load = Some(load);
}

/// Half of the supplies take nothing back.
fn supply(dice: &mut Dice, plant: &mut PlantParameters) {
    plant.bus.regenerative = dice.chance(0.5);
    plant.bus.source_ohm *= dice.around(3.0);
    plant.bus.capacitance_f *= dice.between(0.7, 5.0);
}

/// The winding warms by what the settings say of it, so that a winding that is too hot is too hot by them.
pub(super) fn warms(plant: &mut PlantParameters, settings: &Settings) {
    let Some(control) = &settings.control else { return };
    let continuous_a = f64::from(control.continuous_current_a);
    let copper_w = 1.5 * plant.motor.resistance_ohm * HOT * continuous_a * continuous_a;
    let half_k_per_w = 0.5 * RISE_K / copper_w;
    plant.motor.heat = Some(HeatParameters {
        copper_k_per_w: half_k_per_w,
        copper_time_s: control.winding_time_s.into(),
        housing_k_per_w: half_k_per_w,
        housing_time_s: control.housing_time_s.into(),
    });
}

/// In words.
pub(super) fn words(motor: &Motor, plant: &PlantParameters) -> String {
    let PlantParameters { motor: now, bus, .. } = plant;
    let mut text = format!(
        "motor {}: {} pole pairs, {:.3} Ω, {:.1} µH, {:.3} mWb, {:.3} g·cm², up to {:.2} A of {} A; {:.1} V{}, {:.0} µF",
        motor.name,
        now.pole_pairs,
        now.resistance_ohm,
        1e6 * now.inductance_h,
        1e3 * now.back_emf.flux_linkage_vs,
        1e7 * now.inertia_kgm2,
        motor.limit_a,
        motor.full_scale_a,
        bus.supply_v,
        if bus.regenerative { " taking back" } else { "" },
        1e6 * bus.capacitance_f,
    );
    if plant.magnets.gain > 0.0 {
        text += &format!(", magnets {:.0} % uneven", 100.0 * plant.magnets.gain);
    }
    if now.iron != Iron::NONE {
        text += &format!(", salience {:.2}, saturating at {:.1} A", now.iron.salience, now.iron.saturation_a);
    }
    if let Some(load) = &now.load {
        let hz = (load.stiffness_nm_rad * (1.0 / now.inertia_kgm2 + 1.0 / load.inertia_kgm2)).sqrt();
        text += &format!(
            ", a load of {:.3} g·cm² on a shaft that swings at {:.0} Hz{}",
            1e7 * load.inertia_kgm2,
            hz / std::f64::consts::TAU,
            if load.backlash_rad > 0.0 { " with play" } else { "" }
        );
    }
    text
}
