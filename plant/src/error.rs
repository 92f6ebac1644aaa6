//! What is wrong with a parameter.

use core::fmt;

/// A parameter outside its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error {
    /// Path of the field within [`PlantParameters`](crate::PlantParameters).
    pub field: &'static str,
    /// Which element, counted from 0, where the field stands in an array. The text counts from 1.
    pub index: Option<usize>,
    /// What the value has to be.
    pub rule: &'static str,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.field)?;
        if let Some(index) = self.index {
            write!(f, " (number {})", index + 1)?;
        }
        write!(f, " must be {}", self.rule)
    }
}

impl core::error::Error for Error {}

impl Error {
    pub(crate) const fn new(field: &'static str, rule: &'static str) -> Self {
        Self { field, index: None, rule }
    }

    pub(crate) const fn at(self, index: usize) -> Self {
        Self { index: Some(index), ..self }
    }
}

pub(crate) fn require(holds: bool, field: &'static str, rule: &'static str) -> Result<(), Error> {
    if holds { Ok(()) } else { Err(Error::new(field, rule)) }
}

pub(crate) fn finite(value: f64, field: &'static str) -> Result<(), Error> {
    require(value.is_finite(), field, "finite")
}

pub(crate) fn positive(value: f64, field: &'static str) -> Result<(), Error> {
    require(value.is_finite() && value > 0.0, field, "finite and above zero")
}

pub(crate) fn not_negative(value: f64, field: &'static str) -> Result<(), Error> {
    require(value.is_finite() && value >= 0.0, field, "finite and not below zero")
}
