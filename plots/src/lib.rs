//! The reports of the experiments, the tool and the virtual boards: one page each, in one file that needs no other.

mod bars;
mod page;
mod plot;

pub use bars::Bars;
pub use page::loads;
pub use plot::{Plot, Series};

use anyhow::Result;
use page::escaped;
use std::fmt::Write;

/// A report in the making.
#[derive(Clone, Debug, Default)]
pub struct Report {
    title: String,
    body: String,
    /// Level and text of the headings.
    headings: Vec<(u8, String)>,
}

impl Report {
    /// Empty but for its title.
    pub fn new(title: &str) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// The first sentence: what is seen here, and why it matters.
    pub fn lead(&mut self, text: &str) -> &mut Self {
        self.line(&format!("{}{}</p>", page::LEAD, escaped(text)))
    }

    /// A heading above other headings.
    pub fn chapter(&mut self, text: &str) -> &mut Self {
        self.headed(1, text, "<h2 class=\"chapter\"")
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.headed(2, text, "<h2")
    }

    fn headed(&mut self, level: u8, text: &str, tag: &str) -> &mut Self {
        let id = self.headings.len();
        self.headings.push((level, text.to_string()));
        self.line(&format!("{tag} id=\"h{id}\">{}</h2>", escaped(text)))
    }

    /// A paragraph.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.line(&format!("<p>{}</p>", escaped(text)))
    }

    /// A paragraph that stands out.
    pub fn note(&mut self, text: &str) -> &mut Self {
        self.line(&format!("<p class=\"note\">{}</p>", escaped(text)))
    }

    /// Lines as they are.
    pub fn preformatted(&mut self, text: &str) -> &mut Self {
        self.line(&format!("<pre>{}</pre>", escaped(text)))
    }

    /// A table of rows; the first row is the head. Columns of numbers stand at the right.
    pub fn table(&mut self, rows: &[Vec<String>]) -> &mut Self {
        self.line(&page::table(rows))
    }

    /// A diagram under its title, with a caption.
    ///
    /// # Errors
    /// As [`Plot::svg`].
    pub fn plot(&mut self, plot: &Plot, caption: &str) -> Result<&mut Self> {
        Ok(self.line(&page::figure(&plot.title, &plot.svg()?, plot.data().as_deref(), caption)))
    }

    /// Bars with a caption under them.
    ///
    /// # Errors
    /// As [`Bars::html`].
    pub fn bars(&mut self, bars: &Bars, caption: &str) -> Result<&mut Self> {
        Ok(self.line(&page::figure(&bars.title, &bars.html()?, None, caption)))
    }

    fn line(&mut self, html: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "{html}");
        self
    }

    /// The whole page.
    pub fn html(&self) -> String {
        page::html(&self.title, &self.headings, &self.body)
    }
}

/// Rows as a table for the terminal; the first row is the head.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |k: usize| rows.iter().filter_map(|row| row.get(k)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<_> = (0..columns).map(width).collect();
    let mut text = String::new();
    for (number, row) in rows.iter().enumerate() {
        let line: Vec<_> = row
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(k, (cell, &width))| if k == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") })
            .collect();
        // Writing into a string does not fail.
        let _ = writeln!(text, "  {}", line.join("   "));
        if number == 0 {
            let _ =
                writeln!(text, "  {}", widths.iter().map(|&width| "─".repeat(width)).collect::<Vec<_>>().join("───"));
        }
    }
    text
}

/// Prints rows as a table on the terminal; the first row is the head.
pub fn print_table(rows: &[Vec<String>]) {
    line(format_args!("{}", table(rows).trim_end()));
}

/// Prints a line. Where the output is full, nothing is left to be done: that is said, and the process ends.
pub fn line(text: std::fmt::Arguments<'_>) {
    if let Err(error) = std::io::Write::write_fmt(&mut std::io::stdout(), format_args!("{text}\n")) {
        eprintln!("cannot write to the standard output: {error}");
        std::process::exit(1);
    }
}

#[cfg(test)]
mod tests;
