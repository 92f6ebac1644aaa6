//! `hallctl` at `hallctl simulate`: every command that a person has, over TCP and over a pseudo-terminal.

use crate::process::{Drive, call, fails, spawn};
use hallservo_protocol::VERSION;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::thread;
use std::time::Duration;
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Everything that a first evening with a drive has.
fn evening(options: &[&str]) {
    let folder = folder();
    let file = |name: &str| folder.path().join(name);
    let flash = file("flash.bin");
    let drive = Drive::with_flash(&flash, &[options, &["--fault", "hall-open@4s"]].concat());

    assert!(drive.ok(&["status"]).contains("unarmed: bridge off, not calibrated"));
    assert!(drive.fails(6, &["arm"]).contains("`hallctl calibrate` first"));
    let report = drive.ok(&["calibrate"]);
    assert!(report.contains("Calibrated.") && report.contains("120° apart"), "{report}");
    drive.ok(&["arm"]);
    let turning = drive.ok(&["speed", "100", "--seconds", "0.5"]);
    let speed: f64 = turning.split(' ').next().unwrap().parse().unwrap();
    assert!((speed - 100.0).abs() < 3.0, "{turning}");

    // Telemetry of a motor that is told once, and stops a second later by itself.
    drive.ok(&["speed", "50", "--once"]);
    let (csv, html) = (file("t.csv"), file("t.html"));
    let paths = [csv.to_str().unwrap(), html.to_str().unwrap()];
    drive.ok(&["telemetry", "--seconds", "1.2", "--hz", "500", "--csv", paths[0], "--plot", paths[1]]);
    let mut rows = csv::Reader::from_path(&csv).unwrap();
    let column = |name: &str| rows.headers().unwrap().iter().position(|head| head == name).unwrap();
    let [time, speed, lost] = ["time_s", "speed_rad_s", "lost"].map(column);
    let rows: Vec<_> = rows.records().map(Result::unwrap).collect();
    let number = |row: &csv::StringRecord, place: usize| row[place].parse::<f64>().unwrap();
    assert!((500..700).contains(&rows.len()), "{}", rows.len());
    assert!(rows.iter().all(|row| number(row, lost) == 0.0));
    assert!(number(&rows[rows.len() - 1], time) > 1.0);
    assert!(rows.iter().any(|row| (number(row, speed) - 50.0).abs() < 3.0));
    assert!(number(&rows[rows.len() - 1], speed).abs() < 3.0);
    assert!(fs::read_to_string(html).unwrap().contains("<svg"));
    assert!(drive.ok(&["status"]).contains("stopped: no command came for too long"));

    // The Hall breaks while the position is held.
    let fallen = drive.fails(7, &["position", "2.5", "--seconds", "5"]);
    assert!(fallen.contains("Hall 1 is at the end of the ADC's range"), "{fallen}");
    let history = drive.ok(&["faults"]);
    assert!(
        history.contains("running)  Hall 1 is at the end") && history.contains("→ check that Hall's supply"),
        "{history}"
    );
    assert!(drive.ok(&["status"]).contains("faulted"));
    drive.ok(&["clear"]);

    drive.ok(&["settings", "set", "max_current_a", "2.5"]);
    assert!(drive.fails(6, &["settings", "set", "max_current_a", "99"]).contains("the board's ceiling is 6"));
    assert!(drive.fails(6, &["settings", "set", "stall_s", "99"]).contains("must be from 0.01 to 5"));
    // No bandwidth goes with it: a range from nothing to nothing would tell little.
    let refused = drive.fails(6, &["settings", "set", "flux_linkage_wb", "10"]);
    assert!(refused.contains("beyond the integers") && refused.contains("flux_linkage_wb"), "{refused}");
    assert!(drive.fails(6, &["settings", "set", "adc_bits", "16"]).contains("follows from the board's parts"));
    assert_eq!(drive.ok(&["settings", "save"]), "saved\n");
    drop(drive);

    // The same flash, another power-up.
    let drive = Drive::with_flash(&flash, options);
    assert!(drive.ok(&["settings", "get", "max_current_a"]).contains("max_current_a = 2.5 A"));
    assert!(drive.ok(&["status"]).contains("ready: bridge off, calibrated"));
    drive.ok(&["arm"]);
    drive.ok(&["position", "2.5", "--seconds", "1"]);
    let status = drive.ok(&["status"]);
    let position = status.lines().find_map(|line| line.trim().strip_prefix("position")?.trim().strip_suffix(" turns"));
    let position: f64 = position.unwrap().parse().unwrap();
    assert!(status.contains("running: bridge on") && (position - 2.5).abs() < 1e-3, "{status}");
    drive.ok(&["disarm"]);
}

#[test]
fn pole_pairs_are_counted_by_a_turn_of_the_hand() {
    let mut drive = Drive::start(&[]);
    let said = drive.fails(7, &["pole-pairs"]);
    assert!(said.contains("the drive must be calibrated") && said.contains("`hallctl calibrate` first"), "{said}");
    drive.ok(&["calibrate"]);
    // It has four.
    drive.ok(&["settings", "set", "pole_pairs", "7"]);
    let mut count = |turns: &str, asked: &str| {
        let mut tool = spawn(&drive.port, &["pole-pairs", "--turns", asked]);
        let mut out = BufReader::new(tool.stdout.take().unwrap());
        out.read_line(&mut String::new()).unwrap();
        drive.hand(turns);
        tool.stdin.take().unwrap().write_all(b"\n").unwrap();
        let mut text = String::new();
        out.read_to_string(&mut text).unwrap();
        let ended = tool.wait_with_output().unwrap();
        (ended.status.code(), text + &String::from_utf8(ended.stderr).unwrap())
    };
    let (code, text) = count("1.3", "1");
    assert!(code == Some(7) && text.contains("not told apart"), "{text}");
    let (code, text) = count("-2.005", "2");
    assert_eq!(code, Some(0), "{text}");
    // 0.005 turns are 1.8°. Either end is uncertain by 0.4° at most of four pole pairs' noise, and let go, the shaft
    // may slip to a tooth.
    let off_deg =
        text.strip_prefix("4 pole pairs: the shaft was ").and_then(|rest| rest.split_once("° off")?.0.parse().ok());
    assert!(off_deg.is_some_and(|off_deg: f64| (off_deg - 1.8).abs() <= 1.0), "{text}");
    assert!(drive.ok(&["settings", "get", "pole_pairs"]).contains("pole_pairs = 4"));
    // Nobody at the keyboard.
    assert!(drive.fails(7, &["pole-pairs"]).contains("nobody pressed Enter"));
}

#[test]
fn an_evening_over_tcp() {
    evening(&[]);
}

#[test]
fn an_evening_over_a_pseudo_terminal() {
    evening(&["--pty"]);
}

#[test]
fn what_a_fast_drive_does_depends_on_no_clock() {
    let telling = |pause| {
        let folder = folder();
        let file = folder.path().join("t.csv");
        let drive = Drive::start(&[]);
        let telemetry = ["telemetry", "--seconds", "0.3", "--hz", "500", "--csv", file.to_str().unwrap()];
        let commands: [&[&str]; 4] = [&["calibrate"], &["arm"], &["speed", "50", "--once"], &telemetry];
        let mut said = String::new();
        for command in commands {
            thread::sleep(pause);
            said += &drive.ok(command);
        }
        said + &drive.ok(&["status"]) + &fs::read_to_string(file).unwrap()
    };
    assert_eq!(telling(Duration::ZERO), telling(Duration::from_millis(100)));
}

#[test]
fn settings_go_into_a_file_and_back() {
    let folder = folder();
    let file = folder.path().join("settings.toml");
    let path = file.to_str().unwrap();
    let drive = Drive::start(&[]);
    drive.ok(&["settings", "set", "commutation", "block"]);
    drive.ok(&["commutation", "sinusoidal"]);
    drive.ok(&["settings", "set", "reversed", "yes"]);
    // In the file, the bandwidth of the speed comes after the one that limits it, and that has to fall first.
    drive.ok(&["settings", "set", "position_bandwidth_hz", "2"]);
    drive.ok(&["settings", "set", "speed_bandwidth_hz", "8"]);
    drive.ok(&["settings", "set", "current_bandwidth_hz", "40"]);
    drive.ok(&["settings", "export", path]);
    drive.ok(&["settings", "reset"]);
    let list = drive.ok(&["settings", "list"]);
    assert!(!list.lines().any(|line| line.starts_with("* ") && !line.contains("differs")), "{list}");
    drive.ok(&["settings", "import", path]);
    let list = drive.ok(&["settings", "list"]);
    let changed = list.lines().filter(|line| line.starts_with("* ") && !line.contains("differs")).count();
    assert_eq!(changed, 5, "{list}");
    assert!(list.contains("* commutation                  sinusoidal"), "{list}");
    assert!(drive.fails(6, &["settings", "load"]).contains("none stored"));

    fs::write(&file, "stall_s = 0.7\nno_such_setting = 1\n").unwrap();
    assert!(drive.fails(6, &["settings", "import", path]).contains("no such setting"));
    fs::write(&file, "reversed = \"perhaps\"\n").unwrap();
    assert!(drive.fails(6, &["settings", "import", path]).contains("takes yes or no"));
}

#[test]
fn what_turns_by_whole_turns_is_refused_where_the_shaft_has_bounds() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let journal = folder.path().join("commission.toml");
    drive.ok(&["settings", "set", "max_position_turns", "0.5"]);
    let commission = ["commission", "--max-current", "2", "--yes", "--file", journal.to_str().unwrap()];
    for command in [&["calibrate"][..], &["identify"], &["cogging", "learn"], &["magnets", "learn"], &commission] {
        let why = drive.fails(6, command);
        assert!(why.contains("max_position_turns is 0.5") && why.contains("1e6"), "{command:?}: {why}");
    }
    drive.ok(&["settings", "set", "max_position_turns", "1e6"]);
    drive.ok(&["calibrate"]);
}

/// What TOML says of a word without quotation marks is that it is no number.
#[test]
fn a_value_that_is_no_toml_is_named_with_its_line_and_what_is_expected() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let file = folder.path().join("settings.toml");
    for (text, words) in [
        ("stall_s = 0.7\nreversed = no\n", ["line 2", "reversed", "true or false"]),
        ("# by hand\n\ncommutation = block\n", ["line 3", "commutation", "\"block\""]),
        ("pole_pairs = many\n", ["line 1", "pole_pairs", "a number"]),
        ("nonsense = many\n", ["line 1", "nonsense", "no such setting"]),
    ] {
        fs::write(&file, text).unwrap();
        let said = drive.fails(1, &["settings", "import", file.to_str().unwrap()]);
        assert!(words.iter().all(|word| said.contains(word)) && !said.contains("nan"), "{text}: {said}");
    }
}

/// Of another drive, perhaps: what it was set up for is another motor then.
#[test]
fn an_import_says_which_settings_of_the_motor_it_changes() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let file = folder.path().join("settings.toml");
    let path = file.to_str().unwrap();
    drive.ok(&["settings", "export", path]);
    let exported = fs::read_to_string(&file).unwrap();
    let head: Vec<_> = exported.lines().take(2).collect();
    assert!(head[0].contains("simulated") && head[1].starts_with("# Exported 2") && head[1].contains(&drive.port));
    fs::write(&file, "pole_pairs = 7\nflux_linkage_wb = 0.002\nstall_s = 0.7\n").unwrap();
    // Nobody has set it up yet.
    assert!(!drive.ok(&["settings", "import", path]).contains("pole_pairs"));
    drive.ok(&["settings", "reset"]);
    drive.ok(&["calibrate"]);
    let said = drive.ok(&["settings", "import", path]);
    for part in ["calibrated", "pole_pairs from 4 to 7", "flux_linkage_wb from 0.005 to 0.002 Wb"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!said.contains("stall_s") && !said.contains("resistance_ohm"), "{said}");
    // The same once more changes nothing.
    let said = drive.ok(&["settings", "import", path]);
    assert!(!said.contains("pole_pairs") && said.contains("3 settings set"), "{said}");
    let told: serde_json::Value = serde_json::from_str(&{
        fs::write(&file, exported).unwrap();
        drive.ok(&["--json", "settings", "import", path])
    })
    .unwrap();
    assert_eq!(told["motor"][0], serde_json::json!({ "name": "pole_pairs", "from": 7.0, "to": 4.0 }), "{told}");
}

#[test]
fn a_refused_import_changes_no_setting() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let file = folder.path().join("settings.toml");
    let path = file.to_str().unwrap();
    // But for when.
    let exported = || {
        let text = drive.ok(&["settings", "export", "-"]);
        text.lines().filter(|line| !line.starts_with("# Exported ")).collect::<Vec<_>>().join("\n")
    };
    let before = exported();
    // Each has something that could be set before what is refused: by the drive, by its name, as the board's.
    for (text, why) in [
        ("max_current_a = 2.5\npole_pairs = 99\n", "pole_pairs would be 99"),
        // Its bandwidths are set in another order than they stand there.
        (
            "current_bandwidth_hz = 40\nposition_bandwidth_hz = 2\nspeed_bandwidth_hz = 8\nstall_s = -1\n",
            "stall_s would be",
        ),
        ("max_current_a = 2.5\nno_such_setting = 1\n", "no such setting"),
        ("max_current_a = 2.5\ntimer_hz = 1e8\n", "timer_hz: this setting follows from the board's parts"),
        ("max_current_a = 2.5\npole_pairs = \"many\"\n", "pole_pairs: it takes a number, not many"),
    ] {
        fs::write(&file, text).unwrap();
        let said = drive.fails(6, &["settings", "import", path]);
        assert!(said.contains(why), "{text}: {said}");
        assert_eq!(exported(), before, "{text}: {said}");
        assert!(!why.contains("would be") || said.contains("No setting is changed"), "{said}");
        let name = why.split([' ', ':']).next().unwrap();
        assert!(!why.contains("would be") || said.matches(name).count() == 1, "{said}");
    }
}

#[test]
fn a_motor_is_commissioned_by_its_current_limit() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let file = folder.path().join("commission.toml");
    // Settings that fit another motor.
    for (name, value) in [("resistance_ohm", "1"), ("flux_linkage_wb", "2e-3"), ("inertia_kgm2", "1e-4")] {
        drive.ok(&["settings", "set", name, value]);
    }
    assert!(drive.fails(6, &["commission", "--max-current", "100"]).contains("max_current_a"));
    let file = file.to_str().unwrap();
    let told = drive.ok(&["commission", "--yes", "--max-current", "2.5", "--pole-pairs", "4", "--file", file]);
    for part in ["1 of 6: R and L", "Calibrated at 10 Hz", "saved", "resistance       3.7", "inductance     0.3"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(!told.contains("pole-pairs"), "{told}");
    assert!(drive.ok(&["settings", "get", "max_current_a"]).contains("2.5"));
    drive.ok(&["arm"]);
    assert!(drive.ok(&["speed", "100", "--seconds", "1"]).contains("rad/s"));
}

#[test]
fn the_motor_is_measured_and_its_cogging_learnt() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let motor = drive.ok(&["identify"]);
    assert!(motor.contains("resistance") && motor.contains("inertia_kgm2"), "{motor}");
    assert!(drive.ok(&["cogging", "learn"]).contains("A RMS"));
    assert!(drive.ok(&["status"]).contains("anti-cogging on"));
    assert!(!drive.ok(&["magnets", "show", "--json"]).contains("\"state\":\"off\""));
    drive.ok(&["cogging", "off"]);
    assert!(drive.ok(&["magnets", "show", "--json"]).contains("\"state\":\"off\""));
    assert!(!drive.ok(&["status"]).contains("anti-cogging on"));
    drive.ok(&["arm"]);
    drive.ok(&["torque", "0.01", "--seconds", "0.2"]);
    drive.ok(&["voltage", "-0.2", "--seconds", "0.2"]);
    assert!(drive.fails(2, &["torque", "nan", "--once"]).contains("beyond"));
}

#[test]
fn what_is_no_drive_is_told_apart() {
    assert!(fails("/dev/no-such-port", 3, &["status"]).contains("Is the board plugged in?"));
    // Nobody listens there, and nobody plugs in a network.
    let said = fails("tcp:127.0.0.1:1", 3, &["status"]);
    assert!(said.contains("cannot open") && said.contains("hallctl simulate") && !said.contains("dialout"), "{said}");
    let newer = VERSION + 1;
    let text = fails(&serve(&frame_of_version(newer)), 5, &["status"]);
    let both = text.contains(&format!("version {newer}")) && text.contains(&format!("version {VERSION}"));
    assert!(both && text.contains("Update hallctl"), "{text}");
    let text = fails(&serve(b"\x00hello, I am a modem\x00"), 4, &["--patience", "1", "status"]);
    assert!(text.contains("not the protocol of a hallservo drive"), "{text}");
}

#[test]
fn a_line_that_loses_frames_is_asked_again() {
    // They wait on the wall, so all at once.
    thread::scope(|scope| {
        // The first three are those of every command: who is there, and no telemetry.
        for lost in 1..=3 {
            scope.spawn(move || {
                let drive = Drive::start(&[]);
                // Asked again after a quarter of it.
                let output = call(&lossy(&drive.port, lost), &["--alone", "--patience", "6", "status"]);
                assert!(output.status.success(), "{lost}: {}", String::from_utf8_lossy(&output.stderr));
                assert!(String::from_utf8(output.stdout).unwrap().contains("unarmed"));
            });
        }
        // What may have begun is not begun again. Before it, the bounds of the position are asked for.
        let drive = Drive::start(&[]);
        assert!(fails(&lossy(&drive.port, 5), 4, &["--alone", "--patience", "2", "calibrate"]).contains("no answer"));
        assert!(drive.ok(&["status"]).contains("unarmed: bridge off, not calibrated"));
    });
}

/// A line to a port that loses the `lost`th frame on the way there.
fn lossy(port: &str, lost: usize) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let name = format!("tcp:{}", listener.local_addr().unwrap());
    let there = port.strip_prefix("tcp:").unwrap().to_string();
    thread::spawn(move || {
        let (mut tool, _) = listener.accept().unwrap();
        let mut drive = TcpStream::connect(there).unwrap();
        let (mut back, mut answers) = (tool.try_clone().unwrap(), drive.try_clone().unwrap());
        thread::spawn(move || std::io::copy(&mut answers, &mut back));
        let mut frames = 0;
        let mut byte = [0];
        let mut inside = false;
        while tool.read(&mut byte).is_ok_and(|length| length == 1) {
            frames += usize::from(byte[0] != 0 && !inside);
            inside = byte[0] != 0;
            if frames != lost || !inside {
                drive.write_all(&byte).unwrap();
            }
        }
        let _ = drive.shutdown(Shutdown::Both);
    });
    name
}

/// Says the same to everyone, and nothing more.
fn serve(bytes: &[u8]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    let bytes = bytes.to_vec();
    thread::spawn(move || {
        let mut kept = Vec::new();
        for mut stream in listener.incoming().flatten() {
            let _ = stream.write_all(&bytes);
            kept.push(stream);
        }
    });
    port
}

/// As a drive of another version would send it.
fn frame_of_version(version: u8) -> Vec<u8> {
    let inside = [version, 1, 0];
    let checksum = !inside.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
    });
    let inside = [&inside[..], &checksum.to_le_bytes()].concat();
    // COBS: the distance to the next zero in the place of each.
    let mut frame = vec![0, 0];
    let mut mark = 1;
    for byte in inside {
        if byte == 0 {
            frame[mark] = (frame.len() - mark) as u8;
            mark = frame.len();
        }
        frame.push(byte);
    }
    frame[mark] = (frame.len() - mark) as u8;
    frame.push(0);
    frame
}
