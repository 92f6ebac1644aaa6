//! R and L at standstill, as a procedure: nothing has to be known of the motor but the current that it stands.
//!
//! Each phase in turn gets a current against the other two: in full, half of it, and with a square wave on it. The
//! difference of two levels gives R; what the dead time and the amplifiers' offsets contribute is the same in both and
//! cancels. The swing of the current from the square wave gives L: `Δ = 2 W/R tanh(R T / 2L)` for an amplitude W and a
//! time T from edge to edge.
//!
//! The rotor is pulled to the phase meanwhile, but cogging and friction hold it beside that. So the wave is along the phase,
//! then across it, between the other two, and the swing along it is measured, then the one across: a symmetric matrix, whose
//! axes are the magnets' whatever the rotor's angle, and whose two swings are those of the inductances along and across
//! them.
//!
//! Ends with the bridge off. In the tasks; f32.

use super::identify::{AMPERES, Estimate, VOLTS};
use super::procedure::{Error, Procedure, State};
use super::{Event, Service};
use crate::config::Config;
use crate::control::Scale;
use crate::drive::Command;
use crate::drive::standstill::{HALF, Probe, WINDOW, Window};
use crate::mode::Mode;
use crate::telemetry::Measurement;
use core::fmt;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Electrical {
    /// Resistance of a phase and what is in series, Ω: the mean of the three.
    pub resistance_ohm: Estimate,
    /// Inductance of a phase along the magnets' axis, H: the mean of the three.
    pub inductance_h: Estimate,
    /// Inductance across the magnets' axis over the one along it.
    pub saliency: Estimate,
    /// Resistance of each, Ω.
    pub phases_ohm: [f32; 3],
    /// Voltage that the dead time took, V.
    pub dead_time_v: f32,
    /// Largest current that flowed steadily, A.
    pub current_a: f32,
    /// Bus voltage meanwhile, V.
    pub bus_v: f32,
}

impl Electrical {
    /// The saliency as it is to be set: 1 where it is not known to be another.
    pub fn known_saliency(&self) -> f32 {
        let Estimate { value, error } = self.saliency;
        if (value - 1.0).abs() > error { value.clamp(0.25, 8.0) } else { 1.0 }
    }
}

impl fmt::Display for Electrical {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { resistance_ohm: r, inductance_h: l, saliency, phases_ohm: [a, b, c], .. } = *self;
        let Self { current_a, dead_time_v, bus_v, .. } = *self;
        writeln!(f, "  resistance  {:9.4} ± {:.4} Ω ({a:.4}, {b:.4}, {c:.4}) at {current_a:.2} A", r.value, r.error)?;
        writeln!(f, "  inductance  {:9.4} ± {:.4} mH along the magnets' field", 1e3 * l.value, 1e3 * l.error)?;
        writeln!(f, "  saliency    {:9.4} ± {:.4}, Lq/Ld", saliency.value, saliency.error)?;
        writeln!(f, "  dead time   {dead_time_v:9.4} V, of a bus of {bus_v:.1} V")
    }
}

/// Share of the largest current that flows in full.
const FULL: f32 = 0.5;
/// Swing that the square wave is made as large for, as a share of that current.
const SWING: f32 = 0.2;
/// Windows averaged at a level; with a wave on it, of which there are three, fewer, as the current heats the winding.
const AVERAGED: u8 = 4;
const WITH_WAVE: u8 = 3;
/// Windows until a level that does not become steady is taken as it is: 3 s at 40 kHz.
const LONGEST: u8 = 60;
const ROOT_3: f32 = 1.732_050_8;
/// Spread of the swing of a wave, as a share of it, that is not waited for, and windows until a larger one is taken as it
/// is: at a motor of a small current it is noise. Beyond the last, it is a rotor that swings.
const STEADY_SWING: f32 = 0.02;
const LONGEST_WAVE: u8 = 16;
const SWINGS: f32 = 0.03;
/// Spread of a steady level's voltage, as a share of it, of which no longer a mean is taken.
const STEADY_MEAN: f32 = 0.01;
/// Share of what the wave's voltage drives in the end from which on the current counts as settled before the next edge: then
/// the inductance is told to be what would just do so, ± all of it. L/R of a quarter of the time from edge to edge.
const SETTLES: f32 = 0.95;
/// Share by which the resistance may be off then.
const SETTLED: f32 = 0.12;
/// Current that shows that there is a winding, as a share of the full one.
const ANSWERS: f32 = 0.04;
/// Phases whose resistances differ by more are not alike.
const UNEVEN: f32 = 0.25;
/// Time from one repetition of the command to the next, and longest wait for a window, ms.
const REPEAT_MS: u32 = 50;
const ANSWER_MS: u32 = 400;

/// A level of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Full,
    Half,
    /// A wave along the phase, and its swing; both across; the wave across and the swing along.
    Along,
    Across,
    Between,
}

/// Means over some windows, in SI.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    current_a: f32,
    voltage_v: f32,
    swing_a: f32,
    /// Half of the range of the windows' voltages, and of their swings.
    spread_v: f32,
    spread_a: f32,
}

/// Chooses what to measure, and makes ohms and henries of it; without any input or output of its own.
#[derive(Clone, Debug)]
pub struct Evaluation {
    scale: Scale,
    period: f32,
    full: i32,
    probe: Probe,
    level: Level,
    /// Windows of this level so far, and those averaged.
    windows: u8,
    averaged: u8,
    sum: Mean,
    range_v: [f32; 2],
    range_a: [f32; 2],
    last_v: f32,
    bus_v: f32,
    of_full: Mean,
    /// Swings of this phase, of a volt of the wave.
    swings: [f32; 2],
    resistance: [f32; 3],
    inductance: [f32; 3],
    saliency: [f32; 3],
    uncertain: f32,
    /// Largest share by which a swing was unsteady.
    unsteady: f32,
    /// By how many times more than a swing and a resistance an inductance is off, at most.
    steepness: f32,
    dead_time_v: f32,
    result: Option<Result<Electrical, Error>>,
}

impl Evaluation {
    /// For a drive.
    ///
    /// # Errors
    /// [`Error::NoControl`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let full = ((FULL * control.max_current as f32) as i32).max(1);
        Ok(Self {
            scale: control.scale,
            period: config.period.into(),
            full,
            probe: Probe { current: full, ..Probe::default() },
            level: Level::Full,
            windows: 0,
            averaged: 0,
            sum: Mean::default(),
            range_v: [0.0; 2],
            range_a: [0.0; 2],
            last_v: 0.0,
            bus_v: 0.0,
            of_full: Mean::default(),
            swings: [0.0; 2],
            resistance: [0.0; 3],
            inductance: [0.0; 3],
            saliency: [0.0; 3],
            uncertain: 0.0,
            unsteady: 0.0,
            steepness: 1.0,
            dead_time_v: 0.0,
            result: None,
        })
    }

    /// What is to be measured now.
    pub const fn probe(&self) -> Probe {
        self.probe
    }

    /// What was found, or why nothing, from the end on.
    pub const fn result(&self) -> Option<&Result<Electrical, Error>> {
        self.result.as_ref()
    }

    fn fail(&mut self, error: Error) {
        self.result = Some(Err(error));
    }

    /// 0 to 1.
    pub fn progress(&self) -> f32 {
        let level = match self.level {
            _ if self.result.is_some() => 5.0,
            Level::Full => 0.0,
            Level::Half => 1.0,
            Level::Along => 2.0,
            Level::Across => 3.0,
            Level::Between => 4.0,
        };
        (5.0 * f32::from(self.probe.phase) + level) / 15.0
    }

    /// Takes what flowed in a window.
    pub fn window(&mut self, window: &Window) {
        if window.probe != self.probe || self.result.is_some() {
            return;
        }
        let count = WINDOW as f32;
        let per_ampere = 3.0 * count * self.scale.per_ampere();
        self.bus_v = window.bus as f32 / count / 32_768.0 * self.scale.volts;
        let voltage_v = window.voltage as f32 / (3.0 * count) / self.period * self.bus_v;
        let current_a = window.current as f32 / per_ampere;
        // A period of the square wave has one swing up and one down. The difference of two phases' currents is √3 times the
        // current across the third.
        let times = if window.probe.swings_across { ROOT_3 } else { 1.0 };
        let swing_a = times * window.swing as f32 / per_ampere * (2 * HALF) as f32;
        let steady = (voltage_v - self.last_v).abs() <= STEADY_V + STEADY * voltage_v.abs();
        self.last_v = voltage_v;
        self.windows += 1;
        // The first one has the step from the level before in it.
        if self.windows == 1 || self.averaged == 0 && !steady && self.windows < LONGEST {
            return;
        }
        if self.averaged == 0 {
            (self.range_v, self.range_a) = ([voltage_v; 2], [swing_a; 2]);
        }
        self.averaged += 1;
        let averaged = if self.probe.ripple > 0 { WITH_WAVE } else { AVERAGED };
        let share = 1.0 / f32::from(averaged);
        self.sum.current_a += share * current_a;
        self.sum.voltage_v += share * voltage_v;
        self.sum.swing_a += share * swing_a;
        self.range_v = [self.range_v[0].min(voltage_v), self.range_v[1].max(voltage_v)];
        self.range_a = [self.range_a[0].min(swing_a), self.range_a[1].max(swing_a)];
        // One is enough to choose the next amplitude of the square wave by.
        let small =
            matches!(self.level, Level::Along | Level::Across) && swing_a < 0.5 * SWING * self.of_full.current_a;
        if small && !window.limited {
            let wanted = SWING * self.of_full.current_a / swing_a.max(0.05 * SWING * self.of_full.current_a);
            let ripple = (self.probe.ripple as f32 * wanted.min(8.0)) as i32;
            return self.go_on(self.level, self.probe.current, ripple.max(self.probe.ripple + 1));
        }
        if self.averaged >= averaged {
            let [spread_v, spread_a] = [self.range_v, self.range_a].map(|[least, most]| 0.5 * (most - least));
            let waved = self.probe.ripple > 0;
            // A rotor that swings about the field induces a voltage whose mean is zero in the long run, for the flux that it
            // moves through the phase is limited; the swing of a wave is waited for.
            let unsteady = spread_a / (self.of_full.current_a * SWING);
            let longest = if waved && unsteady <= SWINGS { LONGEST_WAVE } else { LONGEST };
            let is_steady = if waved { unsteady <= STEADY_SWING } else { spread_v <= STEADY_MEAN * voltage_v.abs() };
            if is_steady || self.windows >= longest {
                // Of a mean of many, the swing that is not over is a small part.
                let share = f32::from(averaged) / f32::from(self.averaged);
                let Mean { current_a, voltage_v, swing_a, .. } = self.sum;
                let [current_a, voltage_v, swing_a] = [current_a, voltage_v, swing_a].map(|sum| share * sum);
                let spread_v = spread_v * (2.0 * share).min(1.0);
                self.complete(Mean { current_a, voltage_v, swing_a, spread_v, spread_a });
            } else if waved {
                (self.averaged, self.sum) = (0, Mean::default());
            }
        }
    }

    /// A level has been measured.
    fn complete(&mut self, mean: Mean) {
        let phase = usize::from(self.probe.phase);
        let full_a = self.full as f32 / self.scale.per_ampere();
        let flows = (mean.current_a * self.scale.per_ampere()) as i32;
        match self.level {
            Level::Full if mean.current_a < ANSWERS * full_a => {
                self.fail(Error::NoCurrent { phase: self.probe.phase });
            }
            Level::Full => {
                self.of_full = mean;
                self.go_on(Level::Half, flows / 2, 0);
            }
            Level::Half => {
                let apart = self.of_full.current_a - mean.current_a;
                let resistance = (self.of_full.voltage_v - mean.voltage_v) / apart;
                if !(apart > 0.1 * self.of_full.current_a && resistance > 0.0) {
                    return self.fail(Error::Inconclusive);
                }
                self.resistance[phase] = resistance;
                self.uncertain += (self.of_full.spread_v + mean.spread_v) / apart / 3.0;
                self.dead_time_v = self.of_full.voltage_v - resistance * self.of_full.current_a;
                // Room for the square wave, should the voltage be at its limit.
                let current = (0.75 * self.of_full.current_a * self.scale.per_ampere()) as i32;
                self.go_on(Level::Along, current, 1);
            }
            Level::Along | Level::Across | Level::Between => self.complete_swing(mean),
        }
    }

    /// The swing of a square wave has been measured; after the last one of a phase, what they say.
    fn complete_swing(&mut self, mean: Mean) {
        let phase = usize::from(self.probe.phase);
        let times = if self.probe.across { 2.0 / ROOT_3 } else { 1.0 };
        let amplitude_v = times * self.probe.ripple as f32 / self.period * self.bus_v;
        let swing = mean.swing_a / amplitude_v;
        self.unsteady = self.unsteady.max(mean.spread_a / mean.swing_a.abs().max(SWING * self.of_full.current_a));
        let Probe { current, ripple, .. } = self.probe;
        match self.level {
            Level::Along => {
                self.swings[0] = swing;
                return self.go_on(Level::Across, current, ripple);
            }
            Level::Across => {
                self.swings[1] = swing;
                return self.go_on(Level::Between, current, ripple);
            }
            _ => {}
        }
        let [along, across] = self.swings;
        let (middle, half) = (0.5 * (along + across), 0.5 * (along - across));
        let apart = crate::float::root(half * half + swing * swing);
        // The rotor is nearer to the phase than to what is across.
        let apart = if half < 0.0 { -apart } else { apart };
        let [along_d, along_q] = [middle + apart, middle - apart].map(|swing| self.inductance_of(swing, phase));
        let Some(along_d) = along_d else { return self.fail(Error::Inconclusive) };
        // No rotor makes one direction so unlike the other, but an amplifier that shows nothing does.
        let Some(along_q) = along_q else { return self.fail(Error::Uneven) };
        self.inductance[phase] = along_d;
        self.saliency[phase] = along_q / along_d;
        if phase == 2 {
            self.finish();
        } else {
            self.probe.phase += 1;
            self.go_on(Level::Full, self.full, 0);
        }
    }

    /// The inductance of a swing in amperes, of a volt of the wave; of a current that settles before the next edge the largest
    /// that it may be.
    fn inductance_of(&mut self, swing: f32, phase: usize) -> Option<f32> {
        let tanh = swing * self.resistance[phase] / 2.0;
        let settles = tanh >= SETTLES;
        let tanh = tanh.min(SETTLES);
        // atanh, within 0.2 % up to 0.8, and 4 % too small at 0.95.
        let square = tanh * tanh;
        let atanh = tanh * (945.0 - square * (735.0 - 64.0 * square)) / (945.0 - square * (1050.0 - 225.0 * square));
        let times = if settles { f32::INFINITY } else { tanh / (atanh * (1.0 - square)) };
        self.steepness = self.steepness.max(times);
        let time_s = HALF as f32 / self.scale.step_hz;
        (tanh > 0.0).then_some(self.resistance[phase] * time_s / (2.0 * atanh))
    }

    fn go_on(&mut self, level: Level, current: i32, ripple: i32) {
        self.level = level;
        let across = matches!(level, Level::Across | Level::Between);
        self.probe = Probe { current, ripple, across, swings_across: level == Level::Across, ..self.probe };
        (self.windows, self.averaged, self.sum) = (0, 0, Mean::default());
    }

    fn finish(&mut self) {
        let mean = |x: [f32; 3]| x.iter().sum::<f32>() / 3.0;
        let range = |x: [f32; 3]| {
            x.iter().fold(0.0_f32, |most, &x| most.max(x)) - x.iter().fold(f32::INFINITY, |least, &x| least.min(x))
        };
        let [resistance, inductance, saliency] = [self.resistance, self.inductance, self.saliency].map(mean);
        if range(self.resistance) > UNEVEN * resistance {
            return self.fail(Error::Uneven);
        }
        let estimate = |value: f32, error: f32| Estimate { value, error };
        let uneven_ohm = range(self.resistance) / 3.0;
        // The ripple of such a current passes through zero, and the dead time takes less of the smaller level.
        let settled = if self.steepness.is_finite() { 0.0 } else { SETTLED };
        let gains = VOLTS + AMPERES;
        let off = |share: f32| (share * self.steepness).min(1.0);
        self.result = Some(Ok(Electrical {
            resistance_ohm: estimate(resistance, self.uncertain + uneven_ohm + (0.005 + gains + settled) * resistance),
            inductance_h: estimate(inductance, range(self.inductance) / 3.0 + inductance * off(0.01 + gains)),
            saliency: estimate(saliency, range(self.saliency) / 3.0 + saliency * off(UNLIKE + 0.5 * self.unsteady)),
            phases_ohm: self.resistance,
            dead_time_v: self.dead_time_v,
            current_a: self.of_full.current_a,
            bus_v: self.bus_v,
        }));
    }
}

/// Share by which the inductances of two directions look unlike: iron saturates more along the current that holds the
/// rotor than across it, by 7 % where it saturates at twice the largest current. With less current, the wave would take
/// phases through zero, where the dead time has a say.
const UNLIKE: f32 = 0.08;
/// Change of the voltage from window to window of a steady level: of it, and at least.
const STEADY: f32 = 0.01;
const STEADY_V: f32 = 0.02;

/// The measurement as a procedure.
#[derive(Clone, Debug)]
pub struct Standstill {
    evaluation: Evaluation,
    failure: Option<Error>,
    mode: Option<Mode>,
    /// Whether the drive was told to begin, whether it has, and whether it is to end.
    told: bool,
    begun: bool,
    ending: bool,
    disarmed: bool,
    /// What was sent last, and when; when the last window came.
    sent: Option<(Probe, u32)>,
    window_ms: Option<u32>,
}

impl Standstill {
    /// To be begun by the first step, with the bridge off and the rotor at rest.
    ///
    /// # Errors
    /// [`Error::NoControl`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        Ok(Self {
            evaluation: Evaluation::new(config)?,
            failure: None,
            mode: None,
            told: false,
            begun: false,
            ending: false,
            disarmed: false,
            sent: None,
            window_ms: None,
        })
    }

    /// What was found, from the end on.
    pub const fn report(&self) -> Option<&Electrical> {
        match self.evaluation.result() {
            Some(Ok(electrical)) => Some(electrical),
            _ => None,
        }
    }

    fn end(&mut self, failure: Option<Error>) {
        if !self.ending {
            self.failure = failure;
            self.ending = true;
        }
    }

    fn state(&self) -> State {
        self.failure.map_or(State::Done, State::Failed)
    }

    /// What the drive has done by itself.
    fn check(&mut self, now_ms: u32) {
        match self.mode {
            Some(Mode::Aligning) => self.begun = true,
            Some(Mode::Faulted(fault)) if self.begun => self.end(Some(Error::Fault(fault))),
            Some(_) if self.begun => self.end(Some(Error::Disarmed)),
            _ => {}
        }
        if self.window_ms.is_some_and(|window_ms| now_ms.wrapping_sub(window_ms) > ANSWER_MS) {
            self.end(Some(Error::NoAnswer));
        }
    }

    fn send(&mut self, service: &mut Service, now_ms: u32) {
        let probe = self.evaluation.probe();
        let due = self.sent.is_none_or(|(sent, ms)| sent != probe || now_ms.wrapping_sub(ms) >= REPEAT_MS);
        if due && service.send_for_procedure(Command::Measure { begins: !self.told, probe }).is_ok() {
            self.told = true;
            self.sent = Some((probe, now_ms));
        }
    }
}

impl Procedure for Standstill {
    fn event(&mut self, event: &Event) {
        if let Event::Record(record) = event {
            self.mode = Some(record.status.mode());
        }
    }

    fn measurement(&mut self, _: &Measurement) {}

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        self.window_ms.get_or_insert(now_ms);
        while let Some(window) = service.window() {
            self.window_ms = Some(now_ms);
            self.evaluation.window(&window);
        }
        // A drive that has left the state by itself refuses, too; its record says why.
        if let Some(Err(refusal)) = service.procedure_answer()
            && !self.begun
        {
            self.end(Some(Error::Refused(refusal)));
        }
        if let Some(result) = self.evaluation.result() {
            let failure = result.err();
            self.end(failure);
        }
        if !self.ending {
            self.check(now_ms);
        }
        if !self.ending {
            self.send(service, now_ms);
            return State::Running;
        }
        // What refused to begin goes on as it was.
        if matches!(self.failure, Some(Error::Refused(_))) {
            return self.state();
        }
        self.disarmed = self.disarmed || service.send_internal(Command::Disarm).is_ok();
        let drives = self.mode.is_some_and(Mode::drives) && self.failure != Some(Error::NoAnswer);
        if drives || !self.disarmed { State::Running } else { self.state() }
    }

    fn cancel(&mut self) {
        self.end(Some(Error::Cancelled));
    }

    fn progress(&self) -> f32 {
        self.evaluation.progress()
    }
}
