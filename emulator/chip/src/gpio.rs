//! General-purpose pins (RM0440, chapter 9).

use crate::bits::{bit, field, unmodelled, wrong};
use bus::Complaint;
use serde::Deserialize;

/// Names of the ports.
pub const PORTS: [&str; 7] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG"];

/// A pin of the package, such as PA8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(try_from = "String")]
pub struct Pin {
    /// 0 is port A.
    pub port: u8,
    /// 0 to 15.
    pub number: u8,
}

impl Pin {
    /// `Pin::of(b'A', 8)` is PA8.
    pub const fn of(port: u8, number: u8) -> Self {
        Self { port: port - b'A', number }
    }
}

impl TryFrom<String> for Pin {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let pin = match name.as_bytes() {
            [b'P', port @ b'A'..=b'G', digits @ ..] => {
                let number = core::str::from_utf8(digits).ok().and_then(|digits| digits.parse().ok());
                number.filter(|number| *number < 16).map(|number| Self::of(*port, number))
            }
            _ => None,
        };
        pin.filter(|pin| pin.to_string() == name).ok_or_else(|| format!("a pin is like PA8, not {name:?}"))
    }
}

impl core::fmt::Display for Pin {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "P{}{}", char::from(b'A' + self.port), self.number)
    }
}

/// What MODER makes of a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Read by the firmware.
    Input,
    /// Driven by ODR; open-drain where `true`.
    Output {
        /// OTYPER.
        open_drain: bool,
    },
    /// Given to the peripheral of this number.
    Alternate(u8),
    /// Schmitt trigger off.
    Analog,
}

/// A port.
#[derive(Clone, Debug)]
pub struct Gpio {
    name: &'static str,
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u32,
    lckr: u32,
    afr: [u32; 2],
    lock_step: u8,
}

impl Gpio {
    /// As reset leaves it: everything analogue but the debug pins (9.4).
    pub fn new(port: usize) -> Self {
        let (moder, ospeedr, pupdr) = match port {
            0 => (0xabff_ffff, 0x0c00_0000, 0x6400_0000),
            1 => (0xffff_febf, 0x0000_00c0, 0x0000_0100),
            _ => (0xffff_ffff, 0, 0),
        };
        Self { name: PORTS[port], moder, otyper: 0, ospeedr, pupdr, odr: 0, lckr: 0, afr: [0; 2], lock_step: 0 }
    }

    /// Mode of a pin.
    pub fn mode(&self, pin: u8) -> Mode {
        let pin = u32::from(pin);
        match field(self.moder, 2 * pin, 2) {
            0 => Mode::Input,
            1 => Mode::Output { open_drain: bit(self.otyper, pin) },
            2 => Mode::Alternate(field(self.afr[(pin / 8) as usize], 4 * (pin % 8), 4) as u8),
            _ => Mode::Analog,
        }
    }

    /// Level that the port's own output or pull gives a pin that no peripheral drives.
    pub fn own_level(&self, pin: u8) -> Option<bool> {
        let number = u32::from(pin);
        if let Mode::Output { open_drain } = self.mode(pin) {
            let level = bit(self.odr, number);
            if !(open_drain && level) {
                return Some(level);
            }
        }
        match field(self.pupdr, 2 * number, 2) {
            1 => Some(true),
            2 => Some(false),
            _ => None,
        }
    }

    /// Reads a register; `inputs` are the levels at the pins.
    pub fn read(&self, offset: u32, inputs: impl Fn(u8) -> bool) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => self.moder,
            0x04 => self.otyper,
            0x08 => self.ospeedr,
            0x0c => self.pupdr,
            0x10 => (0..16).filter(|&pin| self.mode(pin) != Mode::Analog && inputs(pin)).map(|pin| 1 << pin).sum(),
            0x14 => self.odr,
            0x18 | 0x28 => 0,
            0x1c => self.lckr,
            0x20 => self.afr[0],
            0x24 => self.afr[1],
            _ => return Err(unmodelled(self.name, offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        let locked = if bit(self.lckr, 16) { self.lckr & 0xffff } else { 0 };
        let keep = |old: u32, width: u32| {
            let mask: u32 =
                (0..16).filter(|&pin| bit(locked, pin)).map(|pin| ((1 << width) - 1) << (width * pin)).sum();
            old & mask | value & !mask
        };
        let half = |old: u32, first: u32| {
            let mask: u32 = (0..8).filter(|&pin| bit(locked, pin + first)).map(|pin| 0xf << (4 * pin)).sum();
            old & mask | value & !mask
        };
        let fixed = match offset {
            0x00 => keep(self.moder, 2) != value,
            0x20 => half(self.afr[0], 0) != value,
            0x24 => half(self.afr[1], 8) != value,
            _ => false,
        };
        match offset {
            0x00 => self.moder = keep(self.moder, 2),
            0x04 => self.otyper = keep(self.otyper, 1) & 0xffff,
            0x08 => self.ospeedr = keep(self.ospeedr, 2),
            0x0c => self.pupdr = keep(self.pupdr, 2),
            0x10 => return Err(wrong(self.name, "IDR is written")),
            0x14 => self.odr = value & 0xffff,
            0x18 => self.odr = (self.odr & !(value >> 16) | value) & 0xffff,
            0x28 => self.odr &= !value,
            0x1c => self.lock(value),
            0x20 => self.afr[0] = half(self.afr[0], 0),
            0x24 => self.afr[1] = half(self.afr[1], 8),
            _ => return Err(unmodelled(self.name, offset)),
        }
        if fixed {
            return Err(wrong(self.name, "the configuration of a locked pin is written (9.4.8)"));
        }
        Ok(())
    }

    /// The key sequence 1, 0, 1 with the same pins (9.4.8).
    fn lock(&mut self, value: u32) {
        if bit(self.lckr, 16) {
            return;
        }
        let (key, pins) = (bit(value, 16), value & 0xffff);
        let same = pins == self.lckr & 0xffff;
        self.lock_step = match (self.lock_step, key) {
            (1, false) if same => 2,
            (2, true) if same => 3,
            (_, true) => 1,
            _ => 0,
        };
        self.lckr = pins | if self.lock_step == 3 { 1 << 16 } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reset_leaves_the_debug_pins_to_the_debugger() {
        let port = Gpio::new(0);
        assert_eq!(port.mode(13), Mode::Alternate(0));
        assert_eq!(port.mode(14), Mode::Alternate(0));
        assert_eq!(port.mode(0), Mode::Analog);
        assert_eq!(port.own_level(13), Some(true), "SWDIO is pulled up");
    }

    #[test]
    fn bsrr_sets_over_resets() {
        let mut port = Gpio::new(2);
        port.write(0x00, 1 << 26).unwrap();
        port.write(0x18, 1 << 13 | 1 << 29).unwrap();
        assert_eq!(port.read(0x14, |_| false).unwrap(), 1 << 13);
        assert_eq!(port.own_level(13), Some(true));
        port.write(0x28, 1 << 13).unwrap();
        assert_eq!(port.own_level(13), Some(false));
    }

    #[test]
    fn the_lock_sequence_freezes_pins() {
        let mut port = Gpio::new(0);
        for value in [0x1_0100, 0x0_0100, 0x1_0100] {
            port.write(0x1c, value).unwrap();
        }
        let before = port.read(0x00, |_| false).unwrap();
        assert!(port.write(0x00, before & !(3 << 16)).is_err());
        assert_eq!(port.mode(8), Mode::Analog);
        port.write(0x00, before & !(3 << 18)).unwrap();
        assert_eq!(port.mode(9), Mode::Input);
    }
}
