//! What the program of every board is.

/// The whole of a board's `main.rs` but its modules: what starts it and the control interrupt. Of the board's type, and
/// how one is made once the clocks run.
#[macro_export]
macro_rules! firmware {
    ($board:ty, $new:expr) => {
        use cortex_m_rt::entry;
        use embassy_stm32::interrupt;

        static CONTROL: $crate::Control<$board> = $crate::Control::new();

        /// Called by `Reset` of cortex-m-rt before the memory is filled.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn __pre_init() {
            // SAFETY: this is the moment that it is for.
            unsafe { $crate::before_memory::<$board>() }
        }

        #[entry]
        fn main() -> ! {
            let bridge = $crate::start::<$board>();
            $crate::run($new, bridge, &CONTROL)
        }

        #[interrupt]
        unsafe fn ADC1_2() {
            // SAFETY: this is the interrupt that it is for.
            unsafe { CONTROL.interrupt() }
        }
    };
}
