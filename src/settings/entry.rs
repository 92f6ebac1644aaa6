//! A row of the table of settings.

use super::{Error, Feedback, OnStopFailure, OnTimeout, Settings, TABLE};
use crate::commutation::Commutation;

/// What values a setting takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Kind<'a> {
    /// A number.
    Real,
    /// A whole number.
    Whole,
    /// 0 for no and 1 for yes.
    Switch,
    /// One of these names, separated by `|`, counted from zero.
    Choice(&'a str),
}

/// A row of [`TABLE`].
pub struct Entry {
    /// Name, unique, up to 32 bytes. One that has been in a release is never given to another setting.
    pub name: &'static str,
    /// Unit of the value, up to 8 bytes.
    pub unit: &'static str,
    /// What values it takes. Few kinds are shared by many rows, for the sake of the flash.
    pub kind: &'static Kind<'static>,
    /// Whether it follows from the board's parts.
    pub fixed: bool,
    /// `None` without current control. One function to read and to write, for the sake of the flash.
    pub(super) field: fn(&mut Settings) -> Option<&mut dyn Value>,
    /// Least and most, as the other settings are.
    pub(super) range: fn(&Settings) -> (f32, f32),
}

impl Entry {
    /// The value; `None` where the drive has no current control, and so no such setting.
    pub fn get(&self, settings: &Settings) -> Option<f32> {
        (self.field)(&mut { *settings }).map(|field| field.number())
    }

    /// Least and most value, as the other settings are and the board allows.
    pub fn range(&self, settings: &Settings) -> (f32, f32) {
        let (min, max) = (self.range)(settings);
        (min, max.min(settings.ceiling(self.name)))
    }

    /// Whether the value is in its range.
    pub(super) fn check(&self, settings: &Settings) -> Result<(), Error<'static>> {
        self.get(settings).map_or(Ok(()), |value| self.check_value(settings, value))
    }

    #[inline(never)]
    fn check_value(&self, settings: &Settings, value: f32) -> Result<(), Error<'static>> {
        let (min, max) = (self.range)(settings);
        // Not a number is in no range.
        let inside = (min..=max).contains(&value);
        if inside { Ok(()) } else { Err(Error::OutOfRange { field: self.name, value, min, max }) }
    }

    /// Another value. A real one may be out of its range, for [`Settings::check`] to find out with the others; the rest
    /// may not. Also of a setting that is the board's: for what simulates that board.
    ///
    /// # Errors
    /// Why not.
    pub fn assign(&self, settings: &mut Settings, value: f32) -> Result<(), Error<'static>> {
        if *self.kind != Kind::Real {
            self.check_value(settings, value)?;
            if value != libm::truncf(value) {
                return Err(Error::NotWhole);
            }
        }
        (self.field)(settings).ok_or(Error::NoControl)?.assign(value);
        Ok(())
    }
}

/// A description of up to 90 bytes; empty for a name that is not in the table. For tools: a drive does not have it.
pub fn about(name: &str) -> &'static str {
    super::ABOUT.iter().find(|(one, _)| *one == name).map_or("", |(_, about)| about)
}

/// The row with a name.
pub fn find(name: &str) -> Option<&'static Entry> {
    TABLE.iter().find(|entry| entry.name == name)
}

/// A field as a number.
pub(super) trait Value {
    fn number(&self) -> f32;
    fn assign(&mut self, number: f32);
}

impl Value for f32 {
    fn number(&self) -> f32 {
        *self
    }

    fn assign(&mut self, number: f32) {
        *self = number;
    }
}

impl Value for u8 {
    fn number(&self) -> f32 {
        (*self).into()
    }

    fn assign(&mut self, number: f32) {
        *self = number as u8;
    }
}

impl Value for bool {
    fn number(&self) -> f32 {
        f32::from(u8::from(*self))
    }

    fn assign(&mut self, number: f32) {
        *self = number != 0.0;
    }
}

/// The number of a choice is its place in this list, which is that of its name in the table.
macro_rules! choice {
    ($type:ident: $($variant:ident),+) => {
        impl Value for $type {
            fn number(&self) -> f32 {
                [$($type::$variant),+].iter().position(|one| one == self).unwrap_or(0) as f32
            }

            fn assign(&mut self, number: f32) {
                if let Some(one) = [$($type::$variant),+].get(number as usize) {
                    *self = *one;
                }
            }
        }
    };
}

choice!(Commutation: Block, Sinusoidal, FieldOriented);
choice!(Feedback: P, Pi, Pd, Pid);
choice!(OnTimeout: Fault, Stop);
choice!(OnStopFailure: Off, Brake);
