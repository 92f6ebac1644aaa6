//! What a recording waits for, and what of the time before it keeps.

use super::telemetry::Row;
use crate::units::{self, Units};
use hallservo::mode::Mode;
use hallservo_protocol::Telemetry;
use std::collections::VecDeque;
use std::str::FromStr;

/// What a recording waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Trigger {
    /// The bridge is on.
    Running,
    /// A fault.
    Fault,
    /// A quantity is above (or below) a value; without a unit, in the one that was chosen.
    Level(Quantity, bool, units::Quantity),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Quantity {
    Speed,
    Position,
    Current,
    Bus,
}

impl FromStr for Trigger {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "running" => return Ok(Self::Running),
            "fault" => return Ok(Self::Fault),
            _ => {}
        }
        let wrong = || {
            format!("running, fault, or speed, position, current or bus > or < a value, like speed>50, not {text:?}")
        };
        let at = text.find(['>', '<']).ok_or_else(wrong)?;
        let (name, value) = (text[..at].trim(), text[at + 1..].trim());
        let (quantity, level) = match name {
            "speed" => (Quantity::Speed, units::speed(value)?),
            "position" => (Quantity::Position, units::position(value)?),
            "current" => (Quantity::Current, units::plain(value).map_err(|_| wrong())?),
            "bus" => (Quantity::Bus, units::plain(value).map_err(|_| wrong())?),
            _ => return Err(wrong()),
        };
        Ok(Self::Level(quantity, text.as_bytes()[at] == b'>', level))
    }
}

impl Trigger {
    fn holds(self, frame: &Telemetry, units: Units) -> bool {
        match self {
            Self::Running => frame.mode == Mode::Running,
            Self::Fault => matches!(frame.mode, Mode::Faulted(_)),
            Self::Level(quantity, above, level) => {
                let (value, usual) = match quantity {
                    Quantity::Speed => (frame.speed_rad_s.into(), units.speed.rad_s()),
                    Quantity::Position => (frame.position_turns, units.position.turns()),
                    Quantity::Current => (frame.current_a[1].into(), 1.0),
                    Quantity::Bus => (f64::from(frame.bus_v), 1.0),
                };
                let level = level.value(usual);
                if above { value > level } else { value < level }
            }
        }
    }
}

/// Lets rows pass from the trigger on, and those of a time before it.
pub(super) struct Gate {
    trigger: Option<Trigger>,
    before_s: f64,
    units: Units,
    kept: VecDeque<Row>,
}

impl Gate {
    /// Without a trigger it is open.
    pub(super) const fn new(trigger: Option<Trigger>, before_s: f64, units: Units) -> Self {
        Self { trigger, before_s, units, kept: VecDeque::new() }
    }

    /// Whether it still waits.
    pub(super) const fn waits(&self) -> bool {
        self.trigger.is_some()
    }

    /// Rows that pass with this one.
    pub(super) fn pass(&mut self, row: Row) -> VecDeque<Row> {
        let Some(trigger) = self.trigger else { return VecDeque::from([row]) };
        let (fires, from_s) = (trigger.holds(&row.frame, self.units), row.time_s - self.before_s);
        self.kept.push_back(row);
        while self.kept.front().is_some_and(|row| row.time_s < from_s) {
            self.kept.pop_front();
        }
        if !fires {
            return VecDeque::new();
        }
        self.trigger = None;
        std::mem::take(&mut self.kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time_s: f64, speed_rad_s: f32) -> Row {
        Row { time_s, lost: 0, frame: Telemetry { speed_rad_s, ..Telemetry::default() } }
    }

    #[test]
    fn a_trigger_is_written_as_one_says_it() {
        assert_eq!("fault".parse(), Ok(Trigger::Fault));
        let level = |text: &str| match text.parse() {
            Ok(Trigger::Level(quantity, above, level)) => (quantity, above, level.value(1.0)),
            other => panic!("{text}: {other:?}"),
        };
        assert_eq!(level("speed > 60turns/s"), (Quantity::Speed, true, 60.0 * std::f64::consts::TAU));
        assert_eq!(level("current<-1.5A"), (Quantity::Current, false, -1.5));
        assert_eq!(level("bus>30 V"), (Quantity::Bus, true, 30.0));
        for text in ["", "speed", "speed>", "speed>fast", "torque>1", "bus>nan"] {
            assert!(text.parse::<Trigger>().is_err(), "{text}");
        }
    }

    #[test]
    fn what_was_before_the_trigger_passes_with_it() {
        let mut gate = Gate::new("speed>5".parse().ok(), 0.25, Units::default());
        let mut passed = Vec::new();
        for k in 0..10 {
            passed.extend(gate.pass(row(f64::from(k) * 0.1, k as f32)).into_iter().map(|row| row.frame.speed_rad_s));
        }
        // Fires at 6, which is at 0.6 s.
        assert_eq!(passed, [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        assert!(!gate.waits());
        assert_eq!(Gate::new(None, 1.0, Units::default()).pass(row(0.0, 0.0)).len(), 1);
    }
}
