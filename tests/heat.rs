//! What heats motor and bridge is limited first and switched off then; a thermistor that tells nothing is a fault.

use hallservo::board::TemperatureCode;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings, Thermistor};
use plant::PlantParameters;
use sim::rig::Rig;

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
    let mut rig = Rig::new(&plant, settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.run(0.1, |_, _| ());
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
    for commutation in [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block] {
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
        rig.run(0.1, |_, _| ());
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
    rig.run(2.0, |_, _| ());
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
        rig.run(5.0, |_, _| ());
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
    rig.run(1.0, |_, _| ());
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
            rig.run(0.06, |_, _| ());
            let expected = fault.map_or(Mode::Running, Mode::Faulted);
            assert_eq!(rig.drive.mode(), expected, "{code}");
            if let Some(fault) = fault {
                rig.command(Command::Clear).unwrap();
                assert_eq!(rig.command(Command::Arm).unwrap_err().to_string(), fault.to_string());
            }
        }
        let mut rig = blocked(&settings(Control::default()), 1.0);
        rig.temperatures[place] = TemperatureCode::MISSING;
        rig.run(0.06, |_, _| ());
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
}
