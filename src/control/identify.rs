//! The motor's parameters from what the drive measures while it turns field-oriented, to and fro.
//!
//! Three regressions of the machine's equations, with the electrical speed ω and the mechanical one Ω:
//!
//! - `v_q = R i_q + λ ω + v₀ s(i_q)`: s is the sign, softened as the dead-time compensation's. What that leaves, and the diodes' drop, is v₀, kept
//!   apart by currents of several magnitudes.
//! - `v_d = −L ω i_q + δ λ ω`, with the angle δ that the frame is off by.
//! - `K_t ∫i_q dt = J ΔΩ + B Δθ + C ∫sign Ω dt + T t`: the balance of momentum from [mark](Identifier::mark) to mark, where the speed is steady.
//!   Offsets and noise of the currents average out, what is left of an offset acts as a load T and does not touch the friction,
//!   which has the other sign on the way back.
//!
//! Each value comes with the error within which the true one is expected: twice the standard error of the regression and what
//! the tests have found beyond. In the tasks; f64.

use crate::control::settings::{self, Config};
use crate::control::{Motor, Scale};
use crate::telemetry::Measurement;
use core::f64::consts::TAU;
use core::fmt;

/// A value, and how far it may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// The true value is expected within ± this.
    pub error: f64,
}

impl Estimate {
    /// Times a factor.
    fn times(self, factor: f64) -> Self {
        Self { value: self.value * factor, error: self.error * factor.abs() }
    }

    /// With an error of a share of the value more.
    fn beside(self, share: f64) -> Self {
        Self { error: self.error + share * self.value.abs(), ..self }
    }

    /// Whether the error is larger than a share of the value.
    pub fn is_doubtful(self) -> bool {
        !(self.error <= DOUBTFUL * self.value.abs())
    }
}

/// Share from which on an error makes a value doubtful.
const DOUBTFUL: f64 = 0.15;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// Resistance of a phase and what is in series, Ω.
    pub resistance_ohm: Estimate,
    /// Inductance of a phase, H.
    pub inductance_h: Estimate,
    /// Flux linkage, Wb.
    pub flux_linkage_wb: Estimate,
    /// Inertia, kg·m².
    pub inertia_kgm2: Estimate,
    /// Friction at any speed, N·m.
    pub coulomb_nm: Estimate,
    /// Friction that grows with the mechanical speed, N·m·s.
    pub viscous_nms: Estimate,
    /// Constant load against positive rotation, and what the offsets of the currents pretend, N·m.
    pub load_nm: Estimate,
    /// Voltage in the direction of the current that the dead-time compensation leaves, V.
    pub leftover_v: Estimate,
    /// What the drive was told.
    pub told: Motor,
    /// Pole pairs that the drive was told; torque constant and everything mechanical stand and fall with them.
    pub pole_pairs: u8,
    /// Measurements used.
    pub samples: u32,
}

impl Report {
    /// Torque per ampere along q, N·m/A: 1.5 · pole pairs · flux linkage.
    pub fn torque_constant_nm_a(&self) -> Estimate {
        self.flux_linkage_wb.times(1.5 * f64::from(self.pole_pairs))
    }

    /// L/R, s.
    pub fn time_constant_s(&self) -> Estimate {
        let share = |x: Estimate| x.error / x.value;
        let value = self.inductance_h.value / self.resistance_ohm.value;
        Estimate { value, error: value * (share(self.inductance_h) + share(self.resistance_ohm)) }
    }

    /// Sets what was found and is not doubtful.
    pub fn apply(&self, settings: &mut settings::Settings) {
        let fields = [
            (&mut settings.resistance_ohm, self.resistance_ohm),
            (&mut settings.inductance_h, self.inductance_h),
            (&mut settings.flux_linkage_wb, self.flux_linkage_wb),
            (&mut settings.inertia_kgm2, self.inertia_kgm2),
        ];
        for (field, estimate) in fields.into_iter().filter(|(_, estimate)| !estimate.is_doubtful()) {
            *field = estimate.value as f32;
        }
    }
}

/// A table: what was found, how far it may be off, what the drive was told, and the field of the settings that it belongs to.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "  {:<20} {:>9} {:>8}  {:<9} {:>8}", "", "measured", "±", "", "told")?;
        let told = |value: f32| Some(f64::from(value));
        let rows = [
            ("resistance", self.resistance_ohm, 1.0, "Ω", told(self.told.resistance_ohm), "resistance_ohm"),
            ("inductance", self.inductance_h, 1e3, "mH", told(self.told.inductance_h), "inductance_h"),
            ("flux linkage", self.flux_linkage_wb, 1e3, "mWb", told(self.told.flux_linkage_wb), "flux_linkage_wb"),
            ("inertia", self.inertia_kgm2, 1e6, "mg·m²·10³", told(self.told.inertia_kgm2), "inertia_kgm2"),
            ("torque constant", self.torque_constant_nm_a(), 1e3, "mN·m/A", None, ""),
            ("time constant L/R", self.time_constant_s(), 1e6, "µs", None, ""),
            ("Coulomb friction", self.coulomb_nm, 1e3, "mN·m", None, ""),
            ("viscous friction", self.viscous_nms, 1e6, "µN·m·s", None, ""),
            ("constant load", self.load_nm, 1e3, "mN·m", None, ""),
            ("left of dead time", self.leftover_v, 1e3, "mV", None, ""),
        ];
        for (name, estimate, scale, unit, told, field) in rows {
            let Estimate { value, error } = estimate.times(scale);
            write!(f, "  {name:<20} {value:>9.3} {error:>8.3}  {unit:<9}")?;
            match told {
                Some(told) => write!(f, " {:>8.3}", told * scale)?,
                None => write!(f, " {:>8}", "")?,
            }
            if !field.is_empty() {
                let verdict = if estimate.is_doubtful() { "doubtful, keep" } else { "set" };
                write!(f, "  {verdict} {field}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Sums of a linear regression with `N` regressors.
#[derive(Clone, Copy, Debug)]
struct Fit<const N: usize> {
    squares: [[f64; N]; N],
    products: [f64; N],
    square: f64,
    count: u32,
}

impl<const N: usize> Fit<N> {
    const NEW: Self = Self { squares: [[0.0; N]; N], products: [0.0; N], square: 0.0, count: 0 };

    fn push(&mut self, x: [f64; N], y: f64) {
        for i in 0..N {
            self.products[i] += x[i] * y;
            for j in 0..N {
                self.squares[i][j] += x[i] * x[j];
            }
        }
        self.square += y * y;
        self.count += 1;
    }

    /// The coefficients, each with twice its standard error; `None` where the regressors do not tell them apart.
    fn solve(&self) -> Option<[Estimate; N]> {
        let values = self.eliminate(&self.products)?;
        let explained: f64 = values.iter().zip(&self.products).map(|(value, product)| value * product).sum();
        let freedom = self.count.checked_sub(N as u32 + 1)?;
        let variance = (self.square - explained).max(0.0) / f64::from(freedom.max(1));
        let mut estimates = [Estimate { value: 0.0, error: 0.0 }; N];
        for (k, estimate) in estimates.iter_mut().enumerate() {
            let mut unit = [0.0; N];
            unit[k] = 1.0;
            let inverse = self.eliminate(&unit)?[k];
            *estimate = Estimate { value: values[k], error: 2.0 * libm::sqrt(variance * inverse) };
        }
        Some(estimates)
    }

    /// Solves the normal equations for a right side, by elimination.
    fn eliminate(&self, right: &[f64; N]) -> Option<[f64; N]> {
        let (mut a, mut b) = (self.squares, *right);
        for k in 0..N {
            if !(a[k][k] > 1e-9 * self.squares[k][k]) {
                return None;
            }
            for i in k + 1..N {
                let factor = a[i][k] / a[k][k];
                for j in k..N {
                    a[i][j] -= factor * a[k][j];
                }
                b[i] -= factor * b[k];
            }
        }
        for k in (0..N).rev() {
            for j in k + 1..N {
                b[k] -= a[k][j] * b[j];
            }
            b[k] /= a[k][k];
        }
        Some(b)
    }
}

/// A measurement in SI.
#[derive(Clone, Copy, Debug)]
struct Point {
    sequence: u32,
    /// In electrical radians.
    position: f64,
    /// Electrical, rad/s.
    omega: f64,
    /// Measured along q.
    current: f64,
}

/// Sums from mark to mark.
#[derive(Clone, Copy, Debug)]
struct Momentum {
    start: Point,
    /// ∫ i dt, ∫ sign dt, and the time.
    impulse: f64,
    sign: f64,
    seconds: f64,
}

/// Collects measurements.
#[derive(Clone, Copy, Debug)]
pub struct Identifier {
    scale: Scale,
    told: Motor,
    ramp_a: f64,
    q: Fit<3>,
    d: Fit<2>,
    motion: Fit<4>,
    last: Option<Point>,
    momentum: Option<Momentum>,
    /// Whether the next measurement ends a balance and begins another.
    marked: bool,
    samples: u32,
}

/// Fewest measurements for a report.
const LEAST: u32 = 500;

impl Identifier {
    /// For a drive.
    pub fn new(config: &Config) -> Self {
        Self {
            scale: config.scale,
            told: config.motor,
            ramp_a: f64::from(config.dead_time_ramp_a()),
            q: Fit::NEW,
            d: Fit::NEW,
            motion: Fit::NEW,
            last: None,
            momentum: None,
            marked: false,
            samples: 0,
        }
    }

    /// Takes a measurement; to be called in their order. One that was lost does no harm.
    pub fn push(&mut self, measurement: &Measurement) {
        let volts = f64::from(self.scale.volts) / 32_768.0;
        let amperes = f64::from(self.scale.amperes) / 32_768.0;
        let step_hz = f64::from(self.scale.step_hz);
        let state = &measurement.state;
        let point = Point {
            sequence: measurement.sequence,
            position: measurement.rotor.smoothed().to_turns() * TAU,
            omega: f64::from(measurement.rotor.speed()) / 4_294_967_296.0 * step_hz * TAU,
            current: f64::from(state.current.q) * amperes,
        };
        let last = self.last.replace(point);
        self.balance(last, point, step_hz);
        let Point { omega, current, .. } = point;
        // Where the current has just leapt, the inductance has a say.
        if last.is_some_and(|last| (last.current - current).abs() > LEAP * (current.abs() + self.ramp_a)) {
            return;
        }
        let soft = (current / self.ramp_a).clamp(-1.0, 1.0);
        self.q.push([current, omega, soft], f64::from(state.voltage.q) * volts);
        self.d.push([-omega * current, omega], f64::from(state.voltage.d) * volts);
        self.samples += 1;
    }

    fn balance(&mut self, last: Option<Point>, point: Point, step_hz: f64) {
        if let (Some(momentum), Some(last)) = (&mut self.momentum, last) {
            let seconds = f64::from(point.sequence.wrapping_sub(last.sequence)) / step_hz;
            momentum.impulse += (last.current + point.current) / 2.0 * seconds;
            momentum.sign += (last.omega.signum() + point.omega.signum()) / 2.0 * seconds;
            momentum.seconds += seconds;
        }
        if !core::mem::take(&mut self.marked) {
            return;
        }
        let start = Momentum { start: point, impulse: 0.0, sign: 0.0, seconds: 0.0 };
        if let Some(Momentum { start, impulse, sign, seconds }) = self.momentum.replace(start)
            && seconds > 0.0
        {
            let pairs = f64::from(self.scale.pole_pairs);
            let (speed, way) = ((point.omega - start.omega) / pairs, (point.position - start.position) / pairs);
            // The noise of an integral grows with the root of its time.
            let weight = 1.0 / libm::sqrt(seconds);
            self.motion.push([speed, way, sign, seconds].map(|x| x * weight), impulse * weight);
        }
    }

    /// The speed is steady: with the next measurement, a balance of momentum ends and another begins.
    pub const fn mark(&mut self) {
        self.marked = true;
    }

    /// What the measurements say; `None` while they are too few, or do not vary enough to tell.
    pub fn report(&self) -> Option<Report> {
        let [resistance, flux_linkage, leftover] = self.q.solve()?;
        let [inductance, _] = self.d.solve()?;
        let motion = self.motion.solve()?;
        let pairs = f64::from(self.scale.pole_pairs);
        let [inertia, viscous, coulomb, load] = motion.map(|x| x.times(1.5 * pairs * flux_linkage.value));
        let share = flux_linkage.error / flux_linkage.value;
        let report = Report {
            resistance_ohm: resistance,
            inductance_h: inductance,
            flux_linkage_wb: flux_linkage,
            inertia_kgm2: inertia.beside(share),
            coulomb_nm: coulomb.beside(share),
            viscous_nms: viscous.beside(share),
            load_nm: load.times(-1.0),
            leftover_v: leftover,
            told: self.told,
            pole_pairs: self.scale.pole_pairs as u8,
            samples: self.samples,
        };
        let sane = [resistance, inductance, flux_linkage, inertia].iter().all(|x| x.value > 0.0);
        (self.samples >= LEAST && sane).then_some(report)
    }
}

/// Share of a current by which it has leapt from one measurement to the next.
const LEAP: f64 = 0.3;
