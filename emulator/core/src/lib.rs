//! An Arm Cortex-M4F: Armv7E-M with FPv4-SP, instruction by instruction, exceptions included, beside a [`bus::Bus`]
//! that is everything else on the chip.
//!
//! Interpreted, not translated: time is exact to the instruction at every access, an interrupt is taken between the
//! same two instructions in every run, and the model says what each instruction costs. Not modelled: the memory
//! protection unit, unprivileged mode, bit-banding, trace; accesses to their registers are listed.

mod access;
mod alu;
mod cache;
mod cpu;
mod decode;
mod exception;
mod execute;
mod fault;
mod float;
mod image;
mod machine;
mod memory;
mod nvic;
mod op;
mod profile;
mod rtt;
mod scs;
mod systick;
mod transfer;
mod watch;

pub use fault::FaultReport;
pub use image::{Image, Place};
pub use machine::{Listed, Machine, Stop};
pub use memory::PAINT;
pub use nvic::{FIRST_IRQ, system_name};
pub use profile::{Activity, BIN, Entries, Profile, Spent};
pub use rtt::{Log, LogLine, Rtt};
pub use watch::Longest;
