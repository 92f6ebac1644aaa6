//! The map of the rotor's magnets: what can be asked of a drive that learns one, and what it answers. Only with the
//! feature `map`, so that other drives have none of it.

use crate::report::Procedure;
use crate::status::Problem;
use hallservo::service::magnets::Use;
use serde::{Deserialize, Serialize};

/// Points of the map in an answer.
pub const POINTS_AT_ONCE: usize = 32;

/// What can be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MagnetsAsk {
    /// Turn both ways, freely, and learn what the magnets do to the angle, from a drive that is ready.
    Learn,
    /// How it is: [`Answer::Magnets`](crate::Answer::Magnets).
    Status,
    /// Points of the map from a number on: [`Answer::MagnetPoints`](crate::Answer::MagnetPoints).
    Points(u16),
    /// The map is given up, in the flash as well.
    Forget,
}

/// What was learnt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MagnetsReport {
    /// What the angle is wrong by without the map, electrical degrees RMS.
    pub without_deg: f32,
    /// With it.
    pub with_deg: f32,
    /// Whether it is kept: it is worth more than the noise.
    pub kept: bool,
    /// Whether the pole can be told after power-up, from a rotor that turns as the map says.
    pub found_again: bool,
}

/// How the map is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MagnetsStatus {
    /// What it is used for.
    pub state: Use,
    /// Pole pairs of its rotor; 0 where there is none.
    pub pole_pairs: u8,
    /// What was learnt, where there is a map.
    pub report: MagnetsReport,
    /// The last learning since power-up.
    pub learning: Procedure<MagnetsReport>,
    /// Mechanical turns since the search for the pole began, or since it was found.
    pub turns: u32,
    /// What the next best pole, or no map, has left over in the last turn, in powers of what the best has; 3 is wanted,
    /// twice. Not a number before there is one.
    pub margin: f32,
    /// What was left over in the last turn, electrical degrees RMS.
    pub left_deg: f32,
    /// What the flash holds of it.
    pub stored: Problem,
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MagnetsRefusal {
    /// There is no map.
    None,
    /// There is an encoder on the shaft, which knows the angle better.
    Encoder,
}
