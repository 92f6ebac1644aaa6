//! Settings as a user may have them: those of a commissioned motor, more or less right, then others at random.

use super::dice::Dice;
use super::scenario::Temper;
use hallservo::commutation::Commutation;
use hallservo::settings::{Ceiling, Control, OnStopFailure, OnTimeout, Settings};
use plant::{Iron, PlantParameters};
use rig::motors::Motor;
use std::f64::consts::TAU;

/// A control step of some six microseconds.
const CEILINGS: &[Ceiling] = &[("pwm_hz", 80e3)];
/// Tries until the numbers fit each other.
const TRIES: u32 = 30;

/// Settings that the drive takes.
pub(super) fn draw(
    dice: &mut Dice,
    motor: &Motor,
    plant: &PlantParameters,
    temper: Temper,
    halls: u8,
) -> Option<Settings> {
    for _ in 0..TRIES {
        let settings = any(dice, motor, plant, temper, halls);
        if settings.validate().is_ok() {
            return Some(settings);
        }
    }
    None
}

fn any(dice: &mut Dice, motor: &Motor, plant: &PlantParameters, temper: Temper, halls: u8) -> Settings {
    let mut settings = Settings { ceilings: CEILINGS, halls, ..motor.settings() };
    settings.pwm_hz = plant.inverter.pwm_hz as f32;
    settings.max_electrical_hz = settings.max_electrical_hz.min(settings.pwm_hz / 20.0);
    settings.commutation = match dice.below(10) {
        0 | 1 => Commutation::Sinusoidal,
        2 | 3 => Commutation::Block,
        _ => Commutation::FieldOriented,
    };
    settings.reversed = dice.chance(0.5);
    settings.run_on_two_halls = halls == 3 && dice.chance(0.3);
    settings.adaptation = dice.chance(0.7);
    settings.tracking_bandwidth_hz = dice.between(180.0, 500.0) as f32;
    if let Some(mut control) = settings.control {
        electrical(dice, &mut control, motor, plant, temper);
        motion(dice, &mut settings, &mut control, motor, plant);
        guard(dice, &mut control, plant, temper);
        settings.control = Some(control);
    }
    if temper > Temper::Driven {
        daring(dice, &mut settings);
    }
    settings
}

/// What the motor is taken for, and the current.
fn electrical(dice: &mut Dice, control: &mut Control, motor: &Motor, plant: &PlantParameters, temper: Temper) {
    let now = &plant.motor;
    let [ohm, henry, weber, kgm2] =
        if temper <= Temper::Driven { [1.05, 1.1, 1.03, 1.15] } else { [1.3, 1.3, 1.15, 2.0] };
    control.resistance_ohm = ((now.resistance_ohm + plant.inverter.switch_ohm) * dice.around(ohm)) as f32;
    // Along the magnets' field, as commissioning finds it.
    let salience = now.iron.salience;
    control.inductance_h = (now.inductance_h * (1.0 - salience) * dice.around(henry)) as f32;
    if now.iron != Iron::NONE {
        control.saliency = ((1.0 + salience) / (1.0 - salience)) as f32;
    }
    control.flux_linkage_wb = (now.back_emf.flux_linkage_vs * dice.around(weber)) as f32;
    let all_kgm2 = now.inertia_kgm2 + now.load.map_or(0.0, |load| load.inertia_kgm2);
    control.inertia_kgm2 = (all_kgm2 * dice.around(kgm2)) as f32;
    control.max_current_a = motor.limit_a;
    control.continuous_current_a = motor.limit_a * dice.within(0.4, 0.7) as f32;
    control.winding_time_s = dice.between(1.0, 60.0) as f32;
    control.guard.over_current_a = (1.5 * motor.limit_a).min(0.98 * control.current_full_scale_a);
    // As commissioning chooses them.
    let henry = f64::from(control.inductance_h) * f64::from(control.saliency).max(1.0);
    let noise_a = f64::from(control.current_full_scale_a) / 1000.0;
    control.dead_time_ramp_a = (f64::from(motor.dead_time_s) * motor.bus_v / 1.5 / henry)
        .clamp(1e-3, 0.1 * f64::from(motor.full_scale_a)) as f32;
    let quiet_hz = 0.02 * motor.bus_v / (TAU * henry * noise_a);
    control.current_bandwidth_hz = quiet_hz.min(1000.0).min(plant.inverter.pwm_hz / 40.0).max(10.0) as f32;
}

/// Speed, acceleration and bandwidths that fit, as commissioning chooses them, or slower.
fn motion(dice: &mut Dice, settings: &mut Settings, control: &mut Control, motor: &Motor, plant: &PlantParameters) {
    let pairs = f64::from(motor.pairs);
    let (flux_vs, inertia) = (f64::from(control.flux_linkage_wb), f64::from(control.inertia_kgm2));
    let torque_nm = 1.5 * pairs * flux_vs * f64::from(control.max_current_a);
    let reached = 0.85 * motor.bus_v / 1.732 / (flux_vs * pairs);
    let allowed = 0.9 * TAU * f64::from(settings.max_electrical_hz) / pairs;
    let max_rad_s = reached.min(allowed).clamp(0.2, 500.0) * dice.within(0.3, 1.0);
    control.max_speed_rad_s = max_rad_s as f32;
    let most = (0.35 * torque_nm / inertia).min(10.0 * max_rad_s);
    control.max_acceleration_rad_s2 = (most * dice.within(0.3, 1.0)).clamp(0.01, 1e6) as f32;
    control.following_error_rad_s = control.following_error_rad_s.min(0.5 * control.max_speed_rad_s).max(1.0);
    control.guard.stop_s = (2.0 * max_rad_s / most).clamp(1.0, 60.0) as f32;
    let noise_rad = 0.82 * plant.halls.iter().fold(0.0_f64, |most, hall| most.max(hall.noise));
    let quiet_hz = |tracking_hz: f32| {
        let tracker = TAU * f64::from(tracking_hz);
        let noise_rad_s = noise_rad * tracker * (tracker / plant.inverter.pwm_hz / 2.8).sqrt() / pairs;
        0.03 * torque_nm / (inertia * noise_rad_s) / TAU
    };
    while quiet_hz(settings.tracking_bandwidth_hz) < 0.6 && settings.tracking_bandwidth_hz > 40.0 {
        settings.tracking_bandwidth_hz *= 0.8;
    }
    // A speed control that is hardly slower than the tracker swings any rotor: SAFETY.md says so.
    let tracked_hz = f64::from(settings.tracking_bandwidth_hz) / 4.0;
    let fastest_hz = quiet_hz(settings.tracking_bandwidth_hz).clamp(0.6, 60.0).min(tracked_hz);
    let speed_hz = fastest_hz.min(f64::from(control.current_bandwidth_hz) / 5.0) * dice.within(0.5, 1.0);
    control.speed_bandwidth_hz = speed_hz.max(0.2) as f32;
    control.position_bandwidth_hz = (control.speed_bandwidth_hz / 4.0).max(0.1);
    // As far as a load of half of the torque pushes a position control so slow, or a user would set it so.
    let stiffness_nm = inertia * TAU * TAU * f64::from(control.speed_bandwidth_hz * control.position_bandwidth_hz);
    control.following_error_turns = (1.0 + torque_nm / stiffness_nm / TAU) as f32;
}

fn guard(dice: &mut Dice, control: &mut Control, plant: &PlantParameters, temper: Temper) {
    control.max_regeneration_a = if plant.bus.regenerative { 1000.0 } else { 0.0 };
    control.max_supply_a = 1000.0;
    let guard = &mut control.guard;
    guard.on_timeout = if dice.chance(0.7) { OnTimeout::Stop } else { OnTimeout::Fault };
    guard.if_stop_fails = if dice.chance(0.7) { OnStopFailure::Off } else { OnStopFailure::Brake };
    guard.stall_s = dice.between(0.3, 2.0) as f32;
    if temper > Temper::Driven {
        guard.command_timeout_s = dice.between(0.1, 60.0) as f32;
        guard.arming_check = dice.chance(0.85);
        control.max_supply_a = dice.between(1.0, 1000.0) as f32;
        control.following_error_turns = dice.between(0.05, 5.0) as f32;
    }
}

/// What a user may set, wisely or not.
fn daring(dice: &mut Dice, settings: &mut Settings) {
    let Some(control) = &mut settings.control else { return };
    if dice.chance(0.4) {
        control.current_bandwidth_hz *= dice.between(0.1, 2.0) as f32;
        control.speed_bandwidth_hz *= dice.between(0.1, 4.0) as f32;
        control.position_bandwidth_hz *= dice.between(0.1, 2.0) as f32;
    }
    if dice.chance(0.3) {
        settings.tracking_bandwidth_hz *= dice.between(0.1, 6.0) as f32;
    }
    if dice.chance(0.2) && settings.commutation == Commutation::FieldOriented {
        let most_a = (0.875 * control.max_current_a).min(0.8 * control.flux_linkage_wb / control.inductance_h);
        control.field_weakening_a = most_a * dice.within(0.1, 1.0) as f32;
        control.max_speed_rad_s *= dice.within(1.0, 1.5) as f32;
    }
    if dice.chance(0.2) {
        control.max_acceleration_rad_s2 *= dice.between(0.1, 10.0) as f32;
    }
    if dice.chance(0.1) {
        control.hold_current_a = control.max_current_a * dice.within(0.2, 1.0) as f32;
    }
    if dice.chance(0.1) {
        settings.phase_advance_deg = 25.0 * dice.share() as f32;
    }
    if dice.chance(0.1) {
        settings.max_modulation = dice.within(0.3, 1.0) as f32;
    }
    settings.tolerated_samples = dice.one_of(&[8, 8, 8, 0, 3, 30]);
}

/// In words.
pub(super) fn words(settings: &Settings) -> String {
    let Some(control) = &settings.control else { return String::new() };
    format!(
        "settings: {:?}, {} Halls{}, {:.0} Hz PWM; {:.4} Ω, {:.1} µH × {:.2}, {:.3} mWb, {:.3} g·cm²; bandwidths {:.0} Hz \
         current, {:.2} Hz speed, {:.2} Hz position, {:.0} Hz tracker; over-current {:.1} A, up to {:.1} rad/s, {:.1} rad/s²{}",
        settings.commutation,
        settings.halls,
        if settings.run_on_two_halls { ", runs on with two" } else { "" },
        settings.pwm_hz,
        control.resistance_ohm,
        1e6 * control.inductance_h,
        control.saliency,
        1e3 * control.flux_linkage_wb,
        1e7 * control.inertia_kgm2,
        control.current_bandwidth_hz,
        control.speed_bandwidth_hz,
        control.position_bandwidth_hz,
        settings.tracking_bandwidth_hz,
        control.guard.over_current_a,
        control.max_speed_rad_s,
        control.max_acceleration_rad_s2,
        if control.field_weakening_a > 0.0 { ", weakens the field" } else { "" },
    )
}
