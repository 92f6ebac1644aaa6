//! What the firmwares with and without an encoder have in common on the chip: pins, and results of the ADCs.

use crate::constants::ZERO;
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::{ADC1, ADC2, ADC3, ADC4, ADC12_COMMON, ADC345_COMMON, GPIOA, GPIOB};
use hallservo::board::Sample;
use stm32g4::can::Wires;
use stm32g4::{Pin, low_side_current, result};

/// Of TIM1.
pub const PINS: &[Pin] = &[
    // PA6 is TIM1_BKIN.
    (GPIOA, 8, 6),
    (GPIOA, 7, 6),
    (GPIOA, 9, 6),
    (GPIOB, 0, 6),
    (GPIOA, 10, 6),
    (GPIOB, 1, 6),
    (GPIOA, 6, 6),
];

/// TX and RX of USART2.
pub const SERIAL: [Pin; 2] = [(GPIOA, 2, 7), (GPIOA, 3, 7)];

/// PA11 and PB9 to a transceiver: PB8, the other pin for RX, is BOOT0, which an idle bus holds high.
pub const CAN: Wires = Wires { pins: [(GPIOA, 11, 9), (GPIOB, 9, 9)], transceiver: &[] };

/// What the ADCs share.
pub const GROUPS: &[AdcCommon] = &[ADC12_COMMON, ADC345_COMMON];

/// Halls, currents and bus, which are at the same ranks in both.
#[inline(always)]
pub fn sample(sample: &mut Sample) {
    sample.halls = [result::<0>(ADC4), result::<0>(ADC3), result::<0>(ADC1)];
    sample.currents =
        [result::<1>(ADC1), result::<1>(ADC2), result::<2>(ADC1)].map(|code| low_side_current(code, ZERO));
    sample.bus = result::<0>(ADC2);
}
