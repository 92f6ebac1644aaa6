//! What the compare channels make of the count (RM0440, 28.3.9 to 28.3.12), and what they trigger.

use super::{Edge, Happened, Timer};
use bus::Cycle;

/// The reference OCxREF in output compare mode `mode` (OCxM).
///
/// In centre-aligned PWM the reference of mode 1 is on while the count is below the compare value on the way up, and
/// not above it on the way down: as many counts on either side of the peak.
fn reference(mode: u32, count: u32, down: bool, compare: u32, old: bool) -> bool {
    let pwm = if down { count <= compare } else { count < compare };
    match mode {
        1 if count == compare => true,
        2 if count == compare => false,
        3 if count == compare => !old,
        4 => false,
        5 => true,
        6 => pwm,
        7 => !pwm,
        _ => old,
    }
}

/// Whether [`reference`] has a model of the mode.
pub fn modelled(mode: u32) -> bool {
    mode < 8
}

impl Timer {
    /// Flags of the channels whose value is reached; in centre-aligned mode 1 on the way down, 2 up, 3 both (28.6.1).
    pub(super) fn compare(&mut self, happened: &mut Happened) {
        let counts = match self.cr1 >> 5 & 3 {
            1 => self.down || self.count == 0,
            2 => !self.down || self.count == self.arr_acts,
            _ => true,
        };
        if !counts {
            return;
        }
        for channel in 0..self.shape.channels {
            if self.ccr_acts[channel] == self.count && self.is_output(channel) {
                self.sr |= if channel < 4 { 2 << channel } else { 1 << (12 + channel) };
                if channel == 0 {
                    if self.cr2 >> 4 & 7 == 3 {
                        happened.trgo = Edge::Pulse;
                    }
                    if self.cr2 >> 20 & 0xf == 3 {
                        happened.trgo2 = Edge::Pulse;
                    }
                }
            }
        }
    }

    fn is_output(&self, channel: usize) -> bool {
        channel >= 4 || self.ccmr_acts[channel / 2] >> (8 * (channel % 2)) & 3 == 0
    }

    /// Output compare mode (OCxM) of a channel.
    fn mode(&self, channel: usize) -> u32 {
        let half = self.ccmr_acts[channel / 2] >> (8 * (channel % 2));
        half >> 4 & 7 | half >> 13 & 8
    }

    /// References from what the counter holds now, and what their edges trigger.
    pub(super) fn refresh_references(&mut self, now: Cycle, happened: &mut Happened) {
        let old = self.references;
        for channel in 0..self.shape.channels {
            let down = self.down && self.centred() || self.cr1 & 0x70 == 0x10;
            self.references[channel] =
                reference(self.mode(channel), self.count, down, self.ccr_acts[channel], old[channel]);
        }
        if self.references == old {
            return;
        }
        let edge = |channel: usize| match (old[channel], self.references[channel]) {
            (false, true) => Edge::Rising,
            (true, false) => Edge::Falling,
            _ => Edge::None,
        };
        if let mode @ 4..=7 = self.cr2 >> 4 & 7 {
            happened.trgo = edge(mode as usize - 4);
        }
        happened.trgo2 = trigger_2(self.cr2 >> 20 & 0xf, edge).unwrap_or(happened.trgo2);
        if self.shape.advanced {
            self.outputs.set_references([self.references[0], self.references[1], self.references[2]], now);
            happened.outputs = true;
        }
    }
}

/// Edges of TRGO2 that come from references (28.6.2, MMS2).
fn trigger_2(mode: u32, edge: impl Fn(usize) -> Edge) -> Option<Edge> {
    let pulse = |is: bool| Some(if is { Edge::Pulse } else { Edge::None });
    match mode {
        4..=9 => Some(edge(mode as usize - 4)),
        10 => pulse(edge(3) != Edge::None),
        11 => pulse(edge(5) != Edge::None),
        12 => pulse(edge(3) == Edge::Rising || edge(5) == Edge::Rising),
        13 => pulse(edge(3) == Edge::Rising || edge(5) == Edge::Falling),
        14 => pulse(edge(4) == Edge::Rising || edge(5) == Edge::Rising),
        15 => pulse(edge(4) == Edge::Rising || edge(5) == Edge::Falling),
        _ => None,
    }
}
