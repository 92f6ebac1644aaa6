//! hallservo on a Nucleo-G474RE with an X-NUCLEO-IHM08M1: L6398 gate drivers, amplifiers on the shield, an ADC for each
//! Hall.
#![no_std]
#![no_main]

mod board;

// The virtual COM port of the ST-LINK.
stm32g4::firmware!(board::Nucleo, board::Nucleo);
