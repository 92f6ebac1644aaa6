//! Settings by name: one table, from which tools list, read and change them, and which the flash is read by.

mod record;
mod table;

pub use record::{KEYED, key};
pub use table::TABLE;

use hallservo::commutation::Commutation;
use hallservo::control::cogging::Table;
use hallservo::control::current::Feedback;
use hallservo::control::settings::{OnTimeout, Settings as Control};
use hallservo::settings::{self, Config};
use hallservo_protocol::{Cogging, Kind, Refusal};

/// The settings of a drive and of its tasks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Those of the control interrupt.
    pub drive: settings::Settings,
    /// Whether the sensors are learnt while the motor turns.
    pub adaptation: bool,
    /// Whether the cogging is balanced, once it has been learnt.
    pub anti_cogging: bool,
}

impl Settings {
    /// With what a board has by default.
    pub const fn new(drive: settings::Settings) -> Self {
        Self { drive, adaptation: true, anti_cogging: true }
    }

    /// Full scale of the current sensing, A; zero without.
    pub(crate) fn full_scale_a(&self) -> f32 {
        self.drive.control.map_or(0.0, |control| control.current_full_scale_a)
    }

    /// A table of the cogging in SI.
    pub(crate) fn cogging(&self, table: &Table) -> Cogging {
        let amperes = |current: &i16| f32::from(*current) / 32_768.0 * self.full_scale_a();
        let largest_a = table.0.iter().map(|current| amperes(current).abs()).fold(0.0, f32::max);
        let squares: f32 = table.0.iter().map(|current| amperes(current) * amperes(current)).sum();
        Cogging { largest_a, rms_a: libm::sqrtf(squares / table.0.len() as f32) }
    }

    /// In the units of the interrupt.
    ///
    /// # Errors
    /// [`Refusal::OutOfRange`] names the first field that cannot be.
    pub fn validate(&self) -> Result<Config, Refusal<'static>> {
        self.drive.validate().map_err(|error| match error {
            settings::Error::OutOfRange { field, value, min, max } => Refusal::OutOfRange { field, value, min, max },
            settings::Error::NoControl => Refusal::NoControl,
            settings::Error::Pwm(_) => Refusal::Contradiction,
        })
    }

    /// Whether all have the same values: shorter in the flash than comparing field by field.
    pub(crate) fn same(&self, other: &Self) -> bool {
        TABLE.iter().all(|entry| entry.get(self) == entry.get(other))
    }

    /// With another value of a setting, if all together are valid then.
    ///
    /// # Errors
    /// Why not.
    pub fn with(&self, name: &str, value: f32) -> Result<Self, Refusal<'static>> {
        let entry = find(name).ok_or(Refusal::NoSetting)?;
        if entry.fixed {
            return Err(Refusal::Fixed);
        }
        let mut changed = *self;
        entry.assign(&mut changed, value)?;
        changed.validate().map(|_| changed)
    }
}

/// A row of the table.
pub struct Entry {
    /// Name, unique, up to 32 bytes; that of the field in the library where it is unique there.
    pub name: &'static str,
    /// Unit of the value, up to 8 bytes.
    pub unit: &'static str,
    /// Of what kind the value is.
    pub kind: Kind<'static>,
    /// Whether it follows from the board's parts.
    pub fixed: bool,
    /// `None` without current control. One function to read and to write, for the sake of the flash.
    field: fn(&mut Settings) -> Option<&mut dyn Value>,
    /// Least and most, as the other settings are.
    range: fn(&settings::Settings, &Control) -> (f32, f32),
}

impl Entry {
    /// The value; `None` where the drive has no current control, and so no such setting.
    pub fn get(&self, settings: &Settings) -> Option<f32> {
        (self.field)(&mut { *settings }).map(|field| field.number())
    }

    /// Least and most value, as the other settings are.
    pub fn range(&self, settings: &Settings) -> (f32, f32) {
        (self.range)(&settings.drive, &settings.drive.control.unwrap_or_default())
    }

    /// Another value, if it is in its range.
    pub(crate) fn assign(&self, settings: &mut Settings, value: f32) -> Result<(), Refusal<'static>> {
        let (min, max) = self.range(settings);
        let field = (self.field)(settings).ok_or(Refusal::NoControl)?;
        // Not a number is in no range; infinity is in that of the command's timeout.
        if !(min..=max).contains(&value) {
            return Err(Refusal::OutOfRange { field: self.name, value, min, max });
        }
        if self.kind != Kind::Real && value != libm::truncf(value) {
            return Err(Refusal::NoChoice);
        }
        field.assign(value);
        Ok(())
    }
}

/// What a setting is, in words of up to 90 bytes; empty for a name that is not in the table. For tools: a drive does not have it.
pub fn about(name: &str) -> &'static str {
    table::ABOUT.iter().find(|(one, _)| *one == name).map_or("", |(_, about)| about)
}

/// The row with a name.
pub fn find(name: &str) -> Option<&'static Entry> {
    TABLE.iter().find(|entry| entry.name == name)
}

/// A field as the number of the protocol.
trait Value {
    fn number(&self) -> f32;
    /// In its range already.
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

#[cfg(test)]
mod tests;
