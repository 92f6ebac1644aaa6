//! ADC1 and ADC2 convert the bus voltage at the same trigger.
#![no_std]
#![no_main]

use chip_firmwares::{board, calibrate, convert_at_trigger, done, enable_converters, full_speed};
use cortex_m_rt::entry;
use stm32_metapac::adc::regs::Isr;
use stm32_metapac::timer::regs::ArrCore;
use stm32_metapac::timer::vals::Mms2;
use stm32_metapac::{ADC1, ADC2, RCC, TIM1};

#[entry]
fn main() -> ! {
    let bus = board().bus;
    full_speed();
    enable_converters();
    for adc in [ADC1, ADC2] {
        calibrate(adc);
        assert_eq!(adc.jdr(0).read().jdata(), 0);
        convert_at_trigger(adc, [bus, bus]);
    }
    RCC.apb2enr().modify(|enable| enable.set_tim1en(true));
    TIM1.arr().write_value(ArrCore(8499));
    TIM1.cr2().write(|cr2| cr2.set_mms2(Mms2::UPDATE));
    TIM1.cr1().modify(|cr1| cr1.set_cen(true));
    let mut sum = 0;
    for _ in 0..100 {
        while !ADC1.isr().read().jeos() {}
        assert!(ADC2.isr().read().jeos(), "both at once");
        for adc in [ADC1, ADC2] {
            adc.isr().write_value(Isr(1 << 6));
        }
        let codes = [ADC1, ADC2].map(|adc| [0, 1].map(|rank| u32::from(adc.jdr(rank).read().jdata())));
        sum += codes.iter().flatten().sum::<u32>();
    }
    TIM1.cr1().modify(|cr1| cr1.set_cen(false));
    defmt::info!("bus {} of 4096", sum / 400);
    done()
}
