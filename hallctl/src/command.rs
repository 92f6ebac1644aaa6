//! The command line.

mod chirp;
mod coil;
mod commission;
mod config;
mod encoder;
mod faults;
mod help;
mod impedance;
mod list;
mod magnets;
mod motion;
mod pole_pairs;
mod procedures;
mod record;
mod response;
mod session;
mod settings;
mod status;
mod telemetry;
mod trigger;
mod tune;
mod watch;

use crate::client::Client;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::out::{Out, is_stream};
use crate::say;
#[cfg(unix)]
use crate::share;
use crate::simulate;
use crate::units::{self, PositionUnit, Quantity, SpeedUnit, Units};
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use config::Config;
use hallservo::commutation::Commutation;
use hallservo_protocol::Ask;
use motion::Target;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::time::Duration;

/// hallctl: talks to a hallservo drive
#[derive(Debug, Parser)]
#[command(version, about, after_help = EXIT_CODES)]
pub struct Arguments {
    /// Port of the drive: a serial port, a pseudo-terminal, or tcp:HOST:PORT [default: /dev/ttyACM0]
    #[arg(long, short, global = true, env = "HALLCTL_PORT", help_heading = OF_ALL)]
    port: Option<String>,
    /// Longest wait for an answer, in seconds on the wall: more for a virtual board on a slow machine [default: 3]
    #[arg(long, global = true, env = "HALLCTL_PATIENCE", value_name = "SECONDS", value_parser = units::whole::<u64>(1..=1_000_000), help_heading = OF_ALL)]
    patience: Option<u64>,
    /// Results as JSON, a value a line, in the units of the settings; a command that fails prints {"error": …}
    #[arg(long, global = true, help_heading = OF_ALL)]
    pub json: bool,
    /// Unit of speeds that are shown, and of those given without one [default: rad/s]
    #[arg(long, global = true, value_enum, help_heading = OF_ALL)]
    speed_unit: Option<SpeedUnit>,
    /// Unit of positions that are shown, and of those given without one [default: turns]
    #[arg(long, global = true, value_enum, help_heading = OF_ALL)]
    position_unit: Option<PositionUnit>,
    /// Without a process that shares the port: no other tool at the same time, none that stops the motor
    #[arg(long, global = true, hide = true)]
    alone: bool,
    #[command(subcommand)]
    command: Command,
}

impl Arguments {
    /// Those of a command line. What is wrong with it is said, and ends the process.
    pub fn read(line: impl IntoIterator<Item = OsString>) -> Self {
        let line: Vec<_> = line.into_iter().collect();
        Self::understood(&line).unwrap_or_else(|error| {
            if error.use_stderr() && line.iter().any(|word| word == "--json") {
                // A script reads the standard output. Nothing is left to be said where that fails.
                let _ = (Out { json: true, units: Units::default() }).value(&wrong_line(&error));
            }
            error.exit()
        })
    }

    fn understood(line: &[OsString]) -> std::result::Result<Self, clap::Error> {
        // A negative number is a value, and refused as one, wherever there is a place for it.
        let command = Self::command().mut_subcommands(|command| command.allow_negative_numbers(true));
        let arguments = Self::from_arg_matches(&command.try_get_matches_from(line)?)?;
        let port = arguments.port.as_ref().filter(|port| !port.is_empty());
        let told = port.is_some_and(|port| std::env::var("HALLCTL_PORT").as_ref() != Ok(port));
        if told && matches!(arguments.command, Command::Simulate(_)) {
            let where_to = "--port is that of a drive to talk to; where a simulated one listens is --listen";
            return Err(Self::command().error(ErrorKind::ArgumentConflict, where_to));
        }
        if arguments.command.files().into_iter().filter(|path| is_stream(path)).count() > 1 {
            let mixed = "one file at most can be -, the standard output: two would be mixed";
            return Err(Self::command().error(ErrorKind::ArgumentConflict, mixed));
        }
        Ok(arguments)
    }
}

/// What is wrong with a command line, as other errors are told to a script.
fn wrong_line(error: &clap::Error) -> Value {
    let text = error.to_string();
    let what = text.strip_prefix("error: ").unwrap_or(&text).split("\n\n").next().unwrap_or_default();
    json!({ "error": { "code": 2, "kind": "usage", "what": what } })
}

/// Heading of the options that every command has, below its own.
const OF_ALL: &str = "Options of all commands";

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 files and the like; 2 wrong command line; 3 no port, or it is gone; 4 no answer; 5 another version
of the protocol; 6 refused, also a value that cannot be; 7 begun, and came to nothing; 130 ended by Ctrl-C or a signal,
the bridge off if this tool controlled it, after 60 ms of braking: a fast or heavy motor coasts on, which is said.

Defaults for --port, --patience, --speed-unit and --position-unit may be in a file, config.toml, in the folder that
`hallctl config` names: port = \"/dev/ttyACM1\", speed_unit = \"rpm\".";

#[derive(Debug, Subcommand)]
enum Command {
    /// Who is there, and how it is
    Status,
    /// Stop: bridge off; ends whatever goes on. From any terminal, at any time
    #[command(visible_alias = "disarm")]
    Stop,
    /// Bridge on: the shaft is checked and held
    Arm,
    /// Take note of a fault
    Clear,
    /// Voltage as a fraction of the largest, −1 to 1, or 50%
    #[command(allow_negative_numbers = true)]
    Voltage {
        /// The voltage
        #[arg(value_parser = units::fraction)]
        value: Quantity,
        #[command(flatten)]
        options: motion::Options,
    },
    /// Torque, N·m, or 50mNm
    #[command(allow_negative_numbers = true)]
    Torque {
        /// The torque
        #[arg(value_parser = units::torque)]
        value: Quantity,
        #[command(flatten)]
        options: motion::Options,
    },
    /// Speed: 100, 100rad/s, 1000rpm, 10turns/s, 360deg/s
    #[command(allow_negative_numbers = true)]
    Speed {
        /// The speed
        #[arg(value_parser = units::speed)]
        value: Quantity,
        #[command(flatten)]
        options: motion::Options,
    },
    /// Position: 2.5, 2.5turns, 90deg, 3.1rad
    #[command(allow_negative_numbers = true)]
    Position {
        /// The position
        #[arg(value_parser = units::position)]
        value: Quantity,
        #[command(flatten)]
        options: motion::Options,
    },
    /// A spring and a damper at the shaft: where it is at rest, how stiff, how strong
    #[command(allow_negative_numbers = true)]
    Impedance(impedance::Options),
    /// How the phases are driven, until the power goes or `settings save`
    Commutation {
        /// The commutation
        kind: Kind,
    },
    /// Turn the rotor and find out what the Halls deliver, in the place of the calibration before and the map of the magnets
    Calibrate(procedures::Options),
    /// Measure the motor, calibrate the Halls and set the control: all that a new motor needs but its largest current
    Commission(commission::Options),
    /// Turn to and fro and measure the motor
    Identify(procedures::Options),
    /// Count the pole pairs while you turn the shaft by hand; after `calibrate`, with the bridge off
    PolePairs(pole_pairs::Options),
    /// What the magnets do to the teeth
    Cogging {
        /// Learn it by turning slowly, compensate it or not
        what: Cogging,
        #[command(flatten)]
        options: procedures::Options,
    },
    /// The rotor's magnets: a map of what they do to the angle
    #[command(subcommand)]
    Magnets(magnets::Command),
    /// What the field of the windings does to the angle: measure it by steps of the torque, and compensate it
    CoilField,
    /// The absolute encoder: two rings on the shaft
    #[command(subcommand)]
    Encoder(encoder::Command),
    /// List, read, change and keep settings
    #[command(subcommand)]
    Settings(settings::Command),
    /// Watch the drive, until Ctrl-C or for a while
    Telemetry(telemetry::Options),
    /// Record up to four channels at up to the control rate, about a trigger
    Record(record::Options),
    /// The drive, live: state, Halls with their swings for mounting, motion; `s` stops it
    Watch,
    /// How the motor follows a step of speed or position: rise, overshoot, settling
    Step(response::StepOptions),
    /// How it follows sines of speed or position: gain, phase, bandwidth, phase margin
    Sine(response::SineOptions),
    /// Frequency response of the current or the speed control: bandwidth, phase margin, beside the model's
    Chirp(chirp::Options),
    /// Try bandwidths of the speed control, and propose one
    Tune(tune::Options),
    /// What went wrong since power-up, and what to do
    Faults,
    /// Be a drive with a simulated motor
    Simulate(simulate::Options),
    /// Ports that may be boards
    List,
    /// Where the file with defaults is, and what it says
    Config,
    /// Completions for a shell, on the standard output
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Manual pages, into a folder
    Man {
        /// The folder
        folder: PathBuf,
    },
    /// Own a port for many tools
    #[command(hide = true)]
    Share,
}

impl Command {
    /// What is written beside the words.
    fn files(&self) -> Vec<&PathBuf> {
        match self {
            Self::Telemetry(options) => options.files().collect(),
            Self::Step(options) => options.files.files().collect(),
            Self::Sine(options) => options.files.files().collect(),
            Self::Record(options) => options.out.iter().collect(),
            Self::Chirp(options) => options.out.iter().collect(),
            _ => Vec::new(),
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    /// Six steps a turn
    Block,
    /// Three sines
    Sinusoidal,
    /// Currents in the frame of the rotor
    FieldOriented,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Cogging {
    /// Turn slowly both ways and learn it
    Learn,
    /// Compensate it
    On,
    /// Do not
    Off,
}

/// Does what the command line says.
///
/// # Errors
/// Each with its exit code.
pub fn run(arguments: &Arguments) -> Result<()> {
    let config = match Config::read() {
        // A motor that has to be stopped does not wait until a file is mended.
        Err(error) if matches!(arguments.command, Command::Stop) && arguments.port.is_some() => {
            crate::tell!("hallctl: {error}");
            Config::default()
        }
        config => config?,
    };
    let port = arguments.port.as_deref().or(config.port.as_deref()).unwrap_or(PORT);
    let patience = arguments.patience.or(config.patience.map(NonZeroU64::get)).unwrap_or(PATIENCE_S);
    let units = Units {
        speed: arguments.speed_unit.or(config.speed_unit).unwrap_or_default(),
        position: arguments.position_unit.or(config.position_unit).unwrap_or_default(),
    };
    let out = Out { json: arguments.json, units };
    match &arguments.command {
        Command::Simulate(options) => return Ok(simulate::main(options, out)?),
        Command::List => return list::list(out),
        Command::Config => return config.show(out),
        Command::Completions { shell } => return help::completions(*shell),
        Command::Man { folder } => return help::pages(folder),
        #[cfg(unix)]
        Command::Share => return Ok(share::main(port)?),
        _ => {}
    }
    // Whatever comes from here on, the motor is stopped before this process ends.
    interrupt::catch()?;
    let mut client = connect(port, Duration::from_secs(patience), arguments.alone)?;
    let result = obey(&mut client, &arguments.command, out);
    match result {
        Err(Error::Interrupted) if client.controls() => {
            client.carry_on();
            let braked = motion::brake(&mut client);
            client.order(Ask::Disarm)?;
            braked?;
            tell_what_is_left(&mut client, &arguments.command, out);
        }
        // The next command is another process. What does not answer is left to its time-out.
        Ok(()) | Err(Error::Refused(_) | Error::Failed(_)) => client.release()?,
        _ => {}
    }
    result
}

/// What a person who has broken something off has to know: a motor that is too fast or too heavy to be braked in a moment
/// is not at rest, and the calibration before is the one in use. A drive that does not answer has nothing to tell.
fn tell_what_is_left(client: &mut Client, command: &Command, out: Out) {
    let Ok(status) = client.status() else { return };
    if !status.mode.drives() && status.speed_rad_s.abs() > motion::AT_REST_RAD_S {
        let speed = out.units.speed(status.speed_rad_s);
        crate::tell!("hallctl: the motor is not at rest: it coasts, the bridge off, at {speed}");
    }
    if matches!(command, Command::Calibrate { .. }) {
        crate::tell!("hallctl: the calibration is broken off: the one before, if there was one, is in use again");
    }
}

/// The port where nobody says another.
const PORT: &str = "/dev/ttyACM0";
/// Longest wait for an answer, s.
const PATIENCE_S: u64 = 3;

/// By way of the process that owns the port, so that there may be other tools.
#[cfg(unix)]
fn connect(port: &str, patience: Duration, alone: bool) -> Result<Client> {
    if alone {
        return Client::connect(port, patience);
    }
    // What is wrong with it is not wrong with the port.
    share::folder()?;
    // One that was just about to end is followed by another.
    let mut attempts = 3;
    loop {
        let line = share::attach(port).map_err(|source| Error::Port { port: port.into(), source })?;
        attempts -= 1;
        match Client::over(line, port, patience) {
            Err(Error::Lost { .. }) if attempts > 0 => {}
            result => return result,
        }
    }
}

#[cfg(not(unix))]
fn connect(port: &str, patience: Duration, _: bool) -> Result<Client> {
    Client::connect(port, patience)
}

fn obey(client: &mut Client, command: &Command, out: Out) -> Result<()> {
    match command {
        Command::Status => status::show(client, out),
        Command::Arm => done(out, client.arm()),
        Command::Stop => {
            client.order(Ask::Disarm)?;
            say!(out, "the bridge is off")?;
            done(out, Ok(()))
        }
        Command::Clear => done(out, client.clear()),
        Command::Voltage { value, options } => {
            motion::hold(client, options, Target::Voltage(value.value(1.0) as f32), out)
        }
        Command::Torque { value, options } => {
            motion::hold(client, options, Target::Torque(value.value(1.0) as f32), out)
        }
        Command::Speed { value, options } => {
            motion::hold(client, options, Target::Speed(value.value(out.units.speed.rad_s()) as f32), out)
        }
        Command::Position { value, options } => {
            motion::hold(client, options, Target::Position(value.value(out.units.position.turns())), out)
        }
        Command::Impedance(options) => impedance::hold(client, options, out),
        Command::Commutation { kind } => {
            let commutation = match kind {
                Kind::Block => Commutation::Block,
                Kind::Sinusoidal => Commutation::Sinusoidal,
                Kind::FieldOriented => Commutation::FieldOriented,
            };
            done(out, client.setting(Ask::Commutate(commutation), |_| ()))
        }
        Command::Calibrate(options) => procedures::calibrate(client, options, out),
        Command::Commission(options) => commission::run(client, options, out),
        Command::Identify(options) => procedures::identify(client, options, out),
        Command::PolePairs(options) => pole_pairs::count(client, options, out),
        Command::Cogging { what: Cogging::Learn, options } => procedures::learn_cogging(client, options, out),
        Command::Cogging { what: Cogging::On, .. } => done(out, client.setting(Ask::AntiCogging(true), |_| ())),
        Command::Cogging { what: Cogging::Off, .. } => done(out, client.setting(Ask::AntiCogging(false), |_| ())),
        Command::Magnets(command) => magnets::run(client, command, out),
        Command::CoilField => coil::measure(client, out),
        Command::Encoder(command) => encoder::run(client, command, out),
        Command::Settings(command) => settings::run(client, command, out),
        Command::Telemetry(options) => telemetry::watch(client, options, out),
        Command::Record(options) => record::record(client, options, out),
        Command::Watch => watch::watch(client, out),
        Command::Step(options) => response::step(client, options, out),
        Command::Sine(options) => response::sine(client, options, out),
        Command::Chirp(options) => chirp::chirp(client, options, out),
        Command::Tune(options) => tune::tune(client, options, out).map(|_| ()),
        Command::Faults => faults::show(client, out),
        // These need no drive.
        Command::Simulate(_)
        | Command::List
        | Command::Config
        | Command::Completions { .. }
        | Command::Man { .. }
        | Command::Share => Ok(()),
    }
}

/// What says no more than that it was done.
fn done(out: Out, result: Result<()>) -> Result<()> {
    result.and_then(|()| out.value(&json!({ "done": true })))
}

/// A time that can pass, in seconds.
fn seconds(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e9 => Ok(seconds),
        _ => Err("a number of seconds above 0 is wanted".into()),
    }
}

/// Frames a second that a drive can send.
fn rate(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(hz) if hz > 0.0 && hz <= 1000.0 => Ok(hz),
        _ => Err("a number of frames a second is wanted, above 0 and up to 1000".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_rate_that_a_drive_can_send_is_asked_for() {
        for hz in ["0", "-1", "nan", "1e9", "1000.1", "fast"] {
            let wrong = format!("--hz={hz}");
            for command in [&["telemetry"][..], &["step", "speed", "10"], &["sine", "speed", "10"]] {
                let arguments = [&["hallctl"], command, &[&wrong]].concat();
                let error = Arguments::try_parse_from(arguments).unwrap_err().to_string();
                assert!(error.contains("up to 1000"), "{error}");
            }
        }
        assert_eq!((rate("1000"), rate("0.5")), (Ok(1000.0), Ok(0.5)));
    }

    #[test]
    fn only_a_time_that_can_pass_turns_a_motor() {
        for text in ["-1", "NaN", "0", "-0.0", "inf", "1e99", "", "1 s"] {
            assert!(seconds(text).is_err(), "{text}");
            for command in ["speed", "voltage", "torque", "position"] {
                assert!(Arguments::try_parse_from(["hallctl", command, "1", "--seconds", text]).is_err(), "{text}");
            }
            assert!(Arguments::try_parse_from(["hallctl", "telemetry", "--seconds", text]).is_err(), "{text}");
        }
        assert_eq!(seconds("0.5"), Ok(0.5));
        for command in [&["calibrate", "--unattended"][..], &["cogging", "learn", "--unattended"], &["voltage", "-1"]] {
            assert!(Arguments::try_parse_from([&["hallctl"], command].concat()).is_ok(), "{command:?}");
        }
    }
}
