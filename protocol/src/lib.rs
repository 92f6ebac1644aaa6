//! The messages between a drive and its tools, and the frames that carry them over a UART, a TCP stream or a
//! pseudo-terminal.
//!
//! `no_std`, no allocation: a board and a host use the same code. Modes, faults, reports and errors are the types of
//! [`hallservo`], which travel as they are. A UART runs at [`BAUD`], 8N1.
//!
//! # Frame
//! ```text
//! 0x00 │ COBS( version: u8 │ message, by postcard │ CRC-32 of both, little endian ) │ 0x00
//! ```
//! COBS leaves no zero inside, so a reader that has lost its way finds it again at the next zero; empty frames are
//! ignored. The leading zero ends whatever noise or cut-off frame came before. The CRC is that of ISO-HDLC (zlib,
//! Ethernet). A message has at most [`MESSAGE`] bytes, a frame at most [`FRAME`]: longer ones are refused as a whole.
//!
//! # Conversation
//! A tool sends [`Request`]s, the drive answers each by one [`Reply`] with the same `id`, in their order.
//! [`Ask::Telemetry`] makes the drive send further [`Answer::Telemetry`] with the id of the request, until it is asked
//! for a rate of zero; a [`Telemetry::number`] left out is a frame lost. A frame that cannot be understood gets no
//! reply, but counts in [`Status::garbage`]; one of another version gets a frame of the drive's version.
//!
//! # Who controls
//! Any number of tools may read. One controls: the first [`Request::client`] that asks for anything but a look, until
//! [`Ask::Release`], a [`Ask::Disarm`] by anyone, or `command_timeout_s` without a request of any kind from it. Others
//! are told [`Refusal::Controlled`] meanwhile; [`Ask::Disarm`] is everybody's at any time. A calibration and the
//! procedures that turn the motor end, bridge off, when the tool that controls falls silent for that long, unless it
//! began them [unattended](Request::unattended). That telemetry is sent is no sign of life.
//!
//! Where the drive has stopped its motor for want of commands and the tool has lost the control by its silence, what still
//! comes of it may have lain in a buffer: its [set-points](Ask::is_set_point) are refused with
//! [`CommandTimeout`](hallservo::fault::Fault::CommandTimeout) until it asks for [`Ask::Release`], or until the bridge has
//! been off.
//!
//! # Versions
//! Framing, CRC and the version's place never change; any change of a message raises [`VERSION`]. Who receives a frame
//! of another version gets [`Error::Version`], which names both, and must not guess at the rest.
#![no_std]

#[cfg(feature = "encoder")]
mod encoder;
mod fields;
mod frame;
mod history;
#[cfg(feature = "map")]
mod magnets;
mod message;
mod report;
#[cfg(feature = "scope")]
mod scope;
mod status;

#[cfg(feature = "encoder")]
pub use encoder::{EncoderAsk, EncoderCalibration, EncoderRefusal, EncoderStatus};
pub use frame::{Decoder, Error, FrameDecoder, encode};
pub use history::{Cause, History, Incident};
#[cfg(feature = "map")]
pub use magnets::{CoggingByPole, MagnetsAsk, MagnetsRefusal, MagnetsReport, MagnetsStatus, POINTS_AT_ONCE};
#[cfg(all(feature = "scope", not(all(feature = "encoder", feature = "map"))))]
pub use message::Absent;
pub use message::{Answer, Ask, AskBy, Hello, Refusal, Reply, Request, RequestBy, Setting};
pub use report::{Calibration, Cogging, Procedure};
#[cfg(feature = "scope")]
pub use scope::{ROWS_AT_ONCE, ScopeAsk, ScopeRefusal, ScopeRows, ScopeStatus};
pub use status::{Activity, Learning, Problem, Record, Status, Telemetry};

/// Version of the messages.
pub const VERSION: u8 = 14;
/// Most bytes of a message.
pub const MESSAGE: usize = 244;
/// Most bytes of a frame, zeros included: version and CRC on top of the message, one byte of COBS for each 254, two
/// zeros.
pub const FRAME: usize = 1 + (1 + MESSAGE + 4 + 1) + 1;
/// Bits a second of a UART.
pub const BAUD: u32 = 460_800;
