//! SAFETY.md promises nothing that no test is named for, and names no test that does not exist.

use std::fs;
use std::path::Path;

fn read(path: &str) -> String {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The trials of the virtual boards.
const VIRTUAL: &str = "emulator/virtual/tests/boards/";

/// What a line sets in backquotes.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Whether there is such a test: `file::function`, or `faults: kind`.
fn exists(name: &str) -> bool {
    let campaign = ["kind.rs", "encoder.rs"].map(|file| read(&format!("sim/src/experiment/faults/{file}"))).concat();
    match (name.split_once("::"), name.strip_prefix("faults: ")) {
        (_, Some(kind)) => campaign.contains(&format!("\"{kind}\"")),
        (Some((file, function)), None) => {
            let text = read(file);
            let head = format!("fn {function}(");
            // Those of the virtual boards are functions that one list runs for every board.
            if file.starts_with(VIRTUAL) {
                return text.contains(&format!("pub {head}")) && read(&format!("{VIRTUAL}main.rs")).contains(function);
            }
            text.split("#[test]").skip(1).any(|test| test.lines().take(4).any(|line| line.contains(&head)))
        }
        _ => false,
    }
}

#[test]
fn every_promise_names_tests_that_exist() {
    let text = read("SAFETY.md");
    let (text, _) = text.split_once("## What is not protected").unwrap();
    let promises: Vec<_> =
        text.lines().filter(|line| line.starts_with("| ")).map(|line| line.split('|').collect::<Vec<_>>()).collect();
    assert!(promises.len() > 10);
    for cells in &promises[1..] {
        assert_eq!(cells.len(), 5, "{cells:?}");
        let tests: Vec<_> = quoted(cells[3]).collect();
        assert!(!tests.is_empty(), "no test for: {}", cells[1]);
        for test in tests {
            assert!(exists(test), "there is no test {test}");
        }
    }
    assert!(!exists("tests/safety.rs::nobody_wrote_this"));
    assert!(!exists("faults: nobody injects this"));
}
