//! Three half bridges on a bus: what a switching period's duties put on the motor's terminals.

use crate::error::{Error, finite, not_negative, positive, require};
use crate::windings::{Diodes, Terminal};

/// Command to one half bridge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Leg {
    /// Complementary switching, the high side on for this share of the period; 0 to 1, clipped.
    Pwm(f64),
    /// Both switches off.
    Open,
}

/// Command to the bridge for one switching period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Legs {
    /// The half bridges at phases A, B and C.
    pub legs: [Leg; 3],
    /// Main output enable: without it all switches go off at once, whatever the compare registers
    /// hold.
    pub enabled: bool,
}

impl Legs {
    /// All switches off, at once.
    pub const OFF: Self = Self { legs: [Leg::Open; 3], enabled: false };

    /// All three legs switching.
    #[must_use]
    pub const fn pwm(duties: [f64; 3]) -> Self {
        Self::new([Leg::Pwm(duties[0]), Leg::Pwm(duties[1]), Leg::Pwm(duties[2])])
    }

    /// An enabled bridge with these legs.
    #[must_use]
    pub const fn new(legs: [Leg; 3]) -> Self {
        Self { legs, enabled: true }
    }
}

/// How the inverter is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InverterModel {
    /// Terminal voltages averaged over the switching period.
    ///
    /// At the valley the mean current and the true current of a centre-aligned inverter agree, so
    /// samples taken there lack nothing. What is lost: the ripple, and that the terminal of a
    /// floating phase swings with the star point and may conduct for part of the period.
    Averaged {
        /// Steps in a period, 1 to 16.
        steps: u8,
    },
    /// Every edge at its instant, dead time and diodes included.
    Switched,
}

/// The bridge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverterParameters {
    /// Switching frequency, Hz; centre-aligned.
    pub pwm_hz: f64,
    /// Dead time at each edge, s; below a quarter of the period.
    pub dead_time_s: f64,
    /// Resistance of a switch that is on, Ω; diodes are given the same beside their drop.
    pub switch_ohm: f64,
    /// Forward voltage of a diode, V.
    pub diode_v: f64,
    /// How it is simulated.
    pub model: InverterModel,
}

impl InverterParameters {
    /// Without dead time and drops, averaged in one step.
    #[must_use]
    pub const fn ideal(pwm_hz: f64) -> Self {
        Self { pwm_hz, dead_time_s: 0.0, switch_ohm: 0.0, diode_v: 0.0, model: InverterModel::Averaged { steps: 1 } }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        positive(self.pwm_hz, "inverter.pwm_hz")?;
        not_negative(self.dead_time_s, "inverter.dead_time_s")?;
        require(
            self.dead_time_s * self.pwm_hz < 0.25,
            "inverter.dead_time_s",
            "below a quarter of the switching period",
        )?;
        not_negative(self.switch_ohm, "inverter.switch_ohm")?;
        not_negative(self.diode_v, "inverter.diode_v")?;
        if let InverterModel::Averaged { steps } = self.model {
            require((1..=16).contains(&steps), "inverter.model.steps", "1 to 16")?;
        }
        Ok(())
    }
}

/// The supply and its capacitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusParameters {
    /// Open-circuit voltage of the supply, V.
    pub supply_v: f64,
    /// Resistance of the supply and its wires, Ω.
    pub source_ohm: f64,
    /// Capacitance of the bus, F; with 0 the bus follows the current of the last step at once.
    pub capacitance_f: f64,
    /// Whether the supply takes current back, as a battery does; otherwise braking pumps the bus
    /// up. Without capacitance it has to.
    pub takes_back: bool,
}

impl BusParameters {
    /// Stiff.
    #[must_use]
    pub const fn ideal(supply_v: f64) -> Self {
        Self { supply_v, source_ohm: 0.0, capacitance_f: 0.0, takes_back: true }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        supply(self.supply_v)?;
        not_negative(self.source_ohm, "bus.source_ohm")?;
        not_negative(self.capacitance_f, "bus.capacitance_f")?;
        require(
            self.takes_back || (self.capacitance_f > 0.0 && self.source_ohm > 0.0),
            "bus.takes_back",
            "true where source_ohm or capacitance_f is zero",
        )
    }
}

fn supply(volts: f64) -> Result<(), Error> {
    finite(volts, "bus.supply_v")?;
    not_negative(volts, "bus.supply_v")
}

#[derive(Clone, Debug)]
pub(crate) struct Bus {
    parameters: BusParameters,
    pub volts: f64,
}

impl Bus {
    pub fn new(parameters: &BusParameters) -> Result<Self, Error> {
        parameters.check()?;
        Ok(Self { parameters: *parameters, volts: parameters.supply_v })
    }

    pub fn set_supply(&mut self, supply_v: f64) -> Result<(), Error> {
        supply(supply_v)?;
        self.parameters.supply_v = supply_v;
        if self.parameters.source_ohm == 0.0 {
            self.volts = supply_v;
        }
        Ok(())
    }

    /// Lets the bridge draw a current for a span.
    pub fn draw(&mut self, current_a: f64, span_s: f64) {
        let BusParameters { supply_v, source_ohm, capacitance_f, takes_back } = self.parameters;
        if source_ohm == 0.0 {
            return;
        }
        let settled_v = supply_v - source_ohm * current_a;
        if capacitance_f == 0.0 {
            self.volts = settled_v;
            return;
        }
        if !takes_back && self.volts > supply_v {
            self.volts -= current_a * span_s / capacitance_f;
            return;
        }
        // Implicit, so that a small capacitor cannot make it swing.
        let relative = span_s / (source_ohm * capacitance_f);
        self.volts = (self.volts + relative * settled_v) / (1.0 + relative);
    }
}

/// The averaged bridge during one period.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AveragedLegs {
    duty: [Option<f64>; 3],
    /// Half of the current ripple at each leg's edges, per volt of bus.
    ripple_per_v: [f64; 3],
}

/// The dead-time effect of an averaged bridge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeadTime {
    /// Share of the period that one dead time takes.
    share: f64,
    /// What a phase current falls by during the dead time, per volt of bus.
    fall_per_v: f64,
    /// Current ripple per volt of bus and share of a period.
    ripple_per_v: f64,
    diode_v: f64,
}

impl DeadTime {
    pub fn new(parameters: &InverterParameters, inductance_h: f64) -> Self {
        let period_s = 1.0 / parameters.pwm_hz;
        Self {
            share: parameters.dead_time_s / period_s,
            // Star of three: the one phase sees two thirds of its terminal's step.
            fall_per_v: parameters.dead_time_s * (2.0 / 3.0) / inductance_h,
            ripple_per_v: 0.5 * period_s / inductance_h,
            diode_v: parameters.diode_v,
        }
    }

    /// Mean change of a terminal's voltage.
    ///
    /// Each edge's switch-on comes a dead time late. At the rising edge a current into the motor
    /// keeps the terminal low meanwhile; at the falling edge a current out of it keeps it high.
    /// The current at an edge is the mean less or plus half the ripple, and where it is so small
    /// that it dies within the dead time, the terminal floats midway for the rest. So the loss runs
    /// over in two ramps, not in a jump.
    fn change_v(&self, current_a: f64, ripple_a: f64, bus_v: f64) -> f64 {
        let fall_a = self.fall_per_v * bus_v;
        let into = |edge_a: f64| {
            if edge_a >= fall_a {
                1.0
            } else if edge_a <= -fall_a {
                0.0
            } else {
                0.5 + 0.5 * edge_a / fall_a
            }
        };
        let lost = into(current_a - ripple_a) + into(current_a + ripple_a) - 1.0;
        -lost * self.share * (bus_v + 2.0 * self.diode_v)
    }
}

impl AveragedLegs {
    pub fn new(legs: &Legs, dead_time: &DeadTime) -> Self {
        let duty = legs.legs.map(|leg| match leg {
            Leg::Pwm(duty) if legs.enabled => Some(clipped(duty)),
            _ => None,
        });
        let ripple_per_v = if dead_time.share == 0.0 {
            [0.0; 3]
        } else {
            edge_ripple(&duty).map(|ripple| ripple * dead_time.ripple_per_v)
        };
        Self { duty, ripple_per_v }
    }

    /// Mean terminal voltages at these phase currents.
    pub fn terminals(&self, dead_time: &DeadTime, currents_a: &[f64; 3], bus_v: f64) -> [Terminal; 3] {
        let mut terminals = [Terminal::Open; 3];
        for phase in 0..3 {
            if let Some(duty) = self.duty[phase] {
                let mut volts = duty * bus_v;
                if dead_time.share != 0.0 && duty > 0.0 && duty < 1.0 {
                    let ripple_a = self.ripple_per_v[phase] * bus_v;
                    volts += dead_time.change_v(currents_a[phase], ripple_a, bus_v);
                    // A pulse shorter than the dead time vanishes; it does not turn round.
                    volts = volts.clamp(-dead_time.diode_v, bus_v + dead_time.diode_v);
                }
                terminals[phase] = Terminal::Driven(volts);
            }
        }
        terminals
    }

    /// Current that the switching legs draw from the bus.
    pub fn bus_a(&self, currents_a: &[f64; 3]) -> f64 {
        let mut sum = 0.0;
        for (duty, current) in self.duty.iter().zip(currents_a) {
            sum += duty.unwrap_or(0.0) * current;
        }
        sum
    }
}

/// Into 0 ..= 1; what is no number counts as 0.
pub(crate) fn clipped(duty: f64) -> f64 {
    if duty > 0.0 { if duty < 1.0 { duty } else { 1.0 } } else { 0.0 }
}

/// Half of the ripple between a leg's rising and falling edge, in units of V·T/(2L).
///
/// The phase voltage is even about the middle of the period, so the ripple is odd about it: what
/// the phase sees while its leg is high, less the mean, is the rise from edge to edge. Leg j is
/// high for min(d_j, d_k) of the time that leg k is.
fn edge_ripple(duty: &[Option<f64>; 3]) -> [f64; 3] {
    let mut ripple = [0.0; 3];
    let count = duty.iter().flatten().count() as f64;
    for (phase, value) in ripple.iter_mut().enumerate() {
        if let Some(own) = duty[phase] {
            let (mut overlap, mut sum) = (0.0, 0.0);
            for &other in duty.iter().flatten() {
                overlap += if other < own { other } else { own };
                sum += other;
            }
            *value = (own - overlap / count) - own * (own - sum / count);
        }
    }
    ripple
}

pub(crate) fn diodes(bus_v: f64, diode_v: f64) -> Diodes {
    Diodes { low_v: -diode_v, high_v: bus_v + diode_v }
}
