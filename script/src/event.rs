//! Events out of words.

use crate::words::{bytes, number, quantity, whole};
use crate::{Event, HallWire, Hang};
use plant::heads::Defect;

pub fn event(words: &[&str]) -> Result<Event, String> {
    Ok(match words {
        [] => return Err("nothing is done".into()),
        ["hall", which, wire] => Event::Hall(hall(which)?, hall_wire(wire)?),
        ["swap", "halls", a, b] => Event::SwapHalls(hall(a)?, hall(b)?),
        ["head", ring, head, "stuck"] => Event::Rings(Some(Defect::Stuck(one_or_two(ring)?, one_or_two(head)?))),
        ["ring", ring, "slips", angle] => Event::Rings(Some(Defect::Slipped(one_or_two(ring)?, degrees(angle)?))),
        ["rings", "slip", angle] => Event::Rings(Some(Defect::BothSlipped(degrees(angle)?))),
        ["ring", ring, "chipped", pair] => Event::Rings(Some(Defect::Chipped(one_or_two(ring)?, pole_pair(pair)?))),
        ["rings", "good"] => Event::Rings(None),
        ["bus", volts] => Event::Bus(supply(volts)?),
        ["current", phase, amperes] => Event::Current(self::phase(phase)?, quantity(amperes, "A")?),
        ["break", level] => Event::Break(break_level(level)?),
        ["enable", "open"] => Event::Enable(false),
        ["enable", "closed"] => Event::Enable(true),
        ["load", torque] => Event::Load(within(quantity(torque, "Nm")?, torque, "Nm")?),
        ["turn", turns] => Event::Turn(within(number(turns)?, turns, " turns")?),
        ["hot"] => Event::Hot,
        ["late"] => Event::Late,
        ["mend"] => Event::Mend,
        ["uart", text] => Event::Uart(bytes(text)?),
        ["send"] => return Err("nothing is sent".into()),
        ["send", request @ ..] => Event::Send(request.iter().map(|word| (*word).to_owned()).collect()),
        ["power", "cut", "after", count, "operations" | "operation"] => Event::PowerCut(whole(count)?),
        ["power", "cycle"] => Event::PowerCycle,
        ["hang"] => Event::Hang(Hang::Control),
        ["hang", "tasks"] => Event::Hang(Hang::Tasks),
        ["hang", number] => Event::Hang(Hang::Exception(exception(number)?)),
        _ => return Err(format!("cannot do {:?}", words.join(" "))),
    })
}

/// Words with hyphens or spaces between them; one that follows another is a sign.
pub fn hyphenated(text: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    for character in text.chars() {
        let begins = words.last().is_none_or(String::is_empty);
        match character {
            '-' | ' ' if !begins => words.push(String::new()),
            ' ' => {}
            _ => words.last_mut().into_iter().for_each(|word| word.push(character)),
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

fn hall(word: &str) -> Result<usize, String> {
    match word {
        "1" => Ok(0),
        "2" => Ok(1),
        "3" => Ok(2),
        _ => Err(format!("Halls are 1, 2 and 3, not {word:?}")),
    }
}

/// A ring of an encoder, or a head over one.
fn one_or_two(word: &str) -> Result<usize, String> {
    match word {
        "1" => Ok(0),
        "2" => Ok(1),
        _ => Err(format!("rings, and the heads over each, are 1 and 2, not {word:?}")),
    }
}

fn pole_pair(word: &str) -> Result<usize, String> {
    let number = whole(word)?.checked_sub(1).and_then(|index| usize::try_from(index).ok());
    number.filter(|&index| index < 64).ok_or_else(|| format!("pole pairs are 1 to 64, not {word:?}"))
}

/// In radians.
fn degrees(word: &str) -> Result<f64, String> {
    quantity(word, "deg").map(f64::to_radians)
}

fn hall_wire(word: &str) -> Result<HallWire, String> {
    Ok(match word {
        "good" => HallWire::Good,
        "open" => HallWire::Open,
        "ground" => HallWire::Ground,
        "supply" => HallWire::Supply,
        "stuck" => HallWire::Stuck,
        _ => return Err(format!("a Hall is good, open, ground, supply or stuck, not {word:?}")),
    })
}

fn phase(word: &str) -> Result<usize, String> {
    let index = ["U", "V", "W"].iter().position(|name| *name == word);
    index.ok_or_else(|| format!("phases are U, V and W, not {word:?}"))
}

fn break_level(word: &str) -> Result<Option<bool>, String> {
    match word {
        "low" => Ok(Some(false)),
        "high" => Ok(Some(true)),
        "released" => Ok(None),
        _ => Err(format!("the break pin is low, high or released, not {word:?}")),
    }
}

fn exception(word: &str) -> Result<u16, String> {
    let number = u16::try_from(whole(word)?).ok().filter(|number| (2..128).contains(number));
    number.ok_or_else(|| format!("exceptions are 2 to 127, not {word:?}"))
}

/// A supply's voltage.
fn supply(text: &str) -> Result<f64, String> {
    let volts = quantity(text, "V")?;
    if volts < 0.0 { Err(format!("a supply has 0V or more, not {text:?}")) } else { within(volts, text, "V") }
}

/// Beyond it the motor's equations are no numbers any more, and nothing mends them.
const MOST: f64 = 1000.0;

fn within(value: f64, text: &str, unit: &str) -> Result<f64, String> {
    if value.abs() <= MOST { Ok(value) } else { Err(format!("{MOST}{unit} at most, not {text:?}")) }
}
