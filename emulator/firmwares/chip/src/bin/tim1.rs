//! TIM1: dead times of all four ranges of DTG, the rate of updates, and MOE off by software.
#![no_std]
#![no_main]

use chip_firmwares::{HCLK_HZ, board, connect, done, full_speed, wait};
use cortex_m_rt::entry;
use stm32_metapac::timer::regs::{ArrCore, Ccr1ch, RcrAdv, SrAdv};
use stm32_metapac::timer::vals::{Cms, Ocm, Ossi, Ossr};
use stm32_metapac::{RCC, TIM1};

const HALF_PERIOD: u32 = 4250;
/// DTG and what it makes, in 2.94 ns: 20, 127, 130, 254, 256, 504, 512, 1008.
const DEAD_TIMES: [u8; 8] = [20, 127, 0x81, 0xbf, 0xc0, 0xdf, 0xe0, 0xff];

#[entry]
fn main() -> ! {
    let board = board();
    full_speed();
    RCC.apb2enr().modify(|enable| enable.set_tim1en(true));
    TIM1.cr1().write(|cr1| cr1.set_cms(Cms::CENTER_ALIGNED3));
    TIM1.arr().write_value(ArrCore(HALF_PERIOD));
    TIM1.rcr().write_value(RcrAdv(1));
    for leg in 0..3 {
        TIM1.ccmr_output(leg / 2).modify(|ccmr| ccmr.set_ocm(leg % 2, Ocm::PWM_MODE1));
        TIM1.ccr(leg).write_value(Ccr1ch(HALF_PERIOD / 2));
        TIM1.cr2().modify(|cr2| cr2.set_oisn(leg, board.low_inverted));
        TIM1.ccer().modify(|ccer| {
            ccer.set_cce(leg, true);
            ccer.set_ccne(leg, true);
            ccer.set_ccnp(leg, board.low_inverted);
        });
    }
    TIM1.bdtr().write(|bdtr| {
        bdtr.set_ossi(Ossi::IDLE_LEVEL);
        bdtr.set_ossr(Ossr::IDLE_LEVEL);
        bdtr.set_dtg(DEAD_TIMES[0]);
    });
    connect(&board.gates);
    TIM1.egr().write(|egr| egr.set_ug(true));
    TIM1.cr1().modify(|cr1| cr1.set_cen(true));
    TIM1.bdtr().modify(|bdtr| bdtr.set_moe(true));
    for dtg in DEAD_TIMES {
        TIM1.bdtr().modify(|bdtr| bdtr.set_dtg(dtg));
        wait(10 * 2 * HALF_PERIOD);
        defmt::info!("DTG {}", dtg);
        // As long as it takes to look at the pins.
        wait(HCLK_HZ / 2000);
    }

    let mut updates = 0;
    let begin = cortex_m::peripheral::DWT::cycle_count();
    while cortex_m::peripheral::DWT::cycle_count().wrapping_sub(begin) < 100 * 2 * HALF_PERIOD {
        if TIM1.sr().read().uif() {
            TIM1.sr().write_value(SrAdv(!1));
            updates += 1;
        }
    }
    assert!((100..=101).contains(&updates), "{updates} updates in 100 periods");

    TIM1.egr().write(|egr| egr.set_bg(0, true));
    assert!(!TIM1.bdtr().read().moe());
    assert!(TIM1.sr().read().bif(0));
    done()
}
