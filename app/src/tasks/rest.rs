//! The wait for the rotor to come to rest after a procedure, so that the next request finds it where it stays.

use super::Tasks;
use crate::encoder::Encoder;
use embedded_storage::nor_flash::NorFlash;
use hallservo::angle::Position;
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Record};

/// At rest is a rotor that stays within 10 electrical degrees for 200 ms: slower than 0.14 electrical turns a second.
/// Twice as far as the noise of a bad Hall (1 % of its swing) moves the angle, which the tracker's speed is too noisy
/// for.
const STILL: u64 = (1 << 32) * 10 / 360;
const STILL_MS: u64 = 200;
/// Longest wait: a heavy rotor with little friction, or one that a hand turns, may not come to rest.
const LONGEST_MS: u64 = 5000;

/// A rotor that was turned.
pub(super) struct Rest {
    /// The procedure that has turned it; it is reported as running until the wait is over.
    pub after: Activity,
    since_ms: u64,
    /// Position that it has stayed near, and since when, ms.
    still: Option<(Position, u64)>,
}

impl Rest {
    pub fn after(activity: Activity, now_ms: u64) -> Self {
        Self { after: activity, since_ms: now_ms, still: None }
    }

    /// Whether the wait is over, with the rotor at this place; `None` as long as there is more to wait for.
    fn is_over(&mut self, place: Option<Position>, now_ms: u64) -> bool {
        let rests = match (place, self.still) {
            (Some(place), Some((near, since_ms)))
                if place.to_bits().wrapping_sub(near.to_bits()).unsigned_abs() <= STILL =>
            {
                now_ms >= since_ms + STILL_MS
            }
            _ => {
                self.still = place.map(|place| (place, now_ms));
                false
            }
        };
        rests || now_ms >= self.since_ms + LONGEST_MS
    }
}

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Ends the wait once the rotor is at rest and the result is in use and in the flash, or at a fault.
    pub(super) fn come_to_rest(&mut self) {
        let place = self.is_settled().then(|| self.record.rotor.position());
        let faulted = matches!(self.mode(), Mode::Faulted(_));
        if self.rest.as_mut().is_some_and(|rest| faulted || rest.is_over(place, self.now_ms)) {
            self.rest = None;
        }
    }

    /// Whether the drive uses the results and the flash holds them.
    fn is_settled(&self) -> bool {
        let stores = self.unsaved[Record::Sensors as usize] || self.unsaved[Record::Cogging as usize];
        self.mode() == Mode::Ready
            && self.sent_settings.is_none()
            && !self.install_due
            && !self.table_due
            && !stores
            && self.encoder.is_settled()
            && self.magnets.is_settled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Milliseconds that are waited for a rotor at this place, electrical turns, after so many milliseconds.
    fn waited_ms(turns: impl Fn(u64) -> Option<f64>) -> u64 {
        let mut rest = Rest::after(Activity::Calibration, 1000);
        let place = |ms| turns(ms).map(|turns| Position::from_bits((turns * 4_294_967_296.0) as i64));
        (0..).find(|&ms| rest.is_over(place(ms), 1000 + ms)).unwrap()
    }

    #[test]
    fn it_takes_a_rotor_that_stays_where_it_is() {
        assert_eq!(waited_ms(|_| Some(-7.3)), 200);
        // With noise.
        assert_eq!(waited_ms(|ms| Some(if ms % 2 == 0 { 0.0 } else { 0.02 })), 200);
        // Once it is there, and the result is.
        assert_eq!(waited_ms(|ms| Some(ms.min(300) as f64)), 500);
        assert_eq!(waited_ms(|ms| (ms >= 300).then_some(1.0)), 500);
        // Slower and faster than the limit.
        assert_eq!(waited_ms(|ms| Some(0.13e-3 * ms as f64)), 200);
        assert_eq!(waited_ms(|ms| Some(0.15e-3 * ms as f64)), 5000);
    }

    #[test]
    fn it_ends_without_one() {
        assert_eq!(waited_ms(|_| None), 5000);
        // To and fro, by a hand.
        assert_eq!(waited_ms(|ms| Some((ms as f64 * 0.01).sin())), 5000);
    }
}
