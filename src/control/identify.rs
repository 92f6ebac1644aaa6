//! The motor's parameters from what the drive measures while it turns to and fro under field-oriented speed control.
//!
//! Three regressions of the machine's equations: `v_q = R i_q + λ ω`, `v_d = −L ω i_q`, and `K_t i_q = J ω̇ + viscous and Coulomb
//! friction`, with the electrical speed ω and, for J, the mechanical one. On the simulated unkind motor, told parameters that are
//! off by a fifth: R within 5 %, L within 10 %, λ within 1 %, J within 3 %. In the tasks; f64.

use crate::control::settings::Config;
use crate::telemetry::Measurement;
use core::f64::consts::TAU;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// Resistance of a phase and what is in series, Ω.
    pub resistance_ohm: f64,
    /// Inductance of a phase, H.
    pub inductance_h: f64,
    /// Flux linkage, Wb.
    pub flux_linkage_wb: f64,
    /// Inertia, kg·m².
    pub inertia_kgm2: f64,
    /// Measurements used.
    pub samples: u32,
}

/// Sums of a linear regression with `N` regressors.
#[derive(Clone, Copy, Debug)]
struct Fit<const N: usize> {
    squares: [[f64; N]; N],
    products: [f64; N],
}

impl<const N: usize> Fit<N> {
    const NEW: Self = Self { squares: [[0.0; N]; N], products: [0.0; N] };

    fn push(&mut self, x: [f64; N], y: f64) {
        for i in 0..N {
            self.products[i] += x[i] * y;
            for j in 0..N {
                self.squares[i][j] += x[i] * x[j];
            }
        }
    }

    /// The coefficients, by elimination; `None` where the regressors do not tell them apart.
    fn solve(&self) -> Option<[f64; N]> {
        let (mut a, mut b) = (self.squares, self.products);
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

/// Collects measurements.
#[derive(Clone, Copy, Debug)]
pub struct Identifier {
    config: Config,
    q: Fit<2>,
    d: Fit<1>,
    motion: Fit<3>,
    last: [Option<Point>; 2],
    samples: u32,
}

/// A measurement in SI.
#[derive(Clone, Copy, Debug)]
struct Point {
    sequence: u32,
    /// Electrical, rad/s.
    omega: f64,
    current: f64,
}

/// Fewest measurements for a report.
const LEAST: u32 = 500;

impl Identifier {
    /// For a drive.
    pub const fn new(config: &Config) -> Self {
        Self { config: *config, q: Fit::NEW, d: Fit::NEW, motion: Fit::NEW, last: [None; 2], samples: 0 }
    }

    /// Takes a measurement; to be called in their order.
    pub fn push(&mut self, measurement: &Measurement) {
        let scale = &self.config.scale;
        let volts = f64::from(scale.volts) / 32_768.0;
        let amperes = f64::from(scale.amperes) / 32_768.0;
        let step_hz = f64::from(scale.step_hz);
        let state = &measurement.state;
        let omega = f64::from(measurement.rotor.speed()) / 4_294_967_296.0 * step_hz * TAU;
        let current = f64::from(state.current.q) * amperes;
        self.q.push([current, omega], f64::from(state.voltage.q) * volts);
        self.d.push([-omega * current], f64::from(state.voltage.d) * volts);
        let point = Point { sequence: measurement.sequence, omega, current: f64::from(state.wanted) * amperes };
        // The acceleration at the middle of three, where the rotor turns one way.
        if let [Some(first), Some(middle)] = self.last
            && first.omega * omega > 0.0
        {
            let seconds = f64::from(point.sequence.wrapping_sub(first.sequence)) / step_hz;
            let pairs = f64::from(scale.pole_pairs);
            let speed = middle.omega / pairs;
            self.motion.push([(omega - first.omega) / pairs / seconds, speed, speed.signum()], middle.current);
        }
        self.last = [self.last[1], Some(point)];
        self.samples += 1;
    }

    /// What the measurements say; `None` while they are too few, or do not vary enough to tell.
    pub fn report(&self) -> Option<Report> {
        let [resistance_ohm, flux_linkage_wb] = self.q.solve()?;
        let [inductance_h] = self.d.solve()?;
        // Dead time and offsets of the currents show in the friction's, so they are not reported.
        let [inertia, _, _] = self.motion.solve()?;
        let torque_constant = 1.5 * f64::from(self.config.scale.pole_pairs) * flux_linkage_wb;
        let report = Report {
            resistance_ohm,
            inductance_h,
            flux_linkage_wb,
            inertia_kgm2: inertia * torque_constant,
            samples: self.samples,
        };
        let sane = [resistance_ohm, inductance_h, flux_linkage_wb, report.inertia_kgm2].iter().all(|x| *x > 0.0);
        (self.samples >= LEAST && sane).then_some(report)
    }
}
