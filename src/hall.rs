//! Three linear Halls, or two: from ADC codes to the rotor's electrical angle, speed and turns.
//!
//! [`model`] says what a sensor delivers, [`calibrate`] finds the model by turning the rotor, [`estimate`] turns it
//! into integers and inverts it in the control interrupt, [`track`] makes angle, speed and turns of the angles.
//! [`plausibility`] tells which codes no healthy sensor delivers, [`pair`] when two sensors do not fit each other.

pub mod adapt;
pub mod calibrate;
pub mod estimate;
pub mod map;
pub mod model;
pub mod pair;
pub mod plausibility;
pub mod track;

use core::fmt;

/// The three ADC codes of one instant, right-aligned.
pub type Codes = [u16; 3];

/// Which of the three sensors: 0 to 2. Its text counts from one, as boards and people do: "Hall 1" to "Hall 3".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Channel(pub u8);

impl Channel {
    /// The one that a drive with two Halls does not have.
    pub const THIRD: Self = Self(2);
}

/// How many sensors a drive has. Of two, it is [`Channel::THIRD`] that is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Halls {
    /// 90°, 120° or 60° apart, electrical.
    Two,
    /// 120° or 60° apart.
    Three,
}

impl Halls {
    /// Their number.
    pub const fn count(self) -> usize {
        match self {
            Self::Two => 2,
            Self::Three => 3,
        }
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Hall {}", u16::from(self.0) + 1)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Channel {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "Hall {}", u16::from(self.0) + 1);
    }
}
