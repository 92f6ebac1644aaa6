//! The experiments: hallservo's control code in a closed loop with the simulated motor, with figures and plots.

/// As that of the standard library, but a full output is said in words, and no panic.
macro_rules! println {
    () => { $crate::report::line(format_args!("")) };
    ($($text:tt)*) => { $crate::report::line(format_args!($($text)*)) };
}

pub mod baseline;
pub mod commissioning;
pub mod experiment;
pub mod motors;
pub mod rig;
pub mod statistics;

pub use plots as report;
