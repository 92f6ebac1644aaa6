//! What is asked of the encoder.

use super::{FASTER, Outcome, SAMPLE_HZ, TOLERANCE_DEG, Vernier, largest_step};
use crate::encoder::Encoder as _;
use core::f32::consts::TAU;
use hallservo::angle::ElectricalAngle;
use hallservo::drive;
use hallservo::mode::Mode;
use hallservo::service::Service;
use hallservo::service::encoder::EncoderCalibration;
use hallservo::settings::Settings;
use hallservo::vernier::calibrate::margin;
use hallservo::vernier::encoder::Calibration;
use hallservo::vernier::fit::tolerance_at_rest;
use hallservo::vernier::settings;
use hallservo_protocol::{Answer, EncoderAsk, EncoderRefusal, EncoderStatus, Problem, Refusal};

type Refused = Refusal<'static>;

const fn refused(why: EncoderRefusal) -> Refused {
    Refusal::Encoder(why)
}

/// What changes the encoder waits for the bridge to be off.
const fn off(mode: Mode) -> Result<(), Refused> {
    if mode.drives() { Err(Refusal::Drive(drive::Refusal::Mode(mode))) } else { Ok(()) }
}

impl<const HEADS: usize> Vernier<HEADS> {
    pub(super) fn answer(
        &mut self,
        ask: EncoderAsk,
        service: &Service,
        settings: &Settings,
        mode: Mode,
    ) -> Result<Answer<'static>, Refused> {
        match ask {
            // What the sensors' models are is not the encoder's.
            EncoderAsk::Align => return Err(refused(EncoderRefusal::None)),
            EncoderAsk::Status => return Ok(Answer::Encoder(self.status(settings))),
            EncoderAsk::Calibrate { by_hand } => self.begin(service, settings, mode, by_hand)?,
            EncoderAsk::Zero => self.set_zero(mode)?,
            EncoderAsk::Rings { reference, vernier } => {
                self.change(mode, |settings| settings.with_rings(reference, vernier))?;
            }
            EncoderAsk::Forget => {
                off(mode)?;
                self.forget();
            }
        }
        Ok(Answer::Done)
    }

    /// Begins a calibration. What was known is in use again when it fails.
    #[inline(never)]
    fn begin(&mut self, service: &Service, settings: &Settings, mode: Mode, by_hand: bool) -> Result<(), Refused> {
        let has_halls = match mode {
            Mode::Ready => true,
            Mode::Unarmed if by_hand => false,
            Mode::Unarmed => return Err(Refusal::Drive(drive::Refusal::NotCalibrated)),
            mode => return Err(Refusal::Drive(drive::Refusal::Mode(mode))),
        };
        let rings = self.rings().ok_or(refused(EncoderRefusal::NotCalibrated))?;
        let ideal = Calibration::ideal(&rings);
        let previous = self.known.calibration.as_ref().unwrap_or(&ideal);
        let config = service.config();
        let calibration = if by_hand {
            EncoderCalibration::by_hand(config, &rings, previous, has_halls)
        } else {
            let sample_hz = settings.pwm_hz / ((settings.pwm_hz / SAMPLE_HZ) as u32).max(1) as f32;
            EncoderCalibration::by_motor(config, &rings, previous, sample_hz)
                .map_err(|error| refused(EncoderRefusal::Calibration(error)))?
        };
        *self.calibration = Some(calibration);
        self.outcome = Outcome::Running(None);
        self.take_back();
        Ok(())
    }

    fn set_zero(&mut self, mode: Mode) -> Result<(), Refused> {
        off(mode)?;
        if self.known.calibration.is_none() {
            return Err(refused(EncoderRefusal::NotCalibrated));
        }
        match self.last.and_then(|sample| sample.angle) {
            Some(Ok(angle)) => self.known.zero = angle,
            Some(Err(fault)) => return Err(refused(EncoderRefusal::NoAngle(Some(fault)))),
            None => return Err(refused(EncoderRefusal::NoAngle(None))),
        }
        self.unsaved = true;
        Ok(())
    }

    /// By how much the Halls are ahead, for their zero to be taken from the encoder. Farther than they may be while
    /// the motor turns, it is likelier that the rings have turned on the shaft, or show another pole pair.
    pub(super) fn halls_ahead_at_rest(&self, mode: Mode) -> Result<ElectricalAngle, Refused> {
        off(mode)?;
        match self.last.and_then(|sample| sample.angle) {
            Some(Err(fault)) => return Err(refused(EncoderRefusal::NoAngle(Some(fault)))),
            _ if mode == Mode::Unarmed => return Err(Refusal::Drive(drive::Refusal::NotCalibrated)),
            _ if self.mounting.is_none() => return Err(refused(EncoderRefusal::NotCalibrated)),
            _ => {}
        }
        let ahead = self.agreement.ahead.ok_or(refused(EncoderRefusal::NotAbsolute(None)))?;
        if ahead.to_degrees().abs() > TOLERANCE_DEG {
            return Err(refused(EncoderRefusal::HallsTooFar(ahead.to_degrees())));
        }
        Ok(ahead)
    }

    /// Takes over other settings. Other rings have to be calibrated anew.
    pub(super) fn change(
        &mut self,
        mode: Mode,
        change: impl FnOnce(&settings::Settings) -> Result<settings::Settings, settings::Error>,
    ) -> Result<(), Refused> {
        off(mode)?;
        let before = self.known.settings;
        let changed = change(&before).map_err(|error| refused(EncoderRefusal::Setting(error)))?;
        let pairs = |settings: &settings::Settings| [settings.reference_pairs, settings.vernier_pairs];
        if pairs(&before) != pairs(&changed) {
            self.forget();
        }
        self.known.settings = changed;
        self.unsaved = true;
        Ok(())
    }

    fn forget(&mut self) {
        self.known.calibration = None;
        self.known.fitted = None;
        self.known.zero = hallservo::angle::MechanicalAngle::ZERO;
        (self.install_due, self.outcome, self.disagreed_deg) = (false, Outcome::None, None);
        *self.decoder = None;
        self.unsaved = true;
        self.take_back();
    }

    /// Whether the drive may be armed, or sent to a position: not to one that nobody knows.
    pub(super) fn may_be_moved(&self, position: bool, settings: &Settings) -> Result<(), Refused> {
        let absolute = !self.has_moved(settings) && self.mounting == self.wanted(settings);
        let absolute = absolute && self.last.is_some_and(|sample| sample.absolute);
        let needed = self.known.fitted.is_some() && (position || !self.known.settings.falls_back);
        if !needed || absolute {
            return Ok(());
        }
        match self.last.and_then(|sample| sample.angle) {
            Some(Err(fault)) => Err(refused(EncoderRefusal::NoAngle(Some(fault)))),
            _ => Err(refused(EncoderRefusal::NotAbsolute(self.disagreed_deg))),
        }
    }

    fn status(&mut self, settings: &Settings) -> EncoderStatus {
        let known = &self.known;
        let last = self.last;
        let angle = last.and_then(|sample| sample.angle);
        let mut status = EncoderStatus {
            pairs: [known.settings.reference_pairs, known.settings.vernier_pairs],
            heads: HEADS as u8,
            calibrated: known.calibration.is_some(),
            mounted: known.fitted.is_some(),
            absolute: last.is_some_and(|sample| sample.absolute),
            proven: last.is_some_and(|sample| sample.proven),
            used: last.is_some_and(|sample| sample.used) && known.settings.closes_loops,
            angle_deg: f32::NAN,
            fault: angle.and_then(Result::err),
            last_fault: self.last_fault,
            missed: self.missed,
            residual_counts: [f32::NAN; 3],
            halls_ahead_deg: self.agreement.ahead.map_or(f32::NAN, |ahead| ahead.to_degrees()),
            tolerance_deg: f32::NAN,
            calibration: self.outcome,
            stored: if self.unsaved { Problem::Blank } else { self.problem },
            fastest_rad_s: f32::NAN,
        };
        let Some(rings) = self.rings() else { return status };
        if let Some(Ok(angle)) = angle {
            let shaft = self.mounting.map_or(angle - known.zero, |mounting| mounting.shaft(angle));
            status.angle_deg = shaft.to_degrees();
        }
        if let Some(calibration) = &known.calibration {
            let (worst, limit) = (self.worst_residual, u32::from(calibration.residual_limit));
            let margin = margin(&rings, &calibration.averages);
            status.residual_counts = [worst, limit, margin].map(|residual| rings.residual_counts(residual as i32));
        }
        if let Some(mounting) = &self.mounting {
            status.tolerance_deg = tolerance_at_rest(&rings, mounting.pole_pairs).to_degrees();
        }
        let step = largest_step(&rings, settings).to_degrees() / 360.0;
        status.fastest_rad_s = TAU * step * settings.pwm_hz / FASTER;
        self.worst_residual = 0;
        status
    }
}
