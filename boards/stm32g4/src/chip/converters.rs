//! The ADCs: calibrated, then started by TIM1 for good.

use crate::registers::adc::{self, Sequence};
use crate::registers::clock::HCLK_HZ;
use core::hint::assert_unchecked;
use cortex_m::asm;
use embassy_stm32::pac::RCC;
use embassy_stm32::pac::adc::{Adc, regs};
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::adccommon::regs::Ccr;
use hallservo::board::TemperatureCode;

/// An ADC and what it converts in every period.
pub struct Converter {
    /// Which.
    pub adc: Adc,
    /// What.
    pub sequence: Sequence,
}

/// Calibrates the ADCs and lets them wait for the first trigger. The end of the first one's sequence is the control
/// interrupt: it must be the last to end. `groups` are what they share: of ADC1 and ADC2, and of the others if there
/// are any.
#[inline(never)]
pub(crate) fn start(groups: &[AdcCommon], converters: &[Converter]) {
    RCC.ahb2enr().modify(|enable| {
        enable.set_adc12en(true);
        enable.set_adc345en(groups.len() > 1);
    });
    for group in groups {
        group.ccr().write_value(Ccr(adc::CCR));
    }
    for converter in converters {
        converter.adc.cr().write_value(regs::Cr(adc::CR_REGULATOR));
    }
    asm::delay(adc::REGULATOR_US * (HCLK_HZ / 1_000_000));
    for Converter { adc, sequence } in converters {
        calibrate(adc);
        adc.isr().write_value(regs::Isr(adc::READY));
        adc.cr().write_value(regs::Cr(adc::CR_REGULATOR | adc::CR_ENABLE));
        while adc.isr().read().0 & adc::READY == 0 {}
        let [first, second] = sequence.smpr();
        adc.cfgr().write_value(regs::Cfgr(adc::CFGR));
        adc.smpr().write_value(regs::Smpr(first));
        adc.smpr2().write_value(regs::Smpr2(second));
        adc.jsqr().write_value(regs::Jsqr(sequence.jsqr()));
    }
    if let [first, ..] = converters {
        first.adc.ier().write_value(regs::Ier(adc::END_OF_SEQUENCE));
    }
    for converter in converters {
        converter.adc.cr().write_value(regs::Cr(adc::CR_REGULATOR | adc::CR_ENABLE | adc::CR_START_INJECTED));
    }
}

fn calibrate(adc: &Adc) {
    adc.cr().write_value(regs::Cr(adc::CR_REGULATOR | adc::CR_CALIBRATE));
    while adc.cr().read().0 & adc::CR_CALIBRATE != 0 {}
    // ADEN may be set four ADC cycles later at the earliest.
    asm::delay(4 * adc::DIVIDER);
    defmt::debug!("calibration factor of an ADC: {=u8}", adc.calfact().read().calfact_s());
}

/// Takes the control interrupt's request back.
#[inline(always)]
pub(crate) fn acknowledge(first: &Adc) {
    first.isr().write_value(regs::Isr(adc::END_OF_SEQUENCE));
}

/// Result of a rank, from 0 to 3.
#[inline(always)]
pub fn result<const RANK: usize>(adc: Adc) -> u16 {
    let word = adc.jdr(RANK).read().0;
    // SAFETY: JDATA is the lower half, and the upper half is reserved and reads as zero (RM0440, ADC_JDRy). Of its 16
    // bits a converter of 12 fills as many, with no offset and no oversampling set.
    unsafe { assert_unchecked(word <= u32::from(crate::Adc::FULL_SCALE)) };
    word as u16
}

/// [`Adc::low_side_current`](crate::Adc::low_side_current) in two instructions.
#[inline(always)]
pub fn low_side_current(code: u16, zero: u16) -> u16 {
    limited(i32::from(crate::Adc::MIDDLE) + i32::from(zero) - i32::from(code))
}

/// [`Adc::ntc_to_reference`](crate::Adc::ntc_to_reference).
#[inline(always)]
pub fn ntc_to_reference(code: u16) -> TemperatureCode {
    TemperatureCode::from_bits(crate::Adc::FULL_SCALE.wrapping_sub(code))
}

/// Within 12 bits. The compiler knows no such instruction.
#[inline(always)]
fn limited(code: i32) -> u16 {
    let limited: u32;
    // SAFETY: computes.
    unsafe {
        core::arch::asm!("usat {}, #12, {}", out(reg) limited, in(reg) code, options(pure, nomem, nostack));
        // SAFETY: that is what it does.
        assert_unchecked(limited <= u32::from(crate::Adc::FULL_SCALE));
    }
    limited as u16
}
