//! All integration tests as one program: linking one for each file takes longer than running most of them.

mod at_rest;
mod broken_off;
#[cfg(unix)]
mod clumsy;
#[cfg(unix)]
mod cogging;
mod coil;
mod commission;
mod control;
mod diagnostic;
mod docs;
mod encoder;
mod encoder_loops;
mod end_to_end;
mod hostile;
mod hub;
mod impedance;
mod learning;
mod magnets;
mod process;
#[cfg(unix)]
mod readme;
mod record;
mod registers;
mod resonance;
mod retune;
mod scope;
#[cfg(unix)]
mod scripts;
mod silence;
mod steps;
#[cfg(unix)]
mod stopping;
mod switching;
mod tasks;
mod tool;
mod two_halls;
