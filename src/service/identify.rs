//! The motor's parameters from what the drive measures while it turns field-oriented, to and fro.
//!
//! Three regressions of the machine's equations, with the electrical speed ω and the mechanical one Ω:
//!
//! - `v_q = R i_q + λ ω + v₀ s(i_q)`: s is the sign, softened as the dead-time compensation's. What that leaves, and
//!   the diodes' drop, is v₀, kept apart by currents of several magnitudes.
//! - `v_d = −L ω i_q + λ ω (δ + τ − T ω)`, with the constant angle δ that the frame is off by, the angle τ by which it
//!   is trimmed and the tracker lags meanwhile, and the delay T of the Halls' signals that the settings do not know.
//! - `K_t ∫i_q dt = J ΔΩ + B Δθ + C ∫sign Ω dt + T t`: the balance of momentum from [mark](Identifier::mark) to mark,
//!   where the speed is steady. Offsets and noise of the currents average out, what is left of an offset acts as a load
//!   T and does not touch the friction, which has the other sign on the way back.
//!
//! Against the simulated imperfect motor, whatever its friction, load, inertia and dead time, and settings off by a
//! fifth: R within 2 %, L within 4.5 %, λ within 1 %, J within 1.5 %, Coulomb friction within 0.06 mN·m, load within
//! 0.09 mN·m, viscous friction within 0.65 µN·m·s.
//!
//! Each value comes with the error within which the true one is expected: three times the standard error of the
//! regression and what the tests have found beyond. In the tasks; positions are taken as differences of integers, for which
//! single precision does.

use crate::angle::{Position, TURN};
use crate::config::Config;
use crate::control::{Motor, Scale};
use crate::math;
use crate::settings::Control;
use crate::telemetry::Measurement;
use core::f32::consts::TAU;
use core::fmt;

/// A value, and how far it may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// The value.
    pub value: f32,
    /// The true value is expected within ± this.
    pub error: f32,
}

impl Estimate {
    /// Times a factor.
    fn times(self, factor: f32) -> Self {
        Self { value: self.value * factor, error: self.error * factor.abs() }
    }

    /// With an error of a share of the value more.
    fn beside(self, share: f32) -> Self {
        Self { error: self.error + share * self.value.abs(), ..self }
    }

    /// Whether the error is larger than a share of the value.
    pub fn is_doubtful(self) -> bool {
        !(self.error <= DOUBTFUL * self.value.abs())
    }
}

/// Range of the setting `hall_delay_us`.
const HALL_DELAY_US: core::ops::RangeInclusive<f32> = -20.0..=200.0;
/// Share from which on an error makes a value doubtful.
const DOUBTFUL: f32 = 0.15;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    /// Delay of the Halls' signals, µs.
    pub hall_delay_us: Estimate,
    /// The settings meanwhile.
    pub configured: Motor,
    /// The delay of the Halls in the settings meanwhile, µs.
    pub configured_delay_us: f32,
    /// Pole pairs in the settings; torque constant and everything mechanical depend on them.
    pub pole_pairs: u8,
    /// Measurements used.
    pub samples: u32,
}

impl Report {
    /// Torque per ampere along q, N·m/A: 1.5 · pole pairs · flux linkage.
    pub fn torque_constant_nm_a(&self) -> Estimate {
        self.flux_linkage_wb.times(1.5 * f32::from(self.pole_pairs))
    }

    /// L/R, s.
    pub fn time_constant_s(&self) -> Estimate {
        let share = |x: Estimate| x.error / x.value;
        let value = self.inductance_h.value / self.resistance_ohm.value;
        Estimate { value, error: value * (share(self.inductance_h) + share(self.resistance_ohm)) }
    }

    /// Sets what was found and is not doubtful.
    pub fn apply(&self, settings: &mut Control) {
        let fields = [
            (&mut settings.resistance_ohm, self.resistance_ohm),
            (&mut settings.inductance_h, self.inductance_h),
            (&mut settings.flux_linkage_wb, self.flux_linkage_wb),
            (&mut settings.inertia_kgm2, self.inertia_kgm2),
        ];
        for (field, estimate) in fields.into_iter().filter(|(_, estimate)| !estimate.is_doubtful()) {
            *field = estimate.value;
        }
        if self.tells_delay() {
            settings.hall_delay_us = self.hall_delay_us.value.clamp(*HALL_DELAY_US.start(), *HALL_DELAY_US.end());
        }
    }

    /// Whether the delay of the Halls is known better than the settings know it.
    pub fn tells_delay(&self) -> bool {
        let Estimate { value, error } = self.hall_delay_us;
        (value - self.configured_delay_us).abs() > error
    }
}

/// A table: what was found, how far it may be off, the setting so far, and the field of the settings that it belongs
/// to.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "  {:<20} {:>9} {:>8}  {:<9} {:>8}", "", "measured", "±", "", "setting")?;
        let rows = [
            ("resistance", self.resistance_ohm, 1.0, "Ω", Some(self.configured.resistance_ohm), "resistance_ohm"),
            ("inductance", self.inductance_h, 1e3, "mH", Some(self.configured.inductance_h), "inductance_h"),
            (
                "flux linkage",
                self.flux_linkage_wb,
                1e3,
                "mWb",
                Some(self.configured.flux_linkage_wb),
                "flux_linkage_wb",
            ),
            ("inertia", self.inertia_kgm2, 1e7, "g·cm²", Some(self.configured.inertia_kgm2), "inertia_kgm2"),
            ("torque constant", self.torque_constant_nm_a(), 1e3, "mN·m/A", None, ""),
            ("time constant L/R", self.time_constant_s(), 1e6, "µs", None, ""),
            ("Coulomb friction", self.coulomb_nm, 1e3, "mN·m", None, ""),
            ("viscous friction", self.viscous_nms, 1e6, "µN·m·s", None, ""),
            ("constant load", self.load_nm, 1e3, "mN·m", None, ""),
            ("left of dead time", self.leftover_v, 1e3, "mV", None, ""),
            ("delay of the Halls", self.hall_delay_us, 1.0, "µs", Some(self.configured_delay_us), ""),
        ];
        for (name, estimate, scale, unit, set, field) in rows {
            let Estimate { value, error } = estimate.times(scale);
            write!(f, "  {name:<20} {value:>9.3} {error:>8.3}  {unit:<9}")?;
            match set {
                Some(set) => write!(f, " {:>8.3}", set * scale)?,
                None => write!(f, " {:>8}", "")?,
            }
            if name == "delay of the Halls" {
                write!(f, "  {} hall_delay_us", if self.tells_delay() { "set" } else { "keep" })?;
            }
            if !field.is_empty() {
                let verdict = if estimate.is_doubtful() { "doubtful, keep" } else { "set" };
                write!(f, "  {verdict} {field}")?;
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "  {:<20} {:>9} set, not measured: torque and everything mechanical depend on it",
            "pole pairs", self.pole_pairs
        )
    }
}

/// Most regressors.
const MOST: usize = 5;

/// Sums of a linear regression; one function for all numbers of regressors is shorter than one for each.
#[derive(Clone, Copy, Debug)]
struct Fit {
    squares: [[f32; MOST]; MOST],
    products: [f32; MOST],
    square: f32,
    count: u32,
    regressors: usize,
}

impl Fit {
    /// With up to [`MOST`] regressors.
    const fn new(regressors: usize) -> Self {
        Self { squares: [[0.0; MOST]; MOST], products: [0.0; MOST], square: 0.0, count: 0, regressors }
    }

    /// Those beyond the regressors are to be zero.
    fn push(&mut self, x: [f32; MOST], y: f32) {
        for (i, (squares, product)) in self.squares.iter_mut().zip(&mut self.products).enumerate() {
            *product += x[i] * y;
            for (square, x_j) in squares.iter_mut().zip(x) {
                *square += x[i] * x_j;
            }
        }
        self.square += y * y;
        self.count += 1;
    }

    /// The coefficients, each with three times its standard error; `None` where the regressors do not tell them apart.
    fn solve(&self) -> Option<[Estimate; MOST]> {
        let values = self.solve_for(self.products)?;
        let explained: f32 =
            values.iter().zip(&self.products).take(self.regressors).map(|(x, product)| x * product).sum();
        let freedom = self.count.checked_sub(self.regressors as u32 + 1)?;
        let variance = (self.square - explained).max(0.0) / freedom.max(1) as f32;
        let mut estimates = [Estimate { value: 0.0, error: 0.0 }; MOST];
        for (k, estimate) in estimates.iter_mut().enumerate().take(self.regressors) {
            let mut unit = [0.0; MOST];
            unit[k] = 1.0;
            let inverse = self.solve_for(unit)?[k];
            *estimate = Estimate { value: values[k], error: 3.0 * libm::sqrtf(variance * inverse) };
        }
        Some(estimates)
    }

    /// Solves the normal equations for a right side.
    fn solve_for(&self, mut right: [f32; MOST]) -> Option<[f32; MOST]> {
        math::solve(&mut self.squares.clone(), &mut right, self.regressors, SINGULAR)?;
        Some(right)
    }

    /// Takes the last coefficient for known: the sums become those of what it leaves.
    fn eliminate(&mut self, coefficient: f32) {
        let last = self.regressors - 1;
        let own = self.squares[last][last];
        self.square += coefficient * (coefficient * own - 2.0 * self.products[last]);
        for (product, squares) in self.products.iter_mut().zip(&self.squares) {
            *product -= coefficient * squares[last];
        }
        self.regressors = last;
    }
}

/// Share of a regressor that the others must leave unexplained.
const SINGULAR: f32 = 1e-6;

/// A measurement in SI.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Step in which it was taken.
    sequence: u32,
    position: Position,
    /// Electrical, of the tracker: it lags, in radians a second.
    speed: f32,
    /// Along q, measured.
    current: f32,
    /// Current along d, A.
    burnt: f32,
    /// Along d and q.
    voltage: [f32; 2],
    /// Electrical radians.
    trim: f32,
}

/// Sums from mark to mark.
#[derive(Clone, Copy, Debug)]
struct Momentum {
    /// Mechanical speed, position and step at the begin.
    speed: f32,
    position: Position,
    sequence: u32,
    /// ∫ i dt, ∫ sign dt, and the square of what the first is uncertain by.
    impulse: f32,
    sign: f32,
    uncertain: f32,
}

/// Collects measurements.
#[derive(Clone, Copy, Debug)]
pub struct Identifier {
    scale: Scale,
    configured: Motor,
    configured_delay_us: f32,
    ramp_a: f32,
    /// Angle that the tracker lags by for an acceleration, s².
    lag: f32,
    q: Fit,
    d: Fit,
    motion: Fit,
    /// The last measurements, the newest last.
    points: [Option<Point>; 2],
    momentum: Option<Momentum>,
    /// Whether the next measurement ends a balance and begins another.
    marked: bool,
    samples: u32,
}

/// Fewest measurements for a report.
const LEAST: u32 = 500;

impl Identifier {
    /// For a drive; `None` for one without current control.
    pub fn new(config: &Config) -> Option<Self> {
        let control = config.control.as_ref()?;
        let step_hz = control.scale.step_hz;
        Some(Self {
            scale: control.scale,
            configured: control.motor,
            configured_delay_us: control.hall_delay_us(),
            ramp_a: control.dead_time_ramp_a(),
            lag: config.tracking.lag() / (step_hz * step_hz),
            q: Fit::new(3),
            d: Fit::new(5),
            motion: Fit::new(4),
            points: [None; 2],
            momentum: None,
            marked: false,
            samples: 0,
        })
    }

    /// Takes a measurement; to be called in their order. One that was lost does no harm.
    pub fn push(&mut self, measurement: &Measurement) {
        let volts = self.scale.volts / 32_768.0;
        let amperes = self.scale.amperes / 32_768.0;
        let state = &measurement.state;
        let newest = Point {
            sequence: measurement.sequence,
            position: measurement.rotor.smoothed(),
            speed: measurement.rotor.speed() as f32 / TURN * TAU * self.scale.step_hz,
            current: state.current.q as f32 * amperes,
            burnt: state.current.d as f32 * amperes,
            voltage: [state.voltage.d, state.voltage.q].map(|voltage| voltage as f32 * volts),
            trim: measurement.trim.to_radians(),
        };
        if let [Some(before), Some(middle)] = self.points {
            self.take(&before, &middle, &newest);
        }
        self.points = [self.points[1], Some(newest)];
    }

    /// Takes the middle one of three, where the speed does not lag.
    fn take(&mut self, before: &Point, point: &Point, after: &Point) {
        let elapsed = self.seconds(before.sequence, after.sequence);
        let speed = self.radians(before.position, after.position) / elapsed;
        self.balance(speed, before, point);
        let Point { current, voltage: [d, q], .. } = *point;
        // Where the current leaps, the inductance has a say; where braking is burnt by a current along d, that has.
        let most = LEAP * (current.abs() + self.ramp_a);
        if (after.current - before.current).abs() > most || point.burnt.abs() > most / 3.0 {
            return;
        }
        // A frame that is far off, as after a reversal with late Halls, is beyond what is linear.
        if d.abs() > FAR * q.abs() {
            return;
        }
        let omega = speed * self.scale.pole_pairs;
        let acceleration = (after.speed - before.speed) / elapsed;
        self.q.push([current, omega, (current / self.ramp_a).clamp(-1.0, 1.0), 0.0, 0.0], q);
        let turned = omega * (point.trim - self.lag * acceleration);
        self.d.push([-omega * current, omega, -omega * omega, turned, point.burnt], d);
        self.samples += 1;
    }

    /// Time from step to step.
    fn seconds(&self, from: u32, to: u32) -> f32 {
        to.wrapping_sub(from) as f32 / self.scale.step_hz
    }

    /// Way of the rotor, in mechanical radians.
    fn radians(&self, from: Position, to: Position) -> f32 {
        let way = to.to_bits().wrapping_sub(from.to_bits());
        // By halves, which a 32-bit core converts by itself.
        let turns = (way >> 32) as i32 as f32 + way as u32 as f32 / TURN;
        turns * TAU / self.scale.pole_pairs
    }

    fn balance(&mut self, speed: f32, before: &Point, point: &Point) {
        let elapsed = self.seconds(before.sequence, point.sequence);
        if let Some(momentum) = &mut self.momentum {
            momentum.impulse += (before.current + point.current) / 2.0 * elapsed;
            momentum.sign += speed.signum() * elapsed;
            let leap = (point.current - before.current) * elapsed;
            momentum.uncertain += leap * leap;
        }
        if !core::mem::take(&mut self.marked) {
            return;
        }
        let Point { position, sequence, .. } = *point;
        let begun = Momentum { speed, position, sequence, impulse: 0.0, sign: 0.0, uncertain: 0.0 };
        if let Some(ended) = self.momentum.replace(begun) {
            let weight = 1.0 / libm::sqrtf(ended.uncertain.max(1e-12));
            let way = self.radians(ended.position, position);
            let row = [speed - ended.speed, way, ended.sign, self.seconds(ended.sequence, sequence), 0.0];
            self.motion.push(row.map(|x| x * weight), ended.impulse * weight);
        }
    }

    /// The speed is steady: with the next measurement, a balance of momentum ends and another begins.
    pub const fn mark(&mut self) {
        self.marked = true;
    }

    /// What the measurements say; `None` while they are too few, or do not vary enough to tell.
    pub fn report(&self) -> Option<Report> {
        let [resistance, flux_linkage, leftover, ..] = self.q.solve()?;
        // The last coefficients are known by now.
        let mut d = self.d;
        d.eliminate(resistance.value);
        d.eliminate(flux_linkage.value);
        let [inductance, _, late, ..] = d.solve()?;
        let [inertia, viscous, coulomb, load, _] = self.motion.solve()?;
        let pairs = self.scale.pole_pairs;
        let share = flux_linkage.error / flux_linkage.value;
        let [inertia, viscous, coulomb, load] =
            [inertia, viscous, coulomb, load].map(|x| x.times(1.5 * pairs * flux_linkage.value));
        let late = late.times(1e6 / flux_linkage.value);
        let late = Estimate { error: SWINGING * late.error, ..late }.beside(share + UNLIKE);
        let report = Report {
            resistance_ohm: resistance.beside(0.02),
            inductance_h: inductance.beside(0.02),
            flux_linkage_wb: flux_linkage.beside(0.008),
            inertia_kgm2: inertia.beside(share + 0.005),
            coulomb_nm: coulomb.beside(share),
            // What is braked along d makes the balance of momentum less sure than its residuals say.
            viscous_nms: Estimate { error: 2.0 * viscous.error, ..viscous }.beside(share),
            load_nm: load.beside(share + 0.01),
            leftover_v: leftover,
            hall_delay_us: Estimate { value: late.value + self.configured_delay_us, ..late },
            configured: self.configured,
            configured_delay_us: self.configured_delay_us,
            pole_pairs: self.scale.pole_pairs as u8,
            samples: self.samples,
        };
        let sane = [resistance, inductance, flux_linkage, inertia].iter().all(|x| x.value > 0.0);
        (self.samples >= LEAST && sane).then_some(report)
    }
}

/// Tangent of the angle by which the voltage may be beside q.
const FAR: f32 = 0.25;
/// What uneven magnets leave swings with the rotor and is no noise: so many times the error that noise would have.
const SWINGING: f32 = 4.0;
/// Share of the delay by which Halls that are not equally late mislead.
const UNLIKE: f32 = 0.08;
/// Share of a current by which it has leapt from one measurement to the next.
const LEAP: f32 = 0.3;
