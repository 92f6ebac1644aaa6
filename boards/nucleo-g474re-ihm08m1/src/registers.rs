//! The registers that decide whether transistors burn, worked out from the reference manual, and the settings a drive
//! starts with.

use crate::constants::*;
use stm32g4::check::{self, channels};
use stm32g4::registers::timer;
use stm32g4::wiring::{ChopperOutput, EnableInput, Wiring};

/// What the simulations on a host take for this board is this board.
#[test]
fn settings_are_exported() {
    check::exported(&settings(), include_str!("../settings.toml"));
}

#[test]
fn timer_of_the_bridge() {
    let Wiring { gates, source, lead, .. } = BRIDGE;
    assert_eq!(BRIDGE.period(), 2125);
    // DTG = 85 ticks, 500 ns; LOCK 2; OSSI, OSSR, BKE; BKP = 0, active low; BKF = 1001: 64 ticks, 376 ns.
    assert_eq!(BRIDGE.bdtr(), 85 | 2 << 8 | 0b0111 << 10 | 9 << 16);
    assert_eq!(timer::af1(source), 1);
    // L6398: all CCxNP set, idle levels of the lower outputs high.
    assert_eq!(timer::legs(gates, 7).ccer, 0xDDD);
    assert_eq!(timer::cr2(gates), 0x0070_2A01);
    // CN7-3.
    assert_eq!(BRIDGE.enable, Some(EnableInput { port: 2, pin: 12 }));
    assert_eq!(BRIDGE.chopper, Some(ChopperOutput { port: 2, pin: 10 }));
    // 24.5 cycles for the Halls, 12.5 for U and W: held 207 and 307 ticks after the trigger.
    assert_eq!(lead, 257);
}

#[test]
fn sequences_of_the_converters() {
    // Hall 3 PB14, U PA0, W PC0 on ADC1; bus PA1, V PC1, temperature PC2 on ADC2; PB13 on ADC3; PB12 on ADC4.
    assert_eq!(channels(&FIRST), [5, 1, 6]);
    assert_eq!(channels(&SECOND), [2, 7, 8]);
    assert_eq!((channels(&THIRD), channels(&FOURTH)), (vec![5], vec![3]));
    assert_eq!(FIRST.jsqr(), 2 | 8 << 2 | 1 << 7 | 5 << 9 | 1 << 15 | 6 << 21);
    // 24.5 cycles (3) for channel 5, 12.5 (2) for 1 and 6.
    assert_eq!(FIRST.smpr(), [3 << 15 | 2 << 3 | 2 << 18, 0]);
    // All three Halls at once.
    assert_eq!([FIRST.held(0), THIRD.held(0), FOURTH.held(0)], [107; 3]);
    assert_eq!(FIRST.done(), 357);
}

#[test]
fn the_drive_can_start_and_agrees_with_the_registers() {
    check::settings(&settings(), &BRIDGE);
    check::currents(&settings(), &BRIDGE, &FIRST, 1..=2);
}

#[test]
fn what_sampling_and_dead_time_leave_of_the_voltage() {
    for (hz, expected) in [(80e3, 0.68), (40e3, 0.84), (20e3, 0.92)] {
        let left = check::voltage_left(&settings(), hz, None);
        assert!((left - expected).abs() < 0.005, "{hz}: {left}");
    }
    for (hz, expected) in [(80e3, 0.78), (40e3, 0.90), (20e3, 0.95)] {
        let left = check::voltage_left(&settings(), hz, Some(1e-6));
        assert!((left - expected).abs() < 0.005, "{hz}: {left}, with two currents");
    }
}
