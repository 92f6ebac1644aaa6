//! Clocks: 100 ms at 16 and at 170 MHz, a timer on a divided bus, and the reset of a peripheral.
#![no_std]
#![no_main]

use chip_firmwares::{HCLK_HZ, done, full_speed, wait};
use cortex_m_rt::entry;
use stm32_metapac::rcc::vals::Ppre;
use stm32_metapac::{RCC, TIM2};

#[entry]
fn main() -> ! {
    defmt::info!("16 MHz");
    wait(1_600_000);
    defmt::info!("over");
    full_speed();
    defmt::info!("170 MHz");
    wait(HCLK_HZ / 10);
    defmt::info!("over");

    // A timer on a bus that is divided by four runs at half of HCLK.
    RCC.cfgr().modify(|cfgr| cfgr.set_ppre1(Ppre::DIV4));
    RCC.apb1enr1().modify(|enable| enable.set_tim2en(true));
    TIM2.cr1().modify(|cr1| cr1.set_cen(true));
    let begin = TIM2.cnt().read();
    wait(10_000);
    let counts = TIM2.cnt().read() - begin;
    assert!((5000..5050).contains(&counts), "{counts} counts in 10 000 cycles");

    RCC.apb1rstr1().modify(|reset| reset.set_tim2rst(true));
    RCC.apb1rstr1().modify(|reset| reset.set_tim2rst(false));
    assert!(!TIM2.cr1().read().cen());
    assert_eq!(TIM2.cnt().read(), 0);
    done()
}
