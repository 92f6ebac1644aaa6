//! hallservo on a B-G431B-ESC1 (MB1419): L6387 gate drivers, three shunts at the chip's own op-amps, two ADCs.
#![no_std]
#![no_main]

mod analog;
mod board;

// The virtual COM port of the ST-LINK.
stm32g4::firmware!(board::Esc1, board::Esc1::new());
