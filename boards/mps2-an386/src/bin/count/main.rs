//! Instructions executed by each function of the fast path and by its peers, over a sweep of inputs, with the errors.
//!
//! Prints a table in Markdown and fails when a function exceeds its budget. A count is what a call costs, prologue and
//! return included; inlined into the control interrupt, the functions cost a few instructions less.
#![no_std]
#![no_main]

mod adapt;
mod call;
mod drive;
mod duties;
mod halls;
mod motor;
mod row;
mod scope;
mod servo;
mod trig;
mod vernier;

use cortex_m_rt::entry;
use row::Row;

#[entry]
fn main() -> ! {
    let tables =
        [trig::ROWS, halls::ROWS, duties::ROWS, drive::ROWS, servo::ROWS, scope::ROWS, vernier::ROWS, adapt::ROWS];
    Row::table(init, &tables)
}

fn init() {
    halls::init();
    duties::init();
    drive::init();
    servo::init();
    scope::init();
    vernier::init();
    adapt::init();
}
