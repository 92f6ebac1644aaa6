//! Pins, and the way from ADC results to a sample. Schematics: X-NUCLEO-IHM08M1 (UM1996), MB1367 (UM2505).

use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::{ADC1, ADC2, ADC3, ADC4, ADC12_COMMON, ADC345_COMMON, GPIOA, GPIOB};
use hallservo::board::Sample;
use hallservo::settings::Settings;
use nucleo_g474re_ihm08m1::constants::{self, FIRST, FOURTH, SECOND, THIRD, ZERO};
use stm32g4::wiring::Wiring;
use stm32g4::{Board, Converter, Pin, low_side_current, ntc_to_reference, result};

/// The board in the control interrupt.
pub struct Nucleo;

impl Board for Nucleo {
    const NAME: &'static str = "Nucleo-G474RE, X-NUCLEO-IHM08M1";

    const BRIDGE: Wiring = constants::BRIDGE;
    const PINS: &'static [Pin] = &[
        // PA6 is TIM1_BKIN.
        (GPIOA, 8, 6),
        (GPIOA, 7, 6),
        (GPIOA, 9, 6),
        (GPIOB, 0, 6),
        (GPIOA, 10, 6),
        (GPIOB, 1, 6),
        (GPIOA, 6, 6),
    ];

    const CONVERTERS: &'static [Converter] = &[
        Converter { adc: ADC1, sequence: FIRST },
        Converter { adc: ADC2, sequence: SECOND },
        Converter { adc: ADC3, sequence: THIRD },
        Converter { adc: ADC4, sequence: FOURTH },
    ];
    const GROUPS: &'static [AdcCommon] = &[ADC12_COMMON, ADC345_COMMON];

    fn settings() -> Settings {
        constants::settings()
    }

    #[inline(always)]
    fn sample(&mut self, sample: &mut Sample) {
        sample.halls = [result::<0>(ADC4), result::<0>(ADC3), result::<0>(ADC1)];
        sample.currents =
            [result::<1>(ADC1), result::<1>(ADC2), result::<2>(ADC1)].map(|code| low_side_current(code, ZERO));
        sample.bus = result::<0>(ADC2);
        sample.temperatures[0] = ntc_to_reference(result::<2>(ADC2));
    }
}
