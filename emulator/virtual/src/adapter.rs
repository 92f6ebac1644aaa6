//! An adapter between the bus and a client: lines of text as those of an fdcanusb, on a pseudo-terminal or a local TCP
//! port. As on a serial line, check sums are asked for once one was seen, and always given.

use crate::serial::{Port, REPLY};
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
/// … and while it is not: as long as a task may be kept from it, by a save to the flash or a model of the sensors.
const LONGEST_S: f64 = 0.2;

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
        while let Some(end) = self.heard.iter().position(|byte| *byte == b'\n') {
            let text: Vec<u8> = self.heard.drain(..=end).collect();
            let (format, text) = Format::of(text);
            let Some(format) = format else {
                // It is always on, and has nothing to be set.
                self.say(&line::ok());
                continue;
            };
            for byte in text {
                match self.decoder.push(byte) {
                    None => {}
                    Some(Ok(request)) => {
                        self.say(&line::ok());
                        self.owed += usize::from(request.identifier & REPLY != 0);
                        station.send(now_s, format.frame(&request));
                        self.until_s = now_s + if self.owed > 0 { LONGEST_S } else { WORTH_S };
                    }
                    Some(Err(error)) => self.say(&line::error(error)),
                }
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

/// How a frame is to be sent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Format {
    /// With 29 bits, or 11; else as many as it needs.
    extended: Option<bool>,
    classic: bool,
    at_one_rate: bool,
}

impl Format {
    /// Of a line, which becomes a `can send`; `None` where it is about the adapter itself.
    fn of(line: Vec<u8>) -> (Option<Self>, Vec<u8>) {
        let words: Vec<&[u8]> = line.trim_ascii().split(|byte| *byte == b' ').collect();
        let extended = match words[..] {
            [b"can", b"on" | b"off" | b"status", ..] | [b"conf", ..] => return (None, line),
            [b"can", b"std", ..] => Some(false),
            [b"can", b"ext", ..] => Some(true),
            _ => None,
        };
        let flags: Vec<u8> = words
            .iter()
            .skip(4)
            .filter(|word| word[..1.min(word.len())] != *b"*")
            .flat_map(|word| word.to_vec())
            .collect();
        let format = Self { extended, classic: flags.contains(&b'f'), at_one_rate: flags.contains(&b'b') };
        let text = if extended.is_some() { [b"can send", &line[b"can std".len()..]].concat() } else { line };
        (Some(format), text)
    }

    fn frame(self, Request { identifier, bytes }: &Request) -> Frame {
        let extended = self.extended.unwrap_or(*identifier > 0x7ff) || *identifier > 0x7ff;
        let frame = Frame::switched(*identifier, extended, bytes);
        // What is too long for a classic frame is none.
        let fd = !self.classic || frame.data.len() > 8;
        Frame { fd, switched: fd && !self.at_one_rate, ..frame }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(line: &str) -> Option<Frame> {
        let (format, text) = Format::of(line.into());
        let mut decoder = Decoder::new();
        let request = text.into_iter().find_map(|byte| decoder.push(byte))?.ok()?;
        format.map(|format| format.frame(&request))
    }

    #[test]
    fn lines_are_frames() {
        let query = Frame::switched(0x8001, true, &[0x11, 0]);
        assert_eq!(sent("can send 8001 1100\n"), Some(query.clone()));
        assert_eq!(sent("can ext 8001 1100 B F\n"), Some(query.clone()));
        assert_eq!(sent("can send 8001 1100 b\n"), Some(Frame { switched: false, ..query.clone() }));
        assert_eq!(sent("can std 101 1100 f\n"), Some(Frame { id: 0x101, data: vec![0x11, 0], ..Frame::default() }));
        assert_eq!(sent("can ext 101 1100\n"), Some(Frame { id: 0x101, ..query }));
        assert_eq!(sent("can send 8001 110\n"), None);
        assert_eq!(Format::of(b"can on\n".to_vec()).0, None);
        assert_eq!(Format::of(b"conf get can.bitrate\n".to_vec()).0, None);
    }

    #[test]
    fn frames_go_out_and_replies_come_back_and_time_is_the_clients() {
        let mut adapter = Adapter::open("tcp:127.0.0.1:0", true).unwrap();
        let mut station = Adapter::station();
        let wall = Duration::ZERO;
        assert!(adapter.may_run(0.1, wall) && !adapter.may_run(0.2, wall), "time to start is given");
        adapter.heard = b"can send 8001 1100\ncan se".to_vec();
        adapter.hear(&mut station, 0.2);
        assert_eq!((station.waiting(), &adapter.heard[..]), (1, &b"can se"[..]));
        assert!(adapter.unsent.starts_with(b"OK"));
        adapter.unsent.clear();
        assert!(adapter.may_run(0.39, wall) && !adapter.may_run(0.401, wall), "until it is answered, or 0.2 s");
        adapter.heard = b"can send 8001 1100\n".to_vec();
        adapter.hear(&mut station, 1.0);
        adapter.unsent.clear();
        station.received.push((1.001, Frame::switched(0x100, false, &[0x21, 0, 0])));
        adapter.serve(&mut station, 1.001);
        assert!(adapter.may_run(1.002, wall) && !adapter.may_run(1.0031, wall), "and two more");
    }
}
