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
        let error = error_deg(angle, pairs.into()) / 360.0 + random.random_range(-1.0..1.0) * 0.8 / 360.0;
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

#[test]
fn the_pole_is_found_within_three_turns_and_not_without_unevenness() {
    let map = learnt(7);
    for begun in 0..7 {
        let mut finder = Finder::<7>::default();
        let mut found = None;
        // The position starts to count at zero, wherever the rotor is.
        let begin = f64::from(begun) / 7.0;
        turn(7, 2000, 10.0, begin, |measured, speed, sequence, angle| {
            let counted = Position::from_bits(measured.to_bits() - (i64::from(begun) << 32));
            if let (None, Some(now)) = (found, finder.push(&map, counted, speed, sequence)) {
                found = Some((now.electrical_turns, angle - begin));
            }
        });
        let (turns, after) = found.expect("it is found");
        assert_eq!(turns, begun);
        assert!(after < 3.0, "{after}");
    }
    let mut finder = Finder::<7>::default();
    turn(7, 20_000, 60.0, 0.0, |measured, speed, sequence, angle| {
        let even = Position::from_bits(measured.to_bits() - (error_deg(angle, 7.0) / 360.0 * f64::from(TURN)) as i64);
        assert_eq!(finder.push(&Map { layout: map.layout, ..Map::ZERO }, even, speed, sequence), None);
    });
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
    assert_eq!(map.turned(5).error(Position::from_turns(0.3)), map.error(Position::from_turns(5.3)));
    let pitch: f32 = map.pitch_deg().sum();
    assert!(pitch.abs() < 0.01, "{pitch}");
}
