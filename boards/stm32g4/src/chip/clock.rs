//! The chip out of reset: its clocks.

use crate::registers::clock::*;
use cortex_m::asm;
use embassy_stm32::pac::rcc::regs::Pllcfgr;
use embassy_stm32::pac::rcc::vals::{Hpre, Sw};
use embassy_stm32::pac::{FLASH, PWR, RCC};

/// FLASH_ACR.PRFTEN: the next line is read while this one is executed.
const PREFETCH: u32 = 1 << 8;

/// Switches to 170 MHz, in the order that RM0440 asks for: with HCLK halved the regulator is boosted and the flash
/// slowed, then HCLK doubles.
pub(crate) fn start() {
    RCC.apb1enr1().modify(|enable| enable.set_pwren(true));
    // PB4 and PB6 have no pull-downs for USB.
    PWR.cr3().modify(|cr3| cr3.set_ucpd1_dbdis(true));
    RCC.cfgr().modify(|cfgr| cfgr.set_hpre(Hpre::DIV2));
    PWR.cr5().modify(|cr5| cr5.0 &= !R1MODE);
    let states = const { wait_states(HCLK_HZ, true).unwrap() };
    FLASH.acr().modify(|acr| acr.0 = acr.0 & !0xF | states | PREFETCH);
    while FLASH.acr().read().0 & 0xF != states {}
    RCC.pllcfgr().write_value(Pllcfgr(PLLCFGR));
    RCC.cr().modify(|cr| cr.set_pllon(true));
    while !RCC.cr().read().pllrdy() {}
    RCC.cfgr().modify(|cfgr| cfgr.set_sw(Sw::PLL1_R));
    while RCC.cfgr().read().sws() != Sw::PLL1_R {}
    // A microsecond at least.
    asm::delay(HCLK_HZ / 1_000_000);
    RCC.cfgr().modify(|cfgr| cfgr.0 = cfgr.0 & !DIVIDERS_MASK | DIVIDERS);
}
