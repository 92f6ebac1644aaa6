//! What a drive says, for a script: `--json` and Python have the same.

use crate::client::Client;
use crate::error::Result;
use crate::words;
use hallservo::fault::Fault;
use hallservo::hall::calibrate::report::Report;
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Cause, Status};
use serde_json::{Value, json};

/// How the drive is; what is not measured is null.
///
/// # Errors
/// As [`Client::ask`].
pub fn status(client: &mut Client) -> Result<Value> {
    let status = client.status()?;
    let lost_s = position_lost_s(client, &status)?;
    Ok(status_of(client, &status, lost_s))
}

/// Whether another tool controls the drive.
pub(crate) fn is_controlled(client: &Client, status: &Status) -> bool {
    status.client != 0 && !client.is_me(status.client)
}

/// When the count of turns was lost last, seconds since power-up: without an angle, nobody counts.
pub(crate) fn position_lost_s(client: &mut Client, status: &Status) -> Result<Option<f64>> {
    if status.incidents == 0 {
        return Ok(None);
    }
    let loses = |cause| matches!(cause, Cause::Fault(Fault::Hall(_) | Fault::AngleJump));
    let (_, incidents) = client.incidents()?;
    Ok(incidents.iter().find(|incident| loses(incident.cause)).map(|incident| incident.at_ms as f64 / 1000.0))
}

/// Whether there is no angle at the moment.
pub(crate) const fn has_no_angle(mode: Mode) -> bool {
    matches!(mode, Mode::Faulted(Fault::Hall(_) | Fault::AngleJump))
}

/// The same of a drive that was asked.
pub(crate) fn status_of(client: &Client, status: &Status, lost_s: Option<f64>) -> Value {
    let identity = client.identity();
    let fault = if let Mode::Faulted(fault) = status.mode { Some(words::fault_value(fault)) } else { None };
    let [bridge_c, motor_c] = status.temperatures_c;
    let [sensors, cogging, settings] = status.stored.map(words::problem);
    json!({
        "board": identity.board,
        "firmware": identity.firmware,
        "serial_number": identity.serial,
        "uptime_s": status.uptime_ms as f64 / 1000.0,
        "state": words::mode_word(status.mode),
        "fault": fault,
        "limits": words::limits_in(status.mode, status.limits),
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

/// What a calibration has found.
pub fn calibration(report: &Report) -> Value {
    let halls = report.present().iter().map(|sensor| {
        json!({
            "swing_codes": sensor.swing,
            "offset_codes": sensor.offset,
            "placement_error_deg": sensor.placement_error.to_degrees(),
            "third_pct": sensor.third_pct,
            "fifth_pct": sensor.fifth_pct,
            "noise_pct": sensor.noise_pct,
        })
    });
    json!({
        "halls": halls.collect::<Vec<_>>(),
        "spacing_deg": report.pattern.spacing,
        "in_order_of_phases": report.pattern.forward,
        "angle_noise_deg": report.angle_noise_deg,
        "lag_deg": report.lag.to_degrees().abs(),
        "hunting_deg": report.hunting_deg,
        "residual_pct": report.residual_pct,
        "findings": report.findings().map(|finding| finding.to_string()).collect::<Vec<_>>(),
    })
}
