//! What a person sets of an encoder. A drive without one has none of it.

use super::rings::{Rings, RingsError};
use crate::settings::Kind;
use core::fmt;

/// Settings of the two rings and of what they are for. The default is the construction of the second paper.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Pole pairs of the ring whose reading gives the fine angle.
    pub reference_pairs: u8,
    /// Pole pairs of the other ring.
    pub vernier_pairs: u8,
    /// From the head over the reference ring to that over the vernier ring, seen from the axis, degrees.
    pub head_angle_deg: f32,
    /// Length of a pole pair on either ring, mm.
    pub pole_pair_mm: f32,
    /// Whether speed and position are controlled by the encoder; otherwise by the Halls.
    pub closes_loops: bool,
    /// Whether a running drive that loses the encoder goes on by the Halls; otherwise it fails.
    pub falls_back: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            reference_pairs: 37,
            vernier_pairs: 45,
            head_angle_deg: 40.0,
            pole_pair_mm: 2.0,
            closes_loops: true,
            falls_back: false,
        }
    }
}

/// A setting.
pub struct Row {
    /// Name; one that has been in a release is never given to another setting.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// What values it takes.
    pub kind: Kind<'static>,
    /// Least and most.
    pub range: (f32, f32),
    /// What it is, for a person.
    pub about: &'static str,
    field: Field,
}

/// Where a setting is, and of which type.
enum Field {
    Pairs(fn(&mut Settings) -> &mut u8),
    Number(fn(&mut Settings) -> &mut f32),
    Switch(fn(&mut Settings) -> &mut bool),
}

/// Range of a switch.
const EITHER: (f32, f32) = (0.0, 1.0);
/// Of the pole pairs of a ring.
const PAIRS: (f32, f32) = (1.0, 64.0);

/// All of them.
pub static TABLE: &[Row] = &[
    Row {
        name: "encoder_reference_pairs",
        unit: "",
        kind: Kind::Whole,
        range: PAIRS,
        about: "Pole pairs of the ring that gives the fine angle",
        field: Field::Pairs(|settings| &mut settings.reference_pairs),
    },
    Row {
        name: "encoder_vernier_pairs",
        unit: "",
        kind: Kind::Whole,
        range: PAIRS,
        about: "Pole pairs of the other ring: no common divisor",
        field: Field::Pairs(|settings| &mut settings.vernier_pairs),
    },
    Row {
        name: "encoder_head_angle_deg",
        unit: "°",
        kind: Kind::Real,
        range: (-180.0, 180.0),
        about: "From the head over the first ring to that over the second",
        field: Field::Number(|settings| &mut settings.head_angle_deg),
    },
    Row {
        name: "encoder_pole_pair_mm",
        unit: "mm",
        kind: Kind::Real,
        range: (0.2, 50.0),
        about: "Length of a pole pair on the rings",
        field: Field::Number(|settings| &mut settings.pole_pair_mm),
    },
    Row {
        name: "encoder_closes_loops",
        unit: "",
        kind: Kind::Switch,
        range: EITHER,
        about: "Speed and position are controlled by the encoder",
        field: Field::Switch(|settings| &mut settings.closes_loops),
    },
    Row {
        name: "encoder_on_loss",
        unit: "",
        kind: Kind::Choice("fault|halls"),
        range: EITHER,
        about: "A running drive that loses the encoder fails, or goes on by the Halls",
        field: Field::Switch(|settings| &mut settings.falls_back),
    },
];

/// Why a value is not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// No setting has this name.
    Unknown,
    /// Not in the range of the setting, or not whole where it has to be.
    OutOfRange {
        /// Least.
        min: f32,
        /// Most.
        max: f32,
    },
    /// The two rings make no encoder.
    Rings(RingsError),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("there is no such setting"),
            Self::OutOfRange { min, max } => write!(f, "it has to be from {min} to {max}"),
            Self::Rings(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for Error {}

impl Row {
    /// The value.
    pub fn get(&self, settings: &Settings) -> f32 {
        let mut settings = *settings;
        match self.field {
            Field::Pairs(field) => (*field(&mut settings)).into(),
            Field::Number(field) => *field(&mut settings),
            Field::Switch(field) => u8::from(*field(&mut settings)).into(),
        }
    }

    fn set(&self, settings: &mut Settings, value: f32) {
        match self.field {
            Field::Pairs(field) => *field(settings) = value as u8,
            Field::Number(field) => *field(settings) = value,
            Field::Switch(field) => *field(settings) = value != 0.0,
        }
    }
}

impl Settings {
    /// The rings under heads of so many bits.
    ///
    /// # Errors
    /// They make no encoder.
    pub const fn rings(&self, bits: u8) -> Result<Rings, RingsError> {
        Rings::new(self.reference_pairs, self.vernier_pairs, bits)
    }

    /// With another value of one setting, if that is allowed.
    ///
    /// # Errors
    /// Why not.
    pub fn with(&self, name: &str, value: f32) -> Result<Self, Error> {
        let row = TABLE.iter().find(|row| row.name == name).ok_or(Error::Unknown)?;
        let (min, max) = row.range;
        let whole = row.kind == Kind::Real || value == libm::truncf(value);
        if !((min..=max).contains(&value) && whole) {
            return Err(Error::OutOfRange { min, max });
        }
        let mut changed = *self;
        row.set(&mut changed, value);
        changed.rings(16).map_err(Error::Rings)?;
        Ok(changed)
    }

    /// With other rings.
    ///
    /// # Errors
    /// They make no encoder.
    pub fn with_rings(&self, reference_pairs: u8, vernier_pairs: u8) -> Result<Self, Error> {
        let changed = Self { reference_pairs, vernier_pairs, ..*self };
        changed.rings(16).map_err(Error::Rings)?;
        Ok(changed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_reads_what_it_writes_and_refuses_the_rest() {
        for (number, row) in TABLE.iter().enumerate() {
            let (min, max) = row.range;
            let default = row.get(&Settings::default());
            assert!((min..=max).contains(&default));
            assert!(TABLE.iter().skip(number + 1).all(|other| other.name != row.name));
            assert!(row.name.len() <= 32 && row.unit.len() <= 8 && row.about.len() <= 90, "{}", row.name);
            let other = Settings::default().with(row.name, if default == max { min } else { max }).unwrap();
            assert_eq!(row.get(&other), if default == max { min } else { max });
            for bad in [f32::NAN, min - 1.0, max + 1.0, f32::INFINITY] {
                assert_eq!(Settings::default().with(row.name, bad), Err(Error::OutOfRange { min, max }));
            }
        }
        assert_eq!(
            Settings::default().with("encoder_reference_pairs", 36.5),
            Err(Error::OutOfRange { min: 1.0, max: 64.0 })
        );
        assert_eq!(Settings::default().with("pole_pairs", 4.0), Err(Error::Unknown));
    }

    #[test]
    fn rings_with_a_common_divisor_are_refused_by_it() {
        let refused = Settings::default().with("encoder_reference_pairs", 36.0);
        assert_eq!(refused, Err(Error::Rings(RingsError::CommonDivisor(9))));
        assert_eq!(Settings::default().with_rings(45, 37).map(|settings| settings.reference_pairs), Ok(45));
    }
}
