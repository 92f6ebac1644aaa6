//! What the drive says by numbers, in words, and what to do about it.

pub mod encoder;

use crate::scope::name;
use hallservo::commutation::Commutation;
use hallservo::control::config::BadDemand;
use hallservo::control::impedance;
use hallservo::drive;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::scope;
use hallservo::service::procedure;
use hallservo::settings::{self, Kind};
use hallservo_protocol::{
    Activity, Ask, Cause, Incident, Learning, MagnetsAsk, MagnetsRefusal, Problem, Record, Refusal, ScopeAsk,
    ScopeRefusal, Setting, Status,
};
use serde_json::{Value, json};

/// A state.
pub fn mode(mode: Mode) -> String {
    match mode {
        Mode::Unarmed => "unarmed: bridge off, not calibrated".into(),
        Mode::Aligning => "aligning: a standing field pulls the rotor into line".into(),
        Mode::Calibrating => "calibrating: the field drags the rotor along".into(),
        Mode::Ready => "ready: bridge off, calibrated".into(),
        Mode::Running => "running: bridge on".into(),
        Mode::Faulted(fault) => format!("faulted: {fault}"),
    }
}

/// One word for a table.
pub fn mode_word(mode: Mode) -> &'static str {
    match mode {
        Mode::Unarmed => "unarmed",
        Mode::Aligning => "aligning",
        Mode::Calibrating => "calibrating",
        Mode::Ready => "ready",
        Mode::Running => "running",
        Mode::Faulted(_) => "faulted",
    }
}

/// Everything that limits the drive; empty where nothing does.
pub fn limits(limits: Limits) -> Vec<&'static str> {
    let names = [
        (Limits::DUTY, "voltage"),
        (Limits::EXTRAPOLATED, "an angle extrapolated"),
        (Limits::CURRENT, "current"),
        (Limits::HEAT, "heat"),
        (Limits::SUPPLY, "what the supply gives or takes back"),
        (Limits::CHECKING, "the check at arming"),
        (Limits::TIMEOUT, "stopped: no command came for too long"),
        (Limits::TWO_HALLS, "running on two Halls"),
    ];
    names.into_iter().filter(|(limit, _)| limits.contains(*limit)).map(|(_, name)| name).collect()
}

/// The same in a mode: with the bridge off nothing is asked for that could be too much, whatever was before.
pub fn limits_in(mode: Mode, active: Limits) -> Vec<&'static str> {
    let of_commands = Limits::DUTY.with(Limits::CURRENT).with(Limits::SUPPLY).with(Limits::CHECKING);
    limits(if mode.drives() { active } else { active.without(of_commands) })
}

/// A commutation.
pub const fn commutation(commutation: Commutation) -> &'static str {
    match commutation {
        Commutation::Block => "block",
        Commutation::Sinusoidal => "sinusoidal",
        Commutation::FieldOriented => "field-oriented",
    }
}

/// What goes on.
pub const fn activity(activity: Activity) -> &'static str {
    match activity {
        Activity::None => "nothing",
        Activity::Calibration => "a calibration",
        Activity::Identification => "the identification of the motor",
        Activity::Cogging => "learning the cogging",
        Activity::Swings => "swinging the rotor",
        Activity::Encoder => "the calibration of the encoder",
        Activity::Magnets => "learning the magnets",
    }
}

/// A kind of record.
pub const fn record(record: Record) -> &'static str {
    match record {
        Record::Sensors => "sensors",
        Record::Cogging => "cogging",
        Record::Settings => "settings",
        Record::Encoder => "encoder",
        Record::Magnets => "map of the magnets",
    }
}

/// What the flash holds.
pub fn problem(problem: Problem) -> String {
    match problem {
        Problem::None => "stored".into(),
        Problem::Blank => "none stored".into(),
        Problem::Corrupt => "corrupt, not used".into(),
        Problem::Version(found) => format!("of version {found}, another firmware's, not used"),
        Problem::Foreign => {
            "stored, but for a setting that this firmware does not know or allow: that has its default".into()
        }
        Problem::Flash => "the flash failed".into(),
    }
}

/// The Kalman filter in the tasks.
pub fn learning(learning: Learning) -> String {
    match learning {
        Learning::Off => "off".into(),
        Learning::On => "on".into(),
        Learning::Ended(why) => format!("ended: {why}"),
        Learning::Uneven => "paused, the magnets look uneven: the calibration is used, and it is tried again".into(),
        Learning::TooFast => "paused, the motor turns too fast to learn: what was learnt is used".into(),
    }
}

/// What to do about a fault, in the order in which it works.
pub fn what_to_do(fault: Fault) -> String {
    let then = fault.after_clearing().map(|then| format!("; {then}")).unwrap_or_default();
    format!("{}; then `hallctl clear`{then}", fault.advice())
}

/// That a fault has switched the bridge off, and what to do.
pub fn switched_off(fault: Fault) -> String {
    format!("the drive switched off: {fault}\n  {}.", what_to_do(fault))
}

/// That a command is over, the bridge off.
pub const STOPPED: &str = "the bridge was switched off meanwhile: another tool, `hallctl stop` perhaps";

/// The same where the bridge is on: a tool that was suspended cannot tell which.
pub const TAKEN: &str = "the bridge was switched off meanwhile, or another tool has controlled the drive, or it has heard \
                         nothing from this one for command_timeout_s";

/// A fault for a script.
pub fn fault_value(fault: Fault) -> Value {
    json!({ "code": fault.code(), "what": fault.to_string(), "advice": what_to_do(fault) })
}

/// What to do about a calibration that failed, where the drive is calibrated now.
const CALIBRATED_SINCE: &str = "nothing: it was calibrated since; `hallctl commission` tries slower fields by itself";

/// What went wrong, and what is left to do of it as the drive is now.
pub fn incident_of(incident: &Incident, status: &Status) -> (String, String) {
    let (text, advice) = self::incident(incident);
    let is_over = incident.cause == Cause::Fault(Fault::Calibration)
        && status.calibrated
        && !matches!(status.mode, Mode::Faulted(_) | Mode::Aligning);
    (text, if is_over { CALIBRATED_SINCE.into() } else { advice })
}

/// What went wrong, and what to do.
pub fn incident(incident: &Incident) -> (String, String) {
    match incident.cause {
        Cause::Fault(fault) => (fault.to_string(), what_to_do(fault)),
        Cause::Stored(kind, why) => {
            let advice = match kind {
                Record::Sensors => "`hallctl calibrate` stores them anew",
                Record::Cogging => "`hallctl cogging learn` stores it anew",
                Record::Settings => {
                    "look through `hallctl settings list`, set what is missing, then `hallctl settings save`"
                }
                Record::Magnets => "`hallctl magnets learn` learns it anew",
                Record::Encoder => "`hallctl encoder calibrate` stores it anew, `hallctl encoder zero` its zero",
            };
            (format!("the {} in the flash: {}", record(kind), problem(why)), advice.into())
        }
        Cause::NotSaved(kind) => {
            (format!("the {} could not be saved", record(kind)), "the flash may be worn out".into())
        }
        Cause::Abandoned(what) => (
            format!("{} was ended: its tool fell silent", activity(what)),
            "keep hallctl running, or begin it by `--unattended`".into(),
        ),
        Cause::Adaptation(why) => (why.to_string(), "`hallctl calibrate`, after a look at that Hall".into()),
        Cause::Heavier => (
            "the rotor swung about its position, much heavier than inertia_kgm2: until it is armed again, the position is \
             controlled more slowly"
                .into(),
            "`hallctl commission` with everything on the shaft that it is to turn".into(),
        ),
        Cause::Lighter => (
            "the speed control swung the rotor to and fro, as one much lighter than inertia_kgm2 or on a soft shaft: until \
             it is armed again, its gains are smaller"
                .into(),
            "`hallctl commission` with what is on the shaft now, or a smaller `speed_bandwidth_hz`".into(),
        ),
    }
}

const NO_SCOPE: &str = "this drive has no scope: its memory is too small for one\n  `hallctl telemetry` records up to \
                        1000 times a second.";

/// What a drive lacks that does not answer this, though it answers what comes behind.
pub const fn lacks(ask: &Ask<'_>) -> Option<&'static str> {
    match ask {
        Ask::Scope(ScopeAsk::Status) => Some(NO_SCOPE),
        Ask::Magnets(MagnetsAsk::Status) => Some(
            "the firmware of this drive knows no map of the magnets: it leaves no room for one\n  A board with more flash \
             does, as the Nucleo-G474RE's; without it the angle is as good as the magnets are even.",
        ),
        _ => None,
    }
}

/// Why something is refused, and what to do.
pub fn refusal(refusal: &Refusal<'_>) -> String {
    match refusal {
        Refusal::Drive(why) => drive_refusal(*why),
        Refusal::Demand(bad) => {
            format!("{} is beyond ±{}, which the settings allow", bad.value, short(bad.most))
        }
        Refusal::Procedure(error) => procedure_error(error),
        Refusal::Setting(error) => setting_error(error),
        Refusal::NothingStored(why) => format!("there are no settings in the flash to go back to ({})", problem(*why)),
        Refusal::Encoder(why) => encoder::refusal(why),
        Refusal::Magnets(MagnetsRefusal::None) => {
            "there is no map of the magnets\n  `hallctl magnets learn` learns one.".into()
        }
        Refusal::Magnets(MagnetsRefusal::Encoder) => {
            "there is an encoder on the shaft: a map of the magnets is for drives without".into()
        }
        Refusal::Scope(ScopeRefusal::None) => NO_SCOPE.into(),
        Refusal::Scope(ScopeRefusal::Setup(error)) => setup_error(error),
        Refusal::Scope(ScopeRefusal::Busy) => {
            "another tool records\n  Wait until it ends; two seconds after one was killed the scope is free.".into()
        }
        Refusal::Scope(ScopeRefusal::Gone) => {
            "the recording is gone: the drive was restarted or calibrated, or another tool records\n  Record again."
                .into()
        }
        Refusal::Flash => "the flash did not take it\n  Try again; the flash may be worn out.".into(),
        Refusal::NoTable => "the cogging is not learnt yet\n  `hallctl cogging learn` first.".into(),
        Refusal::Busy(what) => format!("{} is at work\n  Wait, or end it by `hallctl stop`.", activity(*what)),
        Refusal::Controlled => {
            "another tool controls the drive\n  Wait until it ends, or stop the motor by `hallctl stop`, which \
                                anyone may."
                .into()
        }
        Refusal::Unconfirmed(why) => format!(
            "the settings in the flash: {}; those in use may be less strict\n  Look through `hallctl settings list`, \
             set what is missing, then `hallctl settings save` (or `hallctl settings accept`, until the power is switched off).",
            problem(*why)
        ),
        Refusal::Impedance(impedance::Error::NoControl) => NO_CONTROL.into(),
        Refusal::Impedance(error) => impedance_error(error),
        Refusal::NoAnswer => {
            "the control interrupt does not answer\n  Does its timer run? Look at the board's log.".into()
        }
    }
}

/// Why a demand is refused, with its unit and what limits it.
pub fn demand(ask: &Ask<'_>, bad: BadDemand) -> String {
    let (what, unit, limit) = match ask {
        Ask::Voltage(_) => ("a voltage", "", "max_modulation allows"),
        Ask::Torque(_) => ("a torque", " Nm", "max_current_a allows"),
        Ask::Speed(_) => ("a speed", " rad/s", "max_speed_rad_s allows"),
        Ask::Position(_) => ("a position", " turns", "is as far as the drive counts"),
        Ask::Telemetry(_) => return format!("{} Hz is beyond 0 to {} Hz", short(bad.value), short(bad.most)),
        _ => return refusal(&Refusal::Demand(bad)),
    };
    format!("{what} of {}{unit} is beyond ±{}{unit}, which {limit}", short(bad.value), digits(bad.most, 4))
}

/// What cannot be in a spring and a damper. A limit that no float exceeds is none.
fn impedance_error(error: &impedance::Error) -> String {
    let said = error.to_string();
    match (error, said.split_once(", but must be ")) {
        (impedance::Error::OutOfRange { least, most, .. }, Some((what, _))) if *most == f32::MAX => {
            format!("{what}, but must be {least} or more")
        }
        _ => said,
    }
}

/// Why nothing is recorded, with the channels as one types them.
fn setup_error(error: &scope::Error) -> String {
    match error {
        scope::Error::Twice(channel) => format!("{} is to be recorded twice", name(*channel)),
        scope::Error::NoControl(channel) => {
            format!("{} needs current sensing, which this drive does not have", name(*channel))
        }
        error => error.to_string(),
    }
}

/// Why the drive refuses a command, and what to do.
fn drive_refusal(refusal: drive::Refusal) -> String {
    match refusal {
        drive::Refusal::Mode(Mode::Faulted(fault)) => {
            format!("the drive is faulted: {fault}\n  {}.", what_to_do(fault))
        }
        drive::Refusal::Mode(Mode::Running) => "the bridge is on\n  `hallctl stop` first.".into(),
        drive::Refusal::Mode(Mode::Ready | Mode::Unarmed) => "the bridge is off\n  `hallctl arm` first.".into(),
        drive::Refusal::Mode(_) => "the drive calibrates\n  Wait, or end it by `hallctl stop`.".into(),
        drive::Refusal::NotCalibrated => {
            "there is no calibration\n  `hallctl calibrate` first: it turns the rotor.".into()
        }
        drive::Refusal::NoAngle => {
            "the Halls give no plausible angle\n  Check their supply, wires and the magnet.".into()
        }
        drive::Refusal::TooLarge => "the command is beyond what the settings allow".into(),
        drive::Refusal::HallLost => "a Hall is lost\n  Repair it, then `hallctl calibrate`.".into(),
        drive::Refusal::NoControl => NO_CONTROL.into(),
        drive::Refusal::Fault(fault) => format!("{fault}\n  {}.", fault.advice()),
        drive::Refusal::Turning => "the rotor turns\n  Let it come to rest first.".into(),
        drive::Refusal::OutOfBounds => {
            "the position is outside of its bounds\n  They are min_position_turns and max_position_turns.".into()
        }
        drive::Refusal::TooFar => {
            "the position, or the range, is farther from the rotor than following_error_turns\n  \
             `hallctl position` first, or let the reference go there by limits of speed and acceleration."
                .into()
        }
    }
}

const NO_CONTROL: &str = "this drive has no current control: it can be given a voltage only";

/// What limits a setting that others limit, where that is not plain.
fn reason(field: &str) -> &'static str {
    match field {
        "field_weakening_a" => {
            "\n  More than seven eighths of max_current_a leave no torque; more than eight tenths of flux_linkage_wb over \
             inductance_h would turn the field round."
        }
        "over_current_a" => {
            "\n  It is at least 8.8 % above max_current_a, for noise and overshoot: raise this one first, lower that one first, or \
             let `hallctl commission --max-current` set both."
        }
        "least_low_side_s" => {
            "\n  Set field_weakening_a to 0, or this: they do not go together. Without field weakening, sampling_window_s \
             limits it."
        }
        "max_speed_rad_s" => {
            "\n  With field_weakening_a, the voltage of a motor that is switched off at this speed must be below \
             over_voltage_v: it reaches the supply through the bridge's diodes. Else max_electrical_hz limits it."
        }
        _ => "",
    }
}

/// Why a setting cannot be changed so, and what to do.
pub fn setting_error(error: &settings::Error<'_>) -> String {
    match error {
        settings::Error::OutOfRange { field, value, min, max } if max <= min => format!(
            "{field} of {value} is beyond the integers of the control, with the other settings as they are\n  Choose a smaller \
             one. Where none is small enough, one of resistance_ohm, inductance_h, flux_linkage_wb and inertia_kgm2 is far from \
             that of any motor for this board."
        ),
        settings::Error::OutOfRange { field, value, min, max } => {
            let (min, max) = (short(*min), short(*max));
            let why = reason(field);
            format!(
                "{field} would be {value}, but must be from {min} to {max}, with the other settings as they are{why}"
            )
        }
        settings::Error::Ceiling { field, value, most } => {
            format!("{field} would be {}, but the board's ceiling is {}", short(*value), short(*most))
        }
        settings::Error::NoControl => NO_CONTROL.into(),
        settings::Error::Unknown => format!("{error}\n  `hallctl settings list` names them all."),
        error => error.to_string(),
    }
}

/// Why a procedure came to nothing.
pub fn procedure_error(error: &procedure::Error) -> String {
    use procedure::Error;
    match error {
        Error::NoControl => NO_CONTROL.into(),
        Error::Demand(bad) => refusal(&Refusal::Demand(*bad)),
        Error::Refused(why) => drive_refusal(*why),
        Error::Fault(fault) => format!("{fault}\n  {}.", what_to_do(*fault)),
        Error::NotReached => {
            format!("{error}\n  Is the rotor blocked or loaded, are pole_pairs and the motor's settings right?")
        }
        Error::Inconclusive => format!("{error}\n  Is the shaft free?"),
        Error::Disarmed | Error::Cancelled => format!("{error}\n  Another tool, `hallctl stop` perhaps."),
        error => error.to_string(),
    }
}

/// A setting's value as a person writes it.
pub fn value(setting: &Setting<'_>, value: f32) -> String {
    match setting.kind {
        Kind::Switch => if value == 0.0 { "no" } else { "yes" }.into(),
        Kind::Choice(names) => names.split('|').nth(value as usize).unwrap_or("?").into(),
        Kind::Whole => format!("{value:.0}"),
        Kind::Real => number(value),
    }
}

/// With six digits, for a limit that was computed.
pub fn short(value: f32) -> String {
    digits(value, 6)
}

/// With so many digits.
fn digits(value: f32, count: usize) -> String {
    format!("{value:.*e}", count - 1).parse().map_or_else(|_| value.to_string(), number)
}

/// With as many digits as a float has, and an exponent where that is shorter.
fn number(value: f32) -> String {
    let plain = value.to_string();
    let scientific = format!("{value:e}");
    if plain.len() > scientific.len() + 2 { scientific } else { plain }
}

/// The number of a value as a person writes it.
pub fn parse(setting: &Setting<'_>, text: &str) -> Option<f32> {
    match setting.kind {
        Kind::Switch => match text {
            "yes" | "on" | "true" | "1" => Some(1.0),
            "no" | "off" | "false" | "0" => Some(0.0),
            _ => None,
        },
        Kind::Choice(names) => names.split('|').position(|name| name == text).map(|place| place as f32),
        Kind::Real | Kind::Whole => {
            let text = text.trim();
            let infinite = text.trim_start_matches(['+', '-']).to_lowercase().starts_with("inf");
            // What is too large for a float is no infinity, and means nothing.
            text.parse().ok().filter(|value: &f32| value.is_finite() || infinite)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_limits_what_is_not_asked_for() {
        let active = Limits::CURRENT.with(Limits::HEAT).with(Limits::TIMEOUT);
        assert_eq!(limits_in(Mode::Running, active), limits(active));
        assert_eq!(limits_in(Mode::Ready, active), ["heat", "stopped: no command came for too long"]);
    }
}
