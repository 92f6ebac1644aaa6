//! What speaks against a sensor: contradictions of the other two, and codes at the end of the ADC's range.

use crate::hall::Channel;

/// Turns of suspicion that an accepted turn takes back.
const DECAY: f32 = 0.25;

/// What speaks against one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Suspicion {
    /// Electrical turns for which the sensor has contradicted the other two, less what was taken back.
    pub turns: f32,
    /// Samples in which it has.
    pub times: u32,
    /// Samples in a row at the end of the ADC's range.
    pub at_rail: u32,
}

impl Suspicion {
    /// Whether anything speaks against the sensor.
    pub fn exists(&self) -> bool {
        self.turns > 0.0 || self.at_rail > 0
    }

    /// Turns in which the sensor agrees take suspicion back.
    pub fn decay(&mut self, turns: f32) {
        self.turns -= DECAY * turns;
        if self.turns <= 0.0 {
            (self.turns, self.times) = (0.0, 0);
        }
    }
}

/// What speaks against the three sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Suspicions {
    /// Of each sensor.
    pub sensors: [Suspicion; 3],
    /// Whether any of what follows, or of the above, is not zero: then a sample is looked at with all three sensors.
    pub any: bool,
    /// Samples in a row that nothing explains.
    pub rejected: u32,
    /// Times that angle and speed were acquired anew since a turn was understood.
    pub reacquisitions: u32,
    /// Times that all parameters were reset since then.
    pub restarts: u32,
    /// The sensor that the filter works without: it was lost, or there are only two.
    pub lost: Option<Channel>,
}

impl Suspicions {
    /// Sensors under suspicion.
    pub fn suspected(&self) -> [bool; 3] {
        self.sensors.map(|suspicion| suspicion.turns > 0.0)
    }

    /// Nothing speaks against any sensor of those that there are.
    pub fn without(lost: Option<Channel>) -> Self {
        Self { lost, ..Self::default() }
    }

    /// A turn was understood: nothing speaks against any sensor.
    pub fn clear(&mut self) {
        *self = Self::without(self.lost);
    }

    /// Whether the filter works without this sensor.
    #[inline]
    pub fn is_lost(&self, sensor: usize) -> bool {
        self.lost == Some(Channel(sensor as u8))
    }
}
