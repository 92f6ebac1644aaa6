//! The current that friction and cogging take.

use crate::angle::Position;
use crate::control::config::Config;
use crate::telemetry::Measurement;

/// The current that friction and cogging take, at the middle between two measurements: what flows less what accelerates
/// the rotor. So it is right also where the speed control does not hold the speed.
#[derive(Clone, Debug, Default)]
pub struct Taken {
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    position: Position,
    speed: i32,
    sequence: u32,
    current: i32,
}

/// Longest time between two measurements, in steps.
const LONGEST_GAP: u32 = 512;

impl Taken {
    /// Before the first.
    pub const NONE: Self = Self { last: None };

    /// Takes a measurement; the position in the middle, and the current in 2⁻¹⁵ of the full scale.
    pub fn take(&mut self, measurement: &Measurement, config: &Config) -> Option<(Position, f32)> {
        let Measurement { rotor, sequence, state, .. } = measurement;
        let now = Last {
            position: rotor.position(),
            speed: rotor.speed(),
            sequence: *sequence,
            current: state.current_reference,
        };
        let last = self.last.replace(now)?;
        let steps = sequence.wrapping_sub(last.sequence);
        if steps == 0 || steps > LONGEST_GAP {
            return None;
        }
        let way = now.position.to_bits().wrapping_sub(last.position.to_bits());
        let middle = Position::from_bits(last.position.to_bits().wrapping_add(way / 2));
        let accelerates = config.current_per_speed_change() * (now.speed - last.speed) as f32 / steps as f32;
        Some((middle, 0.5 * (last.current + now.current) as f32 - accelerates))
    }
}
