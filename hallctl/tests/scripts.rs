//! What a script relies on: JSON from every command, exit codes, standard streams, an output that is full or closed.

use crate::process::{Drive, HALLCTL, PATIENCE, call, spawn};
use serde_json::Value;
use std::fs::File;
use std::io::Write;
use std::process::{Command, Stdio};

impl Drive {
    /// The only line that a command prints.
    fn json(&self, arguments: &[&str]) -> Value {
        let text = self.ok(&[&["--json"], arguments].concat());
        assert_eq!(text.lines().count(), 1, "{arguments:?}: {text}");
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments:?}: {error}: {text}"))
    }
}

#[test]
fn every_command_speaks_json() {
    let drive = Drive::start(&[]);
    assert_eq!(drive.json(&["status"])["state"], "unarmed");
    let report = drive.json(&["calibrate"]);
    assert_eq!((report["halls"].as_array().unwrap().len(), report["spacing_deg"].as_u64()), (3, Some(120)));
    assert_eq!(drive.json(&["arm"])["done"], true);
    let turning = drive.json(&["speed", "600rpm", "--seconds", "0.5"]);
    assert!((turning["speed_rad_s"].as_f64().unwrap() - 62.83).abs() < 3.0, "{turning}");
    assert_eq!(drive.json(&["speed", "-60rpm", "--once"])["done"], true);
    assert_eq!(drive.json(&["stop"])["done"], true);
    let status = drive.json(&["status"]);
    assert_eq!(
        (&status["state"], &status["current_a"], &status["fault"]),
        (&"ready".into(), &Value::Null, &Value::Null)
    );
    assert!(drive.json(&["identify"])["resistance_ohm"]["value"].is_number());
    assert!(drive.json(&["cogging", "learn"])["rms_a"].is_number());
    assert_eq!(drive.json(&["cogging", "off"])["done"], true);
    assert_eq!(drive.json(&["commutation", "block"])["done"], true);
    assert_eq!(drive.json(&["settings", "get", "commutation"])["value"], "block");
    assert_eq!(drive.json(&["settings", "set", "max_current_a", "2.5"])["value"], 2.5);
    assert_eq!(drive.json(&["settings", "save"])["saved"], true);
    assert_eq!(drive.json(&["settings", "load"])["done"], true);
    assert_eq!(drive.json(&["settings", "accept"])["done"], true);
    assert!(drive.json(&["settings", "list"]).as_array().unwrap().len() > 40);
    assert_eq!(drive.json(&["settings", "reset"])["done"], true);
    assert_eq!(drive.json(&["faults"])["total"], 0);
    let frames = drive.ok(&["--json", "telemetry", "--seconds", "0.2", "--halls"]);
    let frames: Vec<Value> = frames.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(
        frames.len() > 10 && frames[0]["hall_1"].is_number() && frames[0]["current_q_a"].is_null(),
        "{}",
        frames[0]
    );
    // What goes wrong is told, too.
    let refused = drive.call(&["--json", "speed", "1"]);
    assert_eq!(refused.status.code(), Some(6));
    let refused: Value = serde_json::from_slice(&refused.stdout).unwrap();
    assert_eq!((&refused["error"]["code"], &refused["error"]["kind"]), (&6.into(), &"refused".into()));
    for alone in [&["list"][..], &["config"]] {
        serde_json::from_slice::<Value>(&call("", &[&["--json"], alone].concat()).stdout).unwrap();
    }
}

#[test]
fn a_step_and_a_sine_are_measured() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let step = drive.json(&["step", "speed", "50rad/s", "--from", "20"]);
    let of = |value: &Value, name: &str| value[name].as_f64().unwrap_or_else(|| panic!("{step}"));
    assert_eq!((of(&step, "from"), of(&step, "to")), (20.0, 70.0));
    assert!(of(&step["measured"], "error").abs() < 1.0 && of(&step["measured"], "overshoot_pct") < 20.0, "{step}");
    assert!(of(&step["measured"], "rise_s") < 0.02 && of(&step["trajectory"], "rise_s") > 0.0, "{step}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("step.html");
    let path = file.to_str().unwrap();
    let table = drive.ok(&["step", "position", "90deg", "--seconds", "1", "--plot", path, "--csv", "-"]);
    assert!(table.contains("settled within 5 %") && table.contains("time_s,set_point,measured"), "{table}");
    assert!(std::fs::read_to_string(&file).unwrap().contains("<svg"));
    // It is left as it was found.
    assert!(drive.ok(&["status"]).contains("bridge off"));
    let sine = drive.json(&["sine", "speed", "20", "--from", "40", "--frequency", "1,2"]);
    for at in 0..2 {
        let sine = &sine["sines"][at];
        assert!(
            (sine["gain"].as_f64().unwrap() - 1.0).abs() < 0.1 && sine["phase_deg"].as_f64().unwrap().abs() < 30.0,
            "{sine}"
        );
    }
    assert!(drive.fails(6, &["step", "speed", "100000"]).contains("beyond"));
    assert!(drive.ok(&["status"]).contains("bridge off"));
}

#[test]
fn lists_fit_a_terminal() {
    let drive = Drive::start(&[]);
    for command in [&["settings", "list"][..], &["settings", "list", "--about"], &["status"], &["faults"]] {
        for line in drive.ok(command).lines() {
            assert!(line.chars().count() <= 80, "{command:?}: {line}");
        }
    }
}

#[test]
fn settings_travel_through_standard_streams() {
    let drive = Drive::start(&[]);
    drive.ok(&["settings", "set", "stall_s", "0.7"]);
    let file = drive.ok(&["settings", "export", "-"]);
    assert!(file.contains("stall_s = 0.7\n"), "{file}");
    drive.ok(&["settings", "reset"]);
    let import = |text: &str| {
        let mut tool = spawn(&drive.port, &["settings", "import", "-"]);
        tool.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        tool.wait_with_output().unwrap()
    };
    assert!(import(&file).status.success());
    assert!(drive.ok(&["settings", "get", "stall_s"]).contains("stall_s = 0.7 s"));
    let unknown = import("stall_s = 0.6\nno_such_setting = 1\n");
    let said = String::from_utf8(unknown.stderr).unwrap();
    assert!(unknown.status.code() == Some(6) && said.contains("no_such_setting: "), "{said}");
    // Nothing was set by halves.
    assert!(drive.ok(&["settings", "get", "stall_s"]).contains("0.7"));
    assert!(drive.fails(6, &["settings", "set", "stall_s", "1e99"]).contains("1e99"));
    // What is left of a file that was cut short.
    let within = file.find("stall_s = 0.7").unwrap() + "stall_s = 0.".len();
    let cut = [("", "there is no setting in -"), ("# Settings of", "there is no setting in -")]
        .into_iter()
        .chain([&file[..within], file.trim_end().trim_end_matches('.')].map(|text| (text, "- has been cut")));
    for (text, words) in cut {
        let refused = import(text);
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(refused.status.code() == Some(1) && said.contains(words), "{text}: {said}");
        assert!(drive.ok(&["settings", "get", "stall_s"]).contains("stall_s = 0.7 s"));
    }
    // Who writes a file by hand needs no such line; who adds to an exported one, as an editor on Windows does, neither.
    assert!(import("stall_s = 0.8").status.success());
    let added = file.replace("stall_s = 0.7\n", "").replace('\n', "\r\n") + "stall_s = 0.9";
    assert!(import(&added).status.success());
    assert!(drive.ok(&["settings", "get", "stall_s"]).contains("stall_s = 0.9 s"));
}

#[test]
fn a_full_output_is_an_error_in_words() {
    let drive = Drive::start(&[]);
    for command in
        [&["status"][..], &["settings", "list"], &["faults"], &["completions", "bash"], &["settings", "export", "-"]]
    {
        let output = Command::new(HALLCTL)
            .args(["--port", &drive.port])
            .args(command)
            .envs([PATIENCE])
            .stdin(Stdio::null())
            .stdout(File::options().write(true).open("/dev/full").unwrap())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{command:?}: {said}");
        assert!(said.starts_with("hallctl: cannot write"), "{command:?}: {said}");
    }
}

#[test]
fn a_lost_port_and_a_wrong_value_have_the_codes_of_the_help() {
    let mut drive = Drive::start(&["--log"]);
    assert!(drive.fails(6, &["settings", "set", "max_current_a", "2A"]).contains("takes a number, not 2A"));
    assert!(drive.fails(6, &["settings", "set", "commutation", "7"]).contains("field-oriented, not 7"));
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let turning = spawn(&drive.port, &["speed", "20"]);
    drive.log_until("Speed(20.0)");
    // As if its cable were pulled.
    drop(drive);
    let output = turning.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(3) && said.contains("is lost"), "{said}");
}

#[test]
fn what_is_refused_is_named_as_it_was_typed() {
    let drive = Drive::start(&[]);
    assert!(drive.fails(6, &["clear"]).contains("there is no fault to clear"));
    drive.ok(&["settings", "set", "calibration_current_a", "0.5"]);
    let said = drive.fails(6, &["settings", "set", "max_current_a", "0.25"]);
    assert!(said.contains("max_current_a limits calibration_current_a: ") && said.contains("would be 0.5"), "{said}");
    assert!(said.contains("Set calibration_current_a first."), "{said}");
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    assert!(drive.fails(6, &["clear"]).contains("there is no fault to clear"));
    for (option, value) in [("--kp", "-1"), ("--kp", "nan"), ("--kd", "-1"), ("--max-torque", "-1")] {
        let said = drive.fails(6, &["impedance", "0", &format!("{option}={value}"), "--once"]);
        assert!(said.contains("must be 0 or more") && !said.contains("unstable"), "{said}");
    }
    // With its unit, and what limits it.
    for (demand, said) in [
        (
            &["--speed-unit", "rpm", "speed", "10000"][..],
            "1047.2 rad/s is beyond ±500 rad/s, which max_speed_rad_s allows",
        ),
        (&["torque", "9"], "a torque of 9 Nm is beyond ±0.09 Nm, which max_current_a allows"),
        (&["voltage", "1.2"], "a voltage of 1.2 is beyond ±1, which max_modulation allows"),
        (&["position", "1e9"], "turns, which is as far as the drive counts"),
        (&["impedance", "--within", "400", "410", "--kp", "0.01"], "`hallctl position` first"),
    ] {
        let text = drive.fails(6, &[demand, &["--once"]].concat());
        assert!(text.contains(said), "{demand:?}: {text}");
    }
    // What does nothing has no rise, gain or bandwidth.
    for nothing in [&["step", "speed", "0"][..], &["sine", "position", "0"], &["tune", "--step", "0"]] {
        assert!(drive.fails(2, nothing).contains("a size other than 0 is wanted"));
    }
    for step in ["1e-9", "-1e9"] {
        let said = drive.fails(6, &["tune", &format!("--step={step}")]);
        assert!(said.contains("must be 5 to 500 rad/s") && !said.contains("motor steps"), "{said}");
    }
    // Of infinity it would be said that it must be 0 or more.
    for value in ["1e99", "inf"] {
        let said = drive.fails(2, &["impedance", "0", "--kp", value, "--once"]);
        assert!(said.contains(&format!("{value} is beyond what a drive can be told")), "{said}");
    }
}

#[test]
fn the_exit_codes_are_documented_and_pages_are_written() {
    let help = String::from_utf8(call("", &["--help"]).stdout).unwrap();
    for code in ["0 done", "1 files", "2 wrong", "3 no port", "4 no answer", "5 another", "6 refused", "7 begun", "130"]
    {
        assert!(help.contains(code), "{code}: {help}");
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(call("", &["man", folder.path().to_str().unwrap()]).status.success());
    let page = std::fs::read_to_string(folder.path().join("hallctl-speed.1")).unwrap();
    assert!(page.contains("1000rpm"), "{page}");
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let script = String::from_utf8(call("", &["completions", shell]).stdout).unwrap();
        assert!(script.contains("hallctl"), "{shell}");
    }
}

#[test]
fn a_position_that_nobody_has_counted_is_called_lost() {
    let mut drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    drive.ok(&["speed", "50", "--seconds", "0.3"]);
    assert!(drive.json(&["status"])["position_turns"].is_number());
    // Also as the options have it.
    assert_eq!(drive.typed("hall-open"), "hall-open: done\n");
    drive.typed("mend");
    assert_eq!(drive.typed("hall 1 open"), "hall 1 open: done\n");
    assert!(drive.fails(6, &["speed", "50"]).contains("then `hallctl clear`; after a repair, `hallctl calibrate`"));
    assert!(drive.ok(&["status"]).contains("lost: the Halls give no angle"));
    assert!(drive.json(&["status"])["position_turns"].is_null());
    // What the advice says works, in its order.
    drive.typed("mend");
    drive.ok(&["clear"]);
    drive.ok(&["calibrate"]);
    assert!(drive.ok(&["status"]).contains("turns before the fault at"));
    drive.ok(&["arm"]);
    drive.ok(&["speed", "50", "--seconds", "0.2"]);
}

#[test]
fn a_bandwidth_is_proposed_and_kept_only_if_asked_to() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let before = drive.json(&["settings", "get", "speed_bandwidth_hz"])["value"].clone();
    let tuned = drive.json(&["tune"]);
    let trials = tuned["trials"].as_array().unwrap();
    assert!(trials.len() >= 3 && tuned["kept"] == false, "{tuned}");
    let proposed = tuned["proposed_hz"].as_f64().unwrap_or_else(|| panic!("{tuned}"));
    assert!(trials.iter().any(|trial| trial["bandwidth_hz"].as_f64() == Some(proposed)), "{tuned}");
    assert_eq!(drive.json(&["settings", "get", "speed_bandwidth_hz"])["value"], before);
    let table = drive.ok(&["tune", "--keep"]);
    assert!(table.contains("proposed") && table.contains("speed_bandwidth_hz is"), "{table}");
    assert!(drive.ok(&["status"]).contains("bridge off"));
}

/// A load that is stronger than the motor drives it beyond its largest speed: nobody but a person clears that.
#[test]
fn tuning_arms_no_rotor_that_something_else_drives() {
    let drive = Drive::start(&["--fault", "load-0.2Nm@1.5s"]);
    drive.ok(&["calibrate"]);
    let said = drive.fails(7, &["tune"]);
    assert!(said.contains("the rotor turned faster than allowed") && said.contains("hallctl clear"), "{said}");
    assert!(drive.ok(&["status"]).contains("faulted: the rotor turned faster than allowed"));
}

/// Whoever does not wait at all would find every drive silent.
#[test]
fn no_patience_is_a_wrong_command_line() {
    let drive = Drive::start(&[]);
    assert!(drive.fails(2, &["--patience", "0", "status"]).contains("--patience"));
    drive.ok(&["--patience", "60", "status"]);
}

/// 6 is what was never begun, 7 what came to nothing.
#[test]
fn a_drive_without_an_encoder_refuses_what_needs_one() {
    let drive = Drive::start(&[]);
    for what in ["status", "calibrate", "zero"] {
        assert!(drive.fails(6, &["encoder", what]).contains("no encoder"), "{what}");
    }
}

#[test]
fn a_calibration_that_fails_says_what_comes_next() {
    let mut drive = Drive::start(&[]);
    drive.typed("hall 2 open");
    let said = drive.fails(7, &["calibrate"]);
    assert!(said.contains("Hall 2 sees no magnet turning") && said.contains("`hallctl clear`"), "{said}");
    let drive = Drive::start(&["--encoder", "37/45", "--fault", "hall-2-open@1s"]);
    drive.ok(&["calibrate"]);
    let said = drive.fails(7, &["encoder", "calibrate"]);
    assert!(said.contains("Hall 2 is at the end") && said.contains("`hallctl clear`"), "{said}");
}

/// What `--speed-unit` says of numbers without a unit holds for those of a trigger, too.
#[test]
fn a_trigger_has_the_unit_that_was_chosen() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let first = |unit: &str, of: &str, trigger: &str, name: &str| {
        // The command holds for a second; then the motor comes to rest.
        drive.ok(&["speed", "50", "--once"]);
        let options = ["--before", "0.001", "--seconds", "0.1"];
        let frames = drive.ok(&[&["--json", unit, of, "telemetry", "--trigger", trigger], &options[..]].concat());
        let line = frames.lines().next().unwrap_or_else(|| panic!("{trigger}: {frames}"));
        serde_json::from_str::<Value>(line).unwrap()[name].as_f64().unwrap()
    };
    let speed = first("--speed-unit", "rpm", "speed<200", "speed_rad_s");
    assert!(speed < 21.0, "{speed}");
    let speed = first("--speed-unit", "rpm", "speed<20rad/s", "speed_rad_s");
    assert!(speed < 20.0, "{speed}");
    let turns = drive.json(&["status"])["position_turns"].as_f64().unwrap();
    let trigger = format!("position>{}", 360.0 * (turns + 2.0));
    let fired = first("--position-unit", "deg", &trigger, "position_turns");
    assert!(fired > turns + 2.0 && fired < turns + 4.0, "{turns} {fired}");
    // It crosses 21 rad/s on its way to rest, and no 200.
    drive.ok(&["speed", "50", "--once"]);
    let record = ["record", "--trigger", "speed<200", "--rows", "8", "--seconds", "5"];
    drive.ok(&[&["--speed-unit", "rpm"], &record[..]].concat());
}

#[test]
fn a_recording_waits_for_what_it_is_told_to() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    drive.ok(&["speed", "50", "--once"]);
    // The command holds for a second.
    let trigger = ["--json", "telemetry", "--trigger", "speed<40", "--before", "0.1", "--seconds", "0.1"];
    let frames = drive.ok(&trigger);
    let speeds: Vec<_> = frames
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["speed_rad_s"].as_f64().unwrap())
        .collect();
    let fired = speeds.iter().position(|speed| *speed < 40.0).unwrap();
    assert!((8..=12).contains(&fired), "{speeds:?}");
    assert!((fired + 8..fired + 40).contains(&speeds.len()), "{speeds:?}");
    assert!(drive.fails(2, &["telemetry", "--trigger", "speed"]).contains("speed>50"));
}

#[test]
fn a_wrong_command_line_has_its_own_exit_code() {
    for wrong in [
        &["simulate", "--listen", "here"][..],
        &["simulate", "--listen", "tcp:127.0.0.1"],
        &["simulate", "--fault", "hall-open"],
        &["simulate", "--fault", "dance@1s"],
        &["record", "-o", "diagram.png"],
        &["chirp", "speed", "-o", "diagram.HTML"],
    ] {
        let output = call("", wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_refused_setting_is_named() {
    let drive = Drive::start(&[]);
    let said = drive.fails(6, &["settings", "set", "pole_pairs", "4.5"]);
    assert!(said.contains("refused: pole_pairs: this setting takes whole numbers"), "{said}");
    let said = drive.fails(6, &["settings", "set", "pole_pairs", "300"]);
    assert!(said.contains("refused: pole_pairs would be 300"), "{said}");
}

/// What the first saves later would be lost by the second, and the other way round.
#[test]
fn two_drives_do_not_share_a_flash() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let drive = Drive::with_flash(&flash, &[]);
    let output = call("", &["simulate", "--flash", flash.to_str().unwrap(), "--listen", "tcp:127.0.0.1:0"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("is in use by a simulated drive"), "{said}");
    // The same chip after power-up, and no other.
    let serial = |drive: &Drive| {
        let said = drive.ok(&["--json", "status"]);
        let status: Value = serde_json::from_str(&said).unwrap();
        let serial = status["serial_number"].as_str().unwrap().to_owned();
        assert!(serial.len() == 24 && drive.ok(&["status"]).contains(&serial), "{said}");
        serial
    };
    let before = serial(&drive);
    drop(drive);
    assert_eq!(serial(&Drive::with_flash(&flash, &[])), before);
    assert_ne!(serial(&Drive::with_flash(&folder.path().join("another"), &[])), before);
}

#[test]
fn a_motor_is_stopped_though_the_file_with_defaults_is_broken() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("hallctl")).unwrap();
    std::fs::write(folder.path().join("hallctl/config.toml"), "speed_unit = 3").unwrap();
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let code = |arguments: &[&str]| {
        let mut tool = Command::new(HALLCTL);
        tool.args(arguments).env("XDG_CONFIG_HOME", folder.path()).envs([PATIENCE]).env_remove("HALLCTL_PORT");
        tool.output().unwrap().status.code()
    };
    assert_eq!(code(&["--port", &drive.port, "status"]), Some(1));
    // Whose motor it would be is not known.
    assert_eq!(code(&["stop"]), Some(1));
    assert!(drive.ok(&["status"]).contains("bridge on"));
    assert_eq!(code(&["--port", &drive.port, "stop"]), Some(0));
    assert!(drive.ok(&["status"]).contains("bridge off"));
}

/// The flash does not hold a setting that was only set; what was learnt has nothing to do with it.
#[test]
fn what_waits_to_be_saved_is_named() {
    let drive = Drive::start(&[]);
    assert!(!drive.ok(&["status"]).contains("does not hold all"));
    drive.ok(&["settings", "set", "stall_s", "0.7"]);
    let said = drive.ok(&["status"]);
    assert!(said.contains("settings wait for `hallctl settings save`") && !said.contains("learnt"), "{said}");
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let said = drive.ok(&["status"]);
    assert!(said.contains("for the bridge to be off"), "{said}");
    drive.ok(&["stop"]);
    drive.ok(&["settings", "save"]);
    drive.ok(&["settings", "save"]);
    let said = drive.ok(&["status"]);
    assert!(!said.contains("does not hold all"), "{said}");
}

/// A calibration that failed and was followed by another is no work for anybody.
#[test]
fn a_fault_that_is_over_asks_for_nothing() {
    let drive = Drive::start(&["--motor", "direct-drive"]);
    drive.ok(&["settings", "set", "calibration_hz", "20"]);
    drive.fails(7, &["calibrate"]);
    let said = drive.ok(&["faults"]);
    assert!(said.contains("mend what the calibration named") && !said.contains("over"), "{said}");
    drive.ok(&["clear"]);
    drive.ok(&["settings", "set", "calibration_hz", "2"]);
    drive.ok(&["calibrate"]);
    let said = drive.ok(&["faults"]);
    assert!(!said.contains("mend what") && said.contains("calibrated since") && said.contains("commission"), "{said}");
    let told = drive.json(&["faults"]);
    assert!(told["incidents"][0]["advice"].as_str().unwrap().contains("calibrated since"), "{told}");
}
