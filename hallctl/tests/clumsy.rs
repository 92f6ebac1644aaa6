//! A clumsy command line: what is wrong is named, with what to do, and nothing that was measured is lost.

use crate::process::{Drive, HALLCTL, PATIENCE, call, fails};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;
use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

#[test]
fn a_file_may_have_any_name() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let name = folder.path().join(OsStr::from_bytes(b"settings-\xff.toml"));
    for command in ["export", "import"] {
        let mut tool = Command::new(HALLCTL);
        tool.args(["--port", &drive.port, "settings", command]).arg(&name).envs([PATIENCE]).stdin(Stdio::null());
        let output = tool.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let nonsense = Command::new(HALLCTL).arg(OsStr::from_bytes(b"\xff")).output().unwrap();
    assert_eq!(nonsense.status.code(), Some(2), "{}", String::from_utf8_lossy(&nonsense.stderr));
}

#[test]
fn a_wrong_command_line_is_told_to_a_script() {
    for (wrong, named) in [
        (&["speed", "nan"][..], "nan is beyond"),
        (&["speed"], "required"),
        (&["chirp", "speed", "--steps", "4.5"], "a whole number from 2 to 200 is wanted"),
        (&["chirp", "speed", "--steps", "-4"], "a whole number from 2 to 200 is wanted"),
        (&["telemetry", "--hz", "-5"], "a number of frames a second is wanted"),
        (&["speed", "1,5"], "with a point and no comma"),
        (&["simulate"], "--listen"),
        (&["dance"], "dance"),
    ] {
        let output = call("tcp:127.0.0.1:1", &[&["--json"], wrong].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&told["error"]["code"], &told["error"]["kind"]), (&2.into(), &"usage".into()), "{told}");
        assert!(told["error"]["what"].as_str().unwrap().contains(named), "{told}");
    }
    // What is no error is none.
    let help = call("", &["--json", "--help"]);
    assert!(help.status.success() && String::from_utf8(help.stdout).unwrap().starts_with("Talks"));
}

#[test]
fn a_negative_number_may_begin_with_its_point() {
    let drive = Drive::start(&[]);
    for number in ["-.5", "-.5rpm", "-0.5", "-5e-1"] {
        assert!(drive.fails(6, &["speed", number]).contains("the bridge is off"), "{number}");
    }
}

#[test]
fn a_port_that_is_none_is_told_what_it_should_be() {
    for (port, advice) in [
        ("", "HALLCTL_PORT"),
        ("127.0.0.1:7", "tcp:127.0.0.1:7"),
        ("tcp://127.0.0.1:7", "Without slashes: tcp:127.0.0.1:7"),
        ("tcp:127.0.0.1", "tcp:HOST:PORT"),
        ("tcp:127.0.0.1:65536", "tcp:HOST:PORT"),
        ("/dev/null", "no serial port"),
        ("/dev/no-such-port", "Is the board plugged in?"),
    ] {
        let said = fails(port, 3, &["status"]);
        assert!(said.contains(advice), "{port}: {said}");
    }
}

#[test]
fn a_missing_temporary_folder_is_no_wrong_port() {
    let mut tool = Command::new(HALLCTL);
    tool.args(["--port", "tcp:127.0.0.1:1", "status"]).envs([
        PATIENCE,
        ("TMPDIR", "/no/such"),
        ("XDG_RUNTIME_DIR", ""),
    ]);
    let output = tool.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("/no/such/hallctl-") && said.contains("No such file") && !said.contains("listens"), "{said}");
}

/// A full disk, or a terminal that is gone.
#[test]
fn where_nothing_can_be_said_the_exit_code_still_tells() {
    for arguments in [&["settings", "get", "pole_pairs"][..], &["--json", "stop"]] {
        let mut tool = Command::new(HALLCTL);
        tool.args(["--port", "tcp:127.0.0.1:1"]).args(arguments).envs([PATIENCE]);
        let tool = tool.stdout(Stdio::null()).stderr(File::options().write(true).open("/dev/full").unwrap());
        assert_eq!(tool.status().unwrap().code(), Some(3), "{arguments:?}");
    }
}

#[test]
fn a_folder_is_no_file_before_the_motor_turns() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    drive.ok(&["calibrate"]);
    for command in [
        &["step", "speed", "20", "--csv"][..],
        &["chirp", "current", "-o"],
        &["telemetry", "--seconds", "0.1", "--plot"],
        &["record", "-o"],
    ] {
        let output = drive.call(&[command, &[folder.path().to_str().unwrap()]].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && said.contains("cannot write"), "{command:?}: {said}");
        assert!(output.stdout.is_empty() && !said.contains("frames"), "{command:?}: {said}");
    }
}

#[test]
fn what_cannot_be_written_is_shown_and_costs_no_other_file() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    drive.ok(&["calibrate"]);
    let good = folder.path().join("good.csv");
    for (command, shown) in [(&["record"][..], "rows"), (&["chirp", "current", "--steps", "4"], "bandwidth")] {
        let output = drive.call(&[command, &["-o", "/dev/full", "-o", good.to_str().unwrap()]].concat());
        let [said, wrong] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
        assert!(output.status.code() == Some(1) && wrong.contains("cannot write /dev/full"), "{wrong}");
        assert!(said.contains(shown), "{command:?}: {said}");
        assert!(std::fs::read_to_string(&good).unwrap().lines().count() > 10, "{command:?}");
        std::fs::remove_file(&good).unwrap();
    }
}

#[test]
fn a_map_that_is_not_there_is_no_file() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let file = folder.path().join("map.csv");
    let said = drive.fails(6, &["magnets", "show", "--csv", file.to_str().unwrap()]);
    assert!(said.contains("there is no map") && said.contains("hallctl magnets learn"), "{said}");
    assert!(!file.exists());
    drive.ok(&["magnets", "show"]);
}

#[test]
fn a_step_below_the_noise_is_told_no_times() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    let step = |size: &str| -> Value {
        serde_json::from_str(&drive.ok(&["--json", "step", "speed", size, "--seconds", "0.2"])).unwrap()
    };
    let small = step("0.1");
    assert!(small["measured"]["settling_s"].is_null() && small["measured"]["rise_s"].is_null(), "{small}");
    let said = drive.ok(&["step", "speed", "0.1", "--seconds", "0.2"]);
    assert!(said.contains("no larger than the noise"), "{said}");
    let large = step("100");
    assert!(large["measured"]["settling_s"].is_number(), "{large}");
}

#[test]
fn what_is_typed_amiss_leaves_the_simulated_drive_as_it_was() {
    let mut drive = Drive::start(&[]);
    drive.type_bytes(b"\xff\xfe\nbus 1e30V\nload 1e30Nm\nturn 1e30\n\n");
    drive.hand("0.25");
    drive.ok(&["calibrate"]);
}

/// Whoever is asked may not know what to say.
#[test]
fn a_signal_ends_a_question() {
    let (drive, folder) = (Drive::start(&[]), tempfile::tempdir().unwrap());
    let mut tool = Command::new(HALLCTL);
    tool.args(["--port", &drive.port, "commission"]).envs([PATIENCE]).current_dir(folder.path());
    let mut asking = tool.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut asked = asking.stderr.take().unwrap();
    assert!(asked.read(&mut [0; 100]).unwrap() > 0);
    kill_process(Pid::from_child(&asking), Signal::INT).unwrap();
    assert_eq!(ended(&mut asking), Some(130));
}

/// Its exit code; none, if it goes on for ever.
fn ended(tool: &mut Child) -> Option<i32> {
    let status = (0..3000).find_map(|_| {
        std::thread::sleep(Duration::from_millis(10));
        tool.try_wait().unwrap()
    });
    let _ = tool.kill();
    status?.code()
}

/// A window that is closed: who watches there lets the port go.
#[test]
fn watching_ends_with_its_terminal() {
    let drive = Drive::start(&[]);
    let screen = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&screen).unwrap();
    unlockpt(&screen).unwrap();
    let name = ptsname(&screen, Vec::new()).unwrap().into_string().unwrap();
    let end = || Stdio::from(File::options().read(true).write(true).open(&name).unwrap());
    let mut tool = Command::new(HALLCTL);
    tool.args(["--port", &drive.port, "watch"]).envs([PATIENCE, ("TERM", "xterm")]);
    let mut watching = tool.stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
    drop(tool);
    let mut shown = File::from(screen);
    assert!(shown.read(&mut [0; 4096]).unwrap() > 0);
    drop(shown);
    kill_process(Pid::from_child(&watching), Signal::HUP).unwrap();
    assert_eq!(ended(&mut watching), Some(130));
}
