//! Logging: defmt where the board has it, nothing otherwise.

/// Without defmt the arguments are only used, for the sake of the compiler.
macro_rules! log {
    ($level:ident, $($argument:expr),+) => {{
        #[cfg(feature = "defmt")]
        defmt::$level!($($argument),+);
        #[cfg(not(feature = "defmt"))]
        {
            let _ = ($(&$argument),+);
        }
    }};
}

pub(crate) use log;
