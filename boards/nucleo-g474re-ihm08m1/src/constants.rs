//! Constants, with reasons. Schematics: X-NUCLEO-IHM08M1 (UM1996), MB1367 (UM2505).

use hallservo::settings::{Ceiling, Control, GuardSettings, Settings, Thermistor};
use stm32g4::registers::adc::{Rank, Sampling, Sequence};
use stm32g4::registers::timer::{Active, Break, Gates};
use stm32g4::wiring::{ChopperOutput, EnableInput, Wiring};

/// Shunts of 10 mΩ, amplified 5.18 times by the shield.
const VOLTS_PER_AMPERE: f32 = 0.010 * 5.18;
/// Code of an amplifier without current: 1.71 V of 3.3 V. The drive measures what it is exactly.
pub const ZERO: u16 = 2122;

/// The amplifiers are strong sources, the thermistor is one of 3.2 kΩ at most.
pub const SHORT: Sampling = Sampling::from_source(3_200);
/// 169 kΩ and 9.31 kΩ: 8.8 kΩ. The Halls take as long as the bus that is sampled beside them.
pub const BUS: Sampling = Sampling::from_source(8_800);

/// Hall 3, U, W.
pub const FIRST: Sequence = Sequence(&[Rank::new(5, BUS), Rank::new(1, SHORT), Rank::new(6, SHORT)]);
/// Bus, V, temperature.
pub const SECOND: Sequence = Sequence(&[Rank::new(2, BUS), Rank::new(7, SHORT), Rank::new(8, SHORT)]);
/// Hall 2.
pub const THIRD: Sequence = Sequence(&[Rank::new(5, BUS)]);
/// Hall 1.
pub const FOURTH: Sequence = Sequence(&[Rank::new(3, BUS)]);

/// U and V are held as long before the valley as W after it.
const LEAD: u32 = (FIRST.held(1) + FIRST.held(2)) / 2;
// All Halls are held at once, and the interrupt comes when everything is done.
const _: () = assert!(FIRST.held(0) == THIRD.held(0) && FIRST.held(0) == FOURTH.held(0));
const _: () = assert!(FIRST.done() >= SECOND.done() && FIRST.done() > THIRD.done());

/// PWM, and control in every period. Twice what nobody hears any more: half the ripple of the current, half the delay,
/// and so 1 kHz of current control with a phase to spare. The control interrupt takes half of a period at most, and
/// sampling and dead time an eighth, which is the voltage that is given for it. 20 kHz for little loss by switching:
/// everything else follows.
const PWM_HZ: u32 = 40_000;

/// The way to the gate drivers.
pub const BRIDGE: Wiring = Wiring {
    // L6398: the lower inputs are inverted.
    gates: Gates { upper: Active::High, lower: Active::Low },
    // The L6398 makes 320 ns of its own, counted from the same edges: the longer one acts.
    dead_time_ns: 500,
    pwm_hz: PWM_HZ,
    // The shield's comparators at the shunts, 30 A: open collectors, low at a current that is too large.
    source: Break::PinLow,
    noise_ns: 380,
    lead: LEAD,
    // PC12, beside the 3.3 V of the same connector. `None` if nothing is wired there: the drive then runs without.
    enable: Some(EnableInput { port: 2, pin: 12 }),
    // PC10, two pins from the enable input. Off unless `chopper_v` is set.
    chopper: Some(ChopperOutput { port: 2, pin: 10 }),
};

/// Half of the reference, A.
const FULL_SCALE_A: f32 = 1.65 / VOLTS_PER_AMPERE;

/// What no setting exceeds. The firmware with an encoder leaves out the first.
pub const CEILINGS: &[Ceiling] = &[
    // 2126 cycles from trigger to trigger: the work begins 357 after the trigger, and takes 1480 at most with the bridge on.
    // A calibration's first step takes longer, and the bridge is off then.
    ("pwm_hz", 80e3),
    // 15 A RMS is what UM1996 gives the shield.
    ("max_current_a", 21.0),
    // Below the 30 A of the comparators, with a margin for the tolerance of both.
    ("over_current_a", 27.0),
    // The shield is made for 48 V, its STL220N6F7 transistors for 60 V, of which ringing takes its part.
    ("over_voltage_v", 52.0),
    // The FR-4 stands 130 °C, and the transistors are hotter than the thermistor beside them.
    ("bridge_max_c", 110.0),
];

/// What a drive on this board starts with.
pub const fn settings() -> Settings {
    let control = Control {
        current_full_scale_a: FULL_SCALE_A,
        // 15 A RMS of the shield.
        bridge_continuous_a: 21.0,
        // 169 kΩ and 9.31 kΩ.
        bus_full_scale_v: 3.3 * 178.31 / 9.31,
        guard: GuardSettings {
            under_voltage_v: 9.0,
            over_voltage_v: 50.0,
            // To 3.3 V, against 4.7 kΩ to ground.
            bridge: Thermistor { pull_up_ohm: 4700.0, beta_k: 3425.0, ..Thermistor::ntc_10k(80.0, 100.0) },
            ..GuardSettings::for_full_scale(FULL_SCALE_A)
        },
        ..Control::DEFAULT
    };
    // Two thirds of a microsecond to either side, and a half for the amplifiers to settle.
    let sampling_window_s = 2.5e-6;
    Settings { ceilings: CEILINGS, ..BRIDGE.settings(sampling_window_s, FIRST.held(0), control) }
}
