//! `hallctl commission`: eleven motors, from a board that knows nothing to a drive that turns; broken off and gone on with.

use crate::process::{Drive, HALLCTL, PATIENCE};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// With its largest current, A.
const MOTORS: [(&str, &str); 11] = [
    ("gimbal-7", "0.3"),
    ("drone-15uh", "15"),
    ("20mohm-32a", "20"),
    ("hub", "15"),
    ("paper", "3"),
    ("20ohm", "0.5"),
    ("slotless", "4"),
    ("paper-heavy", "3"),
    ("direct-drive", "4"),
    ("22-pairs", "30"),
    ("drone-heavy", "15"),
];

fn tool(drive: &Drive, folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(HALLCTL);
    command.args(["--port", &drive.port]).args(arguments).envs([PATIENCE]).current_dir(folder).stdin(Stdio::null());
    command
}

fn commission(drive: &Drive, folder: &TempDir, arguments: &[&str]) -> (Option<i32>, String) {
    let output: Output = tool(drive, folder.path(), &[&["commission", "--yes"], arguments].concat()).output().unwrap();
    let mut said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    if output.status.code() == Some(3) {
        said += &drive.fate();
    }
    (output.status.code(), said)
}

/// A test that fails by a lost drive says which of two processes has ended, and how.
#[test]
fn how_a_drive_has_ended_that_is_lost_is_said() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let mut tool = answering(&drive, &folder, "y\n");
    let mut lines = BufReader::new(tool.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("1 of 6")));
    kill_process(Pid::from_raw(drive.id() as i32).unwrap(), Signal::KILL).unwrap();
    let lost = tool.wait_with_output().unwrap();
    assert_eq!(lost.status.code(), Some(3), "{}", String::from_utf8_lossy(&lost.stderr));
    assert!(drive.fate().contains("signal: 9"), "{}", drive.fate());
    // What has ended cannot be opened either.
    let (code, said) = commission(&drive, &folder, &[]);
    assert!(code == Some(3) && said.contains("signal: 9"), "{said}");
}

/// The same, with an answer instead of `--yes`.
fn answering(drive: &Drive, folder: &TempDir, answer: &str) -> Child {
    let mut tool = tool(drive, folder.path(), &["commission", "--max-current", "2.5", "--pole-pairs", "4"]);
    let mut tool = tool.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    tool.stdin.take().unwrap().write_all(answer.as_bytes()).unwrap();
    tool
}

fn answered(drive: &Drive, folder: &TempDir, answer: &str) -> (Option<i32>, String) {
    let output = answering(drive, folder, answer).wait_with_output().unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (output.status.code(), said)
}

fn is_left(folder: &TempDir) -> bool {
    folder.path().join("commission.toml").exists()
}

/// How the speed is at a tenth of the largest, relative to what is asked for.
fn speed_at_a_tenth(drive: &Drive) -> f64 {
    let most: Value = serde_json::from_str(&drive.ok(&["--json", "settings", "get", "max_speed_rad_s"])).unwrap();
    let asked = most["value"].as_f64().unwrap() / 10.0;
    drive.ok(&["arm"]);
    // Cogging makes it swing.
    let speeds: Vec<f64> = [4.0, 0.3, 0.3, 0.3, 0.3, 0.3]
        .iter()
        .map(|seconds: &f64| {
            let told = drive.ok(&["--json", "speed", &asked.to_string(), "--seconds", &seconds.to_string()]);
            serde_json::from_str::<Value>(&told).unwrap()["speed_rad_s"].as_f64().unwrap()
        })
        .collect();
    drive.ok(&["stop"]);
    speeds.iter().sum::<f64>() / speeds.len() as f64 / asked
}

#[test]
fn eleven_motors_are_commissioned_unattended() {
    let motors: Vec<_> = MOTORS.iter().step_by(sim::of(8, 1)).collect();
    std::thread::scope(|scope| {
        for some in motors.chunks(sim::of(2, 6)) {
            scope.spawn(move || {
                for (k, (motor, limit_a)) in some.iter().enumerate() {
                    // Every other one's Halls see the windings.
                    let coil = ["0", "0.05"][k % 2];
                    let drive = Drive::start(&["--motor", motor, "--coil-field", coil]);
                    let folder = tempfile::tempdir().unwrap();
                    let (code, said) = commission(&drive, &folder, &["--max-current", limit_a]);
                    println!("{motor}: {said}");
                    assert_eq!(code, Some(0), "{motor}: {said}");
                    for step in ["1 of 6: R and L", "2 of 6", "3 of 6", "4 of 6", "5 of 6", "6 of 6: saved"] {
                        assert!(said.contains(step), "{motor}: {step}: {said}");
                    }
                    assert!(!said.contains("stay as computed"), "{motor}: {said}");
                    let set: Value =
                        serde_json::from_str(&drive.ok(&["--json", "settings", "get", "hall_coil_deg_a"])).unwrap();
                    // At the largest current, electrical degrees; 5 % of the magnets' field are 3°.
                    let turned_deg = set["value"].as_f64().unwrap() * limit_a.parse::<f64>().unwrap();
                    let expected = if coil == "0" { -1.5..1.5 } else { 1.0..5.0 };
                    assert!(expected.contains(&turned_deg), "{motor}: {turned_deg}°, {coil}");
                    assert!(!is_left(&folder), "{motor}");
                    assert!(drive.ok(&["status"]).contains("ready: bridge off, calibrated"), "{motor}");
                    let share = speed_at_a_tenth(&drive);
                    assert!((share - 1.0).abs() < 0.1, "{motor}: {share}");
                }
            });
        }
    });
}

/// Motors with their largest current, A, and a load on a shaft that twists: how many times the rotor's inertia it has, and
/// the resonance, Hz.
const TWISTS: [(&str, &str, &str, &str); 7] = [
    // The identification determines nothing, and a position was held with 55 % of the largest current.
    ("22-pairs", "30", "10", "20"),
    // The drive switched off where it held one.
    ("22-pairs", "30", "10", "200"),
    ("drone-15uh", "15", "10", "40"),
    ("paper", "3", "10", "200"),
    ("direct-drive", "4", "3", "40"),
    ("direct-drive", "4", "10", "40"),
    // On a supply that takes nothing back, its swings lifted the bus too high where the motor was measured.
    ("22-pairs", "30", "10", "60"),
];

/// RMS about the mean of the current along q, A, in the last second of a position that is held after a small move.
fn held_a(drive: &Drive, folder: &TempDir) -> f64 {
    drive.ok(&["settings", "set", "command_timeout_s", "60"]);
    drive.ok(&["arm"]);
    let status: Value = serde_json::from_str(&drive.ok(&["--json", "status"])).unwrap();
    let goal = status["position_turns"].as_f64().unwrap() + 0.1;
    drive.ok(&["position", "--once", &goal.to_string()]);
    let file = folder.path().join("held.csv");
    drive.ok(&["telemetry", "--seconds", "3", "--hz", "500", "--csv", file.to_str().unwrap()]);
    assert!(drive.ok(&["status"]).contains("running"), "the drive switched off");
    let text = std::fs::read_to_string(file).unwrap();
    let column = text.lines().next().unwrap().split(',').position(|name| name == "current_q_a").unwrap();
    let currents: Vec<f64> =
        text.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    let last = &currents[2 * currents.len() / 3..];
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    (last.iter().map(|current| (current - mean).powi(2)).sum::<f64>() / last.len() as f64).sqrt()
}

/// The load swings long after each step, which looks like a loop that swings: nothing is proposed then, and bandwidths that
/// were computed for a stiff shaft swing by themselves.
#[test]
fn a_load_on_a_shaft_that_twists_is_held_quietly() {
    std::thread::scope(|scope| {
        for some in TWISTS[..sim::of(1, 7)].chunks(sim::of(1, 4)) {
            scope.spawn(move || {
                for (motor, limit_a, times, hz) in some {
                    let options = ["--seed", "5", "--motor", motor, "--load-inertia", times, "--resonance-hz", hz];
                    let (drive, folder) = (Drive::start(&options), tempfile::tempdir().unwrap());
                    let (code, said) = commission(&drive, &folder, &["--max-current", limit_a]);
                    println!("{motor}: {said}");
                    assert!(code == Some(0) && said.contains("6 of 6: saved"), "{motor}: {said}");
                    let share = held_a(&drive, &folder) / limit_a.parse::<f64>().unwrap();
                    println!("{motor} ×{times}, {hz} Hz: held with {:.1} % of the largest current", 100.0 * share);
                    assert!(share < 0.1, "{motor} ×{times}, {hz} Hz: {share}");
                }
            });
        }
    });
}

#[test]
fn the_motor_turns_only_when_somebody_has_said_yes() {
    let (mut drive, folder) = (Drive::start(&["--log"]), tempfile::tempdir().unwrap());
    for (answer, why) in [("n\n", "nothing more was done"), ("", "nobody has answered"), ("what?\n", "nothing more")] {
        let (code, said) = answered(&drive, &folder, answer);
        assert!(code == Some(6) && said.contains("may it begin?") && said.contains(why), "{answer:?}: {said}");
    }
    // Nothing has been measured, which switches the bridge on and off.
    drive.ok(&["stop"]);
    drive.log_until("Disarm");
    assert!(!drive.log_has("aligning") && !drive.log_has("running") && !is_left(&folder));
    // The short form does not wait until it is through.
    if sim::of(true, false) {
        return drop(begun(answering(&drive, &folder, "y\n")));
    }
    let (code, said) = answered(&drive, &folder, "y\n");
    assert!(code == Some(0) && said.contains("6 of 6: saved"), "{said}");
}

/// A drive whose commissioning comes to nothing in step 3, by a fault at a time of its own clock.
fn broken_off(folder: &TempDir) -> Drive {
    let mut drive = Drive::start(&["--fault", "bus-60V@1s"]);
    let (code, said) = commission(&drive, folder, &["--max-current", "2.5"]);
    assert!(code == Some(7) && said.contains("goes on with this step"), "{said}");
    let known = std::fs::read_to_string(folder.path().join("commission.toml")).unwrap();
    assert!(known.contains("standstill") && known.contains("calibration") && !known.contains("swings"), "{known}");
    // A person has to look first.
    let (code, said) = commission(&drive, folder, &[]);
    assert!(code == Some(7) && said.contains("the drive is faulted"), "{said}");
    assert_eq!(drive.typed("mend"), "mend: done\n");
    drive.ok(&["clear"]);
    drive
}

#[test]
fn it_goes_on_where_it_was_broken_off() {
    let folder = tempfile::tempdir().unwrap();
    let drive = broken_off(&folder);
    let (code, said) = commission(&drive, &folder, &[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("It goes on with step 3"), "{said}");
    assert!(!said.contains("2 of 6") && said.contains("3 of 6") && said.contains("6 of 6: saved"), "{said}");
    assert!(said.contains("at 2.5 A at most") && !is_left(&folder), "{said}");
    // The next one is another.
    if sim::of(false, true) {
        let (_, said) = commission(&drive, &folder, &["--max-current", "2"]);
        assert!(said.contains("1 of 6"), "{said}");
    }
}

/// What a step has failed by is mended by a setting, or by a limit that is lower: neither is undone.
#[test]
fn what_was_set_since_it_was_broken_off_stays() {
    let folder = tempfile::tempdir().unwrap();
    let drive = broken_off(&folder);
    drive.ok(&["settings", "set", "max_regeneration_a", "2"]);
    drive.ok(&["settings", "set", "max_speed_rad_s", "100"]);
    let said = begins(&drive, &folder, &["--max-current", "2.5"]);
    assert!(said.contains("Set since then, and kept: max_regeneration_a, max_speed_rad_s."), "{said}");
    let get = |name| drive.ok(&["settings", "get", name]);
    assert!(get("max_regeneration_a").contains("= 2 A"), "{}", get("max_regeneration_a"));
    assert!(get("max_speed_rad_s").contains("= 100 rad/s"), "{}", get("max_speed_rad_s"));
    // Not told again, the largest current is a setting, too: what was found with another one is not used.
    drive.ok(&["settings", "set", "max_current_a", "1.5"]);
    let said = begins(&drive, &folder, &[]);
    assert!(said.contains("1 of 6") && said.contains("up to 1.5 A"), "{said}");
}

/// The same until it has begun with a step, where a signal ends it: the first of six.
fn begins(drive: &Drive, folder: &TempDir, arguments: &[&str]) -> String {
    let arguments = [&["commission", "--yes"], arguments].concat();
    begun(tool(drive, folder.path(), &arguments).stdout(Stdio::piped()).spawn().unwrap())
}

fn begun(mut tool: Child) -> String {
    let mut lines = BufReader::new(tool.stdout.take().unwrap()).lines().map_while(Result::ok);
    let (mut said, mut begun) = (String::new(), false);
    while !begun {
        let line = lines.next().unwrap_or_else(|| panic!("{said}"));
        begun = line.contains(" of 6");
        said = said + &line + "\n";
    }
    kill_process(Pid::from_child(&tool), Signal::INT).unwrap();
    assert_eq!(tool.wait().unwrap().code(), Some(130), "{said}{:?}", lines.collect::<Vec<_>>());
    said
}

/// The short form goes no further than to the step that it begins with.
#[test]
fn what_is_known_of_another_motor_is_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let drive = broken_off(&folder);
    let file = folder.path().join("commission.toml");
    let left = std::fs::read_to_string(&file).unwrap();
    let said = |drive: &Drive, arguments: &[&str]| {
        std::fs::write(&file, &left).unwrap();
        if sim::of(true, false) {
            return begins(drive, &folder, arguments);
        }
        let (code, said) = commission(drive, &folder, arguments);
        assert_eq!(code, Some(0), "{arguments:?}: {said}");
        said
    };
    let steps = |arguments: &[&str], wanted: &str| {
        let said = said(&drive, arguments);
        assert!(said.contains(wanted), "{arguments:?}: {said}");
    };
    // What is told again is no other motor; another limit is, or it is asked for.
    steps(&["--pole-pairs", "4"], "It goes on with step 3");
    steps(&["--max-current", "2"], "1 of 6");
    steps(&["--restart"], "1 of 6");
    // Another drive, also where it has taken the place of the first at the same port.
    let other = Drive::with_flash(&folder.path().join("flash"), &[]);
    let told = said(&other, &["--max-current", "2.5"]);
    assert!(told.contains("1 of 6"), "{told}");
    std::fs::write(&file, left.replace(&drive.port, &other.port)).unwrap();
    let told = begins(&other, &folder, &["--max-current", "2.5"]);
    assert!(told.contains("1 of 6"), "{told}");
    // A file that is something else is not overwritten.
    std::fs::write(&file, "a letter").unwrap();
    let (code, said) = commission(&other, &folder, &[]);
    assert!(code == Some(7) && said.contains("--restart"), "{said}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "a letter");
}

/// A drive whose winding stands so little for ever, with a housing that cools within a minute.
fn weak_winding(continuous_a: &str) -> Drive {
    let drive = Drive::start(&[]);
    for (name, value) in [("housing_time_s", "60"), ("max_current_a", "3"), ("continuous_current_a", continuous_a)] {
        drive.ok(&["settings", "set", name, value]);
    }
    drive
}

/// The drive's own time.
fn uptime_s(drive: &Drive) -> f64 {
    let status: Value = serde_json::from_str(&drive.ok(&["--json", "status"])).unwrap();
    status["uptime_s"].as_f64().unwrap()
}

const TOO_WARM: &str = "Too warm by the current that has flowed: 20 s of rest, then again.";

/// A winding that is too hot in the middle of the calibration, which is a fault, and one that is before the swings, which
/// is refused: both have cooled after a rest, and the same step is made again.
#[test]
fn what_is_too_warm_is_waited_for() {
    // The short form does not look how long it takes without.
    let usual_s = sim::of(None, Some("1.5")).map(|continuous_a| {
        let long_enough = weak_winding(continuous_a);
        let (code, said) = commission(&long_enough, &tempfile::tempdir().unwrap(), &[]);
        assert!(code == Some(0) && !said.contains(TOO_WARM), "{said}");
        uptime_s(&long_enough)
    });
    let cases = [("0.48", "2 of 6", true), ("0.51", "3 of 6", false)];
    for (continuous_a, step, faults) in cases.into_iter().take(sim::of(1, 2)) {
        let (drive, folder) = (weak_winding(continuous_a), tempfile::tempdir().unwrap());
        let (code, said) = commission(&drive, &folder, &[]);
        assert!(code == Some(0) && said.contains("6 of 6: saved"), "{said}");
        let parts: Vec<_> = said.split(TOO_WARM).collect();
        assert!(parts.len() == 2 && parts[0].contains(step) && parts[1].trim_start().starts_with(step), "{said}");
        assert_eq!(drive.ok(&["faults"]).contains("the winding is too hot"), faults, "{said}");
        // In the drive's time, with the bridge off.
        let waited_s = usual_s.map(|usual_s| uptime_s(&drive) - usual_s);
        assert!(waited_s.is_none_or(|waited_s| waited_s > 20.0), "{continuous_a} A: {waited_s:?} s longer");
        assert!(drive.ok(&["status"]).contains("ready: bridge off, calibrated") && !is_left(&folder));
    }
}

/// It is given up where the current is too much for the winding in any case, and a signal ends the wait.
#[test]
fn a_wait_for_a_winding_ends() {
    let (drive, folder) = (weak_winding("0.44"), tempfile::tempdir().unwrap());
    let mut waits = tool(&drive, folder.path(), &["commission", "--yes"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(waits.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains(TOO_WARM)));
    kill_process(Pid::from_child(&waits), Signal::INT).unwrap();
    assert_eq!(waits.wait().unwrap().code(), Some(130), "{:?}", lines.collect::<Vec<_>>());
    let is_off = || drive.ok(&["status"]).contains("faulted: the winding is too hot");
    assert!(is_off());
    // Fifteen of them are long.
    if sim::of(true, false) {
        return;
    }
    let (code, said) = commission(&drive, &folder, &[]);
    assert!(code == Some(7) && said.contains("the winding is too hot by its current or resistance"), "{said}");
    assert_eq!(said.matches(TOO_WARM).count(), 15, "{said}");
    assert!(said.contains("goes on with this step") && is_off(), "{said}");
}

#[test]
fn of_two_at_once_one_is_refused() {
    let (mut drive, folder) = (Drive::start(&["--log"]), tempfile::tempdir().unwrap());
    // The simulated time is fast: on a busy machine a second of it is over before the first tool has its turn again.
    drive.ok(&["settings", "set", "command_timeout_s", "60"]);
    // And the first may be over before the second begins.
    let refused = (0..5).any(|_| {
        drive.forget_log();
        let first = tool(&drive, folder.path(), &["commission", "--yes", "--max-current", "2.5"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        drive.log_until("calibrating");
        let (code, said) = commission(&drive, &folder, &["--max-current", "2"]);
        assert!(code == Some(0) || code == Some(6) && said.contains("another tool controls"), "{said}");
        // The short form does not wait until the first is through.
        if sim::of(true, false) && code == Some(6) {
            begun(first);
        } else {
            let output = first.wait_with_output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
        }
        code == Some(6)
    });
    assert!(refused);
}

/// A shaft that is held, or that another tool turns, must not be let go by what is refused.
#[test]
fn what_is_refused_switches_nothing_off() {
    let (mut drive, folder) = (Drive::start(&["--log"]), tempfile::tempdir().unwrap());
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    let is_on = || drive.ok(&["status"]).contains("bridge on");
    let (code, said) = commission(&drive, &folder, &[]);
    assert!(code == Some(6) && said.contains("the bridge is on") && is_on(), "{said}");
    let mut turning = tool(&drive, folder.path(), &["speed", "20"]).stderr(Stdio::piped()).spawn().unwrap();
    drive.log_until("Speed(20.0)");
    let (code, said) = commission(&drive, &folder, &[]);
    assert!(code == Some(6) && said.contains("another tool controls"), "{said}");
    assert!(drive.ok(&["status"]).contains("bridge on") && turning.try_wait().unwrap().is_none(), "{said}");
    kill_process(Pid::from_child(&turning), Signal::INT).unwrap();
    assert_eq!(turning.wait().unwrap().code(), Some(130));
}

#[test]
fn what_cannot_be_kept_is_told_before_the_motor_turns() {
    let folder = tempfile::tempdir().unwrap();
    let drive = Drive::start(&["--log"]);
    let file = folder.path().join("none/commission.toml");
    let output = drive.call(&["commission", "--max-current", "2", "--yes", "--file", file.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("cannot write"), "{said}");
    assert!(!String::from_utf8_lossy(&output.stdout).contains("1 of 6"));
    assert_eq!(drive.ok(&["settings", "get", "max_current_a"]).split_whitespace().nth(2), Some("3"));
}
