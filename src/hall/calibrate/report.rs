//! What a calibration says to the person who mounted the sensors.

use super::fit::Fit;
use crate::angle::{ElectricalAngle, PolePairs};
use crate::hall::model::Model;
use crate::hall::{Channel, Halls};
use crate::trig;
use core::fmt;

/// Placement pattern nearest to what was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pattern {
    /// Electrical degrees from sensor to sensor: 60 or 120, or 90 of two sensors.
    pub spacing: u8,
    /// Whether the second sensor follows the first in the direction from phase A to B; otherwise the Halls, or two
    /// motor wires, are in reverse order. Both work.
    pub forward: bool,
}

/// One sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SensorReport {
    /// Peak to peak, 2 A, in ADC codes; 0 of one that is not there.
    pub swing: f32,
    /// Mean of the signal, in ADC codes.
    pub offset: f32,
    /// Difference of ψ from the pattern's placement, electrical, the mean of all taken off. Refused beyond 20°, of two
    /// sensors beyond 15°.
    pub placement_error: ElectricalAngle,
    /// Third harmonic in per cent of the amplitude.
    pub third_pct: f32,
    /// Fifth harmonic in per cent of the amplitude.
    pub fifth_pct: f32,
    /// Standard deviation in per cent of the amplitude.
    pub noise_pct: f32,
    /// Samples at the ends of the ADC's range.
    pub at_rail: u32,
}

/// What the samples of a sensor tell without a model.
pub(super) struct Raw {
    /// Standard deviation of the noise, in ADC codes.
    pub noise: f32,
    /// Samples at the ends of the ADC's range.
    pub at_rail: u32,
}

/// All of them.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// The sensors in the order of their channels.
    pub sensors: [SensorReport; 3],
    /// How they are placed.
    pub pattern: Pattern,
    /// What the model does not explain, RMS in per cent of the amplitude.
    pub residual_pct: f32,
    /// How far the rotor lagged behind the field: friction against the torque of the calibration's current.
    pub lag: ElectricalAngle,
    /// How far the rotor swung about its mean lag, electrical degrees RMS: cogging, and resonance with it.
    pub hunting_deg: f32,
    /// Noise of the angle before tracking, electrical degrees RMS.
    pub angle_noise_deg: f32,
}

/// Something that the person who mounted the sensors should know or change.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Finding {
    /// The swing, in ADC codes, is small: the sensor is far from the magnet.
    TooFar(Channel, f32),
    /// The signal reaches the end of the ADC's range, or is flattened as a saturated sensor's.
    TooClose(Channel),
    /// One sensor's swing is this many times another's.
    Unequal(f32),
    /// Electrical degrees away from even spacing with the other two: how far it is to be moved.
    Misplaced(Channel, f32),
    /// Noise in per cent of the amplitude.
    Noisy(Channel, f32),
    /// What no rotor with three Halls explains, in per cent: a slipping rotor, a loose magnet, a current's field.
    Unexplained(f32),
    /// The rotor lagged behind the field by this many electrical degrees.
    Lagging(f32),
    /// The rotor swung about its mean lag by this many electrical degrees RMS.
    Hunting(f32),
}

impl Finding {
    /// Whether the drive must not be armed.
    pub fn refuses(&self) -> bool {
        match *self {
            Self::TooFar(_, swing) => swing < 40.0,
            Self::TooClose(_) => true,
            Self::Unequal(ratio) => ratio > 4.0,
            Self::Misplaced(_, degrees) => degrees > 30.0,
            Self::Noisy(_, percent) => percent > 6.0,
            Self::Unexplained(percent) => percent > 6.0,
            Self::Lagging(degrees) => degrees > 60.0,
            Self::Hunting(degrees) => degrees > 20.0,
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFar(channel, swing) => write!(
                f,
                "{channel} swings by only {swing:.0} ADC codes: move it closer to the magnet, amplify it, or check \
                 which way it faces"
            ),
            Self::TooClose(channel) => {
                write!(f, "{channel} saturates (flat peaks): move it away from the magnet, or lower its gain")
            }
            Self::Unequal(ratio) => {
                write!(
                    f,
                    "one Hall swings {ratio:.1} times as much as another: mount them at the same distance from the \
                     magnet"
                )
            }
            Self::Misplaced(channel, degrees) => {
                write!(f, "{channel} is {degrees:.0}° (electrical) away from even spacing with the others: move it")
            }
            Self::Noisy(channel, percent) => {
                write!(f, "{channel} has {percent:.1} % noise: shield its wire from the motor's, or filter it")
            }
            // Of a rotor that rocks the amplitude is nearly nothing, and all else many times as large.
            Self::Unexplained(percent) => write!(
                f,
                "{:.1} % of the signals fit no turning magnet: the rotor slips or sticks (turn it slower, or with more \
                 current), a Hall's wire is loose, a magnet is uneven, or the motor's current reaches the Halls",
                percent.min(100.0)
            ),
            Self::Hunting(degrees) => write!(
                f,
                "the rotor swings {degrees:.0}° about the field: turn it at another speed, away from the resonance, \
                 or with more current"
            ),
            Self::Lagging(degrees) => {
                write!(
                    f,
                    "the rotor lags {degrees:.0}° behind the field: raise the calibration current, or free the shaft"
                )
            }
        }
    }
}

impl Report {
    pub(super) fn new(
        model: &Model,
        raw: &[Raw; 3],
        fit: &Fit,
        lag: ElectricalAngle,
        hunting: ElectricalAngle,
    ) -> Self {
        let halls = model.halls();
        let pattern = Pattern::nearest(model);
        let sensor = |channel: usize| {
            let sensor = &model.sensors[channel];
            if channel >= halls.count() {
                return SensorReport::ABSENT;
            }
            SensorReport {
                swing: 2.0 * sensor.amplitude,
                offset: sensor.offset,
                placement_error: pattern.error(model, channel),
                third_pct: 100.0 * sensor.third,
                fifth_pct: 100.0 * sensor.fifth,
                noise_pct: 100.0 * raw[channel].noise / sensor.amplitude,
                at_rail: raw[channel].at_rail,
            }
        };
        let sensors = [sensor(0), sensor(1), sensor(2)];
        let noise_power = sensors.iter().map(|s| s.noise_pct * s.noise_pct).sum::<f32>() / (1e4 * halls.count() as f32);
        Self {
            sensors,
            pattern,
            residual_pct: 100.0 * fit.residual,
            lag,
            hunting_deg: hunting.to_degrees(),
            angle_noise_deg: crate::float::root(noise_power * angle_power(model)).to_degrees(),
        }
    }

    /// Those that are there.
    pub fn present(&self) -> &[SensorReport] {
        let [others @ .., third] = &self.sensors;
        if third.swing > 0.0 { &self.sensors } else { others }
    }

    fn weakest_swing(&self) -> f32 {
        self.present().iter().fold(f32::MAX, |least, sensor| least.min(sensor.swing))
    }

    /// All findings, those of single sensors first.
    pub fn findings(&self) -> impl Iterator<Item = Finding> {
        (0..3 * self.sensors.len() + 5).filter_map(|number| self.finding(number))
    }

    /// Three of each sensor, and then those of all. One at a time takes a fifth of a KiB of flash less than a list of all.
    #[inline(never)]
    fn finding(&self, number: usize) -> Option<Finding> {
        if let Some(sensor) = self.present().get(number / 3) {
            return sensor.finding(Channel(number as u8 / 3), number % 3);
        }
        let strongest = self.sensors.iter().fold(0.0_f32, |most, sensor| most.max(sensor.swing));
        let ratio = strongest / self.weakest_swing();
        let lag = self.lag.to_degrees().abs();
        match number.wrapping_sub(3 * self.sensors.len()) {
            0 => self.misplaced(),
            1 => (ratio > 2.0).then_some(Finding::Unequal(ratio)),
            2 => (self.residual_pct > 2.0).then_some(Finding::Unexplained(self.residual_pct)),
            3 => (lag > 30.0).then_some(Finding::Lagging(lag)),
            4 => (self.hunting_deg > 5.0).then_some(Finding::Hunting(self.hunting_deg)),
            _ => None,
        }
    }

    /// The Hall that is farthest from its place, and by how much. The placement errors have mean zero, so that one of
    /// three has to move by half as much again to be even with the other two, and one of two by twice as much.
    fn misplaced(&self) -> Option<Finding> {
        let errors = self.sensors.map(|sensor| sensor.placement_error.to_degrees().abs());
        let farthest = (0..3).reduce(|far, k| if errors[k] > errors[far] { k } else { far })?;
        let count = self.present().len() as f32;
        let degrees = errors[farthest] * count / (count - 1.0);
        (degrees > 15.0).then_some(Finding::Misplaced(Channel(farthest as u8), degrees))
    }

    /// Counts in an electrical turn by Simpkins and Todorov, eq. (7): four times the swing, of the weakest sensor.
    pub fn counts_per_electrical_turn(&self) -> f32 {
        4.0 * self.weakest_swing()
    }

    /// Counts in a mechanical turn.
    pub fn counts_per_turn(&self, pole_pairs: PolePairs) -> f32 {
        self.counts_per_electrical_turn() * f32::from(pole_pairs.get())
    }
}

/// Mean over the turn of the angle's noise power, over that of a sensor. Without harmonics three sensors 120° apart
/// have 2/3, two at ψ from each other 1/sin² ψ.
fn angle_power(model: &Model) -> f32 {
    match model.halls() {
        Halls::Three => 2.0 / 3.0,
        Halls::Two => {
            let (sine, _) = trig::sin_cos_f32(model.sensors[1].placement - model.sensors[0].placement);
            1.0 / (sine * sine)
        }
    }
}

impl SensorReport {
    const ABSENT: Self = Self {
        swing: 0.0,
        offset: 0.0,
        placement_error: ElectricalAngle::ZERO,
        third_pct: 0.0,
        fifth_pct: 0.0,
        noise_pct: 0.0,
        at_rail: 0,
    };

    fn finding(&self, channel: Channel, number: usize) -> Option<Finding> {
        // A sine clipped at 80 % of its peak has 10 % third harmonic; no magnet's own field is as flat.
        let flat = self.third_pct > 15.0;
        match number {
            0 => (self.swing < 150.0).then_some(Finding::TooFar(channel, self.swing)),
            1 => (self.at_rail > 0 || flat).then_some(Finding::TooClose(channel)),
            _ => (self.noise_pct > 3.0).then_some(Finding::Noisy(channel, self.noise_pct)),
        }
    }
}

impl Pattern {
    fn nearest(model: &Model) -> Self {
        let candidates = [60, 60, 120, 120, 90, 90];
        // Three are never 90° apart.
        let possible = if model.halls() == Halls::Two { 6 } else { 4 };
        // By quarters, whose sum has room in 32 bits.
        let misfit = |pattern: &Self| (0..3).map(|k| pattern.error(model, k).to_bits().unsigned_abs() / 4).sum::<u32>();
        let mut nearest = (u32::MAX, Self { spacing: 120, forward: true });
        for (k, spacing) in candidates.into_iter().enumerate().take(possible) {
            let pattern = Self { spacing, forward: k % 2 == 1 };
            let misfit = misfit(&pattern);
            if misfit < nearest.0 {
                nearest = (misfit, pattern);
            }
        }
        nearest.1
    }

    /// A sensor's distance from the pattern, which is laid so that the distances have mean zero; zero for one that is
    /// not there.
    fn error(self, model: &Model, channel: usize) -> ElectricalAngle {
        let spacing = ElectricalAngle::from_degrees(f32::from(self.spacing));
        let step = if self.forward { spacing } else { -spacing };
        let places = [ElectricalAngle::ZERO, step, step + step];
        let count = model.halls().count();
        if channel >= count {
            return ElectricalAngle::ZERO;
        }
        let error = |k: usize| i64::from((model.sensors[k].placement - places[k]).to_bits());
        let mean = (0..count).map(error).sum::<i64>() / count as i64;
        ElectricalAngle::from_bits((error(channel) - mean) as i32)
    }
}
