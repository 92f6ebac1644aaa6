//! The matrix by which three signals become cosine, sine and what they have in common.

use crate::hall::Channel;
use crate::hall::model::Model;
use crate::hall::plausibility::Window;
use crate::trig::sin_cos_f32;

/// Largest plausible disagreement c of the sensors, relative to their amplitude.
pub const DISAGREEMENT: f32 = 0.3;

/// The inverse of (F, s): what to take of each normalised signal for cosine, sine and what is common.
pub(super) struct Inverse {
    pub cosine: [f32; 3],
    pub sine: [f32; 3],
    pub common: [f32; 3],
}

impl Inverse {
    pub fn new(model: &Model) -> Self {
        let f = model.sensors.map(|s| {
            let (sine, cosine) = sin_cos_f32(s.placement);
            [-sine, cosine]
        });
        let minor = |i: usize, k: usize| f[i][0] * f[k][1] - f[i][1] * f[k][0];
        // The vector that no angle explains, orthogonal to both columns of F, tells which sensors are upside down.
        let null = [minor(1, 2), minor(2, 0), minor(0, 1)];
        let s = null.map(|component| if component * null[0] < 0.0 { -1.0 } else { 1.0 });
        let determinant: f32 = (0..3).map(|k| null[k] * s[k]).sum();
        let cosine =
            [f[1][1] * s[2] - f[2][1] * s[1], f[2][1] * s[0] - f[0][1] * s[2], f[0][1] * s[1] - f[1][1] * s[0]];
        let sine = [f[2][0] * s[1] - f[1][0] * s[2], f[0][0] * s[2] - f[2][0] * s[0], f[1][0] * s[0] - f[0][0] * s[1]];
        let divide = |row: [f32; 3]| row.map(|component| component / determinant);
        Self { cosine: divide(cosine), sine: divide(sine), common: divide(null) }
    }

    /// Of the two sensors other than `lost`; nothing is left to check them by.
    pub fn without(lost: Channel, model: &Model) -> Self {
        let (a, b) = match lost.0 {
            0 => (1, 2),
            1 => (2, 0),
            _ => (0, 1),
        };
        // r = sin θ · cos ψ − cos θ · sin ψ for both, solved for cosine and sine.
        let [(sin_a, cos_a), (sin_b, cos_b)] = [a, b].map(|k| sin_cos_f32(model.sensors[k].placement));
        let determinant = sin_b * cos_a - cos_b * sin_a;
        let (mut cosine, mut sine) = ([0.0; 3], [0.0; 3]);
        (cosine[a], cosine[b]) = (cos_b / determinant, -cos_a / determinant);
        (sine[a], sine[b]) = (sin_b / determinant, -sin_a / determinant);
        Self { cosine, sine, common: [0.0; 3] }
    }

    /// RMS angle noise over the turn, relative to three equal sensors 120° apart. Not a number counts as infinite.
    pub fn noise_gain(&self) -> f32 {
        let power: f32 = self.cosine.iter().chain(&self.sine).map(|w| w * w).sum();
        // Half the sum over both rows is the mean over the turn; at 120° it is 2/3.
        let gain = crate::float::root(power * 0.5 * 1.5);
        if gain.is_finite() { gain } else { f32::INFINITY }
    }

    /// What one amplitude is in the integers, so that no row overflows anywhere in the window.
    pub fn unit(&self, model: &Model, window: Window) -> f32 {
        let (low, high) = window.bounds();
        let largest = model.sensors.map(|sensor| {
            let farthest = (sensor.offset - f32::from(low)).max(f32::from(high) - sensor.offset);
            // One that is not there has no weight in any row.
            if sensor.amplitude > 0.0 { farthest / sensor.amplitude } else { 0.0 }
        });
        let reach = |row: &[f32; 3]| (0..3).map(|k| row[k].abs() * largest[k]).sum::<f32>();
        let worst = reach(&self.cosine).max(reach(&self.sine)).max(reach(&self.common) + DISAGREEMENT);
        // One per cent for rounding of the gains; at least two, for which the table is centred.
        2_147_483_648.0 * 0.99 / worst.max(2.0)
    }

    pub fn apply(&self, signals: [f32; 3]) -> (f32, f32) {
        let dot = |row: &[f32; 3]| row[0] * signals[0] + row[1] * signals[1] + row[2] * signals[2];
        (dot(&self.cosine), dot(&self.sine))
    }
}
