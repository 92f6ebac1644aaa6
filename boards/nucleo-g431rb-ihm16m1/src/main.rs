//! hallservo on a Nucleo-G431RB with an X-NUCLEO-IHM16M1: STSPIN830, amplifiers on the shield, two ADCs.
#![no_std]
#![no_main]

mod board;

// The virtual COM port of the ST-LINK.
stm32g4::firmware!(board::Nucleo, board::Nucleo::new());
