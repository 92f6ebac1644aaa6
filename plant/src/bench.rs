//! A test bench: three Hall sensors at a rotor that turns as told, without motor or inverter, so that a thousand runs
//! take seconds.
//!
//! The rotor's speed ω (electrical) follows `dω/dt = torque/J·pairs − damping/J·ω + white noise`, once a sample.

use crate::adc::{Adc, AdcParameters};
use crate::error::{Error, not_negative, positive};
use crate::hall::{HallFault, HallParameters, Halls, View};
use crate::magnets::Magnets;
use crate::noise::Noise;
use crate::phasor::{Phasor, wrapped};
use core::f64::consts::TAU;

/// The rotor of a [`Bench`] and how it is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchParameters {
    /// The three linear Halls.
    pub halls: [HallParameters; 3],
    /// The magnets that they look at.
    pub magnets: Magnets,
    /// The ADC that reads them.
    pub adc: AdcParameters,
    /// Time between samples, s.
    pub period_s: f64,
    /// Electrical turns in a mechanical one.
    pub pole_pairs: u8,
    /// Inertia of all that turns, kg·m².
    pub inertia_kgm2: f64,
    /// Torque against the motion per speed, of friction and back-EMF together, N·m·s.
    pub damping_nms: f64,
    /// Density of a white torque that the estimator is not told, N·m/√Hz.
    pub torque_noise_nm_rthz: f64,
}

/// Sensors at a turning rotor.
#[derive(Clone, Debug)]
pub struct Bench {
    parameters: BenchParameters,
    halls: Halls,
    adc: Adc,
    noise: Noise,
    angle_rad: f64,
    /// Whole electrical turns since the start, which tell the magnets.
    turns: f64,
    speed_rad_s: f64,
    currents_a: [f64; 3],
}

impl Bench {
    /// With the rotor at an electrical angle and speed.
    ///
    /// # Errors
    /// Names the parameter that is out of range.
    pub fn new(parameters: &BenchParameters, angle_rad: f64, speed_rad_s: f64, seed: u64) -> Result<Self, Error> {
        positive(parameters.period_s, "period_s")?;
        positive(parameters.inertia_kgm2, "inertia_kgm2")?;
        not_negative(parameters.damping_nms, "damping_nms")?;
        not_negative(parameters.torque_noise_nm_rthz, "torque_noise_nm_rthz")?;
        let pairs = parameters.pole_pairs;
        let mut halls = Halls::new(&parameters.halls, 0.0, &parameters.magnets, pairs, parameters.period_s)?;
        halls.settle(view(angle_rad, 0.0, pairs), &[0.0; 3]);
        Ok(Self {
            parameters: *parameters,
            halls,
            adc: Adc::new(&parameters.adc)?,
            noise: Noise::new(seed),
            angle_rad,
            turns: 0.0,
            speed_rad_s,
            currents_a: [0.0; 3],
        })
    }

    /// One period under a torque, then a sample.
    pub fn step(&mut self, torque_nm: f64) -> [u16; 3] {
        let BenchParameters { period_s, pole_pairs, inertia_kgm2, damping_nms, torque_noise_nm_rthz, .. } =
            self.parameters;
        let unknown_nm = self.noise.scaled(torque_noise_nm_rthz / libm::sqrt(period_s));
        let acceleration =
            (f64::from(pole_pairs) * (torque_nm + unknown_nm) - damping_nms * self.speed_rad_s) / inertia_kgm2;
        let angle_rad = self.angle_rad + period_s * (self.speed_rad_s + 0.5 * period_s * acceleration);
        self.angle_rad = wrapped(angle_rad);
        self.turns += libm::round((angle_rad - self.angle_rad) / TAU);
        self.speed_rad_s += period_s * acceleration;
        self.halls.advance(view(self.angle_rad, self.turns, pole_pairs), &self.currents_a, period_s);
        self.halls.volts(&mut self.noise).map(|volts| self.adc.code(volts))
    }

    /// Takes the rotor to a speed at once.
    pub fn set_speed(&mut self, speed_rad_s: f64) {
        self.speed_rad_s = speed_rad_s;
    }

    /// Sets a sensor's fault, or clears it.
    pub fn set_fault(&mut self, sensor: usize, fault: Option<HallFault>) {
        self.halls.set_fault(sensor, fault);
    }

    /// Phase currents from now on, A, which only the sensors see: their torque is the caller's business.
    pub fn set_currents(&mut self, currents_a: [f64; 3]) {
        self.currents_a = currents_a;
    }

    /// Temperature of the sensors, °C.
    pub fn set_temperature(&mut self, celsius: f64) {
        self.halls.set_temperature(celsius);
    }

    /// Electrical angle, −π to π.
    #[must_use]
    pub const fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// Electrical speed.
    #[must_use]
    pub const fn speed_rad_s(&self) -> f64 {
        self.speed_rad_s
    }
}

/// What the Halls see after so many electrical turns.
fn view(angle_rad: f64, turns: f64, pole_pairs: u8) -> View {
    View { electrical: Phasor::new(angle_rad), mechanical_rad: (angle_rad + turns * TAU) / f64::from(pole_pairs) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::PlantParameters;

    fn parameters() -> BenchParameters {
        let plant = PlantParameters::ideal();
        BenchParameters {
            halls: plant.halls,
            magnets: plant.magnets,
            adc: plant.adc,
            period_s: 1e-3,
            pole_pairs: 4,
            inertia_kgm2: 1e-5,
            damping_nms: 1e-4,
            torque_noise_nm_rthz: 0.0,
        }
    }

    #[test]
    fn a_torque_speeds_up_to_what_damping_allows() {
        let mut bench = Bench::new(&parameters(), 0.0, 0.0, 1).unwrap();
        for _ in 0..2000 {
            bench.step(2e-3);
        }
        // pairs · torque / damping = 80 rad/s, with a time constant of 0.1 s.
        assert!((bench.speed_rad_s() - 80.0).abs() < 1e-3, "{}", bench.speed_rad_s());
    }

    #[test]
    fn unknown_torque_spreads_the_speed_as_theory_says() {
        let free = BenchParameters { damping_nms: 0.0, torque_noise_nm_rthz: 1e-5, ..parameters() };
        let mut square = 0.0;
        for seed in 0..400 {
            let mut bench = Bench::new(&free, 0.0, 0.0, seed).unwrap();
            for _ in 0..1000 {
                bench.step(0.0);
            }
            square += bench.speed_rad_s().powi(2) / 400.0;
        }
        // 4 / 1e-5 · 1e-5 N·m/√Hz after one second.
        assert!((square.sqrt() / 4.0 - 1.0).abs() < 0.1, "{square}");
    }

    #[test]
    fn the_codes_are_those_of_the_sensors() {
        let mut bench = Bench::new(&parameters(), 0.3, 62.8, 1).unwrap();
        for _ in 0..100 {
            let codes = bench.step(0.0);
            for (k, code) in codes.into_iter().enumerate() {
                let phase = bench.angle_rad() - core::f64::consts::TAU / 3.0 * k as f64;
                let exact = (1.65 + libm::sin(phase)) * 4096.0 / 3.3;
                assert!((f64::from(code) - exact).abs() <= 0.5 + 1e-9);
            }
        }
    }
}
