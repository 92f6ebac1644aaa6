//! Space-vector modulation by min/max centring, the voltage limit as a circle, and what the dead time takes.
//!
//! The star point is free, so the three compare values are moved together until the highest and the lowest lie
//! symmetrically in the allowed range. That makes 2/√3 of the amplitude of centred sines possible, the circle inside
//! the hexagon of space vectors, less what the dead time's correction needs. A vector that is longer than the range of the
//! phases whose currents are sampled begins at its lower end, and the highest phase alone goes beyond.

use crate::commutation::frames::{Dq, InverseClarke, Rotation};
use crate::math::{clamp, high};
use crate::pwm::Limits;

/// The largest voltage along d. The unit of the voltages follows from it: [`LONGEST`] is the longest vector in every
/// direction.
pub const MOST_D: i32 = 1 << 21;

/// The longest voltage vector, of which [`MOST_D`] is 7/10.
pub const LONGEST: i32 = 2_995_931;

/// A voltage cut to the circle of [`LONGEST`], components of any size. The one along d comes first, up to [`MOST_D`];
/// that along q gets what is left, by a parabola through the top of the circle and the point at the largest d: up to
/// 1.6 % of the radius less than the circle leaves, and 0.1 % where there is no voltage along d.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Circle(i32);

/// (1 − √(1 − 0.7²)) / 0.7² of the radius, in 2³² over its square; rounded up.
const BEND: i32 = 837;

impl Circle {
    /// The only one. A constant in memory is loaded by one instruction.
    pub const NEW: Self = Self(LONGEST - BEND);

    /// A voltage within it.
    #[inline(always)]
    pub const fn cut(&self, vector: Dq) -> Dq {
        let d = between(vector.d, -MOST_D, MOST_D - 1);
        Dq { d, q: clamp(vector.q, self.left(d)) }
    }

    /// What d leaves to q.
    #[inline(always)]
    const fn left(&self, d: i32) -> i32 {
        // The square of d loses its fraction.
        self.0 - high(d, d) * BEND
    }

    /// What a voltage leaves to q.
    #[inline(always)]
    pub const fn free(&self, Dq { d, q }: Dq) -> i32 {
        self.left(d) - q.abs()
    }

    /// Whether a voltage has been cut, or just not.
    #[inline(always)]
    pub const fn touches(&self, Dq { d, q }: Dq) -> bool {
        // One less to the negative side, as in the range.
        let along = d ^ (d >> 31);
        ((q.abs() - self.left(d)) & (along - (MOST_D - 1))) >= 0
    }
}

/// `x` cut to a range; with powers of two one instruction.
#[inline(always)]
const fn between(x: i32, low: i32, top: i32) -> i32 {
    let x = if x < top { x } else { top };
    if x > low { x } else { low }
}

/// Makes compare values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Modulator {
    /// Counts for a phase voltage of 2³².
    counts: i32,
    /// Middle of the range in which the currents are sampled, and half a count for rounding, as an eighth of a voltage.
    middle: i32,
    phases: InverseClarke,
    /// What half of the dead time takes, as an eighth of a voltage, in 2¹¹.
    dead_time: i32,
}

/// A current from which on the dead time acts in full.
pub const RAMP: i32 = 1 << 24;

impl Modulator {
    /// Memory for one.
    pub const NONE: Self = Self { counts: 0, middle: 0, phases: InverseClarke::new(false), dead_time: 0 };

    /// For a timer, a dead time in counts, up to a fifth of the period, and the [`longest`](Self::longest) vector that they
    /// and the limits allow.
    pub fn new(period: u16, dead_time: u16, limits: &Limits, longest: f32, reversed: bool) -> Self {
        // An eighth of a voltage of one count.
        let eighth = LONGEST as f32 / longest / f32::from(period) / 8.0;
        Self {
            counts: (4_294_967_296.0 / eighth) as i32,
            middle: (limits.middle(8) as f32 / 256.0 * eighth + 0.5) as i32,
            phases: InverseClarke::new(reversed),
            dead_time: (f32::from(dead_time) * eighth * 1024.0 + 0.5) as i32,
        }
    }

    /// Whether phases B and C are exchanged.
    pub const fn is_reversed(&self) -> bool {
        self.phases.is_reversed()
    }

    /// The longest vector that fits the limits in every direction, with the correction of the dead time, as a share of
    /// the bus.
    pub fn longest(period: u16, dead_time: u16, limits: &Limits) -> f32 {
        limits.longest_vector(dead_time) / f32::from(period)
    }

    /// Compare values of a `voltage` within the [circle](Circle) for a rotor at an angle, and whether they exceed the range
    /// in which all currents are sampled, to either side: then they are to be raised until the lowest, which has wrapped, is
    /// zero. Within one count of the exact value.
    ///
    /// To each phase is added what the dead time takes: half of its counts, with the sign of the phase's share of the
    /// `current` along q and in proportion to it below [`RAMP`], where the terminal floats for part of the dead time.
    #[inline(always)]
    pub const fn compare(&self, rotor: Rotation, voltage: Dq, current: i32) -> ([u16; 3], bool) {
        let [a, b, c] = self.phases.of(rotor.inverse_park(voltage));
        // A vector along d stands a quarter turn behind one along q, which saves two signs.
        let behind = rotor.inverse_park_d(current);
        let [flowing_a, flowing_b, flowing_c] = self.phases.of_ahead(behind);
        let (a, b, c) = (a - self.taken(flowing_a), b + self.taken(flowing_b), c + self.taken(flowing_c));
        let (low, top) = if a < b { (a, b) } else { (b, a) };
        let low = if c < low { c } else { low };
        let top = if c > top { c } else { top };
        let shift = self.middle - ((low + top) >> 1);
        let [a, b, c] = [self.counts(a + shift), self.counts(b + shift), self.counts(c + shift)];
        // The range begins at zero and ends as far above its middle.
        ([a as u16, b as u16, c as u16], low + shift < 0)
    }

    /// What the dead time takes from a phase with an eighth of a current.
    #[inline(always)]
    const fn taken(&self, current: i32) -> i32 {
        high(between(current, -RAMP / 8, RAMP / 8 - 1), self.dead_time)
    }

    #[inline(always)]
    const fn counts(&self, eighth: i32) -> i32 {
        high(eighth, self.counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::ElectricalAngle;
    use crate::pwm::SQRT_3;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    extern crate std;

    /// Compare values of which the lowest may have wrapped below zero, raised so far that it is zero.
    fn raised(compare: [u16; 3]) -> [u16; 3] {
        let counts = compare.map(|compare| compare as i16);
        let lowest = counts.iter().fold(i16::MAX, |least, count| least.min(*count));
        counts.map(|count| (count - lowest) as u16)
    }

    fn vector(length: f64, angle: f64) -> Dq {
        Dq { d: (length * libm::cos(angle)) as i32, q: (length * libm::sin(angle)) as i32 }
    }

    #[test]
    fn the_line_voltages_are_the_vectors_and_the_range_is_used_evenly() {
        let limits = Limits::new(2125, 0, 1997).unwrap();
        for (reversed, sign) in [(false, 1.0), (true, -1.0)] {
            let modulator = Modulator::new(2125, 0, &limits, Modulator::longest(2125, 0, &limits), reversed);
            for tenth in 0..3600 {
                for share in [0.01, 0.5, 1.0] {
                    let angle = f64::from(tenth) / 3600.0 * TAU;
                    let rotor = ElectricalAngle::from_degrees(0.1 * tenth as f32);
                    let voltage = vector(share * f64::from(LONGEST), 0.4);
                    let compare = modulator.compare(Rotation::at(rotor), voltage, 0).0.map(f64::from);
                    let phase = |k: usize| {
                        share
                            * f64::from(limits.longest_vector(0))
                            * libm::cos(angle + 0.4 - sign * k as f64 / 3.0 * TAU)
                    };
                    for (k, next) in [(0, 1), (1, 2), (2, 0)] {
                        let exact = phase(k) - phase(next);
                        assert!((compare[k] - compare[next] - exact).abs() <= 1.2, "{tenth} {share}");
                    }
                    let exact = [0, 1, 2].map(phase);
                    let middle =
                        exact.iter().copied().fold(f64::MIN, f64::max) + exact.iter().copied().fold(f64::MAX, f64::min);
                    for (compare, phase) in compare.iter().zip(exact) {
                        let exact = 1997.0 / 2.0 + phase - middle / 2.0;
                        assert!((compare - exact).abs() <= 1.0, "{tenth} {share} {compare} {exact}");
                    }
                    let high = compare.iter().copied().fold(0.0, f64::max);
                    let low = compare.iter().copied().fold(1e9, f64::min);
                    assert!((high + low - 1997.0).abs() <= 2.0, "{compare:?}");
                }
            }
        }
    }

    #[test]
    fn a_full_vector_is_two_over_root_three_of_centred_sines() {
        let limits = Limits::new(2000, 0, 2000).unwrap();
        let ratio = Modulator::longest(2000, 0, &limits) * 2000.0 / 1000.0;
        assert!((ratio - 2.0 / SQRT_3).abs() < 0.004, "{ratio}");
    }

    proptest! {
        #[test]
        fn no_voltage_that_is_cut_leaves_the_limits(
            period in 64..=65_535_u16, low in 0..=20_u16, window in 0..=20_u16, dead_time in 0.0..0.1,
            d in any::<i32>(), q in any::<i32>(), length in 0.0..1.1, angle in 0.0..TAU,
            rotor in any::<i32>(), current in -(1 << 30)..(1 << 30), reversed: bool,
        ) {
            let limits = Limits::new(period, low, period - window).unwrap();
            let dead_time = (dead_time * f64::from(period)) as u16;
            let modulator = Modulator::new(period, dead_time, &limits, Modulator::longest(period, dead_time, &limits), reversed);
            let rotation = Rotation::at(ElectricalAngle::from_bits(rotor));
            for voltage in [Dq { d, q }, vector(length * f64::from(LONGEST), angle)] {
                let (compare, beyond) = modulator.compare(rotation, Circle::NEW.cut(voltage), current);
                for compare in compare {
                    prop_assert!((low..=period - window).contains(&compare), "{compare}");
                }
                prop_assert!(!beyond);
            }
        }
    }

    proptest! {
        #[test]
        fn one_phase_alone_goes_beyond_what_is_sampled(
            window in 0..=500_u16, left in 0..=40_u16, dead_time in 0..=140_u16, length in 0.0..1.0, angle in 0.0..TAU,
            rotor in any::<i32>(), current in -(1 << 30)..(1 << 30), reversed: bool,
        ) {
            let top = 2125 - left.min(window);
            let limits = Limits::new(2125, 0, 2125 - window).unwrap().with_top(top);
            let high = 2125 - window;
            let modulator = Modulator::new(2125, dead_time, &limits, Modulator::longest(2125, dead_time, &limits), reversed);
            let voltage = Circle::NEW.cut(vector(length * f64::from(LONGEST), angle));
            let (compare, beyond) = modulator.compare(Rotation::at(ElectricalAngle::from_bits(rotor)), voltage, current);
            let compare = if beyond { raised(compare) } else { compare };
            let unsampled = compare.iter().filter(|compare| **compare > high).count();
            prop_assert!(compare.iter().all(|compare| *compare <= top), "{compare:?}");
            prop_assert!(unsampled <= 1 && (beyond || unsampled == 0), "{compare:?} {beyond}");
        }
    }

    #[test]
    fn a_top_beyond_what_is_sampled_makes_longer_vectors_with_the_same_line_voltages() {
        let sampled = Limits::new(2125, 0, 1717).unwrap();
        let limits = sampled.with_top(1972);
        let [before, after] = [sampled, limits].map(|limits| Modulator::longest(2125, 0, &limits) * SQRT_3);
        assert!((before - 0.807).abs() < 1e-3 && (after - 0.927).abs() < 1e-3, "{before} {after}");
        let modulator = Modulator::new(2125, 0, &limits, Modulator::longest(2125, 0, &limits), false);
        for degree in 0..360 {
            let rotor = ElectricalAngle::from_degrees(degree as f32);
            let (compare, beyond) = modulator.compare(Rotation::at(rotor), vector(f64::from(LONGEST), 0.0), 0);
            let compare = if beyond { raised(compare) } else { compare }.map(f64::from);
            let phase = |k: usize| {
                f64::from(limits.longest_vector(0)) * libm::cos(f64::from(degree).to_radians() - k as f64 / 3.0 * TAU)
            };
            for (k, next) in [(0, 1), (1, 2), (2, 0)] {
                assert!((compare[k] - compare[next] - phase(k) + phase(next)).abs() <= 1.2, "{degree} {compare:?}");
            }
        }
    }

    #[test]
    fn the_circle_cuts_q_after_d_and_gives_little_away() {
        let radius = f64::from(LONGEST);
        for degree in 0..360 {
            for share in [0.2, 0.98, 1.0, 1.2, 1.4, 5.0, 300.0] {
                let asked = vector(share * radius, f64::from(degree) / 360.0 * TAU);
                let cut = Circle::NEW.cut(asked);
                let (d, q) = (f64::from(cut.d), f64::from(cut.q));
                assert!(libm::hypot(d, q) <= radius, "{degree} {share}");
                assert!(asked.d.abs() < MOST_D && cut.d == asked.d || d.abs() >= 0.69999 * radius);
                let left = libm::sqrt(radius * radius - d * d) / radius;
                let given_away = left - q.abs() / radius;
                assert!(cut.q == asked.q || given_away <= 0.016, "{degree} {share} {given_away}");
                assert!(cut.q == asked.q || cut.d != 0 || given_away <= 0.001);
                assert!(cut == asked || Circle::NEW.touches(cut));
                assert!(share > 0.9 || cut == asked && (cut.d.abs() >= MOST_D || !Circle::NEW.touches(cut)));
            }
        }
    }

    #[test]
    fn the_dead_time_is_given_back_with_the_sign_of_the_current() {
        let limits = Limits::new(2125, 0, 2125).unwrap();
        let modulator = Modulator::new(2125, 84, &limits, Modulator::longest(2125, 84, &limits), false);
        // The vector along q at −90° is along phase A.
        let rotation = Rotation::at(ElectricalAngle::from_degrees(-90.0));
        let line = |current: i32| {
            let [a, b, c] = modulator.compare(rotation, Dq::ZERO, current).0.map(i32::from);
            assert_eq!(b, c);
            a - b
        };
        // A up by 42 counts and the others, with half of its current, down by as much.
        for (current, exact) in [(-1 << 28, -84), (-2 * RAMP - 99, -84), (0, 0), (2 * RAMP + 99, 84), (1 << 28, 84)] {
            assert!((line(current) - exact).abs() <= 1, "{current} {}", line(current));
        }
        // Below, A at its half and the others at their quarter.
        assert!((line(RAMP / 2) - 31).abs() <= 1, "{}", line(RAMP / 2));
    }
}
