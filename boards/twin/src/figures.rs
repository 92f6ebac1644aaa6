//! How well the drive does: its angle against the truth, which only the simulation knows.

use core::f64::consts::TAU;
use core::fmt;
use hallservo::angle::{ElectricalAngle, PolePairs};
use hallservo::board::Sample;
use hallservo::drive::Drive;
use plant::Truth;

/// Over all periods judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    pole_pairs: f64,
    periods: u32,
    angle: Errors,
    tracked: Errors,
    /// True turns less counted ones, at first and now.
    offset: [f64; 2],
    forward_hz: f64,
    backward_hz: f64,
}

impl Figures {
    pub(crate) fn new(pole_pairs: PolePairs) -> Self {
        Self {
            pole_pairs: pole_pairs.get().into(),
            periods: 0,
            angle: Errors::default(),
            tracked: Errors::default(),
            offset: [0.0; 2],
            forward_hz: 0.0,
            backward_hz: 0.0,
        }
    }

    /// Judges a period after the drive's step.
    pub(crate) fn push(&mut self, drive: &Drive, sample: &Sample, truth: &Truth) {
        let turns = truth.mechanical_angle_rad * self.pole_pairs / TAU;
        let single = drive.estimator().and_then(|estimator| estimator.angle(&sample.halls).ok());
        self.angle.push(single, turns);
        self.tracked.push(Some(drive.tracker().angle()), turns);
        self.offset[1] = turns - drive.tracker().position().to_turns();
        if self.periods == 0 {
            self.offset[0] = self.offset[1];
        }
        let hz = truth.speed_rad_s * self.pole_pairs / TAU;
        self.forward_hz = self.forward_hz.max(hz);
        self.backward_hz = self.backward_hz.max(-hz);
        self.periods += 1;
    }

    /// Electrical turns that the drive's counter lost or gained.
    pub fn turns_lost(&self) -> i32 {
        libm::round(self.offset[1] - self.offset[0]) as i32
    }

    /// RMS error of the calibrated angle of single samples, in electrical degrees.
    pub fn angle_error_deg_rms(&self) -> f64 {
        self.angle.rms()
    }

    /// Largest electrical speed, forward and backward.
    pub fn fastest_hz(&self) -> [f64; 2] {
        [self.forward_hz, self.backward_hz]
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "angle {:.4}° RMS, {:.3}° largest; tracked {:.4}° RMS, {:.3}° largest; up to {:.2} Hz forward and {:.2} \
             Hz backward electrical; {} turns lost in {} periods",
            self.angle.rms(),
            self.angle.largest,
            self.tracked.rms(),
            self.tracked.largest,
            self.forward_hz,
            self.backward_hz,
            self.turns_lost(),
            self.periods,
        )
    }
}

/// Errors of an angle, in electrical degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Errors {
    count: u32,
    squares: f64,
    largest: f64,
}

impl Errors {
    fn push(&mut self, angle: Option<ElectricalAngle>, true_turns: f64) {
        // A sample without an angle counts as wholly wrong.
        let error = angle.map_or(180.0, |angle| {
            let turns = f64::from(angle.to_bits()) / 4_294_967_296.0 - true_turns;
            360.0 * (turns - libm::round(turns))
        });
        self.count += 1;
        self.squares += error * error;
        self.largest = self.largest.max(error.abs());
    }

    fn rms(&self) -> f64 {
        libm::sqrt(self.squares / f64::from(self.count.max(1)))
    }
}
