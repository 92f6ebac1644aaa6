//! Faults injected into a running encoder: does a wrong angle leave it before the fault is reported?

use super::build::{Build, calibrate};
use anyhow::Result;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::continuity::State;
use hallservo::vernier::encoder::{Encoder, Reading};
use hallservo::vernier::head::{Channel, Head, HeadFault};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;
use std::f64::consts::TAU;

/// What breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// One head keeps its reading.
    StuckHead,
    /// One ring loses half of its field, under heads with sine and cosine outputs.
    HalfDemagnetised,
    /// The readings of the two rings are exchanged.
    ReadingsSwapped,
    /// All readings are random for 1 to 64 samples.
    NoiseBurst,
}

impl Fault {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::StuckHead => "a head is stuck",
            Self::HalfDemagnetised => "a ring loses half of its field",
            Self::ReadingsSwapped => "the readings are swapped",
            Self::NoiseBurst => "a burst of noise",
        }
    }
}

/// All of them.
pub const FAULTS: [Fault; 4] = [Fault::StuckHead, Fault::HalfDemagnetised, Fault::ReadingsSwapped, Fault::NoiseBurst];

/// What became of the trials of one fault.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Outcome {
    /// The fault.
    pub fault: Fault,
    /// Heads over each ring.
    pub heads: usize,
    /// Times it was injected.
    pub trials: usize,
    /// Trials in which it was reported.
    pub flagged: usize,
    /// Trials in which an angle off by more than the margin was returned as good, before or after a report.
    pub wrong: usize,
    /// Trials in which the decoder by itself, without the checks, would have returned one.
    pub unchecked_wrong: usize,
    /// The largest error of an angle that was returned as good, mechanical degrees.
    pub worst_deg: f64,
    /// Reports while nothing was broken.
    pub false_alarms: usize,
}

impl Outcome {
    /// This and the trials of another encoder, of the same fault.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            trials: self.trials + other.trials,
            flagged: self.flagged + other.flagged,
            wrong: self.wrong + other.wrong,
            unchecked_wrong: self.unchecked_wrong + other.unchecked_wrong,
            worst_deg: self.worst_deg.max(other.worst_deg),
            false_alarms: self.false_alarms + other.false_alarms,
            ..self
        }
    }
}

/// Places on the turn at which the encoder is known: 0.0014° apart, finer than a count of either ring.
const PLACES: usize = 1 << 18;
/// The largest step between samples, in places; 6000 rpm at 20 kHz.
const LARGEST_STEP: f64 = 0.005 * PLACES as f64;
/// The largest change of the step, in places: 19 000 rad/s² at 20 kHz.
const LARGEST_CHANGE: f64 = 2.0;
/// Samples for which a fault is watched after its report, and the most without one.
const AFTER_REPORT: usize = 256;
const LONGEST: usize = 4096;

/// Samples of an encoder all round, to be read faster than the geometry can be computed.
pub struct Recorded<const HEADS: usize> {
    encoder: Encoder<HEADS>,
    /// Electrical angles as wrapping turns.
    phases: Vec<[[u32; HEADS]; 2]>,
    /// What the encoder makes of each place when nothing is broken.
    healthy: Vec<MechanicalAngle>,
    margin_deg: f64,
}

impl<const HEADS: usize> Recorded<HEADS> {
    /// Builds and calibrates an encoder and records it.
    ///
    /// # Errors
    /// The calibration is refused.
    pub fn new(build: &Build, seed: u64) -> Result<Self> {
        let mut construction = build.construction(seed);
        let rings = build.rings()?;
        let (calibration, _) = calibrate::<HEADS>(build, &mut construction, seed)?;
        let step = MechanicalAngle::from_bits((LARGEST_STEP / PLACES as f64 * 2f64.powi(32)) as i32);
        let encoder = Encoder::new(&rings, &calibration, step)?;
        let phases: Vec<[[u32; HEADS]; 2]> = (0..PLACES)
            .map(|place| {
                let shaft = place as f64 / PLACES as f64 * TAU;
                std::array::from_fn(|ring| {
                    std::array::from_fn(|head| {
                        let turns = construction.heads[ring][head].electrical(&construction.rings[ring], shaft) / TAU;
                        ((turns - turns.floor()) * 2f64.powi(32)) as u32
                    })
                })
            })
            .collect();
        let healthy =
            phases.iter().map(|phases| encoder.decode(reading(phases.map(|p| p.map(|p| (p >> 16) as u16)))).angle);
        let healthy = healthy.collect();
        let margin_deg = f64::from(rings.margin().mechanical_degrees);
        Ok(Self { encoder, phases, healthy, margin_deg })
    }

    /// Injects a fault `trials` times.
    pub fn trials(&self, fault: Fault, trials: usize, seed: u64) -> Outcome {
        let mut outcome = Outcome {
            fault,
            heads: HEADS,
            trials,
            flagged: 0,
            wrong: 0,
            unchecked_wrong: 0,
            worst_deg: 0.0,
            false_alarms: 0,
        };
        let mut random = Pcg32::seed_from_u64(seed);
        let mut shaft = Shaft { place: random.random_range(0.0..PLACES as f64), step: 500.0, target: 500.0 };
        let mut state = State::default();
        for _ in 0..trials {
            for _ in 0..random.random_range(5..80) {
                shaft.turn(&mut random);
                let sample = self.sample(shaft.place(), None, 0, &mut random);
                outcome.false_alarms += usize::from(self.step(&mut state, sample).is_err());
            }
            while !state.is_proven() {
                // The first time only: the encoder needs the travel of a pole pair.
                shaft.turn(&mut random);
                let sample = self.sample(shaft.place(), None, 0, &mut random);
                outcome.false_alarms += usize::from(self.step(&mut state, sample).is_err());
            }
            let trial = self.trial(fault, state, shaft.clone(), &mut random);
            outcome.flagged += usize::from(trial.flagged);
            outcome.wrong += usize::from(trial.worst_deg > self.margin_deg);
            outcome.unchecked_wrong += usize::from(trial.worst_unchecked_deg > self.margin_deg);
            outcome.worst_deg = outcome.worst_deg.max(trial.worst_deg);
        }
        outcome
    }

    /// One fault.
    fn trial(&self, fault: Fault, mut state: State, mut shaft: Shaft, random: &mut Pcg32) -> Trial {
        let broken = random.random_range(0..2 * HEADS);
        let burst = random.random_range(1..=64);
        let stuck = self.digital(shaft.place(), random);
        let mut reported_at = None;
        let (mut worst, mut worst_unchecked) = (0.0, 0.0);
        let error_deg = |angle: MechanicalAngle, place: usize| {
            f64::from((angle - self.healthy[place]).to_bits().unsigned_abs()) / 2f64.powi(32) * 360.0
        };
        for number in 0..LONGEST {
            if reported_at.is_some_and(|at| number > at + AFTER_REPORT) {
                break;
            }
            shaft.turn(random);
            let place = shaft.place();
            let over = fault == Fault::NoiseBurst && number >= burst;
            if over && reported_at.is_none() {
                break;
            }
            let sample = match fault {
                Fault::StuckHead => {
                    let mut reading = self.digital(place, random);
                    reading[broken / HEADS][broken % HEADS] = stuck[broken / HEADS][broken % HEADS];
                    Ok(reading)
                }
                Fault::ReadingsSwapped => {
                    let [reference, vernier] = self.digital(place, random);
                    Ok([vernier, reference])
                }
                _ => self.sample(place, (!over).then_some(fault), broken / HEADS, random),
            };
            if let Ok(readings) = sample {
                let angle = self.encoder.decode(reading(readings)).angle;
                worst_unchecked = f64::max(worst_unchecked, error_deg(angle, place));
            }
            match self.step(&mut state, sample) {
                Ok(angle) => worst = f64::max(worst, error_deg(angle, place)),
                Err(()) => {
                    reported_at.get_or_insert(number);
                }
            }
        }
        Trial { flagged: reported_at.is_some(), worst_deg: worst, worst_unchecked_deg: worst_unchecked }
    }

    fn step(&self, state: &mut State, sample: Result<[[u16; HEADS]; 2], HeadFault>) -> Result<MechanicalAngle, ()> {
        let decoded = match sample {
            Ok(readings) => self.encoder.step(state, reading(readings)),
            Err(_) => self.encoder.miss(state),
        };
        decoded.map(|decoded| decoded.angle).map_err(|_| ())
    }

    /// Readings at a place with nothing broken, with a random burst, or of analog heads over a weak ring.
    fn sample(
        &self,
        place: usize,
        fault: Option<Fault>,
        ring: usize,
        random: &mut Pcg32,
    ) -> Result<[[u16; HEADS]; 2], HeadFault> {
        match fault {
            Some(Fault::NoiseBurst) => Ok(std::array::from_fn(|_| std::array::from_fn(|_| random.random()))),
            Some(Fault::HalfDemagnetised) => self.analog(place, ring, random),
            _ => Ok(self.digital(place, random)),
        }
    }

    /// 12-bit readings with a count of noise.
    fn digital(&self, place: usize, random: &mut Pcg32) -> [[u16; HEADS]; 2] {
        self.phases[place].map(|phases| {
            phases.map(|phase| {
                let noise = random.random_range(-1.0..=1.0) * 2f64.powi(20);
                ((phase.wrapping_add_signed(noise as i32) >> 20) << 4) as u16
            })
        })
    }

    /// Readings of heads with sine and cosine, half of the field missing under one ring. Their calibration has left
    /// 2 % of offset, which counts for twice as much now.
    fn analog(&self, place: usize, weak: usize, random: &mut Pcg32) -> Result<[[u16; HEADS]; 2], HeadFault> {
        const AMPLITUDE: f64 = 1500.0;
        let channel = Channel { offset: 2048, amplitude: AMPLITUDE as u16 };
        let head = Head::new(channel, channel, 4095).ok_or(HeadFault::Weak)?;
        let mut readings = [[0; HEADS]; 2];
        for (ring, (readings, phases)) in readings.iter_mut().zip(self.phases[place]).enumerate() {
            let amplitude = AMPLITUDE * if ring == weak { 0.5 } else { 1.0 };
            for (reading, phase) in readings.iter_mut().zip(phases) {
                let mut code = |value: f64| {
                    let noise = random.random_range(-1.0..=1.0);
                    (2048.0 + 0.02 * AMPLITUDE + amplitude * value + noise).round() as u16
                };
                let angle = f64::from(phase) / 2f64.powi(32) * TAU;
                *reading = head.read(code(angle.sin()), code(angle.cos()))?;
            }
        }
        Ok(readings)
    }
}

/// What became of one fault: the largest errors of angles returned as good, and of the decoder's without checks.
struct Trial {
    flagged: bool,
    worst_deg: f64,
    worst_unchecked_deg: f64,
}

fn reading<const HEADS: usize>([reference, vernier]: [[u16; HEADS]; 2]) -> Reading<HEADS> {
    Reading { reference, vernier }
}

/// A shaft that goes after one random speed after the other; places and places a sample.
#[derive(Clone, Debug)]
struct Shaft {
    place: f64,
    step: f64,
    target: f64,
}

impl Shaft {
    fn turn(&mut self, random: &mut Pcg32) {
        if random.random_range(0..200) == 0 {
            // From standstill over creeping to the highest speed, each as likely.
            let magnitude = LARGEST_STEP * 0.98 * 10f64.powf(random.random_range(-6.0..0.0));
            self.target = match random.random_range(0..5) {
                0 => 0.0,
                1 | 2 => magnitude,
                _ => -magnitude,
            };
        }
        self.step += (self.target - self.step).clamp(-LARGEST_CHANGE, LARGEST_CHANGE);
        self.place = (self.place + self.step).rem_euclid(PLACES as f64);
    }

    fn place(&self) -> usize {
        self.place as usize % PLACES
    }
}
