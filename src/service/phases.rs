//! Does each phase carry its current, and does the current follow its reference? Asked of the currents that the drive
//! notes, so that what breaks while the motor turns is found as well.
//!
//! The current in the frame of the rotor, averaged over a few measurements, says what each phase is due at the present
//! angle. An open phase, or a transistor that does not conduct, is one which is due a current in one direction
//! [`TIMES`] in a row and carries none, while that mean is about what the drive asks for. A rotor that stands tells
//! nothing: there the mean is what flows. Nor do measurements that see the rotor at the same angle again and again.

use crate::angle::ElectricalAngle;
use crate::commutation::frames::Dq;
use crate::fault::Fault;
use crate::math::high;
use crate::telemetry::{Measurement, State};

/// Measurements in a row that are a fault.
const TIMES: u8 = 16;
/// Measurements after which one of those is forgotten.
const FORGETTING: u8 = 8;
/// Least current that a phase has to be due, in 2⁻¹⁵ of the full scale: well above the noise.
const LEAST: i32 = 512;
/// Measurements in a row without any current that are a moment.
const QUIET: u8 = 3;
/// Weight of a measurement in the mean, 2⁻³.
const MEAN_BITS: u32 = 3;
/// Bits that a current is shortened by, for products of two that fit in 32.
const SHORTER: u32 = 2;

/// What is counted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Phases {
    /// Mean current in the frame of the rotor, in 2⁻¹⁸ of the full scale.
    mean: Dq,
    /// Measurements so far.
    count: u8,
    /// Measurements, less what was forgotten, in which each phase carried nothing of what it was due, along it and
    /// against it.
    missing: [[u8; 2]; 3],
    /// Measurements in a row in which no phase carried a current.
    quiet: u8,
    /// Measurements in a row without a current, though the voltage was below its limit.
    unfollowed: u8,
}

impl Phases {
    /// Takes a measurement in, of a commutation that drives all three phases; with `reversed` ones, B and C are
    /// exchanged. The back-EMF is in the unit of the voltage.
    pub fn look(&mut self, measurement: &Measurement, reversed: bool, induced: i32) -> Option<Fault> {
        let state = &measurement.state;
        if state.voltage == Dq::ZERO {
            // Nothing is controlled, as during the check at arming: all begins anew.
            *self = Self::default();
            return None;
        }
        self.mean.d += state.current.d - (self.mean.d >> MEAN_BITS);
        self.mean.q += state.current.q - (self.mean.q >> MEAN_BITS);
        if self.is_unfollowed(state, induced) {
            return Some(Fault::CurrentModel);
        }
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(FORGETTING) {
            for missing in self.missing.iter_mut().flatten() {
                *missing = missing.saturating_sub(1);
            }
        }
        // Where none of the three carries any, all amplifiers may have died, and the mean fades yet. For a moment there is none
        // where the phase that is open would carry the most.
        let none_flows = state.phases.iter().all(|flows| flows.abs() < LEAST / 4);
        self.quiet = if none_flows { self.quiet.saturating_add(1) } else { 0 };
        let reference = Dq { d: state.field_reference.into(), q: state.current_reference };
        let judges = self.quiet <= QUIET && self.is_steady(reference);
        let angle = (measurement.rotor.angle() + measurement.trim).to_bits();
        let third = (if reversed { -ElectricalAngle::THIRD } else { ElectricalAngle::THIRD }).to_bits();
        (0..3).find_map(|phase| {
            let from_phase = ElectricalAngle::from_bits(angle.wrapping_sub(third.wrapping_mul(phase as i32)));
            self.is_missing(phase, from_phase, state, judges)
        })
    }

    /// The current has a new way to go: in the measurements to come, it may be on its way each time.
    pub const fn begin_following(&mut self) {
        self.unfollowed = 0;
    }

    /// Whether the mean is what is due: the reference has not changed much, neither in length nor in direction.
    fn is_steady(&self, reference: Dq) -> bool {
        let mean = self.mean();
        let (along, length) = (dot(mean, reference), dot(reference, reference));
        let across = dot(mean, Dq { d: -reference.q, q: reference.d });
        length < 4 * along && along < 2 * length && across.abs() < along / 2
    }

    /// Mean current in the frame of the rotor, in 2⁻¹⁵ of the full scale.
    const fn mean(&self) -> Dq {
        Dq { d: self.mean.d >> MEAN_BITS, q: self.mean.q >> MEAN_BITS }
    }

    /// A current that nothing hinders, and that does not flow: no amplifier shows it. At a rotor that hardly turns, all of the
    /// voltage cannot but drive some, and what flows unseen is large.
    fn is_unfollowed(&mut self, state: &State, induced: i32) -> bool {
        let State { current_reference, field_reference, current, voltage, .. } = *state;
        let reference = current_reference.abs() + i32::from(field_reference).abs();
        let (flows, bus) = (current.q.abs() + current.d.abs(), i32::from(state.bus));
        let limited = voltage.q.abs() + voltage.d.abs() > bus / 5 * 2;
        if flows > reference / 4 {
            self.unfollowed = 0;
        } else if reference > LEAST && !limited {
            self.unfollowed += 1;
        } else if reference > LEAST && flows < LEAST / 4 && induced.abs() < bus / 10 {
            self.unfollowed += TIMES / 4;
        }
        self.unfollowed >= TIMES
    }

    /// Whether a phase carries nothing that the rotor is ahead of by an angle.
    fn is_missing(&mut self, phase: usize, from_phase: ElectricalAngle, state: &State, judges: bool) -> Option<Fault> {
        const OPEN: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];
        const BLIND: [Fault; 3] = [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC];
        let mean = self.mean();
        let due = along(mean, from_phase);
        let sum: i32 = state.phases.iter().sum();
        // The phases were measured a step later, by when a current that changes is another one. What they have in common is not
        // in the frame of the rotor.
        let flows = along(state.current, from_phase) + sum / 3;
        let (flows, due, side) = if due < 0 { (-flows, -due, 1) } else { (flows, due, 0) };
        let missing = &mut self.missing[phase][side];
        // Near the zero crossing of its current a phase tells little.
        let tells = judges && due >= LEAST && ((due * 8 / 5) >> SHORTER).pow(2) >= dot(mean, mean);
        // What flows counts also where nothing is judged: a current that is turned back again and again may be about what is
        // asked for in those moments only in which it does not flow.
        if !tells && flows <= LEAST.max(due / 4) {
            return None;
        }
        *missing = if flows > due / 4 { 0 } else { *missing + 1 };
        if *missing < TIMES {
            return None;
        }
        // What the other two carry and does not come back is a current that is not shown.
        Some(if sum.abs() > due / 2 { BLIND[phase] } else { OPEN[phase] })
    }
}

/// Product of two currents' lengths and the cosine of the angle between them, each without its last bits.
fn dot(a: Dq, b: Dq) -> i32 {
    (a.d >> SHORTER) * (b.d >> SHORTER) + (a.q >> SHORTER) * (b.q >> SHORTER)
}

/// What a current in the frame of the rotor is along a phase that the rotor is ahead of by an angle.
fn along(current: Dq, from_phase: ElectricalAngle) -> i32 {
    let (sin, cos) = crate::trig::sin_cos_of_tasks(from_phase);
    high(current.d << 2, cos.to_bits()) - high(current.q << 2, sin.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hall::track::Tracker;
    use core::f64::consts::TAU;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A motor whose current has components along d and q, in 2⁻¹⁵ of the full scale, and that goes on by so many
    /// electrical turns from measurement to measurement.
    #[derive(Clone, Copy, Debug)]
    struct Motor {
        d: f64,
        q: f64,
        from: f64,
        turns: f64,
        broken: Broken,
        reversed: bool,
    }

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Broken {
        Nothing,
        Phase(usize),
        /// Conducts in one direction only.
        Half(usize),
        /// Shows nothing.
        Amplifier(usize),
        Amplifiers,
    }

    const MOTOR: Motor = Motor { d: 0.0, q: 3000.0, from: 0.1, turns: 0.03, broken: Broken::Nothing, reversed: false };
    const OPEN: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];
    const BLIND: [Fault; 3] = [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC];
    /// Of a rotor that turns.
    const INDUCED: i32 = 8000;

    impl Motor {
        fn measurement(&self, k: u32, random: &mut Pcg64) -> Measurement {
            let turns = self.from + self.turns * f64::from(k);
            let order = if self.reversed { [0.0, 2.0, 1.0] } else { [0.0, 1.0, 2.0] };
            let angles = order.map(|phase| TAU * (turns - phase / 3.0));
            let mut currents = angles.map(|angle| self.d * libm::cos(angle) - self.q * libm::sin(angle));
            match self.broken {
                Broken::Phase(open) | Broken::Half(open)
                    if currents[open] > 0.0 || self.broken == Broken::Phase(open) =>
                {
                    // What flows into one of the other two comes out of the other.
                    let half = currents[open] / 2.0;
                    currents = currents.map(|current| current + half);
                    currents[open] = 0.0;
                }
                Broken::Amplifier(blind) => currents[blind] = 0.0,
                Broken::Amplifiers => currents = [0.0; 3],
                _ => {}
            }
            let currents = currents.map(|current| current + random.random_range(-50.0..50.0));
            let along = |of: fn(f64) -> f64| (0..3).map(|k| currents[k] * of(angles[k])).sum::<f64>() / 1.5;
            let current = Dq { d: along(libm::cos) as i32, q: -along(libm::sin) as i32 };
            let phases = currents.map(|current| current as i32);
            let state = State {
                phases,
                current,
                current_reference: self.q as i32,
                field_reference: self.d as i16,
                bus: 20_000,
                voltage: Dq { d: 0, q: 1000 },
            };
            // The frame of the currents is ahead of the rotor.
            let trim = ElectricalAngle::from_turns(0.02);
            let rotor = Tracker::at(ElectricalAngle::from_turns((turns - 0.02) as f32));
            Measurement { rotor, state, trim, ..Measurement::NONE }
        }

        /// The first fault in so many measurements.
        fn look(&self, measurements: u32) -> Option<Fault> {
            let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(1));
            (0..measurements).find_map(|k| phases.look(&self.measurement(k, &mut random), self.reversed, INDUCED))
        }
    }

    #[test]
    fn what_carries_nothing_is_named_whatever_the_direction_and_the_speed() {
        for phase in 0..3 {
            for turns in [0.03, -0.03, 0.21, -1.17] {
                for (d, q) in [
                    (0.0, 3000.0),
                    (0.0, -3000.0),
                    (-300.0, 2500.0),
                    (0.0, 20_000.0),
                    (-4000.0, 0.0),
                    (-3000.0, -3000.0),
                ] {
                    let motor = Motor { d, q, turns, ..MOTOR };
                    for (broken, fault) in [
                        (Broken::Phase(phase), OPEN[phase]),
                        (Broken::Half(phase), OPEN[phase]),
                        (Broken::Amplifier(phase), BLIND[phase]),
                        (Broken::Amplifiers, Fault::CurrentModel),
                    ] {
                        let motor = Motor { broken, reversed: turns > 0.1, ..motor };
                        assert_eq!(motor.look(u32::from(TIMES) - 1), None);
                        assert_eq!(motor.look(160), Some(fault), "{motor:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_motor_that_is_whole_is_none_whatever_current_flows_and_however_it_changes() {
        let mut random = Pcg64::seed_from_u64(3);
        for _ in 0..300 {
            let (mut phases, mut turns) = (Phases::default(), 0.0);
            let mut motor = MOTOR;
            for k in 0..1000 {
                // Now and then another current, or another speed; and a ripple of the torque with the angle.
                if random.random_bool(0.01) {
                    (motor.d, motor.q) = (random.random_range(-8e3..8e3), random.random_range(-8e3..8e3));
                }
                if random.random_bool(0.02) {
                    motor.turns = random.random_range(-0.6..0.6);
                }
                turns += motor.turns;
                let ripple = 1.0 + libm::cos(TAU * turns);
                let now = Motor { q: motor.q * ripple, from: turns, turns: 0.0, ..motor };
                assert_eq!(phases.look(&now.measurement(0, &mut random), false, INDUCED), None, "{k} {motor:?}");
            }
        }
    }

    /// At rest a phase may have its share of nothing for ever; seen at the same angles again and again, a motor is at
    /// rest.
    #[test]
    fn a_rotor_that_stands_tells_nothing() {
        for broken in [Broken::Nothing, Broken::Phase(0), Broken::Half(1), Broken::Phase(2)] {
            for degree in 0..360 {
                for (turns, d, q) in
                    [(0.0, 0.0, 3000.0), (1.0, 0.0, 3000.0), (1.0, -3000.0, 0.0), (0.0, -3000.0, 900.0)]
                {
                    let motor = Motor { d, q, from: f64::from(degree) / 360.0, turns, broken, reversed: false };
                    let fault = motor.look(500);
                    // Where the open phase is the one that q is along, the current does not follow.
                    assert!(matches!(fault, None | Some(Fault::CurrentModel)), "{fault:?} {motor:?}");
                    assert!(fault.is_none() || broken != Broken::Nothing, "{motor:?}");
                }
            }
        }
    }

    /// What was counted before the bridge is checked once more does not go on afterwards.
    #[test]
    fn a_check_between_begins_anew() {
        let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(5));
        let still = Motor { broken: Broken::Amplifiers, ..MOTOR };
        let mut look = |k, voltage| {
            let mut measurement = still.measurement(k, &mut random);
            measurement.state.voltage.q = voltage;
            phases.look(&measurement, false, INDUCED)
        };
        let short = u32::from(TIMES) - 1;
        assert!((0..short).all(|k| look(k, 1000).is_none()));
        assert!((0..100).all(|k| look(k, 0).is_none()));
        assert!((0..short).all(|k| look(k, 1000).is_none()));
        assert_eq!(look(short, 1000), Some(Fault::CurrentModel));
    }

    /// What was due before they died is due for a while yet, of phases that seem to carry nothing.
    #[test]
    fn amplifiers_that_die_together_are_no_open_phase_at_any_speed() {
        for turn in 0..500 {
            let mut random = Pcg64::seed_from_u64(turn);
            let turns = random.random_range(-0.5..0.5);
            let q = random.random_range(3000.0..25_000.0);
            let mut phases = Phases::default();
            let fault = (0..300).find_map(|k| {
                let broken = if k < 200 { Broken::Nothing } else { Broken::Amplifiers };
                // What is asked for fades as well, and the voltage is at its limit.
                let mut measurement = Motor { q, turns, broken, ..MOTOR }.measurement(k, &mut random);
                measurement.state.voltage = Dq { d: 3000, q: 11_000 };
                measurement.state.current_reference = (q * libm::exp(-f64::from(k.saturating_sub(200)) / 10.0)) as i32;
                phases.look(&measurement, false, INDUCED)
            });
            assert_eq!(fault, None, "{turns} {q}");
        }
    }

    /// At the limit of the voltage, the current cannot follow.
    #[test]
    fn a_current_that_the_voltage_cannot_drive_is_not_missed() {
        let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(4));
        for k in 0..1000 {
            let mut measurement = MOTOR.measurement(k, &mut random);
            measurement.state.current_reference = 30_000;
            measurement.state.voltage = Dq { d: 0, q: 11_000 };
            assert_eq!(phases.look(&measurement, false, INDUCED), None);
        }
    }

    /// At rest the limit of the voltage drives some current, if little: none at all is what no amplifier shows.
    #[test]
    fn all_of_the_voltage_at_rest_drives_a_current() {
        for (flows, fault) in [(0.0, Some(Fault::CurrentModel)), (200.0, None)] {
            let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(5));
            let found = (0..4).find_map(|k| {
                let mut measurement = Motor { q: flows, turns: 0.0, ..MOTOR }.measurement(k, &mut random);
                measurement.state.current_reference = 30_000;
                measurement.state.voltage = Dq { d: 0, q: 11_000 };
                phases.look(&measurement, false, 0)
            });
            assert_eq!(found, fault);
        }
    }
}
