//! Status and telemetry.

use super::Tasks;
use crate::encoder::Encoder;
use crate::measure;
use core::f32::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use hallservo::double;
use hallservo::mode::Mode;
use hallservo::telemetry::Measurement;
use hallservo_protocol::{Activity, Status, Telemetry};

/// Telemetry that was requested.
#[derive(Clone, Copy)]
pub(super) struct Stream {
    id: u16,
    /// Frames a tick, and those due.
    rate: f32,
    due: f32,
    number: u32,
}

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Starts telemetry, or ends it with a rate of zero.
    pub fn stream(&mut self, id: u16, hz: f32) {
        self.stream = (hz > 0.0).then_some(Stream { id, rate: hz / 1000.0, due: 0.0, number: 0 });
    }

    /// Telemetry that is due, with the id of its request.
    pub fn telemetry(&mut self) -> Option<(u16, Telemetry)> {
        let stream = self.stream.as_mut()?;
        stream.due += stream.rate;
        if stream.due < 1.0 {
            return None;
        }
        stream.due -= 1.0;
        stream.number = stream.number.wrapping_add(1);
        let Stream { id, number, .. } = *stream;
        let [mut current_a, mut voltage_v] = [[f32::NAN; 2]; 2];
        if let (Some(measurement), Some(control)) = (&self.measurement, &self.settings.control) {
            current_a = self.current_a(measurement);
            voltage_v = measure::voltage_v(control, measurement);
        }
        let telemetry = Telemetry {
            number,
            step: self.record.sequence,
            angle_deg: self.record.rotor.angle().to_degrees(),
            speed_rad_s: self.speed_rad_s(),
            position_turns: self.position_turns(),
            current_a,
            voltage_v,
            bus_v: measure::bus_v(&self.settings, self.readings),
            mode: self.mode(),
            limits: self.record.status.limits(),
            codes: self.record.codes,
        };
        Some((id, telemetry))
    }

    fn current_a(&self, measurement: &Measurement) -> [f32; 2] {
        let control = self.service.config().control.as_ref();
        control.map_or([f32::NAN; 2], |control| measurement.current_a(control))
    }

    #[inline(never)]
    pub(super) fn speed_rad_s(&self) -> f32 {
        self.record.electrical_hz(self.step_hz()) * TAU / f32::from(self.settings.pole_pairs)
    }

    fn position_turns(&self) -> f64 {
        double::from_fixed(self.position_fixed())
    }

    /// Mechanical position in 2⁻³² turns.
    pub fn position_fixed(&self) -> i64 {
        let recorded = self.record.rotor.position();
        let position = if self.mode().drives() { recorded } else { self.encoder.position().unwrap_or(recorded) };
        let bits = position.to_bits().wrapping_sub(self.encoder.origin().to_bits());
        bits / i64::from(self.settings.pole_pairs.max(1))
    }

    /// The state of the drive.
    pub fn status(&self) -> Status {
        let settings = &self.settings;
        let mode = self.mode();
        let activity = self.activity();
        Status {
            uptime_ms: self.now_ms,
            mode,
            limits: self.record.status.limits(),
            calibrated: self.sensors.is_some() && !matches!(mode, Mode::Unarmed | Mode::Aligning | Mode::Calibrating),
            commutation: settings.commutation,
            anti_cogging: self.anti_cogging,
            position_turns: self.position_turns(),
            speed_rad_s: self.speed_rad_s(),
            current_a: self.measurement.as_ref().map_or(f32::NAN, |measurement| self.current_a(measurement)[1]),
            bus_v: measure::bus_v(settings, self.readings),
            temperatures_c: measure::temperatures_c(settings, self.readings),
            activity,
            progress: match &*self.procedure {
                Some(procedure) => procedure.progress(),
                None if self.rest.is_some() => 1.0,
                None if activity == Activity::Calibration => self.service.progress(),
                None => self.encoder.activity().1,
            },
            learning: self.adaptation.state(),
            learnt: self.adaptation.count,
            stored: self.stored,
            unsaved: self.unsaved != [false; 3]
                || self.settings.digest() != self.stored_settings
                || self.sensors_changed()
                || !self.magnets.is_settled(),
            lost_records: self.lost_records,
            garbage: self.garbage,
            lost_frames: self.lost_frames,
            command_timeout_s: settings.control.map_or(f32::INFINITY, |control| control.guard.command_timeout_s),
            incidents: self.history.len(),
            client: self.controller.client(),
            unconfirmed: self.unconfirmed,
        }
    }
}
