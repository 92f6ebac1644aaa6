//! Frames on their way out.

use hallservo_protocol::{FRAME, Reply, encode};
use heapless::Deque;

/// Bytes that may wait to be transmitted.
const ROOM: usize = 3 * FRAME;

/// Whole frames, in the order in which they go out.
pub(crate) struct Outbox(Deque<u8, ROOM>);

impl Outbox {
    pub const fn new() -> Self {
        Self(Deque::new())
    }

    /// Whether an answer of any length has room.
    pub fn has_room(&self) -> bool {
        self.spare() >= FRAME
    }

    fn spare(&self) -> usize {
        ROOM - self.0.len()
    }

    /// Adds an answer, for which there [is room](Self::has_room).
    pub fn push(&mut self, reply: &Reply<'_>) {
        self.push_beside(reply, 0);
    }

    /// Adds a frame that may be lost, if an answer still has room after it.
    pub fn push_if_spare(&mut self, reply: &Reply<'_>) -> bool {
        self.push_beside(reply, FRAME)
    }

    #[inline(never)]
    fn push_beside(&mut self, reply: &Reply<'_>, reserve: usize) -> bool {
        let mut frame = [0; FRAME];
        // Every reply fits a frame, which a test shows.
        let length = encode(reply, &mut frame).unwrap_or(0);
        let fits = length + reserve <= self.spare();
        if fits {
            for byte in frame.into_iter().take(length) {
                // It has room.
                let _ = self.0.push_back(byte);
            }
        }
        fits
    }

    /// Takes as many bytes as there are, or have room.
    pub fn pop(&mut self, bytes: &mut [u8]) -> usize {
        let mut length = 0;
        for place in bytes {
            let Some(byte) = self.0.pop_front() else { break };
            *place = byte;
            length += 1;
        }
        length
    }
}
