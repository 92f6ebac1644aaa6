//! A sample against those before it, which the paper lacks: a wrong reading is reported, never followed.
//!
//! Every sample is decoded on its own, so the table says which pole pair it is; the angle it gives must lie where the
//! last ones put it. That single comparison holds the table's pole pair against the one carried along, and the fine
//! angle against the speed. What it lets pass is at most half the margin off, and errors of one ring alone that grow
//! slower show in the residual before they are as large as the margin.
//!
//! After a doubtful sample the encoder holds the last speed for a few samples; one of them that is sound and lies
//! where it should ends the doubt. Later than that a stuck head may have come round to a place where it fits, so the
//! encoder searches: it believes again when it has followed the shaft over a pole pair of both rings without
//! contradiction. No stuck, weak or exchanged head passes that, but it needs motion. At standstill only the user can
//! decide to start anew, with a new [`State`].
//!
//! The first sample after power-up has no past. It is returned at once if it is sound in itself, and so are the next,
//! but [`State::is_proven`] tells that they rest on the residual alone until the shaft has moved a pole pair.

use super::decode::Decoded;
use super::rings::{Ring, Rings};
use crate::angle::MechanicalAngle;
use core::fmt;

/// Why a sample gives no angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Fault {
    /// The rings contradict each other: the residual is near the margin or beyond.
    Residual,
    /// The heads of this ring contradict each other.
    HeadsApart(Ring),
    /// The rings agree on another pole pair than the one carried along.
    PolePair,
    /// The angle is not where the last ones put it.
    Jump,
    /// The sample could not be read.
    Unread,
    /// Nothing is wrong with this sample, but the position was lost and is not proven yet.
    Searching,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Residual => "the two rings contradict each other",
            Self::HeadsApart(Ring::Reference) => "the heads of the reference ring contradict each other",
            Self::HeadsApart(Ring::Vernier) => "the heads of the vernier ring contradict each other",
            Self::PolePair => "the rings give another pole pair than the one carried along",
            Self::Jump => "the angle jumped further than the shaft can turn",
            Self::Unread => "the heads could not be read",
            Self::Searching => "the position was lost and is not proven again yet",
        })
    }
}

impl core::error::Error for Fault {}

/// Limits of the shaft's motion between two samples, in 2⁻³² turns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// The largest step.
    pub step: u32,
    /// How far an angle may be from where the last two put it.
    pub innovation: u32,
    /// Samples for which the last speed is taken to hold: within them not even the largest steps make half a pole
    /// pair of either ring, so that a stuck head cannot have come round to where it fits.
    pub hold: u32,
    /// The travel that proves that no head is stuck: a pole pair of the coarser ring.
    pub proof: i64,
    /// Pole pairs of the reference ring.
    pub reference_pairs: i32,
}

impl Limits {
    /// For steps between samples above zero and up to `largest_step`. The error is the largest that the rings allow.
    pub fn new(rings: &Rings, largest_step: MechanicalAngle) -> Result<Self, MechanicalAngle> {
        let p = u32::from(rings.pole_pairs(Ring::Reference));
        let q = u32::from(rings.pole_pairs(Ring::Vernier));
        // A turn has one bit too many for the type; the last does not matter here.
        let turn = u32::MAX;
        let largest = turn / p.max(q) / 4;
        let step = largest_step.to_bits();
        if step <= 0 || step as u32 > largest {
            return Err(MechanicalAngle::from_bits(largest as i32));
        }
        Ok(Self {
            step: step as u32,
            // A quarter of the margin, and what two codes' rounding adds.
            innovation: turn / (8 * p * q) + ((turn / p) >> rings.bits()) * 2,
            hold: turn / p.max(q) / 2 / step as u32,
            proof: i64::from(turn / p.min(q)),
            reference_pairs: p as i32,
        })
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    /// Nothing is known.
    #[default]
    Start,
    /// Angle and perhaps speed are known but not proven by travel; `lost` tells whether they are withheld.
    Proving { lost: bool, has_speed: bool },
    /// All is well.
    Tracking,
    /// The last `missed` samples were not accepted; the last speed is taken to hold.
    Holding { missed: u32 },
    /// Position lost, no sample to start from yet.
    Searching,
}

/// What an encoder remembers from sample to sample, 32 bytes; `default` is the state at power-up.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    angle: MechanicalAngle,
    /// Speed, 2⁻³² turns a sample.
    speed: MechanicalAngle,
    /// Largest innovation that is accepted without further checks, 2⁻³² turns; 0 unless tracking.
    window: u32,
    mode: Mode,
    /// Travel while proving, 2⁻³² turns.
    travel: i64,
}

/// The share of the innovation by which the speed follows, as a power of two.
const SPEED_SHIFT: u32 = 2;

impl State {
    /// Whether the position has been proven by motion and not lost since. Before that an angle that is returned
    /// rests on the residual alone, and a head that is stuck from power-up can make it wrong.
    pub fn is_proven(&self) -> bool {
        matches!(self.mode, Mode::Tracking | Mode::Holding { .. })
    }

    /// Takes an angle if it lies where it should while all is well, and tells whether it did.
    #[inline(always)]
    pub(super) fn follow(&mut self, angle: MechanicalAngle) -> bool {
        let innovation = angle - (self.angle + self.speed);
        // As `within`, but nothing is within 0.
        let expected = (innovation.to_bits() as u32).wrapping_add(self.window) < 2 * self.window;
        if expected {
            self.advance(angle, innovation);
        }
        expected
    }

    /// Everything else: a sample that [`Self::follow`] has not taken, with what is wrong with it by itself.
    pub(super) fn doubt(
        &mut self,
        limits: &Limits,
        decoded: Decoded,
        reference: u16,
        contradiction: Option<Fault>,
    ) -> Result<Decoded, Fault> {
        let fault = contradiction.or_else(|| self.inconsistency(limits, decoded.angle, reference));
        match fault {
            Some(fault) => {
                self.miss(limits);
                // A sound sample is as good a place as any to search from.
                if contradiction.is_none() && self.mode == Mode::Searching {
                    self.begin(decoded.angle, true);
                }
                Err(fault)
            }
            None => self.believe(limits, decoded),
        }
    }

    /// Lets one sample pass without an angle.
    pub(super) fn miss(&mut self, limits: &Limits) {
        self.window = 0;
        self.angle += self.speed;
        self.mode = match self.mode {
            Mode::Start => Mode::Start,
            Mode::Tracking if limits.hold > 0 => Mode::Holding { missed: 1 },
            Mode::Holding { missed } if missed < limits.hold => Mode::Holding { missed: missed + 1 },
            _ => Mode::Searching,
        };
    }

    /// What is wrong with a sample when held against the past.
    fn inconsistency(&self, limits: &Limits, angle: MechanicalAngle, reference: u16) -> Option<Fault> {
        let window = match self.mode {
            Mode::Start | Mode::Searching => return None,
            Mode::Proving { has_speed: false, .. } => limits.step,
            // A wrong sample that was just let pass must not make the right ones after it fail for good.
            Mode::Holding { .. } => 2 * limits.innovation,
            _ => limits.innovation,
        };
        let expected = self.angle + self.speed;
        if (angle - expected).to_bits().unsigned_abs() < window {
            return None;
        }
        // The reference ring by itself may well be where it should.
        let expected_reading = (expected.to_bits().wrapping_mul(limits.reference_pairs) >> 16) as u16;
        let step = reference.wrapping_sub(expected_reading) as i16;
        // Both in 2⁻³² pole pairs: nothing in the control interrupt divides by what the compiler does not know.
        let fits = (i64::from(step.unsigned_abs()) << 16) < i64::from(window) * i64::from(limits.reference_pairs);
        Some(if fits { Fault::PolePair } else { Fault::Jump })
    }

    /// A sample with nothing against it.
    fn believe(&mut self, limits: &Limits, decoded: Decoded) -> Result<Decoded, Fault> {
        let step = decoded.angle - self.angle;
        let innovation = step - self.speed;
        match self.mode {
            Mode::Start => self.begin(decoded.angle, false),
            Mode::Searching => self.begin(decoded.angle, true),
            Mode::Tracking | Mode::Holding { .. } => {
                self.advance(decoded.angle, innovation);
                self.track(limits);
            }
            Mode::Proving { lost, has_speed } => {
                self.mode = Mode::Proving { lost, has_speed: true };
                if has_speed {
                    self.advance(decoded.angle, innovation);
                } else {
                    (self.angle, self.speed) = (decoded.angle, step);
                }
                self.travel += i64::from(step.to_bits());
                if self.travel.abs() >= limits.proof {
                    self.track(limits);
                }
            }
        }
        if let Mode::Proving { lost: true, .. } = self.mode { Err(Fault::Searching) } else { Ok(decoded) }
    }

    #[inline(always)]
    fn advance(&mut self, angle: MechanicalAngle, innovation: MechanicalAngle) {
        self.angle = angle;
        self.speed += MechanicalAngle::from_bits(innovation.to_bits() >> SPEED_SHIFT);
    }

    fn begin(&mut self, angle: MechanicalAngle, lost: bool) {
        self.angle = angle;
        self.speed = MechanicalAngle::ZERO;
        self.travel = 0;
        self.mode = Mode::Proving { lost, has_speed: false };
    }

    fn track(&mut self, limits: &Limits) {
        self.mode = Mode::Tracking;
        self.window = limits.innovation;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn while_the_last_speed_holds_no_steps_make_half_a_pole_pair() {
        let rings = Rings::new(37, 45, 12).unwrap();
        for degrees in [0.01, 0.1, 0.5, 1.0, 1.9] {
            let limits = Limits::new(&rings, MechanicalAngle::from_degrees(degrees)).unwrap();
            let turned = f64::from(degrees) * f64::from(limits.hold);
            let half = 360.0 / 45.0 / 2.0;
            assert!(turned < half + 1e-5 && turned > half - 1.01 * f64::from(degrees), "{degrees}: {turned}");
        }
        assert!(Limits::new(&rings, MechanicalAngle::from_degrees(2.01)).is_err());
    }
}
