//! TIM3 as a time driver has it: a microsecond a count, an interrupt at the overflow, half-way, and at an alarm.
#![no_std]
#![no_main]

use chip_firmwares::{HCLK_HZ, done, full_speed, wait};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::{DWT, NVIC};
use cortex_m_rt::entry;
use stm32_metapac::timer::regs::{Ccr1ch as Ccr, DierGp16, EgrGp16, SrGp16};
use stm32_metapac::timer::vals::Urs;
use stm32_metapac::{Interrupt, RCC, TIM3, interrupt};

const ALARM: u16 = 40_000;
/// When the flags UIF, CC1IF and CC2IF came, cycles.
static CAME: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];

#[entry]
fn main() -> ! {
    full_speed();
    RCC.apb1enr1().modify(|enable| enable.set_tim3en(true));
    TIM3.psc().write_value((HCLK_HZ / 1_000_000 - 1) as u16);
    TIM3.ccr(0).write_value(Ccr(0x8000));
    TIM3.ccr(1).write_value(Ccr(ALARM.into()));
    // The update that takes up the prescaler leaves no flag.
    TIM3.cr1().modify(|cr1| cr1.set_urs(Urs::COUNTER_ONLY));
    TIM3.egr().write_value(EgrGp16(1));
    assert!(!TIM3.sr().read().uif());
    TIM3.dier().write_value(DierGp16(0b111));
    // SAFETY: what the handler uses is there.
    unsafe { NVIC::unmask(Interrupt::TIM3) };
    TIM3.cr1().modify(|cr1| cr1.set_cen(true));
    let begin = DWT::cycle_count();
    wait(70_000 * (HCLK_HZ / 1_000_000));
    let count = TIM3.cnt().read().0;
    assert!((70_000 - 65_536..70_010 - 65_536).contains(&count), "{count}");
    for (flag, expected) in [65_536, 0x8000, u32::from(ALARM)].into_iter().enumerate() {
        let after = CAME[flag].load(Relaxed).wrapping_sub(begin) / (HCLK_HZ / 1_000_000);
        assert!(after.abs_diff(expected) <= 1, "flag {flag} after {after} us");
    }
    done()
}

#[interrupt]
fn TIM3() {
    let flags = TIM3.sr().read().0;
    TIM3.sr().write_value(SrGp16(!flags));
    for (flag, came) in CAME.iter().enumerate() {
        if flags >> flag & 1 != 0 {
            came.store(DWT::cycle_count(), Relaxed);
        }
    }
}
