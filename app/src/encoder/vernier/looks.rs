//! What the samples of the encoder tell.

use super::Vernier;
use hallservo::angle::ElectricalAngle;
use hallservo::drive::absolute::SampleOf;
use hallservo::mode::Mode;
use hallservo::vernier::encoder::{Encoder, Reading};
use hallservo::vernier::fit::tolerance_at_rest;

/// Samples over which encoder and Halls have to agree before the position counts from the encoder's zero: 13 ms.
const SAMPLES: u32 = 64;

/// The mean distance of Halls and encoder.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    first: Option<ElectricalAngle>,
    sum: i64,
    count: u32,
    /// By how much the Halls were ahead over the last samples.
    pub ahead: Option<ElectricalAngle>,
}

impl Agreement {
    /// Takes a sample; true when there are enough, whose mean is then known.
    fn push(&mut self, ahead: ElectricalAngle) -> bool {
        let first = *self.first.get_or_insert(ahead);
        self.sum += i64::from((ahead - first).to_bits());
        self.count += 1;
        if self.count < SAMPLES {
            return false;
        }
        let mean = ElectricalAngle::from_bits((self.sum / i64::from(self.count)) as i32);
        *self = Self { ahead: Some(first + mean), ..Self::default() };
        true
    }

    /// A sample without an angle.
    fn restart(&mut self) {
        *self = Self { ahead: self.ahead, ..Self::default() };
    }
}

impl<const HEADS: usize> Vernier<HEADS> {
    /// Takes all samples that have come.
    pub(super) fn take_samples(&mut self, mode: Mode) {
        while let Some(sample) = self.tasks.take() {
            if let Some(calibration) = self.calibration {
                calibration.sample(&sample);
            }
            if self.installed {
                self.last = Some(sample);
            }
            match sample.angle {
                Some(Ok(_)) => self.take_residual(sample.reading),
                Some(Err(fault)) => {
                    self.last_fault = Some(fault);
                    self.missed = self.missed.saturating_add(1);
                }
                None => {}
            }
            self.compare(&sample, mode);
        }
    }

    fn take_residual(&mut self, reading: Reading<HEADS>) {
        if let Some(decoder) = self.decoder {
            self.worst_residual = self.worst_residual.max(decoder.decode(reading).residual.unsigned_abs());
        }
    }

    /// Compares the electrical angles of Halls and encoder. Where they agree, with the bridge off, the position counts
    /// from the encoder's zero from then on; where they do not, no longer.
    fn compare(&mut self, sample: &SampleOf<Encoder<HEADS>>, mode: Mode) {
        let (Some(mounting), Some(Ok(angle))) = (&self.mounting, sample.angle) else {
            return self.agreement.restart();
        };
        if !matches!(mode, Mode::Ready | Mode::Running | Mode::Faulted(_)) {
            return self.agreement.restart();
        }
        let ahead = sample.halls.angle() - mounting.position(angle).angle();
        if !self.agreement.push(ahead) || mode.drives() {
            return;
        }
        let (Some(ahead), Some(rings)) = (self.agreement.ahead, self.rings()) else { return };
        let tolerance = tolerance_at_rest(&rings, mounting.pole_pairs);
        let agree = ahead.to_bits().unsigned_abs() <= tolerance.to_bits().unsigned_abs();
        self.disagreed_deg = if agree { None } else { Some(ahead.to_degrees()) };
        match (agree, sample.absolute) {
            // Asked for again where the queue is full.
            (true, false) => drop(self.tasks.count()),
            // Rings that have slipped by less than a turning drive tolerates: it is sent the mounting anew.
            (false, true) => self.mounting = None,
            _ => {}
        }
    }
}
