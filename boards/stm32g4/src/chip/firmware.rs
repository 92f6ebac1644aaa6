//! What the program of every board is.

/// The whole of a board's `main.rs` but its modules: what starts it and its two interrupts. Of the board's type, how
/// one is made once the clocks run, and the pins of the serial line, which is USART2.
#[macro_export]
macro_rules! firmware {
    ($board:ty, $new:expr, tx: $tx:ident, rx: $rx:ident) => {
        use cortex_m_rt::entry;
        use embassy_stm32::usart::BufferedUart;
        use embassy_stm32::{bind_interrupts, interrupt, peripherals, usart};
        use static_cell::ConstStaticCell;

        bind_interrupts!(struct Interrupts {
            USART2 => usart::BufferedInterruptHandler<peripherals::USART2>, $crate::Listen;
        });

        static CONTROL: $crate::Control<$board> = $crate::Control::new();
        static TX: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
        /// Emptied at each byte.
        static RX: ConstStaticCell<[u8; 16]> = ConstStaticCell::new([0; 16]);

        /// Called by `Reset` of cortex-m-rt before the memory is filled.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn __pre_init() {
            // SAFETY: this is the moment that it is for.
            unsafe { $crate::before_memory::<$board>() }
        }

        #[entry]
        fn main() -> ! {
            let (bridge, chip) = $crate::start::<$board>();
            let board = $new;
            let (tx, rx) = (TX.take(), RX.take());
            let serial = BufferedUart::new(chip.USART2, chip.$rx, chip.$tx, tx, rx, Interrupts, $crate::serial());
            let Ok(serial) = serial else { panic!("the serial line cannot be set up") };
            $crate::run(board, bridge, &CONTROL, chip.FLASH, serial)
        }

        #[interrupt]
        unsafe fn ADC1_2() {
            // SAFETY: this is the interrupt that it is for.
            unsafe { CONTROL.interrupt() }
        }
    };
}
