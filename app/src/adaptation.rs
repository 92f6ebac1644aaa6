//! The adaptation of the sensors' model from the records while the motor turns; of two sensors, whether they fit each
//! other.

use crate::storage::Sensors;
use hallservo::config::Config;
use hallservo::hall::Halls;
use hallservo::hall::adapt::{self, Status};
use hallservo::hall::model::Model;
use hallservo::service::Service;
use hallservo::service::adaptation::Watch;
use hallservo::settings::Settings;
use hallservo::telemetry::Record;
use hallservo_protocol::{self as protocol, Cause};

/// Spectral density of unmeasured torque (cogging, loads), as the electrical acceleration that it causes, rad/s²/√Hz.
const UNMEASURED_TORQUE: f32 = 16.0;
/// Damping over inertia of a motor at a voltage, 1/s: by its back-EMF. Where the current is measured its torque has that in
/// it, and friction is a load that is learnt: counted twice, it would have the filter take a fast rotor for slower than it
/// is, and its magnets for uneven.
const DAMPING: f32 = 16.0;

/// Slowest speed at which the sensors of a rotor that is known to be uneven are learnt, Hz electrical. The unmeasured torque
/// moves the rotor by three degrees in an electrical turn there. Slower, only the Halls themselves tell the angle, and what
/// the magnets differ by bends the sensors' parameters: an angle that a map has made good to 0.1° was off by up to 0.9°.
const SLOWEST_UNEVEN_HZ: f32 = 32.0;

/// Records from one model that is sent to the drive to the next: a second's. One turn would be enough, but making the
/// estimator's table stalls the tasks of a small chip for a tenth of a second.
const RECORDS_PER_MODEL: u16 = 1000;

/// What watches the sensors of a drive with a calibration.
pub(crate) struct SensorAdaptation {
    watch: Watch,
    /// The fault that ended it.
    ended: Option<adapt::Fault>,
    /// Models that the drive has accepted.
    pub count: u32,
    /// Records until the next model may be sent.
    wait: u16,
}

impl SensorAdaptation {
    /// Off.
    #[inline(always)]
    pub const fn new() -> Self {
        Self { watch: Watch::none(), ended: None, count: 0, wait: RECORDS_PER_MODEL }
    }

    /// Starts anew from what is known of the sensors, and of the unevenness of the rotor.
    pub fn restart(&mut self, settings: &Settings, sensors: Option<&Sensors>, uneven: Option<[f32; 3]>, every: u32) {
        self.ended = None;
        self.wait = RECORDS_PER_MODEL;
        self.watch.begin(settings.halls == 2);
        if let Some(sensors) = sensors.filter(|_| settings.adaptation)
            && let Some(config) = config(settings, sensors.noise, uneven.is_some(), every)
        {
            let Sensors { calibrated, model, .. } = sensors;
            // An error leaves it off.
            let _ = self.watch.resume(&config, calibrated, model, every);
            if let (Some(rms), Some(adaptation)) = (uneven, self.watch.adaptation()) {
                adaptation.expect_unexplained(rms);
            }
        }
    }

    /// Whether a record of a running drive says that its two sensors do not fit each other.
    pub fn contradicts(&mut self, record: &Record, sensors: &Sensors, torque_nm: f32, config: &Config) -> bool {
        self.watch.contradicts(record, &sensors.model, torque_nm, config)
    }

    /// Learns from a record; returns the fault that ends it.
    pub fn take(&mut self, record: &Record, torque_nm: f32) -> Option<Cause> {
        match self.watch.adaptation()?.take(record, torque_nm) {
            Status::Failed(fault) => {
                self.ended = Some(fault);
                Some(Cause::Adaptation(fault))
            }
            Status::Adapting | Status::ModelReady => {
                self.wait = self.wait.saturating_sub(1);
                None
            }
            _ => None,
        }
    }

    /// Sends the drive the model that is due and returns it; after the loss of a Hall one for the other two, if the
    /// drive may run so.
    pub fn publish(&mut self, service: &mut Service, on_two_halls: bool) -> Option<Model> {
        let adaptation = self.watch.adaptation().filter(|_| self.ended.is_none() || on_two_halls)?;
        // What was learnt of an uneven rotor is taken back at once.
        if self.wait > 0 && self.ended.is_none() && !adaptation.adapter().doubts() {
            return None;
        }
        if adaptation.publish(service) != Ok(true) {
            return None;
        }
        self.wait = RECORDS_PER_MODEL;
        self.count = self.count.saturating_add(1);
        self.ended.is_none().then(|| *adaptation.adapter().model())
    }

    #[inline(never)]
    pub fn state(&self) -> protocol::Learning {
        match (self.ended, self.watch.adapter()) {
            (Some(fault), _) => protocol::Learning::Ended(fault),
            (_, None) => protocol::Learning::Off,
            (_, Some(adapter)) if adapter.doubts() => protocol::Learning::Uneven,
            (_, Some(adapter)) if adapter.is_too_fast() => protocol::Learning::TooFast,
            _ => protocol::Learning::On,
        }
    }
}

fn config(settings: &Settings, noise_codes: [f32; 3], uneven: bool, every: u32) -> Option<adapt::Config> {
    let default = adapt::Settings::default();
    let (inertia_kgm2, damping) =
        settings.control.map_or((default.inertia_kgm2, DAMPING), |control| (control.inertia_kgm2, 0.0));
    adapt::Settings {
        slowest_hz: if uneven { SLOWEST_UNEVEN_HZ } else { default.slowest_hz },
        halls: if settings.halls == 2 { Halls::Two } else { Halls::Three },
        adc_bits: settings.adc_bits,
        update_hz: settings.pwm_hz / every as f32,
        noise_codes,
        pole_pairs: settings.pole_pairs,
        inertia_kgm2,
        damping_nms: damping * inertia_kgm2,
        torque_noise_nm_rthz: UNMEASURED_TORQUE * inertia_kgm2 / f32::from(settings.pole_pairs),
        ..default
    }
    .validate()
    .ok()
}
