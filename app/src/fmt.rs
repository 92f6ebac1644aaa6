//! Logging: defmt where the board has it, nothing otherwise.

/// Does nothing with its arguments but use them.
macro_rules! say {
    ($level:ident, $($argument:expr),+) => {{
        #[cfg(feature = "defmt")]
        defmt::$level!($($argument),+);
        #[cfg(not(feature = "defmt"))]
        {
            let _ = ($(&$argument),+);
        }
    }};
}

pub(crate) use say;
