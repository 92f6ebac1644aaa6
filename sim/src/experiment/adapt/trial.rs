//! One run of the adaptation against three imperfect Halls on a bench, with the bound that no filter can beat.

use anyhow::Result;
use hallservo::angle::ElectricalAngle;
use hallservo::hall::Halls;
use hallservo::hall::adapt::{Adapter, Observation, Settings, Status};
use hallservo::hall::model::{Model, Sensor};
use plant::{Bench, BenchParameters, Bound, HallParameters, Magnets, PlantParameters, Prior};
use std::f64::consts::{PI, TAU};

/// Time between samples, s.
pub const PERIOD_S: f64 = 1e-3;
/// LSB of the converter, V.
pub const LSB_V: f64 = 3.3 / 4096.0;
pub(super) const POLE_PAIRS: f64 = 4.0;
const INERTIA_KGM2: f64 = 1e-5;
/// Damping torque per speed, by friction and by the back-EMF at a voltage command, N·m·s.
pub(super) const DAMPING_NMS: f64 = 1.6e-4;
/// Density of the torque that the filter is not told, N·m/√Hz.
const TORQUE_NOISE_NM_RTHZ: f64 = 1e-5;
/// The same as an electrical acceleration, rad/s²/√Hz.
pub const ACCELERATION_NOISE: f64 = POLE_PAIRS / INERTIA_KGM2 * TORQUE_NOISE_NM_RTHZ;
/// Rate at which the speed decays, 1/s.
pub const DAMPING_1_S: f64 = DAMPING_NMS / INERTIA_KGM2;

/// The electrical speed that is asked for, over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Hz.
    Constant(f64),
    /// From rest to so many Hz in a second, then on at that speed.
    Ramp(f64),
    /// Between plus and minus so many Hz, one triangle in two seconds.
    Reversals(f64),
}

impl Motion {
    /// Speed in rad/s and acceleration in rad/s² at a time.
    pub fn at(self, t: f64) -> (f64, f64) {
        match self {
            Self::Constant(hz) => (TAU * hz, 0.0),
            Self::Ramp(hz) if t < 1.0 => (TAU * hz * t, TAU * hz),
            Self::Ramp(hz) => (TAU * hz, 0.0),
            Self::Reversals(hz) => {
                let phase = (t + 0.5).rem_euclid(2.0);
                let slope = 2.0 * TAU * hz;
                if phase < 1.0 { (slope * (phase - 0.5), slope) } else { (slope * (1.5 - phase), -slope) }
            }
        }
    }
}

/// The torque of an electrical acceleration, rad/s², N·m.
pub fn torque_nm(acceleration: f64) -> f64 {
    INERTIA_KGM2 / POLE_PAIRS * acceleration
}

/// What the filter starts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// The data sheet.
    Nominal,
    /// A calibration, taken as exact.
    Calibrated,
}

/// A bench with a filter.
pub struct Trial {
    /// The rotor and its sensors.
    pub bench: Bench,
    /// The filter.
    pub adapter: Adapter,
    /// The bound.
    pub bound: Bound,
    /// The sensors as they are at 25 °C.
    pub halls: [HallParameters; 3],
    motion: Motion,
    time_s: f64,
}

/// What came of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Codes.
    pub codes: [u16; 3],
    /// The torque told to the filter, N·m.
    pub torque_nm: f64,
    /// What the filter said.
    pub outcome: Status,
    /// Its angle less the true one, degrees.
    pub error_deg: f64,
    /// Least standard deviation of that, degrees.
    pub bound_deg: f64,
}

/// Sensors drawn from the seed: see `PlantParameters::imperfect`.
pub fn halls(seed: u64) -> [HallParameters; 3] {
    PlantParameters::imperfect(seed).halls
}

/// Two of them, so far apart, besides errors.
pub fn two_halls(apart_deg: f64, seed: u64) -> [HallParameters; 3] {
    PlantParameters::imperfect(seed).with_two_halls(apart_deg).halls
}

/// How many they are: one that is not there sees no magnet.
pub fn count(halls: &[HallParameters; 3]) -> Halls {
    if halls[2].amplitude_v == 0.0 { Halls::Two } else { Halls::Three }
}

/// The model of sensors known exactly; zero is where the first sensor's signal rises through its offset.
pub fn exact_model(halls: &[HallParameters; 3]) -> Model {
    let mut model = nominal_model();
    for (sensor, hall) in model.sensors.iter_mut().zip(halls) {
        *sensor = Sensor {
            offset: (hall.offset_v / LSB_V) as f32,
            amplitude: (hall.amplitude_v / LSB_V) as f32,
            placement: ElectricalAngle::from_radians((hall.placement_rad - halls[0].placement_rad) as f32),
            third: hall.third as f32,
            fifth: hall.fifth as f32,
        };
    }
    model
}

/// The data sheet's model.
pub fn nominal_model() -> Model {
    Model::nominal(12, 250.0, ElectricalAngle::THIRD)
}

/// The settings that fit the bench.
pub fn settings(start: Start) -> Settings {
    let settings = Settings::default();
    match start {
        Start::Nominal => Settings { start: Settings::NOMINAL, ..settings },
        Start::Calibrated => settings,
    }
}

/// An angle between −180° and 180°.
pub fn wrapped_deg(radians: f64) -> f64 {
    (radians - TAU * (radians / TAU).round()).to_degrees()
}

impl Trial {
    /// A motor of the seed.
    ///
    /// # Errors
    /// Parameters that plant or filter refuse.
    pub fn new(seed: u64, halls: [HallParameters; 3], motion: Motion, start: Start) -> Result<Self> {
        let model = match start {
            Start::Nominal => nominal_model(),
            Start::Calibrated => exact_model(&halls),
        };
        Self::with(seed, halls, motion, &model, &settings(start))
    }

    /// The same with a model and settings of one's own.
    ///
    /// # Errors
    /// Parameters that plant or filter refuse.
    pub fn with(
        seed: u64,
        halls: [HallParameters; 3],
        motion: Motion,
        model: &Model,
        settings: &Settings,
    ) -> Result<Self> {
        Self::at(seed, halls, Magnets::EVEN, motion, model, settings)
    }

    /// The same at uneven magnets.
    ///
    /// # Errors
    /// Parameters that plant or filter refuse.
    pub fn at(
        seed: u64,
        halls: [HallParameters; 3],
        magnets: Magnets,
        motion: Motion,
        model: &Model,
        settings: &Settings,
    ) -> Result<Self> {
        let parameters = BenchParameters {
            halls,
            magnets,
            adc: PlantParameters::imperfect(seed).adc,
            period_s: PERIOD_S,
            pole_pairs: POLE_PAIRS as u8,
            inertia_kgm2: INERTIA_KGM2,
            damping_nms: DAMPING_NMS,
            torque_noise_nm_rthz: TORQUE_NOISE_NM_RTHZ,
        };
        // Anywhere in the turn, another place for each seed.
        let angle = TAU * (seed as f64 * 0.618_034).fract() - PI;
        let bench = Bench::new(&parameters, angle, motion.at(0.0).0, seed)?;
        let config = Settings { halls: count(&halls), ..*settings }.validate()?;
        let nominal_v = 250.0 * LSB_V;
        let prior = Prior {
            angle_rad: PI / 3.0_f64.sqrt(),
            speed_rad_s: TAU * 100.0,
            third: f64::from(settings.start.third),
            offset_v: nominal_v * f64::from(settings.start.offset),
            amplitude_v: nominal_v * f64::from(settings.start.amplitude),
            placement_rad: f64::from(settings.start.placement_deg).to_radians(),
        };
        Ok(Self {
            bench,
            adapter: Adapter::new(&config, model)?,
            bound: Bound::new(&prior),
            halls,
            motion,
            time_s: 0.0,
        })
    }

    /// The next sample.
    pub fn step(&mut self) -> Step {
        let (speed, acceleration) = self.motion.at(self.time_s);
        let torque_nm = torque_nm(acceleration + DAMPING_1_S * speed);
        let codes = self.sample(torque_nm);
        let observation = Observation { codes, elapsed: 1, torque_nm: torque_nm as f32 };
        let outcome = self.adapter.update(&observation);
        Step { codes, torque_nm, outcome, error_deg: self.error_deg(), bound_deg: self.bound.angle_rad().to_degrees() }
    }

    /// The next sample under a torque; the filter does not see it yet.
    pub fn sample(&mut self, torque_nm: f64) -> [u16; 3] {
        self.time_s += PERIOD_S;
        let codes = self.bench.step(torque_nm);
        self.bound.advance(PERIOD_S, DAMPING_1_S, ACCELERATION_NOISE);
        self.bound.observe(&self.halls, self.bench.angle_rad(), LSB_V);
        codes
    }

    /// The filter's angle less the true one, degrees.
    pub fn error_deg(&self) -> f64 {
        wrapped_deg(f64::from(self.adapter.hall_angle().to_radians()) - self.hall_rad())
    }

    /// The true angle from where the first sensor's signal rises.
    pub fn hall_rad(&self) -> f64 {
        self.bench.angle_rad() - self.halls[0].placement_rad
    }

    /// Time passed.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }
}
