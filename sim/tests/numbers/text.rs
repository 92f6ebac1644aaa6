//! Figures in a text, by the words around them.

use super::page::read;
use std::ops::Range;

/// A figure as it stands in a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    pub value: f64,
    /// Value of one in its last digit.
    pub unit: f64,
}

/// The figure that a text begins with, and its length: `-0.060`, `4.0e-5`, `168 841`, `40_000`.
pub fn number(text: &str) -> Option<(Number, usize)> {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut at = usize::from(text.starts_with(['-', '+']));
    let whole = digits(at);
    if whole == 0 {
        return None;
    }
    at += whole;
    if whole <= 3 {
        // In pages a space stands between thousands, in code a line.
        while matches!(bytes.get(at), Some(b' ' | b'_')) && digits(at + 1) == 3 {
            at += 4;
        }
    }
    let mut decimals = 0;
    if bytes.get(at) == Some(&b'.') && digits(at + 1) > 0 {
        decimals = digits(at + 1);
        at += 1 + decimals;
    }
    let mut exponent = 0;
    if bytes.get(at) == Some(&b'e') {
        let sign = usize::from(matches!(bytes.get(at + 1), Some(b'-' | b'+')));
        let length = digits(at + 1 + sign);
        if length > 0 {
            exponent = text[at + 1..at + 1 + sign + length].parse().ok()?;
            at += 1 + sign + length;
        }
    }
    let value = text[..at].replace([' ', '_'], "").parse().ok()?;
    Some((Number { value, unit: 10_f64.powi(exponent - decimals as i32) }, at))
}

/// A text with one space wherever there is room, for paragraphs are broken anywhere.
pub struct Narrow {
    text: String,
    /// Where each byte comes from.
    origins: Vec<usize>,
}

impl Narrow {
    pub fn new(text: &str) -> Self {
        let mut narrow = Self { text: String::new(), origins: Vec::new() };
        for (at, letter) in text.char_indices() {
            let letter = if letter.is_whitespace() { ' ' } else { letter };
            if letter != ' ' || !narrow.text.ends_with(' ') {
                narrow.text.push(letter);
                narrow.origins.resize(narrow.text.len(), at);
            }
        }
        narrow
    }

    /// Wherever this stands, with the figures in the places of `{}`.
    pub fn find(&self, template: &str) -> Vec<(Range<usize>, Vec<Number>)> {
        let template = template.split_whitespace().collect::<Vec<_>>().join(" ");
        let words = template.strip_prefix("{}").unwrap_or(&template);
        let (first, _) = words.split_once("{}").unwrap_or((words, ""));
        let found = self.text.match_indices(first).filter_map(|(words, _)| {
            // What begins with a figure is found by the words after it.
            let figure = |letter: char| letter.is_ascii_digit() || ".-+".contains(letter);
            let start =
                if template.starts_with("{}") { self.text[..words].trim_end_matches(figure).len() } else { words };
            let mut at = start;
            let mut numbers = Vec::new();
            for (place, part) in template.split("{}").enumerate() {
                if place > 0 {
                    let (number, length) = number(&self.text[at..])?;
                    at += length;
                    numbers.push(number);
                }
                at += self.text[at..].starts_with(part).then_some(part.len())?;
            }
            Some((self.origins[start]..self.origins[at - 1] + 1, numbers))
        });
        found.collect()
    }
}

/// What a long command has printed, as `docs/record` keeps it.
pub struct Recorded {
    name: String,
    narrow: Narrow,
}

impl Recorded {
    pub fn of(name: &str) -> Self {
        let name = format!("docs/recorded/{name}.txt");
        Self { narrow: Narrow::new(&read(&name)), name }
    }

    /// The figures of each place that says this.
    #[track_caller]
    pub fn all(&self, template: &str) -> Vec<Vec<f64>> {
        let found = self.narrow.find(template);
        assert!(!found.is_empty(), "{} does not say {template:?}", self.name);
        found.into_iter().map(|(_, numbers)| numbers.iter().map(|number| number.value).collect()).collect()
    }

    /// The figures of the only place that says this.
    #[track_caller]
    pub fn only<const N: usize>(&self, template: &str) -> [f64; N] {
        let [all] = self.all(template).try_into().expect("once");
        all.try_into().expect("as many")
    }

    /// The largest of a figure.
    #[track_caller]
    pub fn most(&self, template: &str) -> f64 {
        self.all(template).concat().into_iter().fold(f64::MIN, f64::max)
    }

    /// The smallest of a figure.
    #[track_caller]
    pub fn least(&self, template: &str) -> f64 {
        self.all(template).concat().into_iter().fold(f64::MAX, f64::min)
    }
}

#[test]
fn figures_are_found_by_their_words() {
    let text = Narrow::new("error 4.0e-5,\n 168 841 uncalibrated; -0.060° mean; 1.06 of 2");
    let figure = |template: &str| text.find(template).into_iter().flat_map(|(_, numbers)| numbers).collect::<Vec<_>>();
    let number = |value: f64, unit: f64| Number { value, unit };
    assert_eq!(figure("error {}, {} uncal"), [number(4e-5, 1e-6), number(168_841.0, 1.0)]);
    assert_eq!(figure("; {}° mean"), [number(-0.06, 1e-3)]);
    assert_eq!(figure("mean; {} of {}"), [number(1.06, 1e-2), number(2.0, 1.0)]);
    assert_eq!(figure("{}° mean"), [number(-0.06, 1e-3)]);
    assert!(figure("error {} uncal").is_empty());
    assert_eq!(Narrow::new("HZ: u32 = 40_000;").find("HZ: u32 = {}")[0].1, [number(40e3, 1.0)]);
}
