use super::recording::Recording;
use super::setup::{Plan, Source};
use super::{Channel, ROWS};
use proptest::prelude::*;
extern crate std;
use std::vec::Vec;

fn plan(rows: u16, before: u16, source: Source, level: i32, rising: bool) -> Plan {
    Plan { channels: [Some(Channel::Speed), None, None, None], every: 1, rows, before, source, level, rising }
}

/// Numbers of the rows that are kept of a watched quantity, where it was triggered.
fn kept(plan: &Plan, watched: &[i32]) -> Option<Vec<i32>> {
    let mut recording = Recording::new();
    recording.restart(plan);
    for (number, watched) in watched.iter().enumerate() {
        if !recording.is_complete() {
            recording.push([number as i32, 0, 0, 0], *watched);
        }
    }
    let row = |number| recording.row(number).map(|row| row[0]);
    assert!(row(plan.rows).is_none());
    recording.is_complete().then(|| (0..plan.rows).map(|number| row(number).unwrap()).collect())
}

#[test]
fn a_new_recording_is_empty() {
    assert_eq!(size_of::<Recording>() / 1024, ROWS / 64);
    assert!(Recording::new().row(0).is_none());
}

#[test]
fn an_angle_that_wraps_crosses_a_level_once_a_turn() {
    let plan = plan(2, 1, Source::Channel(Channel::Angle), 1 << 30, true);
    let forward: Vec<i32> = (0..40).map(|k: i32| k.wrapping_mul(i32::MAX / 8)).collect();
    let kept = kept(&plan, &forward).unwrap();
    assert_eq!(kept, [4, 5]);
    // Backwards it never rises.
    let backward: Vec<i32> = forward.iter().map(|angle| angle.wrapping_neg()).collect();
    assert!(super::tests::kept(&plan, &backward).is_none());
}

proptest! {
    #[test]
    fn rows_about_the_first_crossing_that_has_enough_before_it(
        watched in prop::collection::vec(-100_i32..100, 1..1500),
        rows in 1_u16..=ROWS as u16,
        share in 0.0_f32..1.0,
        level in -90_i32..90,
        rising: bool,
    ) {
        let before = (f32::from(rows - 1) * share) as u16;
        let plan = plan(rows, before, Source::Channel(Channel::Speed), level, rising);
        let crosses = |k: usize| {
            let (last, now) = (watched[k - 1], watched[k]);
            if rising { last < level && now >= level } else { last > level && now <= level }
        };
        let at = (1.max(usize::from(before))..watched.len()).find(|&k| crosses(k));
        let whole = at.map(|at| at - usize::from(before)).filter(|first| first + usize::from(rows) <= watched.len());
        let expected = whole.map(|first| (first as i32..).take(rows.into()).collect::<Vec<_>>());
        prop_assert_eq!(kept(&plan, &watched), expected);
    }

    #[test]
    fn any_numbers_are_no_panic(watched in prop::collection::vec(any::<i32>(), 0..600), level: i32, rising: bool) {
        kept(&plan(300, 100, Source::Channel(Channel::Angle), level, rising), &watched);
    }
}
