//! A servo drive from a brushless motor, three cheap linear Hall sensors and a Cortex-M.
//!
//! `no_std`, no allocation, no `unsafe`. What runs in the control interrupt is integer arithmetic without a panic:
//! one [`Sample`](board::Sample) of the sensors in, one [`Output`](board::Output) for the timer out, by
//! [`Drive::step`](drive::Drive::step). Tasks at a lower rate calibrate and supervise it through lock-free queues, by
//! [`Service`](service::Service).
//!
//! # From a Hall's voltage to a torque
//! ```text
//!           ┌──────┐   ┌─────────────┐   ┌─────────┐   ┌───────────────────┐
//!  Sample ─▶│ hall ├──▶│   control   ├──▶│ commu-  ├──▶│ pwm               ├─▶ Output
//!  (board)  │ angle│   │ position,   │   │ tation  │   │ compare values    │  (board)
//!           │ speed│   │ speed,      │   │ which   │   └───────────────────┘
//!           └──────┘   │ current     │   │ phases  │
//!                      └─────────────┘   └─────────┘
//!  ◀──────────────── drive: which of these runs, in the control interrupt ─────────────▶
//!        │ records, replies                                    ▲ commands, models
//!        ▼                                                     │
//!  ◀──────────── service: calibrates, adapts, identifies, in the tasks ────────────────▶
//! ```
//!
//! Read the modules from below; each needs only those before it, and each can be used alone.
//!
//! 1. [`angle`] and [`trig`]: an angle is an integer whose full scale is one turn, so that it wraps by itself. Sine,
//!    arcsine and arctangent come from tables with proven errors.
//! 2. [`hall`]: three codes to an angle ([`estimate`](hall::estimate)), to speed and turns ([`track`](hall::track));
//!    finding out what the sensors deliver ([`calibrate`](hall::calibrate)), and keeping it true while the motor turns
//!    ([`adapt`](hall::adapt)). [`vernier`]: the absolute angle from two magnetic rings.
//! 3. [`commutation`] and [`pwm`]: from an angle and a voltage to three compare values.
//! 4. [`control`]: loops for current, speed and position, with gains from the motor's data and a bandwidth.
//! 5. [`board`]: what a board gives and gets. [`drive`]: all of the above in one interrupt, with its states ([`mode`]),
//!    [`fault`]s and [`telemetry`].
//! 6. [`settings`]: what a person sets, in SI units; [`config`]: the integers that the interrupt works with.
//! 7. [`service`]: the tasks' side of a drive. [`storage`]: what survives a power cut.
//! 8. `Supervisor` in the crate `hallservo-app`: commands over a serial line, procedures, storage and watchdog in three
//!    calls, without a runtime.
//!
//! To bring it to a board: [`porting`]. Every symbol with its unit and range: [`glossary`]. Examples, from three Halls
//! to a whole port: `examples/`.
//!
//! The methods are those of Simpkins and Todorov, *Position Estimation and Control of Compact BLDC Motors Based on
//! Analog Linear Hall Effect Sensors* (2010), and of Bakos, Gőzse and Soumelidis, *Design and Analysis of a Magnetic
//! Off-axis Rotary Position Sensing Device*. Where a printed equation does not hold, it is corrected; the place that
//! uses it says so.
//!
//! # Example
//! ```
//! use hallservo::board::Sample;
//! use hallservo::drive::{Channels, Command, Drive};
//! use hallservo::hall::estimate::Estimator;
//! use hallservo::service::Service;
//! use hallservo::settings::Settings;
//! use static_cell::ConstStaticCell;
//!
//! static CHANNELS: ConstStaticCell<Channels> = ConstStaticCell::new(Channels::new());
//! static ESTIMATORS: [ConstStaticCell<Estimator>; 2] = [const { ConstStaticCell::new(Estimator::blank()) }; 2];
//!
//! let config = Settings { pole_pairs: 7, ..Settings::default() }.validate()?;
//! let (interrupt, tasks) = CHANNELS.take().split();
//! let mut drive = Drive::new(config, interrupt); // the interrupt's
//! let mut service = Service::new(config, tasks, ESTIMATORS.each_ref().map(ConstStaticCell::take)); // a task's
//!
//! // In a task.
//! service.send(Command::Calibrate)?;
//! // In the interrupt, once a PWM period.
//! let output = drive.step(&Sample { halls: [2100, 1900, 2050], ..Sample::default() });
//! assert!(output.compare.iter().all(|&compare| compare < config.period));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]

pub mod angle;
pub mod board;
pub mod commutation;
pub mod config;
pub mod control;
pub mod crc;
pub mod double;
pub mod drive;
pub mod fault;
pub mod float;
/// Glossary: symbol, words, unit, range, and where each is defined.
///
#[doc = include_str!("../docs/glossary.md")]
pub mod glossary {}
pub mod hall;
mod math;
pub mod mode;
/// Porting: what a board gives and gets, step by step up to the first power-up.
///
#[doc = include_str!("../docs/porting.md")]
pub mod porting {}
pub mod pwm;
mod schedule;
pub mod scope;
pub mod service;
pub mod settings;
pub mod storage;
pub mod telemetry;
pub mod trig;
pub mod turn;
pub mod vernier;
