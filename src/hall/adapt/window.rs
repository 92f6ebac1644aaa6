//! The mean of three samples, each sensor in its turn.

use crate::hall::Codes;

/// The latest samples, a sample period apart, that have not been used for every sensor.
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
    /// The samples so far are used up.
    pub fn clear(&mut self) {
        self.filled = 0;
    }

    /// Takes a sample, so many periods after the last; returns the sensor whose turn it is and, if there are two
    /// samples just before, the mean code of the three. Without a gap the next two samples are those of the other
    /// sensors, so that every sample of every sensor is used once.
    #[inline]
    pub fn push(&mut self, codes: &Codes, elapsed: u16) -> (usize, Option<f32>) {
        let sensor = usize::from(self.sensor);
        self.sensor = if sensor >= 2 { 0 } else { self.sensor + 1 };
        let sensor = sensor.min(2);
        let [oldest, middle] = self.codes;
        self.codes = [middle, *codes];
        if elapsed != 1 {
            self.filled = 0;
        }
        if self.filled < 2 {
            self.filled += 1;
            return (sensor, None);
        }
        let sum = u32::from(oldest[sensor]) + u32::from(middle[sensor]) + u32::from(codes[sensor]);
        (sensor, Some(sum as f32 * (1.0 / 3.0)))
    }
}
