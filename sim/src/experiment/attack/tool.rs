//! A tool at the drive's line.

use anyhow::{Context, Result};
use hallservo_protocol::{Answer, Ask, Decoder, FRAME, Reply, Request, Status, encode};
use simulator::Simulator;

/// Who asks.
const CLIENT: u32 = 7;
/// Milliseconds that it waits.
pub(super) const PATIENCE_MS: u32 = 300;

/// What the drive has answered.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Heard {
    Done,
    Refused(String),
    Status(Box<Status>),
    /// A setting's value, after it was set or asked for.
    Setting(f32),
    Other,
}

/// Speaks to a drive, one request after the other.
#[derive(Default)]
pub(super) struct Tool {
    id: u16,
    decoder: Decoder,
}

impl Tool {
    /// Sends a request.
    ///
    /// # Errors
    /// It does not fit into a frame.
    pub fn send(&mut self, drive: &mut Simulator, ask: Ask<'_>) -> Result<()> {
        self.id = self.id.wrapping_add(1);
        let mut frame = [0; FRAME];
        let request = Request { id: self.id, client: CLIENT, unattended: false, ask };
        let length = encode(&request, &mut frame).context("a request that fits into no frame")?;
        drive.write(&frame[..length]);
        Ok(())
    }

    /// The answer to the last request, once it is there.
    pub fn hear(&mut self, drive: &mut Simulator) -> Option<Heard> {
        let mut heard = None;
        for byte in drive.read() {
            if let Some(Ok(Reply { id, answer })) = self.decoder.push(byte)
                && id == self.id
            {
                heard = Some(understood(&answer));
            }
        }
        heard
    }
}

fn understood(answer: &Answer<'_>) -> Heard {
    match answer {
        Answer::Done => Heard::Done,
        Answer::Refused(refusal) => Heard::Refused(format!("{refusal:?}")),
        Answer::Status(status) => Heard::Status(Box::new(*status)),
        Answer::Setting(setting) => Heard::Setting(setting.value),
        _ => Heard::Other,
    }
}
