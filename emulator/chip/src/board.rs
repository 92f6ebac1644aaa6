//! A board: which pin of the chip is wired to what. Read from the board's folder, `virtual.toml`.

mod file;

use crate::device::Device;
use crate::gpio::Pin;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What an analogue pin is wired to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Net {
    /// A linear Hall sensor, 0 to 2.
    Hall(usize),
    /// Shunt of a phase (0 to 2): gain in V/A of the current that comes up through it into the motor, and V without.
    Shunt {
        /// Phase.
        phase: usize,
        /// V/A, negative: current into the motor pulls the shunt below ground.
        gain: f64,
        /// V without current.
        zero: f64,
    },
    /// The bus, divided.
    Bus(f64),
    /// An NTC of 10 kΩ (B = 3425 K) at 25 °C to 3.3 V, against this resistor to ground.
    Ntc(f64),
    /// A potentiometer, in the middle.
    Potentiometer,
    /// A head over a magnetised ring of an encoder, both counted from 0: the angle within the pole pair, as a share of
    /// the supply.
    Head(usize, usize),
}

/// A gate driver with an interlock: both inputs on are both outputs off.
#[derive(Clone, Debug, PartialEq)]
pub struct Driver {
    /// Its name.
    pub name: String,
    /// The low-side input is active low.
    pub low_inverted: bool,
    /// From one output off to the other on, at least, s.
    pub own_dead_time_s: f64,
    /// How much longer a transistor takes to go off than to go on, s: less dead time is shoot-through.
    pub overlap_s: f64,
    /// All outputs float unless this pin is high.
    pub standby: Option<Pin>,
}

/// What the firmware on a board promises, beyond what holds for all; the tests of the virtual boards look at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promises {
    /// Outside of it the drive switches off, V.
    pub bus_v: [f64; 2],
    /// From this magnitude of a phase's current on a sample switches it off, A.
    pub over_current_a: f64,
    /// From this current down through a shunt on, the hardware switches off without code, A.
    pub trip_a: f64,
    /// Cycles of the control interrupt at 40 kHz while it turns field-oriented, in the mean and at most, and at most
    /// whatever it does.
    pub control_cycles: [u64; 3],
    /// Lowest and highest switching frequency that it may be set to, with the settings of its motor as they come, Hz.
    pub pwm_hz: [f64; 2],
    /// The same cycles of the firmware for two rings on the shaft, where there is one.
    pub encoder_cycles: Option<[u64; 3]>,
}

/// A CAN transceiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transceiver {
    /// TX and RX of the chip.
    pub pins: [Pin; 2],
    /// It is off unless this pin is low.
    pub shutdown: Option<Pin>,
    /// From TX to the wires and back to RX, s.
    pub loop_s: f64,
    /// Whether it needs a firmware of its own, as one has no room for everything.
    pub own_firmware: bool,
}

/// A board.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// That of its folder.
    pub name: String,
    /// Its chip.
    pub device: Device,
    /// Pins at the driver: high and low side of each leg.
    pub gates: [[Pin; 2]; 3],
    /// The driver.
    pub driver: Driver,
    /// Analogue pins, with the resistance of what drives them, Ω.
    pub analog: Vec<(Pin, Net, f64)>,
    /// Serial port: TX and RX of the chip.
    pub serial: [Pin; 2],
    /// Pin that the board pulls low at over-current, and A at which it does: current down through a shunt.
    pub trip: Option<(Pin, f64)>,
    /// Input with a contact to 3.3 V: open, it floats.
    pub enable: Option<Pin>,
    /// Output that switches a resistor across the bus, and its resistance, Ω. It has a pull-down.
    pub brake: Option<(Pin, f64)>,
    /// Transceiver of a CAN, on the board or wired to its pins.
    pub can: Option<Transceiver>,
    /// Inputs with a pull-up on the board: buttons.
    pub pulled_up: Vec<Pin>,
    /// Pole pairs of the two rings of an encoder, where there are heads.
    pub rings: Option<[usize; 2]>,
    /// What its firmware promises.
    pub promises: Promises,
}

/// What is wrong with a board's description.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// The file, or the folder.
    pub path: PathBuf,
    /// What is wrong with it, and at which key.
    pub what: String,
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.what)
    }
}

impl std::error::Error for Error {}

/// Baud rate of whoever is at the other end of the serial port.
pub const BAUD: f64 = 460_800.0;

/// Name of the file in a board's folder.
pub const FILE: &str = "virtual.toml";

impl Board {
    /// All boards of a folder, by name: each of its folders with a description is one.
    ///
    /// # Errors
    /// A folder that cannot be read, or the first description that is wrong.
    pub fn all(boards: &Path) -> Result<Vec<Arc<Board>>, Error> {
        Board::names(boards)?.iter().map(|name| Board::load(&boards.join(name))).collect()
    }

    /// Their names, in order.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn names(boards: &Path) -> Result<Vec<String>, Error> {
        let entries = std::fs::read_dir(boards)
            .map_err(|error| Error { path: boards.into(), what: format!("cannot be read: {error}") })?;
        let described = entries.flatten().filter(|entry| entry.path().join(FILE).is_file());
        let mut names: Vec<_> = described.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        Ok(names)
    }

    /// The board that a folder describes.
    ///
    /// # Errors
    /// A file that cannot be read, or what is wrong in it.
    pub fn load(folder: &Path) -> Result<Arc<Board>, Error> {
        let path = folder.join(FILE);
        let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let text = std::fs::read_to_string(&path).map_err(|error| format!("cannot be read: {error}"));
        let board = text.and_then(|text| Board::parse(&name, &text));
        board.map(Arc::new).map_err(|what| Error { path, what })
    }

    /// What an analogue pin is wired to.
    pub fn net(&self, pin: Pin) -> Option<(Net, f64)> {
        self.analog.iter().find(|(at, ..)| *at == pin).map(|(_, net, ohm)| (*net, *ohm))
    }
}
