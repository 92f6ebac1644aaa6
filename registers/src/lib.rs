//! The register protocol that moteus clients speak, for a hallservo drive: compatible with the clients, and made from
//! the protocol's public documentation (repository `mjbots/moteus`: `docs/protocol/can.md` and `registers.md`,
//! `docs/integration/uart.md`).
//!
//! `no_std`, no allocation, no `unsafe`, and nothing of a drive: what a drive has to offer is the trait [`Axis`].
//!
//! ```text
//! serial line ── line::Decoder ─┐                      ┌─ Axis: the drive
//!                               ├─ Request ── Server ──┤
//! CAN-FD ───────────────────────┘     │                └─ Tunnel: the diagnostic channel
//!                                     └─ Reply ── line::reply, or CAN-FD
//! ```
//!
//! A frame is taken as a whole or not at all: one that is cut off, or has a register or a value that is refused,
//! commands nothing.
#![no_std]

pub mod axis;
pub mod diagnostic;
mod fields;
pub mod frame;
pub mod line;
pub mod register;
mod server;
mod stops;
mod tunnel;

pub use axis::Axis;
pub use server::{Address, BROADCAST, Reply, Request, Server};
pub use stops::stops;
pub use tunnel::{NoTunnel, Tunnel};

/// Most bytes of a frame, as CAN-FD has it.
pub const FRAME: usize = 64;
