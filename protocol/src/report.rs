//! What the long procedures found.

use crate::message::Refusal;
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

/// What a procedure that turns the motor came to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Procedure<'a, T> {
    /// There was none since power-up.
    None,
    /// It goes on.
    Turning,
    /// What it found.
    Found(T),
    /// Why it came to nothing.
    #[serde(borrow)]
    Failed(ProcedureError<'a>),
}

/// Why a procedure came to nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ProcedureError<'a> {
    /// The drive refused a command of it.
    #[serde(borrow)]
    Refused(Refusal<'a>),
    /// A fault switched the bridge off.
    Fault(u8),
    /// Somebody switched the bridge off.
    Disarmed,
    /// The drive gave no answer.
    Silent,
    /// The rotor did not reach a speed or a place in time.
    Unreached,
    /// The measurements do not tell what was asked.
    Untold,
    /// There was no room for the result.
    NoTable,
    /// A command ended it.
    Cancelled,
}

/// The motor as measured: values and how far they may be off. What is not doubtful is in the settings, not yet saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motor {
    /// Resistance of a phase, Ω.
    pub resistance_ohm: [f32; 2],
    /// Inductance of a phase, H.
    pub inductance_h: [f32; 2],
    /// Flux linkage, Wb.
    pub flux_linkage_wb: [f32; 2],
    /// Inertia, kg·m².
    pub inertia_kgm2: [f32; 2],
    /// Friction at any speed, N·m.
    pub coulomb_nm: [f32; 2],
    /// Friction that grows with the speed, N·m·s.
    pub viscous_nms: [f32; 2],
    /// Constant load against positive rotation, N·m.
    pub load_nm: [f32; 2],
    /// Voltage that the dead-time compensation leaves, V.
    pub leftover_v: [f32; 2],
    /// Resistance, inductance, flux linkage and inertia that the drive was told.
    pub told: [f32; 4],
    /// Pole pairs that the drive was told.
    pub pole_pairs: u8,
    /// Measurements used.
    pub samples: u32,
}

/// The cogging as learnt; it is in the flash, or will be at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cogging {
    /// Largest current of the table, A.
    pub largest_a: f32,
    /// Its RMS, A.
    pub rms_a: f32,
}
