//! A spring and a damper by the tool.

use crate::process::Drive;

fn position(drive: &Drive) -> f64 {
    let status = drive.ok(&["status"]);
    let line = status.lines().find_map(|line| line.trim().strip_prefix("position")?.trim().strip_suffix(" turns"));
    line.unwrap_or_else(|| panic!("{status}")).trim().parse().unwrap()
}

/// In the order in which they are written.
#[test]
fn the_commands_of_the_page_are_obeyed() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let page = include_str!("../../docs/impedance.md");
    let commands: Vec<_> = page.lines().filter_map(|line| line.strip_prefix("$ hallctl ")).collect();
    for command in &commands {
        let words: Vec<_> = command.split('#').next().unwrap().split_whitespace().collect();
        drive.ok(&words);
    }
    assert_eq!(commands.len(), 5);
}

#[test]
fn the_shaft_is_held_moved_and_let_go() {
    let drive = Drive::start(&[]);
    assert!(drive.fails(6, &["impedance", "1", "--once"]).contains("off"));
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    drive.ok(&["impedance", "0.5", "--seconds", "1"]);
    // Friction and cogging over the stiffness.
    assert!((position(&drive) - 0.5).abs() < 0.01, "{}", position(&drive));
    drive.ok(&["impedance", "--velocity", "20", "--stop", "360deg", "--seconds", "1"]);
    assert!((position(&drive) - 1.0).abs() < 0.01, "{}", position(&drive));
    drive.ok(&["impedance", "--within", "-0.5", "0.25", "--max-torque", "20mNm", "--seconds", "1"]);
    assert!((position(&drive) - 0.25).abs() < 0.05, "{}", position(&drive));
    let refused = drive.fails(6, &["impedance", "0", "--kp", "5", "--once"]);
    assert!(refused.contains("kp in N·m/rad is 5, but must be a number from 0 to 0.49"), "{refused}");
    drive.fails(2, &["impedance", "0", "--velocity", "1", "--once"]);
    drive.fails(2, &["impedance", "--within", "0", "--once"]);
    let crossed = drive.fails(6, &["impedance", "--within", "1", "0", "--once"]);
    assert!(crossed.contains("ends before it begins"), "{crossed}");
}
