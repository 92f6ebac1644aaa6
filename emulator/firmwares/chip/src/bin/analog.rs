//! PA1 by a comparator against a ramp of DAC3, and by an op-amp and an ADC: both must find the same voltage.
#![no_std]
#![no_main]

use chip_firmwares::{ADC_ENABLE, calibrate, done, enable_converters, full_speed};
use cortex_m_rt::entry;
use stm32_metapac::adc::regs::{self, Isr};
use stm32_metapac::comp::regs::Csr as Comparator;
use stm32_metapac::dac::regs::{Cr, Dhr12r, Mcr};
use stm32_metapac::opamp::regs::Csr as Opamp;
use stm32_metapac::{ADC1, COMP1, DAC3, OPAMP1, RCC};

#[entry]
fn main() -> ! {
    full_speed();
    RCC.apb2enr().modify(|enable| enable.set_syscfgen(true));
    RCC.ahb2enr().modify(|enable| enable.set_dac3en(true));
    // Both channels inside the chip (MODE 3), HFSEL above 160 MHz; channel 1 on.
    DAC3.mcr().write_value(Mcr(0x0003_8003));
    DAC3.cr().write_value(Cr(1));
    // PA1 against channel 1 of DAC3 (INMSEL 4).
    COMP1.csr().write_value(Comparator(1 | 4 << 4));
    let above = |code| {
        DAC3.dhr12r(0).write_value(Dhr12r(code));
        COMP1.csr().read().value()
    };
    let mut code = 0;
    for bit in (0..12).rev() {
        if above(code | 1 << bit) {
            code |= 1 << bit;
        }
    }
    assert!(above(code) && !above(code + 1));

    // PA1 twice (VM_SEL 2, PGA_GAIN 0), onto PA2: channel 3 of ADC1, started by software.
    OPAMP1.csr().write_value(Opamp(1 | 2 << 5 | 1 << 7));
    enable_converters();
    calibrate(ADC1);
    ADC1.jsqr().write(|jsqr| jsqr.set_jsq(0, 3));
    let mut sum = 0;
    for _ in 0..64 {
        ADC1.cr().write_value(regs::Cr(ADC_ENABLE | 1 << 3));
        while !ADC1.isr().read().jeos() {}
        ADC1.isr().write_value(Isr(1 << 6));
        sum += u32::from(ADC1.jdr(0).read().jdata());
    }
    defmt::info!("comparator {} of 4096", code);
    defmt::info!("op-amp {} of 4096", sum / 128);
    done()
}
