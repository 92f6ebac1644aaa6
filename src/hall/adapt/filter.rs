//! The extended Kalman filter itself: eleven states and their joint covariance.
//!
//! States, in this order: θ (Hall angle, rad), ω (rad a sample), h (third harmonic beyond the calibrated one, the same
//! for all sensors), and for every sensor its offset and amplitude, relative to the calibrated amplitude, and, but for the
//! first, its placement ψ (rad). The angles themselves are kept as wrapping integers.
//!
//! A sample brings three scalar measurements. They are worked in one after the other, each with the covariance that
//! the one before has left, so nothing is inverted; all share the derivatives at the predicted angle, so the 66
//! entries of the covariance are read and written once a sample and not three times.

use crate::angle::ElectricalAngle;

/// Number of states.
pub const STATES: usize = 11;
/// Entries of the covariance on and above its diagonal.
const ENTRIES: usize = STATES * (STATES + 1) / 2;

/// Where a state stands.
pub const ANGLE: usize = 0;
pub const SPEED: usize = 1;
pub const THIRD: usize = 2;
/// The offset of each sensor; its amplitude and placement follow.
pub const OFFSET: [usize; 3] = [3, 5, 8];

/// A vector over the states.
pub type Vector = [f32; STATES];

/// The upper triangle of a symmetric matrix, row by row; 264 bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance([f32; ENTRIES]);

/// Where an entry is kept, whichever triangle it is of.
const fn at(i: usize, j: usize) -> usize {
    let (i, j) = if i < j { (i, j) } else { (j, i) };
    i * STATES - i * (i + 1) / 2 + j
}

impl Covariance {
    /// Independent states of these variances.
    pub fn diagonal(variances: &Vector) -> Self {
        let mut entries = [0.0; ENTRIES];
        for (k, variance) in variances.iter().enumerate() {
            entries[at(k, k)] = *variance;
        }
        Self(entries)
    }

    /// An entry.
    #[inline(always)]
    pub const fn get(&self, i: usize, j: usize) -> f32 {
        self.0[at(i, j)]
    }

    /// Adds to a variance, but not beyond `largest`.
    pub fn widen(&mut self, state: usize, variance: f32, largest: f32) {
        let entry = &mut self.0[at(state, state)];
        *entry = (*entry + variance).min(largest).max(*entry);
    }

    /// Forgets what is known of a state, but for this variance.
    pub fn forget(&mut self, state: usize, variance: f32) {
        for k in 0..STATES {
            self.0[at(state, k)] = 0.0;
        }
        self.0[at(state, state)] = variance;
    }

    /// A sample period passes: θ += ω, with a random change of the speed of variance `noise` meanwhile. That the speed
    /// decays is left out, which makes no difference from sample to sample.
    #[inline(always)]
    pub fn advance(&mut self, noise: f32) {
        let p = &mut self.0;
        let (cross, speed) = (p[1], p[STATES] + noise);
        p[0] += cross + cross + p[STATES] + 0.25 * noise;
        p[1] += speed - 0.5 * noise;
        p[STATES] = speed;
        for k in 2..STATES {
            p[k] += p[STATES - 1 + k];
        }
    }
}

/// What a sensor's code tells, at the predicted state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measurement {
    /// Measured less predicted signal.
    pub innovation: f32,
    /// Variance of the signal's noise.
    pub noise: f32,
    /// Derivatives of the signal; that by the offset is one, that by the placement the negative of `angle`.
    pub angle: f32,
    pub amplitude: f32,
    pub third: f32,
}

impl Measurement {
    /// Product of the derivatives with a vector.
    #[inline(always)]
    fn dot<const SENSOR: usize>(&self, v: &Vector) -> f32 {
        let own = OFFSET[SENSOR];
        let angle = if SENSOR == 0 { v[ANGLE] } else { v[ANGLE] - v[own + 2] };
        self.angle * angle + self.third * v[THIRD] + v[own] + self.amplitude * v[own + 1]
    }

    /// Product of the covariance with the derivatives.
    #[inline(always)]
    fn spread<const SENSOR: usize>(&self, p: &Covariance) -> Vector {
        let own = OFFSET[SENSOR];
        let mut b = [0.0; STATES];
        for (k, b) in b.iter_mut().enumerate() {
            let angle = if SENSOR == 0 { p.get(ANGLE, k) } else { p.get(ANGLE, k) - p.get(own + 2, k) };
            *b = self.angle * angle + self.third * p.get(THIRD, k) + p.get(own, k) + self.amplitude * p.get(own + 1, k);
        }
        b
    }
}

impl Measurement {
    /// Of a sensor that is not to be used: infinitely noisy.
    pub fn discard(&mut self) {
        self.innovation = 0.0;
        self.noise = 1e12;
    }
}

/// Three measurements with what they mean for the covariance.
pub struct Sample<'a> {
    pub measurements: &'a [Measurement; 3],
    /// Covariance times derivatives.
    spreads: [Vector; 3],
    /// Of the innovations, without their noise.
    pub variances: [f32; 3],
}

impl<'a> Sample<'a> {
    /// Prepares for [`Covariance::update`].
    #[inline(always)]
    pub fn new(m: &'a [Measurement; 3], p: &Covariance) -> Self {
        let spreads = [m[0].spread::<0>(p), m[1].spread::<1>(p), m[2].spread::<2>(p)];
        let variances = [m[0].dot::<0>(&spreads[0]), m[1].dot::<1>(&spreads[1]), m[2].dot::<2>(&spreads[2])];
        Self { measurements: m, spreads, variances }
    }

    /// Whether a measurement is farther from its prediction than the square root of so many variances.
    #[inline(always)]
    pub fn is_outlier(&self, sensor: usize, squared: f32) -> bool {
        let m = &self.measurements[sensor];
        m.innovation * m.innovation > squared * (self.variances[sensor] + m.noise)
    }
}

impl Covariance {
    /// Works in a sample. Without `learn`, only angle and speed follow, and what is known of them together with the
    /// parameters stays consistent (a Schmidt filter).
    #[inline(always)]
    pub fn update(&mut self, sample: Sample, state: &mut State, learn: bool) {
        let Sample { measurements: m, spreads: [b0, mut b1, mut b2], variances } = sample;
        let (c01, c02, c12) = (m[1].dot::<1>(&b0), m[2].dot::<2>(&b0), m[2].dot::<2>(&b1));
        let w0 = 1.0 / (variances[0] + m[0].noise);
        let i0 = w0 * m[0].innovation;
        let (l01, l02) = (w0 * c01, w0 * c02);
        let w1 = 1.0 / (variances[1] - l01 * c01 + m[1].noise);
        let i1 = w1 * (m[1].innovation - c01 * i0);
        let c12 = c12 - l01 * c02;
        let l12 = w1 * c12;
        let w2 = 1.0 / (variances[2] - l02 * c02 - l12 * c12 + m[2].noise);
        let i2 = w2 * (m[2].innovation - c02 * i0 - c12 * i1);
        let mut correction = [0.0; STATES];
        for k in 0..STATES {
            b1[k] -= l01 * b0[k];
            b2[k] -= l02 * b0[k] + l12 * b1[k];
            correction[k] = i0 * b0[k] + i1 * b1[k] + i2 * b2[k];
        }
        state.correct(&correction, learn);
        self.shrink([w0, w1, w2], [&b0, &b1, &b2], learn);
    }

    /// Subtracts Σ w·b·bᵀ; without learning only from the rows of angle and speed.
    #[inline(always)]
    fn shrink(&mut self, w: [f32; 3], b: [&Vector; 3], learn: bool) {
        self.shrink_rows::<0, 2>(w, b);
        if learn {
            self.shrink_rows::<2, 5>(w, b);
            self.shrink_rows::<7, 4>(w, b);
        }
    }

    /// Several rows at once, so that a column's b are loaded once for them.
    #[inline(always)]
    fn shrink_rows<const FIRST: usize, const ROWS: usize>(&mut self, w: [f32; 3], b: [&Vector; 3]) {
        let mut k = [[0.0; 3]; ROWS];
        for (row, k) in k.iter_mut().enumerate() {
            *k = [w[0] * b[0][FIRST + row], w[1] * b[1][FIRST + row], w[2] * b[2][FIRST + row]];
        }
        for column in FIRST..STATES {
            let [b0, b1, b2] = [b[0][column], b[1][column], b[2][column]];
            for (row, k) in k.iter().enumerate() {
                if FIRST + row <= column {
                    self.0[at(FIRST + row, column)] -= k[0] * b0 + k[1] * b1 + k[2] * b2;
                }
            }
        }
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
    /// Moves by a vector, or only angle and speed.
    #[inline(always)]
    fn correct(&mut self, by: &Vector, learn: bool) {
        self.angle += radians(by[ANGLE]);
        self.speed += by[SPEED];
        if !learn {
            return;
        }
        self.third += by[THIRD];
        for (k, own) in OFFSET.into_iter().enumerate() {
            self.offset[k] += by[own];
            self.amplitude[k] += by[own + 1];
            if k != 0 {
                self.placement[k] += radians(by[own + 2]);
            }
        }
    }
}

/// An angle of a few radians, to 2⁻²⁴ of itself.
#[inline(always)]
pub fn radians(angle: f32) -> ElectricalAngle {
    const BITS: f32 = 4_294_967_296.0 / core::f32::consts::TAU;
    // Through 64 bits where it may exceed half a turn would be a software routine; corrections never do.
    ElectricalAngle::from_bits((angle * BITS) as i32)
}
