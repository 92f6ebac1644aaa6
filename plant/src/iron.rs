//! What iron does to the inductance: it differs along and across the magnets, and it saturates.

use crate::emf::PhaseSequence;
use crate::error::{Error, positive, require};
use crate::phasor::Phasor;

/// Salience and saturation of the windings' own flux.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iron {
    /// Difference of the inductances across and along the magnets' field over their sum, (Lq − Ld)/(Lq + Ld): 0.2 for
    /// 0.2 and 0.3 mH, with `inductance_h` of 0.25 mH. Magnets inside the rotor make it positive.
    pub salience: f64,
    /// Current whose flux is 1/√2 of what it would be without saturation, A.
    pub saturation_a: f64,
}

impl Iron {
    /// The same inductance in every direction, whatever the current.
    pub const NONE: Self = Self { salience: 0.0, saturation_a: f64::INFINITY };

    pub(crate) fn check(&self) -> Result<(), Error> {
        require(self.salience.abs() <= 0.5, "motor.iron.salience", "from -0.5 to 0.5")?;
        if self.saturation_a == f64::INFINITY { Ok(()) } else { positive(self.saturation_a, "motor.iron.saturation_a") }
    }

    /// Whether there is anything to it.
    pub(crate) fn acts(&self) -> bool {
        *self != Self::NONE
    }

    /// Flux along d and q less what `inductance_h` links: the derivatives of the co-energy F(u), u = (Ld d² + Lq q²)/2,
    /// so that no motion makes energy of nothing. F′ = 1/√(1 + 2u/(L I²)).
    fn beyond(&self, inductance_h: f64, [d, q]: [f64; 2]) -> [f64; 2] {
        let [along, across] = [1.0 - self.salience, 1.0 + self.salience];
        let share = (along * d * d + across * q * q) / (self.saturation_a * self.saturation_a);
        let saturated = 1.0 / libm::sqrt(1.0 + share);
        [inductance_h * (along * saturated - 1.0) * d, inductance_h * (across * saturated - 1.0) * q]
    }
}

/// Directions of d and q in the three phases at an angle.
pub(crate) struct Axes {
    d: [f64; 3],
    q: [f64; 3],
}

impl Axes {
    pub fn new(at: Phasor, sequence: PhaseSequence) -> Self {
        let mut axes =
            Self { d: Phasor { sin: at.cos, cos: -at.sin }.three_phase(), q: at.three_phase().map(|sine| -sine) };
        if sequence == PhaseSequence::Acb {
            axes.d.swap(1, 2);
            axes.q.swap(1, 2);
        }
        axes
    }

    /// Components of three currents.
    fn of(&self, currents_a: &[f64; 3]) -> [f64; 2] {
        [&self.d, &self.q].map(|axis| axis.iter().zip(currents_a).map(|(a, i)| a * i).sum::<f64>() * (2.0 / 3.0))
    }

    /// Flux of each phase beyond what `inductance_h` links.
    pub fn flux_beyond_vs(&self, iron: &Iron, inductance_h: f64, currents_a: &[f64; 3]) -> [f64; 3] {
        let [d, q] = iron.beyond(inductance_h, self.of(currents_a));
        [0, 1, 2].map(|k| d * self.d[k] + q * self.q[k])
    }

    /// Torque per pole pair by that flux.
    pub fn torque_beyond_nm(&self, iron: &Iron, inductance_h: f64, currents_a: &[f64; 3]) -> f64 {
        let [d, q] = self.of(currents_a);
        let [along, across] = iron.beyond(inductance_h, [d, q]);
        1.5 * (along * q - across * d)
    }
}
