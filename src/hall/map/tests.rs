use super::*;
use crate::angle::TURN;
use crate::hall::Codes;
use crate::hall::model::Model;
use core::f32::consts::TAU;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

extern crate std;
use std::println;
use std::vec::Vec;

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

/// Sensors whose magnets differ in strength and place from pole to pole by up to so much, and have a second harmonic and an
/// offset that all poles share: codes with a noise of 1 % at a position.
struct Poles {
    model: Model,
    /// Strength, and place in radians.
    magnets: Vec<(f32, f32)>,
    random: Pcg64,
}

impl Poles {
    fn new(pairs: u8, most: f32, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut off = || random.random_range(-most..=most);
        let magnets = (0..2 * pairs).map(|_| (1.0 + off(), off())).collect();
        Self { model: Model::nominal(12, 1000.0, ElectricalAngle::from_degrees(120.0)), magnets, random }
    }

    fn codes(&mut self, position: Position) -> Codes {
        let hall = self.model.hall(position.angle());
        let magnets = &self.magnets;
        [0, 1, 2].map(|k| {
            let sensor = &self.model.sensors[k];
            let half_turns = (position.to_turns() - f64::from(k as u8) / 3.0) * 2.0;
            let (strength, place) = magnets[(half_turns.floor() as i64).rem_euclid(magnets.len() as i64) as usize];
            let wave = sensor.wave(hall + ElectricalAngle::from_radians(place));
            let second = 0.04 * (2.0 * (hall - sensor.placement).to_radians()).cos();
            let noise = self.random.random_range(-1.0..1.0) * 0.017;
            (sensor.offset + 1000.0 * (strength * wave + second + 0.03 + noise)) as u16
        })
    }

    /// Turned by `turns` electrical turns at a steady speed from a place, as a drive counts that began `behind` it.
    fn turn(&mut self, collector: &mut Collector, begin: f64, turns: f64, behind: f64) {
        for k in 0..4000 {
            let position = begin + turns * f64::from(k) / 4000.0;
            let codes = self.codes(Position::from_turns(position));
            collector.push(&self.model, &codes, Position::from_turns(position - behind));
        }
    }
}

fn collected(poles: &mut Poles, pairs: u8, begin: f64, turns: f64, behind: f64) -> Collector {
    let mut collector = Collector::OFF;
    collector.begin(PolePairs::new(pairs).unwrap());
    poles.turn(&mut collector, begin, turns, behind);
    collector
}

/// A map that differs from pole to pole, so that all of them matter.
fn any_map(pairs: u8) -> Map {
    let mut random = Pcg64::seed_from_u64(pairs.into());
    let pole_pairs = PolePairs::new(pairs).unwrap();
    Map::of_points(pole_pairs, (0..Map::points_for(pole_pairs)).map(|_| random.random_range(-2000..2000))).unwrap()
}

#[test]
fn a_signature_tells_every_pole_either_way() {
    for pairs in [2, 4, 7, 21, 44] {
        let mut poles = Poles::new(pairs, 0.05, pairs.into());
        let once = f64::from(pairs);
        let signature = collected(&mut poles, pairs, 0.0, once, 0.0).signature().unwrap();
        for behind in (0..pairs).step_by(usize::from(pairs / 5 + 1)) {
            for turns in [3.02 * once, -3.02 * once] {
                let mut collector = collected(&mut poles, pairs, 3.3, turns, f64::from(behind));
                let verdict = collector.judge(&signature, &any_map(pairs), None).unwrap();
                assert!(verdict.sure && verdict.fit > 0.6, "{pairs} {behind} {turns}: {verdict:?}");
                assert_eq!(verdict.electrical_turns, i32::from(behind), "{pairs} {turns}");
            }
        }
        // Nothing is said of less than a turn.
        let mut collector = collected(&mut poles, pairs, 0.0, 0.9 * once, 0.0);
        assert!(collector.signature().is_none() && collector.judge(&signature, &any_map(pairs), None).is_none());
    }
}

#[test]
fn a_signature_in_use_contradicts_a_wrong_pole_and_another_rotor_is_never_sure() {
    for pairs in [4, 11] {
        let mut poles = Poles::new(pairs, 0.05, 1);
        let once = 1.02 * f64::from(pairs);
        let signature = collected(&mut poles, pairs, 0.0, once, 0.0).signature().unwrap();
        for used in 0..i32::from(pairs) {
            let mut collector = collected(&mut poles, pairs, 1.0, once, 2.0);
            let verdict = collector.judge(&signature, &any_map(pairs), Some(used)).unwrap();
            assert_eq!((verdict.sure, verdict.misfit), (used == 2, used != 2), "{pairs} {used}: {verdict:?}");
        }
        for seed in 2..40 {
            for most in [0.0, 0.02, 0.05, 0.1] {
                let mut other = Poles::new(pairs, most, seed);
                let mut collector = collected(&mut other, pairs, 1.0, once, 2.0);
                let verdict = collector.judge(&signature, &any_map(pairs), None).unwrap();
                assert!(!verdict.sure, "{pairs} {seed} {most}: {verdict:?}");
            }
        }
    }
}

#[test]
fn a_signature_counts_the_other_way_with_the_angle() {
    let mut poles = Poles::new(4, 0.05, 3);
    let signature = collected(&mut poles, 4, 0.0, 4.1, 0.0).signature().unwrap();
    assert_eq!(signature.reversed().reversed(), signature);
    // The same rotor and Halls, of which the drive takes the angle to fall.
    let mut collector = Collector::OFF;
    collector.begin(PolePairs::new(4).unwrap());
    let reversed = Model { reversed: true, ..poles.model };
    for k in 0..4000 {
        let position = 4.1 * f64::from(k) / 4000.0;
        let codes = poles.codes(Position::from_turns(position));
        collector.push(&reversed, &codes, Position::from_turns(-position - 1.0));
    }
    let verdict = collector.judge(&signature.reversed(), &any_map(4), None).unwrap();
    assert!(verdict.sure && verdict.electrical_turns == 1, "{verdict:?}");
}

#[test]
fn a_rotor_of_one_pole_pair_has_nothing_to_tell() {
    assert!(!collected(&mut Poles::new(1, 0.1, 1), 1, 0.0, 9.0, 0.0).signature().unwrap().tells());
    assert!(collected(&mut Poles::new(4, 0.05, 1), 4, 0.0, 9.0, 0.0).signature().unwrap().tells());
}

#[test]
fn even_magnets_have_next_to_no_signature() {
    let rms = |most| collected(&mut Poles::new(4, most, 1), 4, 0.0, 4.1, 0.0).signature().unwrap().rms();
    assert!(rms(0.0).iter().all(|&rms| rms < 0.004), "{:?}", rms(0.0));
    assert!(rms(0.05).iter().all(|&rms| rms > 0.006), "{:?}", rms(0.05));
}
