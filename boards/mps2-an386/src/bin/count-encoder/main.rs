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

use cortex_m_rt::entry;
use row::Row;

#[entry]
fn main() -> ! {
    Row::table(init, &[absolute::ROWS])
}

fn init() {
    halls::init();
    absolute::init();
}
