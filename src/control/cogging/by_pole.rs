//! What of the cogging differs from pole to pole: a magnet that is stronger than the others passes every tooth in a
//! turn, and so makes a torque that repeats with the teeth and not with the poles.
//!
//! The orders of the mechanical turn that are multiples of the pole pairs are the [table](super::Table)'s over the
//! electrical turn. Of the others a few stand out of the noise; these [`Waves`] are what is stored, and a table over the
//! whole turn is made of them.

mod find;
mod taken;
#[cfg(test)]
mod tests;

use crate::angle::{ElectricalAngle, PolePairs, Position};
use crate::trig;
use crate::turn::{Layout, POINTS, Table};
use core::f32::consts::PI;
pub use find::{Finder, Verdict};
use heapless::Vec;
pub use taken::Taken;

/// Most orders.
pub const WAVES: usize = 16;
/// Points of the table in a period of the highest order, at least.
const POINTS_IN_A_PERIOD: usize = 4;
/// Lower orders are a load's, or the shaft's, and so slow that the speed control has no need of this.
const LEAST_ORDER: usize = 3;
/// An order stands out whose amplitude is so many times that of half the difference between both directions, as a rule …
const STANDS_OUT: f32 = 4.5;
/// … and so many times that of its own.
const ALIKE: f32 = 2.0;

/// A current along q of one order of the mechanical turn, in 2⁻¹⁵ of the full scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wave {
    /// Periods in a mechanical turn, 1 to 255.
    pub order: u8,
    /// Amplitude of the sine of the angle from the begin.
    pub sine: i16,
    /// Amplitude of the cosine.
    pub cosine: i16,
}

impl Wave {
    const NONE: Self = Self { order: 0, sine: 0, cosine: 0 };

    /// `None` where it is beyond the full scale.
    fn of(order: usize, parts: [f32; 2]) -> Option<Self> {
        let [sine, cosine] = parts.map(libm::roundf);
        let fits = sine.abs().max(cosine.abs()) <= f32::from(i16::MAX);
        fits.then_some(Self { order: order as u8, sine: sine as i16, cosine: cosine as i16 })
    }
}

/// The current that compensates it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Waves(Vec<Wave, WAVES>);

impl Waves {
    /// None: the cogging is alike at all poles.
    pub const NONE: Self = Self(Vec::new());

    /// Of so many orders, [`WAVES`] at most.
    pub fn of(waves: impl IntoIterator<Item = Wave>) -> Self {
        let mut all = Self::NONE;
        for wave in waves {
            let _ = all.0.push(wave);
        }
        all
    }

    /// Each of them.
    pub fn iter(&self) -> impl Iterator<Item = &Wave> {
        self.0.iter()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The same for a drive that counts the other way: both the angle and the current change their signs.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self::of(self.iter().map(|wave| Wave { cosine: wave.cosine.saturating_neg(), ..*wave }))
    }

    /// The same where the current's full scale is another, so many times smaller. `None` where a current is beyond it.
    pub fn scaled(&self, ratio: f32) -> Option<Self> {
        let mut all = Self::NONE;
        for wave in self.iter() {
            let parts = [wave.sine, wave.cosine].map(|part| ratio * f32::from(part));
            let _ = all.0.push(Wave::of(wave.order.into(), parts)?);
        }
        Some(all)
    }

    /// Root of the mean square of the current.
    pub fn rms(&self) -> f32 {
        let squares = self.iter().map(|wave| square([wave.sine, wave.cosine].map(f32::from)));
        crate::float::root(squares.fold(0.0, |sum, square| sum + square) / 2.0)
    }

    /// As a table, if there are any. Orders that it has too few points for are left out.
    #[inline(never)]
    pub fn table(&self, pole_pairs: PolePairs) -> Option<Table> {
        if self.is_empty() {
            return None;
        }
        let mut table = Table { layout: Layout::new(pole_pairs), ..Table::ZERO };
        let count = table.layout.points();
        let mut values = [0.0_f32; POINTS];
        for wave in self.iter().filter(|wave| usize::from(wave.order) * POINTS_IN_A_PERIOD <= count) {
            // Straight lines between the points make a wave smaller by this.
            let sinc = sinc(PI * f32::from(wave.order) / count as f32);
            let (sine, cosine) = (f32::from(wave.sine) / (sinc * sinc), f32::from(wave.cosine) / (sinc * sinc));
            for (value, (sin, cos)) in values.iter_mut().zip(turn(wave.order.into(), count)) {
                *value += sine * sin + cosine * cos;
            }
        }
        for (point, value) in table.points.iter_mut().zip(values) {
            *point = libm::roundf(value) as i16;
        }
        Some(table)
    }
}

/// Sine and cosine of an order at each of so many points of the turn.
fn turn(order: usize, points: usize) -> impl Iterator<Item = (f32, f32)> {
    let turns = move |point: usize| (order * point % points) as f32 / points as f32;
    (0..points).map(move |point| trig::sin_cos_f32(ElectricalAngle::from_turns(turns(point))))
}

/// sin x / x for up to an eighth of a turn, to 5e-5.
fn sinc(x: f32) -> f32 {
    let square = x * x;
    1.0 - square / 6.0 * (1.0 - square / 20.0)
}

/// Learns it from positions and currents: 6 KiB.
#[derive(Clone, Debug)]
pub struct Learner {
    layout: Layout,
    /// Of each point, backward and forward.
    sums: [[f32; POINTS]; 2],
    counts: [[u16; POINTS]; 2],
}

impl Learner {
    /// Memory for one.
    pub const NONE: Self =
        Self { layout: Layout::new(PolePairs::ONE), sums: [[0.0; POINTS]; 2], counts: [[0; POINTS]; 2] };

    /// Begins anew, for so many pole pairs.
    pub fn begin(&mut self, pole_pairs: PolePairs) {
        self.layout = Layout::new(pole_pairs);
        self.sums.as_flattened_mut().fill(0.0);
        self.counts.as_flattened_mut().fill(0);
    }

    /// Takes the whole current that turning takes at a position, forward or backward.
    pub fn push(&mut self, forward: bool, position: Position, current: f32) {
        let (before, after, share) = self.layout.place(position);
        let (way, point) = (usize::from(forward), if share < 1 << 15 { before } else { after });
        if let Some(more) = self.counts[way][point].checked_add(1) {
            self.counts[way][point] = more;
            self.sums[way][point] += current;
        }
    }

    /// The orders that stand out, alike in both directions. Friction, of either sign, is in none of them. `None` while a
    /// point lacks samples in a direction. It takes some million instructions.
    #[inline(never)]
    pub fn waves(&self) -> Option<Waves> {
        let points = self.layout.points();
        let mut means = [[0.0_f32; POINTS]; 2];
        for ((means, sums), counts) in means.iter_mut().zip(&self.sums).zip(&self.counts) {
            for ((mean, sum), &count) in means.iter_mut().zip(sums).zip(counts.iter().take(points)) {
                if count == 0 {
                    return None;
                }
                *mean = sum / f32::from(count);
            }
        }
        let [backward, forward] = &means;
        self.strongest(backward.get(..points)?, forward.get(..points)?)
    }

    fn strongest(&self, backward: &[f32], forward: &[f32]) -> Option<Waves> {
        let most = (forward.len() / POINTS_IN_A_PERIOD).min(u8::MAX.into());
        let mut found: Vec<(f32, Wave), WAVES> = Vec::new();
        let (mut noise, mut orders) = (0.0, 0.0_f32);
        for order in (LEAST_ORDER..=most).filter(|order| order % self.layout.pole_pairs.unsigned_abs() as usize != 0) {
            let [backward, forward] = wave([backward, forward], order);
            let mean = [0, 1].map(|part| (forward[part] + backward[part]) / 2.0);
            let half = [0, 1].map(|part| (forward[part] - backward[part]) / 2.0);
            (noise, orders) = (noise + square(half), orders + 1.0);
            if square(mean) < ALIKE * ALIKE * square(half) {
                continue;
            }
            let place = if found.is_full() {
                found.iter_mut().min_by(|a, b| a.0.total_cmp(&b.0))
            } else {
                let _ = found.push((0.0, Wave::NONE));
                found.last_mut()
            };
            if let Some(weakest) = place.filter(|weakest| weakest.0 < square(mean)) {
                *weakest = (square(mean), Wave::of(order, mean)?);
            }
        }
        // Nor is it of use where it is less than the current's unit.
        let least = (STANDS_OUT * STANDS_OUT * noise / orders.max(1.0)).max(1.0);
        Some(Waves::of(found.iter().filter(|(square, _)| *square > least).map(|&(_, wave)| wave)))
    }
}

fn square([sine, cosine]: [f32; 2]) -> f32 {
    sine * sine + cosine * cosine
}

/// Sine and cosine of an order, of values over the turn in both directions.
fn wave([backward, forward]: [&[f32]; 2], order: usize) -> [[f32; 2]; 2] {
    let count = forward.len();
    let mut sums = [[0.0; 2]; 2];
    for ((backward, forward), (sin, cos)) in backward.iter().zip(forward).zip(turn(order, count)) {
        for ([sine, cosine], value) in sums.iter_mut().zip([backward, forward]) {
            *sine += value * sin;
            *cosine += value * cos;
        }
    }
    // A point stands for what is half the way to the next around it.
    let scale = 2.0 / count as f32 / sinc(PI * order as f32 / count as f32);
    sums.map(|parts| parts.map(|sum| scale * sum))
}
