//! Constants, with reasons. The shield's schematic is in UM2415, the Nucleo's is MB1367 (UM2505). Where a number is not
//! from one of them, the README says from where.
//!
//! # How the STSPIN830 is driven
//!
//! The library tells for each leg whether it is driven, upper and lower transistor in turn, or floating, and off is all
//! legs floating, at once, also by a break without code. The driver has two ways to be told, chosen by its pin MODE.
//!
//! - **One input and one enable a leg** (the shield as it comes): INx is the PWM, ENx low lets the leg float. TIM1
//!   cannot do that: while CHx switches, CHxN is its complement and not a level. ENx would be a port's output, written
//!   by code, not preloaded with the duties and not cleared by a break: when MOE falls, INx goes low with ENx still
//!   high, which shorts the motor's windings instead of letting go of them.
//! - **Two inputs a leg** (MODE high, a rework): INxH and INxL are CHx and CHxN. Both low is floating, MOE low is all
//!   floating, and a break acts without code. This is what the other boards have, and what is used here.

use hallservo::settings::{Ceiling, Control, GuardSettings, Settings, Thermistor};
use stm32g4::registers::adc::{Rank, Sampling, Sequence};
use stm32g4::registers::timer::{Active, Break, Gates};
use stm32g4::wiring::{ChopperOutput, Wiring};

/// Shunts of 330 mΩ, amplified 1.53 times.
const VOLTS_PER_AMPERE: f32 = 0.330 * 1.53;
/// Code of an amplifier without current: 1.56 V of 3.3 V, assumed. The drive measures what it is exactly.
pub const ZERO: u16 = 1936;

/// Amplifiers, Hall sensors and the thermistor, 3.2 kΩ at most.
const SHORT: Sampling = Sampling::from_source(3_200);
/// 169 kΩ and 9.31 kΩ: 8.8 kΩ.
const BUS: Sampling = Sampling::from_source(8_824);

/// V, W, Hall 3, bus.
pub const FIRST: Sequence =
    Sequence(&[Rank::new(12, SHORT), Rank::new(15, SHORT), Rank::new(7, SHORT), Rank::new(1, BUS)]);
/// U, Hall 1, Hall 2, temperature.
pub const SECOND: Sequence =
    Sequence(&[Rank::new(2, SHORT), Rank::new(6, SHORT), Rank::new(9, SHORT), Rank::new(5, SHORT)]);

/// U and V are held as long before the valley as W after it.
const LEAD: u32 = (FIRST.held(0) + FIRST.held(1)) / 2;
/// Hall 1 is held 588 ns before the others: two ADCs cannot hold three at once.
pub const EARLY: u32 = FIRST.held(2) - SECOND.held(1);
const _: () = assert!(FIRST.held(0) == SECOND.held(0) && FIRST.held(2) == SECOND.held(2));
const _: () = assert!(FIRST.done() >= SECOND.done());

/// PWM, and control in every period.
const PWM_HZ: u32 = 40_000;

/// The way to the driver.
pub const BRIDGE: Wiring = Wiring {
    // STSPIN830 with MODE high: INxH and INxL, both active high.
    gates: Gates { upper: Active::High, lower: Active::High },
    // The STSPIN830 makes a dead time of its own; how long it is was not verified, so the timer makes one that is
    // enough without.
    dead_time_ns: 500,
    pwm_hz: PWM_HZ,
    // EN\FAULT, which the STSPIN830 pulls low at over-current, over-temperature and under-voltage.
    source: Break::PinLow,
    noise_ns: 380,
    lead: LEAD,
    // PC12 would do, at CN7-3: `Some(EnableInput { port: 2, pin: 12 })`.
    enable: None,
    // PC10, at CN7-1, in a firmware without the scope: the flash has room for one of them. Off unless `chopper_v` is set.
    chopper: if cfg!(feature = "scope") { None } else { Some(ChopperOutput { port: 2, pin: 10 }) },
};

/// Half of the reference, A.
const FULL_SCALE_A: f32 = 1.65 / VOLTS_PER_AMPERE;

/// What no setting exceeds.
const CEILINGS: &[Ceiling] = &[
    // What the longest step leaves time for.
    ("pwm_hz", PWM_HZ as f32),
    // The STSPIN830's 1.5 A RMS.
    ("max_current_a", 2.1),
    // Current into the motor is seen up to 3.09 A only.
    ("over_current_a", 3.0),
    // The STSPIN830's largest supply.
    ("over_voltage_v", 45.0),
    // The STSPIN830 switches off by itself at 160 °C in its middle, of which the thermistor beside it shows less.
    ("bridge_max_c", 100.0),
];

/// What a drive on this board starts with.
pub const fn settings() -> Settings {
    let control = Control {
        current_full_scale_a: FULL_SCALE_A,
        // 1.5 A RMS of the STSPIN830.
        bridge_continuous_a: 2.1,
        // 169 kΩ and 9.31 kΩ.
        bus_full_scale_v: 3.3 * 178.31 / 9.31,
        // 1.5 A RMS.
        max_current_a: 2.1,
        guard: GuardSettings {
            // The STSPIN830 takes 7 to 45 V.
            under_voltage_v: 8.0,
            over_voltage_v: 42.0,
            over_current_a: 2.8,
            // More than the tolerance of the parts: the zero itself is assumed.
            offset_a: 0.5,
            // To 3.3 V, against 4.7 kΩ to ground: 1.055 V at 25 °C.
            bridge: Thermistor { pull_up_ohm: 4700.0, beta_k: 3425.0, ..Thermistor::ntc_10k(80.0, 100.0) },
            ..GuardSettings::for_full_scale(FULL_SCALE_A)
        },
        ..Control::DEFAULT
    };
    // Two thirds of a microsecond to either side, and 1.4 until edges of 0.7 µs and their noise of 0.7 µs are over.
    let sampling_window_s = 4e-6;
    Settings { ceilings: CEILINGS, ..BRIDGE.settings(sampling_window_s, FIRST.held(2), control) }
}
