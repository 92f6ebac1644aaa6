//! Impedance control: a spring and a damper at the shaft,
//!
//! torque = kp · (reference − position) + kd · (reference's speed − speed) + feed-forward torque,
//!
//! within ± a largest torque; the reference is a trajectory, or the nearer end of a range outside of which alone the
//! spring acts. Prepared by the tasks from a [`Request`] in SI ([`Config::impedance`](crate::config::Config::impedance)),
//! computed in integers every [`OUTER`](crate::drive::OUTER) steps, in the slot of the speed loop.
//!
//! Units as in the outer loops: positions in 2⁻²⁹ electrical turns, so that a speed is what a position moves on by.

mod error;
mod gains;
mod reference;
mod request;
mod state;

use crate::angle::Position;
use crate::math::clamp;
use crate::schedule::OUTER;
pub use error::{Error, Field};
pub use gains::Gains;
pub(crate) use gains::Spring;
pub(crate) use reference::Reference;
pub use request::{Motion, Request};
pub use state::State;

/// A [`Request`] in the units of the interrupt, and what becomes of it there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Impedance {
    spring: Spring,
    /// Feed-forward current and largest current along q, in 2⁻¹⁵ of the full scale.
    forward: i32,
    most: i32,
    pub(crate) reference: Reference,
    /// Command time-out in steps of the outer loops; the largest number for none.
    pub(crate) timeout: u32,
}

impl Impedance {
    /// Without a spring, a damper or a torque: what memory for one begins with.
    pub const NONE: Self = Self { spring: Spring::NONE, forward: 0, most: 0, reference: Reference::REST, timeout: 1 };

    /// Whether a spring acts, which a rotor far from the reference strains.
    #[inline(always)]
    pub(crate) const fn is_sprung(&self) -> bool {
        self.spring.stiffness != 0 && !matches!(self.reference, Reference::Within { .. })
    }

    /// The current along q for a rotor at a position with a speed, in 2⁻¹⁵ of the full scale; `ahead` is the
    /// trajectory's position and speed.
    #[inline(always)]
    pub(crate) fn current(&self, ahead: (i64, i32), position: i64, speed: i32) -> i32 {
        let current = match self.reference {
            Reference::Within { least, .. } if position < least => self.spring.current(least - position, -speed).max(0),
            Reference::Within { most, .. } if position > most => self.spring.current(most - position, -speed).min(0),
            Reference::Within { .. } => 0,
            _ => self.spring.current(ahead.0.wrapping_sub(position), ahead.1.wrapping_sub(speed)),
        };
        clamp(current + self.forward, self.most)
    }
}

/// A position in the unit of the outer loops: what a speed moves on by in a step of theirs is its number.
const fn coarse(position: Position) -> i64 {
    position.to_bits() >> OUTER.ilog2()
}
