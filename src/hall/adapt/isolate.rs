//! When measurements are not where they were predicted: a torque that was not expected, or a wrong sensor?

use super::filter::{ANGLE, SPEED};
use super::sample::Sample;
use super::suspicion::{Suspicion, Suspicions};
use super::{Adapter, Fault, Observation, Phase, Status};
use crate::hall::{Channel, Codes};
use core::f32::consts::TAU;

/// Electrical turns for which a sensor may contradict the others before it counts as lost.
const MOST_SUSPECTED_TURNS: f32 = 0.15;
/// Fewest samples in a row at the ADC's rail, and fewest contradictions, of a lost sensor.
const FEWEST_CONTRADICTIONS: u32 = 4;
/// Largest innovation, share of the amplitude, that uneven magnets can produce: 10 % of strength from pole to pole, 10 %
/// of modulation, 5° of pitch, and 5 % of second harmonic at once. It speaks against no sensor.
pub(super) const MOST_OF_A_ROTOR: f32 = 0.35;
/// Largest innovation of sensors that agree against a third, share of the amplitude.
const AGREEING: f32 = 0.2;
/// Sum of squared innovations, in variances, that may remain when an outlier is explained by an unexpected torque.
const LARGEST_REMAINDER: f32 = 9.0;
/// Largest displacement of the rotor by such a torque, rad, for which the derivatives of the signals are good.
const LARGEST_DISPLACEMENT: f32 = 0.15;
/// Samples in a row that nothing explains, after which angle and speed are acquired anew.
const MOST_REJECTED: u32 = 4;
/// Times that they may be acquired anew within a turn, after which the parameters' variances start anew.
const MOST_REACQUISITIONS: u32 = 6;
/// Times that the variances may start anew before one turn is understood.
const MOST_RESTARTS: u32 = 4;

impl Adapter {
    /// Whether a sample must be looked at with all three sensors: a sensor is at an end of the ADC's range or under
    /// suspicion.
    #[inline]
    pub(super) fn needs_check(&self, codes: &Codes) -> bool {
        let at_rail = |k: usize| self.config.is_at_rail(codes[k]);
        self.suspicions.any | at_rail(0) | at_rail(1) | at_rail(2) && !self.is_known(codes)
    }

    /// Whether all that is wrong with a sample is the sensor that the filter works without already.
    #[cold]
    fn is_known(&self, codes: &Codes) -> bool {
        !self.suspicions.any && (0..3).all(|k| self.suspicions.is_lost(k) || !self.config.is_at_rail(codes[k]))
    }

    /// Sensors that cannot be used in a sample with something wrong; `None` if fewer than two can.
    #[cold]
    pub(super) fn unusable(&mut self, codes: &Codes) -> Option<[bool; 3]> {
        let mut unusable = [false; 3];
        let mut at_rail_for_good = None;
        for (k, unusable) in unusable.iter_mut().enumerate() {
            let lost = self.suspicions.is_lost(k);
            let at_rail = self.config.is_at_rail(codes[k]);
            *unusable = lost | at_rail;
            let suspicion = &mut self.suspicions.sensors[k];
            suspicion.at_rail = if at_rail & !lost { suspicion.at_rail.saturating_add(1) } else { 0 };
            if suspicion.at_rail >= FEWEST_CONTRADICTIONS {
                at_rail_for_good = at_rail_for_good.or(Some(k));
            }
        }
        self.suspicions.any = self.suspicions.rejected > 0 || self.suspicions.sensors.iter().any(Suspicion::exists);
        if let (None, None, Some(k)) = (self.fault, self.suspicions.lost, at_rail_for_good) {
            self.fail(Fault::AtRail(Channel(k as u8)));
        }
        if unusable.iter().filter(|&&unusable| unusable).count() > 1 {
            self.phase = Phase::Unknown;
            return None;
        }
        Some(unusable)
    }

    /// Electrical turns in this many samples; none where the rotor may be at rest.
    fn turns(&self, samples: f32) -> f32 {
        let speed = self.state.speed.abs();
        if speed >= self.config.slowest { speed * samples / TAU } else { 0.0 }
    }

    /// Updates angle and speed by a sample in which a sensor is an outlier, was one, or is lost.
    pub(super) fn isolate_outlier(&mut self, observation: &Observation, sample: &mut Sample) -> Status {
        let mut outliers = sample.outliers();
        let suspected = self.suspicions.sensors.iter().position(|suspicion| suspicion.turns > 0.0);
        if suspected.is_none() && outliers == [false; 3] {
            return self.accept(sample, &observation.codes);
        }
        let suspect = suspected.unwrap_or_else(|| sample.farthest());
        let others = sample.squares.iter().sum::<f32>() - sample.squares[suspect];
        let alternative = match self.suspicions.lost {
            // A sensor under suspicion goes on contradicting more likely than a torque acts just then.
            None if suspected.is_some() && others < LARGEST_REMAINDER => 0.0,
            None => others,
            // Of two sensors, neither is the suspect.
            Some(_) => f32::INFINITY,
        };
        if outliers != [false; 3] && self.absorb_disturbance(sample, alternative) {
            return self.accept(sample, &observation.codes);
        }
        if self.calibrated {
            self.excuse(sample, &mut outliers);
            if suspected.is_none() && outliers == [false; 3] {
                sample.discard(suspect);
                return self.accept(sample, &observation.codes);
            }
        }
        // A sensor is wrong only where the others agree: all three are wrong where the angle is. Of two from the start, no
        // third one tells which.
        let agrees =
            |k: usize| !outliers[k] && (!self.calibrated || sample.measurements[k].innovation.abs() < AGREEING);
        let others_fit = (0..3).all(|k| k == suspect || agrees(k));
        let tells = self.suspicions.lost.is_none() || self.fault.is_some();
        sample.discard(suspect);
        if !(others_fit && tells) {
            return self.reject(&observation.codes);
        }
        // A suspect is compared, but not used until its suspicion has decayed.
        let turns = self.turns(f32::from(observation.elapsed));
        if outliers[suspect] {
            if self.calibrated && self.fault.is_none() && self.agrees_with_the_others(suspect, &observation.codes) {
                return self.reject(&observation.codes);
            }
            self.suspect(suspect, turns);
        } else {
            self.suspicions.sensors[suspect].decay(turns);
        }
        self.accept(sample, &observation.codes)
    }

    /// Outliers that uneven magnets can produce speak against no sensor; they count little.
    fn excuse(&mut self, sample: &mut Sample, outliers: &mut [bool; 3]) {
        if outliers.iter().filter(|&&outlier| outlier).count() > 1 {
            // A load that is estimated wrongly shows in more than one.
            self.load *= 0.5;
        }
        for (k, outlier) in outliers.iter_mut().enumerate().filter(|(_, outlier)| **outlier) {
            let innovation = sample.measurements[k].innovation;
            if innovation.abs() < MOST_OF_A_ROTOR {
                self.sensors[k].learn_outlier(innovation);
                sample.mistrust(k);
                *outlier = false;
            }
        }
    }

    /// A sensor was an outlier: the next sample is looked at with all three.
    #[cold]
    pub(super) fn flag_outlier(&mut self) -> Status {
        self.suspicions.any = true;
        self.follow()
    }

    /// Whether an unexpected torque explains the sample, and better than the alternative, a wrong sensor. Then angle
    /// and speed are less certain by the displacement, and the load estimate takes a share.
    fn absorb_disturbance(&mut self, sample: &mut Sample, alternative: f32) -> bool {
        let (displacement, remaining) = sample.as_disturbance();
        let disturbed =
            displacement.abs() < LARGEST_DISPLACEMENT && remaining < LARGEST_REMAINDER && remaining < alternative;
        if disturbed {
            // An unknown acceleration makes the tracking lag by itself over the square of the natural frequency: half
            // of it, to be careful.
            self.load += 0.5 * displacement * self.natural_frequency * self.natural_frequency;
            self.covariance.inflate(ANGLE, displacement * displacement, f32::MAX);
            sample.inflate(displacement * displacement);
            self.covariance.inflate(
                SPEED,
                displacement * displacement * self.natural_frequency * self.natural_frequency,
                f32::MAX,
            );
        }
        disturbed
    }

    /// Updates angle and speed by the sensors that were not discarded, unless one of these is an outlier still.
    fn accept(&mut self, sample: &mut Sample, codes: &Codes) -> Status {
        if sample.outliers() != [false; 3] {
            return self.reject(codes);
        }
        self.suspicions.rejected = 0;
        self.track_all(&sample.measurements);
        self.follow()
    }

    /// Notes that one sensor contradicts the other two, for this part of a turn.
    fn suspect(&mut self, sensor: usize, turns: f32) {
        let suspicion = &mut self.suspicions.sensors[sensor];
        suspicion.turns += turns;
        suspicion.times += 1;
        self.suspicions.any = true;
        if suspicion.turns > MOST_SUSPECTED_TURNS && suspicion.times >= FEWEST_CONTRADICTIONS && self.fault.is_none() {
            self.fail(Fault::Lost(Channel(sensor as u8)));
        }
    }

    /// Nothing explains the sample. A few in a row are passed over; if there are more, angle and speed are acquired
    /// anew, and if that does not help, the parameters' variances start anew. Where the sensors agree with each other, the
    /// rotor was turned by something else: that speaks for no other parameters, however often it happens.
    fn reject(&mut self, codes: &Codes) -> Status {
        self.suspicions.any = true;
        self.followed_eighths = 0;
        self.suspicions.rejected += 1;
        if self.suspicions.rejected < MOST_REJECTED {
            return self.follow();
        }
        self.suspicions.rejected = 0;
        self.phase = Phase::Unknown;
        if self.calibrated && self.agree(codes) {
            return Status::Acquiring;
        }
        self.suspicions.reacquisitions += 1;
        if self.suspicions.reacquisitions < MOST_REACQUISITIONS || self.fault.is_some() {
            return Status::Acquiring;
        }
        let restarts = self.suspicions.restarts + 1;
        self.suspicions = Suspicions { restarts, ..Suspicions::without(self.suspicions.lost) };
        if self.suspicions.restarts > MOST_RESTARTS {
            self.fail(Fault::Contradiction);
        } else {
            self.restart();
        }
        Status::Acquiring
    }

    /// Ends the adaptation of parameters; angle and speed are tracked on.
    pub(super) fn fail(&mut self, fault: Fault) {
        self.fault = Some(fault);
        self.limit_parameters();
        self.model_due = false;
        self.suspicions = Suspicions::without(fault.lost().or(self.suspicions.lost));
    }
}
