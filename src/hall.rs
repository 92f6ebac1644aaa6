//! Three linear Halls: from ADC codes to the rotor's electrical angle, speed and turns.
//!
//! [`model`] says what a sensor delivers, [`calibrate`] finds the model by turning the rotor, [`estimate`] turns it
//! into integers and inverts it in the control interrupt, [`track`] makes angle, speed and turns of the angles.
//! [`plausibility`] tells which codes no healthy sensor delivers.

pub mod adapt;
pub mod calibrate;
pub mod estimate;
pub mod model;
pub mod plausibility;
pub mod track;

use core::fmt;

/// The three ADC codes of one instant, right-aligned.
pub type Codes = [u16; 3];

/// Which of the three sensors, counted from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Channel(pub u8);

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Hall {}", self.0)
    }
}
