//! Scripts: what happens to the board, and when.
//!
//! One line each; `#` begins a comment. Times are since power-on and in `s`, `ms` or `us`.
//!
//! ```text
//! at 500ms  hall 1 open            # also: good, ground, supply, stuck; Halls are 1 to 3
//! at 500ms  swap halls 1 2
//! at 1s     bus 12V
//! at 1s     current U 40A          # into a short at that phase, on top of the motor's; 0A ends it
//! at 2s     break low              # the break pin; also: high, released
//! at 1s     load 0.05Nm
//! at 1s     uart "garbage\x00\xff" # bytes into the serial port
//! at 1s     send calibrate         # a frame of the drive's protocol, see below
//! at 3s     power cut after 12 operations   # in the midst of the 13th flash operation from now; it comes back at once
//! at 3s     power cycle
//! at 4s     hang                   # the control interrupt never ends; also: hang tasks, hang 44 (an exception's number)
//! ```
//!
//! `send` takes `hello`, `status`, `arm`, `disarm`, `clear`, `calibrate`, `calibration`, `identify`, `identification`,
//! `learn-cogging`, `cogging`, `balance on|off`, `commutate block|sinusoidal|field-oriented`, `voltage X`, `torque X` (N·m),
//! `speed X` (rad/s), `position X` (turns), `get NAME`, `set NAME X`, `save`, `load`, `restore`, `telemetry X` (Hz) and
//! `history N`.

use chip::{Disturbance, HallFault};
use hallservo_protocol::{Ask, Commutation, FRAME, Request, encode};
use std::fmt;

/// Something that a script does.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// To the board, the motor or the flash.
    Disturb(Disturbance),
    /// The handler of this exception hangs from its next entry on until the next reset, 0 what is in no handler; `None` is the
    /// control interrupt.
    Hang(Option<u16>),
}

/// An action and its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Seconds since power-on.
    pub at_s: f64,
    /// What is done.
    pub action: Action,
    /// As it was written.
    pub text: String,
}

/// What is wrong with a script, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub what: String,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.what)
    }
}

impl std::error::Error for Error {}

/// Parses a script; steps come in the order of their times.
///
/// # Errors
/// The first line that is wrong.
pub fn parse(text: &str) -> Result<Vec<Step>, Error> {
    let mut steps = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let step = step(line, steps.len()).map_err(|what| Error { line: index + 1, what })?;
        steps.extend(step);
    }
    steps.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(steps)
}

fn step(line: &str, id: usize) -> Result<Option<Step>, String> {
    let words = split(line)?;
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match &words[..] {
        [] => Ok(None),
        ["at", at, rest @ ..] => {
            let at_s = time(at)?;
            let action = action(rest, id)?;
            Ok(Some(Step { at_s, action, text: rest.join(" ") }))
        }
        [first, ..] => Err(format!("a line begins with \"at\" and a time, not with {first:?}")),
    }
}

/// Words, and what is in quotes as one; a comment ends the line.
fn split(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut rest = line.trim_start();
    while !rest.is_empty() && !rest.starts_with('#') {
        let length = if rest.starts_with('"') {
            let mut escaped = false;
            let closing = rest.char_indices().skip(1).find(|&(_, character)| {
                let closes = character == '"' && !escaped;
                escaped = character == '\\' && !escaped;
                closes
            });
            closing.ok_or("the quote is not closed")?.0 + 1
        } else {
            rest.find(|character: char| character.is_whitespace() || character == '#').unwrap_or(rest.len())
        };
        words.push(rest[..length].to_owned());
        rest = rest[length..].trim_start();
    }
    Ok(words)
}

fn time(word: &str) -> Result<f64, String> {
    let units = [("ms", 1e-3), ("us", 1e-6), ("s", 1.0)];
    units
        .iter()
        .find_map(|(unit, scale)| Some(word.strip_suffix(unit)?.parse::<f64>().ok()? * scale))
        .filter(|seconds| seconds.is_finite() && *seconds >= 0.0)
        .ok_or_else(|| format!("a time is like 0.5s, 20ms or 300us, not {word:?}"))
}

/// A number with its unit behind it.
fn quantity(word: &str, unit: &str) -> Result<f64, String> {
    let number = word.strip_suffix(unit).and_then(|number| number.parse::<f64>().ok());
    number.filter(|number| number.is_finite()).ok_or_else(|| format!("expected a number with {unit}, found {word:?}"))
}

fn number(word: &str) -> Result<f64, String> {
    quantity(word, "")
}

fn whole(word: &str) -> Result<u64, String> {
    word.parse().map_err(|_| format!("expected a whole number, found {word:?}"))
}

fn hall(word: &str) -> Result<usize, String> {
    match word {
        "1" => Ok(0),
        "2" => Ok(1),
        "3" => Ok(2),
        _ => Err(format!("Halls are 1, 2 and 3, not {word:?}")),
    }
}

fn action(words: &[&str], id: usize) -> Result<Action, String> {
    use Disturbance::*;
    let disturbance = match words {
        ["hall", which, fault] => Hall(hall(which)?, hall_fault(fault)?),
        ["swap", "halls", a, b] => SwapHalls(hall(a)?, hall(b)?),
        ["bus", volts] => Bus(quantity(volts, "V")?),
        ["current", phase, amperes] => {
            let index = ["U", "V", "W"].iter().position(|name| name == phase);
            Overcurrent(index.ok_or_else(|| format!("phases are U, V and W, not {phase:?}"))?, quantity(amperes, "A")?)
        }
        ["break", "low"] => BreakPin(Some(false)),
        ["break", "high"] => BreakPin(Some(true)),
        ["break", "released"] => BreakPin(None),
        ["load", torque] => Load(quantity(torque, "Nm")?),
        ["uart", text] => Serial(bytes(text)?),
        ["send", request @ ..] => Serial(frame(ask(request)?, id)?),
        ["power", "cut", "after", count, "operations" | "operation"] => PowerCut(whole(count)?),
        ["power", "cycle"] => PowerCycle,
        ["hang"] => return Ok(Action::Hang(None)),
        ["hang", "tasks"] => return Ok(Action::Hang(Some(0))),
        ["hang", exception] => {
            let number = whole(exception)?;
            let number = u16::try_from(number).ok().filter(|number| (2..128).contains(number));
            return Ok(Action::Hang(Some(number.ok_or("exceptions are 2 to 127")?)));
        }
        [] => return Err("nothing is done".into()),
        _ => return Err(format!("cannot do {:?}", words.join(" "))),
    };
    Ok(Action::Disturb(disturbance))
}

fn hall_fault(word: &str) -> Result<HallFault, String> {
    Ok(match word {
        "good" => HallFault::Good,
        "open" => HallFault::Open,
        "ground" => HallFault::Ground,
        "supply" => HallFault::Supply,
        "stuck" => HallFault::Stuck,
        _ => return Err(format!("a Hall is good, open, ground, supply or stuck, not {word:?}")),
    })
}

/// What is in quotes, with `\xNN`, `\n`, `\r`, `\0`, `\"` and `\\`.
fn bytes(quoted: &str) -> Result<Vec<u8>, String> {
    let inner = quoted.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
    let inner = inner.ok_or_else(|| format!("expected text in quotes, found {quoted:?}"))?;
    let mut bytes = Vec::new();
    let mut rest = inner.chars();
    while let Some(character) = rest.next() {
        if character != '\\' {
            bytes.extend(character.encode_utf8(&mut [0; 4]).as_bytes());
            continue;
        }
        bytes.push(match rest.next() {
            Some('n') => b'\n',
            Some('r') => b'\r',
            Some('0') => 0,
            Some(same @ ('"' | '\\')) => same as u8,
            Some('x') => {
                let digits: String = rest.by_ref().take(2).collect();
                u8::from_str_radix(&digits, 16)
                    .map_err(|_| format!("\\x takes two hexadecimal digits, not {digits:?}"))?
            }
            other => return Err(format!("unknown escape \\{}", other.map_or(String::new(), String::from))),
        });
    }
    Ok(bytes)
}

fn ask<'a>(words: &[&'a str]) -> Result<Ask<'a>, String> {
    Ok(match words {
        ["hello"] => Ask::Hello,
        ["status"] => Ask::Status,
        ["arm"] => Ask::Arm,
        ["disarm"] => Ask::Disarm,
        ["clear"] => Ask::Clear,
        ["voltage", value] => Ask::Voltage(number(value)? as f32),
        ["torque", value] => Ask::Torque(number(value)? as f32),
        ["speed", value] => Ask::Speed(number(value)? as f32),
        ["position", value] => Ask::Position(number(value)?),
        ["commutate", "block"] => Ask::Commutate(Commutation::Block),
        ["commutate", "sinusoidal"] => Ask::Commutate(Commutation::Sinusoidal),
        ["commutate", "field-oriented"] => Ask::Commutate(Commutation::FieldOriented),
        ["calibrate"] => Ask::Calibrate,
        ["calibration"] => Ask::Calibration,
        ["identify"] => Ask::Identify,
        ["identification"] => Ask::Identification,
        ["learn-cogging"] => Ask::LearnCogging,
        ["cogging"] => Ask::Cogging,
        ["balance", "on"] => Ask::Balance(true),
        ["balance", "off"] => Ask::Balance(false),
        ["get", name] => Ask::Get(name),
        ["set", name, value] => Ask::Set { name, value: number(value)? as f32 },
        ["save"] => Ask::Save,
        ["load"] => Ask::Load,
        ["restore"] => Ask::Restore,
        ["telemetry", rate] => Ask::Telemetry(number(rate)? as f32),
        ["history", entry] => Ask::History(u8::try_from(whole(entry)?).map_err(|_| "entries are 0 to 255")?),
        _ => return Err(format!("the drive cannot be asked for {:?}", words.join(" "))),
    })
}

fn frame(ask: Ask<'_>, id: usize) -> Result<Vec<u8>, String> {
    let mut frame = [0; FRAME];
    let length = encode(&Request { id: id as u16, ask }, &mut frame).map_err(|error| format!("{error:?}"))?;
    Ok(frame[..length].to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn only(line: &str) -> Action {
        let steps = parse(line).unwrap();
        assert_eq!(steps.len(), 1);
        steps[0].action.clone()
    }

    #[test]
    fn every_line_of_the_description_is_understood() {
        let text = include_str!("script.rs");
        let described =
            text.lines().filter_map(|line| line.strip_prefix("//! ")).filter(|line| line.starts_with("at "));
        let steps: Vec<_> = described.map(only).collect();
        assert_eq!(steps.len(), 11);
        assert_eq!(steps[0], Action::Disturb(Disturbance::Hall(0, HallFault::Open)));
        assert_eq!(steps[6], Action::Disturb(Disturbance::Serial(b"garbage\x00\xff".to_vec())));
        assert_eq!(steps[10], Action::Hang(None));
    }

    #[test]
    fn steps_come_in_the_order_of_time() {
        let steps = parse("at 2s bus 12V\n\n# nothing\nat 20ms power cycle").unwrap();
        assert_eq!(steps.iter().map(|step| step.at_s).collect::<Vec<_>>(), [0.02, 2.0]);
    }

    #[test]
    fn errors_name_line_and_cause() {
        for (text, line, what) in [
            ("\nbus 12V", 2, "a line begins with \"at\" and a time, not with \"bus\""),
            ("at soon bus 12V", 1, "a time is like 0.5s, 20ms or 300us, not \"soon\""),
            ("at 1s bus 12", 1, "expected a number with V, found \"12\""),
            ("at 1s hall 4 open", 1, "Halls are 1, 2 and 3, not \"4\""),
            ("at 1s hall 1 wet", 1, "a Hall is good, open, ground, supply or stuck, not \"wet\""),
            ("at 1s uart \"open", 1, "the quote is not closed"),
            ("at 1s uart \"\\xg1\"", 1, "\\x takes two hexadecimal digits, not \"g1\""),
            ("at 1s dance", 1, "cannot do \"dance\""),
            ("at 1s send flowers", 1, "the drive cannot be asked for \"flowers\""),
            ("at 1s", 1, "nothing is done"),
        ] {
            assert_eq!(parse(text), Err(Error { line, what: what.into() }), "{text}");
        }
    }

    #[test]
    fn what_is_sent_is_a_frame() {
        let Action::Disturb(Disturbance::Serial(frame)) = only("at 1s send speed -3.5") else { panic!() };
        let mut decoder = hallservo_protocol::Decoder::new();
        let mut last = None;
        for byte in frame {
            last = decoder.push::<Request>(byte).map(|request| request.unwrap().ask == Ask::Speed(-3.5)).or(last);
        }
        assert_eq!(last, Some(true));
    }
}
