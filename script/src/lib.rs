//! What may happen to a drive, and when: the language of `cargo virtual --script`, of `hallctl simulate --fault`, and
//! of what a person types into `hallctl simulate`.
//!
//! A script has an event a line; `#` begins a comment. A time is in `s`, `ms` or `us`: since power-on on a virtual
//! board, in the state running, all together, in a simulated drive.
//!
//! ```text
//! at 500ms  hall 1 open            # the wire of a Hall, 1 to 3; also: good, ground, supply, stuck (stays where it is)
//! at 500ms  swap halls 1 2
//! at 500ms  head 1 2 stuck         # of an encoder: over ring 1, head 2 shows what it showed last
//! at 500ms  ring 2 slips 3deg      # it has turned on the shaft; rings slip 3deg: both, together
//! at 500ms  ring 1 chipped 5       # the field of a pole pair is gone; rings good: heads and rings as at power-up
//! at 1s     bus 12V                # the supply
//! at 1s     current U 40A          # into a short at that phase, on top of the motor's; 0A ends it
//! at 2s     break low              # the break pin; also: high, released
//! at 2s     enable open             # the contact of the enable input; also: closed
//! at 1s     load 0.05Nm            # torque against the shaft
//! at 1s     turn 2                 # a hand turns the shaft by so many turns, backwards if negative, a second each
//! at 1s     hot                    # the bridge's thermistor reads 150 °C
//! at 1s     late                   # control periods are lost
//! at 2s     mend                   # Halls, rings, supply, load, thermistor and periods are as they were
//! at 1s     uart "garbage\x00\xff" # bytes into the serial port
//! at 1s     send calibrate         # a request of the drive's protocol
//! at 3s     power cut after 12 operations   # in the midst of the 13th flash operation from now; it comes back at once
//! at 3s     power cycle
//! at 4s     hang                   # the control interrupt never ends; also: hang tasks, hang 44 (an exception)
//! ```
//!
//! On a command line an event goes before its time, with hyphens for the spaces, and Hall 1 needs no number:
//! `bus-12V@1s`, `hall-2-stuck@40s`, `hall-open@40s`. Typed, it has no time, and happens at once: `turn 2`,
//! or with hyphens, too: `hall-open`.
//!
//! Not every drive can do everything: a virtual board turns no shaft by hand, heats no bridge, loses no period and mends
//! nothing; a simulated drive has no pins, no wires to swap, no serial port to disturb and no flash that is cut. Each
//! says so when it is asked to.
//!
//! `send` takes `hello`, `status`, `arm`, `disarm`, `clear`, `calibrate`, `calibration`, `identify`, `identification`,
//! `learn-cogging`, `cogging`, `anti-cogging on|off`, `commutate block|sinusoidal|field-oriented`, `voltage X`, `torque
//! X` (N·m), `speed X` (rad/s), `position X` (turns), `get NAME`, `set NAME X`, `save`, `load`, `restore`, `telemetry
//! X` (Hz), `history N` and `encoder status|calibrate|zero|align|forget`; who sends it knows the protocol.

mod event;
pub mod words;

use std::fmt;

/// Something that happens.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A Hall's wire, 0 to 2.
    Hall(usize, HallWire),
    /// The wires of two Halls are exchanged, 0 to 2.
    SwapHalls(usize, usize),
    /// Something breaks of the encoder; `None`: it is as good as at power-up.
    Rings(Option<plant::heads::Defect>),
    /// The supply's voltage, V.
    Bus(f64),
    /// A current that flows out of a phase (0 to 2) through a short, in addition to the motor's, A.
    Current(usize, f64),
    /// Level of the break pin; `None` lets go of it.
    Break(Option<bool>),
    /// Whether the contact of the enable input is closed.
    Enable(bool),
    /// Torque against the shaft, N·m.
    Load(f64),
    /// A hand turns the shaft by so many turns.
    Turn(f64),
    /// The bridge's thermistor reads 150 °C.
    Hot,
    /// Control periods are lost.
    Late,
    /// All that a simulated drive can suffer is over: Halls, supply, load, thermistor and periods are as at power-up.
    Mend,
    /// Bytes into the serial port.
    Uart(Vec<u8>),
    /// A request of the drive's protocol, in words.
    Send(Vec<String>),
    /// The power goes in the middle of the flash operation that follows this many more, and comes back at once.
    PowerCut(u64),
    /// The power goes and comes back at once.
    PowerCycle,
    /// Code that never ends.
    Hang(Hang),
}

/// How a Hall's wire is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HallWire {
    /// As it should be.
    Good,
    /// Broken.
    Open,
    /// Shorted to ground.
    Ground,
    /// Shorted to the supply.
    Supply,
    /// The sensor's output stays at the level of this moment.
    Stuck,
}

/// What never ends, until the next reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hang {
    /// The control interrupt, from its next entry on.
    Control,
    /// What is in no handler, at once.
    Tasks,
    /// The handler of an exception, from its next entry on: 2 to 127.
    Exception(u16),
}

/// An event and its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Seconds.
    pub at_s: f64,
    /// What happens.
    pub event: Event,
    /// As it was written.
    pub text: String,
    /// Line of the script, from 1.
    pub line: usize,
}

/// What is wrong with a script, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong there, with the word.
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
    for (index, text) in text.lines().enumerate() {
        let line = index + 1;
        steps.extend(step(text, line).map_err(|what| Error { line, what })?);
    }
    steps.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(steps)
}

fn step(text: &str, line: usize) -> Result<Option<Step>, String> {
    let words = words::split(text)?;
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match &words[..] {
        [] => Ok(None),
        ["at"] => Err("\"at\" is followed by a time and an event".into()),
        ["at", at, rest @ ..] => {
            Ok(Some(Step { at_s: words::time(at)?, event: event::event(rest)?, text: rest.join(" "), line }))
        }
        [first, ..] => Err(format!("a line begins with \"at\" and a time, not with {first:?}")),
    }
}

/// An event without a time, as it is typed: `turn 2`, or with hyphens as on a command line.
///
/// # Errors
/// What is wrong, with the word.
pub fn event(text: &str) -> Result<Event, String> {
    let of = |words: &[String]| event::event(&words.iter().map(String::as_str).collect::<Vec<_>>());
    of(&words::split(text)?).or_else(|wrong| of(&hyphenated(text)).map_err(|_| wrong))
}

/// The words of an event of a command line, where Hall 1 needs no number.
fn hyphenated(text: &str) -> Vec<String> {
    let words = event::hyphenated(text);
    match &words[..] {
        [hall, wire] if hall == "hall" => vec![hall.clone(), "1".into(), wire.clone()],
        _ => words,
    }
}

/// An event before its time, as on a command line: `hall-open@40s`.
///
/// # Errors
/// What is wrong, with the word.
pub fn timed(text: &str) -> Result<Step, String> {
    let (what, at) =
        text.rsplit_once('@').ok_or_else(|| format!("an event and its time are like hall-open@2s, not {text:?}"))?;
    let words = hyphenated(what);
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    Ok(Step { at_s: words::time(at)?, event: event::event(&words)?, text: words.join(" "), line: 1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::heads::Defect;

    #[test]
    fn every_line_of_the_description_is_understood() {
        let text = include_str!("lib.rs");
        let described =
            text.lines().filter_map(|line| line.strip_prefix("//! ")).filter(|line| line.starts_with("at "));
        let events: Vec<_> = described.map(|line| parse(line).unwrap().remove(0).event).collect();
        assert_eq!(events.len(), 19);
        assert_eq!(events[0], Event::Hall(0, HallWire::Open));
        assert_eq!(events[2], Event::Rings(Some(Defect::Stuck(0, 1))));
        assert_eq!(events[3], Event::Rings(Some(Defect::Slipped(1, 3.0_f64.to_radians()))));
        assert_eq!(events[4], Event::Rings(Some(Defect::Chipped(0, 4))));
        assert_eq!(events[10], Event::Turn(2.0));
        assert_eq!(events[13], Event::Mend);
        assert_eq!(events[14], Event::Uart(b"garbage\x00\xff".to_vec()));
        assert_eq!(events[18], Event::Hang(Hang::Control));
        assert_eq!(
            event::event(&["rings", "slip", "-3deg"]),
            Ok(Event::Rings(Some(Defect::BothSlipped((-3.0_f64).to_radians()))))
        );
    }

    #[test]
    fn steps_come_in_the_order_of_time() {
        let steps = parse("at 2s bus 12V\n\n# nothing\nat 20ms power cycle").unwrap();
        assert_eq!(steps.iter().map(|step| (step.at_s, step.line)).collect::<Vec<_>>(), [(0.02, 4), (2.0, 1)]);
    }

    #[test]
    fn a_command_line_has_the_event_before_its_time() {
        let of = |text| timed(text).map(|step| (step.event, step.at_s));
        assert_eq!(of("hall-open@40s"), Ok((Event::Hall(0, HallWire::Open), 40.0)));
        assert_eq!(of("hall-2-stuck@40ms"), Ok((Event::Hall(1, HallWire::Stuck), 0.04)));
        assert_eq!(of("turn--1.5@1s"), Ok((Event::Turn(-1.5), 1.0)));
        assert_eq!(of("current-U--40A@1s"), Ok((Event::Current(0, -40.0), 1.0)));
        assert_eq!(of("hot@2s"), Ok((Event::Hot, 2.0)));
        assert_eq!(of("bus 60V@2s"), Ok((Event::Bus(60.0), 2.0)));
        for (text, named) in [
            ("hall-open", "like hall-open@2s"),
            ("hall-open@40", "not \"40\""),
            ("hall-open@-1s", "not \"-1s\""),
            ("hall-open@nans", "not \"nans\""),
            ("flood@1s", "cannot do \"flood\""),
        ] {
            let error = of(text).unwrap_err();
            assert!(error.contains(named), "{text}: {error}");
        }
    }

    #[test]
    fn what_is_typed_has_no_time() {
        assert_eq!(event("turn 2"), Ok(Event::Turn(2.0)));
        assert_eq!(event("  turn -0.5  # back"), Ok(Event::Turn(-0.5)));
        // As the options have them.
        assert_eq!(event("hall-open"), Ok(Event::Hall(0, HallWire::Open)));
        assert_eq!(event("hall-2-stuck"), Ok(Event::Hall(1, HallWire::Stuck)));
        assert_eq!(event("bus-60V"), Ok(Event::Bus(60.0)));
        assert_eq!(event("load--0.05Nm"), Ok(Event::Load(-0.05)));
        assert_eq!(event("hall-open@2s"), Err("cannot do \"hall-open@2s\"".into()));
        assert_eq!(event("turn nan"), Err("expected a number, found \"nan\"".into()));
        assert_eq!(event("turn"), Err("cannot do \"turn\"".into()));
        assert_eq!(event(""), Err("nothing is done".into()));
    }

    #[test]
    fn errors_name_line_and_word() {
        for (text, line, what) in [
            ("\nbus 12V", 2, "a line begins with \"at\" and a time, not with \"bus\""),
            ("at", 1, "\"at\" is followed by a time and an event"),
            ("at soon bus 12V", 1, "a time is like 0.5s, 20ms or 300us, not \"soon\""),
            ("at -1s bus 12V", 1, "a time is like 0.5s, 20ms or 300us, not \"-1s\""),
            ("at nans bus 12V", 1, "a time is like 0.5s, 20ms or 300us, not \"nans\""),
            ("at infs bus 12V", 1, "a time is like 0.5s, 20ms or 300us, not \"infs\""),
            ("at 1s bus 12", 1, "expected a number with V, found \"12\""),
            ("at 1s bus -5V", 1, "a supply has 0V or more, not \"-5V\""),
            ("at 1s bus 1e30V", 1, "1000V at most, not \"1e30V\""),
            ("at 1s load -1e30Nm", 1, "1000Nm at most, not \"-1e30Nm\""),
            ("at 1s turn 1e30", 1, "1000 turns at most, not \"1e30\""),
            ("at 1s bus nanV", 1, "expected a number with V, found \"nanV\""),
            ("at 1s load infNm", 1, "expected a number with Nm, found \"infNm\""),
            ("at 1s current X 1A", 1, "phases are U, V and W, not \"X\""),
            ("at 1s hall 4 open", 1, "Halls are 1, 2 and 3, not \"4\""),
            ("at 1s head 3 1 stuck", 1, "rings, and the heads over each, are 1 and 2, not \"3\""),
            ("at 1s ring 1 slips 3", 1, "expected a number with deg, found \"3\""),
            ("at 1s ring 2 chipped 0", 1, "pole pairs are 1 to 64, not \"0\""),
            ("at 1s hall 1 wet", 1, "a Hall is good, open, ground, supply or stuck, not \"wet\""),
            ("at 1s break loose", 1, "the break pin is low, high or released, not \"loose\""),
            ("at 1s uart \"open", 1, "the quote is not closed"),
            ("at 1s uart \"\\xg1\"", 1, "\\x takes two hexadecimal digits, not \"g1\""),
            ("at 1s hang 1", 1, "exceptions are 2 to 127, not \"1\""),
            ("at 1s power cut after -1 operations", 1, "expected a whole number, found \"-1\""),
            ("at 1s dance", 1, "cannot do \"dance\""),
            ("at 1s send", 1, "nothing is sent"),
            ("at 1s", 1, "nothing is done"),
        ] {
            assert_eq!(parse(text), Err(Error { line, what: what.into() }), "{text}");
        }
    }

    proptest::proptest! {
        /// Whatever is written is understood or refused.
        #[test]
        fn nothing_panics(text in "[a-z0-9 @#\"\\\\.\u{b5}-]{0,40}") {
            let _ = (parse(&text), event(&text), timed(&text));
            let _ = parse(&format!("at 1s {text}"));
            let _ = parse(&format!("at 1s uart \"{text}\""));
        }
    }
}
