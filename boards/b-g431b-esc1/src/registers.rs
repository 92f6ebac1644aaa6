//! The registers that decide whether transistors burn, worked out from the reference manual, and the settings a drive
//! starts with.

use crate::constants::*;
use hallservo::settings::Control;
use hallservo::settings::{Error, Settings};
use stm32g4::check::{self, channels};
use stm32g4::registers::{analog, timer};
use stm32g4::wiring::Wiring;

/// What the simulations on a host take for this board is this board.
#[test]
fn settings_are_exported() {
    check::exported(&settings(), include_str!("../settings.toml"));
}

#[test]
fn timer_of_the_bridge() {
    let Wiring { gates, source, lead, enable, chopper, .. } = BRIDGE;
    assert_eq!((enable, chopper), (None, None));
    assert_eq!(BRIDGE.period(), 2125);
    // DTG = 10 000100: 136 ticks, 800 ns; BKP = 1, active high; BKF = 1111: 256 ticks, 1.5 µs.
    assert_eq!(BRIDGE.bdtr(), 0x84 | 2 << 8 | 0b1111 << 10 | 15 << 16);
    assert_eq!(timer::af1(source), 1 << 1 | 1 << 2 | 1 << 4);
    // L6387: nothing inverted, all idle levels low.
    assert_eq!(timer::legs(gates, 7).ccer, 0x555);
    assert_eq!(timer::cr2(gates), 0x0070_0001);
    // 12.5 cycles each: held 59 and 159 ticks after the trigger.
    assert_eq!(lead, 109);
}

#[test]
fn sequences_of_the_converters() {
    // U PA2, W PB1, Hall 3 PB11, temperature PB14 on ADC1; V PA6, Hall 1 PA4, Hall 2 PC4, bus PA0 on ADC2.
    assert_eq!(channels(&FIRST), [3, 12, 14, 5]);
    assert_eq!(channels(&SECOND), [3, 17, 5, 1]);
    assert_eq!(SECOND.jsqr(), 3 | 8 << 2 | 1 << 7 | 3 << 9 | 17 << 15 | 5 << 21 | 1 << 27);
    // Hall 1 is 25 ADC cycles early: 588 ns.
    assert_eq!(EARLY, 100);
    assert_eq!(FIRST.done(), 549);
}

#[test]
fn comparators_trip_at_sixty_amperes() {
    // At the pins: 4/7 of 3 mΩ · 60 A, above 3.3 V · (1.5 ∥ 2.2) / (22 + 1.5 ∥ 2.2).
    let parallel = 1.5 * 2.2 / 3.7;
    let volts = 3.3 * parallel / (22.0 + parallel) + 60.0 * 0.003 * 4.0 / 7.0;
    assert!((f64::from(TRIP_UV) * 1e-6 - volts).abs() < 0.5e-3, "{volts}");
    assert_eq!(analog::dac_code(TRIP_UV), 288);
    // The same bias, sixteen times, is the zero of the ADC.
    let zero = 16.0 * 3.3 * parallel / (22.0 + parallel) / 3.3 * 4096.0;
    assert!((f64::from(ZERO) - zero).abs() < 1.0, "{zero}");
}

/// Three lithium cells and 12 V supplies: the current control has room for the default motor down to the least bus
/// voltage. A motor for which there is none is told how much there is.
#[test]
fn three_cells_are_enough() {
    let with = |inductance_h: f32, current_bandwidth_hz: f32| {
        let control = settings().control.unwrap();
        let control = Some(Control { inductance_h, current_bandwidth_hz, ..control });
        Settings { control, ..settings() }.validate()
    };
    assert_eq!(settings().control.unwrap().guard.under_voltage_v, 9.0);
    assert!(with(0.43e-3, 1000.0).is_ok());
    let Err(Error::OutOfRange { field: "current_bandwidth_hz", max, .. }) = with(1e-3, 1000.0) else { panic!() };
    assert!((430.0..450.0).contains(&max), "{max}");
    assert!(with(1e-3, 430.0).is_ok());
}

#[test]
fn the_drive_can_start_and_agrees_with_the_registers() {
    check::settings(&settings(), &BRIDGE);
    check::currents(&settings(), &BRIDGE, &FIRST, 0..=1);
}

#[test]
fn what_sampling_and_dead_time_leave_of_the_voltage() {
    for (hz, expected) in [(40e3, 0.74), (20e3, 0.87)] {
        let left = check::voltage_left(&settings(), hz, None);
        assert!((left - expected).abs() < 0.005, "{hz}: {left}");
    }
}
