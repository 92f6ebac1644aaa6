//! The command line.

mod commission;
mod encoder;
mod faults;
mod motion;
mod pole_pairs;
mod procedures;
mod settings;
mod status;
mod telemetry;

use crate::client::Client;
use crate::error::{Error, Result};
use crate::simulate::serve;
use clap::{Parser, Subcommand, ValueEnum};
use hallservo::commutation::Commutation;
use hallservo_protocol::Ask;
use std::path::PathBuf;
use std::time::Duration;

/// hallctl: talks to a hallservo drive
#[derive(Debug, Parser)]
#[command(version, about)]
pub struct Arguments {
    /// Port of the drive: a serial port, a pseudo-terminal, or tcp:HOST:PORT
    #[arg(long, short, global = true, default_value = "/dev/ttyACM0", env = "HALLCTL_PORT")]
    pub port: String,
    /// Longest wait for an answer, in seconds on the wall: more for a virtual board on a slow machine
    #[arg(long, global = true, default_value_t = 3, env = "HALLCTL_PATIENCE", value_name = "SECONDS")]
    patience: u64,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Who is there, and how it is
    Status,
    /// Bridge on, command zero
    Arm,
    /// Bridge off; ends whatever goes on
    Disarm,
    /// Take note of a fault
    Clear,
    /// Voltage as a fraction of the largest, −1 to 1
    #[command(allow_negative_numbers = true)]
    Voltage(motion::Options<f32>),
    /// Torque, N·m
    #[command(allow_negative_numbers = true)]
    Torque(motion::Options<f32>),
    /// Speed, rad/s
    #[command(allow_negative_numbers = true)]
    Speed(motion::Options<f32>),
    /// Position, turns
    #[command(allow_negative_numbers = true)]
    Position(motion::Options<f64>),
    /// How the phases are driven, until the power goes or `settings save`
    Commutation {
        /// The commutation
        kind: Kind,
    },
    /// Turn the rotor and find out what the Halls deliver
    Calibrate(procedures::Options),
    /// Measure the motor, calibrate the Halls and set the control: all that a new motor needs but its largest current
    Commission(commission::Options),
    /// Turn to and fro and measure the motor
    Identify(procedures::Options),
    /// Count the pole pairs while you turn the shaft by hand; after `calibrate`, with the bridge off
    PolePairs {
        /// Turns of the shaft: one tells up to 14 pole pairs, five tell all
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
        turns: u8,
    },
    /// What the magnets do to the teeth
    Cogging {
        /// Learn it by turning slowly, compensate it or not
        what: Cogging,
        #[command(flatten)]
        options: procedures::Options,
    },
    /// The absolute encoder: two rings on the shaft
    #[command(subcommand)]
    Encoder(encoder::Command),
    /// List, read, change and keep settings
    #[command(subcommand)]
    Settings(settings::Command),
    /// Watch the drive
    Telemetry(telemetry::Options),
    /// What went wrong since power-up, and what to do
    Faults,
    /// Be a drive with a simulated motor
    Simulate(serve::Options),
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
    if let Command::Simulate(options) = &arguments.command {
        return Ok(serve::main(options)?);
    }
    let mut client = Client::connect(&arguments.port, Duration::from_secs(arguments.patience))?;
    let result = obey(&mut client, &arguments.command);
    // The next command is another process. What does not answer is left to its time-out.
    if matches!(result, Ok(()) | Err(Error::Refused(_) | Error::Failed(_))) {
        client.release()?;
    }
    result
}

fn obey(client: &mut Client, command: &Command) -> Result<()> {
    match command {
        Command::Simulate(_) => Ok(()),
        Command::Status => status::show(client),
        Command::Arm => client.order(Ask::Arm),
        Command::Disarm => client.order(Ask::Disarm),
        Command::Clear => client.order(Ask::Clear),
        Command::Voltage(options) => {
            motion::hold(client, options, Ask::Voltage(options.value), Some(Ask::Voltage(0.0)))
        }
        Command::Torque(options) => motion::hold(client, options, Ask::Torque(options.value), Some(Ask::Torque(0.0))),
        Command::Speed(options) => motion::hold(client, options, Ask::Speed(options.value), Some(Ask::Speed(0.0))),
        Command::Position(options) => motion::hold(client, options, Ask::Position(options.value), None),
        Command::Commutation { kind } => {
            let commutation = match kind {
                Kind::Block => Commutation::Block,
                Kind::Sinusoidal => Commutation::Sinusoidal,
                Kind::FieldOriented => Commutation::FieldOriented,
            };
            client.setting(Ask::Commutate(commutation), |_| ())
        }
        Command::Calibrate(options) => procedures::calibrate(client, options),
        Command::Commission(options) => commission::run(client, options),
        Command::Identify(options) => procedures::identify(client, options),
        Command::PolePairs { turns } => pole_pairs::count(client, *turns),
        Command::Cogging { what: Cogging::Learn, options } => procedures::learn_cogging(client, options),
        Command::Cogging { what: Cogging::On, .. } => client.setting(Ask::AntiCogging(true), |_| ()),
        Command::Cogging { what: Cogging::Off, .. } => client.setting(Ask::AntiCogging(false), |_| ()),
        Command::Encoder(command) => encoder::run(client, command),
        Command::Settings(command) => settings::run(client, command),
        Command::Telemetry(options) => telemetry::watch(client, options),
        Command::Faults => faults::show(client),
    }
}

/// A time that can pass, in seconds.
fn seconds(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e9 => Ok(seconds),
        _ => Err("a number of seconds above 0 is wanted".into()),
    }
}

/// A file that a person gave for writing, tried before the work begins.
fn writable(path: Option<&PathBuf>) -> Result<()> {
    use anyhow::Context;
    if let Some(path) = path {
        std::fs::write(path, "").with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

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
