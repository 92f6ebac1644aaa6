//! `hallctl coil-field` at a drive whose Halls see the windings: measured, set, and left alone where there is nothing.

use crate::process::Drive;
use serde_json::Value;

fn json(drive: &Drive, arguments: &[&str]) -> Value {
    let text = drive.ok(&[&["--json"], arguments].concat());
    serde_json::from_str(text.lines().last().unwrap()).unwrap_or_else(|why| panic!("{why}: {text}"))
}

#[test]
fn the_field_of_the_windings_is_measured_and_set() {
    // 5 % of the magnets' at 3 A: about an electrical degree an ampere, as the Halls do not see it alike.
    for (share, deg_a) in [("0.05", 1.0), ("0", 0.0)] {
        let drive = Drive::start(&["--coil-field", share]);
        drive.ok(&["calibrate"]);
        let found = json(&drive, &["coil-field"]);
        let number = |name: &str| found[name].as_f64().unwrap_or_else(|| panic!("{found}"));
        assert!((number("deg_a") - deg_a).abs() < 0.25 && number("error_deg_a") < 0.25, "{found}");
        assert_eq!(found["set"], deg_a != 0.0, "{found}");
        let set = json(&drive, &["settings", "get", "hall_coil_deg_a"]);
        let expected = if deg_a == 0.0 { 0.0 } else { number("deg_a") };
        assert!((set["value"].as_f64().unwrap() - expected).abs() < 1e-3, "{set}");
        let status = json(&drive, &["status"]);
        assert!(status.to_string().contains("ready") || status.to_string().contains("Ready"), "{status}");
    }
}

#[test]
fn it_is_refused_while_the_bridge_is_on() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let said = drive.fails(6, &["coil-field"]);
    assert!(said.contains("hallctl stop"), "{said}");
}

/// 6 is what was never begun, 7 what came to nothing; so is the response of the loops, which needs that current, too.
#[test]
fn without_a_current_along_q_it_is_refused() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["commutation", "block"]);
    for command in [&["coil-field"][..], &["chirp", "current"], &["chirp", "speed"]] {
        assert!(drive.fails(6, command).contains("field-oriented"), "{command:?}");
    }
}
