//! Faults of a simulated drive, to see what it does about them.

use anyhow::{Context, Result, bail};
use hallservo::board::{LostPeriods, Sample, TemperatureCode};
use plant::{HallFault, Plant, Rail};
use std::str::FromStr;

/// What breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The wire of Hall 0.
    HallOpen,
    /// Hall 1 stays where it is.
    HallStuck,
    /// The bus.
    OverVoltage,
    /// The bridge's thermistor reads 150 °C.
    Hot,
    /// A control period is lost.
    Late,
}

const NAMES: [(&str, Kind); 5] = [
    ("hall-open", Kind::HallOpen),
    ("hall-stuck", Kind::HallStuck),
    ("over-voltage", Kind::OverVoltage),
    ("hot", Kind::Hot),
    ("late", Kind::Late),
];

/// What breaks, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// What.
    pub kind: Kind,
    /// After so many seconds in the state running, all together.
    pub after_s: f64,
}

impl FromStr for Planned {
    type Err = anyhow::Error;

    /// `hall-open@2s`.
    fn from_str(text: &str) -> Result<Self> {
        let (name, time) = text.split_once('@').context("a fault and its time, as in hall-open@2s")?;
        let Some((_, kind)) = NAMES.iter().find(|(known, _)| *known == name) else {
            bail!("no fault {name}: {}", NAMES.map(|(name, _)| name).join(", "));
        };
        let after_s = time.strip_suffix('s').unwrap_or(time).parse().context("the time, as in 2s")?;
        Ok(Self { kind: *kind, after_s })
    }
}

impl Kind {
    /// True for one that breaks a Hall, and has.
    pub(crate) fn break_hall(self, plant: &mut Plant) -> bool {
        match self {
            Self::HallOpen => plant.set_hall_fault(0, Some(HallFault::Open(Rail::High))),
            Self::HallStuck => plant.set_hall_fault(1, Some(HallFault::StuckAt(1.65))),
            Self::OverVoltage | Self::Hot | Self::Late => return false,
        }
        true
    }

    /// What the others do to a sample.
    pub(crate) fn disturb(self, sample: &mut Sample) {
        match self {
            Self::OverVoltage => sample.bus = 4095,
            Self::Hot => sample.temperatures[0] = TemperatureCode::new(150),
            Self::Late => sample.lost = LostPeriods::counted(1),
            Self::HallOpen | Self::HallStuck => {}
        }
    }
}
