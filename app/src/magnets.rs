//! The map of the rotor's magnets, with the feature `map`; without, nothing of it is left in the image.

#[cfg(feature = "map")]
mod learnt;
#[cfg(not(feature = "map"))]
mod none;

#[cfg(feature = "map")]
pub(crate) use learnt::{ForDrive, MagnetMap, MagnetMemory};
#[cfg(not(feature = "map"))]
pub(crate) use none::{ForDrive, MagnetMap, MagnetMemory};
