//! The error curve of one head from one turn at roughly constant speed, section IV.B of the paper.
//!
//! At constant speed the reading is a straight line against time but for the error that recurs with every pole pair.
//! The paper subtracts a polynomial trend, cuts the rest into pole pairs, resamples these to equal length and averages
//! them without the outliers. Here every step runs along with the samples:
//!
//! 1. Cut and resample: the times at which the reading passes the 32 nodes of the pole pair, each interpolated between
//!    the means of the samples on either side, which averages their noise.
//! 2. Detrend: the parabola through the times at which this pole pair and the one before it began and this one ended.
//!    These are exactly one pole pair apart whatever the error curve is, so the parabola follows a speed that changes
//!    without taking part of the curve for it, as a fit to all samples would. What cancels over the turn, because it
//!    differs from pole pair to pole pair, is left to the average: unequal pole pairs, eccentricity, faster ripple.
//! 3. Average: eq. (30), see [`Run::average`].
//!
//! Sampling must be at equal intervals; their length does not matter.

use super::error::Error;
use crate::vernier::correct::{NODES, round};

/// Distance of nodes in 2⁻¹⁶ pole pairs.
const NODE: i32 = 1 << 16 >> NODES.ilog2();

/// Fewer samples to a pole pair leave nodes without any of their own.
pub const FEWEST_SAMPLES: u32 = NODES as u32;

/// Least similarity, eq. (30), in percent, of a pole pair that takes part in the average: twice as far from it as it is
/// large. Less unlike ones do more good than harm, because ripple cancels over a whole turn.
const SIMILARITY: f32 = -100.0;

/// Eq. (30) divides by the size of the curve, and a perfect head has none: a curve counts as at least this large, RMS,
/// in pole pairs (1.4° electrical).
const SMALLEST_CURVE: f32 = 1.0 / 256.0;

/// Where the reading was at a time: samples since the begin of the pole pair, 2⁻¹⁶ pole pairs since its begin.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    time: f32,
    position: f32,
}

/// The mean of samples.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    count: u32,
    time: u64,
    position: i64,
}

/// The average curve of a turn.
#[derive(Clone, Debug)]
pub struct Average {
    /// What the head reads too much at the nodes, in pole pairs, mean removed.
    pub errors: [f32; NODES],
    /// Which pole pairs it was made of, in the order they were passed.
    pub kept: [bool; 64],
    /// How many.
    pub similar: u8,
}

/// One head's turn, sample by sample.
#[derive(Clone, Debug)]
pub struct Run {
    pole_pairs: u8,
    started: bool,
    /// +1 or −1 once known. Readings that fall are mirrored, so that everything below sees them rise.
    direction: i32,
    last: u16,
    /// Samples and 2⁻¹⁶ pole pairs since the begin of the present pole pair.
    time: u32,
    position: i32,
    /// The samples since the last node passed, and the mean of those before it.
    node: i32,
    mean: Mean,
    previous: Option<Point>,
    /// Times of the nodes of the present pole pair; the number of those known.
    times: [f32; NODES + 1],
    known: usize,
    /// When the present pole pair began and the one before it, if they were seen from their begin.
    begins: [Option<f32>; 2],
    /// What is left of each pole pair's readings after the trend, in 2⁻¹⁶ pole pairs.
    curves: [[i16; NODES]; 64],
    collected: u8,
}

impl Run {
    /// For a ring of the given number of pole pairs.
    pub fn new(pole_pairs: u8) -> Self {
        Self {
            pole_pairs,
            started: false,
            direction: 0,
            last: 0,
            time: 0,
            position: 0,
            node: 0,
            mean: Mean::default(),
            previous: None,
            times: [0.0; NODES + 1],
            known: 0,
            begins: [None; 2],
            curves: [[0; NODES]; 64],
            collected: 0,
        }
    }

    /// Takes a reading; true when the turn is complete.
    ///
    /// # Errors
    /// The shaft turns too fast or has turned back.
    pub fn push(&mut self, reading: u16) -> Result<bool, Error> {
        let step = i32::from(reading.wrapping_sub(self.last) as i16);
        self.last = reading;
        if !self.started {
            self.started = true;
            return Ok(false);
        }
        if step.abs() > (1 << 14) {
            return Err(Error::TooFast);
        }
        if self.direction == 0 {
            self.find_direction(step, reading);
            return Ok(false);
        }
        self.time += 1;
        self.position += step * self.direction;
        let node = self.position.div_euclid(NODE);
        if node > self.node {
            self.pass_nodes()?;
            // Positions count from the begin of a pole pair that may have begun just now.
            self.node = self.position.div_euclid(NODE);
        } else if node < self.node - NODES as i32 / 4 {
            return Err(Error::Reversed);
        }
        self.mean.count += 1;
        self.mean.time += u64::from(self.time);
        self.mean.position += i64::from(self.position);
        Ok(self.collected == self.pole_pairs)
    }

    /// Pole pairs still to come.
    pub fn missing(&self) -> u8 {
        self.pole_pairs - self.collected
    }

    /// Decides on the direction after an eighth of a pole pair.
    fn find_direction(&mut self, step: i32, reading: u16) {
        self.position += step;
        if self.position.abs() < 1 << 13 {
            return;
        }
        self.direction = self.position.signum();
        let rising = if self.direction > 0 { reading } else { reading.wrapping_neg() };
        self.position = i32::from(rising);
        self.node = self.position / NODE;
        // The rest of this pole pair leads to the first begin of one.
        self.known = NODES;
    }

    /// Closes the mean and notes the times of the nodes between it and the one before.
    fn pass_nodes(&mut self) -> Result<(), Error> {
        let count = self.mean.count as f32;
        let mut point = Point { time: self.mean.time as f32 / count, position: self.mean.position as f32 / count };
        let samples = core::mem::take(&mut self.mean).count;
        if samples == 0 {
            return Ok(());
        }
        while let Some(previous) = self.previous {
            let position = (self.known as i32 * NODE) as f32;
            if position > point.position || point.position <= previous.position {
                break;
            }
            let share = (position - previous.position) / (point.position - previous.position);
            let time = previous.time + share * (point.time - previous.time);
            self.times[self.known] = time;
            self.known += 1;
            if self.known > NODES {
                point = self.pass_pole_pair(time, point)?;
            }
        }
        self.previous = Some(point);
        Ok(())
    }

    /// Ends a pole pair: keeps its curve and lets time and position count from the begin of the next.
    fn pass_pole_pair(&mut self, end: f32, point: Point) -> Result<Point, Error> {
        if let [Some(begin), Some(before)] = self.begins
            && self.collected < self.pole_pairs
        {
            if end - begin < FEWEST_SAMPLES as f32 {
                return Err(Error::TooFast);
            }
            self.curves[usize::from(self.collected)] = detrend(&self.times, [before, begin, end]);
            self.collected += 1;
        }
        let whole = end as u32;
        let shift = |point: Point| Point { time: point.time - whole as f32, position: point.position - 65536.0 };
        self.begins = [Some(end), self.begins[0]].map(|begin| begin.map(|time| time - whole as f32));
        self.times[0] = end - whole as f32;
        self.known = 1;
        self.time -= whole;
        self.position -= 1 << 16;
        self.previous = self.previous.map(shift);
        Ok(shift(point))
    }

    /// The average of the curves that are alike.
    ///
    /// Similarity after eq. (30): 100 (1 − ‖fᵢ − f̄‖ / ‖f̄ − mean f̄‖) percent. The print has the fraction bar under
    /// 1 − ‖…‖ and a bar too many under it, which would divide by zero; this is the normalised root mean square error
    /// as a fit in percent, which its terms belong to. Pole pairs less similar than −100 % to the average of those left
    /// are omitted, until none is.
    ///
    /// # Errors
    /// Fewer than three quarters are left.
    pub fn average(&self) -> Result<Average, Error> {
        let curves = &self.curves[..usize::from(self.collected)];
        let mut kept = [false; 64];
        kept[..curves.len()].fill(true);
        loop {
            let similar = kept.iter().filter(|&&kept| kept).count();
            if similar * 4 < curves.len() * 3 || similar == 0 {
                return Err(Error::Unsteady { kept: similar as u8, of: self.collected });
            }
            let curve = mean_curve(curves.iter().zip(kept).filter(|(_, kept)| *kept).map(|(curve, _)| curve));
            let size = norm(curve.iter().copied()).max(SMALLEST_CURVE * crate::float::root(NODES as f32));
            let similarity = |other: &[i16; NODES]| {
                let distance = norm(other.iter().zip(curve).map(|(&value, mean)| in_pole_pairs(value) - mean));
                100.0 * (1.0 - distance / size)
            };
            for (kept, curve) in kept.iter_mut().zip(curves) {
                *kept &= similarity(curve) >= SIMILARITY;
            }
            if kept.iter().filter(|&&kept| kept).count() == similar {
                return Ok(Average { errors: self.unmirrored(curve), kept, similar: similar as u8 });
            }
        }
    }

    /// What is left of each pole pair's readings after the trend, in pole pairs, in the order they were passed.
    pub fn curves(&self) -> impl Iterator<Item = [f32; NODES]> {
        self.curves[..usize::from(self.collected)].iter().map(|curve| self.unmirrored(curve.map(in_pole_pairs)))
    }

    /// A curve of readings that fell was taken from −reading.
    fn unmirrored(&self, curve: [f32; NODES]) -> [f32; NODES] {
        if self.direction < 0 { core::array::from_fn(|node| -curve[(NODES - node) % NODES]) } else { curve }
    }
}

/// Reading minus trend at the nodes, without its mean, in 2⁻¹⁶ pole pairs.
fn detrend(times: &[f32; NODES + 1], begins: [f32; 3]) -> [i16; NODES] {
    // Through (−h₀, −1), (0, 0), (h₁, 1).
    let [before, now] = [begins[1] - begins[0], begins[2] - begins[1]];
    let curvature = (1.0 / now - 1.0 / before) / (now + before);
    let slope = 1.0 / now - curvature * now;
    let rest: [f32; NODES] = core::array::from_fn(|node| {
        let time = times[node] - begins[1];
        node as f32 / NODES as f32 - time * (slope + curvature * time)
    });
    let mean = rest.iter().sum::<f32>() / NODES as f32;
    rest.map(|value| round((value - mean) * 65536.0))
}

fn mean_curve<'a>(curves: impl Iterator<Item = &'a [i16; NODES]>) -> [f32; NODES] {
    let mut sum = [0.0; NODES];
    let mut count = 0.0;
    for curve in curves {
        for (sum, &value) in sum.iter_mut().zip(curve) {
            *sum += in_pole_pairs(value);
        }
        count += 1.0;
    }
    sum.map(|sum| sum / count)
}

fn in_pole_pairs(value: i16) -> f32 {
    f32::from(value) / 65536.0
}

fn norm(values: impl Iterator<Item = f32>) -> f32 {
    crate::float::root(values.map(|value| value * value).sum())
}
