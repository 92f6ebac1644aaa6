//! What may happen to a simulated drive, to see what it does about it. The language is that of the crate [`script`].

use anyhow::{Context as _, Result, anyhow, bail};
use hallservo::board::{LostPeriods, Sample, TemperatureCode};
use plant::heads::Defect;
use plant::{HallFault, Plant, Rail};
use script::{Event, HallWire};
use std::str::FromStr;

/// Supply of the Halls, V.
const SUPPLY_V: f64 = 3.3;

/// What happens, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct ScheduledEvent {
    /// What.
    pub kind: Kind,
    /// After so many seconds in the state running, all together.
    pub after_s: f64,
}

impl FromStr for ScheduledEvent {
    type Err = anyhow::Error;

    /// `hall-open@2s`.
    fn from_str(text: &str) -> Result<Self> {
        let step = script::timed(text).map_err(|what| anyhow!("{text:?}: {what}"))?;
        Ok(Self { kind: Kind::of(&step.event).with_context(|| format!("{text:?}"))?, after_s: step.at_s })
    }
}

/// What a simulated drive can be done to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A Hall's wire, 0 to 2.
    Hall(usize, HallWire),
    /// Something breaks of the rings; `None`: they are as good as at power-up.
    Rings(Option<Defect>),
    /// The supply, V.
    Bus(f64),
    /// Torque against the shaft, N·m.
    Load(f64),
    /// A hand turns the shaft by so many turns.
    Turn(f64),
    /// The bridge's thermistor reads 150 °C, from now on.
    Hot,
    /// A control period is lost each time, from now on.
    Late,
    /// Everything is as at power-up.
    Mend,
}

impl Kind {
    /// Of an event.
    ///
    /// # Errors
    /// What a simulated drive has not.
    pub fn of(event: &Event) -> Result<Self> {
        Ok(match event {
            Event::Hall(hall, wire) => Self::Hall(*hall, *wire),
            Event::Rings(defect) => Self::Rings(*defect),
            Event::Bus(volts) => Self::Bus(*volts),
            Event::Load(torque) => Self::Load(*torque),
            Event::Turn(turns) => Self::Turn(*turns),
            Event::Hot => Self::Hot,
            Event::Late => Self::Late,
            Event::Mend => Self::Mend,
            _ => bail!("a simulated drive can do: hall, head, ring, rings, bus, load, turn, hot, late, mend"),
        })
    }

    /// What is done to the motor; the others are done to each sample.
    pub(crate) fn act(self, plant: &mut Plant) -> Result<()> {
        match self {
            Self::Hall(hall, wire) => {
                let level_v = plant.hall_volts()[hall];
                plant.set_hall_fault(hall, hall_fault(wire, level_v));
            }
            Self::Bus(volts) => plant.set_supply(volts)?,
            Self::Load(torque) => plant.set_load(torque)?,
            Self::Rings(_) | Self::Turn(_) | Self::Hot | Self::Late | Self::Mend => {}
        }
        Ok(())
    }

    /// What is done to a sample.
    pub(crate) fn disturb(self, sample: &mut Sample) {
        match self {
            Self::Hot => sample.temperatures[0] = TemperatureCode::new(150),
            Self::Late => sample.lost = LostPeriods::counted(1),
            Self::Hall(..) | Self::Rings(_) | Self::Bus(_) | Self::Load(_) | Self::Turn(_) | Self::Mend => {}
        }
    }
}

fn hall_fault(wire: HallWire, level_v: f64) -> Option<HallFault> {
    Some(match wire {
        HallWire::Good => return None,
        HallWire::Open => HallFault::Open(Rail::High),
        HallWire::Ground => HallFault::StuckAt(0.0),
        HallWire::Supply => HallFault::StuckAt(SUPPLY_V),
        HallWire::Stuck => HallFault::StuckAt(level_v),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_simulated_drive_cannot_do_is_refused() {
        for (text, named) in [
            ("power-cycle@1s", "a simulated drive can do: hall, head, ring, rings, bus, load, turn, hot, late, mend"),
            ("hall-wet@1s", "a Hall is good, open, ground, supply or stuck, not \"wet\""),
            ("hot@-1s", "a time is like 0.5s, 20ms or 300us, not \"-1s\""),
            ("bus-nanV@1s", "expected a number with V, found \"nanV\""),
            ("hot", "an event and its time are like hall-open@2s, not \"hot\""),
        ] {
            let error = format!("{:#}", text.parse::<ScheduledEvent>().unwrap_err());
            assert!(error.contains(named) && error.contains(text), "{text}: {error}");
        }
        let planned: ScheduledEvent = "hall-open@40s".parse().unwrap();
        assert_eq!(planned, ScheduledEvent { kind: Kind::Hall(0, HallWire::Open), after_s: 40.0 });
    }
}
