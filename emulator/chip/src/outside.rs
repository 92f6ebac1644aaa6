//! The side of whoever looks on: what a script does to board and motor, and what was seen.

use crate::can::Fdcan;
use crate::chip::Chip;
use crate::disturbance::Disturbance;
use crate::facts::{Facts, Trace};
use bus::{Cycle, ResetCause};

impl Chip {
    /// Does to the board or the motor what a script asks.
    ///
    /// # Errors
    /// What the board has not.
    pub fn disturb(&mut self, disturbance: &Disturbance, now: Cycle) -> Result<(), String> {
        self.sync(now);
        self.due = 0;
        let now_s = self.now_s(now);
        self.motor.advance(now_s);
        let in_range = |index: usize| if index < 3 { Ok(index) } else { Err(format!("there is no number {index}")) };
        match disturbance {
            Disturbance::Hall(wire, fault) => self.motor.set_hall_fault(in_range(*wire)?, *fault),
            Disturbance::SwapHalls(a, b) => self.motor.swap_halls(in_range(*a)?, in_range(*b)?),
            Disturbance::Bus(volts) => self.motor.plant.set_supply(*volts).map_err(|error| error.to_string())?,
            Disturbance::Overcurrent(phase, amperes) => self.motor.shorts_a[in_range(*phase)?] = *amperes,
            Disturbance::BreakPin(level) => self.set_break_pin(*level, now)?,
            Disturbance::Enable(_) if self.board.enable.is_none() => {
                return Err(format!("{} has no enable input", self.board.name));
            }
            Disturbance::Enable(closed) => self.enable_open = !closed,
            Disturbance::Load(torque) => self.motor.plant.set_load(*torque).map_err(|error| error.to_string())?,
            Disturbance::Serial(bytes) => {
                let port = self.serial_port(1).ok_or("no serial port is connected to the RX pin")?;
                self.usarts[port].receive(bytes, now);
                return Ok(());
            }
            Disturbance::PowerCut(operations) => self.flash.cut_power_after(*operations),
            Disturbance::Hold(angle) => self.motor.hold(*angle).map_err(|error| error.to_string())?,
            Disturbance::Encoder(defect) => {
                let encoder = self.motor.encoder.as_mut().ok_or("there are no rings on the shaft")?;
                match defect {
                    Some(defect) => encoder.suffer(*defect),
                    None => encoder.mend(),
                }
            }
            Disturbance::PowerCycle => self.wanted_reset = Some(ResetCause::PowerOn),
        }
        self.record.events.push((now_s, format!("{disturbance:?}")));
        self.compare(now);
        Ok(())
    }

    fn set_break_pin(&mut self, level: Option<bool>, now: Cycle) -> Result<(), String> {
        let Some((pin, _)) = self.board.trip else {
            return Err(format!("{} has no break pin; its comparators watch the shunts", self.board.name));
        };
        let before = self.level(pin, now);
        self.break_pin = level;
        let (after, line) = (self.level(pin, now), u32::from(pin.number));
        if after != before && self.syscfg.port(line) == pin.port {
            self.exti.edge(line, after == Some(true));
        }
        Ok(())
    }

    /// The last trigger whose end of sequence raised an interrupt line: line and cycle of the trigger.
    pub fn last_sampling(&self) -> Option<(u16, Cycle)> {
        self.last_sampling
    }

    /// Its CAN, to be put on a [`Wire`](crate::can::wire::Wire) with others. It has been brought to a time of all nodes
    /// by running it until then.
    pub fn can(&mut self) -> &mut Fdcan {
        self.due = 0;
        &mut self.can
    }

    /// Bytes that the firmware sent over its serial port since the last call.
    pub fn take_serial(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.sent)
    }

    /// What was seen at the pins so far.
    pub fn facts(&self) -> Facts {
        self.report()
    }

    /// Traces recorded since the last call.
    pub fn take_trace(&mut self) -> Trace {
        self.record.take_trace()
    }
}
