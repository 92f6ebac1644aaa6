//! What heats motor and bridge is limited first and switched off then; a thermistor that tells nothing is a fault.

use crate::known;
use hallservo::board::TemperatureCode;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings, Thermistor};
use plant::{BackEmf, HeatParameters, PlantParameters};
use rig::Rig;

fn settings(control: Control) -> Settings {
    // What is commanded once has to hold.
    let guard = GuardSettings { arming_check: false, command_timeout_s: 60.0, ..control.guard };
    let control = Control { guard, ..control };
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

/// A motor whose windings are as the settings say, or not, calibrated, armed and blocked.
fn blocked(settings: &Settings, resistance: f64) -> Rig {
    let mut plant = PlantParameters::imperfect(1);
    plant.motor.resistance_ohm *= resistance;
    let mut rig = known::rig(&plant, settings, 1).unwrap();
    rig.wait(0.1);
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.command(Command::Arm).unwrap();
    rig
}

fn current(rig: &mut Rig, amperes: f32) {
    rig.command(Command::Current(rig.control().unwrap().current(amperes).unwrap())).unwrap();
}

/// Square of the current vector's length at the moment, A².
fn square(rig: &Rig) -> f64 {
    rig.plant.truth().currents_a.iter().map(|current| current * current).sum::<f64>() / 1.5
}

/// Energy into the windings in a time, J, and the mean square of the current over the last tenth of it.
fn heat(rig: &mut Rig, seconds: f64, resistance_ohm: f64) -> (f64, f64) {
    let (mut energy, mut late, mut count, total) = (0.0, 0.0, 0.0, rig.periods(seconds));
    let mut k = 0;
    rig.run(seconds, |rig, _| {
        let square = square(rig);
        energy += 1.5 * resistance_ohm * square * rig.period_s();
        k += 1;
        if k > total - total / 10 {
            (late, count) = (late + square, count + 1.0);
        }
    });
    (energy, late / count)
}

#[test]
fn a_blocked_rotor_gets_the_continuous_current_in_the_long_run() {
    let commutations = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];
    for commutation in commutations.into_iter().step_by(sim::of(2, 1)) {
        let settings = Settings { commutation, ..settings(Control::default()) };
        let mut rig = blocked(&settings, 1.0);
        current(&mut rig, 3.0);
        let (energy, late) = heat(&mut rig, 59.0, 3.75);
        println!("{commutation:?}: {energy:.0} J in 59 s, at last {:.3} A", late.sqrt());
        assert_eq!(rig.drive.mode(), Mode::Running);
        assert!(rig.drive.limits().contains(Limits::HEAT.with(Limits::CURRENT)));
        assert!(energy < 1200.0, "{energy}");
        assert!((late.sqrt() / 1.5 - 1.0).abs() < 0.05, "{}", late.sqrt());
    }
}

#[test]
fn the_housing_takes_its_share_after_its_own_time() {
    // Thirty times as fast as a motor.
    let control = Control { winding_time_s: 1.0, housing_time_s: 30.0, ..Control::default() };
    let mut rig = blocked(&settings(control), 0.75);
    current(&mut rig, 3.0);
    let (_, early) = heat(&mut rig, 10.0, 2.81);
    // What is commanded once holds for a minute at most.
    for _ in 0..3 {
        current(&mut rig, 3.0);
        heat(&mut rig, 40.0, 2.81);
    }
    let (_, late) = heat(&mut rig, 10.0, 2.81);
    assert!(early.sqrt() > 1.45 && (late.sqrt() / 1.5 - 1.0).abs() < 0.02, "{} {}", early.sqrt(), late.sqrt());
    // The housing, too, is as warm as it may be: half of the rise is left to the winding, which is there at once.
    current(&mut rig, 0.0);
    heat(&mut rig, 5.0, 2.81);
    current(&mut rig, 3.0);
    let (_, peak) = heat(&mut rig, 0.15, 2.81);
    assert!(peak.sqrt() > 2.9, "{}", peak.sqrt());
    let (_, again) = heat(&mut rig, 3.0, 2.81);
    assert!(again.sqrt() < 1.6, "{}", again.sqrt());
}

#[test]
fn disarming_and_clearing_cool_nothing() {
    let control = Control { winding_time_s: 2.0, ..Control::default() };
    let mut rig = blocked(&settings(control), 0.75);
    let mut energy = 0.0;
    for _ in 0..40 {
        current(&mut rig, 3.0);
        energy += heat(&mut rig, 0.1, 3.75).0;
        rig.command(Command::Trip(Fault::GateDriver)).unwrap();
        rig.command(Command::Clear).unwrap();
        rig.command(Command::Arm).unwrap();
        current(&mut rig, 3.0);
        energy += heat(&mut rig, 0.1, 3.75).0;
        rig.command(Command::Disarm).unwrap();
        rig.command(Command::Arm).unwrap();
    }
    // 8 s: with 3 A all the time 405 J; with 1.5 A 101 J, and what the winding takes up until it is warm.
    println!("{energy:.0} J");
    assert!(energy < 180.0, "{energy}");
}

#[test]
fn current_that_is_not_controlled_is_a_fault() {
    // A voltage that drives 2.4 A through the windings.
    let control = Control { winding_time_s: 1.0, ..Control::default() };
    let mut rig = blocked(&settings(control), 1.0);
    rig.drive_with(0.75).unwrap();
    let mut rose = 0.0;
    for _ in 0..100 {
        rig.wait(0.1);
        rose += 0.1;
        if rig.drive.mode() != Mode::Running {
            break;
        }
    }
    println!("{:.2} A for {rose:.1} s", square(&rig).sqrt());
    assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::WindingHot));
    assert!(rose > 0.3 && rose < 3.0, "{rose}");
    rig.command(Command::Clear).unwrap();
    let refused = rig.command(Command::Arm).unwrap_err().to_string();
    assert_eq!(refused, Fault::WindingHot.to_string());
    rig.wait(2.0);
    rig.command(Command::Arm).unwrap();
}

#[test]
fn calibrating_a_blocked_rotor_heats_it_too() {
    // By itself it takes no more than the continuous current; here it is told to.
    for (calibration_current_a, fault) in [(0.0, Fault::Calibration), (0.6, Fault::WindingHot)] {
        let control =
            Control { winding_time_s: 0.5, continuous_current_a: 0.3, calibration_current_a, ..Control::default() };
        let mut rig = Rig::new(&PlantParameters::imperfect(1), &settings(control), 1).unwrap();
        rig.plant.set_dyno(Some(0.0)).unwrap();
        rig.command(Command::Calibrate).unwrap();
        rig.wait(5.0);
        assert_eq!(rig.drive.mode(), Mode::Faulted(fault));
    }
}

#[test]
fn the_bridge_has_a_limit_of_its_own() {
    let control = Control { bridge_continuous_a: 1.0, continuous_current_a: 3.0, ..Control::default() };
    let mut rig = blocked(&settings(control), 1.0);
    current(&mut rig, 3.0);
    let (_, early) = heat(&mut rig, 0.05, 3.75);
    let (_, late) = heat(&mut rig, 6.0, 3.75);
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!(early.sqrt() > 2.9 && (late.sqrt() - 1.0).abs() < 0.03, "{} {}", early.sqrt(), late.sqrt());
    rig.drive_with(0.75).unwrap();
    rig.wait(1.0);
    assert_eq!(rig.drive.mode(), Mode::Faulted(Fault::BridgeOverload));
}

#[test]
fn a_thermistor_that_is_open_or_shorted_is_a_fault_and_never_cold() {
    let faults = [(Fault::BridgeThermistor, Fault::BridgeHot), (Fault::MotorThermistor, Fault::MotorHot)];
    let arctic = Thermistor::ntc_10k(80.0, 100.0).code(-38.0) / 16.0;
    for (place, (thermistor, hot)) in faults.into_iter().enumerate() {
        let codes = [
            (4095, Some(thermistor)),
            (4080, Some(thermistor)),
            (0, Some(thermistor)),
            (10, Some(thermistor)),
            (150, Some(hot)),
            (arctic as u16, None),
        ];
        for (code, fault) in codes {
            let mut rig = blocked(&settings(Control::default()), 1.0);
            rig.temperatures[place] = TemperatureCode::new(code);
            rig.wait(0.06);
            let expected = fault.map_or(Mode::Running, Mode::Faulted);
            assert_eq!(rig.drive.mode(), expected, "{code}");
            if let Some(fault) = fault {
                rig.command(Command::Clear).unwrap();
                assert_eq!(rig.command(Command::Arm).unwrap_err().to_string(), fault.to_string());
            }
        }
        let mut rig = blocked(&settings(Control::default()), 1.0);
        rig.temperatures[place] = TemperatureCode::MISSING;
        rig.wait(0.06);
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
}

/// Largest rise of the winding's temperature in the settings; the continuous current's own is 0.87 of it, 87 K.
const ALLOWED_K: f32 = 100.0;
/// What is left of errors in these tests: the dead time and its compensation, the amplifiers' zeros, and what the copper warms
/// until a mean shows it.
const ERROR_K: f64 = 12.0;

/// How warm a cold motor may seem.
const COLD_K: f32 = 22.0;

/// A motor that warms twice as far as that of the settings, and in half of the time: by 174 K at 1.5 A, without what the
/// resistance rises by.
fn warms_twice_as_far(plant: &mut PlantParameters) {
    plant.motor.heat =
        Some(HeatParameters { copper_k_per_w: 6.9, copper_time_s: 15.0, housing_k_per_w: 6.9, housing_time_s: 60.0 });
}

fn warming(max_winding_rise_k: f32) -> Settings {
    let guard = GuardSettings { max_winding_rise_k, ..GuardSettings::default() };
    settings(Control { winding_time_s: 30.0, housing_time_s: 120.0, guard, ..Control::default() })
}

/// The copper's largest rise while as much current is asked for as there may be, at a speed; and by how much the measurement
/// was off at most.
fn warmest(speed_rad_s: f64, settings: &Settings) -> (f64, f64) {
    let mut plant = PlantParameters::imperfect(1);
    warms_twice_as_far(&mut plant);
    let mut rig = Rig::new(&plant, settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.wait(0.1);
    rig.plant.set_dyno(Some(speed_rad_s)).unwrap();
    rig.command(Command::Arm).unwrap();
    let (mut most, mut off) = (0.0_f64, 0.0_f64);
    for _ in 0..3 {
        // What is commanded once holds for a minute at most.
        current(&mut rig, 3.0);
        rig.run(40.0, |rig, period| {
            let [copper_k, _] = period.truth.heat_k;
            most = most.max(copper_k);
            if let Some(rise_k) = rig.service.winding_rise_k() {
                off = off.max((f64::from(rise_k) - copper_k).abs());
            }
        });
        let measured = rig.service.winding_rise_k();
        println!(
            "{speed_rad_s} rad/s: {:.1} K, measured {measured:.1?} K, {:.2} A",
            rig.plant.truth().heat_k[0],
            square(&rig).sqrt()
        );
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
    (most, off)
}

/// The short form blocks the rotor, and does not look how warm it gets without the measurement.
#[test]
fn a_winding_that_warms_twice_as_far_is_seen_by_its_resistance() {
    let allowed = f64::from(ALLOWED_K);
    for speed_rad_s in [0.0, 8.0, -15.0].into_iter().take(sim::of(1, 3)) {
        if sim::of(false, true) {
            let (without, _) = warmest(speed_rad_s, &warming(0.0));
            println!("{speed_rad_s} rad/s: {without:.1} K without");
            assert!(without > 1.5 * allowed, "{without:.1} K");
        }
        let (with, off) = warmest(speed_rad_s, &warming(ALLOWED_K));
        println!("{speed_rad_s} rad/s: {with:.1} K with, off by {off:.1} K");
        assert!(with < allowed + ERROR_K && off < ERROR_K, "{with:.1} K, off by {off:.1} K");
    }
}

/// A motor in the cold, whose resistance is that of the settings, while nearly everything else is off: its flux linkage, the
/// dead time, and one way or the other the amplifiers' gains since they have measured the resistance.
fn cold(way: f64) -> Rig {
    let mut plant = PlantParameters::imperfect(3);
    plant.motor.back_emf = BackEmf::sinusoidal(5e-3 * (1.0 + 0.15 * way));
    plant.inverter.dead_time_s *= 1.0 + 0.2 * way;
    plant.current_sense.gain *= 1.0 - 0.02 * way;
    plant.motor.inertia_kgm2 *= 2.0;
    let guard = GuardSettings { max_winding_rise_k: 60.0, ..GuardSettings::default() };
    let control =
        Control { continuous_current_a: 2.5, inertia_kgm2: 2e-5, guard, max_regeneration_a: 5.0, ..Control::default() };
    plant.bus.regenerative = true;
    let settings = settings(control);
    let mut rig = Rig::new(&plant, &settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.wait(0.1);
    rig
}

/// The short form has one of the two ways.
#[test]
fn a_cold_motor_is_not_taken_for_a_warm_one() {
    const SPEEDS: [f32; 12] = [5.0, -5.0, 15.0, 300.0, -300.0, 0.0, 22.0, -40.0, 100.0, -2.0, -150.0, 0.5];
    for way in sim::either(0, [-1.0, 1.0]) {
        let mut rig = cold(way);
        rig.command(Command::Arm).unwrap();
        let (mut least, mut most, mut measured) = (0.0_f32, 0.0_f32, 0);
        for k in 0..60 {
            // Now the load drives, now it brakes.
            rig.plant.set_load([0.03, -0.03, 0.045, 0.0, -0.03][k % 5]).unwrap();
            let control = rig.control().unwrap();
            let speed = control.speed(SPEEDS[k % SPEEDS.len()]).unwrap();
            let amperes = control.current(if k % 2 == 0 { 2.2 } else { -2.2 }).unwrap();
            let command = if k % 10 == 9 { Command::Current(amperes) } else { Command::Speed(speed) };
            rig.command(command).unwrap();
            rig.run(1.0, |rig, _| {
                assert!(!rig.drive.limits().contains(Limits::HEAT), "{k} {way}");
                if let Some(rise_k) = rig.service.winding_rise_k() {
                    (least, most, measured) = (least.min(rise_k), most.max(rise_k), measured + 1);
                }
            });
            assert_eq!(rig.drive.mode(), Mode::Running, "{k} {way}");
        }
        println!("{way}: {least:.1} to {most:.1} K");
        assert!(measured > 1000 && least > -COLD_K && most < COLD_K, "{measured}, {least:.1} to {most:.1} K");
    }
}
