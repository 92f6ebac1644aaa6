//! `hallctl simulate` in a process of its own, and the tool at it.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

pub const HALLCTL: &str = env!("CARGO_BIN_EXE_hallctl");
/// Seconds on the wall for every answer, however slow this machine is: the drive's own time depends on no clock.
pub const PATIENCE: (&str, &str) = ("HALLCTL_PATIENCE", "60");

/// Nothing that comes at all takes so long.
const LONGEST: Duration = Duration::from_secs(300);

/// So often, 10 ms apart, a drive whose line is closed is looked at until it has ended.
const FATE: u32 = 100;

/// A simulated drive in a process of its own; dropped, its power is cut.
pub struct Drive {
    process: Mutex<Child>,
    keyboard: ChildStdin,
    /// Lines that it prints; read all the while, or it would wait.
    screen: Receiver<String>,
    pub port: String,
    /// What it says of itself before that.
    pub about: String,
    log: Vec<Entry>,
}

/// A line of its log.
#[derive(Clone, Debug)]
pub struct Entry {
    pub at_s: f64,
    pub speed_rad_s: f64,
    pub what: String,
}

impl Drop for Drive {
    fn drop(&mut self) {
        let process = self.process.get_mut().unwrap();
        let _ = process.kill();
        let _ = process.wait();
    }
}

impl Drive {
    pub fn start(options: &[&str]) -> Self {
        let mut process = Command::new(HALLCTL)
            .args(["simulate", "--speed", "fast"])
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let keyboard = process.stdin.take().unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        let (printed, screen) = channel();
        std::thread::spawn(move || lines.take_while(|line| printed.send(format!("{line}\n")).is_ok()).for_each(drop));
        let mut about = String::new();
        let port = loop {
            let line = screen.recv().unwrap();
            match line.trim().strip_prefix("The simulated drive is at ") {
                Some(port) => break port.to_owned(),
                None => about += &line,
            }
        };
        Self { process: Mutex::new(process), keyboard, screen, port, about, log: Vec::new() }
    }

    pub fn with_flash(flash: &Path, options: &[&str]) -> Self {
        Self::start(&[&["--flash", flash.to_str().unwrap()], options].concat())
    }

    /// Of its process.
    pub fn id(&self) -> u32 {
        self.process.lock().unwrap().id()
    }

    /// Whether its process goes on, or how it has ended: a tool that has lost it cannot tell a panic of the drive, which
    /// has the code 101, from somebody who kills it, or from the end of the process that shares the port.
    pub fn fate(&self) -> String {
        for _ in 0..FATE {
            if let Some(status) = self.process.lock().unwrap().try_wait().unwrap() {
                return format!("the simulated drive has ended: {status}");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        "the simulated drive goes on: what shares its port has ended".into()
    }

    pub fn call(&self, arguments: &[&str]) -> Output {
        call(&self.port, arguments)
    }

    /// A line that it prints.
    fn line(&mut self) -> String {
        self.screen.recv_timeout(LONGEST).expect("the drive has ended, or what was waited for never comes")
    }

    /// Something is typed into it that it says nothing of, on its standard output.
    pub fn type_bytes(&mut self, bytes: &[u8]) {
        self.keyboard.write_all(bytes).unwrap();
    }

    /// Something is typed into it, and it says that this happened.
    pub fn typed(&mut self, event: &str) -> String {
        writeln!(self.keyboard, "{event}").unwrap();
        self.line()
    }

    /// A hand turns its shaft.
    pub fn hand(&mut self, turns: &str) {
        assert_eq!(self.typed(&format!("turn {turns}")), format!("The shaft is turned by {turns} turns.\n"));
    }

    /// What its log has told so far is of no interest.
    pub fn forget_log(&mut self) {
        writeln!(self.keyboard, "mend").unwrap();
        while self.line() != "mend: done\n" {}
        self.log.clear();
    }

    /// Waits until its log tells of something.
    pub fn log_until(&mut self, what: &str) -> Entry {
        loop {
            let line = self.line();
            let mut parts = line.trim().splitn(3, "  ");
            let mut number = |unit| parts.next().and_then(|part| part.strip_suffix(unit)?.parse().ok());
            let (at_s, speed_rad_s) = (number(" s").unwrap(), number(" rad/s").unwrap());
            let entry = Entry { at_s, speed_rad_s, what: parts.next().unwrap().into() };
            self.log.push(entry.clone());
            if entry.what == what {
                return entry;
            }
        }
    }

    /// The first of the latest entries in a row that tell of something.
    pub fn log_first(&self, what: &str) -> Entry {
        let end = self.log.iter().rposition(|entry| entry.what == what).unwrap_or_else(|| panic!("{:?}", self.log));
        let before = self.log[..end].iter().rposition(|entry| entry.what != what).map_or(0, |at| at + 1);
        self.log[before].clone()
    }

    /// Whether an entry since [`Self::forget_log`] tells of something.
    pub fn log_has(&self, what: &str) -> bool {
        self.log.iter().any(|entry| entry.what == what)
    }

    /// The latest entry that tells of something.
    pub fn log_last(&self, what: &str) -> Entry {
        self.log.iter().rfind(|entry| entry.what == what).unwrap_or_else(|| panic!("{:?}", self.log)).clone()
    }

    /// What it prints, when it succeeds.
    pub fn ok(&self, arguments: &[&str]) -> String {
        let output = self.call(arguments);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{arguments:?}: {text}{}", String::from_utf8_lossy(&output.stderr));
        text
    }

    /// What it says, when it fails with an exit code.
    pub fn fails(&self, code: i32, arguments: &[&str]) -> String {
        fails(&self.port, code, arguments)
    }
}

pub fn call(port: &str, arguments: &[&str]) -> Output {
    Command::new(HALLCTL).args(["--port", port]).args(arguments).envs([PATIENCE]).stdin(Stdio::null()).output().unwrap()
}

/// At work, with somebody at its keyboard.
pub fn spawn(port: &str, arguments: &[&str]) -> Child {
    let mut tool = Command::new(HALLCTL);
    tool.args(["--port", port]).args(arguments).envs([PATIENCE]);
    tool.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

pub fn fails(port: &str, code: i32, arguments: &[&str]) -> String {
    let output = call(port, arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    text
}
