//! A tool at the drive's line.

use anyhow::{Context, Result};
use hallservo::hall::calibrate::report::Report;
use hallservo_protocol::{Answer, Ask, Calibration, Decoder, FRAME, Reply, Request, Status, encode};
use simulator::Simulator;

/// Who asks.
const CLIENT: u32 = 7;
/// Milliseconds that it waits.
pub(super) const PATIENCE_MS: u32 = 300;

/// Lag and swing of the rotor, degrees, and what no turning magnet explains, per cent, up to which commissioning is content.
const GOOD: [f32; 3] = [40.0, 4.5, 2.9];

/// What the drive has answered.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Heard {
    Done,
    Refused(String),
    Status(Box<Status>),
    /// A setting's value, after it was set or asked for.
    Setting(f32),
    /// Whether the calibration is as good as commissioning takes it.
    Calibrated(bool),
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
        Answer::Calibration(Calibration::Done(report)) => {
            let Report { lag, hunting_deg, residual_pct, .. } = report;
            let [lag_deg, most_deg, most_pct] = GOOD;
            let good = lag.to_degrees().abs() <= lag_deg && *hunting_deg <= most_deg && *residual_pct <= most_pct;
            Heard::Calibrated(good)
        }
        _ => Heard::Other,
    }
}
