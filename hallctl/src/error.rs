//! What can go wrong between a person and a drive, each with an exit code of its own.

use crate::interrupt;
use hallservo_protocol::VERSION;
use serde_json::{Value, json};
use std::fmt;

/// Why a command came to nothing.
#[derive(Debug)]
pub enum Error {
    /// The port cannot be opened.
    Port {
        /// Its name.
        port: String,
        /// Why.
        source: std::io::Error,
    },
    /// The port is gone, or who is at its other end.
    Lost {
        /// Its name.
        port: String,
        /// Why.
        source: std::io::Error,
    },
    /// Nothing came back, or nothing that makes sense.
    Silent {
        /// The port.
        port: String,
        /// Whether anything came at all.
        garbage: bool,
    },
    /// Another version of the protocol.
    Version {
        /// That of the drive.
        found: u8,
    },
    /// The drive refused; why, and what to do.
    Refused(String),
    /// It began and came to nothing; why, and what to do.
    Failed(String),
    /// A signal came, Ctrl-C for instance.
    Interrupted,
    /// Files and the like.
    Other(anyhow::Error),
}

/// What a command returns.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// 1 files and the like, 3 no port or a lost one, 4 no answer, 5 another version, 6 refused, 7 failed, 130 ended by a signal; 2 is a wrong
    /// command line.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Other(_) => 1,
            Self::Port { .. } | Self::Lost { .. } => 3,
            Self::Silent { .. } => 4,
            Self::Version { .. } => 5,
            Self::Refused(_) => 6,
            Self::Failed(_) => 7,
            Self::Interrupted => interrupt::EXIT,
        }
    }
}

impl Error {
    /// In a word, for a script.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Other(_) => "other",
            Self::Port { .. } | Self::Lost { .. } => "port",
            Self::Silent { .. } => "silent",
            Self::Version { .. } => "version",
            Self::Refused(_) => "refused",
            Self::Failed(_) => "failed",
            Self::Interrupted => "interrupted",
        }
    }

    /// All of it for a script.
    pub fn value(&self) -> Value {
        json!({ "error": { "code": self.code(), "kind": self.kind(), "what": self.to_string() } })
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port { port, .. } if port.is_empty() => {
                f.write_str("the name of the port is empty: see --port and the environment variable HALLCTL_PORT")
            }
            Self::Port { port, source } => {
                write!(f, "cannot open {port}: {source}\n  {}", advice(port, source))
            }
            Self::Lost { port, source } => write!(
                f,
                "the connection to {port} is lost: {source}\n  Was it unplugged, or its power switched off? Where the drive \
                 has power, the motor comes to rest after command_timeout_s."
            ),
            Self::Silent { port, garbage: false } => write!(
                f,
                "no answer from {port}\n  Is it powered, is the firmware running, and is this its port? Another \
                 program may have the port open."
            ),
            Self::Silent { port, garbage: true } => write!(
                f,
                "what comes from {port} is not the protocol of a hallservo drive\n  Another device, another baud \
                 rate, or another program on the same port?"
            ),
            Self::Version { found } => {
                write!(f, "the drive speaks version {found} of the protocol, this hallctl version {VERSION}\n  ")?;
                let older = if *found < VERSION { "the drive's firmware" } else { "hallctl" };
                write!(f, "Update {older}.")
            }
            Self::Refused(why) => write!(f, "refused: {why}"),
            Self::Failed(why) => f.write_str(why),
            Self::Interrupted => f.write_str("interrupted"),
            Self::Other(error) => write!(f, "{error:#}"),
        }
    }
}

/// What to do about a port that cannot be opened.
fn advice(port: &str, source: &std::io::Error) -> String {
    let is_number = |text: &str| text.parse::<u16>().is_ok();
    match port.strip_prefix("tcp:") {
        Some(address) if !address.rsplit_once(':').is_some_and(|(_, number)| is_number(number)) => {
            "An address is tcp:HOST:PORT, like tcp:127.0.0.1:35993.".into()
        }
        Some(address) if address.starts_with("//") => format!("Without slashes: tcp:{}", address.trim_matches('/')),
        Some(_) => "Is what listens there still running? `hallctl simulate` and a virtual board say their ports, like \
                    tcp:127.0.0.1:35993."
            .into(),
        None if port.rsplit_once(':').is_some_and(|(_, number)| is_number(number)) => {
            format!("An address begins with tcp: tcp:{port}")
        }
        None if source.raw_os_error() == Some(NOT_A_TERMINAL) => "It is no serial port.".into(),
        None => {
            "Is the board plugged in? `ls /dev/ttyACM*` shows its port, and a simulated drive says its own, for --port \
                 or HALLCTL_PORT. Your user may need the group `dialout`."
                .into()
        }
    }
}

/// ENOTTY, of what takes no baud rate.
const NOT_A_TERMINAL: i32 = 25;

impl std::error::Error for Error {}

impl From<anyhow::Error> for Error {
    fn from(error: anyhow::Error) -> Self {
        Self::Other(error)
    }
}
