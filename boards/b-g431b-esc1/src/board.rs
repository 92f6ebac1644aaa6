//! Pins, and the way from ADC results to a sample. Schematic: MB1419.

use b_g431b_esc1::constants::{self, EARLY, FIRST, SECOND, ZERO};
use core::num::NonZeroU32;
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::{ADC1, ADC2, ADC12_COMMON, GPIOA, GPIOB, GPIOC};
use hallservo::board::Sample;
use hallservo::board::sensing::SkewCompensation;
use hallservo::settings::Settings;
use stm32g4::wiring::Wiring;
use stm32g4::{Board, Converter, Pin, low_side_current, ntc_to_reference, result};

/// The state of the board in the control interrupt.
pub struct Esc1 {
    first_hall: SkewCompensation<12>,
}

impl Esc1 {
    /// With the op-amps and comparators on.
    pub fn new() -> Self {
        crate::analog::start();
        Self { first_hall: SkewCompensation::new(EARLY, Self::BRIDGE.whole_period()) }
    }
}

impl Board for Esc1 {
    const NAME: &'static str = "B-G431B-ESC1";

    const BRIDGE: Wiring = constants::BRIDGE;
    const PINS: &'static [Pin] =
        &[(GPIOA, 8, 6), (GPIOC, 13, 4), (GPIOA, 9, 6), (GPIOA, 12, 6), (GPIOA, 10, 6), (GPIOB, 15, 4)];
    const SERIAL: [Pin; 2] = [(GPIOB, 3, 7), (GPIOB, 4, 7)];

    const CONVERTERS: &'static [Converter] =
        &[Converter { adc: ADC1, sequence: FIRST }, Converter { adc: ADC2, sequence: SECOND }];
    const GROUPS: &'static [AdcCommon] = &[ADC12_COMMON];

    /// SHDN of the TCAN330 low; the board's 120 Ω at PC14.
    #[cfg(feature = "can")]
    const CAN: stm32g4::can::Wires = stm32g4::can::Wires {
        pins: [(GPIOA, 11, 9), (GPIOB, 9, 9)],
        transceiver: &[(GPIOC, 11, false), (GPIOC, 14, constants::TERMINATION)],
    };

    fn settings() -> Settings {
        // A constant, which is copied, takes less flash than code that makes it.
        const { constants::settings() }
    }

    fn retime(&mut self, period: NonZeroU32) {
        self.first_hall = SkewCompensation::new(EARLY, period);
    }

    #[inline(always)]
    fn sample(&mut self, sample: &mut Sample) {
        sample.halls = [self.first_hall.at_once(result::<1>(ADC2)), result::<2>(ADC2), result::<2>(ADC1)];
        sample.currents =
            [result::<0>(ADC1), result::<0>(ADC2), result::<1>(ADC1)].map(|code| low_side_current(code, ZERO));
        sample.bus = result::<3>(ADC2);
        sample.temperatures[0] = ntc_to_reference(result::<3>(ADC1));
    }
}
