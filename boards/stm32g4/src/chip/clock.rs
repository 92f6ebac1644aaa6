//! The chip out of reset: clocks, time, and the core's cycle counter.

use crate::registers::clock::*;
use cortex_m::asm;
use embassy_stm32::Peripherals;
use embassy_stm32::interrupt::Priority;
use embassy_stm32::pac::rcc::vals::{Hpre, Pllm, Plln, Pllr, Pllsrc, Sw};
use embassy_stm32::pac::{FLASH, PWR, RCC, TIM3};
use embassy_stm32::rcc::Pll;

/// FLASH_ACR.PRFTEN: the next line is read while this one is executed.
const PREFETCH: u32 = 1 << 8;
/// Ticks of embassy-time a second.
const TICK_HZ: u32 = embassy_time::TICK_HZ as u32;

/// Switches to 170 MHz, in the order that RM0440 asks for: with HCLK halved the regulator is boosted and the flash
/// slowed, then HCLK doubles.
///
/// The HAL knows the clocks as they are before that last step: 85 MHz throughout. PCLK1 stays there. The HAL's own
/// boost does not happen: it clears a bit that is not R1MODE.
// Not inlined, it is compiled for size.
#[inline(never)]
pub(crate) fn start() -> Peripherals {
    let mut config = embassy_stm32::Config::default();
    // Out of the box these are at the priority of the control interrupt.
    config.bdma_interrupt_priority = Priority::from(shared::priority::CEILING);
    config.rcc.pll = Some(Pll {
        source: Pllsrc::HSI,
        prediv: Pllm::from_bits((PLL_M - 1) as u8),
        mul: Plln::from_bits(PLL_N as u8),
        divp: None,
        divq: None,
        divr: Some(Pllr::from_bits((PLL_R / 2 - 1) as u8)),
    });
    config.rcc.sys = Sw::PLL1_R;
    config.rcc.ahb_pre = Hpre::DIV2;
    config.rcc.hsi48 = None;
    let peripherals = embassy_stm32::init(config);
    PWR.cr5().modify(|cr5| cr5.0 &= !R1MODE);
    let states = const { wait_states(HCLK_HZ, true).unwrap() };
    FLASH.acr().modify(|acr| acr.0 = acr.0 & !0xF | states | PREFETCH);
    while FLASH.acr().read().0 & 0xF != states {}
    // A microsecond at least.
    asm::delay(HCLK_HZ / 1_000_000);
    RCC.cfgr().modify(|cfgr| cfgr.0 = cfgr.0 & !DIVIDERS_MASK | DIVIDERS);
    // The timer of embassy-time now runs at twice the clock that it was set up for. It has hardly begun to count.
    TIM3.psc().write_value(const { prescaler(HCLK_HZ, TICK_HZ) });
    TIM3.cr1().modify(|cr1| cr1.set_urs(embassy_stm32::pac::timer::vals::Urs::COUNTER_ONLY));
    TIM3.egr().write(|egr| egr.set_ug(true));
    TIM3.cr1().modify(|cr1| cr1.set_urs(embassy_stm32::pac::timer::vals::Urs::ANY_EVENT));
    assert!(RCC.pllcfgr().read().0 == PLLCFGR, "the PLL is not set as computed");
    peripherals
}
