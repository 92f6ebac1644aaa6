//! The HTML report: a table and plots, in one file without scripts.

mod plot;

pub use plot::{Bars, Plot, Series};

use anyhow::Result;
use std::fmt::Write;

/// A report in the making.
#[derive(Clone, Debug, Default)]
pub struct Report {
    title: String,
    body: String,
}

impl Report {
    /// Empty but for its title.
    pub fn new(title: &str) -> Self {
        Self { title: title.into(), body: String::new() }
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "<h2>{}</h2>", escaped(text));
        self
    }

    /// A heading of many others.
    pub fn chapter(&mut self, text: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "<h1>{}</h1>", escaped(text));
        self
    }

    /// Lines as they are.
    pub fn preformatted(&mut self, text: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "<pre>{}</pre>", escaped(text));
        self
    }

    /// A paragraph that stands out.
    pub fn note(&mut self, text: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "<p class=\"note\">{}</p>", escaped(text));
        self
    }

    /// A paragraph.
    pub fn text(&mut self, text: &str) -> &mut Self {
        // Writing into a string does not fail.
        let _ = writeln!(self.body, "<p>{}</p>", escaped(text));
        self
    }

    /// A table of rows; the first row is the head.
    pub fn table(&mut self, rows: &[Vec<String>]) -> &mut Self {
        self.body.push_str("<table>\n");
        for (k, row) in rows.iter().enumerate() {
            let tag = if k == 0 { "th" } else { "td" };
            let cells: String = row.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
            let _ = writeln!(self.body, "<tr>{cells}</tr>");
        }
        self.body.push_str("</table>\n");
        self
    }

    /// A diagram with a caption under it.
    ///
    /// # Errors
    /// As [`Plot::svg`].
    pub fn plot(&mut self, plot: &Plot, caption: &str) -> Result<&mut Self> {
        Ok(self.figure(&plot.title, &plot.svg()?, caption))
    }

    /// Bars with a caption under them.
    ///
    /// # Errors
    /// As [`Bars::svg`].
    pub fn bars(&mut self, bars: &Bars, caption: &str) -> Result<&mut Self> {
        Ok(self.figure(&bars.title, &bars.svg()?, caption))
    }

    fn figure(&mut self, title: &str, svg: &str, caption: &str) -> &mut Self {
        let (title, caption) = (escaped(title), escaped(caption));
        let _ = writeln!(self.body, "<h2>{title}</h2>\n<figure>{svg}<figcaption>{caption}</figcaption></figure>");
        self
    }

    /// The whole page.
    pub fn html(&self) -> String {
        let title = escaped(&self.title);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><title>{title}</title>\n\
             <style>{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n{}</body>\n</html>\n",
            self.body
        )
    }
}

const STYLE: &str = "body{font:16px/1.45 system-ui,sans-serif;max-width:940px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.6em}h2{font-size:1.1em;margin:1.6em 0 .2em}figure{margin:0}svg{max-width:100%;height:auto}\
figcaption{color:#555;font-size:.9em}table{border-collapse:collapse;margin:1em 0}\
td,th{padding:.25em .9em;border-bottom:1px solid #ddd;text-align:left}td:not(:first-child){text-align:right}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
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
