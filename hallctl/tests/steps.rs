//! What `step` and `sine` say is what the motor did by them, and by nothing before.

use crate::process::Drive;
use serde_json::Value;

impl Drive {
    fn response(&self, arguments: &[&str]) -> Value {
        let text = self.ok(&[&["--json"], arguments].concat());
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments:?}: {error}: {text}"))
    }
}

/// It takes seconds to come to rest, like a heavy wheel.
#[test]
fn a_step_begins_where_it_says_though_the_motor_was_turning() {
    let drive = Drive::start(&[]);
    drive.ok(&["settings", "set", "max_acceleration_rad_s2", "50"]);
    drive.ok(&["calibrate"]);
    let is_one = |arguments: &[&str]| {
        let found = drive.response(&[arguments, &["--seconds", "2"]].concat());
        let number = |name: &str| found["measured"][name].as_f64().unwrap_or_else(|| panic!("{arguments:?}: {found}"));
        assert!(number("overshoot_pct") < 20.0 && number("rise_s") > 0.1, "{arguments:?}: {found}");
    };
    drive.ok(&["arm"]);
    is_one(&["step", "speed", "20"]);
    drive.ok(&["speed", "100", "--seconds", "3"]);
    is_one(&["step", "speed", "20"]);
    // From a speed that it has to reach first.
    is_one(&["step", "speed", "20", "--from", "100"]);
    // A position is one from where the motor has come to rest.
    drive.ok(&["speed", "100", "--seconds", "3"]);
    is_one(&["step", "position", "1"]);
    // Coasting, the bridge off.
    drive.ok(&["speed", "-100", "--seconds", "5"]);
    drive.ok(&["stop"]);
    is_one(&["step", "speed", "20"]);
}

#[test]
fn what_no_sine_has_measured_is_not_told_as_a_figure() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    // The simulated drive takes 50 set-points a second here.
    let output = drive.call(&["sine", "speed", "10", "--frequency", "1,300,250"]);
    let (said, told) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(7), "{said}{told}");
    assert!(said.contains("1 Hz") && !said.contains("NaN") && !said.contains("300"), "{said}");
    assert!(told.contains("not measured: 300 Hz, 250 Hz"), "{told}");
    let output = drive.call(&["sine", "speed", "10", "--frequency", "1000", "--periods", "2"]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(7), 0));
    // A frequency that it cannot follow is not one that it follows.
    let said = drive.ok(&["sine", "position", "100", "--frequency", "1"]);
    assert!(said.contains("below these frequencies"), "{said}");
    assert!(drive.fails(2, &["sine", "speed", "10", "--frequency", "0"]).contains("a frequency"));
}

/// At 5 rad/s, noise of 0.5 RMS: peaks of it are half of the step, in one run of two.
#[test]
fn noise_is_no_overshoot_of_a_small_step() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let overshoot: Vec<_> = (0..6)
        .map(|_| drive.response(&["step", "speed", "5"])["measured"]["overshoot_pct"].as_f64().unwrap())
        .collect();
    assert!(overshoot.iter().all(|pct| *pct < 25.0), "{overshoot:?}");
    // Where there is more, it is told.
    drive.ok(&["settings", "set", "inertia_kgm2", "4e-6"]);
    let large = drive.response(&["step", "speed", "100"]);
    assert!(large["measured"]["overshoot_pct"].as_f64().unwrap() > 2.0, "{large}");
}

/// A person has waited for the measurement, and the motor has turned for it.
#[test]
fn a_file_that_cannot_be_written_is_found_before_the_motor_turns() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let turns = || drive.response(&["status"])["position_turns"].as_f64().unwrap();
    let before = turns();
    for command in [["step", "speed", "20"], ["sine", "position", "0.1"]] {
        for option in ["--csv", "--plot"] {
            let output = drive.call(&[&command[..], &[option, "/no/such/folder/file"]].concat());
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!((output.status.code(), output.stdout.len()), (Some(1), 0), "{command:?}: {said}");
            assert!(said.contains("cannot write /no/such/folder/file"), "{said}");
        }
    }
    assert!((turns() - before).abs() < 0.01, "{before} {}", turns());
    // One that can be is not left behind empty, nor changed, where nothing was measured.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.csv");
    std::fs::write(&file, "kept").unwrap();
    drive.fails(6, &["step", "speed", "1e9", "--csv", file.to_str().unwrap()]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept");
}

/// `--speed-unit` and `--position-unit` are those of what is shown.
#[test]
fn a_step_is_told_in_the_unit_that_was_chosen() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let said = drive.ok(&["--speed-unit", "rpm", "step", "speed", "200"]);
    assert!(said.contains(" rpm") && !said.contains("rad/s "), "{said}");
    let noise = |said: &str| -> f64 {
        let row = said.lines().find(|line| line.contains("noise, RMS")).unwrap_or_else(|| panic!("{said}"));
        row.split_whitespace().nth(2).unwrap().parse().unwrap()
    };
    // The simulated one's is about 0.5 rad/s.
    assert!(noise(&said) > 2.0, "{said}");
    let said = drive.ok(&["--position-unit", "deg", "step", "position", "90"]);
    assert!(said.contains(" deg") && !said.contains("turns"), "{said}");
    // Scripts have the drive's.
    let found = drive.response(&["--speed-unit", "rpm", "step", "speed", "200"]);
    assert_eq!(found["unit"], "rad/s", "{found}");
}

/// A table and a page in one stream are neither; nor is a page a document by its name.
#[test]
fn files_are_what_their_names_say_and_one_at_most_is_the_standard_output() {
    let drive = Drive::start(&[]);
    let commands =
        [&["telemetry", "--seconds", "0.1"][..], &["step", "speed", "20"], &["sine", "speed", "20"], &["record"]];
    for command in commands {
        let both: &[&str] =
            if command[0] == "record" { &["-o", "-", "-o", "-"] } else { &["--csv", "-", "--plot", "-"] };
        let output = drive.call(&[command, both].concat());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{command:?}: {said}");
        assert!(said.contains("standard output"), "{command:?}: {said}");
    }
    let folder = tempfile::tempdir().unwrap();
    for (command, option, name) in [
        (commands[0], "--plot", "x.pdf"),
        (commands[0], "--csv", "x.html"),
        (commands[1], "--plot", "x.csv"),
        (commands[2], "--csv", "x.json"),
    ] {
        let file = folder.path().join(name);
        let said = drive.fails(2, &[command, &[option, file.to_str().unwrap()]].concat());
        let wanted = if option == "--csv" { ".csv" } else { ".html" };
        assert!(said.contains(wanted) && !file.exists(), "{command:?} {option} {name}: {said}");
    }
    // From the trigger on alone, as a recording.
    let said = drive.call(&["telemetry", "--trigger", "bus>1", "--before", "0", "--seconds", "0.1", "--csv", "-"]);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    drive.ok(&["record", "--rows", "5", "--before", "0"]);
    assert!(drive.fails(2, &["telemetry", "--trigger", "bus>1", "--before=-1"]).contains("from 0 on"));
}

/// The same of what `tune` shows, and what `commission` shows by it.
#[test]
fn tuning_is_told_in_the_unit_that_was_chosen() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let said = drive.ok(&["--speed-unit", "rpm", "tune"]);
    assert!(said.contains("steps between") && said.contains(" rpm") && !said.contains("rad/s"), "{said}");
    let said = drive.fails(6, &["--speed-unit", "rpm", "tune", "--step", "0.001"]);
    assert!(said.contains("0.001 rpm") && !said.contains("rad/s"), "{said}");
    let said = drive.ok(&["--position-unit", "deg", "tune", "--step", "100"]);
    assert!(said.contains(" 36 deg") && said.contains("rad/s") && !said.contains("turns"), "{said}");
}
