//! The description as TOML. What it may hold, by an example with every key:
//!
//! ```toml
#![doc = include_str!("example.toml")]
//! ```

use super::{Board, Driver, Net, Promises, Transceiver};
use crate::device::{Device, Signal};
use crate::gpio::Pin;
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    chip: Device,
    serial: Serial,
    driver: DriverFile,
    gates: Phases<[Pin; 2]>,
    trip: Option<Trip>,
    enable: Option<Pin>,
    brake: Option<Brake>,
    rings: Option<[usize; 2]>,
    can: Option<Can>,
    #[serde(default)]
    pulled_up: Vec<Pin>,
    analog: BTreeMap<Pin, Analog>,
    promises: PromisesFile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Serial {
    tx: Pin,
    rx: Pin,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Can {
    tx: Pin,
    rx: Pin,
    shutdown: Option<Pin>,
    loop_ns: f64,
    #[serde(default)]
    own_firmware: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DriverFile {
    name: String,
    #[serde(default)]
    low_inverted: bool,
    own_dead_time_ns: f64,
    overlap_ns: f64,
    standby: Option<Pin>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)]
struct Phases<T> {
    U: T,
    V: T,
    W: T,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Trip {
    pin: Pin,
    amperes: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Brake {
    pin: Pin,
    ohm: f64,
}

#[derive(Clone, Copy, Deserialize)]
enum Phase {
    U,
    V,
    W,
}

/// Exactly one of the first six.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Analog {
    hall: Option<usize>,
    current: Option<Phase>,
    bus: Option<f64>,
    ntc_ohm: Option<f64>,
    #[serde(default)]
    potentiometer: bool,
    ring: Option<usize>,
    head: Option<usize>,
    volts_per_ampere: Option<f64>,
    zero_v: Option<f64>,
    source_ohm: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PromisesFile {
    bus_v: [f64; 2],
    over_current_a: f64,
    trip_a: f64,
    control_cycles: [u64; 3],
    pwm_hz: [f64; 2],
    encoder_cycles: Option<[u64; 3]>,
}

impl Analog {
    fn net(&self) -> Result<Net, String> {
        let nets = [
            self.hall.map(hall),
            self.current.map(|phase| self.shunt(phase)),
            self.bus.map(|share| positive("bus", share).map(Net::Bus)),
            self.ntc_ohm.map(|ohm| positive("ntc_ohm", ohm).map(Net::Ntc)),
            self.potentiometer.then_some(Ok(Net::Potentiometer)),
            self.ring.map(|ring| head(ring, self.head)),
        ];
        if self.ring.is_none() && self.head.is_some() {
            return Err("a head belongs to a ring".into());
        }
        if self.current.is_none() && (self.volts_per_ampere.is_some() || self.zero_v.is_some()) {
            return Err("volts_per_ampere and zero_v belong to a current".into());
        }
        let mut nets = nets.into_iter().flatten();
        match (nets.next(), nets.next()) {
            (Some(net), None) => net,
            _ => Err("is one of hall, current, bus, ntc_ohm, potentiometer, ring".into()),
        }
    }

    fn shunt(&self, phase: Phase) -> Result<Net, String> {
        let (Some(gain), Some(zero)) = (self.volts_per_ampere, self.zero_v) else {
            return Err("a current takes volts_per_ampere and zero_v".into());
        };
        if !gain.is_finite() || gain == 0.0 || !zero.is_finite() {
            return Err("volts_per_ampere and zero_v are numbers, the first not zero".into());
        }
        Ok(Net::Shunt { phase: phase as usize, gain, zero })
    }
}

fn hall(number: usize) -> Result<Net, String> {
    match number {
        1..=3 => Ok(Net::Hall(number - 1)),
        _ => Err(format!("Halls are 1, 2 and 3, not {number}")),
    }
}

fn head(ring: usize, head: Option<usize>) -> Result<Net, String> {
    match (ring, head) {
        (1..=2, Some(head @ 1..=2)) => Ok(Net::Head(ring - 1, head - 1)),
        _ => Err("rings are 1 and 2, and so are the heads of each".into()),
    }
}

fn positive(key: &str, value: f64) -> Result<f64, String> {
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("{key} is a number above 0, not {value}")) }
}

fn not_negative(key: &str, value: f64) -> Result<f64, String> {
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err(format!("{key} is a number from 0 on, not {value}")) }
}

impl Board {
    /// A board of a name, from its description.
    ///
    /// # Errors
    /// What is wrong, with the key.
    pub fn parse(name: &str, text: &str) -> Result<Board, String> {
        let file: File = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        let mut analog = Vec::new();
        for (pin, entry) in &file.analog {
            let at = |what| format!("analog.{pin}: {what}");
            let ohm = positive("source_ohm", entry.source_ohm).map_err(at)?;
            analog.push((*pin, entry.net().map_err(at)?, ohm));
        }
        let DriverFile { name: driver, low_inverted, own_dead_time_ns, overlap_ns, standby } = file.driver;
        let PromisesFile { bus_v, over_current_a, trip_a, control_cycles, pwm_hz, encoder_cycles } = file.promises;
        let board = Board {
            name: name.into(),
            device: file.chip,
            gates: [file.gates.U, file.gates.V, file.gates.W],
            driver: Driver {
                name: driver,
                low_inverted,
                own_dead_time_s: not_negative("driver.own_dead_time_ns", own_dead_time_ns)? * 1e-9,
                overlap_s: not_negative("driver.overlap_ns", overlap_ns)? * 1e-9,
                standby,
            },
            analog,
            serial: [file.serial.tx, file.serial.rx],
            trip: match file.trip {
                Some(Trip { pin, amperes }) => Some((pin, positive("trip.amperes", amperes)?)),
                None => None,
            },
            enable: file.enable,
            brake: match file.brake {
                Some(Brake { pin, ohm }) => Some((pin, positive("brake.ohm", ohm)?)),
                None => None,
            },
            rings: file.rings,
            can: match file.can {
                Some(Can { tx, rx, shutdown, loop_ns, own_firmware }) => {
                    let loop_s = positive("can.loop_ns", loop_ns)? * 1e-9;
                    Some(Transceiver { pins: [tx, rx], shutdown, loop_s, own_firmware })
                }
                None => None,
            },
            pulled_up: file.pulled_up,
            promises: Promises {
                bus_v: [positive("promises.bus_v", bus_v[0])?, positive("promises.bus_v", bus_v[1])?],
                over_current_a: positive("promises.over_current_a", over_current_a)?,
                trip_a: positive("promises.trip_a", trip_a)?,
                control_cycles,
                pwm_hz: [positive("promises.pwm_hz", pwm_hz[0])?, positive("promises.pwm_hz", pwm_hz[1])?],
                encoder_cycles,
            },
        };
        board.check()?;
        Ok(board)
    }

    /// Every pin can carry what it is wired to, and all three Halls and currents are there.
    fn check(&self) -> Result<(), String> {
        let device = self.device;
        for (leg, (pins, phase)) in self.gates.iter().zip(["U", "V", "W"]).enumerate() {
            for (side, pin) in pins.iter().enumerate() {
                if device.alternate(*pin, Signal::Gate(leg, side)).is_none() {
                    let name = ["", "N"][side];
                    return Err(format!("gates.{phase}: {pin} of the {device} cannot be TIM1_CH{}{name}", leg + 1));
                }
            }
        }
        let ports = 0..4;
        let carries =
            |pin, signal: fn(usize) -> Signal| ports.clone().any(|port| device.alternate(pin, signal(port)).is_some());
        for (key, pin, signal) in
            [("tx", self.serial[0], Signal::Tx as fn(usize) -> Signal), ("rx", self.serial[1], Signal::Rx)]
        {
            if !carries(pin, signal) {
                return Err(format!(
                    "serial.{key}: no serial port of the {device} has its {} at {pin}",
                    key.to_uppercase()
                ));
            }
        }
        for (key, at, signal) in [("tx", 0, Signal::CanTx), ("rx", 1, Signal::CanRx)] {
            if let Some(pin) = self.can.map(|can| can.pins[at]).filter(|pin| device.alternate(*pin, signal).is_none()) {
                return Err(format!("can.{key}: {pin} of the {device} cannot be FDCAN1_{}", key.to_uppercase()));
            }
        }
        let heads = self.analog.iter().any(|(_, net, _)| matches!(net, Net::Head(..)));
        if heads != self.rings.is_some_and(|rings| rings.iter().all(|pairs| (1..=64).contains(pairs))) {
            return Err("rings: two numbers of pole pairs, 1 to 64, where there are heads over them".into());
        }
        for (index, phase) in ["U", "V", "W"].iter().enumerate() {
            if !self.analog.iter().any(|(_, net, _)| *net == Net::Hall(index)) {
                return Err(format!("analog: no pin has hall = {}", index + 1));
            }
            if !self.analog.iter().any(|(_, net, _)| matches!(net, Net::Shunt { phase, .. } if *phase == index)) {
                return Err(format!("analog: no pin has current = \"{phase}\""));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = include_str!("example.toml");

    #[test]
    fn the_example_is_a_board() {
        let board = Board::parse("example", EXAMPLE).unwrap();
        assert_eq!(board.device, Device::G474RE);
        assert_eq!(board.gates[1], [Pin::of(b'A', 9), Pin::of(b'B', 0)]);
        assert_eq!(board.net(Pin::of(b'C', 1)), Some((Net::Shunt { phase: 1, gain: -0.05, zero: 1.7 }, 100.0)));
        assert_eq!(board.trip, Some((Pin::of(b'A', 6), 30.0)));
        assert_eq!(board.enable, Some(Pin::of(b'C', 12)));
        assert_eq!(board.brake, Some((Pin::of(b'C', 10), 10.0)));
    }

    /// Each mistake is told with the key, or the line, at which it is.
    #[test]
    fn mistakes_are_named() {
        for (from, to, named) in [
            (
                "chip = \"STM32G474RE\"",
                "chip = \"STM32F405\"",
                "expected one of `STM32G431CB`, `STM32G431RB`, `STM32G474RE`",
            ),
            ("[serial]", "[cereal]", "unknown field `cereal`"),
            ("[\"PA9\", \"PB0\"]", "[\"PA9\", \"PB3\"]", "gates.V: PB3 of the STM32G474RE cannot be TIM1_CH2N"),
            ("tx = \"PA2\"", "tx = \"PA4\"", "serial.tx: no serial port"),
            ("tx = \"PB9\"", "tx = \"PB7\"", "can.tx: PB7 of the STM32G474RE cannot be FDCAN1_TX"),
            ("loop_ns = 150", "loop_ns = 0", "can.loop_ns is a number above 0, not 0"),
            ("tx = \"PA2\"", "tx = \"A2\"", "a pin is like PA8, not \"A2\""),
            ("PB12 = { hall = 1,", "PB12 = { hall = 4,", "analog.PB12: Halls are 1, 2 and 3, not 4"),
            ("PB12 = { hall = 1,", "PB12 = { hall = 2,", "analog: no pin has hall = 1"),
            ("PB12 = { hall = 1,", "PB12 = { hall = 1, bus = 0.1,", "analog.PB12: is one of hall"),
            ("current = \"V\", volts_per_ampere = -0.05,", "current = \"V\",", "analog.PC1: a current takes"),
            ("source_ohm = 8800", "source_ohm = nan", "analog.PA1: source_ohm is a number above 0"),
            ("amperes = 30", "amperes = -30", "trip.amperes is a number above 0, not -30"),
            ("\nohm = 10\n", "\nohm = 0\n", "brake.ohm is a number above 0, not 0"),
            ("own_dead_time_ns = 320", "own_dead_time = 320", "unknown field `own_dead_time`"),
        ] {
            assert!(EXAMPLE.contains(from), "{from}");
            let error = Board::parse("example", &EXAMPLE.replace(from, to)).unwrap_err();
            assert!(error.contains(named), "{to}: {error}");
        }
    }
}
