//! `hallctl` at a virtual board, as a person has it at a real one: every command over the serial port, and what the
//! motor really does meanwhile. No time is that on the wall: the board's passes as long as the tool asks, and the tool
//! counts the board's.

mod common;

use plant::PlantParameters;
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex, OnceLock};
use tempfile::TempDir;
use virtual_board::firmware;

/// The tool itself, built as the workspace at the root builds it.
fn hallctl() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        firmware::executable(&root, &["build", "-p", "hallctl"], "hallctl").expect("hallctl builds")
    })
}

/// `cargo virtual BOARD --serial …` in a process of its own.
struct Virtual {
    process: Child,
    port: String,
    folder: TempDir,
    log: Arc<Mutex<Vec<String>>>,
}

impl Drop for Virtual {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Virtual {
    fn start(board: &str, serial: &str) -> Self {
        Self::with_script(board, serial, "")
    }

    fn with_script(board: &str, serial: &str, script: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("script.txt");
        std::fs::write(&file, script).expect("a file");
        let mut process = Command::new(env!("CARGO_BIN_EXE_virtual"))
            .args([board, "--wait", "--serial", serial, "--out"])
            .arg(folder.path())
            .arg("--script")
            .arg(file)
            .arg("--json")
            .arg(folder.path().join("report.json"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let mut lines = BufReader::new(process.stdout.take().expect("a pipe")).lines().map_while(Result::ok);
        let port = lines.find_map(|line| Some(line.strip_prefix("serial port: ")?.to_owned())).expect("a port");
        let log = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&log);
        std::thread::spawn(move || lines.for_each(|line| kept.lock().expect("the log").push(line)));
        Self { process, port, folder, log }
    }

    fn call(&self, arguments: &[&str]) -> Output {
        // However slow this machine is.
        let arguments = [&["--port", &self.port, "--patience", "120"], arguments].concat();
        Command::new(hallctl()).args(arguments).current_dir(self.folder.path()).output().expect("hallctl starts")
    }

    /// What it prints, when it succeeds.
    fn ok(&self, arguments: &[&str]) -> String {
        let output = self.call(arguments);
        let text = String::from_utf8(output.stdout).expect("text");
        if !output.status.success() {
            let log = self.log.lock().expect("the log");
            let last = log[log.len().saturating_sub(12)..].join("\n");
            panic!("{arguments:?}: {text}{}\n{last}", String::from_utf8_lossy(&output.stderr));
        }
        text
    }

    /// Figures of `hallctl status` by name; `up` in seconds.
    fn status(&self, name: &str) -> f64 {
        let text = self.ok(&["status"]);
        let up = || Some(text.lines().next()?.rsplit_once("up ")?.1.split(':').map(|part| part.parse().ok()));
        let found = match name {
            "up" => up().and_then(|mut parts| parts.try_fold(0.0, |sum, part: Option<f64>| Some(60.0 * sum + part?))),
            _ => text.lines().find_map(|line| line.trim().strip_prefix(name)?.split_whitespace().next()?.parse().ok()),
        };
        found.unwrap_or_else(|| panic!("no {name}: {text}"))
    }

    /// Does something, and says when on the board's clock it was done.
    fn timed(&self, arguments: &[&str]) -> Range<f64> {
        let begin_s = self.status("up");
        println!("{begin_s:.3} s: {arguments:?}: {}", self.ok(arguments).trim());
        begin_s..self.status("up")
    }

    /// Ctrl-C: what the board has to say in the end.
    fn end(mut self) -> Truth {
        let id = Pid::from_child(&self.process);
        kill_process(id, Signal::INT).expect("a signal");
        let status = self.process.wait().expect("an end");
        let file = |name: &str| std::fs::read_to_string(self.folder.path().join(name)).expect("a file");
        let report = serde_json::from_str(&file("report.json")).expect("JSON");
        assert!(status.success(), "{status}: {report:#}");
        let trace = file("trace.csv");
        let mut lines = trace.lines();
        let names = lines.next().expect("names").split(',').map(String::from).collect();
        let rows = lines.map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect());
        Truth { report, names, rows: rows.collect() }
    }
}

/// What the motor did.
struct Truth {
    report: serde_json::Value,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Truth {
    /// A column of the trace over a time.
    fn during(&self, name: &str, time_s: &Range<f64>) -> Vec<f64> {
        let column = self.names.iter().position(|known| known == name).expect("a column");
        self.rows.iter().filter(|row| time_s.contains(&row[0])).map(|row| row[column]).collect()
    }

    /// From row to row of the trace, seconds.
    fn row_s(&self) -> f64 {
        (self.rows[self.rows.len() - 1][0] - self.rows[0][0]) / (self.rows.len() - 1) as f64
    }
}

const TORQUE_NM: f64 = 0.004;
const SPEED_RAD_S: f64 = 40.0;
const TURNS: f64 = 1.5;

/// Torque, speed and position by the tool, and when each was.
struct Motion {
    commutation: &'static str,
    torque: Range<f64>,
    speed: Range<f64>,
    position: Range<f64>,
}

fn moves(board: &Virtual, commutation: &'static str) -> Motion {
    board.ok(&["commutation", commutation]);
    board.ok(&["arm"]);
    let torque = board.timed(&["torque", &TORQUE_NM.to_string(), "--seconds", "0.25"]);
    let speed = board.timed(&["speed", &(-SPEED_RAD_S).to_string(), "--seconds", "0.8"]);
    board.timed(&["speed", "0", "--seconds", "0.3"]);
    let target = board.status("position") + TURNS;
    let position = board.timed(&["position", &target.to_string(), "--seconds", "1.2"]);
    board.ok(&["disarm"]);
    Motion { commutation, torque, speed, position }
}

/// How many of them are within 2 rad/s of a speed, and their mean.
fn near(speeds: Vec<f64>, wanted: f64) -> (usize, f64) {
    let held: Vec<_> = speeds.into_iter().filter(|found| (found - wanted).abs() < 2.0).collect();
    (held.len(), held.iter().sum::<f64>() / held.len() as f64)
}

/// The motor has done what it was told.
fn obeyed(truth: &Truth, motion: &Motion) {
    let Motion { commutation, torque, speed, position } = motion;
    // The rotor is free: what the torque leaves above friction accelerates it. Between two speeds, for it began
    // somewhere.
    let motor = PlantParameters::imperfect(1).motor;
    let speeds = truth.during("speed / rad/s", torque);
    let (from, to) = (20.0, 80.0);
    let rows = speeds.iter().filter(|speed| (from..to).contains(*speed)).count() as f64;
    let acceleration = (to - from) / (rows * truth.row_s());
    let friction_nm = motor.friction.coulomb_nm + motor.friction.viscous_nms * (from + to) / 2.0;
    let found_nm = motor.inertia_kgm2 * acceleration + friction_nm;
    println!("{commutation}: {found_nm:.5} N m");
    assert!((found_nm / TORQUE_NM - 1.0).abs() < 0.05, "{commutation}: {found_nm} N m instead of {TORQUE_NM}");

    let (held, mean) = near(truth.during("speed / rad/s", speed), -SPEED_RAD_S);
    println!("{commutation}: {mean:.3} rad/s for {:.3} s", held as f64 * truth.row_s());
    assert!(held as f64 * truth.row_s() > 0.5, "{commutation}: {SPEED_RAD_S} rad/s is not held");
    assert!((mean + SPEED_RAD_S).abs() < 0.5, "{commutation}: {mean} rad/s");

    let angles = truth.during("angle / turns", position);
    let turned = angles[angles.len() - 1] - angles[0];
    println!("{commutation}: {turned:.5} turns");
    assert!((turned - TURNS).abs() < 3e-3, "{commutation}: {turned} turns instead of {TURNS}");
}

/// Telemetry of a motor that is told once and stops by itself when the command is too old.
fn telemetry(board: &Virtual) -> (Vec<f64>, Range<f64>) {
    let file = board.folder.path().join("telemetry.csv");
    board.ok(&["commutation", "field-oriented"]);
    board.ok(&["arm"]);
    board.ok(&["speed", &SPEED_RAD_S.to_string(), "--once"]);
    let path = file.to_str().expect("a path");
    let time = board.timed(&["telemetry", "--seconds", "2", "--hz", "500", "--csv", path]);
    assert!(board.ok(&["status"]).contains("stopped: no command came for too long"));
    board.ok(&["disarm"]);
    let text = std::fs::read_to_string(file).expect("a file");
    let mut lines = text.lines();
    let names: Vec<_> = lines.next().expect("names").split(',').collect();
    let column = |name| names.iter().position(|known| *known == name).expect("a column");
    let [speed, lost] = ["speed_rad_s", "lost"].map(column);
    let rows: Vec<Vec<_>> = lines.map(|line| line.split(',').collect()).collect();
    // While what is learnt is taken up, the tasks have no time for frames.
    assert!(rows.len() > 400, "{} frames", rows.len());
    assert!(rows.iter().all(|row| row[lost] == "0"));
    (rows.iter().map(|row| row[speed].parse().expect("a speed")).collect(), time)
}

/// Every period of a while, and all rows that the board has memory for.
fn records(name: &str, board: &Virtual) {
    let capacity = if name == "nucleo-g474re-ihm08m1" { 512 } else { 128 };
    let said = board.ok(&["record", "-c", "angle,bus,hall_1,duty_a", "-o", "-"]);
    let too_many = board.call(&["record", "--rows", &(capacity + 1).to_string()]);
    let refused = String::from_utf8(too_many.stderr).expect("text");
    // More than any board has are no request at all.
    assert!(capacity == 512 || refused.contains(&format!("the rows have to be 1 to {capacity}")), "{refused}");
    let rows: Vec<Vec<f64>> = said
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect())
        .collect();
    assert_eq!(rows.len(), capacity);
    let mean = |column: usize| rows.iter().map(|row| row[column]).sum::<f64>() / capacity as f64;
    let bus_v = board.status("bus");
    assert!((mean(2) - bus_v).abs() < 0.5 && mean(4) == 0.0, "{} V, {} of the period", mean(2), mean(4));
    assert!((1000.0..3000.0).contains(&mean(3)), "{} codes", mean(3));
}

/// What is told of the current's loop is what the settings ask for. Each time may tell nothing, in the noise of the amplifiers
/// or because this machine was busy: each request is worth 50 ms of the board's time, in which the step's torque speeds the
/// rotor up, until the voltage is at its limit.
fn measures_its_loop(name: &str, board: &Virtual) {
    assert!((0..12).any(|_| measured(name, board) > 0), "{name} tells nothing");
}

/// How many figures are told; all have to be right.
fn measured(name: &str, board: &Virtual) -> u32 {
    let output = board.call(&["--json", "chirp", "current", "--steps", "8"]);
    let [said, error] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("text"));
    if !output.status.success() {
        assert!(error.contains("the current does not follow"), "{error}");
        return 0;
    }
    let found: serde_json::Value = serde_json::from_str(said.trim()).expect("JSON");
    println!("{name}: {} {}", found["measured"], found["model"]);
    let mut told = 0;
    for figure in ["bandwidth_hz", "crossover_hz"] {
        let Some(measured) = found["measured"][figure].as_f64() else { continue };
        let share = measured / found["model"][figure].as_f64().expect("a figure");
        // A figure is told whose standard error is a tenth at most: on the ESC1 it is about that.
        let within = if name == "b-g431b-esc1" { 0.3 } else { 0.15 };
        assert!((share - 1.0).abs() < within, "{name}, {figure}: {} {}", found["measured"], found["model"]);
        told += 1;
    }
    told
}

/// A recording that waits, and a calibration meanwhile. Where both have the same memory, the one who records is told.
fn calibrates_amid_a_recording(name: &str, board: &Virtual) {
    let waits = ["--port", &board.port, "--patience", "120", "record", "--trigger", "bus>30"];
    let mut recorder = Command::new(hallctl());
    let recorder = recorder.args(waits).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("hallctl starts");
    // From then on another one is refused for that, and no more for what it wants.
    let refusal = || String::from_utf8(board.call(&["record", "-c", "i_q,i_q"]).stderr).expect("text");
    assert!((0..100).any(|_| !refusal().contains("twice")), "nobody records");
    assert!(board.ok(&["calibrate"]).contains("Calibrated."));
    if name == "nucleo-g474re-ihm08m1" {
        kill_process(Pid::from_child(&recorder), Signal::INT).expect("a signal");
    }
    let output = recorder.wait_with_output().expect("an end");
    let said = String::from_utf8(output.stderr).expect("text");
    if name == "nucleo-g474re-ihm08m1" {
        assert_eq!(output.status.code(), Some(130), "{said}");
    } else {
        assert!(output.status.code() == Some(7) && said.contains("calibrated meanwhile"), "{name}: {said}");
    }
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    // The memory is the recordings' again.
    records(name, board);
}

/// A calibration that is broken off gives the memory back, too: a recording had waited for it for ever.
fn records_after_a_calibration_that_was_broken_off(name: &str, board: &Virtual) {
    board.ok(&["calibrate", "--unattended"]);
    let goes_on = || board.ok(&["status"]).contains("a calibration");
    assert!((0..10).all(|_| goes_on()));
    board.ok(&["stop"]);
    assert!((0..100).any(|_| !goes_on()));
    records(name, board);
}

fn evening(name: &str, serial: &str) {
    let board = Virtual::start(name, serial);
    assert!(board.ok(&["status"]).contains("unarmed: bridge off, not calibrated"));
    assert_eq!(board.call(&["arm"]).status.code(), Some(6), "not calibrated");
    let report = board.ok(&["calibrate"]);
    assert!(report.contains("Calibrated.") && report.contains("120° apart"), "{report}");
    records(name, &board);
    // On a board with little flash there is no map, and there never will be.
    let shown = board.call(&["magnets", "show"]);
    let why = String::from_utf8_lossy(&shown.stderr);
    let code = if name == "nucleo-g474re-ihm08m1" { 0 } else { 6 };
    assert_eq!(shown.status.code(), Some(code), "{why}");
    assert_eq!(why.contains("the firmware of this drive knows no map of the magnets"), code == 6, "{why}");
    calibrates_amid_a_recording(name, &board);
    records_after_a_calibration_that_was_broken_off(name, &board);
    measures_its_loop(name, &board);
    let motions = ["field-oriented", "sinusoidal", "block"].map(|commutation| moves(&board, commutation));
    let (told, time) = telemetry(&board);
    board.ok(&["settings", "set", "max_current_a", "1.5"]);
    assert_eq!(board.ok(&["settings", "save"]), "saved\n");
    assert!(board.ok(&["settings", "get", "max_current_a"]).contains("max_current_a = 1.5 A"));

    let truth = board.end();
    motions.iter().for_each(|motion| obeyed(&truth, motion));
    let [(frames, told), (_, found)] =
        [told, truth.during("speed / rad/s", &time)].map(|speeds| near(speeds, SPEED_RAD_S));
    println!("{name}: {told:.3} rad/s told by {frames} frames, {found:.3} true");
    assert!(frames > 100 && (told - found).abs() < 0.5, "{told} rad/s told by {frames} frames, {found} true");
    println!("{name}: {:#}", truth.report["angle_error"]);
    let error = &truth.report["angle_error"]["constant_speed"];
    assert!(error["count"].as_u64().expect("frames") > 400, "{error}");
    assert!(error["rms_deg"].as_f64().expect("an error") < 1.0, "{error}");
    assert_eq!(truth.report["resets"], serde_json::json!([]));
}

/// The first board at a pseudo-terminal, the others over TCP.
fn all_evening(board: &str) {
    let boards = chip::Board::names(&firmware::boards()).expect("the boards' folder");
    evening(board, if boards[0] == board { "pty" } else { "tcp:127.0.0.1:0" });
}

/// The commands of the section about the first power-up, in their order.
fn first_power_up(readme: &str) -> Vec<Vec<&str>> {
    let section = readme.split("## First power-up").nth(1).expect("a section");
    let section = section.split("\n## ").next().expect("its end");
    let quoted = section.split('`').skip(1).step_by(2);
    quoted.filter_map(|text| Some(text.strip_prefix("hallctl ")?.split_whitespace().collect())).collect()
}

/// Its README can be followed, command by command.
fn power_up(board: &str) {
    let readme = std::fs::read_to_string(firmware::boards().join(board).join("README.md")).expect("a README");
    let commands = first_power_up(&readme);
    let virtual_board = Virtual::start(board, "tcp:127.0.0.1:0");
    let mut said = String::new();
    for command in &commands {
        // There is nothing to be cleared where nothing was cut off.
        if command != &["clear"] {
            said += &virtual_board.ok(command);
        }
    }
    for (kind, sign) in
        [("status", "bus"), ("telemetry", "Hall 3 "), ("calibrate", "Calibrated."), ("speed", " rad/s at ")]
    {
        let named = commands.iter().any(|command| command[0] == kind);
        assert!(named && said.contains(sign), "{board}: {kind} in {commands:?}: {said}");
    }
    assert!(virtual_board.ok(&["status"]).contains("bridge off"), "{board}");
}

/// The commands of a transcript, and what is printed under each.
fn transcript(text: &str) -> Vec<(Vec<&str>, Vec<&str>)> {
    let mut said: Vec<(Vec<&str>, Vec<&str>)> = Vec::new();
    for block in text.split("```console\n").skip(1) {
        for line in block.split("```").next().expect("an end").lines() {
            match line.strip_prefix("$ hallctl ") {
                Some(command) => said.push((command.split_whitespace().collect(), Vec::new())),
                None => said.last_mut().expect("a command").1.push(line),
            }
        }
    }
    said
}

/// Without figures.
fn words(line: &str) -> Vec<&str> {
    line.split(|c: char| c.is_ascii_digit() || c.is_whitespace() || "+-.".contains(c))
        .filter(|word| !word.is_empty())
        .collect()
}

/// The way from parts to a tuned motor, command by command as it is written: what is said at the beginning of a line, in
/// this order, whatever the figures. What is indented differs from board to board.
fn parts_to_motor(name: &str) {
    let text = std::fs::read_to_string(firmware::boards().join("../docs/first-motor.md")).expect("the transcript");
    let commands = transcript(&text);
    let board = Virtual::with_script(name, "tcp:127.0.0.1:0", "at 1ms bus 15V");
    for (command, printed) in &commands {
        let found = board.ok(command);
        println!("{command:?}\n{found}");
        let mut lines = found.lines();
        for wanted in printed.iter().filter(|line| line.starts_with(|c: char| !c.is_whitespace())) {
            assert!(lines.any(|line| words(line) == words(wanted)), "{name}: {wanted} is missing: {found}");
        }
    }
    assert!(commands.iter().any(|(command, _)| command[0] == "commission"));
    assert!(board.ok(&["status"]).contains("ready: bridge off, calibrated"));
}

/// On the smallest board, and on all with the environment variable FULL: a motor turns for minutes.
fn commissioned(board: &str) -> bool {
    board == common::ESC || std::env::var_os("FULL").is_some()
}

fn main() {
    common::on_boards(&[
        ("is_commissioned_as_written", parts_to_motor, commissioned),
        ("does_what_hallctl_says", all_evening, |_| true),
        ("can_be_powered_up_as_its_readme_says", power_up, |_| true),
    ]);
}
