//! Three half bridges on a bus: what a switching period's duties put on the motor's terminals.

use crate::error::{Error, not_negative, positive, require};
use crate::windings::Diodes;

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

    /// What a timer makes of its compare values, in counts of `period`: legs that are not connected are open, and
    /// without any the bridge is off.
    #[must_use]
    pub fn timer(compare: [u16; 3], period: u16, connected: [bool; 3]) -> Self {
        if connected == [false; 3] {
            return Self::OFF;
        }
        let duty = |k: usize| Leg::Pwm(f64::from(compare[k]) / f64::from(period));
        Self::new([0, 1, 2].map(|k| if connected[k] { duty(k) } else { Leg::Open }))
    }
}

/// How the inverter is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InverterModel {
    /// Terminal voltages averaged over the switching period.
    ///
    /// At the valley the mean current and the true current of a centre-aligned inverter agree, so
    /// samples taken there lack nothing. The dead time acts by the sign of each current, with the
    /// ripple taken into account. What is lost: the ripple itself; that the terminal of a floating
    /// phase swings with the star point and may conduct for part of the period; and that a bridge
    /// without currents passes nothing until its duties differ by the dead time.
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

/// Into 0 ..= 1; what is no number counts as 0.
pub(crate) fn clipped(duty: f64) -> f64 {
    if duty > 0.0 { if duty < 1.0 { duty } else { 1.0 } } else { 0.0 }
}

pub(crate) fn diodes(bus_v: f64, diode_v: f64) -> Diodes {
    Diodes { low_v: -diode_v, high_v: bus_v + diode_v }
}
