//! Current control: d/q PI for field orientation, and the local feedback of Simpkins and Todorov, Fig. 7, on one current.
//!
//! Both have the gains `ω L` and `ω R` for a bandwidth ω: the zero of the PI cancels the pole R/L of the winding, so the loop is
//! an integrator with the delay of sampling and PWM, 1.5 periods. Where the voltage is limited, the integrator is
//! corrected by what the limit took off (back-calculation), with the winding's time constant.

use crate::commutation::frames::Dq;
use crate::commutation::svpwm::within_circle;
use crate::control::{Motor, Scale, clamp, fixed, high};
use core::f32::consts::TAU;

/// Bits of the fraction of a voltage within the controllers.
const FRACTION: u32 = 8;

/// Gains of the d/q controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gains {
    /// Voltage per current in 2⁻²⁶.
    proportional: i32,
    /// Voltage per current and step in 2⁻²⁶.
    integral: i32,
    /// Share of what the limit took off, in 2⁻³².
    back: i32,
    /// Inductive voltage per current and speed.
    inductance: i32,
    /// Voltage in 2⁻⁸ per speed in 2⁻³².
    flux: i32,
}

impl Gains {
    /// For a bandwidth in hertz. `None` when they are beyond the range of the integers.
    pub fn new(motor: &Motor, bandwidth_hz: f32, scale: &Scale) -> Option<Self> {
        let omega = TAU * bandwidth_hz;
        let conductance = scale.conductance();
        let proportional = omega * motor.inductance_h / conductance;
        let integral = omega * motor.resistance_ohm / conductance / scale.step_hz;
        // Radians a second in a speed of 2³².
        let radians_s = TAU * scale.step_hz;
        Some(Self {
            proportional: fixed(proportional, 26)?,
            integral: fixed(integral, 26)?.max(1),
            back: fixed((integral / proportional).min(0.49), 32)?,
            inductance: fixed(radians_s * motor.inductance_h / conductance, 22)?,
            flux: fixed(radians_s * motor.flux_linkage_wb / scale.volts, 15 + FRACTION as i32)?,
        })
    }
}

/// What the d/q controller keeps: the integrators, voltages in 2⁻⁸.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Integrators {
    d: i32,
    q: i32,
}

/// A voltage, and whether the limit was in the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voltage {
    /// The voltage to be applied.
    pub dq: Dq,
    /// Whether more was asked for.
    pub limited: bool,
}

impl Integrators {
    /// Nothing.
    pub const ZERO: Self = Self { d: 0, q: 0 };

    /// One step: the voltage that makes the `measured` currents the `wanted` ones, within a circle of `radius`.
    ///
    /// The voltages that turning with `speed` induces from axis to axis are fed forward, so that d and q do not disturb each
    /// other. Currents are up to 2¹⁶ and the radius up to 2¹⁵.
    #[inline(always)]
    pub const fn step(&mut self, gains: &Gains, wanted: Dq, measured: Dq, speed: i32, radius: i32) -> Voltage {
        let error = Dq { d: (wanted.d - measured.d) << 14, q: (wanted.q - measured.q) << 14 };
        // ω L and ω λ.
        let reactance = high(speed, gains.inductance);
        let coupled_d = -(high(reactance, measured.q << 15) << 3);
        let coupled_q = (high(reactance, measured.d << 15) << 3) + high(speed, gains.flux);
        let asked = Dq {
            d: (high(error.d, gains.proportional) + self.d + coupled_d) >> FRACTION,
            q: (high(error.q, gains.proportional) + self.q + coupled_q) >> FRACTION,
        };
        let dq = within_circle(asked, radius);
        let over = Dq { d: (dq.d - asked.d) << FRACTION, q: (dq.q - asked.q) << FRACTION };
        let most = radius << FRACTION;
        self.d = clamp(self.d + high(error.d, gains.integral) + high(over.d, gains.back), most);
        self.q = clamp(self.q + high(error.q, gains.integral) + high(over.q, gains.back), most);
        Voltage { dq, limited: (over.d | over.q) != 0 }
    }

    /// Voltage along d that the integrator holds, in units of voltage: what the angle's error and the model's show in.
    pub const fn d(&self) -> i32 {
        self.d >> FRACTION
    }
}

/// Which parts the local feedback has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Feedback {
    /// Proportional, as in the paper.
    P,
    /// With an integral part, which leaves no error at rest.
    #[default]
    Pi,
    /// With a derivative part, which makes up for half of the loop's delay.
    Pd,
    /// All three.
    Pid,
}

/// Gains of the local feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LocalGains {
    feed_forward: i32,
    proportional: i32,
    integral: i32,
    derivative: i32,
    back: i32,
    flux: i32,
}

impl LocalGains {
    /// For a bandwidth in hertz. `None` when they are beyond the range of the integers.
    pub fn new(motor: &Motor, feedback: Feedback, bandwidth_hz: f32, scale: &Scale) -> Option<Self> {
        let Gains { proportional, integral, back, flux, .. } = Gains::new(motor, bandwidth_hz, scale)?;
        let integrates = matches!(feedback, Feedback::Pi | Feedback::Pid);
        let derives = matches!(feedback, Feedback::Pd | Feedback::Pid);
        Some(Self {
            feed_forward: if integrates { 0 } else { fixed(motor.resistance_ohm / scale.conductance(), 26)? },
            proportional,
            integral: if integrates { integral } else { 0 },
            // Half of 1.5 steps.
            derivative: if derives { proportional / 4 * 3 } else { 0 },
            back,
            flux,
        })
    }
}

/// The local feedback: a current in, a voltage out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Local {
    integral: i32,
    last: i32,
}

impl Local {
    /// Nothing.
    pub const ZERO: Self = Self { integral: 0, last: 0 };

    /// One step: the voltage that makes the `measured` current the `wanted` one, up to ± `most`.
    ///
    /// The voltage that the back-EMF is expected to take is fed forward; to a feedback without an integral also that of the
    /// resistance, so that it has to make up for the rest only.
    pub const fn step(&mut self, gains: &LocalGains, wanted: i32, measured: i32, speed: i32, most: i32) -> i32 {
        let error = (wanted - measured) << 14;
        let change = (measured - self.last) << 14;
        self.last = measured;
        let forward = high(wanted << 14, gains.feed_forward) + high(speed, gains.flux);
        let asked =
            (high(error, gains.proportional) + self.integral + forward - high(change, gains.derivative)) >> FRACTION;
        let voltage = clamp(asked, most);
        if gains.integral != 0 {
            let over = (voltage - asked) << FRACTION;
            self.integral =
                clamp(self.integral + high(error, gains.integral) + high(over, gains.back), most << FRACTION);
        }
        voltage
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    extern crate std;
    use std::vec::Vec;

    const MOTOR: Motor =
        Motor { resistance_ohm: 3.75, inductance_h: 0.36e-3, flux_linkage_wb: 5e-3, inertia_kgm2: 1e-5 };
    const SCALE: Scale = Scale { step_hz: 40e3, amperes: 8.25, volts: 36.3, pole_pairs: 4.0 };

    /// A winding at rest behind the delay of preloaded compare registers: the current of each step in units.
    fn winding(resistance: f64, steps: usize, mut control: impl FnMut(i32) -> i32) -> Vec<i32> {
        let (tau, mut current, mut acting) = (f64::from(MOTOR.inductance_h) / resistance, 0.0_f64, 0);
        (0..steps)
            .map(|_| {
                let sampled = current as i32;
                let next = control(sampled);
                let target = f64::from(acting) * f64::from(SCALE.conductance()) / resistance;
                current = target + (current - target) * libm::exp(-25e-6 / tau);
                acting = next;
                sampled
            })
            .collect()
    }

    #[test]
    fn a_step_has_the_bandwidth_and_no_overshoot_to_speak_of() {
        for bandwidth in [200.0, 500.0, 1000.0, 2000.0] {
            let gains = Gains::new(&MOTOR, bandwidth, &SCALE).unwrap();
            let mut integrators = Integrators::default();
            let wanted = Dq { d: 0, q: 4000 };
            let currents = winding(3.75, 2000, |q| integrators.step(&gains, wanted, Dq { d: 0, q }, 0, 12_000).dq.q);
            let at = |level: i32| currents.iter().position(|&i| i >= level).unwrap() as f32;
            let rise_s = (at(3600) - at(400)) / 40e3;
            // 0.35 / f for a first order; the delay makes it faster.
            let first_order = 0.35 / bandwidth;
            assert!(
                rise_s <= 1.1 * first_order + 25e-6 && rise_s >= 0.5 * first_order - 25e-6,
                "{bandwidth}: {rise_s}"
            );
            let most = *currents.iter().max().unwrap();
            assert!(most <= 4000 + 400, "{bandwidth}: {most}");
            assert!((currents[1999] - 4000).abs() <= 8, "{bandwidth}: {}", currents[1999]);
        }
    }

    #[test]
    fn leaves_a_limit_without_overshoot() {
        let gains = Gains::new(&MOTOR, 1000.0, &SCALE).unwrap();
        let mut integrators = Integrators::default();
        let mut wanted = Dq { d: 0, q: 30_000 };
        let mut step = 0;
        let currents = winding(3.75, 8000, |q| {
            step += 1;
            if step == 4000 {
                wanted.q = 2000;
            }
            integrators.step(&gains, wanted, Dq { d: 0, q }, 0, 5000).dq.q
        });
        // 5000 units of voltage are 5.54 V: 1.48 A.
        assert!((currents[3999] - 5866).abs() < 30, "{}", currents[3999]);
        let least = currents[4000..].iter().min().unwrap();
        assert!(*least > 1800, "{least}");
    }

    #[test]
    fn turning_does_not_couple_the_axes() {
        let gains = Gains::new(&MOTOR, 1000.0, &SCALE).unwrap();
        // 500 Hz electrical; ω L i and ω λ in volts for 1 A along d and 2 A along q.
        let speed = (500.0 / 40e3 * 4_294_967_296.0) as i32;
        let per_ampere = SCALE.per_ampere();
        let current = Dq { d: per_ampere as i32, q: (2.0 * per_ampere) as i32 };
        let voltage = Integrators::default().step(&gains, current, current, speed, 16_000).dq;
        let omega = TAU * 500.0;
        let volts = |x: i32| x as f32 * SCALE.volts / 32_768.0;
        assert!((volts(voltage.d) + omega * 0.36e-3 * 2.0).abs() < 3e-3, "{voltage:?}");
        assert!((volts(voltage.q) - omega * (0.36e-3 + 5e-3)).abs() < 3e-3, "{voltage:?}");
    }

    #[test]
    fn the_local_feedback_follows_and_its_parts_do_what_they_should() {
        // A winding 20 % hotter than told.
        let settle = |feedback| {
            let gains = LocalGains::new(&MOTOR, feedback, 1000.0, &SCALE).unwrap();
            let mut local = Local::default();
            winding(4.5, 2000, |current| local.step(&gains, 4000, current, 0, 10_000))
        };
        let error = |currents: &[i32]| (currents[1999] - 4000).abs();
        let [p, pi, pd, pid] = [Feedback::P, Feedback::Pi, Feedback::Pd, Feedback::Pid].map(settle);
        assert!(error(&p) > 200 && error(&pd) > 200, "{} {}", error(&p), error(&pd));
        assert!(error(&pi) <= 16 && error(&pid) <= 16, "{} {}", error(&pi), error(&pid));
        for currents in [p, pi, pd, pid] {
            assert!(*currents.iter().max().unwrap() < 4500);
            // Three time constants of 1 kHz.
            assert!(currents[22] > 3200, "{}", currents[22]);
        }
    }

    proptest! {
        #[test]
        fn the_voltage_is_within_the_circle_for_any_input(
            currents in prop::collection::vec((-65_536..65_536, -65_536..65_536), 1..100),
            wanted in (-32_768..32_768, -32_768..32_768), speed in -(1 << 28)..(1 << 28), radius in 0..32_768,
        ) {
            let gains = Gains::new(&MOTOR, 2000.0, &SCALE).unwrap();
            let mut integrators = Integrators::default();
            for (d, q) in currents {
                let wanted = Dq { d: wanted.0, q: wanted.1 };
                let Dq { d, q } = integrators.step(&gains, wanted, Dq { d: d / 2, q: q / 2 }, speed, radius).dq;
                let length = libm::hypot(f64::from(d), f64::from(q));
                prop_assert!(length <= f64::from(radius) * 1.0001 + 1.5);
            }
        }
    }
}
