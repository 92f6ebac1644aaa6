//! `hallctl status`.

use crate::client::Client;
use crate::error::Result;
use crate::out::Out;
use crate::{say, words};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Cause, Status};
use serde_json::{Value, json};

pub(super) fn show(client: &mut Client, out: Out) -> Result<()> {
    let identity = client.identity().clone();
    let status = client.status()?;
    let lost_s = position_lost_s(client, &status)?;
    let line = |name: &str, value: &str| say!(out, "  {name:<14}{value}");
    say!(out, "{} (firmware {}), up {}", identity.board, identity.firmware, uptime(status.uptime_ms))?;
    line("state", &words::mode(status.mode))?;
    if let Mode::Faulted(fault) = status.mode {
        line("", &format!("→ {}", words::what_to_do(fault)))?;
    }
    let limits = words::limits(status.limits);
    line("limited by", &if limits.is_empty() { "nothing".into() } else { limits.join(", ") })?;
    if status.activity != Activity::None {
        line("goes on", &format!("{}, {:.0} %", words::activity(status.activity), 100.0 * status.progress))?;
    }
    line("position", &position(&status, lost_s, out))?;
    line("speed", &out.units.speed(status.speed_rad_s))?;
    line("current", &measured(status.current_a, "A along q"))?;
    line("bus", &measured(status.bus_v, "V"))?;
    let [bridge, motor] = status.temperatures_c.map(temperature);
    line("temperatures", &format!("bridge {bridge}, motor {motor}"))?;
    let anti_cogging = if status.anti_cogging { ", anti-cogging on" } else { "" };
    line("commutation", &format!("{}{anti_cogging}", words::commutation(status.commutation)))?;
    line("learning", &format!("{}, {} models so far", words::learning(status.learning), status.learnt))?;
    line("command holds", &timeout(&status))?;
    if is_controlled(client, &status) {
        line("controlled by", "another tool")?;
    }
    let [sensors, cogging, settings] = status.stored.map(words::problem);
    line("flash", &format!("sensors {sensors}"))?;
    line("", &format!("cogging {cogging}"))?;
    line("", &format!("settings {settings}"))?;
    if status.unconfirmed {
        line(
            "",
            "the bridge stays off until you have looked at `hallctl settings list`, then `hallctl settings save`",
        )?;
    }
    if status.unsaved {
        line(
            "",
            "it does not hold all yet: settings wait for `hallctl settings save`, what was learnt for the bridge to be off",
        )?;
    }
    let lost = format!(
        "{} samples, {} frames to the tools, {} from them",
        status.lost_records, status.lost_frames, status.garbage
    );
    line("lost", &lost)?;
    if status.incidents > 0 {
        line("history", &format!("{} entries: `hallctl faults`", status.incidents))?;
    }
    out.value(&value(client, &status, lost_s))
}

fn is_controlled(client: &Client, status: &Status) -> bool {
    status.client != 0 && !client.is_me(status.client)
}

/// When the count of turns was lost last, seconds since power-up: without an angle, nobody counts.
fn position_lost_s(client: &mut Client, status: &Status) -> Result<Option<f64>> {
    if status.incidents == 0 {
        return Ok(None);
    }
    let loses = |cause| matches!(cause, Cause::Fault(Fault::Hall(_) | Fault::AngleJump));
    let (_, incidents) = client.incidents()?;
    Ok(incidents.iter().find(|incident| loses(incident.cause)).map(|incident| incident.at_ms as f64 / 1000.0))
}

/// Whether there is no angle at the moment.
const fn has_no_angle(mode: Mode) -> bool {
    matches!(mode, Mode::Faulted(Fault::Hall(_) | Fault::AngleJump))
}

fn position(status: &Status, lost_s: Option<f64>, out: Out) -> String {
    match lost_s {
        _ if has_no_angle(status.mode) => "lost: the Halls give no angle".into(),
        None => out.units.position(status.position_turns),
        Some(at_s) => {
            format!("{} (turns before the fault at {at_s:.1} s are lost)", out.units.position(status.position_turns))
        }
    }
}

/// All of it for a script.
fn value(client: &Client, status: &Status, lost_s: Option<f64>) -> Value {
    let identity = client.identity();
    let fault = if let Mode::Faulted(fault) = status.mode { Some(words::fault_value(fault)) } else { None };
    let [bridge_c, motor_c] = status.temperatures_c;
    let [sensors, cogging, settings] = status.stored.map(words::problem);
    json!({
        "board": identity.board,
        "firmware": identity.firmware,
        "uptime_s": status.uptime_ms as f64 / 1000.0,
        "state": words::mode_word(status.mode),
        "fault": fault,
        "limits": words::limits(status.limits),
        "activity": (status.activity != Activity::None).then(|| words::activity(status.activity)),
        "progress": status.progress,
        "calibrated": status.calibrated,
        "position_turns": (!has_no_angle(status.mode)).then_some(status.position_turns),
        "position_lost_at_s": lost_s,
        "speed_rad_s": status.speed_rad_s,
        "current_a": status.current_a,
        "bus_v": status.bus_v,
        "bridge_c": bridge_c,
        "motor_c": motor_c,
        "commutation": words::commutation(status.commutation),
        "anti_cogging": status.anti_cogging,
        "learning": words::learning(status.learning),
        "models_learnt": status.learnt,
        "command_timeout_s": status.command_timeout_s,
        "controlled_by_another": is_controlled(client, status),
        "flash": { "sensors": sensors, "cogging": cogging, "settings": settings },
        "unconfirmed": status.unconfirmed,
        "unsaved": status.unsaved,
        "lost_samples": status.lost_records,
        "lost_frames": status.lost_frames,
        "garbage": status.garbage,
        "incidents": status.incidents,
    })
}

fn uptime(milliseconds: u64) -> String {
    let seconds = milliseconds / 1000;
    format!("{}:{:02}:{:02}.{:03}", seconds / 3600, seconds / 60 % 60, seconds % 60, milliseconds % 1000)
}

fn timeout(status: &Status) -> String {
    if status.command_timeout_s.is_finite() {
        format!("{} s", status.command_timeout_s)
    } else {
        "for ever (command_timeout_s)".into()
    }
}

fn temperature(celsius: f32) -> String {
    if celsius.is_nan() { "no thermistor".into() } else { format!("{celsius:.1} °C") }
}

fn measured(value: f32, unit: &str) -> String {
    if value.is_nan() { "not measured".into() } else { format!("{value:.2} {unit}") }
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_thermistor_is_said() {
        assert_eq!(super::temperature(f32::NAN), "no thermistor");
        assert_eq!(super::temperature(31.25), "31.2 °C");
    }
}
