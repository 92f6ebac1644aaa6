use super::*;
use crate::angle::TURN;
use core::f32::consts::TAU;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

extern crate std;
use std::println;

/// The error of a rotor at a mechanical angle in turns, electrical degrees: uneven poles and a second harmonic.
fn error_deg(turns: f64, pairs: f64) -> f64 {
    let x = turns * f64::from(TAU);
    3.0 * (x + 0.4).sin() + 2.0 * ((pairs + 1.0) * x).cos() + 1.5 * (2.0 * pairs * x + 1.0).sin()
}

/// A rotor that slows down, seen with noise, from an electrical turn on; each sample goes to `take`.
fn turn(pairs: u8, samples: u32, hz: f64, begin: f64, mut take: impl FnMut(Position, i32, u32, f64)) {
    let mut random = Pcg64::seed_from_u64(5);
    let (mut angle, mut speed) = (begin, hz);
    for k in 0..samples {
        let error = error_deg(angle, pairs.into()) / 360.0 + random.random_range(-1.0..1.0) * 0.3 / 360.0;
        let measured = Position::from_turns(angle * f64::from(pairs) + error);
        let per_step = speed * f64::from(pairs) / 40_000.0;
        take(measured, (per_step * f64::from(TURN)) as i32, 40 * k, angle);
        angle += speed * 1e-3;
        speed -= 2.0 * 1e-3 * hz.signum();
    }
}

fn learnt(pairs: u8) -> Map {
    let mut learner = Learner::new(PolePairs::new(pairs).unwrap(), 12_000);
    turn(pairs, 6000, 16.0, 0.0, |measured, speed, sequence, _| learner.push(measured, speed, sequence));
    learner.pause();
    turn(pairs, 6000, -16.0, 0.3, |measured, speed, sequence, _| learner.push(measured, speed, sequence));
    learner.map()
}

#[test]
fn a_freely_turning_rotor_shows_what_its_halls_are_wrong_by() {
    for (pairs, most) in [(1, 0.15), (4, 0.15), (7, 0.15), (15, 0.3), (21, 0.6)] {
        let map = learnt(pairs);
        let (mut before, mut after) = (0.0, 0.0);
        for k in 0..5000 {
            let turns = f64::from(k) / 5000.0;
            let exact = error_deg(turns, pairs.into());
            let found = map.error(Position::from_turns(turns * f64::from(pairs))).to_degrees();
            before += exact * exact / 5000.0;
            after += (exact - f64::from(found)).powi(2) / 5000.0;
        }
        println!("{pairs} pole pairs: {:.3}° RMS becomes {:.3}°", before.sqrt(), after.sqrt());
        assert!(after.sqrt() < most, "{pairs}: {}", after.sqrt());
        assert!((f64::from(map.rms_deg()) / before.sqrt() - 1.0).abs() < 0.1);
    }
}

/// The first sure verdict on a rotor that begins at a pole, and how many turns it took.
fn found(map: &Map, pairs: u8, hz: f64, begun: i32, even: bool) -> Option<(i32, f64)> {
    let mut finder = Finder::<21>::default();
    let mut found = None;
    // The position starts to count at zero, wherever the rotor is.
    let begin = f64::from(begun) / f64::from(pairs);
    turn(pairs, 4000, hz, begin, |measured, speed, sequence, angle| {
        let error = if even { error_deg(angle, pairs.into()) / 360.0 * f64::from(TURN) } else { 0.0 };
        let measured = Position::from_bits(measured.to_bits() - (i64::from(begun) << 32) - error as i64);
        let Some(verdict) = finder.push(map, 0.25, None, &Seen { measured, speed, sequence, driven: 0.0 }) else {
            return;
        };
        if verdict.sure && found.is_none() {
            found = Some((verdict.electrical_turns, (angle - begin).abs()));
        }
    });
    found
}

#[test]
fn the_pole_is_found_within_six_turns() {
    for pairs in [2, 7, 15] {
        let map = learnt(pairs);
        for begun in 0..pairs.into() {
            for hz in [20.0, -20.0] {
                let (pole, after) = found(&map, pairs, hz, begun, false).expect("it is found");
                assert_eq!(pole, begun, "{pairs} {hz}");
                assert!(after < 6.2, "{after}");
            }
        }
    }
}

#[test]
fn no_pole_is_found_on_a_rotor_that_the_map_is_not_of() {
    for pairs in [2, 7, 21] {
        let map = learnt(pairs);
        assert_eq!(found(&map, pairs, 20.0, 0, true), None);
        // One of another shape, and of the same number of poles.
        let other = map.points().iter().rev().map(|point| -point);
        let other = Map::of_points(PolePairs::new(pairs).unwrap(), other.collect::<std::vec::Vec<_>>().into_iter());
        assert_eq!(found(&other.unwrap(), pairs, 20.0, 0, false), None, "{pairs}");
    }
}

#[test]
fn where_the_poles_are_alike_any_is_right() {
    // A second harmonic alone.
    let points: std::vec::Vec<i16> =
        (0..224_i16).map(|k| (2000.0 * (f32::from(k) * TAU / 16.0).sin()) as i16).collect();
    let map = Map::of_points(PolePairs::new(7).unwrap(), points.into_iter()).unwrap();
    assert!(map.difference_deg(3) < 1e-3);
    let mut finder = Finder::<7>::default();
    let mut sure = 0;
    for k in 0..2000_u32 {
        let position = Position::from_turns(0.03 * f64::from(k));
        let measured = Position::from_bits(position.to_bits() + i64::from(map.error(position).to_bits()));
        let seen = Seen { measured, speed: (0.03 / 40.0 * TURN) as i32, sequence: 40 * k, driven: 0.0 };
        sure += u32::from(finder.push(&map, 0.25, None, &seen).is_some_and(|verdict| verdict.sure));
    }
    assert!(sure > 3, "{sure}");
}

#[test]
fn a_reversed_map_is_that_of_the_reversed_angle() {
    let map = learnt(7);
    let reversed = map.reversed();
    for k in -300..300 {
        let turns = f64::from(k) / 32.0;
        let sum =
            map.error(Position::from_turns(turns)).to_bits() + reversed.error(Position::from_turns(-turns)).to_bits();
        assert!(sum.abs() <= 1 << FRACTION, "{turns} {sum}");
    }
    assert_eq!(reversed.reversed(), map);
}

#[test]
fn a_map_closes_over_the_turn_in_both_directions() {
    let map = learnt(4);
    for k in 0..100 {
        let x = 0.04 * f64::from(k);
        for turns in [-8.0, -4.0, 4.0, 400.0] {
            assert_eq!(map.error(Position::from_turns(x)), map.error(Position::from_turns(x + turns)), "{x}");
        }
    }
    assert_ne!(map.error(Position::from_turns(0.3)), map.error(Position::from_turns(1.3)));
    assert_eq!(map.error_from(5, Position::from_turns(0.3)), map.error(Position::from_turns(5.3)));
    let pitch: f32 = map.pitch_deg().sum();
    assert!(pitch.abs() < 0.01, "{pitch}");
}
