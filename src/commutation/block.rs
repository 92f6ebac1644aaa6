//! Block commutation: the six-step table of Simpkins and Todorov, Fig. 5.
//!
//! In each sixth of a turn two legs are driven against each other and the third is open. Twice the deviation from one
//! half lies across the two, so a command M puts `M · V_bus` between them.

use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output};
use crate::commutation::sinusoidal::PhaseOrder;
use crate::pwm::Amplitude;

/// A sixth of the electrical turn: number k runs from `k · 60°` to `(k + 1) · 60°`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sextant {
    /// 0° to 60°.
    First,
    /// 60° to 120°.
    Second,
    /// 120° to 180°.
    Third,
    /// 180° to 240°.
    Fourth,
    /// 240° to 300°.
    Fifth,
    /// 300° to 360°.
    Sixth,
}

/// In the order of the angle.
const SEXTANTS: [Sextant; 8] = {
    use Sextant::*;
    // Eight, so that three bits are always an index; the last two are never reached.
    [First, Second, Third, Fourth, Fifth, Sixth, Sixth, Sixth]
};

/// What the legs do where the vector is to point into a sextant: up, down or open. The vector of each step points at
/// the sextant's middle.
const STEPS: [[i8; 3]; 6] = [[1, 0, -1], [0, 1, -1], [-1, 1, 0], [-1, 0, 1], [0, -1, 1], [1, -1, 0]];

impl Sextant {
    /// The sextant of an angle.
    #[inline(always)]
    pub const fn of(angle: ElectricalAngle) -> Self {
        SEXTANTS[((angle.to_bits() as u32 as u64 * 6) >> 32) as usize & 7]
    }

    /// The sextant of an angle, or still this one while the angle is less than half a degree outside, so that noise at
    /// the border does not step to and fro.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn follow(self, angle: ElectricalAngle) -> Self {
        const SIXTH: i64 = (1 << 32) / 6;
        const MARGIN: u32 = ((1_u64 << 32) / 720) as u32;
        let begin = (self as i64 * SIXTH) as u32;
        let into = (angle.to_bits() as u32).wrapping_sub(begin).wrapping_add(MARGIN);
        if into <= SIXTH as u32 + 2 * MARGIN { self } else { Self::of(angle) }
    }

    /// From three switching Halls at 0°, 120° and 240°, high where their signal is positive: the code in Fig. 5. Of
    /// sensors 60° apart the middle one is the one at 240° upside down. `None` when all three are alike: no magnet
    /// makes that.
    pub fn of_switching_halls(high: [bool; 3]) -> Option<Self> {
        // The signs of sin θ, sin(θ − 120°) and sin(θ − 240°) within each sextant of θ.
        match high {
            [true, false, true] => Some(Self::First),
            [true, false, false] => Some(Self::Second),
            [true, true, false] => Some(Self::Third),
            [false, true, false] => Some(Self::Fourth),
            [false, true, true] => Some(Self::Fifth),
            [false, false, true] => Some(Self::Sixth),
            _ => None,
        }
    }

    /// The sextant that follows.
    pub const fn next(self) -> Self {
        if self as usize == 5 { Self::First } else { SEXTANTS[self as usize + 1] }
    }

    /// Which legs pull up and down in the step of this sextant, 0 to 2.
    #[inline(always)]
    pub const fn conducting(self, order: PhaseOrder) -> (usize, usize) {
        const PAIRS: [(u8, u8); 6] = [(0, 2), (1, 2), (1, 0), (2, 0), (2, 1), (0, 1)];
        const REVERSED: [(u8, u8); 6] = [(0, 1), (2, 1), (2, 0), (1, 0), (1, 2), (0, 2)];
        let (up, down) = if order.is_forward() { PAIRS[self as usize] } else { REVERSED[self as usize] };
        (up as usize, down as usize)
    }

    /// The step whose vector points at the middle of this sextant; a negative amplitude points it the other way.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn output(self, order: PhaseOrder, amplitude: Amplitude, half: u16) -> Output {
        let [a, second, third] = STEPS[self as usize];
        let (b, c) = if order.is_forward() { (second, third) } else { (third, second) };
        let counts = amplitude.counts();
        let compare =
            [half as i32 + a as i32 * counts, half as i32 + b as i32 * counts, half as i32 + c as i32 * counts];
        let open = if a == 0 {
            0
        } else if b == 0 {
            1
        } else {
            2
        };
        Output { compare: [compare[0] as u16, compare[1] as u16, compare[2] as u16], legs: Legs::without(open) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commutation::Modulation;
    use crate::pwm::Limits;
    use crate::trig;

    #[test]
    fn the_vector_of_a_step_is_within_thirty_degrees() {
        let limits = Limits::new(2000, 0, 2000).unwrap();
        let amplitude = limits.amplitude(Modulation::from_num(0.5));
        for tenth in 0..3600 {
            let angle = ElectricalAngle::from_degrees(tenth as f32 / 10.0 + 0.05);
            for (order, sign) in [(PhaseOrder::FORWARD, 1.0), (PhaseOrder::REVERSED, -1.0)] {
                let output = Sextant::of(angle).output(order, amplitude, limits.half());
                let [a, b, c] = output.compare.map(|compare| f32::from(compare) - 1000.0);
                let vector = libm::atan2f((b - c) / 3.0_f32.sqrt(), a).to_degrees() * sign;
                let off = (ElectricalAngle::from_degrees(vector) - angle).to_degrees();
                assert!(off.abs() <= 30.0, "{angle} {vector}");
                assert_eq!(a + b + c, 0.0);
                let (up, down) = Sextant::of(angle).conducting(order);
                assert!(output.compare[up] > 1000 && output.compare[down] < 1000);
                let open: std::vec::Vec<_> = (0..3).filter(|&leg| !output.legs.contains(leg)).collect();
                assert_eq!(open.len(), 1);
                assert_eq!(output.compare[open[0] as usize], 1000);
                // Line to line: M times the period.
                assert_eq!([a, b, c].map(f32::abs).iter().sum::<f32>(), 1000.0);
            }
        }
    }

    extern crate std;

    #[test]
    fn follows_with_half_a_degree_of_hysteresis() {
        let mut sextant = Sextant::of(ElectricalAngle::ZERO);
        for (degrees, expected) in [
            (59.0, 0),
            (60.4, 0),
            (60.6, 1),
            (59.6, 1),
            (59.4, 0),
            (-0.4, 0),
            (-0.6, 5),
            (0.4, 5),
            (0.6, 0),
            (170.0, 2),
        ] {
            sextant = sextant.follow(ElectricalAngle::from_degrees(degrees));
            assert_eq!(sextant as u8, expected, "{degrees}");
        }
    }

    #[test]
    fn signals_and_angle_agree() {
        for tenth in 0..3600 {
            let angle = ElectricalAngle::from_degrees(tenth as f32 / 10.0 + 0.05);
            let third = ElectricalAngle::THIRD;
            let signals = [angle, angle - third, angle - third - third].map(|x| trig::sin(x) >= 0);
            assert_eq!(Sextant::of_switching_halls(signals), Some(Sextant::of(angle)), "{angle}");
        }
        assert_eq!(Sextant::of_switching_halls([true; 3]), None);
        assert_eq!(Sextant::of_switching_halls([false; 3]), None);
    }
}
