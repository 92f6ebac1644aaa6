//! `hallctl status`.

use super::motion::AT_REST_RAD_S;
use crate::client::Client;
use crate::error::Result;
use crate::out::Out;
use crate::values::{self, has_no_angle, is_controlled, position_lost_s};
use crate::{say, words};
use hallservo::mode::Mode;
use hallservo_app::storage::SAVE_INTERVAL_S;
use hallservo_protocol::{Activity, Status};

pub(super) fn show(client: &mut Client, out: Out) -> Result<()> {
    let identity = client.identity().clone();
    let status = client.status()?;
    let lost_s = position_lost_s(client, &status)?;
    let line = |name: &str, value: &str| say!(out, "  {name:<14}{value}");
    say!(out, "{} (firmware {}), up {}", identity.board, identity.firmware, uptime(status.uptime_ms))?;
    line("serial number", &identity.serial)?;
    line("state", &words::mode(status.mode))?;
    if let Mode::Faulted(fault) = status.mode {
        line("", &format!("→ {}", words::what_to_do(fault)))?;
    }
    let limits = words::limits_in(status.mode, status.limits);
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
        line("", &format!("it does not hold all yet: {}", waits(&status)))?;
    }
    let lost = format!(
        "{} samples, {} frames to the tools, {} from them",
        status.lost_records, status.lost_frames, status.garbage
    );
    line("lost", &lost)?;
    if status.incidents > 0 {
        line("history", &format!("{} on record: `hallctl faults`", status.incidents))?;
    }
    out.value(&values::status_of(client, &status, lost_s))
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

/// What the flash does not hold yet, and for what that waits. A calibration is saved as soon as the rotor rests, the bridge
/// off; what was learnt beyond it not more often than each few minutes.
fn waits(status: &Status) -> String {
    let mut waits = vec!["settings wait for `hallctl settings save`".to_owned()];
    let rests = !status.mode.drives() && status.speed_rad_s.abs() < AT_REST_RAD_S;
    if !rests {
        waits.push("what was learnt, for the bridge to be off and the rotor to rest".into());
    } else if status.learnt > 0 {
        waits.push(format!("what was learnt, for its turn each {} minutes", SAVE_INTERVAL_S / 60));
    }
    waits.join(", or ")
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
