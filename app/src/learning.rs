//! The adaptation in the tasks: it learns from the records while the motor turns, and the drive takes up what was learnt.

use crate::saving::Sensors;
use crate::settings::Settings;
use crate::wire;
use hallservo::hall::adapt::{self, Outcome};
use hallservo::hall::model::Model;
use hallservo::service::Service;
use hallservo::service::adaptation::Adaptation;
use hallservo::telemetry::Record;
use hallservo_protocol::{self as protocol, Cause};

/// Density of the torque that is not told, relative to the electrical acceleration it makes: rad/s²/√Hz. Cogging and loads.
const UNTOLD: f32 = 16.0;
/// What the shaft loses of its speed in a second when it is left alone.
const DAMPING: f32 = 16.0;

/// Records to learn from, from one model for the drive to the next: a second's. A turn is enough to learn one, but to make its table keeps
/// the tasks of a small chip for a tenth of a second, in which nobody learns, answers or tells; and the first turn's is the worst.
const REST: u16 = 1000;

/// The adaptation of a drive with a calibration, if it is wanted.
pub(crate) struct Learning {
    adaptation: Option<Adaptation>,
    /// What it gave up for, once it has been told.
    ended: Option<adapt::Fault>,
    /// Models that the drive took up.
    pub count: u32,
    /// Records to learn from until the next.
    rest: u16,
}

impl Learning {
    /// Off.
    pub const fn new() -> Self {
        Self { adaptation: None, ended: None, count: 0, rest: REST }
    }

    /// Starts anew from what is known of the sensors.
    pub fn restart(&mut self, settings: &Settings, sensors: Option<&Sensors>, every: u32) {
        self.ended = None;
        self.rest = REST;
        self.adaptation = sensors.filter(|_| settings.adaptation).and_then(|sensors| {
            let config = config(settings, sensors.noise, every)?;
            Adaptation::new(&config, &sensors.model, every).ok()
        });
    }

    /// Learns from a record; the reason, when it gives up.
    pub fn take(&mut self, record: &Record, torque_nm: f32) -> Option<Cause> {
        match self.adaptation.as_mut()?.take(record, torque_nm) {
            Outcome::Failed(fault) => {
                self.ended = Some(fault);
                Some(wire::sensor(fault))
            }
            Outcome::Adapting | Outcome::ModelReady => {
                self.rest = self.rest.saturating_sub(1);
                None
            }
            _ => None,
        }
    }

    /// Gives the drive what is due; the model then. Without a Hall only if the drive may run so, and at once.
    pub fn publish(&mut self, service: &mut Service, on_two_halls: bool) -> Option<Model> {
        let adaptation = self.adaptation.as_mut().filter(|_| self.ended.is_none() || on_two_halls)?;
        if self.rest > 0 && self.ended.is_none() {
            return None;
        }
        if adaptation.publish(service) != Ok(true) {
            return None;
        }
        self.rest = REST;
        self.count = self.count.saturating_add(1);
        self.ended.is_none().then(|| *adaptation.adapter().model())
    }

    pub fn state(&self) -> protocol::Learning {
        match (self.ended.map(wire::sensor), &self.adaptation) {
            (Some(Cause::Sensor { channel, why }), _) => protocol::Learning::Ended { channel, why },
            (_, Some(_)) => protocol::Learning::On,
            (_, None) => protocol::Learning::Off,
        }
    }
}

fn config(settings: &Settings, noise_codes: [f32; 3], every: u32) -> Option<adapt::Config> {
    let Settings { drive, .. } = settings;
    let default = adapt::Settings::default();
    let inertia_kgm2 = drive.control.map_or(default.inertia_kgm2, |control| control.inertia_kgm2);
    adapt::Settings {
        adc_bits: drive.adc_bits,
        update_hz: drive.pwm_hz / every as f32,
        noise_codes,
        pole_pairs: drive.pole_pairs,
        inertia_kgm2,
        damping_nms: DAMPING * inertia_kgm2,
        torque_noise_nm_rthz: UNTOLD * inertia_kgm2 / f32::from(drive.pole_pairs),
        ..default
    }
    .validate()
    .ok()
}
