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
    /// What noise leaves with it, tracked.
    pub with_deg: f32,
    /// Whether it is kept: it is worth more than the noise.
    pub kept: bool,
    /// Whether the pole can be told after power-up, from a rotor that turns as the map says.
    pub found_again: bool,
}

/// The cogging that differs from pole to pole, as learnt with the rest of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CoggingByPole {
    /// What it is used for.
    pub state: Use,
    /// Current that compensates it, A RMS; 0 where there is none.
    pub rms_a: f32,
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
    /// How well the best pole fits against the next best, or no map: 1 if it is right, −1 if the other is; 0.5 is wanted.
    /// Not a number before the first turn.
    pub fit: f32,
    /// What was left over of single samples, electrical degrees RMS.
    pub left_deg: f32,
    /// What the flash holds of it.
    pub stored: Problem,
    /// The cogging, whose poles are told apart by itself.
    pub cogging: CoggingByPole,
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MagnetsRefusal {
    /// There is no map.
    None,
    /// There is an encoder on the shaft, which knows the angle better.
    Encoder,
}
