//! Diagrams as SVG.

use anyhow::{Result, anyhow};
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::coord::{Shift, cartesian::Cartesian2d};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde_json::json;
use std::error::Error;
use std::ops::Range;

/// A curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend. Curves of the same name have one colour and one place in the legend, which switches all.
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
    logarithmic: bool,
    /// Where on the abscissa something happened, and what.
    events: Vec<(f64, String)>,
}

const COLOURS: [RGBColor; 6] = [
    RGBColor(0x1f, 0x6f, 0xb4),
    RGBColor(0xd6, 0x5f, 0x0e),
    RGBColor(0x2b, 0x8c, 0x4a),
    RGBColor(0xb0, 0x2a, 0x37),
    RGBColor(0x6f, 0x4b, 0xa3),
    RGBColor(0x55, 0x55, 0x55),
];
/// The same on a dark page.
const DARK: [RGBColor; 6] = [
    RGBColor(0x6d, 0xb3, 0xf2),
    RGBColor(0xff, 0x9d, 0x57),
    RGBColor(0x6f, 0xcf, 0x8b),
    RGBColor(0xf2, 0x7b, 0x86),
    RGBColor(0xb9, 0x9a, 0xf0),
    RGBColor(0xb5, 0xb5, 0xb5),
];
const GRID: RGBColor = RGBColor(0xe4, 0xe4, 0xe4);
const AXIS: RGBColor = RGBColor(0x88, 0x88, 0x88);
/// Font and its size.
const LABEL: (&str, i32) = ("sans-serif", 13);
/// Height of a row of the legend, which stands above the curves and hides none, and the width that it has, pixels.
const LEGEND: i32 = 18;
const LEGEND_END: i32 = 880;

/// Abscissa and ordinate of the points that are numbers, each abscissa once, to six digits.
fn columns(points: &[(f64, f64)]) -> [Vec<f64>; 2] {
    let digits = |value: f64| format!("{value:.5e}").parse().unwrap_or(value);
    let [mut xs, mut ys] = [Vec::new(), Vec::new()];
    for &(x, y) in points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
        let x = digits(x);
        if xs.last() != Some(&x) {
            xs.push(x);
            ys.push(digits(y));
        }
    }
    [xs, ys]
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

impl Plot {
    /// A diagram.
    pub fn new(title: &str, x: &str, y: &str, series: Vec<Series>) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), series, logarithmic: false, events: Vec::new() }
    }

    /// With a logarithmic ordinate: values of zero and below are left out.
    pub fn logarithmic(mut self) -> Self {
        self.series.iter_mut().for_each(|series| series.points.retain(|(_, y)| *y > 0.0));
        self.logarithmic = true;
        self
    }

    /// With a mark where something happened.
    pub fn event(mut self, at: f64, what: &str) -> Self {
        self.events.push((at, what.into()));
        self
    }

    /// For the page's script: names, units and points. `None` where a curve goes back along the abscissa, which the
    /// script cannot draw.
    pub fn data(&self) -> Option<String> {
        let rising = |series: &Series| series.points.windows(2).all(|pair| pair[0].0 <= pair[1].0);
        if !self.series.iter().all(rising) {
            return None;
        }
        let curves: Vec<_> = self.series.iter().map(|series| columns(&series.thinned(2000))).collect();
        let names: Vec<_> = self.series.iter().map(|series| series.name.as_str()).collect();
        let [light, dark] = [&COLOURS, &DARK].map(|colours| {
            let css = |RGBColor(r, g, b): RGBColor| format!("#{r:02x}{g:02x}{b:02x}");
            self.coloured(colours).map(|(_, colour)| css(colour)).collect::<Vec<_>>()
        });
        let data = json!({
            "x": self.x, "y": self.y, "names": names, "curves": curves, "light": light, "dark": dark,
            "logarithmic": self.logarithmic, "events": self.events,
        });
        // Nothing in the data may end its element of the page.
        Some(data.to_string().replace('<', "\\u003c"))
    }

    /// The curves, each with its colour.
    fn coloured<'a>(&'a self, colours: &'a [RGBColor; 6]) -> impl Iterator<Item = (&'a Series, RGBColor)> {
        let names = self.names();
        let place = move |series: &Series| names.iter().position(|name| *name == series.name).unwrap_or(0);
        self.series.iter().map(move |series| (series, colours[place(series) % colours.len()]))
    }

    /// What the legend says: each name once.
    fn names(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for series in &self.series {
            if !names.contains(&series.name.as_str()) {
                names.push(series.name.as_str());
            }
        }
        names
    }

    /// The diagram as SVG.
    ///
    /// # Errors
    /// A curve without a finite point.
    pub fn svg(&self) -> Result<String> {
        self.draw().map_err(|error| anyhow!("the plot {:?}: {error}", self.title))
    }

    fn draw(&self) -> Result<String, Box<dyn Error>> {
        let (x, y) = (self.range(|p| p.0, 0.0)?, self.range(|p| p.1, 0.06)?);
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (900, 300)).into_drawing_area();
            root.fill(&WHITE)?;
            let mut area = root.clone();
            if self.series.len() > 1 {
                let rows = self.legend(&root)?;
                area = root.split_vertically(4 + rows * LEGEND).1;
            }
            if self.logarithmic {
                let high = y.end;
                let decade = 0.99 * 10_f64.powf(self.range(|p| p.1, 0.0)?.start.log10().floor());
                self.curves(&area, x, (decade..high).log_scale())?;
            } else {
                self.curves(&area, x, y)?;
            }
            root.present()?;
        }
        Ok(svg)
    }

    fn curves<Y>(&self, area: &Area, x: Range<f64>, y: Y) -> Result<(), Box<dyn Error>>
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut chart: ChartContext<_, Cartesian2d<RangedCoordf64, Y::CoordDescType>> = ChartBuilder::on(area)
            .margin(8)
            .margin_right(16)
            .x_label_area_size(38)
            .y_label_area_size(62)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(&self.x)
            .y_desc(&self.y)
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .light_line_style(WHITE)
            .bold_line_style(GRID)
            .axis_style(AXIS)
            .label_style(LABEL)
            .draw()?;
        for (series, colour) in self.coloured(&COLOURS) {
            chart.draw_series(LineSeries::new(series.thinned(1200), colour.stroke_width(1)))?;
        }
        Self::marks(&self.events, &chart)
    }

    /// Where something happened: a line across, with a name.
    fn marks<Y>(
        events: &[(f64, String)],
        chart: &ChartContext<SVGBackend, Cartesian2d<RangedCoordf64, Y>>,
    ) -> Result<(), Box<dyn Error>>
    where
        Y: Ranged<ValueType = f64>,
    {
        let area = chart.plotting_area();
        let (columns, rows) = area.get_pixel_range();
        let pixels = area.strip_coord_spec();
        for (at, what) in events {
            let x = area.map_coordinate(&(*at, chart.y_range().start)).0 - columns.start;
            pixels.draw(&PathElement::new([(x, 0), (x, rows.end - rows.start)], AXIS.stroke_width(1)))?;
            pixels.draw(&Text::new(what.as_str(), (x + 4, 2), LABEL))?;
        }
        Ok(())
    }

    /// Names side by side, each after a stroke of its colour; returns how many rows they take.
    fn legend(&self, area: &Area) -> Result<i32, Box<dyn Error>> {
        let style = TextStyle::from(LABEL).pos(Pos::new(HPos::Left, VPos::Center));
        let (mut x, mut rows) = (70, 1);
        for (name, colour) in self.names().into_iter().zip(COLOURS.iter().cycle()) {
            let width = 24 + area.estimate_text_size(name, &style)?.0 as i32;
            if x + width > LEGEND_END {
                (x, rows) = (70, rows + 1);
            }
            let y = rows * LEGEND - 4;
            area.draw(&PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3)))?;
            area.draw(&Text::new(name, (x + 24, y), style.clone()))?;
            x += width + 18;
        }
        Ok(rows)
    }

    fn range(&self, of: fn(&(f64, f64)) -> f64, margin: f64) -> Result<Range<f64>> {
        let values = self.series.iter().flat_map(|series| series.points.iter().map(of)).filter(|v| v.is_finite());
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return Err(anyhow!("nothing to plot"));
        }
        let room = if high > low { margin * (high - low) } else { low.abs().max(1.0) * 0.1 };
        Ok(low - room..high + room)
    }
}

/// As short as it can be told apart from its neighbours, and zero without a sign.
fn number(value: &f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}
