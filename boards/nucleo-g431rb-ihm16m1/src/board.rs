//! Pins, and the way from ADC results to a sample. Schematics: X-NUCLEO-IHM16M1 (UM2415), MB1367 (UM2505).

use core::num::NonZeroU32;
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC1, ADC2, ADC12_COMMON, GPIOA, GPIOB};
use hallservo::board::Sample;
use hallservo::board::sensing::SkewCompensation;
use hallservo::settings::Settings;
use nucleo_g431rb_ihm16m1::constants::{self, EARLY, FIRST, SECOND, ZERO};
use stm32g4::wiring::Wiring;
use stm32g4::{Board, Converter, Pin, low_side_current, ntc_to_reference, result};

/// STBY\RESET of the STSPIN830, on port B.
const STANDBY: usize = 5;

/// The state of the board in the control interrupt.
pub struct Nucleo {
    first_hall: SkewCompensation<12>,
}

impl Nucleo {
    /// Wakes the driver up, whose inputs are low by now.
    pub fn new() -> Self {
        GPIOB.bsrr().write(|set| set.set_bs(STANDBY, true));
        GPIOB.moder().modify(|mode| mode.set_moder(STANDBY, Moder::OUTPUT));
        Self { first_hall: SkewCompensation::new(EARLY, Self::BRIDGE.whole_period()) }
    }
}

impl Board for Nucleo {
    const NAME: &'static str = "Nucleo-G431RB, X-NUCLEO-IHM16M1";

    const BRIDGE: Wiring = constants::BRIDGE;
    const PINS: &'static [Pin] = &[
        // PB12 is TIM1_BKIN.
        (GPIOA, 8, 6),
        (GPIOB, 13, 6),
        (GPIOA, 9, 6),
        (GPIOB, 14, 6),
        (GPIOA, 10, 6),
        (GPIOB, 15, 4),
        (GPIOB, 12, 6),
    ];
    const SERIAL: [Pin; 2] = [(GPIOA, 2, 7), (GPIOA, 3, 7)];

    const CONVERTERS: &'static [Converter] =
        &[Converter { adc: ADC1, sequence: FIRST }, Converter { adc: ADC2, sequence: SECOND }];
    const GROUPS: &'static [AdcCommon] = &[ADC12_COMMON];

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
            [result::<0>(ADC2), result::<0>(ADC1), result::<1>(ADC1)].map(|code| low_side_current(code, ZERO));
        sample.bus = result::<3>(ADC1);
        sample.temperatures[0] = ntc_to_reference(result::<3>(ADC2));
    }
}
