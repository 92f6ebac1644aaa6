//! Whether two sensors fit each other, where no third one tells.
//!
//! Two signals give an angle, whatever they are. Three things remain to judge them by:
//!
//! - A sensor that keeps its value while the other goes through most of its range is stuck. At a healthy one's peak,
//!   where it changes least, it changes by 47 % of its amplitude while the other, 90° away, goes through 1.7 amplitudes;
//!   by 10 % with a third harmonic of 15 %, the most that a calibration accepts.
//! - The strength of the magnet that they see: what the residual has across the tangent of the model's curve, of which
//!   an error of the angle, up to some degrees, has no part.
//! - What the rotor makes of the torque. With a sensor that is stuck, two angles have the same signals, and at one of
//!   them the rotor seems to turn the other way: it rocks, each time against its torque. A spring, a mass behind
//!   backlash or a hand does not turn it against a large torque for long, unless it is stronger than the drive.
//!
//! This runs in a task, at the rate of the records. A rotor may come to rest where a stuck sensor's angle and its own
//! are a quarter turn apart; there all fits, and it is for the [stall](crate::fault::Fault::Stall) to tell.

use crate::angle::ElectricalAngle;
use crate::control::config::Config;
use crate::hall::Codes;
use crate::hall::model::{Model, Sensor};

/// Largest healthy difference of the strength, share of the amplitude: what uneven magnets, temperature and noise may
/// come to together.
pub const HEALTHY: f32 = 0.3;

/// What a sensor stays within while it counts as unmoved, share of its amplitude.
const UNMOVED: f32 = 0.06;
/// What the other one goes through meanwhile, at least, in its amplitudes, when that one is stuck. Away from its peak a
/// healthy one changes fast, so there less will do.
const MOVED: f32 = 1.7;
/// See [`MOVED`].
const MOVED_AWAY_FROM_PEAK: f32 = 0.7;
/// Value up to which a sensor is away from its peak, whatever the magnet and its harmonics.
const AWAY_FROM_PEAK: f32 = 0.65;

/// Records that it takes: of a fast rotor, a few may see the same value of a healthy sensor at both sides of its peak.
const UNMOVED_RECORDS: u8 = 4;
/// A rotor that turns by half a turn from record to record, within so much, shows a healthy sensor that is at zero the
/// same value each time, while the other goes from peak to peak.
const ABOUT_HALF: u32 = u32::MAX / 45;

/// Share of the largest torque from which on it counts: well above its noise.
const LARGE: f32 = 0.5;

/// What a record beyond [`HEALTHY`] adds to the score, of which each other one takes 1.
const BEYOND: u8 = 8;
/// The score that no pair of healthy sensors has: three records in a row, or one in nine for longer.
const CONTRADICTION: u8 = 3 * BEYOND;

/// What is kept of the sums of torque and motion from record to record: a fifth of a second at 1.25 kHz.
const KEPT: f32 = 1.0 - 1.0 / 256.0;
/// Records with a large torque that tell something, at least.
const TELLING: f32 = 32.0;
/// What the rotor may do against the torque, share of what the torque should do. It is about −1 with the right inertia,
/// and −⅓ with a third of the inertia that is set.
const AGAINST: f32 = -0.3;
/// By how much the sum has to be beyond that, square, as a multiple of the sum of each record's square: what
/// independent ones come to, which is nearly twice what the noise of a speed does, whose changes take each other back.
const NOISE: f32 = 1.0;
/// Most that a record counts for, in what the largest torque would do: a shaft that is stopped dead loses much more.
const MOST: f32 = 3.0;

/// What the motor does from record to record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// In the direction of the electrical angle, share of the largest.
    pub torque: f32,
    /// The tracked speed, in the direction of the electrical angle, over what the largest torque changes it by until the
    /// next record.
    pub speed: f32,
}

impl Motion {
    /// Of a torque and a tracked speed, in 2⁻³² electrical turns a step, with a record every so many steps.
    pub fn of(control: &Config, torque_nm: f32, speed: i32, every: u32) -> Self {
        let largest_nm = control.largest_current_a() * control.motor.torque_constant(control.scale.pole_pairs);
        let period_s = every as f32 / control.scale.step_hz;
        let change = largest_nm / control.motor.inertia_kgm2 * period_s * control.scale.per_radian_s();
        Self { torque: torque_nm / largest_nm, speed: speed as f32 / change }
    }
}

/// Watches two sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    score: u8,
    /// Torque times what the speed changed by, and times what it should have; with large torques.
    done: f32,
    due: f32,
    /// Sum of the squares of what each record is off by from [`AGAINST`]: what the noise of the speed may come to.
    noise: f32,
    /// At the last record.
    speed: f32,
    at: ElectricalAngle,
    /// Of each sensor, since it was last where it is now.
    still: [Still; 2],
}

/// Where a sensor is, and what the other has gone through meanwhile; shares of their amplitudes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Still {
    at: f32,
    lowest: f32,
    highest: f32,
    records: u8,
}

const NOWHERE: Still = Still { at: f32::INFINITY, lowest: 0.0, highest: 0.0, records: 0 };

impl Pair {
    /// Nothing is suspected.
    pub const NEW: Self =
        Self { score: 0, done: 0.0, due: 0.0, noise: 0.0, speed: 0.0, at: ElectricalAngle::ZERO, still: [NOWHERE; 2] };

    /// Takes what the motor does; true when it turns against its torque.
    pub fn turns_against(&mut self, Motion { torque, speed }: Motion) -> bool {
        let changed = crate::float::cut(speed - core::mem::replace(&mut self.speed, speed), MOST);
        (self.done, self.due, self.noise) = (KEPT * self.done, KEPT * self.due, KEPT * self.noise);
        if libm::fabsf(torque) >= LARGE {
            let (done, due) = (torque * changed, torque * torque);
            self.done += done;
            self.due += due;
            self.noise += (AGAINST * due - done) * (AGAINST * due - done);
        }
        // A heavy rotor hardly changes its speed from record to record, and what is left is noise.
        let beyond = AGAINST * self.due - self.done;
        beyond > 0.0 && beyond * beyond > NOISE * self.noise && self.due > TELLING * LARGE * LARGE
    }

    /// Takes the codes at a tracked electrical angle; true when they contradict the model of the two sensors, or each
    /// other.
    #[inline(never)]
    pub fn take(&mut self, model: &Model, codes: &Codes, electrical: ElectricalAngle) -> bool {
        let [first, second, _] = &model.sensors;
        let signals = [signal(first, codes[0]), signal(second, codes[1])];
        // Not a number, of a model that is none, counts as beyond.
        let healthy = libm::fabsf(strength_error(model, signals, electrical)) <= HEALTHY;
        self.score = if healthy { self.score.saturating_sub(1) } else { (self.score + BEYOND).min(CONTRADICTION) };
        let turned = electrical - core::mem::replace(&mut self.at, electrical);
        if (turned + ElectricalAngle::HALF).to_bits().unsigned_abs() < ABOUT_HALF {
            self.still.iter_mut().for_each(|still| still.at = NOWHERE.at);
        }
        let [first, second] = &mut self.still;
        first.take(signals[0], signals[1]) | second.take(signals[1], signals[0]) | (self.score >= CONTRADICTION)
    }
}

impl Still {
    /// True when this sensor is stuck.
    fn take(&mut self, own: f32, other: f32) -> bool {
        if libm::fabsf(own - self.at) > UNMOVED {
            *self = Self { at: own, lowest: other, highest: other, records: 0 };
        }
        self.lowest = self.lowest.min(other);
        self.highest = self.highest.max(other);
        self.records = self.records.saturating_add(1);
        let moved = if libm::fabsf(self.at) < AWAY_FROM_PEAK { MOVED_AWAY_FROM_PEAK } else { MOVED };
        self.records >= UNMOVED_RECORDS && self.highest - self.lowest > moved
    }
}

/// About ±1.
fn signal(sensor: &Sensor, code: u16) -> f32 {
    (f32::from(code) - sensor.offset) / sensor.amplitude
}

/// How much stronger the magnet seems than calibrated, share of the amplitude.
fn strength_error(model: &Model, signals: [f32; 2], electrical: ElectricalAngle) -> f32 {
    let hall = model.hall(electrical);
    let [first, second, _] = &model.sensors;
    let waves = [first.wave(hall), second.wave(hall)];
    let slopes = [first.slope(hall), second.slope(hall)];
    // Across the tangent; which side is outward, the model's own point tells.
    let across = |point: [f32; 2]| slopes[1] * point[0] - slopes[0] * point[1];
    across([signals[0] - waves[0], signals[1] - waves[1]]) / across(waves)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hall::estimate::Estimator;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    extern crate std;

    /// Two sensors, so far apart, unequal and with a third harmonic.
    fn two(spacing: f32, third: f32) -> Model {
        let mut model = Model::nominal(12, 1000.0, ElectricalAngle::from_degrees(spacing)).of_two();
        model.sensors[1].amplitude = 800.0;
        model.sensors[0].third = third;
        model.sensors[1].third = third;
        model.alignment = ElectricalAngle::from_degrees(33.0);
        model
    }

    fn models() -> impl Iterator<Item = (f32, f32, Model)> {
        [60.0, -75.0, 90.0, 105.0, -120.0]
            .into_iter()
            .flat_map(|spacing| [0.0, 0.05, 0.1, -0.1].map(|third| (spacing, third, two(spacing, third))))
    }

    fn degrees(degrees: usize) -> ElectricalAngle {
        ElectricalAngle::from_degrees(degrees as f32)
    }

    /// Codes with so much noise, a share of the amplitude of 1000.
    fn noisy(codes: Codes, noise: f64, random: &mut Pcg64) -> Codes {
        codes.map(|code| {
            let gauss = (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
            (f64::from(code) + 1000.0 * noise * gauss).round().clamp(0.0, 4095.0) as u16
        })
    }

    #[test]
    fn a_sensor_that_is_stuck_anywhere_contradicts_at_any_speed() {
        let mut random = Pcg64::seed_from_u64(31);
        for (spacing, third, model) in models() {
            let estimator = Estimator::new(&model, 12).unwrap();
            let mut latest = [0; 4];
            // Degrees from record to record: 3 to 400 Hz electrical, at 1 kHz.
            for (latest, step) in latest.iter_mut().zip([1, 7, 36, 144]) {
                for (stuck, at) in [0, 1].into_iter().flat_map(|stuck| (0..360).step_by(5).map(move |at| (stuck, at))) {
                    let at = model.codes(degrees(at))[stuck];
                    let mut pair = Pair::NEW;
                    let contradicts = |record: &usize| {
                        let mut codes = model.codes(degrees(step * record));
                        codes[stuck] = at;
                        let codes = noisy(codes, 0.01, &mut random);
                        // What the drive takes for the angle.
                        pair.take(&model, &codes, estimator.angle_unchecked(&codes))
                    };
                    let records = (0..2000).find(contradicts);
                    let records = records.unwrap_or_else(|| panic!("{spacing} {third} {stuck} {at} {step}"));
                    *latest = records.max(*latest);
                }
            }
            std::println!("{spacing}° apart, third {third}: after {latest:?} records of 1, 7, 36, 144° at the latest");
            // Within four turns, or a dozen records where they are farther apart; two where the angle, which no tracker
            // smooths here, leaps by half a turn.
            assert!(latest[0] <= 1440 && latest[1] <= 206 && latest[2] <= 12 && latest[3] <= 24, "{latest:?}");
        }
    }

    #[test]
    fn a_seventh_of_strength_and_an_error_of_the_angle_are_healthy() {
        let mut random = Pcg64::seed_from_u64(32);
        for (spacing, third, model) in models() {
            for (strength, step) in
                [0.85, 0.95, 1.05, 1.15].into_iter().flat_map(|strength| [1, 7, 97].map(|step| (strength, step)))
            {
                let mut other = model;
                other.sensors.iter_mut().for_each(|sensor| sensor.amplitude *= strength);
                let mut pair = Pair::NEW;
                for k in 0..3600 {
                    let (angle, off) = (degrees(step * k), ElectricalAngle::from_degrees([2.0, -2.0][k % 2]));
                    let codes = noisy(other.codes(angle), 0.01, &mut random);
                    assert!(!pair.take(&model, &codes, angle + off), "{spacing} {third} × {strength}, {k}");
                }
            }
        }
    }

    #[test]
    fn a_healthy_pair_contradicts_at_no_speed() {
        let mut random = Pcg64::seed_from_u64(33);
        for (spacing, third, model) in models() {
            // Half a turn from record to record is among them, and every phase of it.
            for step in (2..=358).step_by(2).chain([179, 181]) {
                let mut pair = Pair::NEW;
                for k in 0..1000 {
                    let angle = degrees(step * k) + ElectricalAngle::from_degrees(0.37 * k as f32);
                    let codes = noisy(model.codes(angle), 0.005, &mut random);
                    assert!(!pair.take(&model, &codes, angle), "{spacing} {third}, {step}°, {k}");
                }
            }
        }
    }

    /// Whether a rotor counts as one that turns against its torque, which is full; record by record its speed, in what
    /// the torque should change it by.
    fn against(speed: impl Fn(usize) -> f32) -> bool {
        let mut pair = Pair::NEW;
        (0..600).any(|k| pair.turns_against(Motion { torque: 1.0, speed: speed(k) }))
    }

    #[test]
    fn a_rotor_that_rocks_against_its_torque_is_none_that_is_heavy_or_swings_once() {
        // It seems to be turned back again and again, and leaps to where it was.
        assert!(against(|k| 5.0 - (k % 10) as f32));
        // Of ten times the inertia, as it should.
        assert!(!against(|k| 0.1 * k as f32));
        // One swing of what uneven magnets have the speed seem, once there is something to compare it with.
        assert!(!against(|k| 0.3 * k as f32 - if k >= 40 { 12.0 } else { 0.0 }));
    }

    /// A hundred seconds of a torque that something holds, of a rotor so heavy that the noise of its speed is more than the torque
    /// changes that by. With a torque just large enough to count it is told most easily.
    #[test]
    fn the_noise_of_a_heavy_rotors_speed_is_no_contradiction() {
        let mut random = Pcg64::seed_from_u64(34);
        for (torque, noise) in
            [0.5, 0.7, 1.0].into_iter().flat_map(|torque| [1.0, 3.0, 10.0].map(|noise| (torque, noise)))
        {
            let mut pair = Pair::NEW;
            for k in 0..125_000 {
                let gauss = (0..12).map(|_| random.random_range(-0.5_f32..0.5)).sum::<f32>();
                assert!(!pair.turns_against(Motion { torque, speed: noise * gauss }), "{torque} {noise} {k}");
            }
        }
    }

    #[test]
    fn half_of_the_strength_of_one_and_two_wires_swapped_contradict() {
        for (spacing, third, model) in models() {
            let estimator = Estimator::new(&model, 12).unwrap();
            let wrong = |change: &dyn Fn(Codes) -> Codes| {
                let mut pair = Pair::NEW;
                (0..720).any(|k| {
                    let codes = change(model.codes(degrees(k)));
                    pair.take(&model, &codes, estimator.angle_unchecked(&codes))
                })
            };
            let half = |[a, b, c]: Codes| [1024 + a / 2, b, c];
            assert!(wrong(&half), "{spacing} {third}");
            assert!(!wrong(&|codes| codes));
        }
    }
}
