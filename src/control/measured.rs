//! Measured currents in SI.

use super::Config;
use crate::commutation::frames::{AlphaBeta, Dq, Rotation};
use crate::telemetry::Measurement;

impl Measurement {
    /// Currents along d and q at the rotor's angle, as the alignment is trimmed, A; of the phases, so whatever the
    /// drive follows.
    pub fn current_a(&self, control: &Config) -> [f32; 2] {
        let [a, b, c] = self.state.phases;
        let [b, c] = if control.modulator.is_reversed() { [c, b] } else { [b, c] };
        // Finer than the phases by 2¹⁰, of which the transform takes 2².
        let vector =
            AlphaBeta { alpha: (2 * a - b - c) * 1024 / 3, beta: ((b - c) as f32 * (1024.0 * 0.577_350_26)) as i32 };
        let Dq { d, q } = Rotation::of_tasks(self.rotor.angle() + self.trim).park(vector);
        let amperes = |current: i32| current as f32 / 256.0 / control.scale.per_ampere();
        [amperes(d), amperes(q)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::ElectricalAngle;
    use crate::settings::{Control, Settings};
    use crate::telemetry::State;

    #[test]
    fn phases_are_currents_along_d_and_q() {
        for (degrees, reversed) in [(0.0_f32, false), (50.0, false), (200.0, true)] {
            let settings = Settings { reversed, control: Some(Control::default()), ..Settings::default() };
            let control = settings.validate().unwrap().control.unwrap();
            // 12 000 along q and 5000 along d, in the order of the phases.
            let phase = |lead: f32| {
                let (sin, cos) = libm::sincosf((degrees - lead).to_radians());
                (5000.0 * cos - 12_000.0 * sin) as i32
            };
            let [a, b, c] = [phase(0.0), phase(120.0), phase(240.0)];
            let state = State { phases: if reversed { [a, c, b] } else { [a, b, c] }, ..State::default() };
            let measurement = Measurement { state, trim: ElectricalAngle::from_degrees(degrees), ..Measurement::NONE };
            let exact = [5000.0, 12_000.0].map(|current| current / 32_768.0 * 8.25);
            let found = measurement.current_a(&control);
            assert!((0..2).all(|k| (found[k] - exact[k]).abs() < 2e-3), "{found:?} {exact:?}");
        }
    }
}
