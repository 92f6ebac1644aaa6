//! The way of a request to disarm past everything that waits: from where bytes arrive to the control interrupt.
//!
//! A request waits for its turn behind others, for room for its answer, and for tasks that fit, learn or save. So who
//! receives bytes, at a higher priority, hears a request to disarm with a [`Listener`] and leaves word in a [`Stop`],
//! which the control interrupt obeys. The bridge stays off until the tasks have dealt with all that came until then, the
//! request itself included: what was asked for before cannot switch it on in between.

use core::sync::atomic::{AtomicU32, Ordering};
use hallservo_protocol::{Ask, FrameDecoder, Request};

/// Longest frame of a request to disarm: COBS, version, number, client, whether unattended, request, CRC.
const ROOM: usize = 1 + 1 + 3 + 5 + 1 + 1 + 4;

/// Whether a request to disarm has come in that has not had its turn. A static.
#[derive(Debug, Default)]
pub struct Stop {
    /// Bytes handed to the tasks up to the end of the latest such request, wrapping. By the listener alone.
    until: AtomicU32,
    /// The same of the latest that the tasks have dealt with. By the tasks alone.
    done: AtomicU32,
}

impl Stop {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self { until: AtomicU32::new(0), done: AtomicU32::new(0) }
    }

    /// Whether the bridge is to be off; for the control interrupt: two loads.
    #[inline(always)]
    pub fn holds(&self) -> bool {
        self.until.load(Ordering::Relaxed) != self.done.load(Ordering::Relaxed)
    }

    /// The tasks have dealt with so many bytes: [`Supervisor::dealt_with`](crate::Supervisor::dealt_with).
    pub fn release(&self, bytes: u32) {
        let until = self.until.load(Ordering::Relaxed);
        if bytes.wrapping_sub(until) as i32 >= 0 {
            self.done.store(until, Ordering::Relaxed);
        }
    }
}

/// Hears requests to disarm in the bytes of a line. Nothing but a whole frame with its CRC is one.
#[derive(Debug)]
pub struct Listener {
    decoder: FrameDecoder<ROOM>,
    /// Bytes handed to the tasks, wrapping.
    handed_on: u32,
}

impl Listener {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self { decoder: FrameDecoder::new(), handed_on: 0 }
    }

    /// Every byte that arrives, and whether it was handed to the tasks or is lost for want of room.
    pub fn hear(&mut self, byte: u8, handed_on: bool, stop: &Stop) {
        self.handed_on = self.handed_on.wrapping_add(u32::from(handed_on));
        if let Some(Ok(Request { ask: Ask::Disarm, .. })) = self.decoder.push(byte) {
            stop.until.store(self.handed_on, Ordering::Relaxed);
        }
    }
}

impl Default for Listener {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hallservo_protocol::{FRAME, encode};

    fn frame(id: u16, ask: Ask<'_>) -> ([u8; FRAME], usize) {
        let mut frame = [0; FRAME];
        // The longest there is.
        let length = encode(&Request { id, client: u32::MAX, unattended: true, ask }, &mut frame).unwrap();
        (frame, length)
    }

    fn hear(listener: &mut Listener, stop: &Stop, id: u16, ask: Ask<'_>) -> u32 {
        let (frame, length) = frame(id, ask);
        frame[..length].iter().for_each(|byte| listener.hear(*byte, true, stop));
        length as u32
    }

    #[test]
    fn a_request_to_disarm_of_any_number_holds_until_it_is_dealt_with() {
        let (mut listener, stop, mut bytes) = (Listener::new(), Stop::new(), 0);
        for id in [0, 1, 127, 128, 300, 0x7fff, 0xffff] {
            bytes += hear(&mut listener, &stop, id, Ask::Arm);
            bytes += hear(&mut listener, &stop, id, Ask::Get("command_timeout_s"));
            assert!(!stop.holds());
            let before = bytes;
            bytes += hear(&mut listener, &stop, id, Ask::Disarm);
            assert!(stop.holds(), "{id}");
            stop.release(before);
            stop.release(bytes - 1);
            assert!(stop.holds(), "{id}");
            stop.release(bytes);
            assert!(!stop.holds(), "{id}");
        }
    }

    #[test]
    fn no_bit_may_be_wrong() {
        for bit in 0..8 * frame(300, Ask::Disarm).1 {
            let (mut listener, stop) = (Listener::new(), Stop::new());
            let (mut bytes, length) = frame(300, Ask::Disarm);
            bytes[bit / 8] ^= 1 << (bit % 8);
            // The zero in front only ends what was before it.
            let harmless = bit < 8 && bytes[1..].starts_with(&frame(300, Ask::Disarm).0[1..]);
            bytes[..length].iter().for_each(|byte| listener.hear(*byte, true, &stop));
            assert!(!stop.holds() || harmless, "bit {bit}");
        }
    }

    #[test]
    fn what_is_lost_on_the_way_to_the_tasks_does_not_count() {
        let (mut listener, stop) = (Listener::new(), Stop::new());
        let (bytes, length) = frame(7, Ask::Disarm);
        for (at, byte) in bytes[..length].iter().enumerate() {
            listener.hear(*byte, at < 3, &stop);
        }
        assert!(stop.holds());
        stop.release(2);
        assert!(stop.holds());
        stop.release(3);
        assert!(!stop.holds());
        // As many bytes as the count holds, and none to disarm.
        stop.release(u32::MAX / 2 + 3);
        stop.release(2);
        assert!(!stop.holds());
    }
}
