//! How the campaign says where something happened.

use super::campaign::Wish;
use hallservo::commutation::Commutation;
use std::fmt;

impl fmt::Display for Wish {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Voltage(share) => write!(f, "{:.0} % of the voltage", 100.0 * share),
            Self::Current(amperes) => write!(f, "the torque of {amperes:.2} A"),
            Self::Speed(rad_s) => write!(f, "{rad_s:.0} rad/s"),
            Self::By(turns) => write!(f, "{turns:+.2} turns from there"),
        }
    }
}

/// A commutation's name.
pub(super) const fn commutation(commutation: Commutation) -> &'static str {
    match commutation {
        Commutation::Block => "block",
        Commutation::Sinusoidal => "sinusoidal",
        Commutation::FieldOriented => "field-oriented",
    }
}
