//! How a board drives its bridge.

use crate::registers::clock::HCLK_HZ;
use crate::registers::timer::{self, Break, Gates};
use core::num::NonZeroU32;
use hallservo::board::timing;
use hallservo::commutation::Commutation;
use hallservo::settings::Settings;
use hallservo::settings::{Control, GuardSettings, OnTimeout};

/// A pin that has to be high for the bridge to be on. It is pulled down: a wire that is broken is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EnableInput {
    /// 0 is A, up to 2.
    pub port: usize,
    /// Of that port.
    pub pin: usize,
}

/// A pin that switches a brake resistor on while it is high, by the gate driver of a transistor that has a pull-down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChopperOutput {
    /// 0 is A, up to 2.
    pub port: usize,
    /// Of that port.
    pub pin: usize,
}

/// What TIM1 has to know of the board.
#[derive(Clone, Copy, Debug)]
pub struct Wiring {
    /// Which levels switch transistors on.
    pub gates: Gates,
    /// From one transistor's off to the other's on, at least, in nanoseconds.
    pub dead_time_ns: u32,
    /// Switching frequency.
    pub pwm_hz: u32,
    /// What switches the bridge off without code.
    pub source: Break,
    /// How long a break is taken for noise, at most, in nanoseconds.
    pub noise_ns: u32,
    /// From the trigger of the ADCs to the valley, in ticks.
    pub lead: u32,
    /// The enable input, where one is wired.
    pub enable: Option<EnableInput>,
    /// The output for a brake resistor, where there is one.
    pub chopper: Option<ChopperOutput>,
}

impl Wiring {
    /// Counts of half a period.
    pub const fn period(&self) -> u16 {
        timer::auto_reload(HCLK_HZ, self.pwm_hz)
    }

    /// Ticks of a whole period.
    pub const fn whole_period(&self) -> NonZeroU32 {
        timer::whole(self.period())
    }

    /// Dead time as a field of BDTR.
    const fn dead_time_field(&self) -> u8 {
        timer::dead_time_field(timer::ticks(HCLK_HZ, self.dead_time_ns) as u16).expect("a dead time of 1 to 1008 ticks")
    }

    /// Dead time as it is, in ticks.
    pub const fn dead_time_ticks(&self) -> u16 {
        timer::dead_time_ticks(self.dead_time_field())
    }

    /// The same in seconds.
    pub const fn dead_time_s(&self) -> f32 {
        self.dead_time_ticks() as f32 / HCLK_HZ as f32
    }

    /// TIM1_BDTR.
    pub const fn bdtr(&self) -> u32 {
        timer::bdtr(self.dead_time_field(), self.source, timer::break_filter(timer::ticks(HCLK_HZ, self.noise_ns)))
    }

    /// What a drive starts with, whose sampling needs the lower transistors to conduct for a time, and whose Halls are
    /// held so many ticks after the trigger.
    pub const fn settings(&self, sampling_window_s: f32, held: u32, control: Control) -> Settings {
        let pwm_hz = self.pwm_hz as f32;
        // A motor whose tool has died, or whose line is broken, comes to rest.
        let guard = GuardSettings { command_timeout_s: 1.0, on_timeout: OnTimeout::Stop, ..control.guard };
        Settings {
            timer_hz: HCLK_HZ as f32,
            pwm_hz,
            dead_time_s: self.dead_time_s(),
            sampling_window_s,
            halls_held_s: timing::held_s(self.lead, held, HCLK_HZ as f32),
            commutation: Commutation::FieldOriented,
            max_electrical_hz: 1000.0,
            // A spark disturbs one sample. A second one in a row is a fault, and the bridge is off a period after the
            // first.
            tolerated_samples: 1,
            // Each costs the tasks some microseconds: half of the samples at 40 kHz is what they can take.
            calibration_record_hz: 20e3,
            control: Some(Control { guard, ..control }),
            ..Settings::DEFAULT
        }
    }
}
