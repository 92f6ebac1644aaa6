//! The shape of the back-EMF over the electrical angle.

use crate::error::{Error, finite, not_negative, positive, require};
use crate::phasor::{Phasor, wrapped};
use core::f64::consts::{FRAC_PI_2, PI};

/// Course of a phase's back-EMF over one electrical turn, with a peak of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// -sin θe in phase A.
    Sinusoidal,
    /// The trapezoid about -sin θe, with straight flanks.
    Trapezoidal {
        /// Length of each flat top in electrical degrees, 0 to 170; ideally 120.
        flat_deg: f64,
    },
}

/// Which winding follows phase A as the electrical angle grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseSequence {
    /// B lags A by 120°.
    Abc,
    /// C lags A by 120°, as if two motor leads were exchanged.
    Acb,
}

/// Back-EMF of the three windings, phase to star point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackEmf {
    /// Peak of the shape per electrical angular speed, V·s/rad; with a sinusoidal shape this is the
    /// flux λ that the magnets link with a phase, in Wb.
    pub flux_linkage_vs: f64,
    /// Shape that the harmonics are added to.
    pub shape: Shape,
    /// Third harmonic relative to the peak, -h·sin 3θe. It drives no current into a star, but moves
    /// the star point and with it the terminal of a floating phase.
    pub third: f64,
    /// Fifth harmonic, relative to the peak.
    pub fifth: f64,
    /// Seventh harmonic, relative to the peak.
    pub seventh: f64,
    /// Order of the phases.
    pub sequence: PhaseSequence,
}

impl BackEmf {
    /// Sinusoidal, without harmonics.
    #[must_use]
    pub const fn sinusoidal(flux_linkage_vs: f64) -> Self {
        Self {
            flux_linkage_vs,
            shape: Shape::Sinusoidal,
            third: 0.0,
            fifth: 0.0,
            seventh: 0.0,
            sequence: PhaseSequence::Abc,
        }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        positive(self.flux_linkage_vs, "motor.back_emf.flux_linkage_vs")?;
        if let Shape::Trapezoidal { flat_deg } = self.shape {
            not_negative(flat_deg, "motor.back_emf.shape.flat_deg")?;
            require(flat_deg <= 170.0, "motor.back_emf.shape.flat_deg", "at most 170")?;
        }
        finite(self.third, "motor.back_emf.third")?;
        finite(self.fifth, "motor.back_emf.fifth")?;
        finite(self.seventh, "motor.back_emf.seventh")
    }

    /// Back-EMF of each phase per electrical angular speed, V·s/rad, which also is the torque per
    /// ampere and pole pair.
    ///
    /// `at` is the phasor of `electrical_rad`; only the trapezoid needs the angle itself.
    pub(crate) fn at(&self, at: Phasor, electrical_rad: f64) -> [f64; 3] {
        let mut sum = match self.shape {
            Shape::Sinusoidal => at.three_phase(),
            Shape::Trapezoidal { flat_deg } => {
                let inverse_flank = 1.0 / ((180.0 - flat_deg) * (PI / 360.0));
                [0.0, -2.0 * PI / 3.0, 2.0 * PI / 3.0].map(|shift| trapezoid(electrical_rad + shift, inverse_flank))
            }
        };
        if self.third != 0.0 || self.fifth != 0.0 || self.seventh != 0.0 {
            self.add_harmonics(at, &mut sum);
        }
        if self.sequence == PhaseSequence::Acb {
            sum.swap(1, 2);
        }
        sum.map(|value| -self.flux_linkage_vs * value)
    }

    fn add_harmonics(&self, at: Phasor, sum: &mut [f64; 3]) {
        let second = at.plus(at);
        let third = second.plus(at);
        let fifth = third.plus(second);
        let seventh = fifth.plus(second);
        // A phase shift of 120° is five (seven) times that for the fifth (seventh): -120°, +120°.
        let [f0, f2, f1] = fifth.three_phase();
        let [s0, s1, s2] = seventh.three_phase();
        for (value, (f, s)) in sum.iter_mut().zip([(f0, s0), (f1, s1), (f2, s2)]) {
            *value += self.third * third.sin + self.fifth * f + self.seventh * s;
        }
    }
}

/// Trapezoid in the place of a sine.
fn trapezoid(angle_rad: f64, inverse_flank: f64) -> f64 {
    let angle = wrapped(angle_rad);
    let side = angle.abs();
    let folded = if side > FRAC_PI_2 { PI - side } else { side };
    let height = folded * inverse_flank;
    let height = if height > 1.0 { 1.0 } else { height };
    if angle < 0.0 { -height } else { height }
}
