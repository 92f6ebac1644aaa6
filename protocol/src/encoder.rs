//! The absolute encoder: what can be asked of a drive that has one, and what it answers. Only with the feature `encoder`,
//! so that other drives have none of it.

use crate::status::Problem;
use hallservo::service::encoder::Error;
use hallservo::vernier::calibrate::Report;
use hallservo::vernier::continuity::Fault;
use hallservo::vernier::settings;
use serde::{Deserialize, Serialize};

/// What can be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EncoderAsk {
    /// How it is: [`Answer::Encoder`](crate::Answer::Encoder).
    Status,
    /// Turn the shaft a few times and find out what the heads deliver, from a drive that is ready; or let a hand turn it,
    /// with the bridge off.
    Calibrate {
        /// Whether a hand turns it.
        by_hand: bool,
    },
    /// The shaft is at zero where it is now; stored.
    Zero,
    /// Other rings. A calibration is given up.
    Rings {
        /// Pole pairs of the ring that gives the fine angle.
        reference: u8,
        /// Pole pairs of the other.
        vernier: u8,
    },
    /// There are no rings any more: calibration and zero are given up, in the flash as well.
    Forget,
    /// The Halls take their electrical zero from the encoder, where the shaft rests; stored.
    Align,
}

/// What became of the last calibration since power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum EncoderCalibration {
    /// There was none.
    #[default]
    None,
    /// It is at work. By hand: why the last attempt was not fit, if there was one.
    Running(Option<Error>),
    /// What the calibration is worth.
    Done(Report),
    /// Why there is none; the one before is kept.
    Failed(Error),
}

/// How the encoder is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EncoderStatus {
    /// Pole pairs of the rings, the reference first.
    pub pairs: [u8; 2],
    /// Heads over each.
    pub heads: u8,
    /// Whether it is calibrated.
    pub calibrated: bool,
    /// Whether it is known how it sits on the rotor's shaft.
    pub mounted: bool,
    /// Whether the drive's position counts from the encoder's zero.
    pub absolute: bool,
    /// Whether motion since power-up has shown every head to follow.
    pub proven: bool,
    /// Whether it closes the loops at the moment.
    pub used: bool,
    /// The shaft's angle from the zero, mechanical degrees, −180 to 180; not a number while there is none.
    pub angle_deg: f32,
    /// Why there is none at the moment.
    pub fault: Option<Fault>,
    /// The last reason since power-up.
    pub last_fault: Option<Fault>,
    /// Samples without an angle since power-up, of those that reach the tasks.
    pub missed: u32,
    /// The largest residual since it was asked for last, the limit, and what a wrong pole pair would take: in counts of
    /// the other ring's head.
    pub residual_counts: [f32; 3],
    /// By how much the Halls are ahead of it, electrical degrees, averaged; not a number where that is unknown.
    pub halls_ahead_deg: f32,
    /// How far they may be at power-up.
    pub tolerance_deg: f32,
    /// The last calibration since power-up.
    pub calibration: EncoderCalibration,
    /// What the flash holds of it.
    pub stored: Problem,
    /// Largest speed that the encoder follows, mechanical rad/s.
    pub fastest_rad_s: f32,
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum EncoderRefusal {
    /// This board has no heads.
    None,
    /// A setting cannot be changed so.
    Setting(settings::Error),
    /// The calibration cannot begin.
    Calibration(Error),
    /// It has to be calibrated first.
    NotCalibrated,
    /// It has no angle.
    NoAngle(Option<Fault>),
    /// The position does not count from the encoder's zero: by so many electrical degrees the Halls do not agree, if that
    /// is why.
    NotAbsolute(Option<f32>),
    /// The Halls are ahead by so many electrical degrees: too far for their zero to be taken from the encoder.
    HallsTooFar(f32),
}
