//! Random attacks at simulated drives: a few in plain `cargo test`, three hundred with FULL, thousands by
//! `cargo run --release -- attack`. Here sums that overflow are a breach, too.

use rayon::prelude::*;
use sim::experiment::attack::{Attacked, Breach, Only, Sabotage, attack};

/// Those of the short form are of every temper and of short scenarios.
const SHORT: u64 = 12;
const WHOLE: u64 = 300;

/// What is wrong with it, and how to see it again.
fn said(attacked: &Attacked) -> String {
    let verdicts = attacked.verdicts.iter();
    let verdicts = verdicts.map(|verdict| format!("{:?} at {:.3} s: {}", verdict.breach, verdict.at_s, verdict.said));
    format!("scenario {}: {}\n{}", attacked.seed, verdicts.collect::<Vec<_>>().join("; "), attacked.words)
}

/// What was found, and has been mended since. Strong magnets (295): the back-EMF of a rotor that was stopped in the check at
/// arming was an over-current. Two Halls at a heavy rotor (543, 379): the noise of its speed was a rotor that turns against
/// its torque.
const FOUND: [u64; 3] = [295, 543, 379];

#[test]
fn what_was_found_stays_mended() {
    let breached: Vec<_> = FOUND
        .into_par_iter()
        .map(|seed| attack(seed, &Only::default(), Sabotage::None))
        .filter(|attacked| !attacked.verdicts.is_empty() || attacked.idle.is_some())
        .map(|attacked| said(&attacked))
        .collect();
    assert!(breached.is_empty(), "{}", breached.join("\n"));
}

#[test]
fn no_drive_does_what_it_must_not() {
    let attacked: Vec<_> = (1..=sim::of(SHORT, WHOLE))
        .into_par_iter()
        .map(|seed| attack(seed, &Only::default(), Sabotage::None))
        .collect();
    let idle = attacked.iter().filter(|one| one.idle.is_some()).count();
    assert!(4 * idle < attacked.len(), "{idle} of {} were not attacked", attacked.len());
    let breached: Vec<_> = attacked.iter().filter(|one| !one.verdicts.is_empty()).map(said).collect();
    assert!(breached.is_empty(), "{}", breached.join("\n"));
}

/// Some of a few scenarios show what is wrong: a judge that sees nothing would be content.
#[test]
fn the_judge_sees_what_is_wrong() {
    for (sabotage, breach) in [
        (Sabotage::WeakMotor(0.3), Breach::Current),
        (Sabotage::Deaf, Breach::DrivenWhileOff),
        (Sabotage::Slips, Breach::LostTurn),
        (Sabotage::Mute, Breach::Mute),
    ] {
        let seen = (1..=8_u64).into_par_iter().any(|seed| {
            attack(seed, &Only::default(), sabotage).verdicts.iter().any(|verdict| verdict.breach == breach)
        });
        assert!(seen, "{sabotage:?} is no {breach:?}");
    }
}
