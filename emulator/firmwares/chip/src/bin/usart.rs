//! USART2 sends back what comes, a letter later in the alphabet.
#![no_std]
#![no_main]

use chip_firmwares::{HCLK_HZ, board, connect, full_speed};
use cortex_m::peripheral::NVIC;
use cortex_m_rt::entry;
use stm32_metapac::usart::regs::{Brr, Cr1};
use stm32_metapac::{Interrupt, RCC, USART2, interrupt};

#[entry]
fn main() -> ! {
    full_speed();
    connect(&board().serial);
    RCC.apb1enr1().modify(|enable| enable.set_usart2en(true));
    USART2.brr().write_value(Brr(HCLK_HZ / 460_800));
    // UE, RE, TE, RXNEIE.
    USART2.cr1().write_value(Cr1(1 | 1 << 2 | 1 << 3 | 1 << 5));
    // SAFETY: the handler uses nothing but the port.
    unsafe { NVIC::unmask(Interrupt::USART2) };
    loop {
        cortex_m::asm::wfi();
    }
}

#[interrupt]
fn USART2() {
    let byte = USART2.rdr().read().dr();
    assert!(USART2.isr().read().txe(), "the line takes as long both ways");
    USART2.tdr().write(|tdr| tdr.set_dr(byte + 1));
}
