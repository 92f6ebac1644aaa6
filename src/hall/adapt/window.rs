//! The mean of three samples, each sensor in its turn.

use crate::hall::Codes;

/// The latest samples, a sample period apart, that may be worked in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Window {
    /// The one before last, and the last.
    codes: [Codes; 2],
    /// How many of them there are.
    filled: u8,
    /// The sensor whose turn it is.
    sensor: u8,
}

impl Window {
    /// No sample so far may be worked in: they have been already, or there was one missing.
    pub fn clear(&mut self) {
        self.filled = 0;
    }

    /// Takes a sample. With the two before it makes the mean code of the sensor whose turn it is; the next two samples are those of
    /// the others, so every sample of every sensor is used once.
    #[inline(always)]
    pub fn push(&mut self, codes: &Codes) -> Option<(usize, f32)> {
        let [oldest, middle] = self.codes;
        self.codes = [middle, *codes];
        if self.filled < 2 {
            self.filled += 1;
            return None;
        }
        let sensor = usize::from(self.sensor);
        self.sensor = if sensor == 2 { 0 } else { self.sensor + 1 };
        let sensor = sensor.min(2);
        let sum = u32::from(oldest[sensor]) + u32::from(middle[sensor]) + u32::from(codes[sensor]);
        Some((sensor, sum as f32 * (1.0 / 3.0)))
    }
}
