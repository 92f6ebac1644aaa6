//! 170 MHz, and time by the cycle counter.

use cortex_m::peripheral::{DCB, DWT};
use stm32_metapac::flash::vals::Latency;
use stm32_metapac::pwr::regs::Cr5;
use stm32_metapac::rcc::{regs::Pllcfgr, vals::Hpre, vals::Sw};
use stm32_metapac::{FLASH, PWR, RCC};

/// HCLK at full speed.
pub const HCLK_HZ: u32 = 170_000_000;

/// 16 MHz / 4 · 85 / 2 from HSI16, in the order of RM0440, 6.1.5: HCLK halved, regulator boosted, flash slowed, HCLK
/// doubled.
pub fn full_speed() {
    RCC.apb1enr1().modify(|enable| enable.set_pwren(true));
    RCC.pllcfgr().write_value(Pllcfgr(2 | 3 << 4 | 85 << 8 | 1 << 24));
    RCC.cr().modify(|cr| cr.set_pllon(true));
    while !RCC.cr().read().pllrdy() {}
    RCC.cfgr().modify(|cfgr| cfgr.set_hpre(Hpre::DIV2));
    // R1MODE is bit 8, and the only one.
    PWR.cr5().write_value(Cr5(0));
    FLASH.acr().modify(|acr| acr.set_latency(Latency::WS4));
    RCC.cfgr().modify(|cfgr| cfgr.set_sw(Sw::PLL1_R));
    while RCC.cfgr().read().sws() != Sw::PLL1_R {}
    wait(HCLK_HZ / 1_000_000);
    RCC.cfgr().modify(|cfgr| cfgr.set_hpre(Hpre::DIV1));
}

/// Waits for so many cycles of HCLK.
pub fn wait(cycles: u32) {
    // SAFETY: nobody else uses the two registers.
    unsafe {
        (*DCB::PTR).demcr.modify(|demcr| demcr | 1 << 24);
        (*DWT::PTR).ctrl.modify(|ctrl| ctrl | 1);
    }
    let begin = DWT::cycle_count();
    while DWT::cycle_count().wrapping_sub(begin) < cycles {}
}
