//! Talks to a hallservo drive over a serial line or TCP, and simulates one.
//!
//! [`link`] opens the line, [`client`] asks and waits for answers, [`words`] says what they mean and [`values`] gives it to a script, [`command`] is the
//! command line, [`share`] lets many tools have one drive ([`hub`] says who gets what), [`interrupt`] hears Ctrl-C, and [`simulate`] the drive that runs on this machine: the same [application](hallservo_app) as on a
//! chip, at a simulated motor.

pub mod client;
pub mod command;
pub mod error;
pub mod frequency;
pub mod hub;
pub mod interrupt;
pub mod link;
pub mod out;
pub mod resonance;
pub mod response;
pub mod scope;
#[cfg(unix)]
pub mod share;
pub mod simulate;
pub mod units;
pub mod values;
pub mod words;
