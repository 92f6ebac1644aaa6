//! The pages of the experiments: each says first what is seen, shows pictures before tables, names the unit of each
//! axis, and loads nothing.

use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::{env, fs};

/// The page of an experiment.
fn page(arguments: &[&str]) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("page_{}", arguments[0]));
    let run = Command::new(env!("CARGO_BIN_EXE_hallservo")).args(arguments).arg("--out").arg(&folder).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    fs::read_to_string(folder.join(format!("{}.html", arguments[0]))).unwrap()
}

fn plots(page: &str) -> Vec<Value> {
    let data = page.split("<script type=\"application/json\">").skip(1);
    data.map(|rest| serde_json::from_str(rest.split("</script>").next().unwrap()).unwrap()).collect()
}

fn check(arguments: &[&str], least_plots: usize) {
    let page = page(arguments);
    let name = arguments[0];
    let loads = plots::loads(&page);
    assert!(loads.is_empty() && page.contains("default-src 'none'"), "{name}: {loads:?}");
    let (lead, figure) = (page.find("class=\"lead\"").unwrap(), page.find("<figure").unwrap());
    assert!(lead < figure, "{name}: what is seen comes first");
    let plots = plots(&page);
    assert!(plots.len() >= least_plots, "{name}: {} diagrams", plots.len());
    assert_eq!(page.matches("<svg").count(), plots.len(), "{name}: each picture is one with values, zoom and legend");
    for plot in plots {
        for axis in ["x", "y"] {
            let label = plot[axis].as_str().unwrap();
            let counted = ["electrical turns", "pole pair", "number of the pole pair"].contains(&label);
            assert!(counted || label.contains(" / ") || label.contains('%'), "{name}: no unit in {label:?}");
        }
    }
    for word in ["StuckHead", "HalfDemagnetised", "FieldOriented", "Some(", "None"] {
        let text = page.split("<script>").next().unwrap();
        assert!(!text.contains(word), "{name}: {word} is not a word");
    }
}

#[test]
fn spin() {
    check(&["spin"], 8);
}

#[test]
fn commutation() {
    check(&["commutation"], 3);
}

#[test]
fn pwm() {
    check(&["pwm"], 1);
}

#[test]
fn adapt() {
    check(&["adapt", "--motors", "24"], 7);
}

#[test]
fn vernier() {
    check(&["vernier", "--pairs", "--trials", "20", "--positions", "1000"], 7);
}

#[test]
fn servo() {
    check(&["servo"], 6);
}

#[test]
fn magnets() {
    check(&["magnets", "--rotors", "1", "--kind", "cheap"], 1);
}

#[test]
fn delay() {
    check(&["delay", "--motors", "1", "--kind", "50 µs", "--even", "--without-map"], 1);
}

#[test]
fn cogging() {
    check(&["cogging", "--motor", "drone-15uh"], 1);
}

#[test]
fn papers() {
    check(&["papers"], 20);
}
