//! Interrupts of the AN386 image (Arm DAI0386, table 3-10) and the vector table that cortex-m-rt links.

use cortex_m::interrupt::InterruptNumber;

/// The interrupts used here.
#[derive(Clone, Copy, Debug)]
#[repr(u16)]
pub enum Interrupt {
    /// Reception of UART 0: unused as such, pended by software to run the tasks of lower priority.
    Uart0 = 0,
    /// CMSDK timer 0: the control interrupt.
    Timer0 = 8,
    /// CMSDK timer 1: unused as a timer, pended by software to run the tasks of higher priority.
    Timer1 = 9,
    /// CMSDK dual timer: the clock and the alarm of embassy-time.
    DualTimer = 10,
}

// SAFETY: the numbers are those of the chip and unique.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

unsafe extern "C" {
    fn UART0();
    fn TIMER0();
    fn TIMER1();
    fn DUALTIMER();
    fn DefaultHandler();
}

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [unsafe extern "C" fn(); 32] = {
    let mut vectors: [unsafe extern "C" fn(); 32] = [DefaultHandler; 32];
    vectors[Interrupt::Uart0 as usize] = UART0;
    vectors[Interrupt::Timer0 as usize] = TIMER0;
    vectors[Interrupt::Timer1 as usize] = TIMER1;
    vectors[Interrupt::DualTimer as usize] = DUALTIMER;
    vectors
};
