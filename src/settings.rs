//! What a person sets, in SI units. One declaration gives each setting its field, default, range, unit, name and
//! description.
//!
//! [`TABLE`] lists the settings by name, for tools and for the flash. [`Settings::validate`] checks all of them
//! together, for some ranges depend on other settings, and makes a [`Config`](crate::config::Config) of them.

mod choice;
#[cfg(not(feature = "no-chopper"))]
mod chopper;
mod declaration;
mod entry;
mod error;
mod guard;

use crate::crc::crc32_of;

pub use choice::{Feedback, OnStopFailure, OnTimeout};
pub use declaration::{ABOUT, Control, GuardSettings, Settings, TABLE, Thermistor};
pub use entry::{Entry, Kind, about, find};
pub use error::Error;
pub use guard::Ceiling;
#[cfg(not(feature = "small"))]
pub(crate) use guard::DEAD_TIMES;

impl Settings {
    /// Checks that no setting exceeds the board's ceilings and every one is in its range, as the others are.
    ///
    /// # Errors
    /// [`Error::Ceiling`] or [`Error::OutOfRange`] names the first that is not.
    pub fn check(&self) -> Result<(), Error<'static>> {
        self.check_ceilings()?;
        TABLE.iter().try_for_each(|entry| entry.check(self))
    }

    /// With another value of one setting, if all together are valid then.
    ///
    /// # Errors
    /// Why not. What is out of its range may be another setting, whose range depends on this one.
    pub fn with(&self, name: &str, value: f32) -> Result<Self, Error<'static>> {
        let mut changed = *self;
        changed.change(name, value)?;
        changed.validate().map(|_| changed)
    }

    /// Gives one setting another value, without a look at the others: for [`Self::validate`] to find out.
    ///
    /// # Errors
    /// Why it cannot be changed, whatever the others are.
    pub fn change(&mut self, name: &str, value: f32) -> Result<(), Error<'static>> {
        find(name).ok_or(Error::Unknown)?.change(self, value)
    }

    /// A checksum of all values, which tells settings apart without keeping both.
    pub fn digest(&self) -> u32 {
        crc32_of(TABLE.iter().map(|entry| entry.get(self).unwrap_or(f32::NAN).to_le_bytes()))
    }

    /// Full scale of the current sensing, A; zero without.
    pub fn full_scale_a(&self) -> f32 {
        self.control.map_or(0.0, |control| control.current_full_scale_a)
    }
}

impl Thermistor {
    /// 10 kΩ at a pull-up of 10 kΩ, B = 3380 K.
    pub const fn ntc_10k(warn_c: f32, max_c: f32) -> Self {
        Self { pull_up_ohm: 10e3, nominal_ohm: 10e3, beta_k: 3380.0, warn_c, max_c }
    }

    /// What the ADC reads at a temperature, for a full scale of 2¹⁶.
    pub fn code(&self, celsius: f32) -> f32 {
        let resistance = self.nominal_ohm * crate::float::exp(self.beta_k * (1.0 / (celsius + 273.15) - 1.0 / 298.15));
        65_536.0 * resistance / (resistance + self.pull_up_ohm)
    }
}

#[cfg(test)]
mod tests;
