//! Whether the motor holds a position quietly: what swings by itself there gets slower loops until it does.

use super::recover::{BY_SWINGING, calm, off, unless};
use super::trial::stand;
use super::{Bandwidths, armed};
use crate::client::Client;
use crate::command::chirp::load::SWINGS;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::say;
use hallservo::fault::Fault;
use hallservo_protocol::Ask;
use serde_json::json;

/// So long it holds after a step, s: a load on a soft shaft swings for long, though the loop damps it.
const HELD_S: f64 = 3.0;
/// How often a bandwidth is halved at most.
const HALVINGS: usize = 10;
/// What a loop that swings comes to; one that does so at the largest current hardly turns the rotor, and feeds the supply.
const FAULTS: [Fault; 5] = [BY_SWINGING[0], BY_SWINGING[1], BY_SWINGING[2], Fault::Stall, Fault::OverVoltage];

/// Halves the bandwidths, that of the position first, until the motor holds a position quietly; where none is quiet, they
/// stay. Leaves the bridge off.
pub(in crate::command) fn quieten(client: &mut Client, out: Out) -> Result<()> {
    // Bandwidths with which it swings may have switched it off since they were set.
    off(client, &FAULTS)?;
    let before = Bandwidths::get(client)?;
    let max_current_a = client.setting(Ask::Get("max_current_a"), |setting| f64::from(setting.value))?;
    let search = |client: &mut Client| search(client, before, SWINGS * max_current_a);
    let Found { loudest_a, quiet } = armed(client, before, search, |found| found.quiet)?;
    let loudest_a = Some(loudest_a).filter(|noise_a| noise_a.is_finite());
    let swings = loudest_a.map_or_else(|| "the drive switched off".into(), |noise_a| format!("{noise_a:.2} A RMS"));
    match quiet {
        Some(quiet) if quiet == before => say!(out, "It holds a position quietly with the bandwidths as they are.")?,
        Some(Bandwidths { speed_hz, position_hz }) => say!(
            out,
            "With faster loops the motor swings by itself where it holds a position ({swings}): speed_bandwidth_hz is \
             {speed_hz:.1} now and position_bandwidth_hz {position_hz:.2}, and it holds one quietly."
        )?,
        None => say!(
            out,
            "The motor swings by itself where it holds a position ({swings}), and slower loops do not help; the bandwidths \
             stay.\n  By hand: see whether the shaft is free, and stiff up to the load."
        )?,
    }
    out.value(&json!({ "holds_quietly": quiet.is_some(), "swung_a": loudest_a, "bandwidths_hz": quiet }))
}

/// What came of it.
struct Found {
    /// Noise of the current, A RMS, of the fastest; infinite where the drive switched off.
    loudest_a: f64,
    /// The fastest that do not.
    quiet: Option<Bandwidths>,
}

fn search(client: &mut Client, before: Bandwidths, most_a: f64) -> Result<Found> {
    let (mut bandwidths, mut first) = (before, None);
    for halving in 0..=HALVINGS {
        let Some(noise_a) = noise_a(client, bandwidths)? else { break };
        let loudest_a = *first.get_or_insert(noise_a);
        if noise_a <= most_a {
            let quiet = if bandwidths == before { before } else { with_margin(client, bandwidths, most_a)? };
            return Ok(Found { loudest_a, quiet: Some(quiet) });
        }
        if halving % 2 == 0 {
            bandwidths.position_hz /= 2.0;
        } else {
            bandwidths.speed_hz /= 2.0;
        }
    }
    Ok(Found { loudest_a: first.unwrap_or(f64::INFINITY), quiet: None })
}

/// Half of bandwidths that are quiet while ones twice as fast are not: without this margin, a larger step set off the swing
/// that a small one had not. The quiet ones themselves where half of them are not quiet.
fn with_margin(client: &mut Client, quiet: Bandwidths, most_a: f64) -> Result<Bandwidths> {
    let half = Bandwidths { speed_hz: quiet.speed_hz / 2.0, position_hz: quiet.position_hz / 2.0 };
    let holds = noise_a(client, half)?.is_some_and(|noise_a| noise_a <= most_a);
    Ok(if holds { half } else { quiet })
}

/// Noise of the current while a position is held with some bandwidths, A RMS, infinite where the drive switches off. None
/// where it can hold no position with such slow ones.
fn noise_a(client: &mut Client, bandwidths: Bandwidths) -> Result<Option<f64>> {
    // Armed anew, it forgets what it has learnt of a heavier rotor and slowed its loops for.
    off(client, &FAULTS)?;
    match bandwidths.set(client) {
        Err(Error::Refused(_)) => return Ok(None),
        result => result?,
    }
    let stood = unless(client, &FAULTS, |client| {
        client.arm()?;
        calm(client)?;
        stand(client, bandwidths, HELD_S)
    })?;
    // What swings may switch off a moment later.
    off(client, &FAULTS)?;
    Ok(Some(stood.map_or(f64::INFINITY, |(_, noise)| noise.current_a)))
}
