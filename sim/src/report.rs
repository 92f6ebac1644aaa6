//! The HTML report: a table and plots, in one file without scripts.

use anyhow::{Result, anyhow};
use plotters::prelude::*;
use std::fmt::Write;

/// A curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Its points in the order of x.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// A curve from points.
    pub fn new(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self { name: name.into(), points: points.into_iter().collect() }
    }

    /// At most `2 · most` points that look the same: the extremes of `most` parts.
    fn thinned(&self, most: usize) -> Vec<(f64, f64)> {
        if self.points.len() <= 2 * most {
            return self.points.clone();
        }
        let part = self.points.len().div_ceil(most);
        let extremes = |points: &[(f64, f64)]| {
            let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let (low, high) = (points.iter().min_by(by_y).copied(), points.iter().max_by(by_y).copied());
            let mut both = [low, high];
            both.sort_by(|a, b| a.map_or(0.0, |p| p.0).total_cmp(&b.map_or(0.0, |p| p.0)));
            both.into_iter().flatten()
        };
        self.points.chunks(part).flat_map(extremes).collect()
    }
}

/// A diagram of one or more curves.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Name and unit of the abscissa.
    pub x: String,
    /// Name and unit of the ordinate.
    pub y: String,
    /// The curves.
    pub series: Vec<Series>,
}

const COLOURS: [RGBColor; 6] = [
    RGBColor(0x1f, 0x6f, 0xb4),
    RGBColor(0xd6, 0x5f, 0x0e),
    RGBColor(0x2b, 0x8c, 0x4a),
    RGBColor(0xb0, 0x2a, 0x37),
    RGBColor(0x6f, 0x4b, 0xa3),
    RGBColor(0x55, 0x55, 0x55),
];

impl Plot {
    /// A diagram.
    pub fn new(title: &str, x: &str, y: &str, series: Vec<Series>) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), series }
    }

    /// The diagram as SVG.
    ///
    /// # Errors
    /// A curve without a finite point.
    pub fn svg(&self) -> Result<String> {
        self.draw().map_err(|error| anyhow!("the plot {:?}: {error}", self.title))
    }

    fn draw(&self) -> Result<String, Box<dyn std::error::Error>> {
        let (x, y) = (self.range(|p| p.0, 0.0)?, self.range(|p| p.1, 0.06)?);
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (900, 300)).into_drawing_area();
            root.fill(&WHITE)?;
            let mut chart = ChartBuilder::on(&root)
                .margin(8)
                .margin_right(16)
                .x_label_area_size(38)
                .y_label_area_size(62)
                .build_cartesian_2d(x, y)?;
            chart
                .configure_mesh()
                .x_desc(&self.x)
                .y_desc(&self.y)
                .light_line_style(WHITE)
                .bold_line_style(RGBColor(0xe4, 0xe4, 0xe4))
                .axis_style(RGBColor(0x88, 0x88, 0x88))
                .label_style(("sans-serif", 13))
                .draw()?;
            for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
                chart
                    .draw_series(LineSeries::new(series.thinned(1200), colour.stroke_width(1)))?
                    .label(&series.name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            }
            if (2..=COLOURS.len()).contains(&self.series.len()) {
                let style = chart.configure_series_labels();
                let mut style = style;
                style.background_style(WHITE.mix(0.85)).border_style(RGBColor(0xcc, 0xcc, 0xcc));
                style.label_font(("sans-serif", 13)).position(SeriesLabelPosition::UpperRight).draw()?;
            }
            root.present()?;
        }
        Ok(svg)
    }

    fn range(&self, of: fn(&(f64, f64)) -> f64, margin: f64) -> Result<std::ops::Range<f64>> {
        let values = self.series.iter().flat_map(|series| series.points.iter().map(of)).filter(|v| v.is_finite());
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return Err(anyhow!("nothing to plot"));
        }
        let room = if high > low { margin * (high - low) } else { low.abs().max(1.0) * 0.1 };
        Ok(low - room..high + room)
    }
}

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
        let svg = plot.svg()?;
        let (title, caption) = (escaped(&plot.title), escaped(caption));
        let _ = writeln!(self.body, "<h2>{title}</h2>\n<figure>{svg}<figcaption>{caption}</figcaption></figure>");
        Ok(self)
    }

    /// The whole page.
    pub fn html(&self) -> String {
        let title = escaped(&self.title);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><title>{title}</title>\n<style>{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n{}</body>\n</html>\n",
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

/// Prints rows as a table on the terminal; the first row is the head.
pub fn print_table(rows: &[Vec<String>]) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |k: usize| rows.iter().filter_map(|row| row.get(k)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<_> = (0..columns).map(width).collect();
    for (number, row) in rows.iter().enumerate() {
        let line: Vec<_> = row
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(k, (cell, &width))| if k == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") })
            .collect();
        println!("  {}", line.join("   "));
        if number == 0 {
            println!("  {}", widths.iter().map(|&width| "─".repeat(width)).collect::<Vec<_>>().join("───"));
        }
    }
}
