//! Field weakening: a current against the magnets' field, for speeds whose back-EMF the supply's voltage does not reach.
//!
//! A current −d takes ω L d off the voltage that a speed needs. How much is needed follows from the voltage itself: a small
//! share of the longest vector is kept free, by an integrator whose gain is that of the motor where its back-EMF takes all
//! of the voltage. Neither resistance, saturation nor a wrong flux linkage moves where that settles.
//!
//! A motor whose voltage goes into its resistance gains nothing by it: below half of that speed nothing is weakened.

use crate::commutation::svpwm::LONGEST;

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
}

impl Gains {
    /// For the largest current, and the one that takes all of the magnets' flux off the winding, λ/L; shares of the full
    /// scale.
    pub fn new(most: f32, short: f32) -> Self {
        // In a product with the longest vector within 32 bits.
        let gain = (short * (CORRECTS * 268_435_456.0 / LONGEST as f32)).min(600.0);
        Self { gain: gain as i16 + 1, most: (most * 8192.0) as i16 }
    }
}

/// The current against the field, by an integrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weakening {
    /// In 2⁻²⁸ of the full scale.
    current: i32,
    /// Largest at the present speed, in the same unit.
    most: i32,
}

impl Weakening {
    /// No current.
    pub const NONE: Self = Self { current: 0, most: 0 };

    /// Takes up the back-EMF, in the unit of [`LONGEST`], and the largest current that heat allows, in 2⁻²⁸ of the full
    /// scale. Nothing up to a back-EMF of half of the longest vector, all of the setting from 7/8 of it on.
    #[inline(always)]
    pub fn limit(&mut self, gains: &Gains, induced: i32, most: i32) {
        let beyond = (induced.abs() - (3 << 19)).clamp(0, (1 << 20) - 1);
        self.most = most.min((beyond >> 5) * i32::from(gains.most));
        self.current = self.current.min(self.most);
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
        self.current = (missing * i32::from(gains.gain) - along_d).min(self.most).max(0);
    }

    /// The current, in 2⁻²⁸ of the full scale.
    #[inline(always)]
    pub const fn current(&self) -> i32 {
        self.current
    }
}
