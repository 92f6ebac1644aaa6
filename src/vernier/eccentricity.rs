//! What a ring that does not turn about its own centre does to the angle, and how much of it a construction bears.
//!
//! **One head**, eq. (10) to (17). The ring of radius r turns about a point that is e off its centre. At the shaft
//! angle α, counted from where centre, axis and head are in line, a head at the angle Θ sees the ring at
//!
//! β = atan2(r sin(α − Θ), r cos(α − Θ) + e) + Θ = α − a sin(α − Θ) + a²/2 sin 2(α − Θ) − …, with a = e/r.
//!
//! The first term is the paper's (16). **Two heads, one a ring**, Θ apart, differ by (17),
//! a₂ sin(α − Θ) − a₁ sin α: two sinusoids of phase Θ, whose *difference* has the amplitude
//! √(a₁² + a₂² − 2 a₁ a₂ cos Θ). Equations (18) to (20) are printed with a plus, for the sum; the minus is right, and
//! with it the head angle matters: in the paper's example (r = 14 and 12 mm, e = 0.05 mm, Θ = 40°) the error is
//! 0.155°, not 0.417°, and heads in line (Θ = 0) see 0.034°.
//!
//! **Opposite heads**, in place of (22) to (29), which the stored text lacks. The second head sits at π + ε, ε being
//! its placement error; by (16), with π taken off, it measures
//!
//! β′ = α − ε + a sin(α − ε) + a²/2 sin 2(α − ε) + …
//!
//! and the mean of both is
//!
//! (β + β′)/2 = α − ε/2 − a sin(ε/2) cos(α − ε/2) + a²/2 cos ε sin(2α − ε) + O(a³).
//!
//! The constant ε/2 cannot be told from the zero of the encoder. What remains is bounded by
//! a |sin(ε/2)| + a²/2: first order in the eccentricity as soon as the heads are not exactly opposite, but scaled down
//! by half the placement error, 1/115 for 1°. Two rings with opposite heads contradict each other by at most the sum
//! of their bounds.

use super::rings::{Ring, Rings};
use core::f32::consts::{PI, TAU};

/// How the heads and the rings are built. Lengths in millimetres, angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Radius of the reference ring at the head.
    pub reference_radius: f32,
    /// Radius of the vernier ring at the head.
    pub vernier_radius: f32,
    /// Θ, from the head over the reference ring to that over the vernier ring, seen from the axis.
    pub head_angle: f32,
}

impl Geometry {
    /// The radii that follow from the length of a pole pair, r = pp·L / 2π, with the heads at the given angle.
    pub fn from_pole_length(rings: &Rings, pole_pair_length: f32, head_angle: f32) -> Self {
        let radius = |ring| f32::from(rings.pole_pairs(ring)) * pole_pair_length / TAU;
        Self { reference_radius: radius(Ring::Reference), vernier_radius: radius(Ring::Vernier), head_angle }
    }

    /// The contradiction of the rings with one head each at the shaft angle α, eq. (12): β₁ − β₂ in radians, exact.
    pub fn error(&self, eccentricity: f32, shaft: f32) -> f32 {
        wrap(
            ring_angle(eccentricity / self.reference_radius, shaft)
                - ring_angle(eccentricity / self.vernier_radius, shaft - self.head_angle)
                - self.head_angle,
        )
    }

    /// Its amplitude, eq. (18) corrected, in radians; within 2 % of the exact for eccentricities up to 1 % of the
    /// radius.
    pub fn largest_error(&self, eccentricity: f32) -> f32 {
        self.sensitivity() * eccentricity
    }

    /// Radians of contradiction for a millimetre of eccentricity, eq. (20) corrected.
    pub fn sensitivity(&self) -> f32 {
        let (a, b) = (1.0 / self.reference_radius, 1.0 / self.vernier_radius);
        let square = a * a + b * b - 2.0 * a * b * libm::cosf(self.head_angle);
        // Rounding may take equal radii in line below zero.
        crate::float::root(square.max(0.0))
    }

    /// The largest eccentricity in millimetres with which one head a ring still finds every pole pair, all else being
    /// ideal and the table too. Infinite for equal radii in line.
    pub fn tolerable(&self, rings: &Rings) -> f32 {
        margin(rings) / self.sensitivity()
    }

    /// Bound of the contradiction of two rings with opposite heads, both pairs misplaced by up to ε, in radians.
    pub fn largest_pair_error(&self, eccentricity: f32, misplacement: f32) -> f32 {
        largest_pair_error(eccentricity / self.reference_radius, misplacement)
            + largest_pair_error(eccentricity / self.vernier_radius, misplacement)
    }

    /// The largest eccentricity in millimetres with which opposite heads, misplaced by up to ε, still find every pole
    /// pair, all else being ideal: where [`Self::largest_pair_error`] reaches the margin.
    pub fn tolerable_with_pairs(&self, rings: &Rings, misplacement: f32) -> f32 {
        let (a, b) = (1.0 / self.reference_radius, 1.0 / self.vernier_radius);
        let linear = libm::fabsf(libm::sinf(misplacement / 2.0)) * (a + b);
        let quadratic = (a * a + b * b) / 2.0;
        // The positive root of quadratic·e² + linear·e = margin, in the form that survives a small quadratic term.
        let margin = margin(rings);
        2.0 * margin / (linear + crate::float::root(linear * linear + 4.0 * quadratic * margin))
    }
}

/// Angle at which a head at 0 sees an eccentric ring when the shaft stands at `shaft`, eq. (10); `ratio` is e/r.
/// Radians, −π to π.
pub fn ring_angle(ratio: f32, shaft: f32) -> f32 {
    libm::atan2f(libm::sinf(shaft), libm::cosf(shaft) + ratio)
}

/// Bound of the error of two opposite heads, one misplaced by ε, without the constant ε/2: a |sin(ε/2)| + a²/2 radians
/// for the ratio a = e/r, to second order.
pub fn largest_pair_error(ratio: f32, misplacement: f32) -> f32 {
    ratio * libm::fabsf(libm::sinf(misplacement / 2.0)) + ratio * ratio / 2.0
}

/// The margin in mechanical radians.
fn margin(rings: &Rings) -> f32 {
    rings.margin().mechanical_degrees * (PI / 180.0)
}

fn wrap(angle: f32) -> f32 {
    angle - TAU * libm::roundf(angle / TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: Geometry = Geometry { reference_radius: 14.0, vernier_radius: 12.0, head_angle: 40.0 / 180.0 * PI };

    fn exact(geometry: &Geometry, eccentricity: f32) -> f32 {
        (0..3600).map(|step| geometry.error(eccentricity, step as f32 / 3600.0 * TAU).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn the_papers_example_with_the_right_sign() {
        let degrees = |radians: f32| radians.to_degrees();
        assert!((degrees(exact(&EXAMPLE, 0.05)) - 0.1555).abs() < 5e-4);
        assert!((degrees(EXAMPLE.largest_error(0.05)) - 0.155).abs() < 5e-4);
        // As printed: 8.3357°/mm.
        let (a, b) = (1.0 / 14.0_f32, 1.0 / 12.0_f32);
        let printed = (a * a + b * b + 2.0 * a * b * EXAMPLE.head_angle.cos()).sqrt();
        assert!((degrees(printed) - 8.3357).abs() < 1e-3);
        for (head_angle, expected) in [(0.0, 0.034), (180.0, 0.443)] {
            let geometry = Geometry { head_angle: f32::to_radians(head_angle), ..EXAMPLE };
            assert!((degrees(geometry.largest_error(0.05)) - expected).abs() < 5e-4);
        }
    }

    #[test]
    fn the_amplitude_is_good_to_two_percent() {
        for head_angle in [10.0_f32, 40.0, 90.0, 180.0] {
            for eccentricity in [0.01, 0.05, 0.12] {
                let geometry = Geometry { head_angle: head_angle.to_radians(), ..EXAMPLE };
                let ratio = exact(&geometry, eccentricity) / geometry.largest_error(eccentricity);
                assert!((ratio - 1.0).abs() < 0.02, "{head_angle} {eccentricity} {ratio}");
            }
        }
    }

    /// Peak of the mean of two opposite heads without its constant, by exact geometry, in degrees.
    fn pair_peak(ratio: f64, misplacement: f64) -> f64 {
        const STEPS: usize = 3600;
        let angle = |shaft: f64| libm::atan2(libm::sin(shaft), libm::cos(shaft) + ratio);
        let error = |step: usize| {
            let shaft = step as f64 / STEPS as f64 * core::f64::consts::TAU;
            let near = |angle: f64| angle - shaft - libm::round((angle - shaft) / PI2) * PI2;
            let opposite = shaft - core::f64::consts::PI - misplacement;
            (near(angle(shaft)) + near(angle(opposite) + core::f64::consts::PI)) / 2.0
        };
        const PI2: f64 = core::f64::consts::TAU;
        let constant = (0..STEPS).map(error).sum::<f64>() / STEPS as f64;
        (0..STEPS).map(|step| libm::fabs(error(step) - constant)).fold(0.0, f64::max).to_degrees()
    }

    #[test]
    fn opposite_heads_cancel_to_the_bound() {
        let ratio = 0.05 / 14.0;
        for (misplacement, expected) in [(0.0, 0.0004), (0.5, 0.0011), (1.0, 0.0019), (2.0, 0.0036)] {
            let peak = pair_peak(ratio, f64::to_radians(misplacement));
            assert!((peak - expected).abs() < 5e-5, "{misplacement} {peak}");
            let bound = largest_pair_error(ratio as f32, f32::to_radians(misplacement as f32));
            let bound = f64::from(bound.to_degrees());
            assert!(peak <= bound * 1.001 && bound < peak * 1.35, "{peak} {bound}");
        }
    }

    #[test]
    fn tolerable_eccentricity_is_where_the_margin_is_used_up() {
        let rings = Rings::new(37, 45, 12).unwrap();
        let geometry = Geometry::from_pole_length(&rings, 2.0, f32::to_radians(40.0));
        assert!((geometry.reference_radius - 11.777).abs() < 1e-3);
        assert!((geometry.vernier_radius - 14.324).abs() < 1e-3);
        let tolerable = geometry.tolerable(&rings);
        assert!(tolerable > 0.030 && tolerable < 0.035, "{tolerable}");
        assert!((exact(&geometry, tolerable) / margin(&rings) - 1.0).abs() < 0.02);
        for misplacement in [0.0_f32, 0.5, 1.0, 2.0] {
            let misplacement = misplacement.to_radians();
            let tolerable = geometry.tolerable_with_pairs(&rings, misplacement);
            let error = geometry.largest_pair_error(tolerable, misplacement);
            assert!((error / margin(&rings) - 1.0).abs() < 1e-4, "{error}");
        }
    }
}
