//! What every Cortex-M board of hallservo needs, whatever its chip: a critical section that never delays the control
//! interrupt, and the interrupt priorities that make it sound.
#![no_std]

mod critical_section;
pub mod priority;
