//! The independent watchdog: fed five times, and then no more.
#![no_std]
#![no_main]

use chip_firmwares::{done, wait};
use cortex_m_rt::entry;
use stm32_metapac::iwdg::regs::{Kr, Rlr};
use stm32_metapac::{IWDG, RCC};

#[entry]
fn main() -> ! {
    if RCC.csr().read().iwdgrstf() {
        RCC.csr().modify(|csr| csr.set_rmvf(true));
        assert!(!RCC.csr().read().iwdgrstf());
        defmt::info!("bitten");
        done()
    }
    IWDG.kr().write_value(Kr(0xcccc));
    IWDG.kr().write_value(Kr(0x5555));
    // 4 · 800 / 32 kHz: 100 ms.
    IWDG.rlr().write_value(Rlr(799));
    while IWDG.sr().read().0 != 0 {}
    for _ in 0..5 {
        IWDG.kr().write_value(Kr(0xaaaa));
        // 80 ms of 16 MHz.
        wait(80 * 16_000);
    }
    defmt::info!("hungry");
    done()
}
