//! What a script does to a virtual board. The language is that of the crate [`script`](::script).

use crate::request;
use ::script::{Event, HallWire, Hang};
use chip::{Disturbance, HallFault};

pub use ::script::Error;

/// Something that a script does.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// To the board, the motor or the flash.
    Disturb(Disturbance),
    /// The handler of this exception hangs from its next entry on until the next reset, 0 what is in no handler; `None`
    /// is the control interrupt.
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

/// Parses a script; steps come in the order of their times.
///
/// # Errors
/// The first line that is wrong, or that asks for what a virtual board cannot do.
pub fn parse(text: &str) -> Result<Vec<Step>, Error> {
    let steps = ::script::parse(text)?.into_iter().enumerate().map(|(id, step)| {
        let action = action(&step.event, &step.text, id).map_err(|what| Error { line: step.line, what })?;
        Ok(Step { at_s: step.at_s, action, text: step.text })
    });
    steps.collect()
}

fn action(event: &Event, text: &str, id: usize) -> Result<Action, String> {
    Ok(Action::Disturb(match event {
        Event::Hall(which, wire) => Disturbance::Hall(*which, hall_fault(*wire)),
        Event::SwapHalls(a, b) => Disturbance::SwapHalls(*a, *b),
        Event::Rings(defect) => Disturbance::Encoder(*defect),
        Event::Bus(volts) => Disturbance::Bus(*volts),
        Event::Current(phase, amperes) => Disturbance::Overcurrent(*phase, *amperes),
        Event::Break(level) => Disturbance::BreakPin(*level),
        Event::Enable(closed) => Disturbance::Enable(*closed),
        Event::Load(torque) => Disturbance::Load(*torque),
        Event::Uart(bytes) => Disturbance::Serial(bytes.clone()),
        Event::Send(words) => Disturbance::Serial(request::frame(words, id)?),
        Event::PowerCut(operations) => Disturbance::PowerCut(*operations),
        Event::PowerCycle => Disturbance::PowerCycle,
        Event::Hang(Hang::Control) => return Ok(Action::Hang(None)),
        Event::Hang(Hang::Tasks) => return Ok(Action::Hang(Some(0))),
        Event::Hang(Hang::Exception(number)) => return Ok(Action::Hang(Some(*number))),
        Event::Turn(_) | Event::Hot | Event::Late | Event::Mend => {
            return Err(format!("a virtual board cannot do {text:?}"));
        }
    }))
}

fn hall_fault(wire: HallWire) -> HallFault {
    match wire {
        HallWire::Good => HallFault::Good,
        HallWire::Open => HallFault::Open,
        HallWire::Ground => HallFault::Ground,
        HallWire::Supply => HallFault::Supply,
        HallWire::Stuck => HallFault::Stuck,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_virtual_board_cannot_do_is_refused_with_its_line() {
        for (text, line, what) in [
            ("at 1s power cycle\nat 0s turn 2", 2, "a virtual board cannot do \"turn 2\""),
            ("at 1s send flowers", 1, "the drive cannot be asked for \"flowers\""),
            ("at 1s send speed nan", 1, "expected a number, found \"nan\""),
            ("at 1s send history 256", 1, "entries are 0 to 255, not \"256\""),
            ("at 1s hall 4 open", 1, "Halls are 1, 2 and 3, not \"4\""),
        ] {
            assert_eq!(parse(text), Err(Error { line, what: what.into() }), "{text}");
        }
    }

    #[test]
    fn the_examples_are_understood() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts");
        let examples: Vec<_> = std::fs::read_dir(folder).unwrap().flatten().collect();
        assert!(examples.len() >= 3);
        for example in examples {
            let text = std::fs::read_to_string(example.path()).unwrap();
            assert!(!parse(&text).unwrap().is_empty(), "{:?}", example.path());
        }
    }
}
