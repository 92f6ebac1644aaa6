//! What a scope sees of the drive after a step.

use super::{Drive, Output, Sample};
use crate::board::Legs;
use crate::mode::Mode;
use crate::schedule::OUTER;
use crate::scope::Channel;

impl Drive {
    /// The raw number of a channel, of the step that has just been. No division.
    #[inline(always)]
    pub(crate) fn look_at(&self, channel: Channel, sample: &Sample, output: &Output) -> i32 {
        let [a, b, c] = output.compare;
        let is_off = output.legs == Legs::NONE;
        let duty = |compare: u16| if is_off { 0 } else { i32::from(compare) };
        // What was asked for last stays there while the bridge is off.
        let reference = |current: i32| if is_off { 0 } else { current };
        let [hall_1, hall_2, hall_3] = sample.halls;
        match channel {
            // One place, as the three are inlined.
            Channel::PhaseA | Channel::PhaseB | Channel::PhaseC => self.phase(channel as usize, sample),
            Channel::CurrentD => self.servo.current().d,
            Channel::CurrentQ => self.servo.current().q,
            Channel::ReferenceD => reference(self.servo.reference.current.d),
            Channel::ReferenceQ => reference(self.servo.reference.current.q),
            Channel::VoltageD => self.voltages().0,
            Channel::VoltageQ => self.voltages().1,
            Channel::DutyA => duty(a),
            Channel::DutyB => duty(b),
            Channel::DutyC => duty(c),
            Channel::Angle => self.record.rotor.angle().to_bits(),
            Channel::Speed => self.record.rotor.speed(),
            Channel::SpeedReference => self.servo.speed_reference,
            Channel::Position => (self.record.rotor.position().to_bits() >> 16) as i32,
            Channel::PositionReference => (self.servo.trajectory.position().to_bits() >> (16 - OUTER.ilog2())) as i32,
            Channel::Bus => self.config.control.as_ref().map_or(0, |control| control.bus(sample.bus)),
            Channel::Hall1 => hall_1.into(),
            Channel::Hall2 => hall_2.into(),
            Channel::Hall3 => hall_3.into(),
        }
    }

    // Inlined, as all of the drive that is not goes to the memory without wait states.
    #[inline(always)]
    fn phase(&self, number: usize, sample: &Sample) -> i32 {
        let control = self.config.control.as_ref();
        control.map_or(0, |control| self.paths.idle.phases(control, sample).get(number).copied().unwrap_or(0))
    }

    #[inline(always)]
    fn voltages(&self) -> (i32, i32) {
        let control = self.config.control.as_ref();
        control.map_or((0, 0), |control| {
            let voltage = self.paths.field_oriented.voltage(control);
            (voltage.d, voltage.q)
        })
    }

    /// Whether a fault has switched it off.
    #[inline(always)]
    pub(crate) const fn is_faulted(&self) -> bool {
        matches!(self.mode, Mode::Faulted(_))
    }
}
