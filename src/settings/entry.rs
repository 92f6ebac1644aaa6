//! A row of the table of settings.

use super::declaration::Row;
use super::{Error, Feedback, OnStopFailure, OnTimeout, Settings, TABLE};
use crate::commutation::Commutation;
use crate::float::whole_u16;

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

/// A row of [`TABLE`]: 12 bytes of flash.
pub struct Entry {
    /// Name, unique, up to 32 bytes. One that has been in a release is never given to another setting.
    pub name: &'static str,
    pub(super) row: Row,
    /// Place in [`UNITS`].
    pub(super) unit: u8,
    /// Place in [`KINDS`], and [`BOARD`] or [`TUNABLE`].
    pub(super) kind: u8,
}

/// Marks a setting that is the board's.
pub(super) const BOARD: u8 = 0x80;
/// Marks one that a drive takes over while it turns.
pub(super) const TUNABLE: u8 = 0x40;

/// Every unit.
const UNITS: [&str; 18] =
    ["", "bit", "Hz", "s", "µs", "°", "°C", "K", "A", "V", "Ω", "H", "Wb", "kg·m²", "turns", "rad/s", "rad/s²", "°/A"];

/// Every kind.
const KINDS: [Kind<'static>; 7] = [
    Kind::Real,
    Kind::Whole,
    Kind::Switch,
    Kind::Choice("block|sinusoidal|field-oriented"),
    Kind::Choice("p|pi|pd|pid"),
    Kind::Choice("off|brake"),
    Kind::Choice("fault|stop"),
];

/// The place of a unit; for constants: one that is not in the list does not compile.
pub(super) const fn unit(name: &str) -> u8 {
    let mut place = 0;
    while !same(UNITS[place], name) {
        place += 1;
    }
    place as u8
}

/// The place of a kind, likewise.
pub(super) const fn kind(kind: Kind<'_>) -> u8 {
    let mut place = 0;
    while !alike(KINDS[place], kind) {
        place += 1;
    }
    place as u8
}

const fn alike(a: Kind<'_>, b: Kind<'_>) -> bool {
    match (a, b) {
        (Kind::Choice(a), Kind::Choice(b)) => same(a, b),
        (Kind::Real, Kind::Real) | (Kind::Whole, Kind::Whole) | (Kind::Switch, Kind::Switch) => true,
        _ => false,
    }
}

const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}

impl Entry {
    /// Unit of the value, up to 8 bytes.
    pub fn unit(&self) -> &'static str {
        UNITS.get(usize::from(self.unit)).unwrap_or(&"")
    }

    /// What values it takes.
    pub fn kind(&self) -> Kind<'static> {
        *KINDS.get(usize::from(self.kind & !(BOARD | TUNABLE))).unwrap_or(&Kind::Real)
    }

    /// Whether it follows from the board's parts. One of these that the board names a ceiling for may be changed up to
    /// that.
    #[inline(never)]
    pub fn fixed(&self, settings: &Settings) -> bool {
        self.kind & BOARD != 0 && settings.ceiling(self.name) == f32::INFINITY
    }

    /// Whether a drive takes it over while it turns, by [`Command::Retune`](crate::drive::Command::Retune).
    pub const fn is_tunable(&self) -> bool {
        self.kind & TUNABLE != 0
    }

    /// The value; `None` where the drive has no current control, and so no such setting.
    pub fn get(&self, settings: &Settings) -> Option<f32> {
        self.row.field(&mut { *settings }).map(|field| field.number())
    }

    /// Least and most value, as the other settings are and the board allows; `None` as [`Self::get`].
    pub fn range(&self, settings: &Settings) -> Option<(f32, f32)> {
        self.row.range(settings).map(|(min, max)| (min, max.min(settings.ceiling(self.name))))
    }

    /// Whether the value is in its range.
    pub(super) fn check(&self, settings: &Settings) -> Result<(), Error<'static>> {
        self.get(settings).map_or(Ok(()), |value| self.check_value(settings, value))
    }

    #[inline(never)]
    fn check_value(&self, settings: &Settings, value: f32) -> Result<(), Error<'static>> {
        let (min, max) = self.row.range(settings).ok_or(Error::NoControl)?;
        // Not a number is in no range.
        let inside = (min..=max).contains(&value);
        if inside { Ok(()) } else { Err(Error::OutOfRange { field: self.name, value, min, max }) }
    }

    /// [`Settings::change`] of this one.
    ///
    /// # Errors
    /// As there.
    pub fn change(&self, settings: &mut Settings, value: f32) -> Result<(), Error<'static>> {
        if self.fixed(settings) { Err(Error::Fixed) } else { self.assign(settings, value) }
    }

    /// Another value. A real one may be out of its range, for [`Settings::check`] to find out with the others; the rest
    /// may not. Also of a setting that is the board's: for what simulates that board.
    ///
    /// # Errors
    /// Why not.
    pub fn assign(&self, settings: &mut Settings, value: f32) -> Result<(), Error<'static>> {
        if self.kind() != Kind::Real {
            self.check_value(settings, value)?;
            // In its range, which an integer holds.
            if value != value as i32 as f32 {
                return Err(Error::NotWhole);
            }
        }
        self.row.field(settings).ok_or(Error::NoControl)?.assign(value);
        Ok(())
    }
}

/// A description of up to 90 bytes; empty for a name that is not in the table. For tools: a drive does not have it.
pub fn about(name: &str) -> &'static str {
    let of_encoder = || crate::vernier::settings::TABLE.iter().find(|row| row.name == name).map_or("", |row| row.about);
    super::ABOUT.iter().find(|(one, _)| *one == name).map_or_else(of_encoder, |(_, about)| about)
}

/// The row with a name.
pub fn find(name: impl AsRef<[u8]>) -> Option<&'static Entry> {
    TABLE.iter().find(|entry| entry.name.as_bytes() == name.as_ref())
}

/// A field of the settings. No trait object, whose tables of functions would take more flash.
pub(super) enum Field<'a> {
    Real(&'a mut f32),
    Whole(&'a mut u8),
    Switch(&'a mut bool),
    Commutation(&'a mut Commutation),
    Feedback(&'a mut Feedback),
    OnTimeout(&'a mut OnTimeout),
    OnStopFailure(&'a mut OnStopFailure),
}

impl Field<'_> {
    fn number(&self) -> f32 {
        match self {
            Self::Real(value) => **value,
            Self::Whole(value) => (**value).into(),
            Self::Switch(value) => u8::from(**value).into(),
            Self::Commutation(value) => (**value as u8).into(),
            Self::Feedback(value) => (**value as u8).into(),
            Self::OnTimeout(value) => (**value as u8).into(),
            Self::OnStopFailure(value) => (**value as u8).into(),
        }
    }

    fn assign(self, number: f32) {
        match self {
            Self::Real(value) => *value = number,
            Self::Whole(value) => *value = whole_u16(number) as u8,
            Self::Switch(value) => *value = number != 0.0,
            Self::Commutation(value) => choose(&COMMUTATIONS, number, value),
            Self::Feedback(value) => choose(&FEEDBACKS, number, value),
            Self::OnTimeout(value) => choose(&TIMEOUTS, number, value),
            Self::OnStopFailure(value) => choose(&STOP_FAILURES, number, value),
        }
    }
}

// The number of a choice is its variant's, which is its place in these lists and that of its name in the table.
const COMMUTATIONS: [Commutation; 3] = [Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented];
const FEEDBACKS: [Feedback; 4] = [Feedback::P, Feedback::Pi, Feedback::Pd, Feedback::Pid];
const TIMEOUTS: [OnTimeout; 2] = [OnTimeout::Fault, OnTimeout::Stop];
const STOP_FAILURES: [OnStopFailure; 2] = [OnStopFailure::Off, OnStopFailure::Brake];

fn choose<T: Copy>(all: &[T], number: f32, value: &mut T) {
    if let Some(one) = all.get(number as usize) {
        *value = *one;
    }
}

macro_rules! field {
    ($($type:ty: $kind:ident),+) => {
        $(impl<'a> From<&'a mut $type> for Field<'a> {
            fn from(value: &'a mut $type) -> Self {
                Self::$kind(value)
            }
        })+
    };
}

field!(f32: Real, u8: Whole, bool: Switch, Commutation: Commutation, Feedback: Feedback, OnTimeout: OnTimeout,
    OnStopFailure: OnStopFailure);
