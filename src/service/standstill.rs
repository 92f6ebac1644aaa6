//! R and L at standstill, as a procedure: nothing has to be known of the motor but the current that it stands.
//!
//! Each phase in turn gets a current against the other two: in full, with a square wave on it, and half of it. The
//! difference of two levels gives R; what the dead time and the amplifiers' offsets contribute is the same in both and
//! cancels. The swing of the current from the square wave gives L: `Δ = 2 W/R tanh(R T / 2L)` for an amplitude W and a
//! time T from edge to edge. The rotor is pulled to the phase meanwhile, so L is that along the magnets' axis.
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
    /// Resistance of each, Ω.
    pub phases_ohm: [f32; 3],
    /// Voltage that the dead time took, V.
    pub dead_time_v: f32,
    /// Largest current that flowed steadily, A.
    pub current_a: f32,
    /// Bus voltage meanwhile, V.
    pub bus_v: f32,
}

impl fmt::Display for Electrical {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { resistance_ohm: r, inductance_h: l, phases_ohm: [a, b, c], current_a, dead_time_v, bus_v } = *self;
        writeln!(f, "  resistance  {:9.4} ± {:.4} Ω ({a:.4}, {b:.4}, {c:.4}) at {current_a:.2} A", r.value, r.error)?;
        writeln!(f, "  inductance  {:9.4} ± {:.4} mH", 1e3 * l.value, 1e3 * l.error)?;
        writeln!(f, "  dead time   {dead_time_v:9.4} V, of a bus of {bus_v:.1} V")
    }
}

/// Share of the largest current that flows in full.
const FULL: f32 = 0.5;
/// Swing that the square wave is made as large for, as a share of that current.
const SWING: f32 = 0.2;
/// Windows averaged at a level.
const AVERAGED: u8 = 4;
/// Windows until a level that does not become steady is taken as it is: 3 s at 40 kHz.
const LONGEST: u8 = 60;
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
    Ripple,
    Half,
}

/// Means over some windows, in SI.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    current_a: f32,
    voltage_v: f32,
    swing_a: f32,
    /// Half of the range of the windows' voltages.
    spread_v: f32,
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
    last_v: f32,
    bus_v: f32,
    of_full: Mean,
    resistance: [f32; 3],
    inductance: [f32; 3],
    uncertain: f32,
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
            probe: Probe { phase: 0, current: full, ripple: 0 },
            level: Level::Full,
            windows: 0,
            averaged: 0,
            sum: Mean::default(),
            range_v: [0.0; 2],
            last_v: 0.0,
            bus_v: 0.0,
            of_full: Mean::default(),
            resistance: [0.0; 3],
            inductance: [0.0; 3],
            uncertain: 0.0,
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
            _ if self.result.is_some() => 3.0,
            Level::Full => 0.0,
            Level::Half => 1.0,
            Level::Ripple => 2.0,
        };
        (3.0 * f32::from(self.probe.phase) + level) / 9.0
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
        // A period of the square wave has one swing up and one down.
        let swing_a = window.swing as f32 / per_ampere * (2 * HALF) as f32;
        let steady = (voltage_v - self.last_v).abs() <= STEADY_V + STEADY * voltage_v.abs();
        self.last_v = voltage_v;
        self.windows += 1;
        // The first one has the step from the level before in it.
        if self.windows == 1 || self.averaged == 0 && !steady && self.windows < LONGEST {
            return;
        }
        if self.averaged == 0 {
            self.range_v = [voltage_v; 2];
        }
        self.averaged += 1;
        let share = 1.0 / f32::from(AVERAGED);
        self.sum.current_a += share * current_a;
        self.sum.voltage_v += share * voltage_v;
        self.sum.swing_a += share * swing_a;
        self.range_v = [self.range_v[0].min(voltage_v), self.range_v[1].max(voltage_v)];
        // One is enough to choose the next amplitude of the square wave by.
        let small = self.level == Level::Ripple && swing_a < 0.5 * SWING * self.of_full.current_a;
        if small && !window.limited {
            let wanted = SWING * self.of_full.current_a / swing_a.max(0.05 * SWING * self.of_full.current_a);
            let ripple = (self.probe.ripple as f32 * wanted.min(8.0)) as i32;
            return self.go_on(self.level, self.probe.current, ripple.max(self.probe.ripple + 1));
        }
        if self.averaged == AVERAGED {
            let spread_v = 0.5 * (self.range_v[1] - self.range_v[0]);
            self.complete(Mean { spread_v, ..self.sum });
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
                let current = (0.8 * self.of_full.current_a * self.scale.per_ampere()) as i32;
                self.go_on(Level::Ripple, current, 1);
            }
            Level::Ripple => {
                let amplitude_v = self.probe.ripple as f32 / self.period * self.bus_v;
                let tanh = mean.swing_a * self.resistance[phase] / (2.0 * amplitude_v);
                if !(tanh > 0.0 && tanh < 0.95) {
                    return self.fail(Error::Inconclusive);
                }
                // atanh, within 1 % up to 0.75.
                let square = tanh * tanh;
                let atanh = tanh * (15.0 - 4.0 * square) / (15.0 - 9.0 * square);
                let time_s = HALF as f32 / self.scale.step_hz;
                self.inductance[phase] = self.resistance[phase] * time_s / (2.0 * atanh);
                if phase == 2 {
                    self.finish();
                } else {
                    self.probe.phase += 1;
                    self.go_on(Level::Full, self.full, 0);
                }
            }
        }
    }

    fn go_on(&mut self, level: Level, current: i32, ripple: i32) {
        self.level = level;
        self.probe = Probe { current, ripple, ..self.probe };
        (self.windows, self.averaged, self.sum) = (0, 0, Mean::default());
    }

    fn finish(&mut self) {
        let mean = |x: [f32; 3]| x.iter().sum::<f32>() / 3.0;
        let range = |x: [f32; 3]| {
            x.iter().fold(0.0_f32, |most, &x| most.max(x)) - x.iter().fold(f32::INFINITY, |least, &x| least.min(x))
        };
        let (resistance, inductance) = (mean(self.resistance), mean(self.inductance));
        if range(self.resistance) > UNEVEN * resistance {
            return self.fail(Error::Uneven);
        }
        let estimate = |value: f32, error: f32| Estimate { value, error };
        let uneven_ohm = range(self.resistance) / 3.0;
        let gains = VOLTS + AMPERES;
        self.result = Some(Ok(Electrical {
            resistance_ohm: estimate(resistance, self.uncertain + uneven_ohm + (0.005 + gains) * resistance),
            inductance_h: estimate(inductance, range(self.inductance) / 3.0 + (0.01 + gains) * inductance),
            phases_ohm: self.resistance,
            dead_time_v: self.dead_time_v,
            current_a: self.of_full.current_a,
            bus_v: self.bus_v,
        }));
    }
}

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
