//! Current, speed and position control: cascaded loops in integers, their gains computed from the motor and a
//! bandwidth.
//!
//! Units of the loops: a current of 2¹⁵ is the full scale of the current amplifiers, a voltage of 2¹⁵ that of the bus
//! divider; speeds are in 2⁻³² electrical turns a step, as the [tracker](crate::hall::track)'s, positions in 2⁻²⁹
//! electrical turns, so that a speed is what they change by in each of the outer loops, every 8 steps.

pub mod cogging;
pub mod config;
pub mod current;
pub mod impedance;
mod measured;
pub mod position;
pub mod trajectory;
pub mod velocity;
pub mod weakening;
mod window;

use crate::angle::TURN;
pub use config::Config;
pub use impedance::Impedance;
pub use window::Window;

/// Current of a phase or along an axis, in 2⁻¹⁵ of the full scale of the amplifiers.
/// [`Config::current`] makes one of amperes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Current(pub(crate) i32);

/// Speed in 2⁻³² electrical turns a step. [`Config::speed`] makes one of radians a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Speed(pub(crate) i32);

/// What the units of the loops are in SI.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scale {
    /// Steps a second.
    pub step_hz: f32,
    /// Current of 2¹⁵.
    pub amperes: f32,
    /// Voltage of 2¹⁵.
    pub volts: f32,
    /// Electrical turns in a mechanical turn.
    pub pole_pairs: f32,
}

impl Scale {
    /// Units of current in an ampere.
    pub fn per_ampere(&self) -> f32 {
        32_768.0 / self.amperes
    }

    /// The pole pairs as an integer, by way of one of 32 bits: the direct way takes a function of its own.
    pub(crate) fn whole_pole_pairs(&self) -> i64 {
        i64::from(self.pole_pairs as i32)
    }

    /// Units of speed in a mechanical radian a second.
    #[cfg_attr(feature = "small", inline(never))]
    pub fn per_radian_s(&self) -> f32 {
        self.pole_pairs / core::f32::consts::TAU / self.step_hz * TURN
    }

    /// Units of current per unit of voltage in a siemens.
    pub fn conductance(&self) -> f32 {
        self.volts / self.amperes
    }
}

/// The motor, as the loops need it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Motor {
    /// Resistance of a phase, star.
    pub resistance_ohm: f32,
    /// Inductance of a phase, star, along the magnets' field.
    pub inductance_h: f32,
    /// Inductance across the magnets' field over the one along it.
    pub saliency: f32,
    /// Flux of the magnets linked with a phase, amplitude; the back-EMF constant per electrical radian a second.
    pub flux_linkage_wb: f32,
    /// Inertia of all that turns.
    pub inertia_kgm2: f32,
}

impl Motor {
    /// Share by which a current of an ampere against the field makes the torque larger, (Lq − Ld)/λ; 0 where it makes it
    /// smaller.
    pub(crate) fn reluctance_per_a(&self) -> f32 {
        ((self.saliency - 1.0) * self.inductance_h / self.flux_linkage_wb).max(0.0)
    }

    /// Inductance along d and q, H.
    pub fn inductances_h(&self) -> [f32; 2] {
        [self.inductance_h, self.inductance_h * self.saliency]
    }

    /// Torque per ampere along q: 1.5 · pole pairs · flux linkage.
    pub fn torque_constant(&self, pole_pairs: f32) -> f32 {
        1.5 * pole_pairs * self.flux_linkage_wb
    }
}

/// `value · 2^bits` as an integer, if it is one of `i32`.
#[inline(never)]
fn fixed(value: f32, bits: i32) -> Option<i32> {
    let scaled = value * crate::float::power_of_two(bits);
    (scaled.abs() < 2_147_483_648.0).then(|| crate::float::nearest(scaled))
}

/// The same, or the largest integer.
#[inline(never)]
fn bounded(value: f32, bits: i32) -> i32 {
    fixed(value, bits).unwrap_or(i32::MAX)
}
