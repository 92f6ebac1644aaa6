//! A brake resistor across the bus of a supply that takes nothing back: what it keeps, and what keeps it from burning.
//! The conditions are unkind: the measured voltage is noisy and off by two per cent, the resistor by thirty, and it acts
//! a period late.

use crate::supply::speed;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::PlantParameters;
use rig::Rig;

/// Rated, Ω: 2.6 A at 26 V. A resistor is as much larger or smaller than that.
const OHM: f64 = 10.0;
const UNLIKE: [f64; 3] = [0.7, 1.0, 1.3];

const CHOPPER_V: f32 = 26.0;
const OVER_V: f64 = 32.0;

fn settings(change: impl FnOnce(&mut Control)) -> Settings {
    let guard = GuardSettings {
        chopper_v: CHOPPER_V,
        arming_check: false,
        // What is commanded once has to hold.
        command_timeout_s: 60.0,
        ..GuardSettings::default()
    };
    let mut control = Control { continuous_current_a: 3.0, guard, ..Control::default() };
    change(&mut control);
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

/// 470 µF, or half of it. The measured bus voltage is off by `gain`, and its noise is 0.2 V.
fn rig(settings: &Settings, gain: f64, brake_ohm: Option<f64>, capacitance_f: f64) -> Rig {
    let mut plant = PlantParameters::imperfect(1);
    plant.bus.capacitance_f = capacitance_f;
    plant.bus_sense.gain *= gain;
    plant.bus_sense.noise_v = 0.2 / 11.0;
    let mut rig = Rig::new(&plant, settings, 1).unwrap();
    rig.brake_ohm = brake_ohm;
    rig.calibrate(|_| ()).unwrap();
    rig.wait(0.1);
    rig
}

/// Largest bus voltage of a time.
fn highest(rig: &mut Rig, seconds: f64) -> f64 {
    let mut most = 0.0_f64;
    rig.run(seconds, |_, period| most = most.max(period.truth.bus_v));
    most
}

/// Largest bus voltage while the shaft is driven from outside, within so many seconds to a speed whose back-EMF is 35 V
/// from phase to phase, and held there.
fn driven(rig: &mut Rig, seconds: f64) -> f64 {
    let mut most = 0.0_f64;
    for percent in 0..=100 {
        rig.plant.set_dyno(Some(10.1 * f64::from(percent))).unwrap();
        most = most.max(highest(rig, seconds / 100.0));
    }
    most.max(highest(rig, 0.3))
}

#[test]
fn a_shaft_driven_from_outside_charges_the_bus_no_further_though_the_bridge_is_off() {
    // The motor's largest is 1.2 A for ever; it may be on for half of the time.
    let settings = settings(|control| control.guard.chopper_share = 0.5);
    for gain in [0.98, 1.02] {
        for unlike in UNLIKE {
            let mut rig = rig(&settings, gain, Some(unlike * OHM), 470e-6);
            let most = driven(&mut rig, 0.2);
            println!("bridge off, gain {gain}, {unlike} of the resistance: {most:.2} V");
            assert!(most < 28.0, "{most}");
            assert_eq!(rig.drive.mode(), Mode::Ready);
        }
    }
    // Without one, or with one whose wire is broken, and with one that no setting names.
    let none = self::settings(|control| control.guard.chopper_v = 0.0);
    for (settings, brake_ohm) in [(settings, None), (none, Some(OHM))] {
        let mut rig = rig(&settings, 1.0, brake_ohm, 470e-6);
        let most = driven(&mut rig, 0.2);
        println!("without: {most:.2} V");
        assert!(most > OVER_V, "{most}");
    }
}

#[test]
fn what_it_is_told_to_brake_with_stays_below_the_range_that_limits_braking() {
    // Half of the resistor's power goes back to it, and thirty per cent more of a smaller one.
    let told = |control: &mut Control| (control.max_regeneration_a, control.guard.chopper_share) = (1.8, 0.5);
    let with_it = |unlike: Option<f64>| {
        let mut rig = rig(&settings(told), 0.98, unlike.map(|unlike| unlike * OHM), 470e-6);
        rig.command(Command::Arm).unwrap();
        speed(&mut rig, 500.0);
        rig.wait(2.0);
        speed(&mut rig, -500.0);
        let mut to_rest = 0.0;
        let mut most = 0.0_f64;
        rig.run(2.0, |rig, period| {
            most = most.max(period.truth.bus_v);
            to_rest += if period.truth.speed_rad_s > 0.0 { rig.period_s() } else { 0.0 };
        });
        println!("reversal, {unlike:?} of the resistance: {most:.2} V, {to_rest:.3} s to rest");
        assert_eq!(rig.drive.mode(), Mode::Running);
        assert!(most < OVER_V);
        (most, to_rest)
    };
    let (without, slow) = with_it(None);
    assert!(without > 28.25, "{without}");
    for unlike in UNLIKE {
        let (most, fast) = with_it(Some(unlike));
        assert!(most < 28.25 && fast <= slow, "{most} {fast} {slow}");
    }
}

fn no_torque(rig: &mut Rig) {
    rig.command(Command::Current(rig.control().unwrap().current(0.0).unwrap())).unwrap();
}

#[test]
fn driven_from_outside_a_running_drive_goes_on_with_it_and_fails_without() {
    for (brake_ohm, mode) in [(Some(1.3 * OHM), Mode::Running), (None, Mode::Faulted(Fault::OverVoltage))] {
        // Beyond its largest speed it would fail of that.
        let fast = |control: &mut Control| (control.max_speed_rad_s, control.guard.chopper_share) = (1100.0, 0.5);
        let mut rig = rig(&settings(fast), 0.98, brake_ohm, 235e-6);
        rig.command(Command::Arm).unwrap();
        no_torque(&mut rig);
        let most = driven(&mut rig, 0.2);
        println!("bridge on, {brake_ohm:?} Ω: {most:.2} V, {:?}", rig.drive.mode());
        assert_eq!(rig.drive.mode(), mode);
        assert_eq!(most < 28.25, brake_ohm.is_some(), "{most}");
    }
}

#[test]
fn a_supply_above_its_voltage_for_good_does_not_burn_it() {
    let settings = settings(|_| ());
    let GuardSettings { chopper_on_s, chopper_share, .. } = settings.control.unwrap().guard;
    let mut rig = rig(&settings, 1.0, Some(OHM), 470e-6);
    rig.command(Command::Arm).unwrap();
    no_torque(&mut rig);
    rig.plant.set_supply(28.0).unwrap();
    let (mut failed_s, mut time_s) = (None, 0.0);
    rig.run(1.0, |rig, _| {
        time_s += rig.period_s();
        if failed_s.is_none() && rig.drive.mode() == Mode::Faulted(Fault::BrakeResistor) {
            failed_s = Some(time_s);
        }
    });
    println!("on for {failed_s:.3?} s, then a fault");
    assert!(failed_s.is_some_and(|time| (time / f64::from(chopper_on_s) - 1.0).abs() < 0.05));
    // It is off until the resistor is cold, and the drive is not armed before.
    rig.command(Command::Clear).unwrap();
    let refused = rig.command(Command::Arm).unwrap_err();
    assert!(refused.to_string().contains("brake resistor"), "{refused}");
    // Its share, for as long as the supply is too high.
    let (mut on, mut all) = (0_u32, 0_u32);
    rig.run(20.0, |rig, _| {
        on += u32::from(rig.brakes());
        all += 1;
    });
    let share = f64::from(on) / f64::from(all);
    println!("on for {share:.3} of 20 s");
    assert!(share <= f64::from(chopper_share) * 1.05 && share > f64::from(chopper_share) * 0.5, "{share}");
    rig.plant.set_supply(24.0).unwrap();
    rig.wait(5.0);
    assert!(!rig.brakes());
    rig.command(Command::Arm).unwrap();
    assert_eq!(rig.drive.mode(), Mode::Running);
}
