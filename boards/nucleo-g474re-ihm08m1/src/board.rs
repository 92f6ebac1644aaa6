//! Pins, and the way from ADC results to a sample. Schematics: X-NUCLEO-IHM08M1 (UM1996), MB1367 (UM2505).

use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::{ADC1, ADC2, ADC3, ADC4};
use hallservo::board::Sample;
use hallservo::settings::Settings;
use nucleo_g474re_ihm08m1::constants::{self, FIRST, FOURTH, SECOND, THIRD};
use nucleo_g474re_ihm08m1::pins;
use stm32g4::can::Wires;
use stm32g4::wiring::Wiring;
use stm32g4::{Board, Converter, Pin, ntc_to_reference, result};

/// The board in the control interrupt.
pub struct Nucleo;

impl Board for Nucleo {
    const NAME: &'static str = "Nucleo-G474RE, X-NUCLEO-IHM08M1";

    const BRIDGE: Wiring = constants::BRIDGE;
    const PINS: &'static [Pin] = pins::PINS;
    const SERIAL: [Pin; 2] = pins::SERIAL;
    const CONVERTERS: &'static [Converter] = &[
        Converter { adc: ADC1, sequence: FIRST },
        Converter { adc: ADC2, sequence: SECOND },
        Converter { adc: ADC3, sequence: THIRD },
        Converter { adc: ADC4, sequence: FOURTH },
    ];
    const GROUPS: &'static [AdcCommon] = pins::GROUPS;

    const CAN: Wires = pins::CAN;

    fn settings() -> Settings {
        // A constant, which is copied, takes less flash than code that makes it.
        const { constants::settings() }
    }

    #[inline(always)]
    fn sample(&mut self, sample: &mut Sample) {
        pins::sample(sample);
        sample.temperatures[0] = ntc_to_reference(result::<2>(ADC2));
    }
}
