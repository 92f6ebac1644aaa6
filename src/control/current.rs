//! Current control: d/q PI for field orientation, and the local feedback of Simpkins and Todorov, Fig. 7, on one
//! current.
//!
//! Both have the gains `ω L` and `ω R` for a bandwidth ω: the zero of the PI cancels the pole R/L of the winding, so
//! the loop is an integrator with the delay of sampling and PWM, 1.5 periods. Of a motor whose inductances along d and q
//! differ, each axis has the gain of its own. Where the voltage is limited, the
//! integrator is corrected by what the limit took off (back-calculation), with the winding's time constant.

mod local;

use crate::angle::TURN;
use crate::commutation::frames::Dq;
use crate::commutation::svpwm::{Circle, LONGEST};
use crate::control::{Motor, Scale};
use crate::math::high;
use core::f32::consts::TAU;
pub use local::{Local, LocalGains};

/// Bits by which a current of the d/q controller, in 2⁻²⁸ of the full scale, is finer than one of the outer loops.
pub(crate) const PARK_BITS: u32 = 13;

/// Gains of the d/q controller. It computes with currents in 2⁻²⁸ of the full scale and with voltages of which the bus
/// allows [`LONGEST`], so its gains follow the bus: these are for a bus of the divider's full scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gains {
    /// Voltage per current of each axis in 2⁻³².
    proportional: Dq,
    /// Voltage per current and step in 2⁻³².
    integral: i32,
    /// Anti-windup by back-calculation: share of the voltage that the limit took off, in 2⁻³².
    back: i32,
    /// Inductive voltage per current of each axis at a turn a step, and induced voltage: products with a speed that is
    /// shifted left by `shift`.
    inductance: Dq,
    flux: i32,
    shift: u8,
    /// Time constant of the loop, 1/ω, in quarters of a step.
    constant: u16,
    /// `i32::MAX` less the largest speed that is fed forward, in 2⁻³² turns a step: saturating additions with it cut
    /// a speed to ± that.
    beyond: i32,
}

/// The gains at the present bus voltage and speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Present {
    /// Coupling of the axes: ω L of the current along d, which takes a voltage along q, and of that along q.
    reactance: Dq,
    proportional: Dq,
    /// Back-EMF ω λ, a voltage.
    induced: i32,
    circle: Circle,
    integral: i32,
    back: i32,
}

impl Gains {
    /// For a bandwidth, a rotor that turns with up to `fastest_hz` electrical, at most a twentieth of a turn a step, a
    /// bus of at least a share `least_bus` of its full scale, and a bridge whose longest voltage is a share `longest`
    /// of the bus.
    ///
    /// What turning induces is fed forward as far as the integers reach; the integrators do the rest.
    ///
    /// # Errors
    /// The bandwidth that the integers have room for, where it is not more than the one that was asked for.
    pub fn new(
        motor: &Motor,
        bandwidth_hz: f32,
        fastest_hz: f32,
        scale: &Scale,
        least_bus: f32,
        longest: f32,
    ) -> Result<Self, f32> {
        /// Present gains have 26 bits of fraction and 31 in all; the rest is for roundings. No sum overflows, whatever
        /// the currents.
        const MOST: f32 = 31.0;
        // From shares of the full scale to the unit of the voltages, with 22 bits.
        let unit = LONGEST as f32 / 4_194_304.0 / longest;
        let omega = TAU * bandwidth_hz;
        let [d_h, q_h] = motor.inductances_h();
        let voltage = |per_s: f32, own_h: f32| unit * per_s * own_h / scale.conductance();
        let (along_d, along_q) = (voltage(omega, d_h), voltage(omega, q_h));
        let proportional = along_d.max(along_q);
        let integral = unit * omega * motor.resistance_ohm / scale.conductance() / scale.step_hz;
        // Radians a second at a turn a step.
        let radians_s = TAU * scale.step_hz;
        let (inductance_d, inductance_q) = (voltage(radians_s, d_h), voltage(radians_s, q_h));
        let inductance = inductance_d.max(inductance_q);
        let flux = unit * radians_s * motor.flux_linkage_wb / scale.volts;
        let room = |gain: f32| MOST * least_bus / gain;
        if room(proportional.max(integral)) <= 1.0 {
            return Err(room(proportional.max(integral)) * bandwidth_hz);
        }
        let turns = (fastest_hz / scale.step_hz).min(room(inductance.max(flux)));
        // The fastest speed fills the integer.
        let shift = -crate::float::exponent(turns) - 2;
        Ok(Self {
            proportional: Dq { d: hold(along_d, 26), q: hold(along_q, 26) },
            integral: hold(integral, 26).max(1),
            back: hold((integral / proportional).min(0.49), 32),
            constant: crate::float::nearest(4.0 * scale.step_hz / omega).clamp(0, 65_535) as u16,
            inductance: Dq { d: hold(inductance_d, 23 - shift), q: hold(inductance_q, 23 - shift) },
            flux: hold(flux, 23 - shift),
            shift: shift as u8,
            beyond: i32::MAX - (turns * TURN) as i32,
        })
    }
}

/// The nearest integer to a gain with so many bits of fraction.
#[inline(never)]
fn hold(gain: f32, bits: i32) -> i32 {
    crate::float::nearest(gain * crate::float::power_of_two(bits))
}

impl Present {
    /// No gain at all.
    pub const ZERO: Self =
        Self { reactance: Dq::ZERO, proportional: Dq::ZERO, induced: 0, circle: Circle::NEW, integral: 0, back: 0 };

    /// Takes up a bus voltage.
    #[inline(always)]
    pub const fn take_up_bus(&mut self, gains: &Gains, bus: Inverse) {
        self.proportional = Dq { d: bus.of(gains.proportional.d) << 6, q: bus.of(gains.proportional.q) << 6 };
        self.integral = bus.of(gains.integral) << 6;
        self.back = gains.back;
    }

    /// Back-EMF, in the unit of the voltages.
    #[inline(always)]
    pub const fn induced(&self) -> i32 {
        self.induced
    }

    /// Voltage of the resistance at a current, from the integral gain, which is that of a step; meaningless beyond 160
    /// times the bus.
    #[inline(always)]
    pub const fn resistive(&self, gains: &Gains, current: i32) -> i32 {
        high(current, self.integral).wrapping_mul(gains.constant as i32) >> 2
    }

    /// Takes up what turning with `speed` induces.
    #[inline(always)]
    pub const fn take_up_speed(&mut self, gains: &Gains, bus: Inverse, speed: i32) {
        // Cut to both sides by saturation, in four instructions.
        let beyond = gains.beyond;
        let speed = speed.saturating_add(beyond).wrapping_sub(beyond).saturating_sub(beyond).wrapping_add(beyond);
        let speed = speed.wrapping_shl(gains.shift as u32);
        let Dq { d, q } = gains.inductance;
        self.reactance = Dq { d: bus.of(high(speed, d)) << 9, q: bus.of(high(speed, q)) << 9 };
        self.induced = bus.of(high(speed, gains.flux)) << 5;
    }
}

/// One over a bus voltage, a share of its full scale, in 2⁻²⁶.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inverse(i32);

impl Inverse {
    /// Of a voltage of 2⁻¹⁵ of the full scale, from a twentieth of it on; up to 2⁻¹⁵ and one part in the voltage too
    /// small: 6.5e-4 of a twentieth, 1e-4 of half the full scale. One division.
    #[inline(always)]
    pub const fn new(bus: i32) -> Self {
        // Never zero, which the compiler does not see.
        Self((((1 << 30) / (bus as u32 | 1)) << 11) as i32)
    }

    /// A product with it, in 2⁻⁶.
    #[inline(always)]
    const fn of(self, x: i32) -> i32 {
        high(x, self.0)
    }
}

/// The integrators of the d/q controller: voltages along d and q.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Integrators {
    d: i32,
    q: i32,
}

impl Integrators {
    /// Nothing.
    pub const ZERO: Self = Self { d: 0, q: 0 };

    /// One step: the voltage that makes the `measured` currents the `reference`, within the circle.
    ///
    /// The voltages that turning induces from axis to axis are fed forward, so that d and q do not disturb each
    /// other. Currents are in 2⁻²⁸ of the full scale and up to 4/3 of it.
    #[inline(always)]
    pub const fn step(&mut self, gains: &Present, reference: Dq, measured: Dq) -> Dq {
        let (field, error) = (reference.d - measured.d, reference.q - measured.q);
        let asked = Dq {
            d: self.d + high(field, gains.proportional.d) - high(measured.q, gains.reactance.q),
            q: self.q + gains.induced + high(error, gains.proportional.q) + high(measured.d, gains.reactance.d),
        };
        let dq = gains.circle.cut(asked);
        let over = Dq { d: dq.d - asked.d, q: dq.q - asked.q };
        self.d = self.d + high(field, gains.integral) + high(over.d, gains.back);
        self.q = self.q + high(error, gains.integral) + high(over.q, gains.back);
        dq
    }

    /// Keeps the voltages when the bus was `before` and is now what `bus` is the inverse of.
    #[inline(always)]
    pub const fn follow(&mut self, before: i32, now: i32, bus: Inverse) {
        let before = if before < 2 * now { before } else { 2 * now - 1 };
        // In 2⁻³⁰: the inverse without its shift.
        let ratio = before.wrapping_mul(bus.0 >> 11);
        self.d = high(self.d, ratio) << 2;
        self.q = high(self.q, ratio) << 2;
    }

    /// Voltage along d that the integrator holds; an error of the angle or of the motor's parameters shows in it.
    pub const fn d(&self) -> i32 {
        self.d
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Feedback;
    use proptest::prelude::*;

    extern crate std;
    use std::vec::Vec;

    const MOTOR: Motor =
        Motor { resistance_ohm: 3.75, inductance_h: 0.36e-3, saliency: 1.0, flux_linkage_wb: 5e-3, inertia_kgm2: 1e-5 };
    const SCALE: Scale = Scale { step_hz: 40e3, amperes: 8.25, volts: 36.3, pole_pairs: 4.0 };

    fn along_q(q: i32) -> Dq {
        Dq { d: 0, q }
    }

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

    /// Longest voltage of the tests as a share of the bus, and the bus: 24 V.
    const LONGEST_SHARE: f64 = 0.55;
    const BUS: i32 = 21_664;

    fn present(bandwidth: f32, speed: i32) -> Present {
        present_of(&MOTOR, bandwidth, speed)
    }

    fn present_of(motor: &Motor, bandwidth: f32, speed: i32) -> Present {
        let gains = Gains::new(motor, bandwidth, 2000.0, &SCALE, 0.3, LONGEST_SHARE as f32).unwrap();
        let mut present = Present::ZERO;
        present.take_up_bus(&gains, Inverse::new(BUS));
        present.take_up_speed(&gains, Inverse::new(BUS), speed);
        present
    }

    /// In 2⁻¹⁵ of the full scale.
    fn units(voltage: i32, bus: i32) -> f64 {
        f64::from(voltage) / f64::from(LONGEST) * LONGEST_SHARE * f64::from(bus)
    }

    #[test]
    fn a_step_has_the_bandwidth_and_no_overshoot_to_speak_of() {
        for bandwidth in [200.0, 500.0, 1000.0, 2000.0] {
            let gains = present(bandwidth, 0);
            let mut integrators = Integrators::default();
            let currents = winding(3.75, 2000, |q| {
                units(integrators.step(&gains, along_q(4000 << 13), Dq { d: 0, q: q << 13 }).q, BUS) as i32
            });
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
        let gains = present(1000.0, 0);
        let mut integrators = Integrators::default();
        let mut reference = 30_000;
        let mut step = 0;
        let currents = winding(3.75, 8000, |q| {
            step += 1;
            if step == 4000 {
                reference = 2000;
            }
            units(integrators.step(&gains, along_q(reference << 13), Dq { d: 0, q: q << 13 }).q, BUS) as i32
        });
        // 13.2 V: 3.52 A.
        assert!((currents[3999] - 13_980).abs() < 60, "{}", currents[3999]);
        let least = currents[4000..].iter().min().unwrap();
        assert!(*least > 1800, "{least}");
    }

    #[test]
    fn turning_does_not_couple_the_axes() {
        // 300 Hz electrical; ω L i and ω λ in volts for 1 A along d and 2 A along q.
        let gains = present(1000.0, (300.0 / 40e3 * TURN) as i32);
        let per_ampere = SCALE.per_ampere();
        let current = Dq { d: per_ampere as i32 * 8192, q: (2.0 * per_ampere) as i32 * 8192 };
        let integrators = Integrators::default();
        let volts = |x: i32| units(x, BUS) as f32 * SCALE.volts / 32_768.0;
        let omega = TAU * 300.0;
        // One step with the currents as reference along q; along d the proportional part takes its share.
        let voltage = { integrators }.step(&gains, along_q(current.q), Dq { d: 0, ..current });
        assert!((volts(voltage.d) + omega * 0.36e-3 * 2.0).abs() < 5e-3, "{}", volts(voltage.d));
        assert!((volts(voltage.q) - omega * 5e-3).abs() < 5e-3, "{}", volts(voltage.q));
        let coupled = { integrators }.step(&gains, along_q(current.q), current);
        assert!((volts(coupled.q) - omega * (0.36e-3 + 5e-3)).abs() < 5e-3, "{}", volts(coupled.q));
        // The current along q takes a voltage along d by its own inductance, and the other way round.
        for saliency in [0.5, 2.0] {
            let gains = present_of(&Motor { saliency, ..MOTOR }, 1000.0, (300.0 / 40e3 * TURN) as i32);
            let voltage = { integrators }.step(&gains, current, current);
            assert!((volts(voltage.d) + omega * 0.36e-3 * saliency * 2.0).abs() < 5e-3, "{}", volts(voltage.d));
            assert!((volts(voltage.q) - omega * (0.36e-3 + 5e-3)).abs() < 5e-3, "{}", volts(voltage.q));
        }
    }

    #[test]
    fn each_axis_has_the_gain_of_its_inductance() {
        for saliency in [0.25, 0.7, 1.5, 8.0] {
            let gains = present_of(&Motor { saliency, ..MOTOR }, 500.0, 0);
            let one = |reference| Integrators::default().step(&gains, reference, Dq::ZERO);
            let [d, q] = [one(Dq { d: 1000 << 13, q: 0 }).d, one(along_q(1000 << 13)).q].map(|v| units(v, BUS));
            let exact = f64::from(TAU * 500.0 * MOTOR.inductance_h / SCALE.conductance()) * 1000.0;
            assert!((d / exact - 1.0).abs() < 1e-3, "{saliency}: {d} {exact}");
            assert!((q / exact / f64::from(saliency) - 1.0).abs() < 1e-3, "{saliency}: {q} {exact}");
        }
    }

    #[test]
    fn one_over_the_bus_is_at_most_a_little_too_small() {
        for (least, most, allowed) in [(1639, 16_384, 6.5e-4), (16_384, 32_768, 1e-4)] {
            let lacking = (least..most)
                .map(|bus| 1.0 - f64::from(Inverse::new(bus).0) * f64::from(bus) / f64::from(1 << 30) / 2048.0);
            let (low, high) =
                lacking.fold((1.0_f64, 0.0_f64), |(low, high), lacking| (low.min(lacking), high.max(lacking)));
            assert!(low >= 0.0 && high <= allowed, "{low} {high}");
        }
    }

    #[test]
    fn the_voltages_stay_when_the_bus_changes() {
        for (before, now) in [(20_000, 15_000), (15_000, 20_000), (15_000, 15_001), (30_000, 14_999)] {
            let mut integrators = Integrators { d: -700_000, q: 900_000 };
            let exact = units(900_000, before).min(units(1_800_000, now));
            integrators.follow(before, now, Inverse::new(now));
            assert!((units(integrators.q, now) / exact - 1.0).abs() < 2e-4, "{before} {now}");
            assert!((units(integrators.d, now) / exact * 9.0 / 7.0 + 1.0).abs() < 2e-4, "{before} {now}");
        }
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

    #[test]
    fn the_local_feedback_feeds_the_back_emf_of_any_motor_forward() {
        for flux_linkage_wb in [1e-4, 5e-3, 0.04, 0.14] {
            let motor = Motor { flux_linkage_wb, ..MOTOR };
            let gains = LocalGains::new(&motor, Feedback::P, 1000.0, &SCALE).unwrap();
            for volts in [-10.0, 0.1, 10.0] {
                let speed = volts / flux_linkage_wb / TAU / SCALE.step_hz * TURN;
                if speed.abs() <= TURN / 20.0 {
                    let found =
                        { Local::ZERO }.step(&gains, 0, 0, speed as i32, 32_767) as f32 * SCALE.volts / 32_768.0;
                    assert!((found - volts).abs() < 3e-3 + 1e-3 * volts.abs(), "{flux_linkage_wb}: {found} {volts}");
                }
            }
        }
    }

    /// A motor of this inductance, relative to that of the others, on a bus of 9 V.
    fn gains(inductance: f32, bandwidth: f32, fastest: f32) -> Result<Gains, f32> {
        let motor = Motor { inductance_h: inductance * MOTOR.inductance_h, ..MOTOR };
        Gains::new(&motor, bandwidth, fastest, &SCALE, 9.0 / 36.3, LONGEST_SHARE as f32)
    }

    #[test]
    fn a_refusal_tells_what_there_is_room_for() {
        assert!(gains(1.0, 1000.0, 2000.0).is_ok());
        for inductance in [20.0, 100.0, 1000.0] {
            let bandwidth = gains(inductance, 2000.0, 2000.0).unwrap_err();
            assert!(gains(inductance, 0.999 * bandwidth, 2000.0).is_ok(), "{inductance} {bandwidth}");
            assert!(gains(inductance, 1.001 * bandwidth, 2000.0).is_err(), "{inductance} {bandwidth}");
        }
    }

    #[test]
    fn the_feed_forward_is_as_exact_with_any_fastest_speed() {
        // Powers of two among them, and what fills the integer.
        for fastest in [1.0, 9.0, 39.0625, 312.0, 625.0, 1000.0, 1250.0, 1999.0, 2000.0] {
            let gains = gains(1.0, 500.0, fastest).unwrap();
            let induced = |hz: f32| {
                let mut present = Present::ZERO;
                present.take_up_speed(&gains, Inverse::new(BUS), (hz / 40e3 * TURN) as i32);
                units(present.induced, BUS) as f32 * SCALE.volts / 32_768.0
            };
            let exact = TAU * fastest * MOTOR.flux_linkage_wb;
            for (hz, exact) in [(fastest, exact), (-fastest, -exact), (10.0 * fastest, exact)] {
                assert!((induced(hz) - exact).abs() < 1e-3 * exact.abs() + 2e-4, "{fastest}: {} {exact}", induced(hz));
            }
        }
    }

    proptest! {
        #[test]
        fn the_voltage_is_within_the_circle_for_any_input(
            currents in prop::collection::vec((-43_690..43_690, -43_690..43_690), 1..100),
            reference in -32_768..32_768, speed: i32, room in 0.01..1.0_f32, resistance in 0.0..3.0_f32,
            flux in 0.0..10.0_f32, saliency in 0.25..8.0_f32,
        ) {
            // Up to the largest gains there is room for, and more flux than that, on the lowest bus.
            let least = 0.05;
            let unit = LONGEST as f32 / 4_194_304.0 / LONGEST_SHARE as f32;
            let (gain, omega) = (30.9 * room * least / unit, TAU * 2000.0);
            let ohm = gain * SCALE.conductance();
            let motor = Motor {
                inductance_h: ohm / omega / saliency.max(1.0),
                saliency,
                resistance_ohm: resistance * ohm,
                flux_linkage_wb: flux * gain * SCALE.volts / omega,
                ..MOTOR
            };
            let gains = Gains::new(&motor, 2000.0, 2000.0, &SCALE, least, LONGEST_SHARE as f32).unwrap();
            let (mut present, bus) = (Present::ZERO, Inverse::new((least * 32_768.0) as i32));
            present.take_up_bus(&gains, bus);
            present.take_up_speed(&gains, bus, speed);
            let mut integrators = Integrators::default();
            for (d, q) in currents {
                let Dq { d, q } = integrators.step(&present, along_q(reference << 13), Dq { d: d << 13, q: q << 13 });
                prop_assert!(libm::hypot(f64::from(d), f64::from(q)) <= f64::from(LONGEST));
            }
        }
    }
}
