//! STM32G431CB and STM32G474RE without their core: peripherals, the boards around them, the motor.
//!
//! Behaviour is that of the reference manual RM0440 and the data sheets (DS12589, DS12288), register by register; it
//! shares nothing with the firmware that it judges. What has no model is complained of, never silently accepted, and
//! so is an access to a peripheral whose clock is off. The six gate signals are computed from the pins: alternate
//! function, dead time, polarity, idle states and MOE act as they do at the driver.
//!
//! Time is event by event, not cycle by cycle: [`Chip::advance`](bus::System::advance) jumps from edge to edge of the
//! PWM and from sample to sample of the converters, and moves the motor in between.

// Channels, legs and sides read better by index.
#![allow(clippy::needless_range_loop)]

pub mod adc;
pub mod analog;
mod bits;
pub mod board;
pub mod bridge;
mod chip;
pub mod device;
pub mod flash;
pub mod gpio;
pub mod iwdg;
pub mod machine;
mod map;
pub mod pwr;
pub mod rcc;
mod record;
mod registers;
mod signals;
mod system;
mod time;
pub mod timer;
pub mod usart;

pub use board::Board;
pub use chip::Chip;
