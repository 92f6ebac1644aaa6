//! Impedance control: a spring and a damper at the shaft,
//!
//! torque = kp · (reference − position) + kd · (reference's speed − speed) + feed-forward torque,
//!
//! within ± a largest torque; the reference is a trajectory, or the nearer end of a range outside of which alone spring
//! and damper act. Prepared by the tasks from a [`Request`] in SI
//! ([`Config::impedance`](crate::config::Config::impedance)), computed in integers every [`OUTER`](crate::drive::OUTER)
//! steps, in the slots of the position and the speed loop.
//!
//! Units as in the outer loops: positions in 2⁻²⁹ electrical turns, so that a speed is what a position moves on by.

mod error;
mod gains;
mod motion;
mod request;
mod state;

pub use error::{Error, Field};
pub use gains::Gains;
pub(crate) use gains::Spring;
pub(crate) use motion::{Course, Start};
pub use request::{LONGEST_S, Motion, Request};
pub use state::State;

/// A [`Request`] in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Impedance {
    pub(crate) spring: Spring,
    /// Feed-forward current and largest current along q, in 2⁻¹⁵ of the full scale.
    pub(crate) forward: i32,
    pub(crate) most: i32,
    pub(crate) course: Course,
    /// Command time-out in steps of the outer loops; the largest number for none.
    pub(crate) timeout: u32,
}

impl Impedance {
    /// Without a spring, a damper or a torque: what memory for one begins with.
    pub const NONE: Self = Self { spring: Spring::NONE, forward: 0, most: 0, course: Course::REST, timeout: 1 };
}
