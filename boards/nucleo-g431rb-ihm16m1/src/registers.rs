//! The registers that decide whether transistors burn, worked out from the reference manual, and the settings a drive
//! starts with.

use crate::constants::*;
use stm32g4::check::{self, channels};
use stm32g4::registers::timer;
use stm32g4::wiring::Wiring;

/// What the simulations on a host take for this board is this board.
#[test]
fn settings_are_exported() {
    check::exported(&settings(), include_str!("../settings.toml"));
}

#[test]
fn timer_of_the_bridge() {
    let Wiring { gates, source, lead, enable, chopper, .. } = BRIDGE;
    assert_eq!(enable, None);
    assert_eq!(chopper.is_some(), !cfg!(feature = "scope"));
    assert_eq!(BRIDGE.period(), 2125);
    // DTG = 85 ticks, 500 ns; LOCK 2; OSSI, OSSR, BKE; BKP = 0, active low; BKF = 1001: 64 ticks, 376 ns.
    assert_eq!(BRIDGE.bdtr(), 85 | 2 << 8 | 0b0111 << 10 | 9 << 16);
    assert_eq!(timer::af1(source), 1);
    // Nothing inverted, all idle levels low: the driver floats.
    assert_eq!(timer::legs(gates, 7).ccer, 0x555);
    assert_eq!(timer::cr2(gates), 0x0070_0001);
    // 12.5 cycles each: held 59 and 159 ticks after the trigger.
    assert_eq!(lead, 109);
}

#[test]
fn sequences_of_the_converters() {
    // V PB1, W PB0, Hall 3 PC1, bus PA0 on ADC1; U PA1, Hall 1 PC0, Hall 2 PC3, temperature PC4 on ADC2.
    assert_eq!(channels(&FIRST), [12, 15, 7, 1]);
    assert_eq!(channels(&SECOND), [2, 6, 9, 5]);
    assert_eq!(FIRST.jsqr(), 3 | 8 << 2 | 1 << 7 | 12 << 9 | 15 << 15 | 7 << 21 | 1 << 27);
    assert_eq!(SECOND.jsqr(), 3 | 8 << 2 | 1 << 7 | 2 << 9 | 6 << 15 | 9 << 21 | 5 << 27);
    // 12.5 cycles (2) for channels 7, 12 and 15, 24.5 (3) for 1.
    assert_eq!(FIRST.smpr(), [3 << 3 | 2 << 21, 2 << 6 | 2 << 15]);
    // Hall 1 is 25 ADC cycles early: 588 ns.
    assert_eq!(EARLY, 100);
}

#[test]
fn amplifiers_show_what_the_driver_may_carry() {
    let control = settings().control.unwrap();
    // 505 mV/A: from 1.56 V down to ground, or up to 3.3 V.
    assert!((1.56_f32 / 0.5049 - 3.09).abs() < 0.01 && (1.74_f32 / 0.5049 - 3.45).abs() < 0.01);
    assert!(control.max_current_a < control.guard.over_current_a && control.guard.over_current_a < 3.09);
    assert!((f32::from(ZERO) / 4096.0 * 3.3 - 1.56).abs() < 1e-3);
}

#[test]
fn the_drive_can_start_and_agrees_with_the_registers() {
    check::settings(&settings(), &BRIDGE);
    check::currents(&settings(), &BRIDGE, &FIRST, 0..=1);
}

#[test]
fn what_sampling_and_dead_time_leave_of_the_voltage() {
    for (hz, expected) in [(40e3, 0.78), (20e3, 0.89)] {
        let left = check::voltage_left(&settings(), hz, None);
        assert!((left - expected).abs() < 0.005, "{hz}: {left}");
    }
}
