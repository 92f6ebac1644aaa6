//! Absolute angle from two magnetised rings of coprime pole-pair counts: the vernier, or nonius.
//!
//! A head over a ring tells where it stands within one pole pair, but not within which. Two rings whose pole-pair
//! counts have no common divisor show a pair of readings that never repeats within a turn. From it an
//! [`Encoder`](encoder::Encoder) takes the number of the pole pair, and with it the absolute angle, from the first
//! sample on. After Bakos, Gőzse and Soumelidis, "Design and Analysis of a Magnetic Off-axis Rotary Position Sensing
//! Device", corrected.
//!
//! - [`rings`]: the two rings and the error that they forgive.
//! - [`decode`]: the pole pair in a handful of instructions.
//! - [`correct`]: what the heads' nonlinearity does to a reading, undone.
//! - [`eccentricity`]: what an eccentric ring does, and how much of it the construction bears.
//! - [`calibrate`]: tables and averages from a few turns of the drive, without a reference encoder.
//! - [`encoder`]: everything together, sample by sample, with the faults it reports.
//! - [`fit`]: how the encoder sits on the rotor's shaft.
//! - [`head`]: a head with sine and cosine outputs.
//! - [`settings`]: what a person sets.
//! - [`turns`]: the Hall sensors' turn counter, given its start and checked.
//!
//! **Readings.** Throughout, a reading is a `u16` fraction of a pole pair, 2¹⁶ to one: the code of a head with fewer
//! bits stands at the left ([`rings::Rings::reading`]). **Residuals** are measured in 2⁻¹⁶ of the distance between two
//! entries of the decoder's table, so that the margin is ±2¹⁵ whatever the rings ([`rings::Rings::residual_counts`]).

pub mod calibrate;
pub mod continuity;
pub mod correct;
pub mod decode;
pub mod eccentricity;
pub mod encoder;
pub mod fit;
pub mod head;
pub mod rings;
pub mod settings;
pub mod turns;
