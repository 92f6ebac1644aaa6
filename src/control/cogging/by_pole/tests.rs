use super::*;
use crate::turn::FRACTION;
use core::f64::consts::TAU;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

extern crate std;
use std::println;

/// Currents over two turns each way of a rotor whose friction is seventy and whose cogging is given by mechanical turns.
fn learner(pairs: u8, noise: f64, seed: u64, cogging: impl Fn(f64) -> f64) -> Learner {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut learner = Learner::NONE;
    learner.begin(PolePairs::new(pairs).unwrap());
    let samples = 20_000;
    for k in 0..2 * samples {
        let forward = k < samples;
        let turns = 2.0 * f64::from(if forward { k } else { 2 * samples - k }) / f64::from(samples) + 0.1;
        let friction = if forward { 70.0 } else { -70.0 };
        let current = cogging(turns) + friction + noise * random.random_range(-1.0..1.0);
        learner.push(forward, Position::from_turns(turns * f64::from(pairs)), current as f32);
    }
    learner
}

#[test]
fn orders_that_the_poles_do_not_have_are_learnt_and_no_other() {
    for (pairs, slots) in [(2, 3_u16), (4, 9), (7, 12), (11, 24), (15, 27), (21, 36), (32, 45)] {
        let one = |turns: f64, order: f64, phase: f64| (TAU * order * turns + phase).sin();
        let higher = if 2 * slots % u16::from(pairs) == 0 { 3 * slots } else { 2 * slots };
        let slotted = |turns: f64| 40.0 * one(turns, slots.into(), 0.5) + 10.0 * one(turns, higher.into(), 1.5);
        // A load's, once a turn, and what is alike at all poles.
        let rest = |turns: f64| 50.0 * one(turns, 1.0, 0.0) + 80.0 * one(turns, f64::from(6 * u16::from(pairs)), 2.0);
        let learner = learner(pairs, 60.0, 1, |turns| slotted(turns) + rest(turns));
        let waves = learner.waves().unwrap();
        let orders: std::vec::Vec<u32> = waves.iter().map(|wave| wave.order.into()).collect();
        println!("{pairs} pole pairs, {slots} slots: {orders:?}");
        assert!(waves.iter().all(|wave| [slots, higher].contains(&wave.order.into())), "{waves:?}");
        let table = waves.table(PolePairs::new(pairs).unwrap()).unwrap();
        let mut square = 0.0;
        for k in 0..1000 {
            let turns = f64::from(k) / 1000.0;
            let value = table.value(Position::from_turns(turns * f64::from(pairs)));
            square += (f64::from(value) / f64::from(1 << FRACTION) - slotted(turns)).powi(2) / 1000.0;
        }
        // Of 29 RMS.
        println!("  leaves {:.2}", square.sqrt());
        assert!(square.sqrt() < 1.5, "{pairs}: {}", square.sqrt());
    }
}

#[test]
fn noise_is_nothing() {
    for seed in 0..200 {
        let waves = learner([2, 4, 7, 15, 21][seed as usize % 5], 200.0, seed, |_| 0.0).waves().unwrap();
        assert!(waves.is_empty(), "{seed} {waves:?}");
    }
}

#[test]
fn a_point_without_samples_in_a_direction_teaches_nothing() {
    let pairs = PolePairs::new(4).unwrap();
    let mut learner = Learner::NONE;
    learner.begin(pairs);
    let points = Table::points_for(pairs);
    for k in 0..2 * points {
        assert_eq!(learner.waves(), None, "{k}");
        learner.push(k < points, Position::from_turns(4.0 * (k % points) as f64 / points as f64), 1.0);
    }
    assert_eq!(learner.waves(), Some(Waves::NONE));
    // Where the counts are full, nothing is added.
    (0..200_000).for_each(|_| learner.push(true, Position::from_bits(0), 1.0));
    assert_eq!(learner.waves(), Some(Waves::NONE));
}

proptest! {
    #[test]
    fn counted_the_other_way_it_is_the_same_torque(
        waves in prop::collection::vec((1..=255_u8, -2000..2000_i16, -2000..2000_i16), 0..=WAVES),
        pairs in 1..=64_u8, turns in -100.0..100.0_f64,
    ) {
        let waves = Waves::of(waves.into_iter().map(|(order, sine, cosine)| Wave { order, sine, cosine }));
        prop_assert_eq!(&waves.reversed().reversed(), &waves);
        let pairs = PolePairs::new(pairs).unwrap();
        let Some(table) = waves.table(pairs) else { return Ok(()) };
        let reversed = waves.reversed().table(pairs).unwrap();
        let [there, back] = [turns, -turns].map(Position::from_turns);
        prop_assert!((table.value(there) + reversed.value(back)).abs() <= 4 << FRACTION);
    }

    #[test]
    fn another_full_scale_is_the_same_current(
        sine in any::<i16>(), cosine in any::<i16>(), ratio in 0.01..100.0_f32,
    ) {
        let waves = Waves::of([Wave { order: 12, sine, cosine }]);
        let most = f32::from(sine).abs().max(f32::from(cosine).abs());
        match waves.scaled(ratio) {
            None => prop_assert!(most * ratio > 32_766.0),
            Some(scaled) => prop_assert!((scaled.rms() - ratio * waves.rms()).abs() <= 1.0 && most * ratio < 32_768.0),
        }
    }

    /// Whatever comes: other speeds, gaps, jumps, currents without measure.
    #[test]
    fn the_finder_takes_anything(
        samples in prop::collection::vec((any::<i64>(), -1e6..1e6_f32), 1..300), pairs in 1..=64_u8, used in any::<i32>(),
    ) {
        let table = Waves::of([Wave { order: 12, sine: 100, cosine: -50 }]).table(PolePairs::new(pairs).unwrap());
        let mut finder = Finder::<32>::new();
        for (k, (position, current)) in samples.into_iter().enumerate() {
            let used = (k % 2 == 0).then_some(used);
            if let Some(table) = &table
                && let Some(verdict) = finder.push(table, used, Position::from_bits(position >> 16), current)
            {
                prop_assert!((0..i32::from(pairs)).contains(&verdict.electrical_turns));
                prop_assert!(!(verdict.sure && verdict.misfit));
            }
        }
    }
}
