//! The log: RTT's up-channel out of RAM, as a debug probe reads it, and defmt's frames in it.

use crate::image::Image;
use crate::machine::Machine;
use anyhow::{Context, Result};
use bus::Bus;
use defmt_decoder::{DecodeError, Frame, Location, Locations, StreamDecoder, Table};
use std::rc::Rc;

/// The control block begins with this, then come the counts of up- and down-channels and the channels' descriptors, of
/// which each is name, buffer, size, write offset, read offset, flags.
const ID: &[u8] = b"SEGGER RTT";

/// Reads up-channel 0.
#[derive(Clone, Copy, Debug)]
pub struct Rtt {
    block: u32,
}

fn word<S: Bus>(machine: &Machine<S>, address: u32) -> Option<u32> {
    Some(u32::from_le_bytes(machine.ram(address, 4)?.try_into().ok()?))
}

impl Rtt {
    /// By the firmware's symbol `_SEGGER_RTT`.
    pub fn find(image: &Image) -> Option<Rtt> {
        image.symbol("_SEGGER_RTT").map(|block| Rtt { block })
    }

    /// What has been written since the last call; nothing before the firmware has set up the channel.
    pub fn read<S: Bus>(&self, machine: &mut Machine<S>) -> Vec<u8> {
        self.take(machine).unwrap_or_default()
    }

    fn take<S: Bus>(&self, machine: &mut Machine<S>) -> Option<Vec<u8>> {
        if !machine.ram(self.block, 16)?.starts_with(ID) {
            return None;
        }
        let channel = self.block + 24;
        let (buffer, size) = (word(machine, channel + 4)?, word(machine, channel + 8)?);
        let (write, read) = (word(machine, channel + 12)?, word(machine, channel + 16)?);
        if write >= size || read >= size || write == read {
            return None;
        }
        let bytes = if write > read {
            machine.ram(buffer + read, write - read)?.to_vec()
        } else {
            let mut bytes = machine.ram(buffer + read, size - read)?.to_vec();
            bytes.extend_from_slice(machine.ram(buffer, write)?);
            bytes
        };
        machine.write_ram(channel + 16, &write.to_le_bytes())?;
        // As a probe does: the firmware may block rather than drop, since somebody reads.
        let flags = word(machine, channel + 20)?;
        machine.write_ram(channel + 20, &((flags & !3) | 2).to_le_bytes())?;
        Some(bytes)
    }
}

/// One line of the log.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LogLine {
    /// Virtual time when it was read, nanoseconds since power-on.
    pub at_ns: u64,
    /// `ERROR` to `TRACE`; empty for `println!`.
    pub level: String,
    /// The firmware's own time stamp, as it displays it.
    pub stamp: String,
    /// The message.
    pub message: String,
    /// File and line of the log statement.
    pub place: String,
}

/// Decodes defmt's frames.
pub struct Log {
    table: &'static Table,
    decoder: Box<dyn StreamDecoder>,
    locations: Rc<Locations>,
}

impl Log {
    /// With the table in the firmware's file; `None` where it has none.
    pub fn new(image: &Image) -> Result<Option<Log>> {
        let Some(table) = Table::parse(&image.elf).context("the firmware's defmt table")? else { return Ok(None) };
        let locations = table.get_locations(&image.elf).context("the firmware's debug information")?;
        // The table lives as long as the process: there is one firmware, and the decoder borrows it.
        let table: &'static Table = Box::leak(Box::new(table));
        Ok(Some(Log { table, decoder: table.new_stream_decoder(), locations: Rc::new(locations) }))
    }

    /// The same firmware's, from the begin of a frame.
    pub fn again(&self) -> Log {
        let Self { table, locations, .. } = self;
        Log { table, decoder: table.new_stream_decoder(), locations: Rc::clone(locations) }
    }

    /// Lines that these bytes complete. What cannot be decoded is a line of its own.
    pub fn decode(&mut self, bytes: &[u8], at_ns: u64) -> Vec<LogLine> {
        self.decoder.received(bytes);
        let mut lines = Vec::new();
        loop {
            match self.decoder.decode() {
                Ok(frame) => lines.push(line(&frame, self.locations.get(&frame.index()), at_ns)),
                Err(DecodeError::UnexpectedEof) => return lines,
                Err(DecodeError::Malformed) => lines.push(LogLine {
                    at_ns,
                    level: "ERROR".into(),
                    stamp: String::new(),
                    message: "malformed defmt frame".into(),
                    place: String::new(),
                }),
            }
        }
    }
}

fn line(frame: &Frame, location: Option<&Location>, at_ns: u64) -> LogLine {
    LogLine {
        at_ns,
        level: frame.level().map(|level| level.as_str().to_uppercase()).unwrap_or_default(),
        stamp: frame.display_timestamp().map(|stamp| stamp.to_string()).unwrap_or_default(),
        message: frame.display_message().to_string(),
        place: location
            .map(|location| {
                let file = location.file.file_name().unwrap_or_default();
                format!("{}:{}", file.display(), location.line)
            })
            .unwrap_or_default(),
    }
}
