//! The serial line.

use crate::Supervisor;
use crate::encoder::Encoder;
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll};
use embedded_io_async::{Read, Write};
use embedded_storage::nor_flash::NorFlash;

/// Bytes read or written at once.
const PIECE: usize = 64;

/// Both directions, each with the bytes that are on their way.
pub(super) struct Line<R, W> {
    rx: R,
    tx: W,
    received: Piece,
    sent: Piece,
}

impl<R: Read, W: Write> Line<R, W> {
    pub const fn new(rx: R, tx: W) -> Self {
        Self { rx, tx, received: Piece::EMPTY, sent: Piece::EMPTY }
    }

    /// Carries what there is in both directions, as far as it has room. The rest waits for the next tick, or for the line.
    pub fn poll<F: NorFlash, E: Encoder>(&mut self, supervisor: &mut Supervisor<F, E>, context: &mut Context<'_>) {
        self.receive(supervisor, context);
        self.transmit(supervisor, context);
    }

    // Requests are large: what takes them has a stack frame of its own, which is not to add to the tick's.
    #[inline(never)]
    fn receive<F: NorFlash, E: Encoder>(&mut self, supervisor: &mut Supervisor<F, E>, context: &mut Context<'_>) {
        loop {
            if self.received.is_empty() {
                // Noise on the line is no byte.
                let length = look(self.rx.read(&mut self.received.bytes), context).and_then(Result::ok).unwrap_or(0);
                self.received.fill(length);
            }
            let taken = supervisor.receive(self.received.rest());
            self.received.advance(taken);
            if taken == 0 {
                break;
            }
        }
    }

    fn transmit<F: NorFlash, E: Encoder>(&mut self, supervisor: &mut Supervisor<F, E>, context: &mut Context<'_>) {
        loop {
            if self.sent.is_empty() {
                let length = supervisor.transmit(&mut self.sent.bytes);
                self.sent.fill(length);
            }
            if self.sent.is_empty() {
                let _ = look(self.tx.flush(), context);
                break;
            }
            match look(self.tx.write(self.sent.rest()), context) {
                Some(Ok(length)) if length > 0 => self.sent.advance(length),
                // A tool that is gone asks again when it is back.
                Some(Err(_)) => self.sent = Piece::EMPTY,
                _ => {
                    // Shows that it is served.
                    supervisor.transmit(&mut []);
                    break;
                }
            }
        }
    }
}

/// What a future is ready with.
fn look<T>(future: impl Future<Output = T>, context: &mut Context<'_>) -> Option<T> {
    match pin!(future).poll(context) {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    }
}

/// Bytes on their way, from `begin` to `end`.
struct Piece {
    bytes: [u8; PIECE],
    begin: usize,
    end: usize,
}

impl Piece {
    const EMPTY: Self = Self { bytes: [0; PIECE], begin: 0, end: 0 };

    const fn fill(&mut self, length: usize) {
        (self.begin, self.end) = (0, length);
    }

    const fn advance(&mut self, by: usize) {
        self.begin += by;
    }

    const fn is_empty(&self) -> bool {
        self.begin >= self.end
    }

    fn rest(&self) -> &[u8] {
        self.bytes.get(self.begin..self.end).unwrap_or_default()
    }
}
