//! The pages, what they quote, and which of their figures have a source.

use super::prose;
use super::text::{Narrow, Number};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{fs, ops::Range};

/// What a page says in the place of a figure.
#[derive(Clone, Copy, Debug)]
pub enum Figure {
    /// This, rounded as the page has it.
    Is(f64),
    /// A bound that this keeps: "within 3 %".
    AtMost(f64),
}

impl Figure {
    fn is_said_by(self, quoted: &Number) -> bool {
        match self {
            Self::Is(value) => (quoted.value - value).abs() <= 0.5 * quoted.unit * (1.0 + 1e-6),
            Self::AtMost(value) => value <= quoted.value * (1.0 + 1e-9),
        }
    }
}

/// The repository's root.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A file of the repository.
pub fn read(file: &str) -> String {
    fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

pub fn exists(file: &str) -> bool {
    root().join(file).exists()
}

/// A page, and where it was found to quote a source.
struct Page {
    name: String,
    text: String,
    narrow: Narrow,
    quoted: Vec<Range<usize>>,
}

/// All pages that quote figures, and what is wrong with them.
pub struct Pages {
    pages: Mutex<Vec<Page>>,
    wrong: Mutex<Vec<String>>,
}

impl Pages {
    pub fn new() -> Self {
        let mut names: Vec<String> =
            ["README.md", "SAFETY.md", "SECURITY.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "boards/PORTING.md"]
                .map(String::from)
                .to_vec();
        names.extend(["boards/README.md", "emulator/README.md"].map(String::from));
        for (folder, file) in [("docs", None), ("boards", Some("README.md"))] {
            for entry in fs::read_dir(root().join(folder)).unwrap() {
                let name = entry.unwrap().file_name().into_string().unwrap();
                let name = file.map_or(format!("{folder}/{name}"), |file| format!("{folder}/{name}/{file}"));
                if name.ends_with(".md") && exists(&name) {
                    names.push(name);
                }
            }
        }
        names.sort();
        let page = |name: String| {
            let text = read(&name);
            Page { narrow: Narrow::new(&text), name, text, quoted: Vec::new() }
        };
        Self { pages: Mutex::new(names.into_iter().map(page).collect()), wrong: Mutex::default() }
    }

    pub fn wrong(&self, what: String) {
        self.wrong.lock().unwrap().push(what);
    }

    /// The page says this, word for word.
    pub fn say(&self, page: &str, text: &str) {
        self.quote(page, text, &[]);
    }

    /// The page says this, and has these figures in the places of `{}`.
    pub fn quote(&self, page: &str, template: &str, figures: &[Figure]) {
        let mut pages = self.pages.lock().unwrap();
        let page = pages.iter_mut().find(|each| each.name == page).unwrap_or_else(|| panic!("no {page}"));
        let found = page.narrow.find(template);
        let Some((range, quoted)) = found.into_iter().next() else {
            return self.wrong(format!("{} does not say {template:?}: is a figure no longer true?", page.name));
        };
        assert_eq!(quoted.len(), figures.len(), "{template:?}");
        page.quoted.push(range);
        for (quoted, figure) in quoted.iter().zip(figures) {
            if !figure.is_said_by(quoted) {
                let name = &page.name;
                self.wrong(format!("{name}, {template:?}: it says {}, its source says {figure:?}", quoted.value));
            }
        }
    }

    /// The page says this wherever it does, with a figure in its prose that needs no source.
    pub fn give(&self, page: &str, text: &str) {
        let mut pages = self.pages.lock().unwrap();
        let page = pages.iter_mut().find(|each| each.name == page).unwrap_or_else(|| panic!("no {page}"));
        let found: Vec<_> = page.narrow.find(text).into_iter().map(|(range, _)| range).collect();
        let figures = prose::figures(&page.text);
        if !found.iter().any(|range| figures.iter().any(|at| range.start < at.end && at.start < range.end)) {
            return self.wrong(format!("{} does not give {text:?}", page.name));
        }
        page.quoted.extend(found);
    }

    /// Cells of tables with figures that no source was found to say, but for columns of what is wanted and for tables
    /// that `excused` knows, by page and heading.
    pub fn check_tables(&self, excused: impl Fn(&str, &str) -> bool) {
        for page in self.pages.lock().unwrap().iter() {
            for cell in cells(&page.text) {
                let quoted = page.quoted.iter().any(|range| range.start < cell.at.end && cell.at.start < range.end);
                if has_figure(&page.text[cell.at.clone()])
                    && !quoted
                    && !WANTED.contains(&cell.column)
                    && !excused(&page.name, cell.heading)
                {
                    let (name, heading, row) = (&page.name, cell.heading, cell.row);
                    self.wrong(format!("{name}, {heading}: no source for {:?} of {row}", &page.text[cell.at]));
                }
            }
        }
    }

    /// Figures in prose that no source was found to say.
    pub fn check_prose(&self) {
        for page in self.pages.lock().unwrap().iter() {
            for at in prose::figures(&page.text) {
                if !page.quoted.iter().any(|range| range.start < at.end && at.start < range.end) {
                    let around = |at: usize, wanted: usize| {
                        (wanted..page.text.len().min(at + 60)).find(|at| page.text.is_char_boundary(*at)).unwrap_or(at)
                    };
                    let words = &page.text[around(at.start, at.start.saturating_sub(40))..around(at.end, at.end)];
                    let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
                    self.wrong(format!("{}: no source for {:?} of {words:?}", page.name, &page.text[at]));
                }
            }
        }
    }

    /// Whether a page has a table of figures under a heading, or at all.
    pub fn has_figures_under(&self, name: &str, heading: &str) -> bool {
        let pages = self.pages.lock().unwrap();
        let mut cells = pages.iter().filter(|page| page.name == name).flat_map(|page| cells(&page.text));
        cells.any(|cell| heading.is_empty() || cell.heading == heading)
    }

    /// Panics with all that is wrong.
    pub fn finish(self) {
        let wrong = self.wrong.into_inner().unwrap();
        assert!(wrong.is_empty(), "{} figures:\n{}", wrong.len(), wrong.join("\n"));
    }
}

/// Columns that tell no result.
const WANTED: [&str; 2] = ["wanted", "budget"];

/// Whether a text has a figure: not in code, nor within a name.
fn has_figure(text: &str) -> bool {
    let words = text.split('`').step_by(2).flat_map(str::split_whitespace);
    let figure =
        |word: &str| word.trim_start_matches(|c: char| !c.is_alphanumeric()).starts_with(|c: char| c.is_ascii_digit());
    words.into_iter().any(figure)
}

struct Cell<'a> {
    heading: &'a str,
    column: &'a str,
    row: &'a str,
    at: Range<usize>,
}

/// The cells of all tables in a page, but for their heads and first columns.
fn cells(text: &str) -> Vec<Cell<'_>> {
    let (mut cells, mut heading, mut head, mut start) = (Vec::new(), "", None::<Vec<&str>>, 0);
    let mut code = false;
    for line in text.split_inclusive('\n') {
        let row = line.trim();
        code ^= row.starts_with("```");
        if code {
        } else if let Some(title) = row.strip_prefix('#') {
            (heading, head) = (title.trim_start_matches('#').trim(), None);
        } else if !row.starts_with('|') {
            head = None;
        } else if let Some(head) = &head {
            let mut at = start;
            for (number, cell) in line.trim_end().split('|').enumerate() {
                // Before the first bar there is nothing.
                if number > 1 && !row.starts_with("|---") {
                    let column = head.get(number).copied().unwrap_or_default();
                    cells.push(Cell { heading, column, row, at: at..at + cell.len() });
                }
                at += cell.len() + 1;
            }
        } else {
            head = Some(row.split('|').map(str::trim).collect());
        }
        start += line.len();
    }
    cells
}

#[test]
fn cells_are_found_where_they_are() {
    let text =
        "# A\n| what | reached | wanted |\n|---|---|---|\n| x | 1 | 2 |\n\n## B\n| | 7 |\n|---|---|\n| y | 3 |\n";
    let found: Vec<_> = cells(text).into_iter().map(|cell| (cell.heading, cell.column, &text[cell.at])).collect();
    let rows = [("A", "reached", " 1 "), ("A", "wanted", " 2 "), ("A", "", ""), ("B", "7", " 3 "), ("B", "", "")];
    assert_eq!(found, rows);
}

#[test]
fn names_and_code_are_no_figures() {
    assert!(["≤ 1.1", "**300**", "±5°", "within 3 %", "−45 A"].into_iter().all(has_figure));
    assert!(["STM32G4", "`--seed 1`", "Cortex-M4F", "R, L"].into_iter().all(|text| !has_figure(text)));
}
