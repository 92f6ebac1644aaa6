//! What `hallctl tune` shows.

use super::trial::Trial;
use super::{Bandwidths, Outcome};
use crate::error::Result;
use crate::out::Out;
use crate::say;
use crate::units::Units;
use serde_json::json;

/// All of it; `kept` is what was set in the end, if it was.
pub(super) fn show(outcome: &Outcome, before: Bandwidths, kept: bool, out: Out) -> Result<()> {
    out.table(&table(outcome, before, out.units))?;
    why(outcome, out)?;
    outcome.found.tell(out)?;
    decided(outcome, before, kept, out)?;
    let proposed = outcome.proposed.map(|trial| trial.bandwidths());
    out.value(&json!({
        "trials": outcome.trials,
        "before_hz": before.speed_hz,
        "proposed_hz": proposed.map(|both| both.speed_hz),
        "proposed_position_hz": proposed.map(|both| both.position_hz),
        "good": outcome.good,
        "swings_from_hz": outcome.swings.map(|trial| trial.bandwidth_hz),
        "uneven_magnets": outcome.uneven,
        "found": outcome.found,
        "kept": kept,
    }))
}

fn table(outcome: &Outcome, before: Bandwidths, units: Units) -> Vec<Vec<String>> {
    let time = |time: Option<f64>| time.map_or_else(|| "never".into(), |time| format!("{:.1} ms", 1e3 * time));
    let head =
        ["bandwidth", "overshoot", "settled", "speed noise", "at rest", "current noise", ""].map(String::from).to_vec();
    let rows = outcome.trials.iter().map(|trial| {
        let Trial { bandwidth_hz, step, turning, standing, .. } = trial;
        let mark = match () {
            () if outcome.proposed.is_some_and(|proposed| proposed.bandwidth_hz == *bandwidth_hz) => "proposed",
            () if trial.switched_off => "swings: switched off",
            () if outcome.judge.swings(trial, &outcome.trials) => "swings",
            () if outcome.judge.is_noisy(trial) => "noisy",
            () if *bandwidth_hz == before.speed_hz => "as it was",
            () => "",
        };
        let current_a = turning.current_a.max(standing.current_a);
        vec![
            format!("{bandwidth_hz:.1} Hz"),
            if trial.switched_off { "-".into() } else { format!("{:.1} %", step.overshoot_pct) },
            if trial.switched_off { "-".into() } else { time(step.settling_s) },
            known(turning.speed_rad_s, |rad_s| units.speed_to(rad_s, 3)),
            known(standing.speed_rad_s, |rad_s| units.speed_to(rad_s, 3)),
            known(current_a, |current_a| format!("{current_a:.4} A")),
            mark.into(),
        ]
    });
    std::iter::once(head).chain(rows).collect()
}

/// A number, if it is one.
fn known(value: f64, words: impl Fn(f64) -> String) -> String {
    if value.is_nan() { "-".into() } else { words(value) }
}

/// Why none is faster.
fn why(outcome: &Outcome, out: Out) -> Result<()> {
    if outcome.mapped {
        return say!(
            out,
            "The magnets look uneven though a map of them is in use, and a fast loop makes a current of that. The map is of \
             another number of pole pairs perhaps: `hallctl pole-pairs` counts them; set pole_pairs, `hallctl calibrate`, \
             `hallctl magnets learn`, and `hallctl tune` again."
        );
    }
    if outcome.uneven {
        return say!(
            out,
            "The magnets are uneven: while the motor turns, the measured speed swings with them at any bandwidth, and a fast \
             loop makes a current of that. Larger bandwidths are possible after `hallctl magnets learn`, on a board that \
             has room for a map (with an encoder on the shaft, after `hallctl encoder calibrate`): then `hallctl tune` \
             again."
        );
    }
    let Some(swings) = outcome.swings else { return Ok(()) };
    say!(
        out,
        "At {:.1} Hz the loop swings by itself; half of that is the most that is proposed.",
        swings.bandwidth_hz
    )?;
    if outcome.found.load.is_none_or(|load| load.resonance.is_none()) {
        say!(out, "The steps do not tell why: play between motor and load, perhaps, or a shaft that twists.")?;
    }
    Ok(())
}

fn decided(outcome: &Outcome, before: Bandwidths, kept: bool, out: Out) -> Result<()> {
    let Some(proposed) = outcome.proposed else {
        return match outcome.swings {
            Some(swings) if swings.bandwidth_hz <= before.speed_hz => say!(
                out,
                "None of them is calm: is the motor calm with `hallctl torque 0`? All is as it was, and may swing."
            ),
            _ => say!(out, "None of them is good: overshoot, settling and noise of the current; all is as it was."),
        };
    };
    let Bandwidths { speed_hz, position_hz } = proposed.bandwidths();
    if !outcome.good {
        say!(
            out,
            "None of them is good: overshoot, settling and noise of the current; {speed_hz:.1} Hz is calm at least."
        )?;
    }
    if !super::judge::follows(&proposed.position_step) {
        say!(out, "A step of the position overshoots by {:.0} % still.", proposed.position_step.overshoot_pct)?;
    }
    if kept {
        say!(
            out,
            "speed_bandwidth_hz is {speed_hz:.1} now and position_bandwidth_hz {position_hz:.1}; `hallctl settings save` \
             keeps them."
        )
    } else {
        say!(
            out,
            "{speed_hz:.1} Hz is proposed, and {position_hz:.1} Hz of the position; all is as it was. \
             `hallctl tune --keep` takes them."
        )
    }
}
