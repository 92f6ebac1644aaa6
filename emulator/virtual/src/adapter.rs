//! An adapter between the bus and a client: lines of text as those of an fdcanusb, on a pseudo-terminal or a local TCP
//! port. As on a serial line, check sums are asked for once one was seen, and always given.

use crate::serial::Port;
use anyhow::Result;
use chip::can::frame::Frame;
use chip::can::station::Station;
use chip::can::timing::Timing;
use hallservo_registers::line::{self, Decoder};
use hallservo_registers::{Reply, Request};
use std::io::Write;
use std::time::Duration;

/// Seconds of the boards' time that a frame is worth where they wait for the client, once it is answered …
const WORTH_S: f64 = 2e-3;
/// … and while it is not.
const LONGEST_S: f64 = 20e-3;
/// The bit of an identifier that asks for a reply.
const REPLY: u32 = 1 << 15;

/// The adapter. Its station on the bus belongs to [`Bus`](crate::bus::Bus).
pub struct Adapter {
    port: Port,
    waits: bool,
    decoder: Decoder,
    heard: Vec<u8>,
    unsent: Vec<u8>,
    until_s: f64,
    /// Frames that a reply is owed to.
    owed: usize,
}

impl Adapter {
    /// Opens a port and says what a client has to connect to. Who `waits` has no time of its own but the client's.
    ///
    /// # Errors
    /// As [`Port::open`].
    pub fn open(description: &str, waits: bool) -> Result<Adapter> {
        let (port, name) = Port::open(description)?;
        println!("fdcanusb: {name}");
        std::io::stdout().flush()?;
        let (heard, unsent) = (Vec::new(), Vec::new());
        Ok(Adapter { port, waits, decoder: Decoder::new(), heard, unsent, until_s: 0.2, owed: 0 })
    }

    /// What an adapter is on the bus.
    pub fn station() -> Station {
        Station::new(Timing::fast())
    }

    /// Passes on lines of the client and frames of the bus. Where the boards wait, a line is heard while time stands
    /// still, so that nothing depends on when it comes.
    pub fn serve(&mut self, station: &mut Station, now_s: f64) {
        for (_, frame) in core::mem::take(&mut station.received) {
            self.owed = self.owed.saturating_sub(1);
            if self.owed == 0 {
                self.until_s = self.until_s.min(now_s + WORTH_S);
            }
            let Ok(bytes) = frame.data.as_slice().try_into() else { continue };
            self.say(&line::reply(&Reply { identifier: frame.id, bytes }));
        }
        if !self.waits || now_s >= self.until_s {
            self.heard.extend(self.port.receive());
            self.hear(station, now_s);
        }
        if !self.unsent.is_empty() {
            let sent = self.port.send(&self.unsent);
            self.unsent.drain(..if self.waits { sent } else { self.unsent.len() });
        }
    }

    fn hear(&mut self, station: &mut Station, now_s: f64) {
        let length = self.heard.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
        for byte in self.heard.drain(..length).collect::<Vec<_>>() {
            match self.decoder.push(byte) {
                None => {}
                Some(Ok(Request { identifier, bytes })) => {
                    self.say(&line::ok());
                    station.send(now_s, Frame::switched(identifier, identifier > 0x7ff, &bytes));
                    self.owed += usize::from(identifier & REPLY != 0);
                    self.until_s = now_s + if self.owed > 0 { LONGEST_S } else { WORTH_S };
                }
                Some(Err(error)) => self.say(&line::error(error)),
            }
        }
    }

    fn say(&mut self, line: &str) {
        self.unsent.extend(line.bytes());
    }

    /// Whether time may pass, that being so late on the boards and on the wall.
    pub fn may_run(&mut self, now_s: f64, wall: Duration) -> bool {
        if !self.waits {
            return now_s < wall.as_secs_f64();
        }
        if now_s >= self.until_s {
            // Who has not been answered by now is not.
            self.owed = 0;
        }
        self.unsent.is_empty() && now_s < self.until_s
    }
}
