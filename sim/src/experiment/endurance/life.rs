//! One rotor with its Halls: what they go through, and what the adaptation makes of it.

use super::course::{Course, between};
use crate::experiment::adapt::rotors::trial_of;
use crate::experiment::adapt::trial::{self, DAMPING_1_S, Motion, PERIOD_S, Trial, wrapped_deg};
use crate::experiment::magnets::Kind;
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::hall::Channel;
use hallservo::hall::adapt::{Adapter, Observation, Status};
use plant::{Bench, HallFault, HallParameters, Noise, Rail, Unevenness};
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Every fourth rotor has two Halls, so far apart.
const TWO_APART_DEG: [f64; 4] = [90.0, 120.0, 60.0, -90.0];
/// How far a Hall and its magnets drift, per kelvin: the amplitude, and the offset in shares of it.
const AMPLITUDE_1_K: f64 = 1.5e-3;
const OFFSET_1_K: f64 = 0.5e-3;
/// Temperatures that it is taken to, °C, how soon, s, and how long it stays, s.
const TEMPERATURES_C: [f64; 2] = [-20.0, 80.0];
const WARMS_S: f64 = 60.0;
const STAYS_S: [f64; 2] = [10.0, 300.0];
/// The motor's torque as it is told to the filter, over what it is: wrong inertia, wrong torque constant.
const TOLD: [f64; 2] = [0.5, 2.0];
/// Acceleration by the largest current, rad/s² electrical.
const RATED_RAD_S2: f64 = 4000.0;
/// Between two samples of one Hall that are disturbed, and between two gaps, s.
const SPIKES_S: f64 = 20.0;
const GAPS_S: f64 = 10.0;
/// Most samples that are lost in a row.
const LONGEST_GAP: f64 = 8.0;
/// An angle that is wrong by so much, degrees, is lost.
const ASTRAY_DEG: f64 = 45.0;
/// Turns from a broken Hall until nobody waits for its name any more.
const PATIENCE_TURNS: f64 = 5.0;

/// A Hall that was broken at the end of a life.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Loss {
    /// Electrical turns until the adaptation says so.
    pub turns: Option<f64>,
    /// Whether it names that Hall.
    pub is_named: bool,
}

/// What came of a life.
#[derive(Clone, Debug, Serialize)]
pub struct Life {
    /// Kind of rotor.
    pub kind: &'static str,
    /// Of everything else that is random.
    pub seed: u64,
    /// Distance of two Halls; none of three.
    pub two_apart_deg: Option<f64>,
    /// So long it was, s.
    pub seconds: f64,
    /// What was said of its sound Halls in the end, if anything.
    pub alarm: Option<String>,
    /// Samples of which parameters were learnt, as a share.
    pub learning: f64,
    /// Error of the filter's angle while it says that it follows, less its mean, electrical degrees RMS.
    pub error_deg_rms: f64,
    /// For how long it was lost meanwhile, s.
    pub astray_s: f64,
    /// What came of the Hall that was broken at last; with two, the adaptation blames none.
    pub loss: Option<Loss>,
}

/// The world around a rotor and its filter.
struct World {
    bench: Bench,
    adapter: Adapter,
    course: Course,
    random: Noise,
    time_s: f64,
    /// The torque that is told, over what it is.
    told: f64,
    temperature_c: f64,
    target_c: f64,
    stays_s: f64,
    rated_a: f64,
    /// Where the first sensor's signal rises through its offset.
    zero_rad: f64,
    /// Samples since the filter had one.
    elapsed: u16,
    gap: u16,
    turned: f64,
}

/// The life of a seed's rotor of a kind.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn live(kind: &Kind, seed: u64, seconds: f64) -> Result<Life> {
    let two_apart_deg = (seed % 4 == 3).then(|| TWO_APART_DEG[(seed / 4 % 4) as usize]);
    let mut world = World::new(kind, seed, two_apart_deg)?;
    let (mut errors, mut learning, mut samples, mut astray_s, mut alarm) = (Statistics::default(), 0.0, 0.0, 0.0, None);
    while alarm.is_none() && world.time_s < seconds {
        let Some(status) = world.step() else { continue };
        samples += 1.0;
        match status {
            Status::Failed(fault) => alarm = Some(fault.to_string()),
            Status::Acquiring => continue,
            Status::Adapting | Status::ModelReady => learning += 1.0,
            Status::Tracking => {}
        }
        let error_deg = world.error_deg();
        errors.push(error_deg);
        astray_s += if error_deg.abs() > ASTRAY_DEG { PERIOD_S } else { 0.0 };
    }
    let loss = if alarm.is_none() && two_apart_deg.is_none() { world.lose(seed) } else { None };
    Ok(Life {
        kind: kind.name,
        seed,
        two_apart_deg,
        seconds: world.time_s.min(seconds),
        alarm,
        learning: learning / samples,
        error_deg_rms: errors.variance().sqrt(),
        astray_s,
        loss,
    })
}

/// Halls whose offsets and amplitudes drift, each by itself.
fn drifting(mut halls: [HallParameters; 3], bandwidth_hz: Option<f64>, random: &mut Noise) -> [HallParameters; 3] {
    for hall in &mut halls {
        hall.amplitude_drift_k = AMPLITUDE_1_K * random.uniform();
        hall.offset_drift_v_k = OFFSET_1_K * hall.amplitude_v * random.uniform();
        hall.bandwidth_hz = bandwidth_hz;
    }
    halls
}

impl World {
    fn new(kind: &Kind, seed: u64, two_apart_deg: Option<f64>) -> Result<Self> {
        let mut random = Noise::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let halls = two_apart_deg.map_or_else(|| trial::halls(seed), |apart_deg| trial::two_halls(apart_deg, seed));
        let halls = drifting(halls, kind.bandwidth_hz, &mut random);
        let Trial { bench, adapter, .. } = trial_of(halls, seed, &kind.unevenness, Motion::Constant(0.0), true)?;
        let told = between(&mut random, TOLD);
        let Unevenness { rated_a, .. } = kind.unevenness;
        Ok(Self {
            bench,
            adapter,
            course: Course::new(seed),
            random,
            time_s: 0.0,
            told,
            temperature_c: 25.0,
            target_c: 25.0,
            stays_s: 0.0,
            rated_a,
            zero_rad: halls[0].placement_rad,
            elapsed: 1,
            gap: 0,
            turned: 0.0,
        })
    }

    /// Whether something that happens every so many seconds does so now.
    fn happens(&mut self, every_s: f64) -> bool {
        0.5 * (1.0 + self.random.uniform()) < PERIOD_S / every_s
    }

    /// A sample; what the filter says, if it has got it.
    fn step(&mut self) -> Option<Status> {
        self.warm();
        let drive = self.course.advance(self.time_s, self.bench.speed_rad_s(), PERIOD_S);
        let current_a = self.rated_a * (drive.told / RATED_RAD_S2).clamp(-1.0, 1.0);
        let angle_rad = self.bench.angle_rad() + PERIOD_S * self.bench.speed_rad_s();
        self.bench.set_currents([0.0, 1.0, 2.0].map(|leg| current_a * (angle_rad + FRAC_PI_2 - leg * TAU / 3.0).cos()));
        let damping_nm = trial::torque_nm(DAMPING_1_S * self.bench.speed_rad_s());
        let motor_nm = trial::torque_nm(drive.told) + if drive.told == 0.0 { 0.0 } else { damping_nm };
        let codes = self.bench.step(motor_nm + trial::torque_nm(drive.untold));
        self.time_s += PERIOD_S;
        self.turned += self.bench.speed_rad_s().abs() * PERIOD_S / TAU;
        let codes = self.disturbed(codes)?;
        let torque_nm = (self.told * motor_nm) as f32;
        let status = self.adapter.update(&Observation { codes, elapsed: self.elapsed, torque_nm });
        self.elapsed = 1;
        Some(status)
    }

    /// What reaches the filter.
    fn disturbed(&mut self, mut codes: [u16; 3]) -> Option<[u16; 3]> {
        if self.gap == 0 && self.happens(GAPS_S) {
            self.gap = between(&mut self.random, [1.0, LONGEST_GAP]).round() as u16;
        }
        if self.gap > 0 {
            self.gap -= 1;
            self.elapsed += 1;
            return None;
        }
        if self.happens(SPIKES_S) {
            let sensor = (1.5 + 1.5 * self.random.uniform()) as usize % 3;
            codes[sensor] = (2048.0 * (1.0 + self.random.uniform())) as u16;
        }
        Some(codes)
    }

    fn warm(&mut self) {
        if self.time_s >= self.stays_s {
            let [coldest, warmest] = TEMPERATURES_C;
            self.target_c = coldest + (warmest - coldest) * 0.5 * (1.0 + self.random.uniform());
            self.stays_s = self.time_s + between(&mut self.random, STAYS_S);
        }
        self.temperature_c += (self.target_c - self.temperature_c) * PERIOD_S / WARMS_S;
        self.bench.set_temperature(self.temperature_c);
    }

    /// The filter's angle less the true one.
    fn error_deg(&self) -> f64 {
        let truth = self.bench.angle_rad() - self.zero_rad;
        wrapped_deg(f64::from(self.adapter.hall_angle().to_radians()) - truth)
    }

    /// Breaks a Hall while the rotor turns at some speed; none where it does not get there.
    fn lose(&mut self, seed: u64) -> Option<Loss> {
        let hz = self.random.uniform().signum() * between(&mut self.random, [1.0, 60.0]);
        self.course.hold(hz);
        let settled = self.turned + 4.0 + 20.0 * self.random.uniform().abs();
        let asked_s = self.time_s + 2.0;
        while self.turned < settled || self.time_s < asked_s {
            if let Some(Status::Failed(_)) = self.step() {
                return None;
            }
        }
        let sensor = (seed / 4 % 3) as usize;
        let fault = self.broken(seed);
        self.bench.set_fault(sensor, Some(fault));
        let (broken, named) = (self.turned, Channel(sensor as u8));
        while self.turned < broken + PATIENCE_TURNS {
            if let Some(Status::Failed(fault)) = self.step() {
                return Some(Loss { turns: Some(self.turned - broken), is_named: fault.lost() == Some(named) });
            }
        }
        Some(Loss { turns: None, is_named: false })
    }

    fn broken(&mut self, seed: u64) -> HallFault {
        match seed / 12 % 4 {
            0 => HallFault::Open(Rail::Low),
            1 => HallFault::Open(Rail::High),
            2 => HallFault::StuckAt(1.65),
            _ => HallFault::StuckAt(1.65 + 0.4 * self.random.uniform()),
        }
    }
}
