//! Where the filter starts: at a calibration, or at what was learnt since one.

use super::doubt::Doubt;
use super::filter::{Covariance, OFFSET, STATES, State, THIRD, Vector};
use super::observe::CalibratedSensor;
use super::suspicion::Suspicions;
use super::window::Window;
use super::{Adapter, Config, Phase, Spread};
use crate::angle::ElectricalAngle;
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;

/// Uncertainty of the amplitudes from which on the start is not a calibration.
const UNCALIBRATED: f32 = 0.1;

impl Adapter {
    /// Starts from a calibration, or from a data sheet's model (with [`NOMINAL`](super::Settings::NOMINAL) as `start`).
    ///
    /// # Errors
    /// [`BadModel`] where the fast path could not work with the model either.
    pub fn new(config: &Config, model: &Model) -> Result<Self, BadModel> {
        Self::resume(config, model, model)
    }

    /// Goes on from what was learnt since a calibration. The limits stay around the calibration, however often this is
    /// done: what is beyond them is cut to them.
    ///
    /// # Errors
    /// As [`Self::new`], of either.
    pub fn resume(config: &Config, calibrated: &Model, learnt: &Model) -> Result<Self, BadModel> {
        estimate::validate_without(calibrated, config.adc_bits, config.absent())?;
        let mut adapter = Self::at(config, calibrated);
        adapter.begin();
        adapter.go_on_from(learnt)?;
        Ok(adapter)
    }

    /// Takes over what was learnt since the calibration that it has just started from.
    pub(crate) fn go_on_from(&mut self, learnt: &Model) -> Result<(), BadModel> {
        for k in self.sensors_in_use() {
            let (from, to) = (&self.sensors[k].sensor, &learnt.sensors[k]);
            self.state.offset[k] = (to.offset - from.offset) / from.amplitude;
            self.state.amplitude[k] = to.amplitude / from.amplitude;
            self.state.placement[k] = to.placement;
        }
        // All sensors share it.
        self.state.third = learnt.sensors[0].third - self.sensors[0].sensor.third;
        self.limit_parameters();
        self.model = self.current();
        estimate::validate_without(&self.model, self.config.adc_bits, self.config.absent())
    }

    /// From a calibration that is valid; [`Self::begin`] follows, when it is in its place.
    // Inlined, it is made there, and takes no stack.
    #[inline(always)]
    pub(crate) fn at(config: &Config, model: &Model) -> Self {
        Self {
            config: *config,
            sensors: core::array::from_fn(|k| CalibratedSensor::new(&model.sensors[k], config.noise_codes[k])),
            state: State {
                angle: ElectricalAngle::ZERO,
                speed: 0.0,
                third: 0.0,
                offset: [0.0; 3],
                amplitude: [1.0; 3],
                placement: model.sensors.map(|sensor| sensor.placement),
            },
            covariance: Covariance::ZERO,
            start: parameters(&config.start),
            drift: parameters(&config.drift),
            natural_frequency: 0.0,
            settled_variance: 0.0,
            load_gain: 0.0,
            load: 0.0,
            phase: Phase::Unknown,
            window: Window::default(),
            seen_eighths: 0,
            followed_eighths: 0,
            learnt_samples: 0,
            samples_since_drift: 0,
            paused: 0,
            model_due: false,
            calibrated: config.start.amplitude < UNCALIBRATED * UNCALIBRATED,
            doubt: Doubt::START,
            last_limit: None,
            suspicions: Suspicions::without(config.absent()),
            fault: None,
            fault_reported: false,
            model: *model,
        }
    }

    /// What follows from the start.
    #[inline(never)]
    pub(crate) fn begin(&mut self) {
        self.covariance.set_diagonal(&self.start);
        self.tune();
        // After that, so that the load is estimated as on the best rotor.
        if self.calibrated {
            self.sensors.iter_mut().for_each(CalibratedSensor::be_cautious);
        }
    }

    /// The rotor is known to leave so much unexplained at each sensor, share of the amplitude RMS: what its magnets differ by,
    /// which a [signature](crate::hall::map::Signature) tells. A slow rotor shows less, as its angle follows.
    pub fn expect_unexplained(&mut self, rms: [f32; 3]) {
        self.sensors.iter_mut().zip(rms).for_each(|(sensor, rms)| sensor.expect_unexplained(rms));
        self.tune();
    }

    /// Fits the estimate of the load to the noise, that which the rotor leaves unexplained included.
    pub(super) fn tune(&mut self) {
        // Of the angle from one sample: two thirds of that of three sensors, all of that of two that are 90° apart.
        let angle_noise = self.mean(CalibratedSensor::noise) * if self.works_with_two() { 1.0 } else { 2.0 / 3.0 };
        self.natural_frequency = fourth_root(self.config.acceleration / angle_noise);
        // Sixteen times √2 · pace · noise, the variance of the angle at a steady speed with known sensors. Less would shut
        // out a friction that is not the settings'.
        self.settled_variance = 22.6 * self.natural_frequency * angle_noise;
        // Slow enough to leave the tracking stable and hardly noisier.
        self.load_gain = 0.1 * self.natural_frequency;
    }
}

/// A spread as a vector over the states; zero for angle and speed.
fn parameters(spread: &Spread) -> Vector {
    let mut vector = [0.0; STATES];
    vector[THIRD] = spread.third;
    for (k, own) in OFFSET.into_iter().enumerate() {
        vector[own] = spread.offset;
        vector[own + 1] = spread.amplitude;
        if k != 0 {
            vector[own + 2] = spread.placement_deg;
        }
    }
    vector
}

/// The fourth root within 4 %, by the float's own logarithm: a quarter of the bits, and three quarters of those of one.
fn fourth_root(x: f32) -> f32 {
    const ONE: u32 = 1.0_f32.to_bits();
    // Straight lines between powers of two lie above the curve; this puts them in the middle of it.
    const ABOVE: u32 = 310_000;
    f32::from_bits((x.to_bits() >> 2) + (ONE / 4 * 3 - ABOVE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fourth_root_is_as_exact_as_promised() {
        for k in 0..4000 {
            let x = 1e-12 * libm::powf(1.01, k as f32);
            assert!((fourth_root(x) / libm::powf(x, 0.25) - 1.0).abs() < 0.04, "{x}");
        }
    }
}
