//! Named bars, as elements of the page: they are as wide as it is, and have its colours.

use crate::page::escaped;
use anyhow::{Result, ensure};
use std::fmt::Write;

/// Named bars on a logarithmic scale that begins at a half.
#[derive(Clone, Debug)]
pub struct Bars {
    /// Heading.
    pub title: String,
    /// Name and unit of what is compared.
    pub x: String,
    /// Name and value of each, from above.
    pub bars: Vec<(String, f64)>,
}

/// Where the scale begins.
const LEAST: f64 = 0.5;

impl Bars {
    /// As a part of a page: each bar with its name before it, its value behind it, and both where a pointer rests.
    ///
    /// # Errors
    /// No bar, or one that is not a number.
    pub fn html(&self) -> Result<String> {
        let values = || self.bars.iter().map(|(_, value)| *value);
        ensure!(!self.bars.is_empty() && values().all(f64::is_finite), "the bars {:?}: nothing to plot", self.title);
        let decades = (values().fold(2.0 * LEAST, f64::max) / LEAST).log10();
        let mut html = String::from("<div class=\"bars\">\n");
        for (name, value) in &self.bars {
            let percent = 100.0 * (value.max(LEAST) / LEAST).log10() / decades;
            let (name, unit) = (escaped(name), escaped(&self.x));
            // Writing into a string does not fail.
            let _ = writeln!(
                html,
                "<span>{name}</span><div title=\"{name}: {value:.1} {unit}\">\
                 <i style=\"width:calc({percent:.1}% - 3em)\"></i> {value:.1}</div>"
            );
        }
        let _ = write!(html, "<span></span><div>{}, logarithmic</div></div>", escaped(&self.x));
        Ok(html)
    }
}
