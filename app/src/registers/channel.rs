//! The diagnostic channel, with the feature `diagnostic`; without, nothing of it is left in the image.

#[cfg(feature = "diagnostic")]
mod diagnostic;
#[cfg(not(feature = "diagnostic"))]
mod none;

#[cfg(feature = "diagnostic")]
pub(super) use diagnostic::{Channel, Pending};
#[cfg(not(feature = "diagnostic"))]
pub(super) use none::{Channel, Pending};
