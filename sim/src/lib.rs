//! The experiments: hallservo's control code in a closed loop with the simulated motor, with figures and plots.

pub mod baseline;
pub mod experiment;
pub mod rig;
pub mod statistics;

pub use plots as report;
