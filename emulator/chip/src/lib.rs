//! STM32G431 and STM32G474 without their core: peripherals, the boards around them, the motor.
//!
//! Behaviour is that of the reference manual RM0440 and the data sheets (DS12589, DS12288), register by register; it
//! shares nothing with the firmware that it judges. What has no model is complained of, never silently accepted, and
//! so is an access to a peripheral whose clock is off. The six gate signals are computed from the pins: alternate
//! function, dead time, polarity, idle states and MOE act as they do at the driver.
//!
//! What has a model: RCC, PWR (ranges, boost), FLASH (programming, erasing, errors, power cut), GPIO with alternate
//! functions, SYSCFG, EXTI lines of pins, TIM1 to TIM8, TIM15 to TIM17 and TIM20 (counting, compare, preloads; with
//! TIM1's outputs, dead time, break inputs and triggers), ADC1 to ADC5 (calibration, regular and injected sequences,
//! offsets), OPAMP, COMP, DAC, USART1 to USART3 and LPUART1, FDCAN1 on a wire with
//! others ([`can`]), IWDG, WWDG (without its early interrupt), DBGMCU, the factory's words.
//!
//! What has none, and is complained of: DMA, FDCAN2 and FDCAN3, the other serial buses, RTC, HRTIM, CORDIC, RNG, CRC; of the timers input
//! capture, slave modes, combined and asymmetric PWM, dithering; of the converters dual modes, the queue of contexts,
//! oversampling, analogue watchdogs, differential inputs; option bytes cannot be programmed, HSE and LSE are not there.
//! Beyond that the model is simpler than silicon in this: a break acts at once, without its filter, and the lock-up,
//! parity and ECC breaks of SYSCFG never come; interrupts of comparators do not reach EXTI; a double word torn by a
//! power cut reads as garbage without an ECC error; what crosses a change of HCLK keeps its number of cycles;
//! switching leaves no noise at the shunts.
//!
//! Time is event by event, not cycle by cycle: [`Chip::advance`](bus::Bus::advance) jumps from edge to edge of the
//! PWM and from sample to sample of the converters, and moves the motor in between.

// Channels, legs and sides read better by index.
#![allow(clippy::needless_range_loop)]

pub mod adc;
pub mod analog;
mod bits;
pub mod board;
pub mod bridge;
pub mod can;
mod chip;
pub mod device;
mod disturbance;
mod facts;
pub mod flash;
pub mod gpio;
pub mod iwdg;
mod map;
pub mod motor;
mod outside;
pub mod pwr;
pub mod rcc;
mod record;
mod registers;
mod report;
mod seam;
mod signals;
mod system;
mod time;
pub mod timer;
pub mod usart;
pub mod wwdg;

pub use board::Board;
pub use chip::Chip;
pub use disturbance::{Disturbance, HallFault};
pub use facts::{Clock, Edge, Facts, Leg, Pwm, Sampling, Trace, Watchdog, WindowWatchdog};
