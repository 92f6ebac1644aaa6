//! What every Cortex-M board of hallservo needs, whatever its chip: a critical section that never delays the control
//! interrupt, the interrupt priorities that make it sound, and functions of the compiler's that take less flash.
#![no_std]

mod critical_section;
mod memory;
pub mod priority;
