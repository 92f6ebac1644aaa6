//! The memory map (RM0440, table 3): where a peripheral is, which enable gates it, what models it.

use crate::device::Device;

/// A model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// Reset and clock control.
    Rcc,
    /// Power.
    Pwr,
    /// Flash registers.
    Flash,
    /// Port, 0 is A.
    Gpio(usize),
    /// SYSCFG, VREFBUF, comparators and op-amps share a page.
    Syscfg,
    /// External interrupts.
    Exti,
    /// Timer by its place in [`TIMERS`].
    Timer(usize),
    /// USART1, 2, 3, LPUART1.
    Usart(usize),
    /// FDCAN1.
    Can,
    /// The part of the message RAM that is FDCAN1's.
    CanRam,
    /// ADC1 and ADC2 (0), or ADC3 to ADC5 (1).
    Adc(usize),
    /// DAC1 to DAC4.
    Dac(usize),
    /// Independent watchdog.
    Iwdg,
    /// Window watchdog.
    Wwdg,
    /// Debug.
    Dbgmcu,
    /// There, and without a model.
    Nothing,
}

/// An entry of the map.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// As the manual calls it.
    pub name: &'static str,
    /// First address.
    pub base: u32,
    /// Model.
    pub block: Block,
    /// Offset of the enable register in RCC, and the bit; `None`: always clocked.
    pub enable: Option<(u32, u32)>,
}

const AHB1: u32 = 0x48;
const AHB2: u32 = 0x4c;
const APB1: u32 = 0x58;
const APB1_2: u32 = 0x5c;
const APB2: u32 = 0x60;

const fn place(base: u32, name: &'static str, block: Block, register: u32, position: u32) -> Place {
    Place { name, base, block, enable: Some((register, position)) }
}

const fn always(base: u32, name: &'static str, block: Block) -> Place {
    Place { name, base, block, enable: None }
}

use Block::{Adc, Dac, Gpio, Nothing, Timer, Usart};

/// In order of addresses; each reaches to the next, or over a kilobyte.
const MAP: [Place; 66] = [
    place(0x4000_0000, "TIM2", Timer(1), APB1, 0),
    place(0x4000_0400, "TIM3", Timer(2), APB1, 1),
    place(0x4000_0800, "TIM4", Timer(3), APB1, 2),
    place(0x4000_0c00, "TIM5", Timer(4), APB1, 3),
    place(0x4000_1000, "TIM6", Timer(5), APB1, 4),
    place(0x4000_1400, "TIM7", Timer(6), APB1, 5),
    place(0x4000_2000, "CRS", Nothing, APB1, 8),
    place(0x4000_2400, "TAMP", Nothing, APB1, 10),
    place(0x4000_2800, "RTC", Nothing, APB1, 10),
    place(0x4000_2c00, "WWDG", Block::Wwdg, APB1, 11),
    always(0x4000_3000, "IWDG", Block::Iwdg),
    place(0x4000_3800, "SPI2", Nothing, APB1, 14),
    place(0x4000_3c00, "SPI3", Nothing, APB1, 15),
    place(0x4000_4400, "USART2", Usart(1), APB1, 17),
    place(0x4000_4800, "USART3", Usart(2), APB1, 18),
    place(0x4000_4c00, "UART4", Nothing, APB1, 19),
    place(0x4000_5000, "UART5", Nothing, APB1, 20),
    place(0x4000_5400, "I2C1", Nothing, APB1, 21),
    place(0x4000_5800, "I2C2", Nothing, APB1, 22),
    place(0x4000_5c00, "USB", Nothing, APB1, 23),
    place(0x4000_6400, "FDCAN1", Block::Can, APB1, 25),
    place(0x4000_6800, "FDCAN2", Nothing, APB1, 25),
    place(0x4000_6c00, "FDCAN3", Nothing, APB1, 25),
    place(0x4000_7000, "PWR", Block::Pwr, APB1, 28),
    place(0x4000_7800, "I2C3", Nothing, APB1, 30),
    place(0x4000_7c00, "LPTIM1", Nothing, APB1, 31),
    place(0x4000_8000, "LPUART1", Usart(3), APB1_2, 0),
    place(0x4000_8400, "I2C4", Nothing, APB1_2, 1),
    place(0x4000_a000, "UCPD1", Nothing, APB1_2, 8),
    place(0x4000_a400, "FDCAN RAM", Block::CanRam, APB1, 25),
    place(0x4001_0000, "SYSCFG", Block::Syscfg, APB2, 0),
    always(0x4001_0400, "EXTI", Block::Exti),
    place(0x4001_2c00, "TIM1", Timer(0), APB2, 11),
    place(0x4001_3000, "SPI1", Nothing, APB2, 12),
    place(0x4001_3400, "TIM8", Timer(7), APB2, 13),
    place(0x4001_3800, "USART1", Usart(0), APB2, 14),
    place(0x4001_3c00, "SPI4", Nothing, APB2, 15),
    place(0x4001_4000, "TIM15", Timer(8), APB2, 16),
    place(0x4001_4400, "TIM16", Timer(9), APB2, 17),
    place(0x4001_4800, "TIM17", Timer(10), APB2, 18),
    place(0x4001_5000, "TIM20", Timer(11), APB2, 20),
    place(0x4001_5400, "SAI1", Nothing, APB2, 21),
    place(0x4001_6800, "HRTIM", Nothing, APB2, 26),
    place(0x4002_0000, "DMA1", Nothing, AHB1, 0),
    place(0x4002_0400, "DMA2", Nothing, AHB1, 1),
    place(0x4002_0800, "DMAMUX", Nothing, AHB1, 2),
    place(0x4002_0c00, "CORDIC", Nothing, AHB1, 3),
    always(0x4002_1000, "RCC", Block::Rcc),
    place(0x4002_1400, "FMAC", Nothing, AHB1, 4),
    place(0x4002_2000, "FLASH", Block::Flash, AHB1, 8),
    place(0x4002_3000, "CRC", Nothing, AHB1, 12),
    place(0x4800_0000, "GPIOA", Gpio(0), AHB2, 0),
    place(0x4800_0400, "GPIOB", Gpio(1), AHB2, 1),
    place(0x4800_0800, "GPIOC", Gpio(2), AHB2, 2),
    place(0x4800_0c00, "GPIOD", Gpio(3), AHB2, 3),
    place(0x4800_1000, "GPIOE", Gpio(4), AHB2, 4),
    place(0x4800_1400, "GPIOF", Gpio(5), AHB2, 5),
    place(0x4800_1800, "GPIOG", Gpio(6), AHB2, 6),
    place(0x5000_0000, "ADC12", Adc(0), AHB2, 13),
    place(0x5000_0400, "ADC345", Adc(1), AHB2, 14),
    place(0x5000_0800, "DAC1", Dac(0), AHB2, 16),
    place(0x5000_0c00, "DAC2", Dac(1), AHB2, 17),
    place(0x5000_1000, "DAC3", Dac(2), AHB2, 18),
    place(0x5000_1400, "DAC4", Dac(3), AHB2, 19),
    place(0x5006_0800, "RNG", Nothing, AHB2, 26),
    always(0xe004_2000, "DBGMCU", Block::Dbgmcu),
];

/// What the larger chip has alone.
const LARGE: [&str; 10] = ["TIM5", "TIM20", "ADC345", "DAC2", "DAC4", "UART5", "FDCAN2", "FDCAN3", "I2C4", "HRTIM"];

/// The peripheral at an address.
pub fn at(address: u32, device: Device) -> Option<&'static Place> {
    let above = MAP.partition_point(|place| place.base <= address);
    let place = MAP.get(above.checked_sub(1)?)?;
    let there = address - place.base < 0x400 && (device.is_large() || !LARGE.contains(&place.name));
    there.then_some(place)
}

/// Peripherals that a bit of an enable register gates, and the bit of the reset register 0x20 below it resets.
pub fn gated_by(register: u32, bits: u32) -> impl Iterator<Item = &'static Place> {
    MAP.iter().filter(move |place| matches!(place.enable, Some((at, bit)) if at == register && bits >> bit & 1 != 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_is_in_order_and_knows_the_smaller_chip() {
        assert!(MAP.is_sorted_by_key(|place| place.base));
        let name = |address, device| at(address, device).map(|place| place.name);
        assert_eq!(name(0x4001_2c44, Device::G431CB), Some("TIM1"));
        assert_eq!(name(0x5000_0308, Device::G431CB), Some("ADC12"));
        assert_eq!(name(0x5000_0400, Device::G431CB), None);
        assert_eq!(name(0x5000_0700, Device::G474RE), Some("ADC345"));
        assert_eq!(name(0x4002_1800, Device::G474RE), None);
    }
}
