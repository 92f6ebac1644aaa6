//! The board with heads: pins, and the way from ADC results to a sample and a reading.

use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::opamp::regs::Csr;
use embassy_stm32::pac::{ADC1, ADC2, ADC3, ADC4, ADC5, OPAMP4, OPAMP5, RCC};
use hallservo::board::Sample;
use hallservo::settings::Settings;
use hallservo::vernier::encoder::Reading;
use hallservo::vernier::head::ReadingSkew;
use nucleo_g474re_ihm08m1::constants::{self, FOURTH, THIRD};
use nucleo_g474re_ihm08m1::heads::{FIFTH, FIRST_WITH, LATER, SECOND_WITH};
use nucleo_g474re_ihm08m1::pins;
use stm32g4::can::Wires;
use stm32g4::registers::analog::OPAMP_FOLLOWER;
use stm32g4::wiring::Wiring;
use stm32g4::{Board, Converter, Pin, ntc_to_reference, result};

/// The board in the control interrupt.
pub struct Nucleo {
    second: ReadingSkew<2>,
}

impl Nucleo {
    /// Switches the followers on, before the ADCs sample them.
    pub fn new() -> Self {
        RCC.apb2enr().modify(|enable| enable.set_syscfgen(true));
        OPAMP4.csr().write_value(Csr(OPAMP_FOLLOWER));
        OPAMP5.csr().write_value(Csr(OPAMP_FOLLOWER));
        Self { second: ReadingSkew::new(LATER as i32, constants::BRIDGE.whole_period().get()) }
    }
}

impl Board for Nucleo {
    const NAME: &'static str = "Nucleo-G474RE, X-NUCLEO-IHM08M1, encoder";

    const BRIDGE: Wiring = constants::BRIDGE;
    const PINS: &'static [Pin] = pins::PINS;
    const SERIAL: [Pin; 2] = pins::SERIAL;
    const CONVERTERS: &'static [Converter] = &[
        Converter { adc: ADC1, sequence: FIRST_WITH },
        Converter { adc: ADC2, sequence: SECOND_WITH },
        Converter { adc: ADC3, sequence: THIRD },
        Converter { adc: ADC4, sequence: FOURTH },
        Converter { adc: ADC5, sequence: FIFTH },
    ];
    const GROUPS: &'static [AdcCommon] = pins::GROUPS;

    const CAN: Wires = pins::CAN;

    fn settings() -> Settings {
        // The vernier's share in the steps is planned once, for the board's own frequency.
        let ceilings = constants::CEILINGS.split_first().map_or(constants::CEILINGS, |(_, others)| others);
        Settings { ceilings, ..constants::settings() }
    }

    #[inline(always)]
    fn sample(&mut self, sample: &mut Sample) {
        pins::sample(sample);
        sample.temperatures[0] = ntc_to_reference(result::<3>(ADC1));
    }

    #[inline(always)]
    fn heads(&mut self) -> Reading<2> {
        let angle = |code: u16| code << 4;
        Reading {
            reference: [result::<2>(ADC2), result::<2>(ADC5)].map(angle),
            vernier: self.second.at_once([result::<3>(ADC2), result::<3>(ADC5)].map(angle)),
        }
    }
}
