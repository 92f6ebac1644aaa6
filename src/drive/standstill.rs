//! A measurement at standstill that needs to know nothing of the motor: one phase against the other two.
//!
//! A voltage rises slowly until the current that was asked for flows, and then keeps it; whatever the impedance is, the
//! current cannot leap. A square wave of a few periods may be added, whose current tells the inductance: along the phase,
//! or across it, from one of the other two to the third. What flows and
//! what drives it are summed up over windows, in whole counts of the timer, so that rounding does not matter; whoever
//! asks makes ohms and henries of them ([`Evaluation`](crate::service::standstill::Evaluation)).

use super::{Drive, OpenLoop, Refusal, Reply, Sample};
use crate::board::{Legs, Output};
use crate::commutation::Modulation;
use crate::config::Config;
use crate::mode::{Event, Mode};

/// What is to be measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Probe {
    /// Phase that the current flows into, 0 to 2.
    pub phase: u8,
    /// That current, in 2⁻¹⁵ of the full scale.
    pub current: i32,
    /// Amplitude of the square wave, in counts: of the phase's voltage, or of the other two against each other.
    pub ripple: i32,
    /// Whether the square wave is across the phase.
    pub across: bool,
    /// Whether its swing is measured across the phase.
    pub swings_across: bool,
}

/// What flowed in a window of [`WINDOW`] steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Window {
    /// What was to be measured.
    pub probe: Probe,
    /// Sum of three times the current, in 2⁻¹⁵ of the full scale.
    pub current: i32,
    /// Sum of three times the voltage along the phase, in counts.
    pub voltage: i32,
    /// Sum over the periods of the square wave: three times the current along the phase from where the wave begins to where
    /// it ends, in 2⁻¹⁵; across, once the difference of the other two phases' currents.
    pub swing: i32,
    /// Sum of the bus voltage, in 2⁻¹⁵ of its full scale.
    pub bus: i32,
    /// Whether the voltage was at its limit in the end.
    pub limited: bool,
}

/// Steps in a window.
pub const WINDOW: u32 = 2048;
/// Steps of half a period of the square wave.
pub const HALF: u32 = 4;
/// Steps after which the bridge is switched off unless the command came again.
const PATIENCE: u32 = 16_384;

/// The measurement at work.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standstill {
    window: Window,
    /// Modulation in 2⁻³¹.
    strength: i32,
    steps: u32,
    /// Steps until the bridge is switched off; 0 while nothing is measured.
    left: u32,
}

impl Standstill {
    /// Nothing is measured.
    pub const OFF: Self = Self {
        window: Window {
            probe: Probe { phase: 0, current: 0, ripple: 0, across: false, swings_across: false },
            current: 0,
            voltage: 0,
            swing: 0,
            bus: 0,
            limited: false,
        },
        strength: 0,
        steps: 0,
        left: 0,
    };

    pub const fn is_active(&self) -> bool {
        self.left > 0
    }

    /// Nothing is measured any more.
    pub const fn end(&mut self) {
        self.left = 0;
    }

    /// Takes up what is to be measured; the same again only says that somebody is still there.
    fn take_up(&mut self, probe: Probe) {
        if !self.is_active() {
            *self = Self::OFF;
        }
        self.left = PATIENCE;
        if probe.phase != self.window.probe.phase {
            self.strength = 0;
        }
        if probe != self.window.probe {
            self.steps = 0;
            self.window = Window { probe, ..Window::default() };
        }
    }

    /// One step: the compare values, and a window that is complete.
    fn step(&mut self, config: &Config, slow: i32, phases: [i32; 3], bus: i32) -> ([u16; 3], Option<Window>) {
        let Probe { phase, current, ripple, across, swings_across } = self.window.probe;
        let phase = usize::from(phase % 3);
        let [next, last] = [(phase + 1) % 3, (phase + 2) % 3];
        let (own, all) = (phases[phase], phases[0] + phases[1] + phases[2]);
        let flows = 3 * own - all;
        // An amplifier that shows too little must not let too much flow: the other phases carry half each.
        let largest = phases.iter().fold(flows.max(3 * own), |largest, &other| largest.max(-6 * other));
        let limits = &config.limits;
        let counts = |strength: i32| limits.amplitude(Modulation::from_bits((strength >> 16) as i16)).counts();
        let limited = counts(self.strength) + ripple >= counts(i32::MAX);
        let rises = largest < 3 * current && !limited;
        self.strength = self.strength.saturating_add(if rises { slow } else { -slow }).max(0);
        let place = self.steps % (2 * HALF);
        let wave = if place < HALF { ripple } else { -ripple };
        let [wave_along, wave_across] = if across { [0, wave] } else { [wave, 0] };
        let along = counts(self.strength) + wave_along;
        // The halves of a square wave around an odd number differ by the whole wave, too.
        let against = along >> 1;
        let half = i32::from(limits.half());
        let mut compare = [0; 3];
        compare[phase] = limits.nearest(half + along);
        compare[next] = limits.nearest(half - against + wave_across);
        compare[last] = limits.nearest(half - against - wave_across);

        let window = &mut self.window;
        window.current += flows;
        window.voltage += 2 * (along + against);
        window.bus += bus;
        window.limited = limited;
        let swings = if swings_across { phases[next] - phases[last] } else { flows };
        // What is computed now acts from the next sample to the one after it.
        match place {
            1 => window.swing -= swings,
            place if place == HALF + 1 => window.swing += swings,
            _ => {}
        }
        self.steps += 1;
        let mut complete = None;
        if self.steps == WINDOW {
            complete = Some(*window);
            self.steps = 0;
            *window = Window { probe: window.probe, ..Window::default() };
        }
        (compare, complete)
    }
}

impl Drive {
    /// Begins a measurement, or goes on with one: what was ended meanwhile is not begun again.
    pub(super) fn measure_standstill(&mut self, begins: bool, probe: Probe) -> Reply {
        let control = self.config.control.as_ref().ok_or(Refusal::NoControl)?;
        if probe.current > control.max_current || probe.current < 0 {
            return Err(Refusal::TooLarge);
        }
        if begins {
            self.calibrate()?;
        } else if self.mode != Mode::Aligning || !self.paths.standstill.is_active() {
            return Err(Refusal::Mode(self.mode));
        }
        self.paths.standstill.take_up(probe);
        Ok(())
    }

    /// A step of it.
    #[cold]
    #[inline(never)]
    pub(super) fn standstill(&mut self, sample: &Sample) -> Output {
        let Self { config, paths, channels, .. } = self;
        let (Some(control), Some(regulator)) = (&config.control, &config.open_loop.regulator) else {
            return Output::OFF;
        };
        let phases = paths.idle.phases(control, sample);
        let bus = control.bus(sample.bus);
        let (compare, window) = paths.standstill.step(config, regulator.slow, phases, bus);
        if let Some(window) = window {
            // A task that does not take them does not get any more.
            let _ = channels.windows.enqueue(window);
        }
        paths.standstill.left -= 1;
        if !paths.standstill.is_active() {
            paths.open_loop = OpenLoop::OFF;
            self.on(Event::Disarm);
        }
        Output { compare, legs: Legs::ALL }
    }
}
