//! What is measured at pins and registers, for the report and the JSON. Times in nanoseconds or seconds as named.

use measure::Range;
use serde::Serialize;
use std::collections::BTreeMap;

/// One node of the clock tree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Clock {
    /// As the reference manual calls it: `SYSCLK`, `HCLK`, `PCLK1`, `ADC12`, …
    pub name: String,
    /// Hz.
    pub hz: f64,
}

/// The motor timer as programmed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pwm {
    /// Period at the pins, Hz.
    pub hz: f64,
    /// Such as `centre-aligned 1`.
    pub mode: String,
    /// Ticks of the timer's clock from valley to peak (ARR).
    pub reload: u32,
    /// Dead time as BDTR.DTG asks for, ns.
    pub dead_time_ns: f64,
    /// How the outputs go when MOE falls, such as `forced to the idle level`.
    pub off_state: String,
    /// Break inputs that are enabled, by name.
    pub breaks: Vec<String>,
}

/// One leg of the bridge, measured at the pins.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Leg {
    /// Pins of the high and the low side, such as `PA8`, `PA7`.
    pub pins: [String; 2],
    /// The level that closes the switch, `high` or `low`, for each side as the *driver* takes it.
    pub driver_on_level: [String; 2],
    /// The level the timer drives for "on", for each side (CCxP, CCxNP).
    pub timer_on_level: [String; 2],
    /// From low side off to high side on, ns.
    pub dead_time_rising_ns: Range,
    /// From high side off to low side on, ns.
    pub dead_time_falling_ns: Range,
    /// Both switches closed: how often.
    pub shoot_through: u64,
    /// When first, seconds.
    pub first_shoot_through_s: Option<f64>,
}

/// One conversion of the sequence that the motor timer triggers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sampling {
    /// Such as `ADC1`.
    pub adc: String,
    /// Rank in the sequence, from 1.
    pub rank: u32,
    /// Input channel.
    pub channel: u32,
    /// What the board has there: `hall 1`, `phase current U`, …
    pub signal: String,
    /// Such as `TIM1_TRGO2`.
    pub trigger: String,
    /// Where in the PWM period the trigger comes, from the timer's underflow, ns.
    pub trigger_ns: Range,
    /// Where sampling starts, ns.
    pub start_ns: Range,
    /// Where it ends (the sample is held), ns.
    pub held_ns: Range,
    /// Where the conversion ends, ns.
    pub end_ns: Range,
}

/// The independent watchdog.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Watchdog {
    /// Runs out after, seconds.
    pub timeout_s: f64,
    /// Between two reloads, seconds.
    pub interval_s: Range,
    /// Resets.
    pub bites: u64,
}

/// The window watchdog.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WindowWatchdog {
    /// Time between two refreshes, as a share of the longest that was allowed.
    pub used: Range,
    /// Resets.
    pub bites: u64,
}

/// When the bridge was enabled or not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Edge {
    /// Seconds since power-on.
    pub at_s: f64,
    /// The new level.
    pub on: bool,
    /// What did it: `software`, `break TIM1_BKIN`, `reset`, …
    pub by: String,
}

/// All that was seen.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Facts {
    /// The clock tree, as it is now.
    pub clocks: Vec<Clock>,
    /// The motor timer, when it was last set up.
    pub pwm: Option<Pwm>,
    /// The bridge.
    pub legs: [Leg; 3],
    /// The sequence that is sampled each period.
    pub sampling: Vec<Sampling>,
    /// Triggers of the injected sequences.
    pub triggers: u64,
    /// Triggers that came while a sequence was still converting.
    pub missed_triggers: u64,
    /// Sequences whose data was overwritten before the firmware read it; not while a flash operation holds the core
    /// with the bridge off.
    pub unread_sequences: u64,
    /// Edges of MOE.
    pub moe: Vec<Edge>,
    /// When the brake resistor was switched on or off, s.
    pub brake: Vec<(f64, bool)>,
    /// The watchdog, when it was started.
    pub watchdog: Option<Watchdog>,
    /// The window watchdog, when it was started.
    pub window_watchdog: Option<WindowWatchdog>,
    /// Flash operations: programmed double words and erased pages.
    pub flash_operations: u64,
    /// What is wrong at pins or inside without an access to blame, seconds of the first time: `dead time: …`,
    /// `idle states: …`, `alternate function: …`, `ADC1: …`.
    pub findings: Vec<(f64, String)>,
    /// The script's disturbances and what else happened, with seconds.
    pub events: Vec<(f64, String)>,
    /// Figures of the motor at the end: `angle_turns`, `speed_rad_s`, …
    pub motor: BTreeMap<String, f64>,
}

/// Columns over time, decimated.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Trace {
    /// Names with units, such as `angle / turns`; the first is `time / s`.
    pub names: Vec<String>,
    /// One row an instant, as long as `names`.
    pub rows: Vec<Vec<f64>>,
}
