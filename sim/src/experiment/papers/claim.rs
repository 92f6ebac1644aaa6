//! What a paper prints beside what is found here.

use crate::report::Plot;
use serde::Serialize;

/// One of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Paper {
    /// Simpkins and Todorov.
    LinearHalls,
    /// Bakos, Gőzse and Soumelidis.
    Vernier,
}

impl Paper {
    /// Authors and title.
    pub fn title(self) -> &'static str {
        match self {
            Self::LinearHalls => {
                "Simpkins and Todorov: Position Estimation and Control of Compact BLDC Motors Based on Analog Linear \
                 Hall Effect Sensors"
            }
            Self::Vernier => {
                "Bakos, Gőzse and Soumelidis: Design and Analysis of a Magnetic Off-axis Rotary Position Sensing Device"
            }
        }
    }
}

/// How a number found here stands to the printed one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Verdict {
    /// The same, within what the comparison can tell.
    Reproduced,
    /// Smaller than the paper's method makes it under the same conditions, where smaller is better.
    Better,
    /// The printed number does not follow from the paper's own equation.
    Misprint,
    /// The paper does not say under which conditions its number was found.
    Incomparable,
    /// The paper has no number for it, or the stored text has not.
    Unprinted,
    /// Neither the same nor better.
    Missed,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Better => "better, conditions alike",
            Self::Misprint => "the print is wrong",
            Self::Incomparable => "conditions unknown",
            Self::Unprinted => "no number in print",
            Self::Missed => "not reached",
        }
    }
}

/// A number.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// What it is the number of.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// As the paper has it.
    pub printed: Option<f64>,
    /// What the paper's own method, corrected, makes of it here, under the conditions of ours.
    pub method: Option<f64>,
    /// As found here.
    pub ours: f64,
    /// What that means.
    pub verdict: Verdict,
}

impl Figure {
    /// A number without one in print.
    pub fn new(name: &'static str, unit: &'static str, ours: f64) -> Self {
        Self { name, unit, printed: None, method: None, ours, verdict: Verdict::Unprinted }
    }

    fn beside(self, printed: f64, verdict: Verdict) -> Self {
        Self { printed: Some(printed), verdict, ..self }
    }

    /// The printed number is to come out, but for a relative deviation.
    #[must_use]
    pub fn reproduces(self, printed: f64, tolerance: f64) -> Self {
        let same = (self.ours / printed - 1.0).abs() <= tolerance;
        self.beside(printed, if same { Verdict::Reproduced } else { Verdict::Missed })
    }

    /// The paper's own method makes this of it under the same conditions, and here it is to be smaller.
    #[must_use]
    pub fn improves_on(self, method: f64) -> Self {
        let verdict = if self.ours < method { Verdict::Better } else { Verdict::Missed };
        Self { method: Some(method), verdict, ..self }
    }

    /// The printed number does not follow from the paper's own equation.
    #[must_use]
    pub fn corrects(self, printed: f64) -> Self {
        self.beside(printed, Verdict::Misprint)
    }

    /// The printed number was found under conditions that the paper does not give.
    #[must_use]
    pub fn beside_unknown(self, printed: f64) -> Self {
        let verdict = if self.method.is_some() { self.verdict } else { Verdict::Incomparable };
        self.beside(printed, verdict)
    }

    /// Name, printed, the paper's method, ours, and what that means.
    pub fn row(&self) -> Vec<String> {
        let room = if self.unit.is_empty() || self.unit.starts_with('°') { "" } else { " " };
        let with_unit = |value: f64| format!("{}{room}{}", number(value), self.unit);
        let [printed, method] = [self.printed, self.method].map(|value| value.map_or("–".to_string(), with_unit));
        vec![self.name.to_string(), printed, method, with_unit(self.ours), self.verdict.words().to_string()]
    }
}

/// A figure, table or statement of a paper, done again.
#[derive(Clone, Debug, Serialize)]
pub struct Claim {
    /// Whose.
    pub paper: Paper,
    /// Where it stands, "Fig. 4(b)".
    pub place: &'static str,
    /// What it is about, in plain words.
    pub title: &'static str,
    /// What is seen and why it matters.
    pub seen: &'static str,
    /// The equations, corrected.
    pub equation: &'static str,
    /// Under which conditions, and which of the paper's are unknown.
    pub conditions: &'static str,
    /// Why the numbers differ, or why they are not compared.
    pub conclusion: String,
    /// What is wrong in print.
    pub erratum: Option<&'static str>,
    /// The numbers.
    pub figures: Vec<Figure>,
    /// A table that the paper prints; the first row is the head.
    pub table: Vec<Vec<String>>,
    /// The diagrams, each with its caption.
    #[serde(skip)]
    pub plots: Vec<(Plot, &'static str)>,
}

impl Claim {
    /// Place and title.
    pub fn heading(&self) -> String {
        format!("{}: {}", self.place, self.title)
    }

    /// The figures as a table; without the paper's method where there is none.
    pub fn figures_table(&self) -> Vec<Vec<String>> {
        let head = ["", "printed", "the paper's method, here", "ours", ""].map(String::from).to_vec();
        let mut rows: Vec<_> = std::iter::once(head).chain(self.figures.iter().map(Figure::row)).collect();
        if self.figures.iter().all(|figure| figure.method.is_none()) {
            rows.iter_mut().for_each(|row| drop(row.remove(2)));
        }
        rows
    }
}

/// Four digits that count.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if value.abs() < 1e-4 {
        return "below 0.0001".into();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    let text = format!("{value:.*}", digits.clamp(0, 12) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [(0.0, "0"), (1984.0, "1984"), (303_104.0, "303104"), (0.18, "0.18"), (-9.5712, "-9.571")]
        {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn a_number_that_is_neither_the_same_nor_better_is_missed() {
        let figure = Figure::new("", "", 2.0);
        assert_eq!(figure.clone().reproduces(2.01, 0.01).verdict, Verdict::Reproduced);
        assert_eq!(figure.clone().reproduces(2.1, 0.01).verdict, Verdict::Missed);
        assert_eq!(figure.clone().improves_on(2.1).verdict, Verdict::Better);
        assert_eq!(figure.improves_on(1.9).verdict, Verdict::Missed);
    }
}
