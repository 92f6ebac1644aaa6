//! `hallctl faults`.

use crate::client::Client;
use crate::error::Result;
use crate::out::Out;
use crate::{say, words};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo_protocol::{Cause, Incident};
use serde_json::json;

pub(super) fn show(client: &mut Client, out: Out) -> Result<()> {
    let status = client.status()?;
    let now_ms = status.uptime_ms;
    let (total, incidents) = client.incidents()?;
    if incidents.is_empty() {
        say!(out, "Nothing went wrong since power-up.")?;
    }
    let mut values = Vec::new();
    for incident in &incidents {
        let (text, advice) = words::incident_of(incident, &status);
        let at_s = incident.at_ms as f64 / 1000.0;
        let ago_s = now_ms.saturating_sub(incident.at_ms) as f64 / 1000.0;
        let mode = words::mode_word(incident.mode);
        say!(out, "{at_s:>10.3} s  ({ago_s:.1} s ago, {mode})  {text}")?;
        say!(out, "              → {advice}")?;
        values.push(json!({ "at_s": at_s, "ago_s": ago_s, "state": mode, "what": text, "advice": advice }));
    }
    if !matches!(status.mode, Mode::Faulted(_)) && incidents.iter().any(may_be_a_try) {
        say!(
            out,
            "`hallctl commission` and `hallctl tune` try what may go wrong, and go on: their tries are here, too."
        )?;
    }
    let more = total.saturating_sub(incidents.len() as u32);
    if more > 0 {
        say!(out, "… and {more} before that.")?;
    }
    out.value(&json!({ "incidents": values, "total": total }))
}

/// What a procedure comes to that looks for the limits of a motor.
fn may_be_a_try(incident: &Incident) -> bool {
    use Fault::{Calibration, Commutation, FollowingError, OverSpeed, OverVoltage, Stall};
    let tries = [Calibration, Commutation, FollowingError, OverSpeed, OverVoltage, Stall];
    matches!(incident.cause, Cause::Fault(fault) if tries.contains(&fault))
}
