//! What the long procedures found.

use serde::{Deserialize, Serialize};

/// What the last calibration came to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Calibration {
    /// There was none since power-up.
    None,
    /// It goes on.
    Turning,
    /// The drive can be armed.
    Found(Report),
    /// What is wrong.
    Failed(CalibrationError),
}

/// One sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorReport {
    /// Peak to peak, ADC codes.
    pub swing: f32,
    /// ADC codes.
    pub offset: f32,
    /// Difference from even spacing, electrical degrees.
    pub placement_error_deg: f32,
    /// Third harmonic in per cent of the amplitude.
    pub third_pct: f32,
    /// Fifth harmonic in per cent of the amplitude.
    pub fifth_pct: f32,
    /// Standard deviation in per cent of the amplitude.
    pub noise_pct: f32,
    /// Samples at the ends of the ADC's range.
    pub at_rail: u32,
}

/// All three.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// In the order of their channels.
    pub sensors: [SensorReport; 3],
    /// Electrical degrees from sensor to sensor: 60 or 120.
    pub spacing: u8,
    /// Whether the second sensor follows the first in the direction from phase A to B.
    pub forward: bool,
    /// What the model does not explain, RMS in per cent of the amplitude.
    pub residual_pct: f32,
    /// How far the rotor lagged behind the field, electrical degrees.
    pub lag_deg: f32,
    /// How far the rotor swung about that, electrical degrees RMS.
    pub hunting_deg: f32,
    /// Noise of the angle before tracking, electrical degrees RMS.
    pub angle_noise_deg: f32,
}

/// Why a calibration failed; sensors are counted from zero.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum CalibrationError {
    /// Too few samples, turning forward or not.
    Incomplete {
        /// Which way.
        forward: bool,
    },
    /// A sensor sees no magnet turning.
    NoSignal(u8),
    /// No parameters explain the signals.
    NoFit,
    /// An ADC of so many bits is not supported.
    AdcBits(u8),
    /// A sensor has impossible parameters.
    Sensor(u8),
    /// So placed, the angle is this many times as noisy as it could be.
    Placement(f32),
    /// No memory for the result.
    Busy,
    /// A small swing in ADC codes.
    TooFar(u8, f32),
    /// A sensor saturates.
    TooClose(u8),
    /// One swing is this many times another.
    Unequal(f32),
    /// Electrical degrees away from even spacing.
    Misplaced(u8, f32),
    /// Noise in per cent of the amplitude.
    Noisy(u8, f32),
    /// Per cent of the signals that no rotor explains.
    Unexplained(f32),
    /// Electrical degrees that the rotor lagged by.
    Lagging(f32),
    /// Electrical degrees RMS that it swung by.
    Hunting(f32),
    /// It was ended by a command or a fault.
    Ended,
}

/// What the last identification of the motor came to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Identification {
    /// There was none since power-up.
    None,
    /// It goes on.
    Turning,
    /// The motor; its parameters are in the settings, not yet saved.
    Found {
        /// Resistance of a phase, Ω.
        resistance_ohm: f32,
        /// Inductance of a phase, H.
        inductance_h: f32,
        /// Flux linkage, Wb.
        flux_linkage_wb: f32,
        /// Inertia of all that turns, kg·m².
        inertia_kgm2: f32,
    },
    /// The measurements tell nothing, or a command or a fault ended it.
    Failed,
}
