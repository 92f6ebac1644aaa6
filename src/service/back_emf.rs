//! Does the motor induce its voltage where the Halls say that its magnets are? Asked of the currents and voltages that the drive
//! notes, for as long as it runs.
//!
//! The check at arming proves the commutation, and from then on a rotor may turn against its torque: a load that wins turns
//! it so. What may break afterwards is the joint of the magnets that the Halls see, or of the Halls' board. All signals
//! stay as good as they were, and are wrong by the angle that the joint has turned; beyond 90° the motor drives itself away
//! from what it is told.
//!
//! What resistance and inductance leave of the voltage is induced by the rotor's magnets: along q, in the direction of the
//! speed, whatever turns the shaft. It is doubted where it stands more than 32° aside, or points back, by more than
//! what the settings may be wrong by. A rotor so slow that it induces less than that tells nothing.

use crate::commutation::frames::Dq;
use crate::control::Config;
use crate::math::high;
use crate::telemetry::State;

/// Weight of a measurement in the means, 2⁻².
const MEAN_BITS: u32 = 2;
/// Noise of a current, in 2⁻¹⁵ of the full scale.
const NOISE: i32 = 128;

/// What has been seen; voltages in 2⁻¹⁵ of the full scale.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BackEmf {
    /// Means of the back-EMF, and of the one along q that the speed should induce, 2² times as large.
    emf: Dq,
    expected: i32,
    /// Current and speed of the measurement before.
    current: Dq,
    speed: i32,
    /// What was induced elsewhere, summed up.
    elsewhere: i32,
}

/// A product of a current, of 16 bits, with a factor in 2⁻¹⁶.
const fn times(current: i32, factor: i32) -> i32 {
    high(current << 16, factor)
}

/// Takes a value into a mean, which it gives.
const fn mean(mean: &mut i32, value: i32) -> i32 {
    *mean += value - (*mean >> MEAN_BITS);
    *mean >> MEAN_BITS
}

impl BackEmf {
    /// Takes a measurement in, of a commutation that drives all three phases; whether the back-EMF stands elsewhere.
    pub fn look(&mut self, state: &State, speed: i32, control: &Config) -> bool {
        let (v, i, model) = (state.voltage, state.current, &control.motion.model);
        if v == Dq::ZERO {
            // Nothing is controlled, as during the check at arming.
            *self = Self::default();
            return false;
        }
        // As while it swings: a speed that the tracker tells late is another one by now.
        let before = core::mem::replace(&mut self.speed, speed);
        if (speed - before).abs() > speed.abs() / 2 {
            *self = Self { current: state.current, speed, ..Self::default() };
            return false;
        }
        if self.is_on_its_way(state) {
            return false;
        }
        let reactance = high(speed, model.reactance);
        let (at_d, at_q) = (times(i.d, model.resistance), times(i.q, model.resistance));
        let inductive = times(i.q, reactance);
        let across = mean(&mut self.emf.d, v.d - at_d + inductive).abs();
        let along = mean(&mut self.emf.q, v.q - at_q - times(i.d, reactance));
        let expected = mean(&mut self.expected, high(speed, model.flux));
        let (along, expected) = if expected < 0 { (-along, -expected) } else { (along, expected) };
        let (at_d, at_q) = (at_d.abs(), at_q.abs());
        // The compensation takes four fifths of the dead time's voltage off where the current is large, and along q as far as it
        // knows: where much flows along d, it takes a phase near its zero crossing for one of the other sign.
        let (saturation, q) = (control.dead_time_saturation.max(1), i.q.abs().max(1));
        let compensated = q.min(saturation) * (q - 2 * i.d.abs()).max(0) / q;
        let dead = times(state.bus.into(), model.dead_of_bus);
        let dead = dead - dead * compensated / saturation * 13 / 16;
        // The resistance may be 0.44 times off, as of a hot winding, and the inductance by half: 32° are too much.
        let aside =
            (across - along * 5 / 8).min(across - expected * 7 / 16) - at_d * 7 / 16 - inductive.abs() / 2 - dead;
        // With what the speed should induce, the resistance may be 0.8 times off where the back-EMF points back.
        let back = -along - at_q * 7 / 16 - dead;
        let elsewhere = aside.min(expected - dead).max(back.min(expected - (at_d + at_q) * 3 / 8));
        self.elsewhere = (self.elsewhere + elsewhere).max(0);
        self.elsewhere > model.most * 3 / 4
    }

    /// Whether the current is on its way to what is asked for, so that the voltage is there to change it: it has changed, or
    /// some is missing though the voltage is not at its limit, or the voltage opposes what is missing, as in the moment in
    /// which it has turned round. Where not half of it flows at that limit, the bridge may be open.
    fn is_on_its_way(&mut self, state: &State) -> bool {
        let State { voltage: v, current: i, .. } = *state;
        let before = core::mem::replace(&mut self.current, i);
        let flows = i.d.abs().max(i.q.abs());
        let changed = (i.d - before.d).abs().max((i.q - before.q).abs());
        let limited = v.d.abs().max(v.q.abs()) > i32::from(state.bus) * 7 / 16;
        let is_missed = |missing: i32, v: i32| {
            let opposed = (missing ^ v) < 0;
            missing.abs() > flows / 4 + NOISE && v != 0 && (!limited || opposed || missing.abs() > flows)
        };
        // Without a current, the amplifiers may be dead, which is another check's.
        flows < NOISE
            || changed > flows / 4 + NOISE
            || is_missed(i32::from(state.field_reference) - i.d, v.d)
            || is_missed(state.current_reference - i.q, v.q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// The default motor as it is, on 24 V, and the drive's rotor that is wrong by an angle.
    #[derive(Clone, Copy, Debug)]
    struct Motor {
        ohm: f64,
        henry: f64,
        flux_vs: f64,
        hz: f64,
        amperes: [f64; 2],
        wrong_deg: f64,
        /// Of the dead time: along the current.
        lost_v: f64,
    }

    fn control() -> Control {
        Settings::default().control.unwrap_or_default()
    }

    fn sound() -> Motor {
        let Control { resistance_ohm, inductance_h, flux_linkage_wb, .. } = control();
        Motor {
            ohm: resistance_ohm.into(),
            henry: inductance_h.into(),
            flux_vs: flux_linkage_wb.into(),
            hz: 0.0,
            amperes: [0.0; 2],
            wrong_deg: 0.0,
            lost_v: 0.0,
        }
    }

    impl Motor {
        fn measurement(&self, random: &mut Pcg64) -> (State, i32) {
            let omega = core::f64::consts::TAU * self.hz;
            let (sin, cos) = libm::sincos(self.wrong_deg.to_radians());
            let [d, q] = self.amperes;
            let length = libm::hypot(d, q).max(1e-9);
            let induced = omega * self.flux_vs;
            let volts = [
                self.ohm * d - omega * self.henry * q + induced * sin + self.lost_v * d / length,
                self.ohm * q + omega * self.henry * d + induced * cos + self.lost_v * q / length,
            ];
            let full = f64::from(control().bus_full_scale_v);
            let of = |value: f64, full: f64, noise: f64| (value / full * 32_768.0 + noise) as i32;
            let mut noise = || random.random_range(-40.0..40.0);
            let amperes = f64::from(control().current_full_scale_a);
            let state = State {
                current: Dq { d: of(d, amperes, noise()), q: of(q, amperes, noise()) },
                current_reference: of(q, amperes, 0.0),
                field_reference: of(d, amperes, 0.0) as i16,
                voltage: Dq { d: of(volts[0], full, noise()), q: of(volts[1], full, noise()) },
                bus: of(24.0, full, 0.0) as u16,
                ..State::NONE
            };
            (state, (self.hz / 40e3 * 4_294_967_296.0) as i32)
        }

        /// The measurement of so many by which it is found.
        fn found(&self, measurements: u32) -> Option<u32> {
            let settings = Settings { control: Some(control()), ..Settings::default() };
            let config = settings.validate().unwrap().control.unwrap();
            let (mut emf, mut random) = (BackEmf::default(), Pcg64::seed_from_u64(1));
            (0..measurements).find(|_| {
                let (state, speed) = self.measurement(&mut random);
                emf.look(&state, speed, &config)
            })
        }
    }

    /// Electrical frequencies, and currents along d and q.
    const RUNS: [(f64, [f64; 2]); 7] = [
        (0.0, [0.0, 3.0]),
        (20.0, [0.0, 3.0]),
        (60.0, [0.0, -3.0]),
        (100.0, [-2.0, -1.0]),
        (250.0, [0.0, 1.0]),
        (-250.0, [-1.0, -0.1]),
        (-350.0, [-0.5, 0.5]),
    ];

    /// What a motor has of R, L and λ where the settings are what was measured from wire to wire.
    const BETWEEN_WIRES: [f64; 3] = [0.5, 0.5, 0.577];

    #[test]
    fn settings_that_are_off_are_no_fault() {
        for (hz, amperes) in RUNS {
            for [ohm, henry, flux] in
                [[1.0; 3], [0.6, 1.4, 1.3], [1.45, 0.6, 1.0], [1.4, 1.4, 0.8], [1.0, 1.0, 2.0], BETWEEN_WIRES]
            {
                for (lost_v, wrong_deg) in [(0.0, 0.0), (-0.1, 15.0), (0.1, -15.0)] {
                    let motor = sound();
                    let (ohm, henry, flux_vs) = (motor.ohm * ohm, motor.henry * henry, motor.flux_vs * flux);
                    let motor = Motor { ohm, henry, flux_vs, hz, amperes, wrong_deg, lost_v };
                    assert_eq!(motor.found(2000), None, "{motor:?}");
                }
            }
        }
    }

    #[test]
    fn a_back_emf_elsewhere_is_found_whatever_the_speed_and_the_current() {
        for (hz, amperes) in &RUNS[4..] {
            for wrong_deg in [60.0, -90.0, 120.0, -150.0, 180.0] {
                let motor = Motor { hz: *hz, amperes: *amperes, wrong_deg, ..sound() };
                let found = motor.found(100).unwrap_or_else(|| panic!("{motor:?}"));
                assert!(found < 30, "{found}: {motor:?}");
            }
        }
    }

    /// As by a load on a soft shaft, faster than the tracker follows: its speed is told late by more than a quarter of the swing,
    /// until that ends. Then little current flows, beside which what was told late would be much.
    #[test]
    fn a_rotor_that_swings_is_no_fault() {
        let config = Settings { control: Some(control()), ..Settings::default() }.validate().unwrap().control.unwrap();
        for swing_hz in [90.0, 164.0, 204.0, 253.0, 410.0] {
            for late_deg in [60.0_f64, 110.0, 150.0] {
                let (mut emf, mut random) = (BackEmf::default(), Pcg64::seed_from_u64(1));
                let found = (0..6000).find(|&k| {
                    let turn = core::f64::consts::TAU * swing_hz * f64::from(k) / 1250.0;
                    let swings = k % 300 < 200;
                    let hz = |turn: f64| if swings { 200.0 * libm::sin(turn) } else { 0.0 };
                    let amperes = [0.0, if swings { libm::copysign(3.0, libm::cos(turn)) } else { 0.2 }];
                    let (state, _) = Motor { hz: hz(turn), amperes, ..sound() }.measurement(&mut random);
                    let told = Motor { hz: hz(turn - late_deg.to_radians()), ..sound() };
                    emf.look(&state, told.measurement(&mut random).1, &config)
                });
                assert_eq!(found, None, "{swing_hz} Hz, {late_deg}°");
            }
        }
    }

    #[test]
    fn a_rotor_at_rest_tells_nothing_nor_does_a_bridge_without_a_voltage() {
        let motor = Motor { amperes: [0.0, 2.0], wrong_deg: 180.0, ..sound() };
        assert_eq!(motor.found(2000), None);
        let settings = Settings { control: Some(control()), ..Settings::default() };
        let (mut emf, mut random) = (BackEmf::default(), Pcg64::seed_from_u64(1));
        let config = settings.validate().unwrap().control.unwrap();
        let (mut state, speed) = Motor { hz: 250.0, wrong_deg: 180.0, ..sound() }.measurement(&mut random);
        state.voltage = Dq::ZERO;
        assert!((0..2000).all(|_| !emf.look(&state, speed, &config)));
    }
}
