//! The motor's parameters from what the drive measures while it turns field-oriented, to and fro.
//!
//! Regressions of the machine's equations, with the electrical speed ω and the mechanical one Ω:
//!
//! - `v_q = R i_q + λ ω + v₀ s(i_q)`, of means over 10 ms of the swings, where the current is constant: noise of the
//!   current or the speed, or magnets that are not alike, would make each of them act less than it does. s is the sign
//!   as the dead time has it, of currents large enough to leave its ripple behind. What its compensation leaves, and the
//!   diodes' drop, is v₀, kept apart by currents of two magnitudes.
//! - `ΔΩ = (K_t ∫i_q dt − B Δθ − C ∫sign Ω dt − T t) / J`, the balance of momentum from mean to mean there: the speed is
//!   what is uncertain, so it is on the left.
//! - `K_t ∫i_q dt − J ΔΩ = B Δθ + C ∫sign Ω dt + T t`, with that J, from [mark](Identifier::mark) to mark, where the
//!   speed is steady. Offsets and noise of the currents average out, what is left of an offset acts as a load T and does
//!   not touch the friction, which has the other sign on the way back.
//! - `v_d = −L ω i_q + λ ω (δ + τ − T ω)`, with the constant angle δ that the frame is off by, the angle τ by which it
//!   is trimmed and the tracker lags meanwhile, and the delay T of the Halls' signals that the settings do not know. T
//!   counts where the rotor coasts: the speed loop answers uneven magnets with a current that swings as the angle's
//!   error does, and the product of both looks like a delay.
//!
//! Against the simulated imperfect motor, whatever its friction, load, inertia and dead time, and settings off by a
//! fifth: R within 2 %, L within 4.5 %, λ within 1.2 %, J within 1.5 %, Coulomb friction within 0.06 mN·m, load within
//! 0.09 mN·m, viscous friction within 0.65 µN·m·s.
//!
//! Each value comes with the error within which the true one is expected: three times the standard error of the
//! regression, what the experiment `identify` has found beyond, and what the gains of the amplifiers and of the bus
//! divider may be off by, 2 % a volt and 1.5 % an ampere, which no measurement of the drive's own shows. Where the board
//! keeps to these, and with uneven magnets, the true value was within 98 % of the times (`cargo run --release -- identify`).
//! L by this is seldom better than by half; [`Standstill`](super::standstill::Standstill) tells it within 5 %.
//!
//! In the tasks; positions are taken as differences of integers, for which single precision does.

use crate::angle::{Position, TURN};
use crate::config::Config;
use crate::control::{self, Motor, Scale};
use crate::float::sign_of;
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
    pub(super) fn beside(self, share: f32) -> Self {
        Self { error: self.error + share * self.value.abs(), ..self }
    }

    /// Whether the error is larger than a share of the value.
    pub fn is_doubtful(self) -> bool {
        !(self.error <= DOUBTFUL * self.value.abs())
    }
}

/// Range of the setting `hall_delay_us`.
const HALL_DELAY_US: core::ops::RangeInclusive<f32> = -20.0..=200.0;
/// Shares by which what the drive takes for a volt and for an ampere may be off: a divider of two resistors of 1 %; a
/// shunt of 1 % and an amplifier set by resistors of 1 %, of which there are three that seldom err the same way.
pub(super) const VOLTS: f32 = 0.02;
pub(super) const AMPERES: f32 = 0.015;
/// Share from which on an error makes a value doubtful.
const DOUBTFUL: f32 = 0.15;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Resistance of a phase and what is in series, Ω.
    pub resistance_ohm: Estimate,
    /// Inductance of a phase along the magnets' field, H: the one across it by the saliency of the settings.
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
            settings.hall_delay_us = self.hall_delay_us.value.max(*HALL_DELAY_US.start()).min(*HALL_DELAY_US.end());
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
        let (scale, unit) = inertia_unit(self.inertia_kgm2.value);
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
            ("inertia", self.inertia_kgm2, scale, unit, Some(self.configured.inertia_kgm2), "inertia_kgm2"),
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

/// The unit in which an inertia is told, and how many of it are a kg·m².
pub const fn inertia_unit(kgm2: f32) -> (f32, &'static str) {
    if kgm2 < 0.01 { (1e7, "g·cm²") } else { (1.0, "kg·m²") }
}

/// Most regressors.
pub(super) const MOST: usize = 5;

/// Sums of a linear regression; one function for all numbers of regressors is shorter than one for each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fit {
    /// The lower triangle.
    squares: [f32; math::triangle(MOST)],
    products: [f32; MOST],
    square: f32,
    count: u32,
}

impl Fit {
    /// With a weight. Those beyond the regressors are to be zero.
    #[inline(never)]
    pub(super) fn push(&mut self, x: [f32; MOST], y: f32, weight: f32) {
        let (x, y) = (x.map(|x| x * weight), y * weight);
        for (i, product) in self.products.iter_mut().enumerate() {
            *product += x[i] * y;
            for (square, x_j) in self.squares.iter_mut().skip(math::triangle(i)).zip(x).take(i + 1) {
                *square += x[i] * x_j;
            }
        }
        self.square += y * y;
        self.count += 1;
    }

    /// The coefficients of the first regressors, each with three times its standard error; `None` where the regressors do
    /// not tell them apart.
    pub(super) fn solve(&self, regressors: usize) -> Option<[Estimate; MOST]> {
        let values = self.solve_for(regressors, self.products)?;
        let explained: f32 = values.iter().zip(&self.products).take(regressors).map(|(x, product)| x * product).sum();
        let freedom = self.count.checked_sub(regressors as u32 + 1)?;
        let variance = (self.square - explained).max(0.0) / freedom.max(1) as f32;
        let mut estimates = [Estimate { value: 0.0, error: 0.0 }; MOST];
        for (k, estimate) in estimates.iter_mut().enumerate().take(regressors) {
            let mut unit = [0.0; MOST];
            unit[k] = 1.0;
            let inverse = self.solve_for(regressors, unit)?[k];
            *estimate = Estimate { value: values[k], error: 3.0 * crate::float::root(variance * inverse) };
        }
        Some(estimates)
    }

    /// Solves the normal equations for a right side.
    fn solve_for(&self, regressors: usize, mut right: [f32; MOST]) -> Option<[f32; MOST]> {
        math::solve(&mut { self.squares }, &mut right, regressors, SINGULAR)?;
        Some(right)
    }

    /// Takes the coefficient of this regressor for known: the sums of those before it become those of what it leaves.
    fn eliminate(&mut self, last: usize, coefficient: f32) {
        let own = self.squares[math::lower(last, last)];
        self.square += coefficient * (coefficient * own - 2.0 * self.products[last]);
        for (row, product) in self.products.iter_mut().enumerate() {
            *product -= coefficient * self.squares[math::lower(row.max(last), row.min(last))];
        }
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

/// What the rotor does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    /// It is steered by the speed loop.
    Steered,
    /// A constant current swings it.
    Swings,
    /// It is left alone, without a current.
    Coasts,
}

/// ∫ i dt, way, ∫ sign dt and time since a mark; mechanical speed; current along q and d, voltage along q.
type Means = [f32; 8];

/// The window of a swing that is being summed up, and the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    /// Sums of [`Means`], their number, and the time so far.
    sums: Means,
    count: f32,
    seconds: f32,
    /// The first five means of the one before, where the rotor did not nearly rest: the balance of momentum is from these.
    before: Option<[f32; 5]>,
}

/// Collects measurements.
#[derive(Clone, Copy, Debug)]
pub struct Identifier {
    scale: Scale,
    configured: Motor,
    configured_delay_us: f32,
    ramp_a: f32,
    /// Fastest mechanical speed so far.
    fastest: f32,
    /// Angle that the tracker lags by for an acceleration, s².
    lag: f32,
    /// Mechanical speed below which friction is not known to have a direction.
    slow: f32,
    stage: Stage,
    window: Window,
    /// Largest mean current of a window.
    largest: f32,
    q: Fit,
    d: Fit,
    late: Fit,
    inertia: Fit,
    motion: Fit,
    /// Sum of the squared leaps of the current while the speed was steady, and their number.
    leaps: [f32; 2],
    /// The last measurements, the newest last.
    points: [Option<Point>; 2],
    /// Since the last mark: ∫ i dt, way, ∫ sign dt, time; the square of what the first is uncertain by; the speed then.
    since: [f32; 4],
    uncertain: f32,
    begun: Option<f32>,
    /// Whether the next measurement ends a balance and begins another.
    marked: bool,
    samples: u32,
}

/// Fewest measurements for a report.
const LEAST: u32 = 500;

impl Identifier {
    /// For a drive; `None` for one without current control.
    pub fn new(config: &Config) -> Option<Self> {
        Some(Self::of(config, config.control.as_ref()?))
    }

    /// The same for its current control.
    pub(super) fn of(config: &Config, control: &control::Config) -> Self {
        let step_hz = control.scale.step_hz;
        Self {
            scale: control.scale,
            configured: control.motor,
            configured_delay_us: control.hall_delay_us(),
            ramp_a: control.dead_time_ramp_a(),
            lag: config.tracking.lag() / (step_hz * step_hz),
            fastest: 0.0,
            slow: SLOW * control.trajectory.speed() as f32 / control.scale.per_radian_s(),
            stage: Stage::Steered,
            window: Window::default(),
            largest: 0.0,
            q: Fit::default(),
            d: Fit::default(),
            late: Fit::default(),
            inertia: Fit::default(),
            motion: Fit::default(),
            leaps: [0.0; 2],
            points: [None; 2],
            since: [0.0; 4],
            uncertain: 0.0,
            begun: None,
            marked: false,
            samples: 0,
        }
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
            voltage: [state.voltage.d as f32 * volts, state.voltage.q as f32 * volts],
            trim: measurement.trim.to_radians(),
        };
        if let [Some(before), Some(middle)] = self.points {
            self.take(&before, &middle, &newest);
        }
        self.points = [self.points[1], Some(newest)];
    }

    /// What the rotor does from now on.
    #[inline(never)]
    pub fn enter(&mut self, stage: Stage) {
        if stage != self.stage {
            (self.stage, self.window) = (stage, Window::default());
        }
    }

    /// Takes the middle one of three, where the speed does not lag.
    fn take(&mut self, before: &Point, point: &Point, after: &Point) {
        let elapsed = self.seconds(before.sequence, after.sequence);
        let omega = radians(before.position, after.position) / elapsed;
        let speed = omega / self.scale.pole_pairs;
        let since = self.seconds(before.sequence, point.sequence);
        self.balance(speed, before, point, since);
        self.fastest = self.fastest.max(speed.abs());
        if self.stage == Stage::Swings {
            self.swing(speed, point, since);
        }
        let Point { current, voltage: [d, q], .. } = *point;
        let acceleration = (after.speed - before.speed) / elapsed;
        let turned = omega * (point.trim - self.lag * acceleration);
        // A frame that is far off, as after a reversal with late Halls, is beyond what is linear.
        if d.abs() > FAR * q.abs() {
            return;
        }
        if self.stage == Stage::Coasts {
            self.late.push([-omega * omega, omega, turned, 0.0, 0.0], d, 1.0);
        }
        // Where the current leaps, the inductance has a say; where braking is burnt by a current along d, that has.
        let most = LEAP * (current.abs() + self.ramp_a);
        if (after.current - before.current).abs() > most || point.burnt.abs() > most / 3.0 {
            return;
        }
        self.d.push([-omega * current, omega, -omega * omega, turned, point.burnt], d, 1.0);
        self.samples += 1;
    }

    /// Takes a point of a swing, so many seconds after the one before.
    fn swing(&mut self, speed: f32, point: &Point, seconds: f32) {
        let [impulse, way, sign, time] = self.since;
        let row = [impulse, way, sign, time, speed, point.current, point.burnt, point.voltage[1]];
        let window = &mut self.window;
        for (sum, x) in window.sums.iter_mut().zip(row) {
            *sum += x;
        }
        window.count += 1.0;
        window.seconds += seconds;
        if window.count < 2.0 || window.seconds < WINDOW_S {
            return;
        }
        let Window { sums, count, before, .. } = *window;
        let [impulse, way, sign, time, speed, current, burnt, voltage] = sums.map(|sum| sum / count);
        self.largest = self.largest.max(current.abs());
        // The current that burns what braking returns turns what the dead time takes.
        let reluctance = self.configured.reluctance_per_a();
        if current.abs() >= STRONG * self.largest && burnt.abs() <= (BURNT + reluctance * current.abs()) * current.abs()
        {
            let taken = softened(current / self.ramp_a);
            self.q.push([current, speed * self.scale.pole_pairs, taken, 0.0, 0.0], voltage, crate::float::root(count));
        }
        let moves = speed.abs() >= self.slow;
        if moves && let Some([impulse_before, way_before, sign_before, time_before, speed_before]) = before {
            let row = [impulse - impulse_before, way - way_before, sign - sign_before, time - time_before, 0.0];
            self.inertia.push(row, speed - speed_before, 1.0);
        }
        self.window = Window { before: moves.then_some([impulse, way, sign, time, speed]), ..Window::default() };
    }

    /// Time from step to step.
    fn seconds(&self, from: u32, to: u32) -> f32 {
        to.wrapping_sub(from) as f32 / self.scale.step_hz
    }

    /// Goes on by so many seconds; a mark ends a balance of momentum.
    fn balance(&mut self, speed: f32, before: &Point, point: &Point, seconds: f32) {
        let [impulse, way, sign, time] = &mut self.since;
        // The current along q that would make the same torque without one along d.
        let more = 1.0 - self.configured.reluctance_per_a() * point.burnt;
        *impulse += (before.current + point.current) / 2.0 * seconds * more;
        *sign += sign_of(speed) * seconds;
        *time += seconds;
        *way += radians(before.position, point.position) / self.scale.pole_pairs;
        let leap = point.current - before.current;
        self.uncertain += leap * leap * seconds * seconds;
        if self.begun.is_some() {
            self.leaps[0] += leap * leap;
            self.leaps[1] += 1.0;
        }
        if !core::mem::take(&mut self.marked) {
            return;
        }
        let [impulse, way, sign, time] = core::mem::take(&mut self.since);
        let uncertain = core::mem::take(&mut self.uncertain);
        if let Some(begun) = self.begun.replace(speed) {
            let weight = 1.0 / crate::float::root(uncertain.max(1e-12));
            self.motion.push([way, sign, time, speed - begun, 0.0], impulse, weight);
        }
    }

    /// The speed is steady: with the next measurement, a balance of momentum ends and another begins.
    pub const fn mark(&mut self) {
        self.marked = true;
    }

    /// What the measurements say; `None` while they are too few, or do not vary enough to tell.
    pub fn report(&self) -> Option<Report> {
        let [resistance, flux_linkage, leftover, ..] = self.q.solve(3)?;
        // The last coefficients are known by now.
        let mut d = self.d;
        // The settings' R is from standstill, or at least a resistance.
        d.eliminate(4, if resistance.is_doubtful() { self.configured.resistance_ohm } else { resistance.value });
        d.eliminate(3, flux_linkage.value);
        // What a current along q induces along d is that of the inductance across the magnets.
        let [inductance, ..] = d.solve(3)?;
        let mut late = self.late;
        late.eliminate(2, flux_linkage.value);
        let [late, ..] = late.solve(2)?;
        let pairs = self.scale.pole_pairs;
        let constant = 1.5 * pairs * flux_linkage.value;
        let share = flux_linkage.error / flux_linkage.value;
        // A heavy rotor that never turned back does not tell friction from a load.
        let [inertia, ..] = self.inertia.solve(4).or_else(|| self.inertia.solve(3))?;
        let inertia = Estimate { value: 1.0 / inertia.value, error: inertia.error / (inertia.value * inertia.value) };
        let mut motion = self.motion;
        motion.eliminate(3, inertia.value);
        let [viscous, coulomb, load, ..] = motion.solve(3)?;
        let torque = |x: Estimate| x.times(constant);
        let (inertia, viscous, coulomb, load) = (torque(inertia), torque(viscous), torque(coulomb), torque(load));
        // Half the square of a leap is the variance of what swings or is noise.
        let swings_nm = SWINGS_SHARE * constant * crate::float::root(self.leaps[0] / self.leaps[1].max(1.0) / 2.0);
        let more = |x: Estimate, more: f32| Estimate { error: x.error + more, ..x };
        let late = late.times(1e6 / flux_linkage.value);
        let late = Estimate { error: SWINGING_FREELY * late.error, ..late }.beside(share + UNLIKE);
        let gains = VOLTS + AMPERES;
        let report = Report {
            resistance_ohm: resistance.beside(0.01 + gains),
            inductance_h: Estimate { error: SWINGING * inductance.error, ..inductance }
                .beside(0.02 + gains)
                .times(1.0 / self.configured.saliency),
            flux_linkage_wb: flux_linkage.beside(0.012 + VOLTS),
            inertia_kgm2: inertia.beside(share + 0.015 + gains),
            coulomb_nm: more(coulomb, swings_nm).beside(share + gains),
            // What is braked along d makes the balance of momentum less sure than its residuals say.
            viscous_nms: more(viscous, 2.0 * viscous.error + swings_nm / self.fastest).beside(share + gains),
            load_nm: more(load, swings_nm).beside(share + gains),
            leftover_v: leftover,
            hall_delay_us: Estimate { value: late.value + self.configured_delay_us, ..late },
            configured: self.configured,
            configured_delay_us: self.configured_delay_us,
            pole_pairs: self.scale.whole_pole_pairs() as u8,
            samples: self.samples,
        };
        // What is doubtful is not set.
        let electrical = [report.resistance_ohm, report.inductance_h];
        let sane = [flux_linkage, inertia].iter().all(|x| x.value > 0.0)
            && electrical.iter().all(|x| x.value > 0.0 || x.is_doubtful());
        (self.samples >= LEAST && sane).then_some(report)
    }
}

/// Way of the rotor, in electrical radians.
fn radians(from: Position, to: Position) -> f32 {
    let way = to.to_bits().wrapping_sub(from.to_bits());
    // By halves, which a 32-bit core converts by itself.
    let turns = (way >> 32) as i32 as f32 + way as u32 as f32 / TURN;
    turns * TAU
}

/// What the dead time takes of a voltage along a current of so many ramps, relative to one at the end of the ramp: the
/// phases' currents pass zero, and the more steeply, the less is missing there. Within 3 % of the mean over a turn.
fn softened(ramps: f32) -> f32 {
    let size = ramps.abs();
    sign_of(ramps) * if size < 1.0 { size } else { 1.273 - 0.212 / (size * size) }
}

/// Length of a window of a swing.
const WINDOW_S: f32 = 0.01;
/// Least current of a window for R and λ, as a share of the largest, and largest one along d, as a share of it.
const STRONG: f32 = 0.4;
const BURNT: f32 = 0.15;
/// Share of the largest speed below which the rotor may stick meanwhile.
const SLOW: f32 = 0.02;
/// Share of what the current swings by that looks like friction: with uneven magnets, the error of the angle swings
/// with it.
const SWINGS_SHARE: f32 = 0.02;
/// Tangent of the angle by which the voltage may be beside q.
const FAR: f32 = 0.25;
/// What uneven magnets leave swings with the rotor and is no noise: so many times the error that noise would have, of L,
/// for which the speed loop answers them, and of the delay, while the rotor coasts.
const SWINGING: f32 = 8.0;
const SWINGING_FREELY: f32 = 2.0;
/// Share of the delay by which Halls that are not equally late mislead.
const UNLIKE: f32 = 0.05;
/// Share of a current by which it has leapt from one measurement to the next.
const LEAP: f32 = 0.3;
