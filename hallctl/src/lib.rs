//! Talks to a hallservo drive over a serial line or TCP, and simulates one.
//!
//! [`link`] opens the line, [`client`] asks and waits for answers, [`words`] says what they mean, [`command`] is the
//! command line, and [`simulate`] the drive that runs on this machine: the same [application](hallservo_app) as on a
//! chip, at a simulated motor.

pub mod client;
pub mod command;
pub mod error;
pub mod link;
pub mod simulate;
pub mod words;
