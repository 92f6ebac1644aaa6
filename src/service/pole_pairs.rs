//! The number of pole pairs, measured: electrical turns by the Halls over turns of the shaft that a person or an
//! encoder counts.
//!
//! The Halls, the currents and the voltages of a motor repeat with the electrical turn; how many of these make a turn
//! of the shaft is in none of them. It takes a person who turns the shaft ([`ByHand`]) or an absolute encoder
//! ([`ByEncoder`]). What differs from magnet to magnet repeats after a turn of the shaft, too, but also after half of
//! one or a third, and would tell no more than a divisor.

use super::Event;
use crate::angle::{MechanicalAngle, PolePairs, Position};
use crate::mode::Mode;
use core::fmt;

/// What was counted.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Count {
    /// The number.
    pub pole_pairs: PolePairs,
    /// How far the motion was from whole electrical turns of that many pole pairs, degrees of the shaft.
    pub off_deg: f32,
    /// How far it was from those of the next best number.
    pub next_off_deg: f32,
}

/// Why there is no number.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error {
    /// The drive is not ready with its bridge off, or lost the angle: from calibration to the last turn, it must not be
    /// touched.
    NotReady,
    /// The shaft has turned by less than half an electrical turn for each turn that it was to.
    NotTurned,
    /// More than [`PolePairs::MAX`], or the shaft was turned more often than said.
    TooMany,
    /// Two numbers explain the motion.
    Ambiguous {
        /// The better one.
        likely: PolePairs,
        /// Turns of the shaft that would tell.
        turns_needed: u8,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotReady => {
                write!(f, "the drive must be calibrated, its bridge off and the angle known all the time")
            }
            Self::NotTurned => write!(f, "the shaft was hardly turned"),
            Self::TooMany => {
                write!(f, "more than {} pole pairs: was the shaft turned more often than told?", PolePairs::MAX)
            }
            Self::Ambiguous { likely, turns_needed } => {
                write!(f, "not told apart, perhaps {}: turn the shaft by {turns_needed} turns", likely.get())
            }
        }
    }
}

impl core::error::Error for Error {}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} pole pairs: the shaft was {:.1}° off, and would have been {:.0}° off with the next number",
            self.pole_pairs.get(),
            self.off_deg,
            self.next_off_deg
        )
    }
}

/// Farthest that a person ends from whole turns, degrees of the shaft.
const BY_EYE_DEG: f32 = 10.0;

impl Count {
    /// From the electrical turns in so many turns of the shaft by hand, at least one, in either direction; as sure as
    /// [`ByHand`] says.
    ///
    /// # Errors
    /// All of [`Error`] but that the drive is not ready.
    fn of(electrical_turns: f64, turns: u8) -> Result<Self, Error> {
        let (electrical, shaft) = (electrical_turns.abs() as f32, f32::from(turns.max(1)));
        let likely = match libm::roundf(electrical / shaft) as u8 {
            0 => return Err(Error::NotTurned),
            number => PolePairs::new(number).ok_or(Error::TooMany)?,
        };
        let off_deg = |pairs: f32| 360.0 * (electrical / pairs - shaft).abs();
        let pairs = f32::from(likely.get());
        let fewer = if pairs > 1.0 { off_deg(pairs - 1.0) } else { f32::INFINITY };
        let next_off_deg = fewer.min(off_deg(pairs + 1.0));
        let off_deg = off_deg(pairs);
        if off_deg <= BY_EYE_DEG && next_off_deg >= 2.0 * BY_EYE_DEG {
            return Ok(Self { pole_pairs: likely, off_deg, next_off_deg });
        }
        // Where one more pole pair would be twice as far off as a person may be, and more than was not enough.
        let needed = crate::float::ceil(2.0 * BY_EYE_DEG / 360.0 * (pairs + 1.0)) as u8;
        Err(Error::Ambiguous { likely, turns_needed: needed.max(turns.saturating_add(1)) })
    }
}

/// Counts while a person turns the shaft by whole turns with the bridge off, in either direction, as fast or slow and
/// with as many rests as they like. A number is told only where another one would put the end more than 20° off: one
/// whose turns end within 19° of whole ones never gets a wrong one.
#[derive(Clone, Copy, Debug)]
pub struct ByHand {
    turns: u8,
    /// The first and the last position; none when the drive was not ready in between.
    ends: Option<Result<(Position, Position), Error>>,
}

impl ByHand {
    /// For whole turns of the shaft, at least one: the more, the surer. Ended within 3°, one tells up to fourteen pole
    /// pairs and five tell all.
    pub const fn new(turns: u8) -> Self {
        Self { turns: if turns == 0 { 1 } else { turns }, ends: None }
    }

    /// Takes an event of the service, from before the shaft is turned to after it.
    pub fn event(&mut self, event: &Event) {
        if let Event::Record(record) = event {
            let known = record.status.mode() == Mode::Ready && record.missed == 0;
            self.observe(known.then(|| record.rotor.position()));
        }
    }

    /// Takes the rotor's position, from before the shaft is turned to after it; `None` when the drive was not ready or
    /// did not know it.
    pub fn observe(&mut self, position: Option<Position>) {
        self.ends = Some(match (self.ends, position) {
            (Some(Err(error)), _) => Err(error),
            (_, None) => Err(Error::NotReady),
            (None, Some(here)) => Ok((here, here)),
            (Some(Ok((first, _))), Some(here)) => Ok((first, here)),
        });
    }

    /// Electrical turns so far.
    ///
    /// # Errors
    /// [`Error::NotReady`]: the drive was not ready in between, or has not been observed yet.
    pub fn electrical_turns(&self) -> Result<f64, Error> {
        let (first, last) = self.ends.unwrap_or(Err(Error::NotReady))?;
        Ok(Position::from_bits(last.to_bits().wrapping_sub(first.to_bits())).to_turns())
    }

    /// The number, when the person says that the turns are made.
    ///
    /// # Errors
    /// [`Error`].
    pub fn finish(&self) -> Result<Count, Error> {
        self.finish_after(self.turns)
    }

    /// The same where the person says only now how many turns were made.
    ///
    /// # Errors
    /// [`Error`].
    pub fn finish_after(&self, turns: u8) -> Result<Count, Error> {
        Count::of(self.electrical_turns()?, turns)
    }
}

/// Counts while the shaft turns, under power or not, with an absolute encoder on it.
#[derive(Clone, Copy, Debug, Default)]
pub struct ByEncoder {
    last: Option<(MechanicalAngle, Position)>,
    /// Mechanical and electrical way, in bits.
    ways: [i64; 2],
}

/// What was counted with an encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EncoderCount {
    /// The number.
    pub pole_pairs: PolePairs,
    /// Whether the encoder counts against the Halls.
    pub opposite: bool,
}

impl ByEncoder {
    /// Takes the encoder's angle and the Halls' position of the same instant, as
    /// [`Absolute`](crate::drive::absolute::Absolute) has them; less than half a turn of the shaft after the last.
    pub const fn push(&mut self, angle: MechanicalAngle, halls: Position) {
        if let Some((last_angle, last_halls)) = self.last {
            self.ways[0] += angle.to_bits().wrapping_sub(last_angle.to_bits()) as i64;
            self.ways[1] = self.ways[1].wrapping_add(halls.to_bits().wrapping_sub(last_halls.to_bits()));
        }
        self.last = Some((angle, halls));
    }

    /// The number; `None` until the shaft has turned by half a turn, and where Halls and encoder do not go together:
    /// off whole numbers by a tenth.
    pub fn count(&self) -> Option<EncoderCount> {
        let [mechanical, electrical] = self.ways;
        if mechanical.unsigned_abs() < 1 << 31 {
            return None;
        }
        let ratio = electrical as f64 / mechanical as f64;
        let number = libm::round(ratio.abs());
        let pole_pairs = PolePairs::new(number as u8)?;
        ((ratio.abs() - number).abs() <= 0.1).then_some(EncoderCount { pole_pairs, opposite: ratio < 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_hand(turns: u8, electrical: f64) -> ByHand {
        let end = Position::from_bits((electrical * 4_294_967_296.0) as i64);
        ByHand { ends: Some(Ok((Position::from_bits(0), end))), ..ByHand::new(turns) }
    }

    #[test]
    fn never_a_wrong_number_within_19_degrees() {
        for pairs in 1..=64_u8 {
            for turns in 1..=5 {
                for off_deg in -19..=19 {
                    let shaft = f64::from(turns) + f64::from(off_deg) / 360.0;
                    match by_hand(turns, -shaft * f64::from(pairs)).finish() {
                        Ok(count) => assert_eq!(count.pole_pairs.get(), pairs, "{turns} {off_deg} {count}"),
                        Err(Error::Ambiguous { turns_needed, .. }) => assert!(turns_needed > turns),
                        // At 64, a little more is more.
                        Err(Error::TooMany) => assert!(pairs > 50 && off_deg > 0),
                        Err(error) => panic!("{pairs} {turns} {off_deg}: {error}"),
                    }
                    // Well turned, it is told: up to 14 by one turn, all by five.
                    if i32::abs(off_deg) <= 3 && (pairs <= 14 || turns >= 5) {
                        assert!(by_hand(turns, shaft * f64::from(pairs)).finish().is_ok(), "{pairs} {turns} {off_deg}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_no_number_is_named() {
        assert_eq!(ByHand::new(1).finish(), Err(Error::NotReady));
        assert_eq!(by_hand(3, 1.0).finish(), Err(Error::NotTurned));
        assert_eq!(by_hand(1, 80.0).finish(), Err(Error::TooMany));
        assert_eq!(by_hand(1, 300.0).finish(), Err(Error::TooMany));
    }

    #[test]
    fn an_encoder_tells_from_half_a_turn_on() {
        for pairs in 1..=64_i64 {
            for sign in [1, -1] {
                let mut count = ByEncoder::default();
                for k in 0..=100_i64 {
                    let shaft = k * 43_000_000;
                    // The Halls are off by 3° electrical to and fro.
                    let error = if k % 2 == 0 { 35_791_394 } else { -35_791_394 };
                    count.push(
                        MechanicalAngle::from_bits(shaft as i32),
                        Position::from_bits(sign * pairs * shaft + error),
                    );
                    assert_eq!(count.count().is_some(), k >= 50, "{pairs} {k}");
                }
                let expected = EncoderCount { pole_pairs: PolePairs::new(pairs as u8).unwrap(), opposite: sign < 0 };
                assert_eq!(count.count(), Some(expected));
            }
        }
        // A coupling that slips.
        let mut slipping = ByEncoder::default();
        for k in 0..200_i64 {
            slipping.push(MechanicalAngle::from_bits((k * 40_000_000) as i32), Position::from_bits(k * 180_000_000));
        }
        assert_eq!(slipping.count(), None);
    }
}
