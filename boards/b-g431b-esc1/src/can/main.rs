//! hallservo on a B-G431B-ESC1 at its CAN-FD: drives a motor that was set up with the board's other firmware.
#![no_std]
#![no_main]

#[path = "../analog.rs"]
mod analog;
#[path = "../board.rs"]
mod board;

// The virtual COM port of the ST-LINK.
stm32g4::firmware!(board::Esc1, board::Esc1::new());
