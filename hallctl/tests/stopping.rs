//! A motor can be stopped at any time: by Ctrl-C, by a tool that is killed, and from a second terminal. The time is
//! that of the drive, which it tells in its log.

use crate::process::{Drive, HALLCTL, PATIENCE};
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Stdio};

/// Longest from the signal to the bridge off, s; the log's times are rounded.
const LONGEST_S: f64 = 0.1005;

impl Drive {
    fn begin(&self, arguments: &[&str]) -> Child {
        Command::new(HALLCTL)
            .args(["--port", &self.port])
            .args(arguments)
            .envs([PATIENCE])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    /// Begins something, and a signal ends it when the drive turns its motor. The exit code, and what it said.
    fn interrupted(&mut self, signal: Signal, arguments: &[&str], sign: &str) -> (Option<i32>, String) {
        self.forget_log();
        let tool = self.begin(arguments);
        self.log_until(sign);
        kill_process(Pid::from_child(&tool), signal).unwrap();
        let output = tool.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    }
}

fn calibrated(options: &[&str]) -> Drive {
    let drive = Drive::start(&[&["--log"], options].concat());
    drive.ok(&["calibrate"]);
    drive
}

fn is_off(drive: &Drive) -> bool {
    drive.ok(&["status"]).contains("bridge off")
}

#[test]
fn a_signal_stops_the_motor_and_switches_off() {
    let mut drive = calibrated(&[]);
    // So slow that the motor stops in its time however late a busy machine hears the signal.
    drive.ok(&["settings", "set", "max_speed_rad_s", "100"]);
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        for (command, sign) in [
            (&["speed", "100"][..], "Speed(100.0)"),
            (&["speed", "100", "--seconds", "1000"], "Speed(100.0)"),
            (&["position", "500"], "Position(500.0)"),
        ] {
            drive.ok(&["arm"]);
            let (code, said) = drive.interrupted(signal, command, sign);
            assert_eq!(code, Some(130), "{said}");
            let off = drive.log_until("Disarm");
            let stop = drive.log_first("Speed(0.0)");
            assert!(off.at_s - stop.at_s <= LONGEST_S, "{stop:?} {off:?}");
            assert!(off.speed_rad_s.abs() < 5.0, "{off:?}");
            assert_eq!(drive.log_until("ready").what, "ready");
            assert!(is_off(&drive));
        }
    }
}

#[test]
fn a_motor_that_a_signal_could_not_stop_is_said_to_coast() {
    let mut drive = calibrated(&[]);
    let (code, said) = {
        drive.ok(&["arm"]);
        drive.interrupted(Signal::INT, &["speed", "5"], "Speed(5.0)")
    };
    assert!(code == Some(130) && !said.contains("coasts"), "{said}");
    // It would take two seconds to stop.
    drive.ok(&["settings", "set", "max_acceleration_rad_s2", "50"]);
    drive.ok(&["arm"]);
    drive.ok(&["speed", "100", "--seconds", "4"]);
    let (code, said) = drive.interrupted(Signal::INT, &["--speed-unit", "rpm", "speed", "100rad/s"], "Speed(100.0)");
    let off = drive.log_until("Disarm");
    assert!(off.speed_rad_s > 50.0, "{off:?}");
    assert!(code == Some(130) && said.contains("it coasts, the bridge off, at ") && said.contains(" rpm"), "{said}");
}

#[test]
fn a_calibration_that_is_broken_off_says_that_the_one_before_stays() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash");
    let mut drive = Drive::with_flash(&flash, &["--log"]);
    drive.ok(&["calibrate"]);
    let (code, said) = drive.interrupted(Signal::INT, &["calibrate"], "calibrating");
    assert!(code == Some(130) && said.contains("the one before, if there was one, is in use again"), "{said}");
    drive.ok(&["arm"]);
    drop(drive);
    Drive::with_flash(&flash, &[]).ok(&["arm"]);
}

#[test]
fn a_signal_ends_what_takes_a_while() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("commission.toml");
    for (command, sign) in [
        (&["identify"][..], "running"),
        (&["cogging", "learn"], "running"),
        (&["calibrate"], "calibrating"),
        (&["commission", "--yes", "--max-current", "2", "--file", file.to_str().unwrap()], "calibrating"),
    ] {
        let mut drive = calibrated(&[]);
        let (code, said) = drive.interrupted(Signal::INT, command, sign);
        assert_eq!(code, Some(130), "{command:?}: {said}");
        let off = drive.log_until("Disarm");
        let stop = drive.log_first("Speed(0.0)");
        assert!(off.at_s - stop.at_s <= LONGEST_S && off.speed_rad_s.abs() < 5.0, "{command:?} {stop:?} {off:?}");
        assert!(is_off(&drive), "{command:?}: {}", drive.ok(&["status"]));
        assert!(!drive.ok(&["status"]).contains("goes on"), "{command:?}");
    }
}

/// Where a signal ends all processes of a simulation, what is lost is no cable.
#[test]
fn a_signal_is_told_of_where_the_drive_is_lost_by_it() {
    for (signal, said) in [(Some(Signal::TERM), true), (None, false)] {
        let mut drive = calibrated(&[]);
        drive.ok(&["arm"]);
        let tool = drive.begin(&["speed", "50"]);
        (0..3).for_each(|_| _ = drive.log_until("Speed(50.0)"));
        let id = Pid::from_child(&tool);
        kill_process(id, Signal::STOP).unwrap();
        kill_process(Pid::from_raw(drive.id() as i32).unwrap(), Signal::KILL).unwrap();
        signal.into_iter().for_each(|signal| kill_process(id, signal).unwrap());
        kill_process(id, Signal::CONT).unwrap();
        let output = tool.wait_with_output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(3) && told.contains("is lost"), "{told}");
        assert_eq!(told.contains("a signal was to end this"), said, "{told}");
    }
}

#[test]
fn the_motor_of_a_tool_that_is_killed_is_switched_off() {
    let mut drive = calibrated(&[]);
    // Even where a command holds for long.
    drive.ok(&["settings", "set", "command_timeout_s", "60"]);
    drive.ok(&["arm"]);
    let tool = drive.begin(&["speed", "100"]);
    // At the third the first is answered.
    (0..3).for_each(|_| _ = drive.log_until("Speed(100.0)"));
    kill_process(Pid::from_child(&tool), Signal::KILL).unwrap();
    tool.wait_with_output().unwrap();
    let off = drive.log_until("Disarm");
    let last = drive.log_last("Speed(100.0)");
    assert!(off.at_s - last.at_s <= LONGEST_S && off.speed_rad_s.abs() < 5.0, "{last:?} {off:?}");
    assert!(is_off(&drive));
    drive.interrupted(Signal::KILL, &["identify"], "running");
    drive.log_until("Disarm");
    assert!(is_off(&drive));
    // The next tool has the control at once.
    drive.ok(&["arm"]);
    drive.ok(&["speed", "20", "--seconds", "0.2"]);
    // One that only looks is missed by nobody.
    drive.ok(&["speed", "20", "--once"]);
    let watcher = drive.begin(&["telemetry"]);
    drive.ok(&["telemetry", "--seconds", "0.5"]);
    kill_process(Pid::from_child(&watcher), Signal::KILL).unwrap();
    watcher.wait_with_output().unwrap();
    assert!(!is_off(&drive));
}

#[test]
fn the_next_command_is_obeyed_though_nobody_reads_the_one_before_to_its_end() {
    let drive = Drive::start(&[]);
    // As `hallctl calibrate | head -0`.
    let mut tool = drive.begin(&["calibrate"]);
    drop(tool.stdout.take());
    assert_eq!(tool.wait().unwrap().signal(), Some(Signal::PIPE.as_raw()));
    drive.ok(&["arm"]);
    // Nobody switches it off late.
    assert!(drive.ok(&["speed", "20", "--seconds", "0.5"]).contains("rad/s at"));
}

#[test]
fn what_is_unattended_goes_on() {
    let mut drive = calibrated(&[]);
    drive.forget_log();
    drive.ok(&["identify", "--unattended"]);
    drive.log_until("running");
    assert!(drive.ok(&["status"]).contains("goes on"));
}

#[test]
fn anyone_may_stop_what_another_tool_does() {
    for options in [&[][..], &["--pty"]] {
        let mut drive = calibrated(options);
        for (command, sign) in
            [(&["speed", "100"][..], "Speed(100.0)"), (&["identify"], "running"), (&["calibrate"], "aligning")]
        {
            if command[0] == "speed" {
                drive.ok(&["arm"]);
            }
            drive.forget_log();
            let turning = drive.begin(command);
            drive.log_until(sign);
            // Others may look meanwhile, and not interfere.
            assert!(drive.ok(&["status"]).contains("another tool"));
            assert!(drive.fails(6, &["speed", "1"]).contains("another tool controls"));
            assert_eq!(drive.ok(&["stop"]), "the bridge is off\n");
            let output = turning.wait_with_output().unwrap();
            let said = String::from_utf8(output.stderr).unwrap();
            assert!(matches!(output.status.code(), Some(6 | 7)), "{command:?}: {said}");
            assert!(is_off(&drive));
        }
    }
}

#[test]
fn a_tool_that_was_suspended_does_not_turn_a_motor_that_another_has_armed() {
    let mut drive = calibrated(&[]);
    for (command, sign) in [
        (&["speed", "20", "--seconds", "1000"][..], "Speed(20.0)"),
        (&["position", "500", "--seconds", "1000"], "Position(500.0)"),
        (&["step", "speed", "20", "--seconds", "1000"], "Speed(20.0)"),
    ] {
        drive.ok(&["arm"]);
        drive.forget_log();
        let tool = drive.begin(command);
        // At the third the first is answered.
        (0..3).for_each(|_| _ = drive.log_until(sign));
        kill_process(Pid::from_child(&tool), Signal::STOP).unwrap();
        drive.ok(&["stop"]);
        drive.ok(&["arm"]);
        // No real drive is stopped and armed in less.
        std::thread::sleep(std::time::Duration::from_millis(300));
        drive.forget_log();
        kill_process(Pid::from_child(&tool), Signal::CONT).unwrap();
        let output = tool.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(7) && said.contains("the bridge was switched off meanwhile"), "{said}");
        // It has left the motor as it was.
        drive.ok(&["stop"]);
        drive.log_until("Disarm");
        assert!(!drive.log_has(sign), "{command:?}");
    }
}

#[test]
fn a_motion_for_a_time_ends_with_the_motor_at_rest() {
    let mut drive = calibrated(&[]);
    for command in [&["position", "300"][..], &["impedance", "--velocity", "100"]] {
        drive.ok(&["arm"]);
        drive.forget_log();
        drive.ok(&[command, &["--seconds", "1"]].concat());
        // The command to stop is there at once, not when the drive misses the next one.
        drive.ok(&["stop"]);
        drive.log_until("Disarm");
        assert!(drive.log_has("Speed(0.0)"), "{command:?}");
    }
}

#[test]
fn commissioning_that_is_stopped_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let commission = ["commission", "--yes", "--max-current", "2.5", "--pole-pairs", "4", "--file"];
    let file = folder.path().join("commission.toml");
    let commission = [&commission[..], &[file.to_str().unwrap()]].concat();
    let stopped = |drive: &Drive, tool: Child| {
        drive.ok(&["stop"]);
        let output = tool.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(7), "{said}");
        said
    };
    let mut drive = Drive::start(&["--log"]);
    // On a busy machine the first step may be over before it is stopped.
    let said = (0..10).any(|_| {
        drive.forget_log();
        let tool = drive.begin(&[&commission[..], &["--restart"]].concat());
        drive.log_until("aligning");
        kill_process(Pid::from_child(&tool), Signal::STOP).unwrap();
        drive.ok(&["stop"]);
        kill_process(Pid::from_child(&tool), Signal::CONT).unwrap();
        stopped(&drive, tool).contains("R and L at standstill: the bridge was switched off meanwhile")
    });
    assert!(said);
    // Later the motor is fast, and takes a while to come to rest; on a busy machine it may be slow again when it is stopped.
    let speed_rad_s = |drive: &Drive| {
        let status: serde_json::Value = serde_json::from_str(&drive.ok(&["--json", "status"])).unwrap();
        (status["state"] == "running").then(|| status["speed_rad_s"].as_f64().unwrap().abs())
    };
    let said = (0..10).any(|_| {
        let mut tool = drive.begin(&[&commission[..], &["--restart"]].concat());
        let mut lines = BufReader::new(tool.stdout.take().unwrap()).lines().map_while(Result::ok);
        assert!(lines.any(|line| line.starts_with("4 of 6")));
        while speed_rad_s(&drive).is_none_or(|speed| speed < 100.0) {}
        let said = stopped(&drive, tool);
        said.contains("The motor still turns: ") && said.contains("wait until it stands")
    });
    assert!(said);
}

#[test]
fn telemetry_of_which_nothing_comes_leaves_its_files() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    for option in ["--csv", "--plot"] {
        let file = folder.path().join(option);
        std::fs::write(&file, "kept").unwrap();
        let waits = drive.begin(&["telemetry", "--trigger", "bus>30", option, file.to_str().unwrap()]);
        std::thread::sleep(std::time::Duration::from_millis(500));
        kill_process(Pid::from_child(&waits), Signal::INT).unwrap();
        let output = waits.wait_with_output().unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept", "{option}");
        // A script must not take it for a recording.
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert!(said.contains("the trigger did not come"), "{said}");
    }
}

/// Memory that a process has, KiB.
#[cfg(target_os = "linux")]
fn memory_kib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// It asks as fast as it can, and takes none of the answers.
#[cfg(target_os = "linux")]
#[test]
fn a_tool_that_never_reads_floods_nothing_and_keeps_nobody_from_stopping() {
    use hallservo_protocol::{Ask, FRAME, Request, encode};
    use std::time::Duration;

    let mut drive = calibrated(&[]);
    // The process that owns the port lives as long as this one watches.
    let mut watcher = drive.begin(&["telemetry"]);
    BufReader::new(watcher.stdout.take().unwrap()).read_line(&mut String::new()).unwrap();
    let mut line = hallctl::share::attach(&drive.port).unwrap();
    let mut frame = [0; FRAME];
    let request = Request { id: 1, client: 77, unattended: false, ask: Ask::Status };
    let length = encode(&request, &mut frame).unwrap();
    let flood = frame[..length].repeat(1000);
    let (told, started) = std::sync::mpsc::channel();
    // It ends when the line breaks, with the drive.
    std::thread::spawn(move || {
        for _ in 0..100_000 {
            let _ = told.send(());
            if line.writer.write_all(&flood).is_err() {
                return;
            }
        }
    });
    started.recv().unwrap();
    drive.ok(&["arm"]);
    let turning = drive.begin(&["speed", "100"]);
    drive.log_until("Speed(100.0)");
    assert_eq!(drive.ok(&["stop"]), "the bridge is off\n");
    turning.wait_with_output().unwrap();
    assert!(is_off(&drive));
    // However long it goes on: it is the one that waits.
    while started.recv_timeout(Duration::from_secs(1)).is_ok() {}
    assert!(memory_kib(drive.id()) < 200_000, "{} KiB", memory_kib(drive.id()));
    watcher.kill().unwrap();
    watcher.wait().unwrap();
}

/// Who has ended it is what matters then, and not the shaft.
#[test]
fn learning_that_another_tool_ends_blames_no_shaft() {
    for learn in ["magnets", "cogging"] {
        let mut drive = calibrated(&[]);
        drive.forget_log();
        let tool = drive.begin(&[learn, "learn"]);
        drive.log_until("running");
        drive.ok(&["stop"]);
        let output = tool.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(7), "{said}");
        assert!(said.contains("`hallctl stop`") && !said.contains("freely"), "{said}");
    }
}
