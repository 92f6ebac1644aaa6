//! A servo drive from a brushless motor, three cheap linear Hall sensors and a Cortex-M.
//!
//! `no_std`, no allocation, no `unsafe`. What runs in the control interrupt is integer arithmetic without a panic:
//! one [`Sample`](board::Sample) of the sensors in, one [`Output`](board::Output) for the timer out, by
//! [`Drive::step`](drive::Drive::step). Tasks at a lower rate calibrate and supervise it through lock-free queues, by
//! [`Service`](service::Service).
//!
//! | module | |
//! |---|---|
//! | [`angle`], [`trig`] | wrapping 32-bit turns; sine, arcsine and arctangent by tables, each with its proven error |
//! | [`hall`] | normalise, estimate, track, calibrate, adapt |
//! | [`vernier`] | the absolute angle from two rings |
//! | [`commutation`], [`pwm`] | block, sinusoidal and field-oriented; compare values, limits, dead time, choice of the frequency |
//! | [`control`] | current, speed, position, trajectory; gains by bandwidth |
//! | [`settings`], [`config`] | what a person sets; what the interrupt works with |
//! | [`drive`], [`mode`], [`fault`], [`telemetry`] | the control interrupt and its states |
//! | [`service`], [`storage`] | the tasks' side of a drive; what survives a power cut |
//! | [`glossary`] | every symbol and word with its unit and range |
//!
//! The methods are those of Simpkins and Todorov, *Position Estimation and Control of Compact BLDC Motors Based on
//! Analog Linear Hall Effect Sensors* (2010), and of Bakos, Gőzse and Soumelidis, *Design and Analysis of a Magnetic
//! Off-axis Rotary Position Sensing Device*, with corrections where the printed equations do not hold; each is told
//! where it is used.
//!
//! # Example
//! ```
//! use hallservo::drive::{Channels, Command, Drive, Sample};
//! use hallservo::hall::estimate::Estimator;
//! use hallservo::service::Service;
//! use hallservo::settings::Settings;
//!
//! // What a board keeps in statics.
//! let channels: &'static mut Channels = Box::leak(Box::new(Channels::new()));
//! let estimators = [(); 2].map(|()| &mut *Box::leak(Box::new(Estimator::blank())));
//!
//! let config = Settings { pole_pairs: 7, ..Settings::default() }.validate()?;
//! let (interrupt, tasks) = channels.split();
//! let mut drive = Drive::new(config, interrupt); // the interrupt's
//! let mut service = Service::new(config, tasks, estimators); // a task's
//!
//! service.send(Command::Calibrate).expect("the queue is empty");
//! let output = drive.step(&Sample { halls: [2100, 1900, 2050], ..Default::default() }); // in the interrupt
//! assert!(output.compare.iter().all(|&compare| compare < config.period));
//! # Ok::<(), hallservo::settings::Error<'static>>(())
//! ```
#![no_std]

pub mod angle;
pub mod board;
pub mod commutation;
pub mod config;
pub mod control;
pub mod drive;
pub mod fault;
/// Glossary: symbol, words, unit, range, and where each is defined.
///
#[doc = include_str!("../docs/glossary.md")]
pub mod glossary {}
pub mod hall;
mod math;
pub mod mode;
pub mod pwm;
mod schedule;
pub mod service;
pub mod settings;
pub mod storage;
pub mod telemetry;
pub mod trig;
pub mod vernier;
