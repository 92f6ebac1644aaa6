//! `hallctl faults`.

use crate::client::{Client, unexpected};
use crate::error::Result;
use crate::words;
use hallservo_protocol::{Answer, Ask};

pub(super) fn show(client: &mut Client) -> Result<()> {
    let (now_ms, entries) = client.status().map(|status| (status.uptime_ms, status.incidents))?;
    if entries == 0 {
        println!("Nothing went wrong since power-up.");
    }
    let mut total = 0;
    for number in 0..entries {
        let history = client.ask(Ask::History(number), |answer| match answer {
            Answer::History(history) => Ok(history),
            other => unexpected(&other),
        })?;
        total = history.total;
        let Some(incident) = history.entry else { break };
        let (text, advice) = words::incident(&incident);
        let at = incident.at_ms as f64 / 1000.0;
        let ago = now_ms.saturating_sub(incident.at_ms) as f64 / 1000.0;
        println!("{at:>10.3} s  ({ago:.1} s ago, {})  {text}", words::mode_word(incident.mode));
        println!("              → {advice}");
    }
    if total > u32::from(entries) {
        println!("… and {} before that.", total - u32::from(entries));
    }
    Ok(())
}
