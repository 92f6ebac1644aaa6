//! Why learning ends.

use crate::hall::Channel;
use core::fmt;

/// What may run to the edge of the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Parameter {
    /// The signal's mean.
    Offset,
    /// The signal's size.
    Amplitude,
    /// The phase against the first sensor.
    Placement,
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Offset => "offset",
            Self::Amplitude => "amplitude",
            Self::Placement => "placement",
        })
    }
}

/// Why nothing is learnt any more. The model stays as it was before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Fault {
    /// The sensor's code stays at the end of the ADC's range.
    AtRail(Channel),
    /// The sensor contradicts the other two.
    Lost(Channel),
    /// The sensor has drifted to the edge of what is allowed around its calibration.
    Drifted(Channel, Parameter),
    /// The third harmonic has drifted to that edge.
    Distorted,
    /// No parameters near the calibration explain the three sensors.
    Contradiction,
}

impl Fault {
    /// The sensor to do without, where one is to blame and the other two still give the angle.
    pub const fn lost(self) -> Option<Channel> {
        match self {
            Self::AtRail(channel) | Self::Lost(channel) => Some(channel),
            Self::Drifted(..) | Self::Distorted | Self::Contradiction => None,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtRail(channel) => {
                write!(f, "{channel} stays at the end of the ADC's range: open, shorted or saturated")
            }
            Self::Lost(channel) => write!(f, "{channel} contradicts the other two: stuck, loose or open"),
            Self::Drifted(channel, parameter) => {
                write!(f, "the {parameter} of {channel} has drifted as far from its calibration as is allowed")
            }
            Self::Distorted => {
                write!(f, "the magnet's third harmonic has drifted as far from its calibration as is allowed")
            }
            Self::Contradiction => write!(f, "the Halls fit nothing near their calibration: calibrate again"),
        }
    }
}

impl core::error::Error for Fault {}
