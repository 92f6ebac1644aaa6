//! Calibration: the model of the sensors from turning the rotor open loop, both ways.
//!
//! The stator's field drags the rotor along; [`Collector`] averages the three codes over the field's angle, and
//! `fit` finds offset, amplitude, placement and harmonics of all sensors and the rotor's true angle in
//! every bin at once, by least squares. (Minimum and maximum, which Simpkins and Todorov propose with eq. (2), are
//! biased by noise: the larger the number of samples, the more.) The rotor lags behind the field by friction, the
//! opposite way in the opposite direction, so the mean over both directions is the alignment φ: of the angle that the
//! estimator will tell, which is not quite the one that fits best.
//!
//! The wave's shape is taken as alike for north and south poles and locked to the placement. Then the third harmonic
//! can be told from an uneven turning of the rotor, which it looks like to a single sensor, by what it does to the
//! other two.

pub mod fit;
pub mod report;

use crate::angle::ElectricalAngle;
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;
use crate::hall::{Channel, Codes, Halls};
use core::fmt;
pub use fit::BINS;
use fit::{Fit, NoFit};
use report::Raw;
pub use report::{Finding, Report};

/// Fewest samples in a bin.
const FEWEST: u32 = 4;

/// Which way the field turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Sweep {
    /// Electrical angle rising.
    Forward,
    /// Electrical angle falling.
    Backward,
}

/// Why a calibration came to nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// A bin of a direction has too few samples: the field did not go all the way round.
    Incomplete(Sweep),
    /// A sensor sees no magnet turning.
    NoSignal(Channel),
    /// No sensors' parameters explain the signals, though all have a signal.
    NoFit,
    /// The parameters found cannot give an angle.
    Model(BadModel),
    /// The drive did not give back the memory for the estimator.
    Busy,
    /// The sensors work, but not well enough; the report's findings say why.
    Refused(Finding),
    /// The tasks came too late for so many samples that nothing can be said of the sensors.
    SamplesLost {
        /// Share of them.
        percent: u8,
    },
    /// No sensor sees a magnet turning.
    NotTurning,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Incomplete(Sweep::Forward) => write!(f, "too few samples while turning forward"),
            Self::Incomplete(Sweep::Backward) => {
                write!(f, "too few samples while turning backward")
            }
            Self::NoSignal(channel) => {
                write!(f, "{channel} sees no magnet turning: check its supply and wire, and that the rotor is free")?;
                if *channel == Channel::THIRD {
                    write!(f, "; where there are only two Halls, set `halls` to 2")?;
                }
                Ok(())
            }
            Self::NotTurning => write!(
                f,
                "no Hall sees the magnet turn: a rotor too heavy to follow the field needs a slower one \
                 (calibration_hz) or more current; otherwise check that it is free, and the Halls' supply"
            ),
            Self::NoFit => write!(f, "the signals fit no rotor: check that it is free to follow the field"),
            Self::Model(bad) => bad.fmt(f),
            Self::SamplesLost { percent } => write!(
                f,
                "{percent} % of the samples were lost: the tasks poll too rarely (Supervisor::tick or Service::poll), \
                 or calibration_record_hz is too high for them"
            ),
            Self::Busy => write!(f, "the drive is busy with the last parameters: try again"),
            Self::Refused(finding) => finding.fmt(f),
        }
    }
}

impl core::error::Error for Error {}

impl From<NoFit> for Error {
    fn from(why: NoFit) -> Self {
        match why {
            NoFit::NoSignal(channel) => Self::NoSignal(channel),
            NoFit::NotTurning => Self::NotTurning,
            NoFit::Diverged => Self::NoFit,
        }
    }
}

/// What a calibration found: with it a drive can be armed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The sensors and the alignment.
    pub model: Model,
    /// What a person should know of them.
    pub report: Report,
}

/// The sums of the three codes, and how many there are.
pub type Bin = [u32; 4];

/// Of the sweep forward and of that backward.
pub type Bins = [[Bin; BINS]; 2];

/// Who has the memory of the sums.
pub trait Memory {
    /// To read.
    fn bins(&self) -> &Bins;
    /// To write.
    fn bins_mut(&mut self) -> &mut Bins;
}

impl Memory for Bins {
    fn bins(&self) -> &Bins {
        self
    }

    fn bins_mut(&mut self) -> &mut Bins {
        self
    }
}

/// What the fit says of a calibration.
struct Found {
    fit: Fit,
    alignment: ElectricalAngle,
    /// Of the rotor behind the field, and its standard deviation.
    lag: ElectricalAngle,
    hunting: ElectricalAngle,
}

/// Sums up the samples of both sweeps; 2.1 KiB, unless another has the memory.
#[derive(Clone, Debug)]
pub struct Collector<M = Bins> {
    bins: M,
    noise: Noise,
    at_rail: [u32; 3],
    adc_bits: u8,
}

impl Collector {
    /// An empty one, for an ADC of 1 to 16 bits.
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub fn new(adc_bits: u8) -> Self {
        Self::with(adc_bits, [[[0; 4]; BINS]; 2])
    }
}

impl<M: Memory> Collector<M> {
    /// The same with memory that is all zeros, or [cleared](Self::clear) before the first sample.
    #[inline(always)]
    pub(crate) fn with(adc_bits: u8, bins: M) -> Self {
        Self { bins, noise: Noise::default(), at_rail: [0; 3], adc_bits }
    }

    /// The memory.
    #[cfg(feature = "small")]
    pub(crate) fn into_memory(self) -> M {
        self.bins
    }

    /// Forgets all, without the stack that a new one would take.
    pub(crate) fn clear(&mut self, adc_bits: u8) {
        for bin in self.bins.bins_mut().iter_mut().flatten() {
            *bin = Bin::default();
        }
        (self.noise, self.at_rail, self.adc_bits) = (Noise::default(), [0; 3], adc_bits);
    }

    /// Takes a sample made while the field pointed at `field`. `sequence` counts the samples, so that a lost one is
    /// noticed. A bin takes up to 65,536 samples and ignores more.
    pub fn push(&mut self, sweep: Sweep, field: ElectricalAngle, codes: &Codes, sequence: u32) {
        let [sums @ .., count] =
            &mut self.bins.bins_mut()[sweep as usize][field.to_bits() as u32 as usize >> (32 - BINS.ilog2())];
        if *count >= 1 << 16 {
            return;
        }
        *count += 1;
        let rail = (1_u32 << self.adc_bits) - 1;
        for (channel, &code) in codes.iter().enumerate() {
            sums[channel] += u32::from(code);
            self.at_rail[channel] += u32::from(code == 0 || u32::from(code) >= rail);
        }
        self.noise.push(codes, sequence);
    }

    /// Fits the model of so many sensors. `reversed` makes the electrical angle count against the stator's phases A, B,
    /// C.
    ///
    /// # Errors
    /// [`Error`], whose `Display` says what is wrong and what to look at.
    // A stack frame of its own, given back before an estimator is made.
    #[inline(never)]
    pub fn finish(&self, halls: Halls, reversed: bool) -> Result<Calibration, Error> {
        let both = self.bins.bins();
        for (sweep, bins) in [Sweep::Forward, Sweep::Backward].into_iter().zip(both) {
            if bins.iter().any(|[.., count]| *count < FEWEST) {
                return Err(Error::Incomplete(sweep));
            }
        }
        self.judge(&self.search(halls)?, reversed)
    }

    /// The sensors, and how the rotor followed the field.
    // The angles have left the stack before the report is made.
    #[inline(never)]
    fn search(&self, halls: Halls) -> Result<Found, Error> {
        let both = self.bins.bins();
        let mut angles = [[ElectricalAngle::ZERO; BINS]; 2];
        let fit = fit::fit(both, halls, &mut angles)?;
        tell(both, &fit, &mut angles);
        let (forward, variance) = lags(&both[0], &angles[0]);
        let (backward, variance_back) = lags(&both[1], &angles[1]);
        let hunting = ElectricalAngle::from_radians(crate::float::root(((variance + variance_back) / 2.0).max(0.0)));
        // Half way between, on the side where they are closer together.
        let lag = ElectricalAngle::from_bits((backward - forward).to_bits() / 2);
        Ok(Found { fit, alignment: forward + lag, lag, hunting })
    }

    /// The model, unless what is told of it refuses it.
    #[inline(never)]
    fn judge(&self, &Found { ref fit, alignment, lag, hunting }: &Found, reversed: bool) -> Result<Calibration, Error> {
        let model = Model { sensors: fit.sensors, alignment, reversed };
        let raw: [_; 3] = core::array::from_fn(|k| Raw { noise: self.noise.deviation(k), at_rail: self.at_rail[k] });
        let report = Report::new(&model, &raw, fit, lag, hunting);
        // A rotor that slipped fits anything, and nothing of what was fitted means anything.
        let unexplained = Finding::Unexplained(report.residual_pct);
        if unexplained.refuses() {
            return Err(Error::Refused(unexplained));
        }
        estimate::validate(&model, self.adc_bits).map_err(Error::Model)?;
        match report.findings().find(Finding::refuses) {
            Some(finding) => Err(Error::Refused(finding)),
            None => Ok(Calibration { model, report }),
        }
    }
}

/// The angles that an estimator with these sensors will tell of the bins, in place of those that fit best. Where magnets
/// have harmonics that the model lacks, the two differ, also in the mean, and it is the estimator that is to be aligned.
#[inline(never)]
fn tell(bins: &Bins, fit: &Fit, angles: &mut [[ElectricalAngle; BINS]; 2]) {
    let model = Model { sensors: fit.sensors, alignment: ElectricalAngle::ZERO, reversed: false };
    let told = estimate::hall_angles(&model, fit::sweep(bins.as_flattened()).map(|point| point.codes));
    angles.as_flattened_mut().iter_mut().zip(told).for_each(|(angle, told)| *angle = told);
}

/// Rotor's angle less field's angle, of a sweep: the mean, and the variance in radians².
#[inline(never)]
fn lags(bins: &[Bin; BINS], angles: &[ElectricalAngle; BINS]) -> (ElectricalAngle, f32) {
    // About the first, or nearly, so that the mean does not see the wrap.
    let about = angles[0];
    let (mut sum, mut squares) = (0.0, 0.0);
    for (point, &angle) in fit::sweep(bins).zip(angles) {
        let off = (angle - point.field - about).to_radians();
        sum += off;
        squares += off * off;
    }
    let mean = sum / BINS as f32;
    (about + ElectricalAngle::from_radians(mean), squares / BINS as f32 - mean * mean)
}

/// Noise from second differences of successive samples, in which the turning of the rotor cancels.
#[derive(Clone, Copy, Debug, Default)]
struct Noise {
    last: [Codes; 2],
    sequence: [u32; 2],
    squares: [f32; 3],
    count: u32,
}

impl Noise {
    fn push(&mut self, codes: &Codes, sequence: u32) {
        let step = sequence.wrapping_sub(self.sequence[0]);
        // The first two differences compare with nothing; zero codes cannot be a pair of healthy samples.
        if step == self.sequence[0].wrapping_sub(self.sequence[1]) && self.last[1] != [0; 3] {
            for channel in 0..3 {
                let [c1, c0] = self.last.map(|codes| f32::from(codes[channel]));
                let second = f32::from(codes[channel]) - 2.0 * c1 + c0;
                self.squares[channel] += second * second;
            }
            self.count += 1;
        }
        self.last = [*codes, self.last[0]];
        self.sequence = [sequence, self.sequence[0]];
    }

    /// Standard deviation in ADC codes; the weights 1, −2, 1 multiply the power by six.
    fn deviation(&self, channel: usize) -> f32 {
        crate::float::root(self.squares[channel] / (6.0 * self.count.max(1) as f32))
    }
}

#[cfg(test)]
mod tests;
