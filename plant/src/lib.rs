//! The physics that judges a brushless servo drive: motor, inverter, linear Hall sensors, converters.
//!
//! The crate knows physics only and shares no code with the drive that it judges. It is `no_std`,
//! allocates nothing, draws its randomness from a seeded generator and calls no floating-point
//! function but those of the `libm` crate, so that a host and a chip without an f64 unit compute
//! bit-identical results.
//!
//! Conventions:
//! - Units are SI and stand in the names (`_ohm`, `_nm`, `_v`, …); angles are radians.
//! - The electrical angle is θe = pole pairs · θ. The magnet flux linked with phase A is
//!   λ·cos θe, its back-EMF −λ·ωe·sin θe: at θe = 0 the d axis lies on phase A, and a current
//!   into A that returns through B and C holds the rotor there.
//! - Phase currents count as positive into the motor; terminal voltages are against the negative
//!   rail of the bus.
//! - A switching period begins and ends in the middle of the all-low state (the "valley"), where
//!   everything is sampled and where the ripple of the phase currents passes through zero.
//!
//! ```
//! use plant::{Legs, Plant, PlantParameters};
//! let mut plant = Plant::new(&PlantParameters::imperfect(1), 1)?;
//! for _ in 0..4000 {
//!     let codes = plant.sample();
//!     assert!(codes.halls.iter().all(|&code| code < 4096));
//!     plant.advance(&Legs::pwm([0.6, 0.45, 0.45])); // a field along phase A
//! }
//! // Within cogging and friction, the rotor has aligned with it.
//! assert!(plant.truth().electrical_angle_rad.abs() < 0.2);
//! # Ok::<(), plant::Error>(())
//! ```
#![no_std]

mod adc;
mod averaged;
mod bench;
mod bound;
mod bus;
pub mod construction;
mod emf;
mod error;
mod fault;
mod hall;
pub mod heads;
mod heat;
mod inverter;
mod iron;
mod load;
mod magnets;
mod motor;
mod noise;
mod parameters;
mod phasor;
mod plant;
pub mod rings;
mod rotor;
mod switched;
mod thermistor;
mod windings;

pub use adc::{AdcParameters, SenseParameters};
pub use bench::{Bench, BenchParameters};
pub use bound::{Bound, Prior};
pub use bus::BusParameters;
pub use emf::{BackEmf, PhaseSequence, Shape};
pub use error::Error;
pub use fault::{AmplifierFault, Transistor, Wires};
pub use hall::{HARMONICS, HallFault, HallParameters, Harmonic, Rail, Saturation};
pub use heat::HeatParameters;
pub use inverter::{InverterModel, InverterParameters, Leg, Legs};
pub use iron::Iron;
pub use load::LoadParameters;
pub use magnets::{Magnets, Modulation, Unevenness};
pub use motor::{MotorParameters, Slice};
pub use noise::Noise;
pub use parameters::{HallLayout, PlantParameters};
pub use phasor::Phasor;
pub use plant::{Codes, Plant, Truth};
pub use rotor::{Cogging, Friction};
pub use switched::Switch;
pub use thermistor::{Thermistor, ThermistorFault};
