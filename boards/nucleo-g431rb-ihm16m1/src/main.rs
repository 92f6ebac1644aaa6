//! hallservo on a Nucleo-G431RB with an X-NUCLEO-IHM16M1: STSPIN830, amplifiers on the shield, two ADCs.
#![no_std]
#![no_main]

mod board;

use board::Nucleo;
use cortex_m_rt::entry;
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{bind_interrupts, interrupt, peripherals, usart};
use static_cell::ConstStaticCell;
use stm32g4::Control;

bind_interrupts!(struct Interrupts {
    USART2 => usart::BufferedInterruptHandler<peripherals::USART2>, stm32g4::Listen;
});

static CONTROL: Control<Nucleo> = Control::new();
static TX: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
/// Emptied at each byte.
static RX: ConstStaticCell<[u8; 16]> = ConstStaticCell::new([0; 16]);

/// Called by `Reset` of cortex-m-rt before the memory is filled.
#[unsafe(no_mangle)]
unsafe extern "C" fn __pre_init() {
    // SAFETY: this is the moment that it is for.
    unsafe { stm32g4::before_memory::<Nucleo>() }
}

#[entry]
fn main() -> ! {
    let (bridge, chip) = stm32g4::start::<Nucleo>();
    board::wake();
    // The virtual COM port of the ST-LINK.
    let serial =
        BufferedUart::new(chip.USART2, chip.PA3, chip.PA2, TX.take(), RX.take(), Interrupts, stm32g4::serial());
    let Ok(serial) = serial else { panic!("the serial line cannot be set up") };
    stm32g4::run(Nucleo::new(), bridge, &CONTROL, chip.FLASH, serial)
}

#[interrupt]
unsafe fn ADC1_2() {
    // SAFETY: this is the interrupt that it is for.
    unsafe { CONTROL.interrupt() }
}
