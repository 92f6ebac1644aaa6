//! Least squares over all bins: fourteen parameters of the sensors, and the rotor's angle in each bin.
//!
//! The residual of sensor i in a bin is `eᵢ = (codeᵢ − offsetᵢ)/amplitudeᵢ − waveᵢ(θ)`. The angle of the bin is
//! eliminated: it is set where the residual has no part along the tangent `tᵢ = ∂waveᵢ/∂θ`, and what a parameter does
//! along the tangent is projected out (variable projection), so the normal equations stay 14 × 14 however many bins
//! there are.
//!
//! Of two sensors the third has neither residual nor tangent, and its parameters stay as they are. Two that are 90°
//! apart cannot tell a difference of their third harmonics from a rotor that turns unevenly twice in an electrical
//! turn, nor a fifth harmonic from one that does so four times. So, as far as the signals do not say otherwise, both
//! sensors have the same third harmonic and no fifth.

use super::{Bin, Bins};
use crate::angle::ElectricalAngle;
use crate::float::cut;
use crate::hall::model::Sensor;
use crate::hall::{Channel, Halls};
use crate::math;
use crate::trig::sin_cos_f32;
use core::f32::consts::PI;

/// Bins in a turn of the field.
pub const BINS: usize = 64;

/// Why no sensors fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFit {
    /// The first harmonic of this sensor is below four codes, while the others see a rotor that turns.
    NoSignal(Channel),
    /// None of them sees one.
    NotTurning,
    /// The iteration does not settle.
    Diverged,
}

/// Mean codes at a field angle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// Mean code of each sensor.
    pub codes: [f32; 3],
    /// The field's angle in the middle of the bin.
    pub field: ElectricalAngle,
}

/// Sensors that explain the points best.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The sensors; the first has placement zero.
    pub sensors: [Sensor; 3],
    /// What stays unexplained: RMS over sensors and bins, as a fraction of the amplitude.
    pub residual: f32,
}

/// Offset, amplitude, third and fifth harmonic of each sensor, and the placement of the second and third.
const PARAMETERS: usize = 14;
const ITERATIONS: usize = 12;
/// Smallest amplitude in ADC codes that is a signal.
const NO_SIGNAL: f32 = 4.0;
/// Smallest of a single sensor that is that of a turning rotor: a calibration refuses less in any case.
const TURNING: f32 = 20.0;
/// Sine of the angle by which the waves of two sensors differ at least where the rotor turns: they sit farther apart, and
/// from opposite each other. 20°.
const APART: f32 = 0.34;
/// Weight of what is expected of two sensors' harmonics, over the mean of the equations' diagonal.
const EXPECTED: f32 = 0.02;

/// Fits the sensors to the points of a forward and a backward sweep, and tells the rotor's Hall angle at each.
///
/// # Errors
/// [`NoFit`], by a sensor without a signal or an iteration that does not settle.
// A stack frame of its own, given back before the report.
#[inline(never)]
pub(super) fn fit(bins: &Bins, halls: Halls, angles: &mut [[ElectricalAngle; BINS]; 2]) -> Result<Fit, NoFit> {
    let mut sensors = [Sensor::ABSENT; 3];
    start(bins, halls, &mut sensors)?;
    // The Hall angle is zero where the first sensor's fundamental rises through its offset.
    let zero = sensors[0].placement;
    for sensor in sensors.iter_mut().take(halls.count()) {
        sensor.placement -= zero;
    }
    for (angle, point) in angles.as_flattened_mut().iter_mut().zip(points(bins)) {
        *angle = point.field - zero;
    }
    for _ in 0..ITERATIONS {
        let mut equations = Equations::ZERO;
        for (point, angle) in points(bins).zip(angles.as_flattened_mut().iter_mut()) {
            *angle = nearest(&sensors, &point.codes, *angle);
            equations.add(&sensors, &point.codes, *angle);
        }
        if halls == Halls::Two {
            equations.expect_alike(&sensors);
        }
        equations.solve().ok_or(NoFit::Diverged)?;
        apply(&mut sensors, &equations.vector);
    }
    let mut square = 0.0;
    for (point, angle) in points(bins).zip(angles.as_flattened_mut().iter_mut()) {
        *angle = nearest(&sensors, &point.codes, *angle);
        square += residuals(&sensors, &point.codes, *angle).iter().map(|e| e * e).sum::<f32>();
    }
    let residual = crate::float::root(square / (2 * halls.count() * BINS) as f32);
    if !residual.is_finite() {
        return Err(NoFit::Diverged);
    }
    sensors.iter_mut().for_each(unaverage);
    Ok(Fit { sensors, residual })
}

/// All of both sweeps. Made anew each time, which takes less time than a small stack has room.
fn points(bins: &Bins) -> impl Iterator<Item = Point> {
    sweep(bins.as_flattened())
}

/// Those of a sweep, or of more than one.
pub(super) fn sweep(bins: &[Bin]) -> impl Iterator<Item = Point> {
    bins.iter().enumerate().map(|(k, bin)| point(k as u32, bin))
}

/// The `k`-th; the next sweep begins after so many bins as there are in a turn.
#[inline(never)]
fn point(k: u32, &[a, b, c, count]: &Bin) -> Point {
    Point {
        codes: [a, b, c].map(|sum| sum as f32 / count as f32),
        field: ElectricalAngle::from_bits(((2 * k + 1) << (31 - BINS.ilog2())) as i32),
    }
}

/// First harmonic over the field's angle, of the first sweep.
fn start(bins: &Bins, halls: Halls, sensors: &mut [Sensor; 3]) -> Result<(), NoFit> {
    let mut weak = None;
    for (channel, sensor) in sensors.iter_mut().enumerate().take(halls.count()) {
        let (mut mean, mut sine, mut cosine) = (0.0, 0.0, 0.0);
        for point in sweep(&bins[0]) {
            let (code, (sin, cos)) = (point.codes[channel], sin_cos_f32(point.field));
            mean += code / BINS as f32;
            sine += code * sin * 2.0 / BINS as f32;
            cosine += code * cos * 2.0 / BINS as f32;
        }
        let amplitude = crate::float::root(sine * sine + cosine * cosine);
        if !(amplitude >= NO_SIGNAL) {
            weak = Some(Channel(channel as u8));
        }
        let placement = ElectricalAngle::from_radians(-crate::float::atan2(cosine, sine));
        *sensor = Sensor::sinusoidal(mean, amplitude, placement);
    }
    match weak {
        None => Ok(()),
        Some(channel) if turns(sensors) => Err(NoFit::NoSignal(channel)),
        Some(_) => Err(NoFit::NotTurning),
    }
}

/// Whether the sensors that have a signal see a rotor that turns. Of one that rocks about a place, they all see the same
/// motion, and their waves over the field's angle are alike or opposite; which of them sees nothing of it is chance.
fn turns(sensors: &[Sensor; 3]) -> bool {
    let mut strong = sensors.iter().filter(|sensor| sensor.amplitude >= NO_SIGNAL);
    match (strong.next(), strong.next()) {
        (Some(one), Some(other)) => sin_cos_f32(one.placement - other.placement).0.abs() >= APART,
        (Some(only), None) => only.amplitude >= TURNING,
        _ => false,
    }
}

/// Of each sensor, and 0 of one that is not there.
fn of_present(sensors: &[Sensor; 3], value: impl Fn(usize, &Sensor) -> f32) -> [f32; 3] {
    core::array::from_fn(|k| if sensors[k].amplitude > 0.0 { value(k, &sensors[k]) } else { 0.0 })
}

fn residuals(sensors: &[Sensor; 3], codes: &[f32; 3], angle: ElectricalAngle) -> [f32; 3] {
    of_present(sensors, |k, sensor| (codes[k] - sensor.offset) / sensor.amplitude - sensor.wave(angle))
}

fn slopes(sensors: &[Sensor; 3], angle: ElectricalAngle) -> [f32; 3] {
    of_present(sensors, |_, sensor| sensor.slope(angle))
}

/// The angle nearest to three codes, by Newton's method from a good guess.
fn nearest(sensors: &[Sensor; 3], codes: &[f32; 3], guess: ElectricalAngle) -> ElectricalAngle {
    let mut angle = guess;
    for _ in 0..3 {
        let e = residuals(sensors, codes, angle);
        let t = slopes(sensors, angle);
        let (along, length) = (dot(&t, &e), dot(&t, &t));
        // A step of more than half a radian leaves the quadratic neighbourhood.
        angle += ElectricalAngle::from_radians(cut(along / length, 0.5));
    }
    angle
}

fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Normal equations `matrix · step = vector`, lower triangle.
struct Equations {
    matrix: [f32; math::triangle(PARAMETERS)],
    vector: [f32; PARAMETERS],
}

/// Which sensor a parameter belongs to.
fn sensor_of(parameter: usize) -> usize {
    if parameter < 12 { parameter / 4 } else { parameter - 11 }
}

impl Equations {
    // A constant, whose parts the compiler does not make elsewhere first.
    const ZERO: Self = Self { matrix: [0.0; math::triangle(PARAMETERS)], vector: [0.0; PARAMETERS] };

    fn add(&mut self, sensors: &[Sensor; 3], codes: &[f32; 3], angle: ElectricalAngle) {
        let e = residuals(sensors, codes, angle);
        let t = slopes(sensors, angle);
        let (along, length) = (dot(&t, &e), dot(&t, &t));
        let derivatives = derivatives(sensors, angle, &t);
        // Row by row the entries follow each other.
        let mut entries = self.matrix.iter_mut();
        for (row, d) in derivatives.iter().enumerate() {
            let own = sensor_of(row);
            self.vector[row] += d * (e[own] - t[own] * along / length);
            for (column, (other_d, entry)) in derivatives.iter().take(row + 1).zip(entries.by_ref()).enumerate() {
                let other = sensor_of(column);
                let same = if own == other { 1.0 } else { 0.0 };
                *entry += d * other_d * (same - t[own] * t[other] / length);
            }
        }
    }

    /// The difference of two sensors' third harmonics and both fifth ones count as measured to be zero, with a weight
    /// well below that of what the signals do say.
    fn expect_alike(&mut self, [first, second, _]: &[Sensor; 3]) {
        let weight = EXPECTED * self.mean();
        let difference = first.third - second.third;
        for (harmonic, excess) in [(2, difference), (6, -difference), (3, first.fifth), (7, second.fifth)] {
            self.matrix[math::lower(harmonic, harmonic)] += weight;
            self.vector[harmonic] -= weight * excess;
        }
        self.matrix[math::lower(6, 2)] -= weight;
    }

    fn mean(&self) -> f32 {
        (0..PARAMETERS).map(|k| self.matrix[math::lower(k, k)]).sum::<f32>() / PARAMETERS as f32
    }

    /// Leaves the solution in `vector`; `None` when the matrix is not positive definite.
    fn solve(&mut self) -> Option<()> {
        let mean = self.mean();
        for k in 0..PARAMETERS {
            // Weight of the guess "no change" where the data say nothing, far below what they say elsewhere.
            self.matrix[math::lower(k, k)] += 1e-5 * mean;
        }
        math::solve(&mut self.matrix, &mut self.vector, PARAMETERS, 0.0)
    }
}

/// What each parameter does to its sensor's model: offset and amplitude relative to the amplitude, harmonics,
/// placement.
fn derivatives(sensors: &[Sensor; 3], angle: ElectricalAngle, t: &[f32; 3]) -> [f32; PARAMETERS] {
    let mut all = [0.0; PARAMETERS];
    let (of_sensors, _) = all.as_chunks_mut();
    for (sensor, own) in sensors.iter().zip(of_sensors).filter(|(sensor, _)| sensor.amplitude > 0.0) {
        let [_, third, fifth] = sensor.harmonics(angle);
        *own = [1.0, sensor.wave(angle), third, fifth];
    }
    all[12] = -t[1];
    all[13] = -t[2];
    all
}

fn apply(sensors: &mut [Sensor; 3], step: &[f32; PARAMETERS]) {
    let (of_sensors, _) = step.as_chunks();
    for (channel, (sensor, &[offset, amplitude, third, fifth])) in sensors.iter_mut().zip(of_sensors).enumerate() {
        sensor.offset += offset * sensor.amplitude;
        sensor.amplitude *= 1.0 + cut(amplitude, 0.5);
        sensor.third += third;
        sensor.fifth += fifth;
        if channel > 0 {
            sensor.placement += ElectricalAngle::from_radians(cut(step[11 + channel], 0.5));
        }
    }
}

/// Undoes the averaging over a bin, which shrinks the k-th harmonic by `sin(kπ/BINS)/(kπ/BINS)`.
fn unaverage(sensor: &mut Sensor) {
    let shrunk = |k: f32| {
        // Of the sine's series, what is left out is below 10⁻⁷.
        let square = k * PI / BINS as f32 * (k * PI / BINS as f32);
        1.0 - square / 6.0 * (1.0 - square / 20.0)
    };
    sensor.amplitude /= shrunk(1.0);
    sensor.third = sensor.third * shrunk(1.0) / shrunk(3.0);
    sensor.fifth = sensor.fifth * shrunk(1.0) / shrunk(5.0);
}
