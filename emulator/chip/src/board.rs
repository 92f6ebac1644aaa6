//! The boards: which pin is wired to what.

use crate::device::Device;
use crate::gpio::Pin;

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
}

/// A gate driver with an interlock: both inputs on are both outputs off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driver {
    /// Its name.
    pub name: &'static str,
    /// The low-side input is active low.
    pub low_inverted: bool,
    /// From one output off to the other on, at least, s.
    pub own_dead_time_s: f64,
    /// How much longer a transistor takes to go off than to go on, s: less dead time is shoot-through.
    pub overlap_s: f64,
}

/// A board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// As on the command line.
    pub name: &'static str,
    /// Its chip.
    pub device: Device,
    /// Pins at the driver: high and low side of each leg.
    pub gates: [[Pin; 2]; 3],
    /// The driver.
    pub driver: Driver,
    /// Analogue pins, with the resistance of what drives them, Ω.
    pub analog: &'static [(Pin, Net, f64)],
    /// Serial port: TX and RX of the chip.
    pub serial: [Pin; 2],
    /// Pin that the board pulls low at over-current, and A at which it does: current down through a shunt.
    pub trip: Option<(Pin, f64)>,
    /// Inputs with a pull-up on the board: buttons.
    pub pulled_up: &'static [Pin],
}

/// Baud rate of whoever is at the other end of the serial port.
pub const BAUD: f64 = 460_800.0;

const fn a(number: u8) -> Pin {
    Pin::of(b'A', number)
}
const fn b(number: u8) -> Pin {
    Pin::of(b'B', number)
}
const fn c(number: u8) -> Pin {
    Pin::of(b'C', number)
}

/// 10 mΩ, amplified 5.18 times about 1.71 V.
const fn shield(phase: usize) -> Net {
    Net::Shunt { phase, gain: -0.010 * 5.18, zero: 1.71 }
}

/// 3 mΩ through 1.5 kΩ, against 2.2 kΩ to ground and 22 kΩ to 3.3 V: 4/7 of it and 3/70 of 3.3 V · 10/11.
const fn input(phase: usize) -> Net {
    let conductance = 1.0 / 1500.0 + 1.0 / 2200.0 + 1.0 / 22_000.0;
    Net::Shunt { phase, gain: -0.003 / 1500.0 / conductance, zero: 3.3 / 22_000.0 / conductance }
}

/// Nucleo-G474RE with the X-NUCLEO-IHM08M1 (UM1996): L6398, amplifiers and over-current comparators on the shield.
pub const NUCLEO_IHM08M1: Board = Board {
    name: "nucleo-g474re-ihm08m1",
    device: Device::G474,
    gates: [[a(8), a(7)], [a(9), b(0)], [a(10), b(1)]],
    // DS7145: 320 ns of dead time and an interlock inside.
    driver: Driver { name: "L6398", low_inverted: true, own_dead_time_s: 320e-9, overlap_s: 60e-9 },
    analog: &[
        (a(0), shield(0), 100.0),
        (c(1), shield(1), 100.0),
        (c(0), shield(2), 100.0),
        (a(1), Net::Bus(9.31 / (9.31 + 169.0)), 8_824.0),
        (c(2), Net::Ntc(4_700.0), 3_200.0),
        (a(4), Net::Potentiometer, 2_500.0),
        (b(12), Net::Hall(0), 100.0),
        (b(13), Net::Hall(1), 100.0),
        (b(14), Net::Hall(2), 100.0),
    ],
    serial: [a(2), a(3)],
    trip: Some((a(6), 30.0)),
    pulled_up: &[c(13)],
};

/// B-G431B-ESC1 (UM2516): L6387, three shunts at the chip's op-amps, linear Halls in place of the back-EMF dividers.
pub const B_G431B_ESC1: Board = Board {
    name: "b-g431b-esc1",
    device: Device::G431,
    gates: [[a(8), c(13)], [a(9), a(12)], [a(10), b(15)]],
    // DS2243: an interlock, and no dead time. STL180N6F7 with its gate resistors goes off later than it goes on.
    driver: Driver { name: "L6387", low_inverted: false, own_dead_time_s: 0.0, overlap_s: 60e-9 },
    analog: &[
        (a(1), input(0), 860.0),
        (a(7), input(1), 860.0),
        (b(0), input(2), 860.0),
        (a(0), Net::Bus(18.0 / 187.0), 16_267.0),
        (b(14), Net::Ntc(4_700.0), 3_200.0),
        (b(12), Net::Potentiometer, 2_500.0),
        (a(4), Net::Hall(0), 100.0),
        (c(4), Net::Hall(1), 100.0),
        (b(11), Net::Hall(2), 100.0),
    ],
    serial: [b(3), b(4)],
    trip: None,
    pulled_up: &[c(10)],
};

impl Board {
    /// Both.
    pub const ALL: [&'static Board; 2] = [&NUCLEO_IHM08M1, &B_G431B_ESC1];

    /// The board of a name.
    pub fn named(name: &str) -> Option<&'static Board> {
        Self::ALL.into_iter().find(|board| board.name == name)
    }

    /// What an analogue pin is wired to.
    pub fn net(&self, pin: Pin) -> Option<(Net, f64)> {
        self.analog.iter().find(|(at, ..)| *at == pin).map(|(_, net, ohm)| (*net, *ohm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_resistors_of_the_small_board_give_what_its_documents_say() {
        let Net::Shunt { gain, zero, .. } = input(0) else { unreachable!() };
        assert!((16.0 * gain / 0.003 + 64.0 / 7.0).abs() < 1e-9, "a net gain of -9.14");
        assert!((zero - 0.12857).abs() < 1e-5);
    }

    #[test]
    fn every_gate_pin_can_carry_its_signal() {
        for board in Board::ALL {
            for (leg, pins) in board.gates.iter().enumerate() {
                for (side, pin) in pins.iter().enumerate() {
                    let signal = crate::device::Signal::Gate(leg, side);
                    assert!(board.device.alternate(*pin, signal).is_some(), "{} {pin}", board.name);
                }
            }
        }
    }
}
