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

/// The vector product.
#[cfg_attr(feature = "small", inline(never))]
fn cross(a: &[f32; 3], b: &[f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Inverse {
    pub fn new(model: &Model) -> Self {
        // The columns of F.
        let (mut of_cosine, mut of_sine) = ([0.0; 3], [0.0; 3]);
        for (k, sensor) in model.sensors.iter().enumerate() {
            let (sine, cosine) = sin_cos_f32(sensor.placement);
            (of_cosine[k], of_sine[k]) = (-sine, cosine);
        }
        // The vector that no angle explains, orthogonal to both, tells which sensors are upside down.
        let null = cross(&of_cosine, &of_sine);
        let s = null.map(|component| if component * null[0] < 0.0 { -1.0 } else { 1.0 });
        let determinant: f32 = (0..3).map(|k| null[k] * s[k]).sum();
        let mut inverse = Self { cosine: cross(&of_sine, &s), sine: cross(&s, &of_cosine), common: null };
        for row in [&mut inverse.cosine, &mut inverse.sine, &mut inverse.common] {
            row.iter_mut().for_each(|component| *component /= determinant);
        }
        inverse
    }

    /// Of the two sensors other than `lost`; nothing is left to check them by.
    pub fn without(lost: Channel, model: &Model) -> Self {
        let (a, b) = match lost.0 {
            0 => (1, 2),
            1 => (2, 0),
            _ => (0, 1),
        };
        // r = sin θ · cos ψ − cos θ · sin ψ for both, solved for cosine and sine.
        let (sin_a, cos_a) = sin_cos_f32(model.sensors[a].placement);
        let (sin_b, cos_b) = sin_cos_f32(model.sensors[b].placement);
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
