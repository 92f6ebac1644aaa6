//! The experiments: hallservo's control code in a closed loop with the simulated motor, with figures and plots.

pub mod experiment;
pub mod paper_filter;
pub mod report;
pub mod rig;
pub mod statistics;
