//! What every page has in common: style, contents, tables, and the script that makes diagrams of pictures.
//!
//! Each diagram is there as a picture, for paper and for readers without scripts; the script replaces it by one with
//! values, zoom and a legend that switches curves (uPlot 1.6.32 from npm, MIT licence, beside this file). The page
//! forbids the browser to load anything.

use std::fmt::Write;

const STYLE: &str = include_str!("page/page.css");
const UPLOT_STYLE: &str = include_str!("page/uPlot.min.css");
const UPLOT: &str = include_str!("page/uPlot.iife.min.js");
const SCRIPT: &str = include_str!("page/page.js");

/// How the first sentence begins.
pub const LEAD: &str = "<p class=\"lead\">";

/// From so many headings on a page has a list of them.
const CONTENTS: usize = 6;

pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// What of a page would make a browser load something from elsewhere: there has to be nothing.
pub fn loads(html: &str) -> Vec<&'static str> {
    const LOADS: [&str; 15] = [
        " src=",
        " srcset=",
        "<link",
        "<iframe",
        "<object",
        "<embed",
        "@import",
        "url(",
        "fetch(",
        "XMLHttpRequest",
        "import(",
        "WebSocket",
        "sendBeacon",
        "href=\"http",
        "xlink:href",
    ];
    LOADS.into_iter().filter(|load| html.contains(load)).collect()
}

/// The whole page.
pub fn html(title: &str, headings: &[(u8, String)], body: &str) -> String {
    let title = escaped(title);
    // What draws diagrams is left out where there are none.
    let (style, script) = if body.contains("data-plot") {
        (UPLOT_STYLE, format!("<script>{UPLOT}</script>\n<script>{SCRIPT}</script>\n"))
    } else {
        ("", String::new())
    };
    // The first sentence stands before the list of contents.
    let (first, rest) = match body.split_once("</p>\n") {
        Some((first, rest)) if body.starts_with(LEAD) => (format!("{first}</p>\n"), rest),
        _ => (String::new(), body),
    };
    let hint = if script.is_empty() { "" } else { HINT };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
         script-src 'unsafe-inline'\">\n<title>{title}</title>\n<style>{style}{STYLE}</style>\n</head>\n\
         <body>\n<h1>{title}</h1>\n{first}{}{hint}{rest}{script}</body>\n</html>\n",
        contents(headings)
    )
}

fn contents(headings: &[(u8, String)]) -> String {
    if headings.len() < CONTENTS {
        return String::new();
    }
    let item = |(id, (level, text)): (usize, &(u8, String))| {
        let text = escaped(text);
        let text = if *level == 1 { format!("<b>{text}</b>") } else { text };
        format!("<li><a href=\"#h{id}\">{text}</a></li>\n")
    };
    format!("<nav><ul>\n{}</ul></nav>\n", headings.iter().enumerate().map(item).collect::<String>())
}

/// A diagram: its picture, and for the script its data.
pub fn figure(title: &str, picture: &str, data: Option<&str>, caption: &str) -> String {
    let title = escaped(title);
    let mut figure = format!("<h3>{title}</h3>\n<figure");
    // Writing into a string does not fail.
    let _ = match data {
        Some(data) => write!(
            figure,
            " data-plot role=\"img\" aria-label=\"{title}\"><div class=\"here\"></div>{picture}\
             <script type=\"application/json\">{data}</script>"
        ),
        None => write!(figure, ">{picture}"),
    };
    if !caption.is_empty() {
        let _ = write!(figure, "<figcaption>{}</figcaption>", escaped(caption));
    }
    figure + "</figure>"
}

/// What the script adds to the pictures, said once.
const HINT: &str = "<p class=\"hint\">Drag, or use two fingers, to zoom into a diagram; double-click to zoom out; \
                    click a name to hide its curve.</p>\n";

/// From so many letters on a cell of a table has a width of its own, or it would be all height beside many others.
const LONG: usize = 60;

/// A table; the first row is the head.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let numeric: Vec<bool> = (0..columns).map(|column| is_numeric(rows, column)).collect();
    let row = |(number, row): (usize, &Vec<String>)| {
        let tag = if number == 0 { "th" } else { "td" };
        let cell = |(column, cell): (usize, &String)| {
            let class = match cell.chars().count() {
                LONG.. => " class=\"long\"",
                _ if numeric[column] => " class=\"n\"",
                _ => "",
            };
            format!("<{tag}{class}>{}</{tag}>", escaped(cell))
        };
        format!("<tr>{}</tr>\n", row.iter().enumerate().map(cell).collect::<String>())
    };
    let rows: String = rows.iter().enumerate().map(row).collect();
    format!("<div class=\"scroll\"><table class=\"data\">\n{rows}</table></div>")
}

/// Whether most cells of a column under the head begin like a number.
fn is_numeric(rows: &[Vec<String>], column: usize) -> bool {
    let cells = rows.iter().skip(1).filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty());
    let (mut numbers, mut words) = (0, 0);
    for cell in cells {
        let is_number = cell.trim_start().starts_with(|c: char| c.is_ascii_digit() || "+-−–±<".contains(c));
        if is_number { numbers += 1 } else { words += 1 }
    }
    column > 0 && numbers > words
}
