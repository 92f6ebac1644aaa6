//! Figures in running text: a number with a unit, or so many of so many. Code, links, headings and tables have none.

use super::text::number;
use std::ops::Range;

/// What makes a number a figure when it follows it.
const UNITS: &[&str] = &[
    "%",
    "°",
    "°C",
    "s",
    "ms",
    "µs",
    "ns",
    "seconds",
    "minutes",
    "Hz",
    "kHz",
    "MHz",
    "rpm",
    "rad",
    "rad/s",
    "A",
    "mA",
    "A/V",
    "V",
    "mV",
    "mV/A",
    "mV/mT",
    "mT",
    "W",
    "Ω",
    "mΩ",
    "kΩ",
    "mH",
    "µH",
    "nF",
    "mm",
    "N·m",
    "mN·m",
    "N·m/rad",
    "kg·m²",
    "KiB",
    "KB",
    "kB",
    "bytes",
    "bit",
    "bits",
    "baud",
    "bit/s",
    "Mbit/s",
    "codes",
    "counts",
    "LSB",
    "turns",
    "periods",
    "cycles",
    "instructions",
    "samples",
    "motors",
    "times",
    "positions",
    "power-ups",
    "defects",
    "faults",
];

/// Where the figures of a page's prose are.
pub fn figures(page: &str) -> Vec<Range<usize>> {
    let prose = prose(page);
    let mut found = Vec::new();
    let mut at = 0;
    while at < prose.len() {
        let before = prose[..at].chars().next_back();
        let begins = prose.as_bytes()[at].is_ascii_digit() && !before.is_some_and(|c| c.is_alphanumeric() || c == '.');
        match begins.then(|| number(&prose[at..])).flatten() {
            Some((_, length)) => {
                found.extend(unit(&prose[at + length..]).map(|unit| at..at + length + unit));
                at += length;
            }
            None => at += prose[at..].chars().next().map_or(1, char::len_utf8),
        }
    }
    found
}

/// The length of a unit that a text begins with, after a space, a hyphen or nothing.
fn unit(text: &str) -> Option<usize> {
    let rest = text.strip_prefix([' ', '\n', '-']).unwrap_or(text);
    let rest = if text.len() > rest.len() { rest.trim_start() } else { rest };
    let skipped = text.len() - rest.len();
    if let Some(whole) = rest.strip_prefix("of ") {
        return number(whole).map(|(_, length)| skipped + "of ".len() + length);
    }
    let ends = |unit: &&&str| {
        let after = rest.strip_prefix(**unit);
        after.is_some_and(|after| !after.starts_with(|c: char| c.is_alphanumeric() || "/·".contains(c)))
    };
    UNITS.iter().filter(ends).map(|unit| skipped + unit.len()).max()
}

/// The page with spaces in the place of all that is not prose.
fn prose(page: &str) -> String {
    let mut prose = String::with_capacity(page.len());
    let mut block = false;
    for line in page.split_inclusive('\n') {
        let text = line.trim_start();
        let fence = text.starts_with("```");
        block ^= fence;
        let hidden = block || fence || text.starts_with(['|', '#']);
        prose.extend(line.bytes().map(|byte| if hidden && byte != b'\n' { ' ' } else { '\0' }));
        if !hidden {
            prose.truncate(prose.len() - line.len());
            prose.push_str(line);
        }
    }
    let prose = without(&prose, "`", "`");
    without(&prose, "](", ")")
}

/// The same with spaces in the place of what is between these.
fn without(text: &str, open: &str, close: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, inside)) = rest.split_once(open) {
        let Some((hidden, after)) = inside.split_once(close) else { break };
        out.push_str(before);
        out.push_str(&" ".repeat(open.len() + hidden.len() + close.len()));
        rest = after;
    }
    out + rest
}

#[test]
fn figures_of_prose_are_numbers_with_units() {
    let found = |page: &str| figures(page).into_iter().map(|at| page[at].to_string()).collect::<Vec<_>>();
    assert_eq!(found("up to 5 %, ±1.5° and 128 000\n  bytes"), ["5 %", "1.5°", "128 000\n  bytes"]);
    assert_eq!(found("168 of 12 000 were missed; a 12-bit ADC"), ["168 of 12 000", "12-bit"]);
    assert_eq!(found("0.2 N·m/rad at 40 kHz."), ["0.2 N·m/rad", "40 kHz"]);
    // Code, links, tables, headings, names and plain numbers are none.
    assert!(found("`at 5 s` [x](a-5 s) STM32 s PA8 A 3 boards, 2.5 Å\n| 5 % |\n# 5 V\n```\n5 A\n```\n").is_empty());
    // What stands behind them is where it was.
    assert_eq!(found("`µ` é\n```\nµ\n```\n| µ |\n7 ms"), ["7 ms"]);
}
