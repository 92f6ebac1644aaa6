//! `hallctl faults`.

use crate::client::Client;
use crate::error::Result;
use crate::out::Out;
use crate::{say, words};
use serde_json::json;

pub(super) fn show(client: &mut Client, out: Out) -> Result<()> {
    let now_ms = client.status()?.uptime_ms;
    let (total, incidents) = client.incidents()?;
    if incidents.is_empty() {
        say!(out, "Nothing went wrong since power-up.")?;
    }
    let mut values = Vec::new();
    for incident in &incidents {
        let (text, advice) = words::incident(incident);
        let at_s = incident.at_ms as f64 / 1000.0;
        let ago_s = now_ms.saturating_sub(incident.at_ms) as f64 / 1000.0;
        let mode = words::mode_word(incident.mode);
        say!(out, "{at_s:>10.3} s  ({ago_s:.1} s ago, {mode})  {text}")?;
        say!(out, "              → {advice}")?;
        values.push(json!({ "at_s": at_s, "ago_s": ago_s, "state": mode, "what": text, "advice": advice }));
    }
    let more = total.saturating_sub(incidents.len() as u32);
    if more > 0 {
        say!(out, "… and {more} before that.")?;
    }
    out.value(&json!({ "incidents": values, "total": total }))
}
