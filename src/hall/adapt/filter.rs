//! The extended Kalman filter itself: eleven states and their joint covariance.
//!
//! States, in this order: θ (Hall angle, rad), ω (rad a sample), h (third harmonic beyond the calibrated one, the same
//! for all sensors), and for every sensor its offset and amplitude, relative to the calibrated amplitude, and, but for
//! the first, its placement ψ (rad). The angles themselves are kept as wrapping integers.
//!
//! Measurements are scalars, used one after the other, so nothing is inverted. One costs what reading and writing the
//! 66 entries of the covariance costs.

use crate::angle::{ElectricalAngle, TURN};

/// Number of states.
pub const STATES: usize = 11;
/// Entries of the covariance on and above its diagonal.
const ENTRIES: usize = STATES * (STATES + 1) / 2;

/// Index of each state.
pub const ANGLE: usize = 0;
pub const SPEED: usize = 1;
pub const THIRD: usize = 2;
/// Index of each sensor's offset; its amplitude and placement follow.
pub const OFFSET: [usize; 3] = [3, 5, 8];

/// A vector over the states.
pub type Vector = [f32; STATES];

/// The upper triangle of a symmetric matrix, row by row; 264 bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance([f32; ENTRIES]);

/// Index of an entry, of either triangle.
const fn at(i: usize, j: usize) -> usize {
    let (i, j) = if i < j { (i, j) } else { (j, i) };
    i * STATES - i * (i + 1) / 2 + j
}

impl Covariance {
    /// Nothing varies.
    pub const ZERO: Self = Self([0.0; ENTRIES]);

    /// Makes it that of independent states of these variances.
    pub fn set_diagonal(&mut self, variances: &Vector) {
        self.0.fill(0.0);
        for (k, variance) in variances.iter().enumerate() {
            self.0[at(k, k)] = *variance;
        }
    }

    /// An entry.
    #[inline]
    pub const fn get(&self, i: usize, j: usize) -> f32 {
        self.0[at(i, j)]
    }

    /// Of a state with the angle between the rotor and a sensor.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn angle_from_placement(&self, sensor: usize, state: usize) -> f32 {
        let angle = self.get(ANGLE, state);
        if sensor == 0 { angle } else { angle - self.get(OFFSET[sensor] + 2, state) }
    }

    /// A row without the speed.
    #[inline]
    const fn row<const K: usize>(&self) -> [f32; STATES - 1] {
        let p = &self.0;
        [
            p[const { at(0, K) }],
            p[const { at(2, K) }],
            p[const { at(3, K) }],
            p[const { at(4, K) }],
            p[const { at(5, K) }],
            p[const { at(6, K) }],
            p[const { at(7, K) }],
            p[const { at(8, K) }],
            p[const { at(9, K) }],
            p[const { at(10, K) }],
        ]
    }

    /// Scalar products of the rows with a vector, but for the speed.
    #[inline(always)]
    fn products(&self, h: &[f32; STATES - 1]) -> Vector {
        if cfg!(feature = "small") { self.products_in_a_loop(h) } else { self.products_straight_on(h) }
    }

    /// In little code: the same sums in the same order.
    #[inline(always)]
    fn products_in_a_loop(&self, h: &[f32; STATES - 1]) -> Vector {
        let column = |j: usize| if j == 0 { ANGLE } else { j + 1 };
        core::array::from_fn(|k| h.iter().enumerate().map(|(j, h)| h * self.get(column(j), k)).sum())
    }

    /// In little time.
    #[inline(always)]
    fn products_straight_on(&self, h: &[f32; STATES - 1]) -> Vector {
        [
            product(h, &self.row::<0>()),
            product(h, &self.row::<1>()),
            product(h, &self.row::<2>()),
            product(h, &self.row::<3>()),
            product(h, &self.row::<4>()),
            product(h, &self.row::<5>()),
            product(h, &self.row::<6>()),
            product(h, &self.row::<7>()),
            product(h, &self.row::<8>()),
            product(h, &self.row::<9>()),
            product(h, &self.row::<10>()),
        ]
    }

    /// Adds to a variance, up to `largest`.
    #[cfg_attr(feature = "small", inline(never))]
    pub fn inflate(&mut self, state: usize, variance: f32, largest: f32) {
        let entry = &mut self.0[at(state, state)];
        let wider = *entry + variance;
        if wider <= largest {
            *entry = wider;
        } else if *entry < largest {
            *entry = largest;
        }
    }

    /// Makes a state independent of the others, with this variance.
    pub fn reset(&mut self, state: usize, variance: f32) {
        for k in 0..STATES {
            self.0[at(state, k)] = 0.0;
        }
        self.0[at(state, state)] = variance;
    }

    /// Prediction over `samples` periods: θ += ω in each, with process noise of variance `noise` on the speed. That
    /// friction slows the rotor is left out here, which makes no difference from sample to sample.
    #[inline]
    pub fn advance(&mut self, noise: f32, samples: f32) {
        let p = &mut self.0;
        let (cross, speed, noise) = (p[1], p[STATES], samples * noise);
        p[0] += samples * (cross + cross + samples * speed) + noise * (samples * samples * (1.0 / 3.0) - 1.0 / 12.0);
        p[1] += samples * (speed + 0.5 * noise);
        p[STATES] = speed + noise;
        for k in 2..STATES {
            p[k] += samples * p[STATES - 1 + k];
        }
    }
}

/// A sensor's signal against its prediction; relative to the calibrated amplitude.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Measured less predicted signal.
    pub innovation: f32,
    /// Variance of the signal's noise.
    pub noise: f32,
    /// Derivatives of the signal by angle (rad), amplitude and third harmonic; that by the offset is one, that by the
    /// placement the negative of `angle`.
    pub angle: f32,
    pub amplitude: f32,
    pub third: f32,
}

/// Covariance of a measurement with the states: P·hᵀ and h·P·hᵀ for the derivatives h.
#[derive(Clone, Copy, Debug)]
pub struct CrossCovariance {
    /// P·hᵀ.
    spread: Vector,
    /// h·P·hᵀ: variance of the innovation without its noise.
    pub variance: f32,
}

/// Scalar product, but for the speed.
#[inline]
fn product(h: &[f32; STATES - 1], b: &[f32; STATES - 1]) -> f32 {
    h[0] * b[0]
        + h[1] * b[1]
        + h[2] * b[2]
        + h[3] * b[3]
        + h[4] * b[4]
        + h[5] * b[5]
        + h[6] * b[6]
        + h[7] * b[7]
        + h[8] * b[8]
        + h[9] * b[9]
}

impl CrossCovariance {
    /// Of the weighted sum of three sensors' signals.
    pub fn of_all(measurements: &[Measurement; 3], weights: &[f32; 3], p: &Covariance) -> Self {
        let [a, b, c] = measurements;
        let [u, v, w] = weights;
        let (angle, third) = (u * a.angle + v * b.angle + w * c.angle, u * a.third + v * b.third + w * c.third);
        let h =
            [angle, third, *u, u * a.amplitude, *v, v * b.amplitude, -v * b.angle, *w, w * c.amplitude, -w * c.angle];
        let spread = p.products(&h);
        let [angle, _, rest @ ..] = spread;
        let [third, o0, a0, o1, a1, p1, o2, a2, p2] = rest;
        let variance = product(&h, &[angle, third, o0, a0, o1, a1, p1, o2, a2, p2]);
        Self { spread, variance }
    }
}

impl Measurement {
    /// A sensor that is not to be used: infinitely noisy.
    pub const NONE: Self = Self { innovation: 0.0, noise: f32::INFINITY, angle: 0.0, amplitude: 0.0, third: 0.0 };

    /// The covariance with the states, for this sensor.
    #[inline]
    pub fn cross(&self, sensor: usize, p: &Covariance) -> CrossCovariance {
        match sensor {
            sensor if cfg!(feature = "small") => self.cross_of_any(sensor, p),
            0 => self.cross_of::<0>(p),
            1 => self.cross_of::<1>(p),
            _ => self.cross_of::<2>(p),
        }
    }

    /// Whether the squared innovation exceeds this multiple of its variance.
    #[inline]
    pub fn is_outlier(&self, cross: &CrossCovariance, squared: f32) -> bool {
        self.innovation * self.innovation > squared * (cross.variance + self.noise)
    }

    /// Variance of the innovation, without its noise: that of the relation, for a third of the work.
    #[inline]
    pub fn variance(&self, sensor: usize, p: &Covariance) -> f32 {
        match sensor {
            sensor if cfg!(feature = "small") => self.variance_of_any(sensor, p),
            0 => self.variance_of::<0>(p),
            1 => self.variance_of::<1>(p),
            _ => self.variance_of::<2>(p),
        }
    }

    #[inline]
    fn variance_of<const SENSOR: usize>(&self, p: &Covariance) -> f32 {
        let offset = OFFSET[SENSOR];
        let (amplitude, placement) = (offset + 1, offset + 2);
        let (a, h) = (self.amplitude, self.third);
        let own = |k| p.get(offset, k) + a * p.get(amplitude, k);
        let angle = |k| if SENSOR == 0 { p.get(ANGLE, k) } else { p.get(ANGLE, k) - p.get(placement, k) };
        let angles = if SENSOR == 0 { angle(ANGLE) } else { angle(ANGLE) - angle(placement) };
        let with_angle = angle(offset) + a * angle(amplitude) + h * angle(THIRD);
        let with_third = own(THIRD);
        self.angle * (self.angle * angles + with_angle + with_angle)
            + h * (h * p.get(THIRD, THIRD) + with_third + with_third)
            + (own(offset) + a * own(amplitude))
    }

    /// Product of the derivatives with a vector.
    #[inline]
    fn dot<const SENSOR: usize>(&self, v: &Vector) -> f32 {
        let own = OFFSET[SENSOR];
        let angle = if SENSOR == 0 { v[ANGLE] } else { v[ANGLE] - v[own + 2] };
        self.angle * angle + self.third * v[THIRD] + v[own] + self.amplitude * v[own + 1]
    }

    #[inline]
    fn cross_of<const SENSOR: usize>(&self, p: &Covariance) -> CrossCovariance {
        let own = OFFSET[SENSOR];
        let mut spread = [0.0; STATES];
        for (k, b) in spread.iter_mut().enumerate() {
            let angle = if SENSOR == 0 { p.get(ANGLE, k) } else { p.get(ANGLE, k) - p.get(own + 2, k) };
            *b = self.angle * angle + self.third * p.get(THIRD, k) + p.get(own, k) + self.amplitude * p.get(own + 1, k);
        }
        CrossCovariance { variance: self.dot::<SENSOR>(&spread), spread }
    }

    /// [`Self::variance`] in little code: the same sums in the same order.
    fn variance_of_any(&self, sensor: usize, p: &Covariance) -> f32 {
        let offset = OFFSET[sensor];
        let (amplitude, placement) = (offset + 1, offset + 2);
        let (a, h) = (self.amplitude, self.third);
        let from_placement = p.angle_from_placement(sensor, ANGLE);
        let angles =
            if sensor == 0 { from_placement } else { from_placement - p.angle_from_placement(sensor, placement) };
        let with_angle = p.angle_from_placement(sensor, offset)
            + a * p.angle_from_placement(sensor, amplitude)
            + h * p.angle_from_placement(sensor, THIRD);
        let with_third = p.get(offset, THIRD) + a * p.get(amplitude, THIRD);
        self.angle * (self.angle * angles + with_angle + with_angle)
            + h * (h * p.get(THIRD, THIRD) + with_third + with_third)
            + (p.get(offset, offset)
                + a * p.get(amplitude, offset)
                + a * (p.get(offset, amplitude) + a * p.get(amplitude, amplitude)))
    }

    /// The same in little code.
    fn dot_any(&self, sensor: usize, v: &Vector) -> f32 {
        let own = OFFSET[sensor];
        let angle = if sensor == 0 { v[ANGLE] } else { v[ANGLE] - v[own + 2] };
        self.angle * angle + self.third * v[THIRD] + v[own] + self.amplitude * v[own + 1]
    }

    /// [`Self::cross`] in little code: the same sums in the same order.
    fn cross_of_any(&self, sensor: usize, p: &Covariance) -> CrossCovariance {
        let own = OFFSET[sensor];
        let mut spread = [0.0; STATES];
        for (k, b) in spread.iter_mut().enumerate() {
            let angle = p.angle_from_placement(sensor, k);
            *b = self.angle * angle + self.third * p.get(THIRD, k) + p.get(own, k) + self.amplitude * p.get(own + 1, k);
        }
        CrossCovariance { variance: self.dot_any(sensor, &spread), spread }
    }
}

impl Covariance {
    /// Update of the covariance by a measurement of this noise. The parameters are corrected by a share, 0 to 1, of
    /// what is best, and their covariance with angle and speed stays consistent (partial update; at 0, the
    /// Schmidt–Kalman filter).
    #[inline]
    fn reduce(&mut self, cross: &CrossCovariance, noise: f32, share: f32) -> f32 {
        let weight = 1.0 / (cross.variance + noise);
        self.reduce_rows(0, THIRD, weight, &cross.spread);
        if share > 0.0 {
            self.reduce_rows(THIRD, STATES, weight * share * (2.0 - share), &cross.spread);
        }
        weight
    }

    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn reduce_rows(&mut self, first: usize, end: usize, weight: f32, b: &Vector) {
        // Row by row the entries follow each other.
        let mut entry = at(first, first);
        for row in first..end {
            let gain = weight * b[row];
            for column in row..STATES {
                self.0[entry] -= gain * b[column];
                entry += 1;
            }
        }
    }

    /// Update by one measurement, whose covariance with the states is `cross`, the parameters by a share of it.
    #[inline]
    pub fn update_by(&mut self, m: &Measurement, cross: &CrossCovariance, state: &mut State, share: f32) {
        let weight = self.reduce(cross, m.noise, share);
        state.correct(weight * m.innovation, &cross.spread, share);
    }
}

/// Angle, speed and parameters as estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    pub angle: ElectricalAngle,
    pub speed: f32,
    pub third: f32,
    pub offset: [f32; 3],
    pub amplitude: [f32; 3],
    pub placement: [ElectricalAngle; 3],
}

impl State {
    /// Adds a multiple of a vector; to the parameters a share of it.
    #[inline]
    fn correct(&mut self, times: f32, by: &Vector, share: f32) {
        self.angle += radians(times * by[ANGLE]);
        self.speed += times * by[SPEED];
        if !(share > 0.0) {
            return;
        }
        let times = times * share;
        self.third += times * by[THIRD];
        for (k, own) in OFFSET.into_iter().enumerate() {
            self.offset[k] += times * by[own];
            self.amplitude[k] += times * by[own + 1];
            if k != 0 {
                self.placement[k] += radians(times * by[own + 2]);
            }
        }
    }
}

/// An angle of a few radians, to 2⁻²⁴ of itself.
#[inline]
pub fn radians(angle: f32) -> ElectricalAngle {
    const BITS: f32 = TURN / core::f32::consts::TAU;
    // Through 64 bits where it may exceed half a turn would be a software routine; corrections never do.
    ElectricalAngle::from_bits((angle * BITS) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boards with little flash take the one, all others the other.
    #[test]
    fn products_in_a_loop_are_those_straight_on() {
        let covariance = Covariance(core::array::from_fn(|k| (k as f32 + 1.0).recip() - 0.1));
        let h = core::array::from_fn(|k| 0.3 * k as f32 - 1.1);
        assert_eq!(covariance.products_in_a_loop(&h), covariance.products_straight_on(&h));
    }

    /// Boards with little flash take the one, all others the other.
    #[test]
    fn any_sensor_has_what_a_known_one_has() {
        let covariance = Covariance(core::array::from_fn(|k| (k as f32 + 1.0).recip() - 0.1));
        let m = Measurement { innovation: 0.1, noise: 0.01, angle: 0.7, amplitude: -0.4, third: 0.3 };
        for sensor in 0..3 {
            let (any, known) = (m.cross_of_any(sensor, &covariance), m.cross(sensor, &covariance));
            assert_eq!((any.spread, any.variance), (known.spread, known.variance));
            assert_eq!(m.variance_of_any(sensor, &covariance), m.variance(sensor, &covariance));
        }
    }
}
