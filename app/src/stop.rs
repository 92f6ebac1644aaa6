//! The way of a request to stop past everything that waits: from where bytes and frames arrive to the control
//! interrupt.
//!
//! A request waits for its turn behind others, for room for its answer, and for tasks that fit, learn or save. So who
//! receives bytes or frames, at a higher priority, hears a request to disarm or a stop of the register protocol with a
//! listener and leaves word in a [`Stop`], which the control interrupt obeys. The bridge stays off until the tasks have
//! dealt with all that came until then, the request itself included: what was asked for before cannot switch it on in
//! between.

#[cfg(feature = "registers")]
mod frames;

use crate::{Ask, Request};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
#[cfg(feature = "registers")]
pub use frames::FrameListener;
use hallservo_protocol::FrameDecoder;
#[cfg(feature = "registers")]
use hallservo_registers::{Address, line};

/// Longest frame of a request to disarm: COBS, version, number, client, whether unattended, request, CRC.
const ROOM: usize = 1 + 1 + 3 + 5 + 1 + 1 + 4;
/// Where requests come from: the line and, for the register protocol, a bus.
const SOURCES: usize = if cfg!(feature = "registers") { 2 } else { 1 };
const LINE: usize = 0;

/// What the tasks have dealt with: [`Supervisor::dealt_with`](crate::Supervisor::dealt_with).
#[derive(Clone, Copy, Debug)]
pub struct Dealt {
    /// Bytes of the line, and frames of the bus, wrapping.
    pub(crate) counts: [u32; SOURCES],
    #[cfg(feature = "registers")]
    pub(crate) address: Address,
}

/// Whether a request to stop has come in that has not had its turn. A static.
#[derive(Debug, Default)]
pub struct Stop {
    /// Such requests, wrapping. By the listeners, of which none interrupts another.
    heard: AtomicU32,
    /// Those that the tasks have dealt with. By the tasks alone, as what follows but one.
    done: AtomicU32,
    /// Bytes or frames handed to the tasks up to the end of the latest, wrapping. By the listener alone.
    until: [AtomicU32; SOURCES],
    /// The same of the latest that the tasks have dealt with.
    dealt: [AtomicU32; SOURCES],
    /// The drive's address, as in an identifier.
    #[cfg(feature = "registers")]
    address: AtomicU32,
}

impl Stop {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self {
            heard: AtomicU32::new(0),
            done: AtomicU32::new(0),
            until: [const { AtomicU32::new(0) }; SOURCES],
            dealt: [const { AtomicU32::new(0) }; SOURCES],
            #[cfg(feature = "registers")]
            address: AtomicU32::new(1),
        }
    }

    /// Whether the bridge is to be off; for the control interrupt: two loads.
    #[inline(always)]
    pub fn holds(&self) -> bool {
        self.heard.load(Relaxed) != self.done.load(Relaxed)
    }

    /// The tasks have dealt with so much, after every tick.
    pub fn release(&self, dealt: &Dealt) {
        #[cfg(feature = "registers")]
        self.address.store(u32::from(dealt.address.prefix) << 16 | u32::from(dealt.address.id), Relaxed);
        if !self.holds() {
            return;
        }
        // What is heard from now on is not among these.
        let heard = self.heard.load(Relaxed);
        let mut is_over = true;
        for ((until, before), count) in self.until.iter().zip(&self.dealt).zip(dealt.counts) {
            let until = until.load(Relaxed);
            // A mark that was reached before says nothing more.
            if until == before.load(Relaxed) || count.wrapping_sub(until) as i32 >= 0 {
                before.store(until, Relaxed);
            } else {
                is_over = false;
            }
        }
        if is_over {
            self.done.store(heard, Relaxed);
        }
    }

    /// A request has come, with which so much was handed to the tasks.
    fn hear(&self, source: usize, handed_on: u32) {
        if let Some(until) = self.until.get(source) {
            until.store(handed_on, Relaxed);
        }
        self.heard.store(self.heard.load(Relaxed).wrapping_add(1), Relaxed);
    }

    #[cfg(feature = "registers")]
    fn address(&self) -> Address {
        let address = self.address.load(Relaxed);
        Address { id: address as u8, prefix: (address >> 16) as u16 }
    }
}

/// Hears requests to stop in the bytes of a line: a whole frame to disarm, with its CRC; with the feature `registers` also
/// lines of the register protocol with the mode "stopped", and where there is a diagnostic channel with `d stop`.
#[derive(Debug)]
pub struct Listener {
    decoder: FrameDecoder<ROOM>,
    #[cfg(feature = "registers")]
    lines: line::Decoder,
    /// Bytes handed to the tasks, wrapping.
    handed_on: u32,
}

impl Listener {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self {
            decoder: FrameDecoder::new(),
            #[cfg(feature = "registers")]
            lines: line::Decoder::new(),
            handed_on: 0,
        }
    }

    /// Every byte that arrives, and whether it was handed to the tasks or is lost for want of room.
    pub fn hear(&mut self, byte: u8, handed_on: bool, stop: &Stop) {
        self.handed_on = self.handed_on.wrapping_add(u32::from(handed_on));
        let disarms = matches!(self.decoder.push(byte), Some(Ok(Request { ask: Ask::Disarm, .. })));
        if disarms || self.is_stopped(byte, stop) {
            stop.hear(LINE, self.handed_on);
        }
    }

    #[cfg(feature = "registers")]
    fn is_stopped(&mut self, byte: u8, stop: &Stop) -> bool {
        let request = self.lines.push(byte).and_then(Result::ok);
        request.is_some_and(|request| stop.address().is_meant(request.identifier) && frames::stops(&request.bytes))
    }

    #[cfg(not(feature = "registers"))]
    const fn is_stopped(&mut self, _: u8, _: &Stop) -> bool {
        false
    }
}

impl Default for Listener {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
