//! ADCs of the first pair.

use crate::{HCLK_HZ, wait};
use stm32_metapac::adc::{Adc, regs, vals::Exten};
use stm32_metapac::adccommon::regs::Ccr;
use stm32_metapac::{ADC12_COMMON, RCC};

/// ADC_CR: ADEN, with the regulator on.
pub const ADC_ENABLE: u32 = 1 << 28 | 1;
/// ADC_CR: JADSTART.
const START_INJECTED: u32 = 1 << 3;
/// ADC_SMPR1 and ADC_SMPR2: 47.5 cycles for all channels.
const SMPR: u32 = 0o4_444_444_444;

/// Gives the pair its clock.
pub fn enable_converters() {
    RCC.ahb2enr().modify(|enable| enable.set_adc12en(true));
}

/// Regulator, calibration, enable; a quarter of HCLK.
pub fn calibrate(adc: Adc) {
    ADC12_COMMON.ccr().write_value(Ccr(3 << 16));
    adc.cr().write_value(regs::Cr(1 << 28));
    wait(20 * (HCLK_HZ / 1_000_000));
    adc.cr().write_value(regs::Cr(1 << 28 | 1 << 31));
    while adc.cr().read().adcal() {}
    wait(4 * 4);
    adc.cr().write_value(regs::Cr(ADC_ENABLE));
    while !adc.isr().read().adrdy() {}
    adc.cfgr().write_value(regs::Cfgr(1 << 31));
    adc.smpr().write_value(regs::Smpr(SMPR));
    adc.smpr2().write_value(regs::Smpr2(SMPR));
}

/// From now on converts two channels at every TIM1_TRGO2.
pub fn convert_at_trigger(adc: Adc, channels: [u8; 2]) {
    adc.jsqr().write(|jsqr| {
        jsqr.set_jl(1);
        jsqr.set_jextsel(8);
        jsqr.set_jexten(Exten::RISING_EDGE);
        jsqr.set_jsq(0, channels[0]);
        jsqr.set_jsq(1, channels[1]);
    });
    adc.cr().write_value(regs::Cr(ADC_ENABLE | START_INJECTED));
}
