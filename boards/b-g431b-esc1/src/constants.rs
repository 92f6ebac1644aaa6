//! Constants, with reasons. Schematic: MB1419.

use hallservo::settings::{Ceiling, Control, GuardSettings, Settings, Thermistor};
use stm32g4::registers::adc::{Rank, Sampling, Sequence};
use stm32g4::registers::timer::{Active, Break, Gates};
use stm32g4::wiring::Wiring;

/// Each shunt, of 3 mΩ, feeds its op-amp through 1.5 kΩ against 2.2 kΩ to ground and 22 kΩ to 3.3 V: 4/7 of its
/// voltage, and 128.6 mV. Sixteen times that is 27.4 mV/A.
const VOLTS_PER_AMPERE: f32 = 0.003 * 16.0 * 4.0 / 7.0;
/// Code of an op-amp without current: 16 · 128.6 mV of 3.3 V. The drive measures what it is exactly.
pub const ZERO: u16 = 2553;

/// The comparators see the op-amps' inputs: 128.6 mV and 1.714 mV/A. 60 A, half as much again as the board is made for:
/// they are to stop a short circuit, the drive stops a current that is too large. In microvolts.
pub const TRIP_UV: u32 = 128_600 + 60 * 1714;

/// Op-amps and Hall sensors are strong sources; the longer of the short times, as 6.5 cycles leave 2 kΩ to them.
const SHORT: Sampling = Sampling::Cycles12_5;
/// 169 kΩ and 18 kΩ: 16.3 kΩ.
const BUS: Sampling = Sampling::from_source(16_300);

/// U, W, Hall 3, temperature.
pub const FIRST: Sequence =
    Sequence(&[Rank::new(3, SHORT), Rank::new(12, SHORT), Rank::new(14, SHORT), Rank::new(5, BUS)]);
/// V, Hall 1, Hall 2, bus.
pub const SECOND: Sequence =
    Sequence(&[Rank::new(3, SHORT), Rank::new(17, SHORT), Rank::new(5, SHORT), Rank::new(1, BUS)]);

/// U and V are held as long before the valley as W after it.
const LEAD: u32 = (FIRST.held(0) + FIRST.held(1)) / 2;
/// Hall 1 is held 588 ns before the others: two ADCs cannot hold three at once.
pub const EARLY: u32 = FIRST.held(2) - SECOND.held(1);
const _: () = assert!(FIRST.held(2) == SECOND.held(2) && FIRST.done() >= SECOND.done());

/// PWM, and control in every period. Twice what nobody hears any more: half the ripple of the current, half the delay,
/// and so 1 kHz of current control with a phase to spare. The control interrupt takes six tenths of a period at most,
/// and sampling and dead time a fifth, which is the voltage that is given for it. 20 kHz for little loss by switching:
/// everything else follows.
const PWM_HZ: u32 = 40_000;

/// The way to the gate drivers.
pub const BRIDGE: Wiring = Wiring {
    // L6387: both inputs active high.
    gates: Gates { upper: Active::High, lower: Active::High },
    // The L6387 refuses to switch both on, but makes no dead time: 110 and 105 ns of delay, 69 + 42 ns of the
    // STL180N6F7 to switch off, and gate resistors. ST's own firmware takes 800 ns.
    dead_time_ns: 800,
    pwm_hz: PWM_HZ,
    // COMP1, COMP2, COMP4.
    source: Break::Comparators(0b1011),
    // The longest there is: switching shows at the shunts.
    noise_ns: 1506,
    lead: LEAD,
    // PB7 of the Hall connector would do: `Some(EnableInput { port: 1, pin: 7 })`.
    enable: None,
    // No pin is left for it.
    chopper: None,
};

/// Half of the reference, A.
const FULL_SCALE_A: f32 = 1.65 / VOLTS_PER_AMPERE;

/// What no setting exceeds.
const CEILINGS: &[Ceiling] = &[
    // What the longest step leaves time for.
    ("pwm_hz", PWM_HZ as f32),
    // 40 A peak is what UM2516 gives the board.
    ("max_current_a", 40.0),
    // Current out of the motor is seen up to 45 A only.
    ("over_current_a", 44.0),
    // Six lithium cells are full at 25.2 V; the rest is for braking. The divider's full scale is 34.3 V.
    ("over_voltage_v", 30.0),
    // A board this small has nothing to take a hot spot's heat away.
    ("bridge_max_c", 100.0),
    ("stall_s", 2.0),
];

/// Whether the board's 120 Ω are at its end of the CAN: at the two ends of the wires, and nowhere between.
pub const TERMINATION: bool = false;

/// What a drive on this board starts with.
pub const fn settings() -> Settings {
    let control = Control {
        current_full_scale_a: FULL_SCALE_A,
        // Half of the 40 A that ST names as the peak; what it stands for ever was not measured.
        bridge_continuous_a: 20.0,
        // 169 kΩ and 18 kΩ.
        bus_full_scale_v: 3.3 * 187.0 / 18.0,
        guard: GuardSettings {
            // Three lithium cells that are empty; the L6387 gives up below 6 V.
            under_voltage_v: 9.0,
            // Six lithium cells, and something for braking.
            over_voltage_v: 28.0,
            // To 3.3 V, against 4.7 kΩ to ground.
            bridge: Thermistor { pull_up_ohm: 4700.0, beta_k: 3425.0, ..Thermistor::ntc_10k(80.0, 100.0) },
            ..GuardSettings::for_full_scale(FULL_SCALE_A)
        },
        ..Control::DEFAULT
    };
    // Two thirds of a microsecond to either side, and 1.4 for the op-amps to settle.
    let sampling_window_s = 4e-6;
    Settings { ceilings: CEILINGS, ..BRIDGE.settings(sampling_window_s, FIRST.held(2), control) }
}
