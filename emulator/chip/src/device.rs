//! The chips: what they have, and which pin carries which signal.

use crate::gpio::Pin;
use bus::{Alias, Cache, Integration};
use serde::Deserialize;

/// A chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Device {
    /// STM32G431CB: 128 KiB, ADC1 and ADC2; 48 pins.
    #[serde(rename = "STM32G431CB")]
    G431CB,
    /// STM32G431RB: the same with 64 pins.
    #[serde(rename = "STM32G431RB")]
    G431RB,
    /// STM32G474RE: 512 KiB in two banks, ADC1 to ADC5.
    #[serde(rename = "STM32G474RE")]
    G474RE,
}

impl core::fmt::Display for Device {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "STM32{self:?}")
    }
}

/// A signal of a peripheral at a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// TIM1_CH1 to CH3 (0 to 2), and their complements where the second is 1.
    Gate(usize, usize),
    /// TIM1_BKIN, TIM1_BKIN2.
    Break(usize),
    /// TX of USART1, 2, 3 or LPUART1 (0 to 3).
    Tx(usize),
    /// RX.
    Rx(usize),
    /// FDCAN1_TX.
    CanTx,
    /// FDCAN1_RX.
    CanRx,
}

/// Port, number, alternate function, signal (data sheets DS12589 and DS12288, table 13).
const SIGNALS: [(u8, u8, u8, Signal); 54] = {
    use Signal::{Break, CanRx, CanTx, Gate, Rx, Tx};
    [
        (b'A', 8, 6, Gate(0, 0)),
        (b'A', 9, 6, Gate(1, 0)),
        (b'A', 10, 6, Gate(2, 0)),
        (b'C', 0, 2, Gate(0, 0)),
        (b'C', 1, 2, Gate(1, 0)),
        (b'C', 2, 2, Gate(2, 0)),
        (b'A', 7, 6, Gate(0, 1)),
        (b'A', 11, 6, Gate(0, 1)),
        (b'B', 13, 6, Gate(0, 1)),
        (b'C', 13, 4, Gate(0, 1)),
        (b'A', 12, 6, Gate(1, 1)),
        (b'B', 0, 6, Gate(1, 1)),
        (b'B', 14, 6, Gate(1, 1)),
        (b'B', 1, 6, Gate(2, 1)),
        (b'B', 9, 12, Gate(2, 1)),
        (b'B', 15, 4, Gate(2, 1)),
        (b'F', 0, 6, Gate(2, 1)),
        (b'A', 6, 6, Break(0)),
        (b'A', 14, 6, Break(0)),
        (b'A', 15, 9, Break(0)),
        (b'B', 8, 12, Break(0)),
        (b'B', 10, 12, Break(0)),
        (b'B', 12, 6, Break(0)),
        (b'C', 13, 2, Break(0)),
        (b'A', 11, 12, Break(1)),
        (b'C', 3, 6, Break(1)),
        (b'A', 9, 7, Tx(0)),
        (b'B', 6, 7, Tx(0)),
        (b'C', 4, 7, Tx(0)),
        (b'A', 10, 7, Rx(0)),
        (b'B', 7, 7, Rx(0)),
        (b'C', 5, 7, Rx(0)),
        (b'A', 2, 7, Tx(1)),
        (b'A', 14, 7, Tx(1)),
        (b'B', 3, 7, Tx(1)),
        (b'A', 3, 7, Rx(1)),
        (b'A', 15, 7, Rx(1)),
        (b'B', 4, 7, Rx(1)),
        (b'B', 9, 7, Tx(2)),
        (b'B', 10, 7, Tx(2)),
        (b'C', 10, 7, Tx(2)),
        (b'B', 8, 7, Rx(2)),
        (b'B', 11, 7, Rx(2)),
        (b'C', 11, 7, Rx(2)),
        (b'A', 2, 12, Tx(3)),
        (b'B', 11, 8, Tx(3)),
        (b'C', 1, 8, Tx(3)),
        (b'A', 3, 12, Rx(3)),
        (b'B', 10, 8, Rx(3)),
        (b'C', 0, 8, Rx(3)),
        (b'A', 11, 9, CanRx),
        (b'B', 8, 9, CanRx),
        (b'A', 12, 9, CanTx),
        (b'B', 9, 9, CanTx),
    ]
};

/// Converter (0 is ADC1), channel, pin.
const CHANNELS: [(usize, u32, u8, u8); 38] = [
    (0, 1, b'A', 0),
    (0, 2, b'A', 1),
    (0, 3, b'A', 2),
    (0, 4, b'A', 3),
    (0, 5, b'B', 14),
    (0, 6, b'C', 0),
    (0, 7, b'C', 1),
    (0, 8, b'C', 2),
    (0, 9, b'C', 3),
    (0, 10, b'F', 0),
    (0, 11, b'B', 12),
    (0, 12, b'B', 1),
    (0, 14, b'B', 11),
    (0, 15, b'B', 0),
    (1, 1, b'A', 0),
    (1, 2, b'A', 1),
    (1, 3, b'A', 6),
    (1, 4, b'A', 7),
    (1, 5, b'C', 4),
    (1, 6, b'C', 0),
    (1, 7, b'C', 1),
    (1, 8, b'C', 2),
    (1, 9, b'C', 3),
    (1, 10, b'F', 1),
    (1, 11, b'C', 5),
    (1, 12, b'B', 2),
    (1, 13, b'A', 5),
    (1, 14, b'B', 11),
    (1, 15, b'B', 15),
    (1, 17, b'A', 4),
    (2, 1, b'B', 1),
    (2, 5, b'B', 13),
    (2, 12, b'B', 0),
    (3, 3, b'B', 12),
    (3, 4, b'B', 14),
    (3, 5, b'B', 15),
    (4, 1, b'A', 8),
    (4, 2, b'A', 9),
];

/// What a converter's channel is connected to inside the chip (RM0440, figures 83 to 87).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// A pin.
    Pin(Pin),
    /// Output of OPAMP1 to OPAMP6 (0 to 5), with OPAINTOEN.
    Opamp(usize),
    /// Temperature sensor.
    Temperature,
    /// A third of VBAT.
    Battery,
    /// Internal reference.
    Reference,
}

impl Device {
    /// The larger die, with everything.
    pub const fn is_large(self) -> bool {
        matches!(self, Self::G474RE)
    }

    /// Memories (RM0440, 2.2), flash accelerator (3.3.6), priorities (PM0214, 4.3.7), SysTick (RM0440, 7.2). SRAM1,
    /// SRAM2 and CCM SRAM are one piece, of which the last part is at `0x1000_0000` as well.
    pub const fn integration(self) -> Integration {
        const SMALL: &[Alias] = &[Alias { address: 0x1000_0000, offset: 22 << 10, bytes: 10 << 10 }];
        const LARGE: &[Alias] = &[Alias { address: 0x1000_0000, offset: 96 << 10, bytes: 32 << 10 }];
        Integration {
            code: 0x0800_0000,
            code_aliases: &[0],
            // Of several ways in the chip; here direct-mapped.
            cache: Cache { line_bytes: 32, word_bytes: 8, instruction_lines: 32, data_lines: 8 },
            ram: 0x2000_0000,
            ram_bytes: if self.is_large() { 128 << 10 } else { 32 << 10 },
            ram_aliases: if self.is_large() { LARGE } else { SMALL },
            priority_bits: 4,
            systick_reference: 8,
        }
    }

    /// Flash, KiB.
    pub const fn flash_kib(self) -> u16 {
        match self {
            Self::G431CB | Self::G431RB => 128,
            Self::G474RE => 512,
        }
    }

    /// Number of converters.
    pub const fn converters(self) -> usize {
        match self {
            Self::G431CB | Self::G431RB => 2,
            Self::G474RE => 5,
        }
    }

    /// Number of comparators.
    pub const fn comparators(self) -> usize {
        match self {
            Self::G431CB | Self::G431RB => 4,
            Self::G474RE => 7,
        }
    }

    /// Number of op-amps.
    pub const fn opamps(self) -> usize {
        match self {
            Self::G431CB | Self::G431RB => 3,
            Self::G474RE => 6,
        }
    }

    /// DBGMCU_IDCODE (47.6.1): categories 2 and 3, revisions Z and X.
    pub const fn idcode(self) -> u32 {
        match self {
            Self::G431CB | Self::G431RB => 0x2001_6468,
            Self::G474RE => 0x2003_6469,
        }
    }

    /// Signal that alternate function `af` puts on a pin, among those that have a model.
    pub fn signal(self, pin: Pin, af: u8) -> Option<Signal> {
        // PC0 to PC3 and PC5 are not on the small package.
        let hidden = self == Self::G431CB && pin.port == 2 && matches!(pin.number, 0..=3 | 5);
        SIGNALS
            .iter()
            .find(|(port, number, function, _)| Pin::of(*port, *number) == pin && *function == af && !hidden)
            .map(|(.., signal)| *signal)
    }

    /// Alternate function that puts a signal on a pin.
    pub fn alternate(self, pin: Pin, signal: Signal) -> Option<u8> {
        (0..16).find(|&af| self.signal(pin, af) == Some(signal))
    }

    /// What a converter (0 is ADC1) has at a channel.
    pub fn input(self, converter: usize, channel: u32) -> Option<Input> {
        let inside = match (converter, channel) {
            (0, 13) => Some(Input::Opamp(0)),
            (1, 16) => Some(Input::Opamp(1)),
            (1, 18) | (2, 13) => Some(Input::Opamp(2)),
            (4, 5) => Some(Input::Opamp(3)),
            (4, 3) => Some(Input::Opamp(4)),
            (3, 17) => Some(Input::Opamp(5)),
            (0, 16) | (4, 4) => Some(Input::Temperature),
            (0 | 2 | 4, 17) => Some(Input::Battery),
            (0 | 2 | 3 | 4, 18) => Some(Input::Reference),
            _ => None,
        };
        let outside = || {
            CHANNELS
                .iter()
                .find(|(adc, number, ..)| (*adc, *number) == (converter, channel))
                .map(|(_, _, port, pin)| Input::Pin(Pin::of(*port, *pin)))
        };
        inside.or_else(outside).filter(|_| converter < self.converters())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alternate_functions_of_the_boards() {
        for (device, port, number, af, signal) in [
            (Device::G474RE, b'A', 7, 6, Signal::Gate(0, 1)),
            (Device::G431CB, b'C', 13, 4, Signal::Gate(0, 1)),
            (Device::G431CB, b'A', 12, 6, Signal::Gate(1, 1)),
            (Device::G431CB, b'B', 15, 4, Signal::Gate(2, 1)),
            (Device::G431CB, b'B', 3, 7, Signal::Tx(1)),
            (Device::G474RE, b'A', 3, 12, Signal::Rx(3)),
        ] {
            assert_eq!(device.signal(Pin::of(port, number), af), Some(signal));
            assert_eq!(device.alternate(Pin::of(port, number), signal), Some(af));
        }
        assert_eq!(Device::G431CB.signal(Pin::of(b'B', 15), 6), None);
        assert_eq!(Device::G431CB.signal(Pin::of(b'C', 0), 2), None, "not on that package");
        assert_eq!(Device::G431RB.signal(Pin::of(b'C', 0), 2), Some(Signal::Gate(0, 0)));
    }

    #[test]
    fn no_pin_has_two_signals_on_one_function_and_no_channel_two_pins() {
        for (k, a) in SIGNALS.iter().enumerate() {
            assert!(!SIGNALS[..k].iter().any(|b| (a.0, a.1, a.2) == (b.0, b.1, b.2)), "{a:?}");
        }
        for (k, a) in CHANNELS.iter().enumerate() {
            assert!(!CHANNELS[..k].iter().any(|b| (a.0, a.1) == (b.0, b.1)), "{a:?}");
        }
    }

    #[test]
    fn converter_inputs() {
        assert_eq!(Device::G431CB.input(1, 17), Some(Input::Pin(Pin::of(b'A', 4))));
        assert_eq!(Device::G474RE.input(3, 3), Some(Input::Pin(Pin::of(b'B', 12))));
        assert_eq!(Device::G431CB.input(1, 18), Some(Input::Opamp(2)));
        assert_eq!(Device::G431CB.input(3, 3), None, "no ADC4");
    }
}
