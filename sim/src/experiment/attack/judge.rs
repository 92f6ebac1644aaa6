//! Judges a drive by physics: what it was told, what it tells of itself, and how things truly are. Of the drive's code it
//! knows nothing.

use super::machine::RISE_K;
use super::scenario::Scenario;
use super::trace::Trace;
use hallservo::settings::Control;
use plant::Truth;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// What a drive must not do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Breach {
    /// A phase current beyond what is a fault, or beyond the largest for longer than an overshoot.
    Current,
    /// A current that is a fault, by the control of a drive whose settings fit its motor.
    Overshoot,
    /// A bus that the drive has pumped up beyond what is a fault.
    Bus,
    /// A current in a motor whose bridge is to be off.
    DrivenWhileOff,
    /// A winding hotter than its continuous current makes it.
    Heat,
    /// Faster than it may be, and nothing but the drive turns it.
    Speed,
    /// A position that is told and is not true.
    LostTurn,
    /// It swings by itself, for ever.
    Swings,
    /// It is not where it was told to be, and tells of nothing.
    Elsewhere,
    /// A fault of sound hardware to which nothing was done.
    FalseAlarm,
    /// It does not run again, though all is well.
    StaysOff,
    /// It does not answer.
    Mute,
    /// Its code has panicked.
    Panic,
    /// Physics that are no numbers any more.
    NotANumber,
}

/// A breach, when, and how far.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// What.
    pub breach: Breach,
    /// When, of the scenario's time, s.
    pub at_s: f64,
    /// In words.
    pub said: String,
}

/// How long something has lasted, and the worst of it.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting {
    since_s: f64,
    worst: f64,
}

impl Lasting {
    /// A step; the worst where it has lasted longer than so.
    fn look(&mut self, is: bool, value: f64, step_s: f64, longest_s: f64) -> Option<f64> {
        if !is {
            *self = Self::default();
            return None;
        }
        self.since_s += step_s;
        self.worst = self.worst.max(value);
        (self.since_s > longest_s).then_some(self.worst)
    }
}

/// What the drive is allowed at the moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowed {
    /// The bridge is to be off.
    pub is_off: bool,
    /// And has been for so long that nothing flows any more.
    pub is_still: bool,
    /// The drive controls the current: no voltage was commanded.
    pub controls: bool,
    /// Something outside turns the shaft, or has turned it just now.
    pub is_driven: bool,
    /// A part that measures or carries currents has broken.
    pub is_blind: bool,
    /// Where the sensors slipped or lie, the drive cannot know its angle.
    pub is_lost: bool,
}

/// From a drive whose amplifiers, wires or transistors have broken, so many times the current of a fault for so long:
/// SAFETY.md says so.
const BLIND: (f64, f64) = (2.2, 0.6);
/// From one that sees, what a sample is late by, and its noise.
const SEEN: (f64, f64) = (1.1, 0.5e-3);
/// Overshoot of a control that is to keep the largest current, and how long it may last, s.
const OVERSHOOT: (f64, f64) = (1.25, 0.05);
/// Noise and zero of the amplifiers, as a share of the full scale.
const AMPLIFIER: f64 = 0.03;
/// Beyond the voltage that is a fault, V, for longer than, s.
const PUMPED: (f64, f64) = (2.0, 1e-3);
/// Over-speed is a fifth above; so much more, and so many electrical hertz, for longer than, s.
const FAST: (f64, f64, f64) = (1.32, 10.0, 0.05);
/// A rotor that is far from its voltage has no current with the bridge off, for longer than, s.
const STILL_S: f64 = 2e-3;
/// Of a winding's rise by its continuous current.
const HOT: f64 = 1.3;

/// Watches a drive.
pub(super) struct Judge {
    control: Control,
    pairs: f64,
    step_s: f64,
    over: Lasting,
    above: Lasting,
    pumped: Lasting,
    driven: Lasting,
    fast: Lasting,
    pub allowed: Allowed,
    /// When the diodes of the bridge rectified the rotor's voltage last, s, and whether that was by what spun it up.
    pub generated_s: f64,
    is_spun: bool,
    pub verdicts: Vec<Verdict>,
    /// What led to the first verdict, where somebody wants to see it.
    pub trace: Option<Trace>,
    /// When the attack began, s.
    pub began_s: f64,
    /// What the largest current may truly be, as a share of what the settings say: 1 but to see that the judge judges.
    pub strictness: f64,
}

impl Judge {
    /// Before anything was told.
    pub fn new(scenario: &Scenario) -> Option<Self> {
        Some(Self {
            control: scenario.settings.control?,
            pairs: scenario.plant.motor.pole_pairs.into(),
            step_s: 1.0 / scenario.plant.inverter.pwm_hz,
            over: Lasting::default(),
            above: Lasting::default(),
            pumped: Lasting::default(),
            driven: Lasting::default(),
            fast: Lasting::default(),
            allowed: Allowed {
                is_off: true,
                is_still: true,
                controls: true,
                is_driven: false,
                is_blind: false,
                is_lost: false,
            },
            generated_s: -1.0,
            is_spun: false,
            verdicts: Vec::new(),
            trace: None,
            began_s: 0.0,
            strictness: 1.0,
        })
    }

    /// Other settings.
    pub fn configure(&mut self, control: Control) {
        self.control = control;
    }

    /// A control period. Once something is judged, it is not judged again.
    pub fn look(&mut self, truth: &Truth) {
        if let Some(trace) = self.trace.as_mut().filter(|_| self.verdicts.is_empty()) {
            trace.push(truth, self.began_s);
        }
        let current_a = truth.currents_a.iter().fold(0.0_f64, |most, a| most.max(a.abs()));
        if !(current_a + truth.bus_v + truth.speed_rad_s).is_finite() {
            return self.say(Breach::NotANumber, truth, format!("{truth:?}"));
        }
        // The diodes of the bridge rectify the voltage of a fast rotor, whatever the drive does.
        let square_v2 = truth.back_emf_v.iter().map(|v| v * v).sum::<f64>();
        let generates = (2.0 * square_v2).sqrt() > 0.9 * truth.bus_v;
        self.current(truth, current_a, generates);
        self.bus(truth, generates);
        self.motion(truth, current_a, generates);
        if generates {
            self.generated_s = truth.time_s;
            // Spun up from outside, a rotor heats its winding through the diodes of the bridge.
            self.is_spun |= truth.speed_rad_s.abs() > FAST.0 * f64::from(self.control.max_speed_rad_s);
        }
        if truth.heat_k[0] > HOT * RISE_K && !self.is_spun {
            self.say(Breach::Heat, truth, format!("the winding is {:.0} K warm", truth.heat_k[0]));
        }
    }

    fn current(&mut self, truth: &Truth, current_a: f64, generates: bool) {
        let Control { max_current_a, current_full_scale_a, guard, .. } = self.control;
        let free = self.allowed.is_still || generates;
        let (times, longest_s) = if self.allowed.is_blind { BLIND } else { SEEN };
        let zero_a = AMPLIFIER * f64::from(current_full_scale_a);
        let most_a = self.strictness * (times * f64::from(guard.over_current_a) + zero_a);
        if let Some(worst) = self.over.look(!free && current_a > most_a, current_a, self.step_s, longest_s) {
            self.say(Breach::Current, truth, format!("{worst:.2} A where {:.2} A are a fault", guard.over_current_a));
        }
        let (times, longest_s) = OVERSHOOT;
        let most_a = self.strictness * (times * f64::from(max_current_a) + zero_a);
        let above = !free && self.allowed.controls && !self.allowed.is_blind && current_a > most_a;
        if let Some(worst) = self.above.look(above, current_a, self.step_s, longest_s) {
            self.say(Breach::Current, truth, format!("{worst:.2} A where {max_current_a:.2} A are the most"));
        }
    }

    fn bus(&mut self, truth: &Truth, generates: bool) {
        let (beyond_v, longest_s) = PUMPED;
        let over_v = f64::from(self.control.guard.over_voltage_v);
        let pumped = !generates && !self.allowed.is_off && !self.allowed.is_driven && truth.bus_v > over_v + beyond_v;
        if let Some(worst) = self.pumped.look(pumped, truth.bus_v, self.step_s, longest_s) {
            self.say(Breach::Bus, truth, format!("a bus of {worst:.1} V where {over_v:.1} V are a fault"));
        }
    }

    fn motion(&mut self, truth: &Truth, current_a: f64, generates: bool) {
        let Control { current_full_scale_a, max_speed_rad_s, .. } = self.control;
        let flows = self.allowed.is_still && !generates && current_a > 0.005 * f64::from(current_full_scale_a);
        if let Some(worst) = self.driven.look(flows, current_a, self.step_s, STILL_S) {
            self.say(Breach::DrivenWhileOff, truth, format!("{worst:.2} A in a motor that is to be off"));
        }
        let (times, hertz, longest_s) = FAST;
        let most = times * f64::from(max_speed_rad_s) + TAU * hertz / self.pairs;
        let speed = truth.speed_rad_s.abs();
        let free = self.allowed.is_off || self.allowed.is_driven || self.allowed.is_lost;
        if let Some(worst) = self.fast.look(!free && speed > most, speed, self.step_s, longest_s) {
            self.say(Breach::Speed, truth, format!("{worst:.1} rad/s where {max_speed_rad_s:.1} rad/s are the most"));
        }
    }

    /// Something is wrong. Each kind once: the first is what led to the others.
    pub fn say(&mut self, breach: Breach, truth: &Truth, said: String) {
        self.say_at(breach, truth.time_s, said);
    }

    pub fn say_at(&mut self, breach: Breach, at_s: f64, said: String) {
        if self.verdicts.iter().all(|verdict| verdict.breach != breach) {
            self.verdicts.push(Verdict { breach, at_s: at_s - self.began_s, said });
        }
    }
}

/// Half an electrical turn, in mechanical turns.
pub(super) fn half_turn(pairs: f64) -> f64 {
    PI / pairs / TAU
}
