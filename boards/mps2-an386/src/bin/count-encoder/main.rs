//! As `count`, of the step with an encoder: a program of its own, as a second caller would change how the functions of
//! the step are inlined.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "of the rows without an encoder, what they are made of is enough")]

mod absolute;
#[path = "../count/call.rs"]
mod call;
#[path = "../count/drive.rs"]
mod drive;
#[path = "../count/halls.rs"]
mod halls;
#[path = "../count/row.rs"]
mod row;
#[path = "../count/trig.rs"]
mod trig;

use call::Counter;
use cortex_m_rt::entry;
use mps2_an386::{failure, success};
use row::Row;

#[entry]
fn main() -> ! {
    let Some(mut core) = cortex_m::Peripherals::take() else { failure() };
    let counter = Counter::new(&mut core.SYST);
    halls::init();
    absolute::init();
    Row::print_head();
    let mut within = true;
    for row in absolute::ROWS {
        within &= row.print(&counter);
    }
    if within { success() } else { failure() }
}
