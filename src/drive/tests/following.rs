//! Currents, speeds and positions: what is refused, what is a fault, what holds back.

use super::*;
use crate::board::sensing::Adc;

#[test]
fn a_drive_without_current_control_says_so() {
    let mut bench = Bench::running();
    assert_eq!(bench.command(Command::Current(Current(0))), Err(Refusal::NoControl));
    bench.command(Command::Disarm).unwrap();
    assert_eq!(bench.command(Command::Commutate(Commutation::FieldOriented)), Err(Refusal::NoControl));
    let settings = Settings { commutation: Commutation::FieldOriented, ..Settings::default() };
    assert_eq!(settings.validate(), Err(crate::settings::Error::NoControl));
}

#[test]
fn the_commutation_changes_only_while_the_bridge_is_off() {
    let mut bench = with_control(Commutation::Block, |_| ());
    bench.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.command(Command::Commutate(Commutation::Block)), Err(Refusal::Mode(Mode::Running)));
    assert_eq!(bench.drive.commutation(), Commutation::FieldOriented);
}

#[test]
fn demands_beyond_the_limits_are_refused() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    assert_eq!(bench.command(Command::Current(Current(0))), Err(Refusal::Mode(Mode::Ready)));
    bench.command(Command::Arm).unwrap();
    for bad in [i32::MAX, i32::MIN, 20_000, -20_000] {
        assert_eq!(bench.command(Command::Current(Current(bad))), Err(Refusal::TooLarge));
    }
    assert_eq!(bench.command(Command::Speed(Speed(i32::MIN))), Err(Refusal::TooLarge));
    assert_eq!(bench.mode(), Mode::Running);
}

#[test]
fn nothing_is_armed_that_would_fail_at_once() {
    type Spoil = fn(&mut Sample);
    let cases: [(Spoil, Fault); 7] = [
        (|s| s.bus = 1000, Fault::UnderVoltage),
        (|s| s.bus = 4000, Fault::OverVoltage),
        (|s| s.currents[1] = 4095, Fault::OverCurrent),
        (Adc::<12>::show_tripped, Fault::OverCurrent),
        (|s| s.temperatures[0] = TemperatureCode::new(100), Fault::BridgeHot),
        (|s| s.temperatures[1] = TemperatureCode::new(100), Fault::MotorHot),
        (|s| s.lost = LostPeriods::counted(1), Fault::Deadline),
    ];
    for (spoil, fault) in cases {
        let mut bench = with_control(Commutation::FieldOriented, |_| ());
        bench.service.send(Command::Arm).unwrap();
        let mut sample = healthy(bench.model.codes(bench.rotor));
        spoil(&mut sample);
        while bench.service.poll().is_some() {}
        bench.drive.step(&sample);
        bench.drive.step(&sample);
        assert_eq!(bench.reply(), Err(Refusal::Fault(fault)));
        // The same while running.
        bench.arm();
        bench.command(Command::Current(Current(100))).unwrap();
        let off = (1..=70 * CYCLE).find(|_| bench.drive.step(&sample).legs == Legs::NONE);
        assert!(off.is_some_and(|steps| steps == 1 || matches!(fault, Fault::BridgeHot | Fault::MotorHot)));
        assert_eq!(bench.mode(), Mode::Faulted(fault));
    }
}

#[test]
fn heat_reduces_the_current_before_it_is_a_fault() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    bench.command(Command::Arm).unwrap();
    let full = bench.config.control.unwrap().current(3.0).unwrap();
    bench.command(Command::Current(full)).unwrap();
    // Half way in codes from 80 to 100 °C.
    let ntc = crate::settings::Thermistor::ntc_10k(80.0, 100.0);
    let code = (ntc.code(80.0) + ntc.code(100.0)) / 32.0;
    let mut sample = healthy(bench.model.codes(bench.rotor));
    sample.temperatures[0] = TemperatureCode::new(code as u16);
    for _ in 0..140 * CYCLE {
        bench.drive.step(&sample);
    }
    let share = bench.drive.state().current_reference as f32 / full.0 as f32;
    assert!((share - 0.5).abs() < 0.02, "{share}");
    assert!(bench.drive.limits().contains(Limits::HEAT.with(Limits::CURRENT)));
}

#[test]
fn silence_stops_the_drive_if_so_chosen() {
    use crate::settings::OnTimeout;
    let mut bench = with_control(Commutation::FieldOriented, |control| {
        control.guard.command_timeout_s = 0.01;
        control.guard.on_timeout = OnTimeout::Stop;
    });
    bench.arm();
    let speed = bench.config.control.unwrap().speed(100.0).unwrap();
    bench.command(Command::Speed(speed)).unwrap();
    for _ in 0..390 {
        bench.step();
    }
    // What the tasks do by themselves is no sign of life of whoever commands.
    bench.install().unwrap();
    assert!(!bench.drive.limits().contains(Limits::TIMEOUT));
    for _ in 0..10 + 2 * OUTER {
        bench.step();
    }
    assert!(bench.drive.limits().contains(Limits::TIMEOUT));
    assert_eq!(bench.drive.servo.demand(), Demand::Speed(Speed(0)));
    bench.command(Command::Speed(speed)).unwrap();
    assert!(!bench.drive.limits().contains(Limits::TIMEOUT));
}
