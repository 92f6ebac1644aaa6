//! The paper's construction with eccentric rings and a table for ideal ones: where exact geometry says it fails.

use core::f64::consts::{PI, TAU};
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::eccentricity::Geometry;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use plant::rings::{Head, Ring};

const POSITIONS: usize = 40_000;
const HEAD_ANGLE: f64 = 40.0 / 180.0 * PI;

fn paper() -> Rings {
    Rings::new(37, 45, 12).unwrap()
}

/// 37 and 45 pole pairs of 2 mm, both on one eccentric ring.
fn plant(eccentricity: f64) -> [Ring; 2] {
    [37, 45].map(|pole_pairs| Ring { eccentricity_mm: eccentricity, ..Ring::new(pole_pairs, 2.0) })
}

/// Share of wrong pole pairs in percent and largest residual in counts, with an uncalibrated encoder.
fn turn<const HEADS: usize>(eccentricity: f64) -> (f64, f32) {
    let rings = paper();
    let plant = plant(eccentricity);
    let step = MechanicalAngle::from_degrees(1.0);
    let encoder = Encoder::<HEADS>::new(&rings, &Calibration::ideal(&rings), step).unwrap();
    let heads = |mounted: f64| {
        let first = Head::new(mounted, 12);
        core::array::from_fn::<_, HEADS, _>(|head| match head {
            0 => first.clone(),
            _ => first.opposite(0.0),
        })
    };
    let (reference, vernier) = (heads(0.0), heads(HEAD_ANGLE));
    let (mut wrong, mut largest) = (0, 0);
    for position in 0..POSITIONS {
        let shaft = (position as f64 + 0.5) / POSITIONS as f64 * TAU;
        // Half a code of noise makes the head's rounding down a rounding to the nearest.
        let read = |ring, head: &Head| rings.reading(head.digital(ring, shaft, 0.5));
        let decoded = encoder.decode(Reading {
            reference: reference.each_ref().map(|head| read(&plant[0], head)),
            vernier: vernier.each_ref().map(|head| read(&plant[1], head)),
        });
        let error = f64::from(decoded.angle.to_bits() as u32) / 2f64.powi(32) - shaft / TAU;
        wrong += usize::from((error - error.round()).abs() > 0.5 / 37.0);
        largest = largest.max(decoded.residual.abs());
    }
    let percent = 100.0 * wrong as f64 / POSITIONS as f64;
    (percent, rings.residual_counts(largest))
}

#[test]
fn one_head_fails_between_thirty_and_thirty_five_micrometres() {
    assert_eq!(turn::<1>(0.030).0, 0.0);
    let (percent, _) = turn::<1>(0.035);
    assert!((percent - 11.0).abs() < 1.0, "{percent}");
    let (percent, _) = turn::<1>(0.050);
    assert!((percent - 52.0).abs() < 1.0, "{percent}");
    let rings = paper();
    let tolerable = Geometry::from_pole_length(&rings, 2.0, HEAD_ANGLE as f32).tolerable(&rings);
    assert!((0.030..0.035).contains(&tolerable), "{tolerable}");
}

#[test]
fn opposite_heads_bear_ten_times_as_much() {
    let (percent, largest) = turn::<2>(0.3);
    assert_eq!(percent, 0.0);
    assert!((largest - 11.7).abs() < 1.0, "{largest}");
}
