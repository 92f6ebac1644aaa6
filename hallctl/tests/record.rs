//! `hallctl record` and `hallctl chirp` at a simulated drive in a process of its own.

use crate::process::{Drive, spawn};
use serde_json::Value;

fn calibrated() -> Drive {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive
}

fn json(text: &str) -> Value {
    serde_json::from_str(text.trim()).unwrap_or_else(|why| panic!("{why}: {text}"))
}

#[test]
fn a_recording_is_a_table_a_file_of_json_and_a_page() {
    let drive = calibrated();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [csv, page, data] = ["a.csv", "a.html", "a.json"].map(path);
    let said = drive.ok(&["record", "-c", "bus,hall_1,angle", "--rows", "100", "-o", &csv, "-o", &page, "-o", &data]);
    assert!(said.contains("100 rows, 25.0 µs apart; 0 before") && said.contains("hall_1"), "{said}");
    let csv = std::fs::read_to_string(csv).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((rows.len(), &rows[0][..]), (101, &["time_s", "bus", "hall_1", "angle"][..]));
    assert_eq!(rows[100][0], "0.002475000");
    assert!((rows[1][1].parse::<f64>().unwrap() - 24.0).abs() < 1.0, "{:?}", rows[1]);
    let data = json(&std::fs::read_to_string(data).unwrap());
    assert_eq!(data["hall_1"].as_array().unwrap().len(), 100);
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("hall_1") && page.contains("trigger"));
    // The same to a script, and to a pipe.
    assert_eq!(
        json(&drive.ok(&["--json", "record", "--rows", "7", "-c", "speed"]))["speed"].as_array().unwrap().len(),
        7
    );
    assert_eq!(drive.ok(&["record", "--rows", "7", "-c", "speed", "-o", "-"]).lines().count(), 8);
}

/// Of the speed control that held the motor before.
#[test]
fn with_the_bridge_off_no_current_is_asked_for() {
    let drive = calibrated();
    let references = || {
        let told = json(&drive.ok(&["--json", "record", "-c", "i_q_ref,i_d_ref", "--rows", "5"]));
        ["i_q_ref", "i_d_ref"]
            .map(|name| told[name].as_array().unwrap().iter().map(|row| row.as_f64().unwrap()).collect())
    };
    for command in [&["speed", "50", "--seconds", "0.5"][..], &["speed", "-50", "--seconds", "0.5"]] {
        drive.ok(&["arm"]);
        drive.ok(command);
        assert!(references().iter().any(|rows: &Vec<f64>| rows.iter().any(|row| *row != 0.0)));
        drive.ok(&["stop"]);
        assert_eq!(references(), [vec![0.0; 5], vec![0.0; 5]], "{command:?}");
    }
}

#[test]
fn what_cannot_be_recorded_is_said_in_words() {
    let drive = Drive::start(&[]);
    assert!(drive.fails(6, &["record", "-c", "i_q,i_q"]).contains("i_q is to be recorded twice"));
    assert!(drive.fails(6, &["record", "--trigger", "i_q>1e6"]).contains("within"));
    assert!(drive.fails(6, &["record", "-c", "i_q,i_d,speed,bus,angle"]).contains("4 channels"));
    for wrong in [&["-c", "torque"][..], &["--trigger", "i_q>nan"], &["--before", "1"], &["--every", "0"]] {
        drive.fails(2, &[&["record"], wrong].concat());
    }
    // The trigger never comes; the scope is free then.
    let said = drive.fails(7, &["record", "--trigger", "bus>30", "--seconds", "0.2"]);
    assert!(said.contains("the trigger did not come within 0.2 s"), "{said}");
    drive.ok(&["record"]);
}

#[test]
fn a_file_keeps_what_it_holds_until_there_is_something_else() {
    let drive = Drive::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("keep");
    let path = file.to_str().unwrap();
    let never = ["--trigger", "bus>30", "--seconds", "0.2"];
    std::fs::write(&file, "kept").unwrap();
    for (code, command) in [
        (6, &["record", "-c", "i_q,i_q", "-o", path][..]),
        (7, &[&["record", "-o", path], &never[..]].concat()),
        (6, &["chirp", "current", "--size", "0", "-o", path]),
    ] {
        let output = drive.call(command);
        assert_eq!(output.status.code(), Some(code), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept", "{command:?}");
    }
    // What was not there is not left, and what there is beside it is no business of the tool.
    let new = folder.path().join("new.csv");
    drive.fails(6, &["record", "-c", "i_q,i_q", "-o", new.to_str().unwrap()]);
    drive.ok(&["record", "--rows", "7", "-c", "speed", "-o", path]);
    assert_eq!(std::fs::read_to_string(&file).unwrap().lines().count(), 8);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["keep"]);
    drive.fails(1, &["record", "-o", folder.path().join("no/such.csv").to_str().unwrap()]);
}

#[test]
fn a_command_of_another_tool_is_recorded() {
    let drive = calibrated();
    // Each request of the recorder is worth some time, and the other tool may be late on a busy machine.
    drive.ok(&["settings", "set", "command_timeout_s", "60"]);
    drive.ok(&["arm"]);
    let arguments = ["--json", "record", "--trigger", "speed>15", "--every", "8", "-c", "speed,speed_ref,i_q,position"];
    let mut recorder = spawn(&drive.port, &arguments);
    // However long it takes to come.
    while recorder.try_wait().unwrap().is_none() {
        drive.ok(&["speed", "40", "--seconds", "0.5"]);
        drive.ok(&["speed", "0", "--seconds", "0.5"]);
    }
    let output = recorder.wait_with_output().unwrap();
    let found = json(&String::from_utf8(output.stdout).unwrap());
    let of = |name: &str, row: usize| found[name][row].as_f64().unwrap();
    assert!(of("speed", 127) < 15.0 && of("speed", 128) >= 15.0 && of("time_s", 128) == 0.0, "{found}");
    assert!(of("position", 511) > of("position", 0));
}

/// What 80 kHz are for: the current control has the bandwidth that it is set to, of more than 40 kHz allow with a margin.
#[test]
fn the_current_control_is_faster_where_the_bridge_switches_faster() {
    let drive = calibrated();
    drive.ok(&["settings", "set", "pwm_hz", "80000"]);
    drive.ok(&["settings", "set", "current_bandwidth_hz", "2500"]);
    let found = json(&drive.ok(&["--json", "chirp", "current", "--steps", "8"]));
    let of = |loops: &str, name: &str| found[loops][name].as_f64().unwrap_or_else(|| panic!("{name}: {found}"));
    let [bandwidth, crossover, margin] =
        ["bandwidth_hz", "crossover_hz", "phase_margin_deg"].map(|name| of("measured", name));
    println!("at 80 kHz: {bandwidth:.0} Hz to -3 dB, gain of one at {crossover:.0} Hz, {margin:.0}° of margin");
    assert!((crossover / 2500.0 - 1.0).abs() < 0.12 && margin > 60.0, "{found}");
    assert!((margin - of("model", "phase_margin_deg")).abs() < 8.0, "{found}");
}

/// The loops have the bandwidths that the settings ask for, and the margins of the model.
#[test]
fn loops_are_measured_beside_the_model() {
    let drive = calibrated();
    let of = |value: &Value, name: &str| value[name].as_f64().unwrap_or_else(|| panic!("{name}: {value}"));
    // The speed follows beyond what is measured, as its acceleration is fed forward.
    for (which, names) in [("current", &["bandwidth_hz", "crossover_hz"][..]), ("speed", &["crossover_hz"])] {
        let found = json(&drive.ok(&["--json", "chirp", which, "--steps", "8"]));
        let (measured, model) = (&found["measured"], &found["model"]);
        println!("{which}: {measured} {model}");
        for name in names {
            let share = of(measured, name) / of(model, name);
            assert!((share - 1.0).abs() < 0.12, "{which} {name}: {measured} {model}");
        }
        let margins = of(measured, "phase_margin_deg") - of(model, "phase_margin_deg");
        assert!(margins.abs() < 8.0, "{which}: {measured} {model}");
    }
    assert!(drive.ok(&["status"]).contains("ready"));
    assert!(drive.fails(6, &["chirp", "current", "--size=-1"]).contains("above 0"));
    // Less than the noise: nothing is made up.
    let found = json(&drive.ok(&["--json", "chirp", "current", "--steps", "4", "--size", "0.005"]));
    assert!(found["measured"]["bandwidth_hz"].is_null(), "{}", found["measured"]);
    let page = tempfile::tempdir().unwrap();
    let path = page.path().join("chirp.html");
    drive.ok(&["chirp", "current", "--steps", "2", "-o", path.to_str().unwrap()]);
    assert!(std::fs::read_to_string(path).unwrap().contains("Phase, open loop"));
}
