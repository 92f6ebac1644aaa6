//! Frames on their way out.

use hallservo_protocol::{Answer, FRAME, encode};
use heapless::Deque;

/// Bytes that may wait to be transmitted.
const ROOM: usize = 3 * FRAME;

/// Ticks until answers that nobody takes are dropped.
const PATIENCE: u32 = 100;

/// Whole frames, in the order in which they go out.
pub(crate) struct Outbox {
    bytes: Deque<u8, ROOM>,
    /// Ticks without room for an answer and without a byte taken.
    ticks_stuck: u32,
}

impl Outbox {
    pub const fn new() -> Self {
        Self { bytes: Deque::new(), ticks_stuck: 0 }
    }

    /// Once a millisecond: drops answers that nobody takes, as no request, not even to disarm, is read before there is
    /// room for its answer. Whether it did.
    pub fn tick(&mut self) -> bool {
        self.ticks_stuck = if self.has_room() { 0 } else { self.ticks_stuck + 1 };
        let drops = self.ticks_stuck >= PATIENCE;
        if drops {
            self.bytes.clear();
        }
        drops
    }

    /// Whether an answer of any length has room.
    pub fn has_room(&self) -> bool {
        self.spare() >= FRAME
    }

    fn spare(&self) -> usize {
        ROOM - self.bytes.len()
    }

    /// Adds an answer, for which there [is room](Self::has_room).
    pub fn push(&mut self, id: u16, answer: &Answer<'_>) {
        self.push_beside(id, answer, 0);
    }

    /// Adds a frame that may be lost, if an answer still has room after it.
    pub fn push_if_spare(&mut self, id: u16, answer: &Answer<'_>) -> bool {
        self.push_beside(id, answer, FRAME)
    }

    #[inline(never)]
    fn push_beside(&mut self, id: u16, answer: &Answer<'_>, reserve: usize) -> bool {
        let mut frame = [0; FRAME];
        // Encoded as a `Reply` is, whose answer would have to be moved there. Every one fits a frame, which a test shows.
        let length = encode(&(id, answer), &mut frame).unwrap_or(0);
        let fits = length + reserve <= self.spare();
        if fits {
            for byte in frame.into_iter().take(length) {
                // It has room.
                let _ = self.bytes.push_back(byte);
            }
        }
        fits
    }

    /// Adds a line of text, for which there [is room](Self::has_room) beside one that acknowledges it.
    #[cfg(feature = "registers")]
    pub fn push_line(&mut self, line: &str) {
        for byte in line.bytes() {
            // It has room.
            let _ = self.bytes.push_back(byte);
        }
    }

    /// Takes as many bytes as there are, or have room.
    pub fn pop(&mut self, bytes: &mut [u8]) -> usize {
        let mut length = 0;
        for place in bytes {
            let Some(byte) = self.bytes.pop_front() else { break };
            self.ticks_stuck = 0;
            *place = byte;
            length += 1;
        }
        length
    }
}
