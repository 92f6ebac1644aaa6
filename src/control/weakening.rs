//! A current −d against the magnets' field, for one of two reasons.
//!
//! Field weakening, for speeds whose back-EMF the supply's voltage does not reach.
//! A current −d takes ω L d off the voltage that a speed needs. How much is needed follows from the voltage itself: a small
//! share of the longest vector is kept free, by an integrator whose gain is that of the motor where its back-EMF takes all
//! of the voltage. Neither resistance, saturation nor a wrong flux linkage moves where that settles.
//!
//! A motor whose voltage goes into its resistance gains nothing by it: below half of that speed nothing is weakened.
//!
//! The most torque per ampere, where the inductance across the magnets is larger than along them: of all currents that
//! make the torque 1.5 p (λ + (Lq − Ld) d) q, the shortest has d² − d λ/(Lq − Ld) = q² for d against the field. The
//! current against the field is never less than that d, whatever the voltage.

use crate::commutation::svpwm::LONGEST;
use crate::float::whole_i16;

/// What is kept free of the longest vector: 4.4 %, which noise and a change of the load need.
const FREE: i32 = 1 << 17;

/// Share by which each step of the integrator corrects what is missing, of what would make it up in one: 20 Hz for 128
/// control periods of 25 µs.
const CORRECTS: f32 = 0.4;

/// In the units of the interrupt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gains {
    /// Current, in 2⁻²⁸ of the full scale, per voltage of which [`LONGEST`] is the longest.
    gain: i16,
    /// Largest current, in 2⁻¹³ of the full scale; 0: none.
    most: i16,
    /// Current at which reluctance makes as much torque as the magnets, λ/(Lq − Ld), in 2⁻¹⁵ of the full scale.
    reluctance: u32,
}

/// A current of reluctance that no motor gets near.
const NO_RELUCTANCE: u32 = 1 << 30;

impl Gains {
    /// For the largest current, and the one that takes all of the magnets' flux off the winding, λ/Ld; shares of the full
    /// scale. `reluctance` is (Lq − Ld)/λ per full scale: the torque that a current against the field adds, relative to
    /// the magnets'. `largest` is that along q, in 2⁻¹⁵ of the full scale: from twice that torque at it on, a little less
    /// than the shortest current is given up, and the first step from rest asks for no more along d than half of that along q.
    pub fn new(most: f32, short: f32, reluctance: f32, largest: f32) -> Self {
        // In a product with the longest vector within 32 bits.
        let gain = (short * (CORRECTS * 268_435_456.0 / LONGEST as f32)).min(600.0);
        let reluctance = (32_768.0 / reluctance).max(0.5 * largest) as u32;
        let reluctance = reluctance.min(NO_RELUCTANCE);
        Self { gain: whole_i16(gain) + 1, most: whole_i16(most * 8192.0), reluctance }
    }
}

/// The current against the field: by an integrator where the voltage asks for it, by the torque where that asks for more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weakening {
    /// In 2⁻²⁸ of the full scale.
    current: i32,
    /// Largest for the voltage at the present speed, in the same unit.
    most: i32,
    /// For the torque, in the same unit.
    least: i32,
}

impl Weakening {
    /// No current.
    pub const NONE: Self = Self { current: 0, most: 0, least: 0 };

    /// Takes up the back-EMF, in the unit of [`LONGEST`], and the largest current that heat allows, in 2⁻²⁸ of the full
    /// scale. Nothing up to a back-EMF of half of the longest vector, all of the setting from 7/8 of it on.
    #[inline(always)]
    pub fn limit(&mut self, gains: &Gains, induced: i32, most: i32) {
        let beyond = (induced.abs() - (3 << 19)).clamp(0, (1 << 20) - 1);
        self.most = most.min((beyond >> 5) * i32::from(gains.most));
        self.current = self.current.min(self.most).max(self.least);
    }

    /// Takes up the current along q, in 2⁻¹⁵ of the full scale. The root is approached by the continued fraction
    /// d = q²/(λ/(Lq − Ld) + d), a quarter of the way each time.
    #[inline(always)]
    pub const fn share_torque(&mut self, gains: &Gains, q: i32) {
        let d = self.least as u32 >> 13;
        let d = (3 * d + (q * q) as u32 / ((gains.reluctance + d) | 1)) / 4;
        self.least = (d << 13) as i32;
    }

    /// Whether the back-EMF takes so much of the voltage that the field may be weakened.
    #[inline(always)]
    pub const fn is_allowed(&self) -> bool {
        self.most != 0
    }

    /// Whether the field is weakened, or has to be: by the current along d and by what the voltage leaves of the longest
    /// vector.
    #[inline(always)]
    pub const fn is_needed(&self, along_d: i32, free: i32) -> bool {
        self.is_allowed() && (along_d != 0 || free < FREE)
    }

    /// One step, from the present current along d, which may be more than was asked for here.
    #[inline(always)]
    pub fn step(&mut self, gains: &Gains, along_d: i32, free: i32) {
        // Down no faster than up: a bus that braking lifts has more voltage, and needs what the current burns.
        let missing = (FREE - free).max(-FREE);
        self.current = (missing * i32::from(gains.gain) - along_d).min(self.most).max(self.least);
    }

    /// The current, in 2⁻²⁸ of the full scale.
    #[inline(always)]
    pub const fn current(&self) -> i32 {
        self.current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// d for a current along q, in 2⁻¹⁵, after so many steps, with λ/Ld the full scale.
    fn shared(saliency: f32, q: i32, steps: usize) -> f64 {
        let (gains, mut weakening) = (Gains::new(0.0, 1.0, (saliency - 1.0).max(0.0), 32_767.0), Weakening::NONE);
        (0..steps).for_each(|_| weakening.share_torque(&gains, q));
        weakening.limit(&gains, 0, 0);
        f64::from(weakening.current()) / 8192.0
    }

    #[test]
    fn the_shortest_current_makes_the_torque() {
        // Beyond a saliency of 3, the reluctance is more than twice the magnets' torque at the largest current.
        for (saliency, longer) in [(1.1_f32, 1.0), (1.5, 1.0), (3.0, 1.0), (8.0, 1.05)] {
            for q in [100, 3000, -20_000, 32_767] {
                let full = 32_768.0;
                let (q_share, more) = (f64::from(q) / full, f64::from(saliency) - 1.0);
                // Shortest by search, of those that make the torque of what was chosen.
                let chosen = shared(saliency, q, 40) / full;
                let torque = (1.0 + more * chosen) * q_share;
                let length = |d: f64| libm::hypot(d, torque / (1.0 + more * d));
                let best = (0..40_000).map(|k| length(f64::from(k) / 40_000.0)).fold(f64::INFINITY, f64::min);
                assert!(
                    length(chosen) < longer * best + 2.0 / full,
                    "{saliency} {q}: {chosen}, {} {best}",
                    length(chosen)
                );
            }
        }
    }

    /// A torque that begins at once, of the motor with the largest reluctance that settings can tell.
    #[test]
    fn it_is_never_larger_than_the_current_along_q() {
        for reluctance in [0.1, 1.0, 30.0, 1e3, 1e9, f32::INFINITY] {
            for q in [1, 500, 10_000, -32_767] {
                let (gains, mut weakening) = (Gains::new(0.0, 1.0, reluctance, 32_767.0), Weakening::NONE);
                for _ in 0..20 {
                    weakening.share_torque(&gains, q);
                    weakening.limit(&gains, 0, 0);
                    let d = weakening.current() >> 13;
                    assert!((0..=q.abs() + 1).contains(&d), "{reluctance} {q}: {d}");
                }
            }
        }
    }

    #[test]
    fn it_settles_within_a_few_steps_and_is_none_without_reluctance() {
        for (saliency, q) in [(1.2, 5000), (8.0, 32_767), (8.0, 100)] {
            let end = shared(saliency, q, 100);
            assert!((shared(saliency, q, 16) - end).abs() <= 2.0 + end / 50.0, "{saliency} {q}");
        }
        for saliency in [0.25, 1.0] {
            assert_eq!(shared(saliency, 32_767, 100), 0.0);
        }
    }
}
