//! Does each phase carry its share of the current? Watched over some tenths of a second while the motor turns, from the
//! currents that the drive notes, so it also finds what opens while running.

use crate::angle::ElectricalAngle;
use crate::fault::Fault;
use crate::telemetry::Measurement;

/// Measurements that a verdict takes.
const COUNT: u32 = 48;
/// Least mean current that is no noise, in 2⁻¹⁵ of the full scale.
const LEAST: u32 = 160;

/// Sums over the measurements since the last verdict.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Phases {
    count: u32,
    /// Of the current that flowed in each phase, and of that which should have, for the length of the whole.
    flowed: [u32; 3],
    due: [u32; 3],
}

impl Phases {
    /// Takes a measurement in. A phase that carried less than a quarter of its share, while the rotor has turned so that
    /// all three had theirs, is open.
    pub fn look(&mut self, measurement: &Measurement) -> Option<Fault> {
        let state = &measurement.state;
        let (d, q) = (state.current.d.unsigned_abs(), state.current.q.unsigned_abs());
        let length = d.max(q) + d.min(q) * 3 / 8;
        let angle = measurement.rotor.angle() + measurement.trim;
        for phase in 0..3 {
            let share = along_q(angle, phase as i32);
            self.flowed[phase] = self.flowed[phase].saturating_add(state.phases[phase].unsigned_abs());
            self.due[phase] = self.due[phase].saturating_add((length.min(65_535) * share) >> 14);
        }
        self.count += 1;
        if self.count < COUNT {
            return None;
        }
        let Self { flowed, due, .. } = core::mem::take(self);
        let most = due[0].max(due[1]).max(due[2]);
        // Seen at the same angles again and again, a current along d gives a phase less than its share.
        if due.iter().any(|due| *due < most - most / 4 || *due < COUNT * LEAST / 2) {
            return None;
        }
        let open = (0..3).find(|&phase| flowed[phase] < due[phase] / 4)?;
        Some([Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC][open])
    }
}

/// Share of a current along q that a phase carries, in 2⁻¹⁴.
fn along_q(angle: ElectricalAngle, phase: i32) -> u32 {
    const THIRD: i32 = 1_431_655_765;
    let from_phase = ElectricalAngle::from_bits(angle.to_bits().wrapping_sub(phase.wrapping_mul(THIRD)));
    (crate::trig::sin(from_phase).to_bits() >> 16).unsigned_abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commutation::frames::Dq;
    use crate::hall::track::Tracker;
    use crate::telemetry::State;
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
        /// Phase that carries no current.
        open: Option<usize>,
    }

    const MOTOR: Motor = Motor { d: 0.0, q: 3000.0, from: 0.1, turns: 0.03, open: None };
    const FAULTS: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];

    impl Motor {
        fn measurement(&self, k: u32, random: &mut Pcg64) -> Measurement {
            let turns = self.from + self.turns * f64::from(k);
            let angles = [0.0, 1.0, 2.0].map(|phase| TAU * (turns - phase / 3.0));
            let mut currents = angles.map(|angle| self.d * libm::cos(angle) - self.q * libm::sin(angle));
            if let Some(open) = self.open {
                // What flows into one of the other two comes out of the other.
                let half = currents[open] / 2.0;
                currents = currents.map(|current| current + half);
                currents[open] = 0.0;
            }
            let currents = currents.map(|current| current + random.random_range(-100.0..100.0));
            let along = |of: fn(f64) -> f64| (0..3).map(|k| currents[k] * of(angles[k])).sum::<f64>() / 1.5;
            let current = Dq { d: along(libm::cos) as i32, q: -along(libm::sin) as i32 };
            let state = State { phases: currents.map(|current| current as i32), current, ..State::NONE };
            // The frame of the currents is ahead of the rotor.
            let trim = ElectricalAngle::from_turns(0.02);
            let rotor = Tracker::at(ElectricalAngle::from_turns((turns - 0.02) as f32));
            Measurement { rotor, state, trim, ..Measurement::NONE }
        }

        /// The first fault in so many measurements.
        fn look(&self, measurements: u32) -> Option<Fault> {
            let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(1));
            (0..measurements).find_map(|k| phases.look(&self.measurement(k, &mut random)))
        }
    }

    #[test]
    fn a_phase_that_carries_nothing_is_named_whatever_the_direction_and_the_speed() {
        for (open, fault) in FAULTS.into_iter().enumerate() {
            for turns in [0.03, -0.03, 0.21, -1.17] {
                for (d, q) in [(0.0, 3000.0), (0.0, -3000.0), (-800.0, 1500.0), (0.0, 20_000.0)] {
                    let motor = Motor { d, q, turns, open: Some(open), ..MOTOR };
                    assert_eq!(motor.look(COUNT - 1), None);
                    assert_eq!(motor.look(4 * COUNT), Some(fault), "{motor:?}");
                }
            }
        }
    }

    #[test]
    fn a_phase_that_opens_while_the_motor_runs_is_named() {
        let (mut phases, mut random) = (Phases::default(), Pcg64::seed_from_u64(2));
        for k in 0..10 * COUNT {
            assert_eq!(phases.look(&MOTOR.measurement(k, &mut random)), None);
        }
        let broken = Motor { open: Some(1), ..MOTOR };
        let fault = (10 * COUNT..13 * COUNT).find_map(|k| phases.look(&broken.measurement(k, &mut random)));
        assert_eq!(fault, Some(Fault::OpenPhaseB));
    }

    #[test]
    fn a_motor_that_is_whole_is_none_whatever_current_flows() {
        let mut random = Pcg64::seed_from_u64(3);
        for _ in 0..2000 {
            let mut within = |range: f64| random.random_range(-range..range);
            let motor =
                Motor { d: within(8000.0), q: within(8000.0), from: within(1.0), turns: within(0.6), open: None };
            assert_eq!(motor.look(5 * COUNT), None, "{motor:?}");
        }
    }

    /// At rest a phase may have its share of nothing for ever; seen at the same angles again and again, a motor is at
    /// rest.
    #[test]
    fn a_rotor_that_stands_tells_nothing() {
        for open in [None, Some(0), Some(1), Some(2)] {
            for degree in 0..360 {
                for (turns, d, q) in
                    [(0.0, 0.0, 3000.0), (0.5, 0.0, 3000.0), (1.0, -3000.0, 0.0), (0.0, -3000.0, 900.0)]
                {
                    let motor = Motor { d, q, from: f64::from(degree) / 360.0, turns, open };
                    assert_eq!(motor.look(5 * COUNT), None, "{motor:?}");
                }
            }
        }
    }

    #[test]
    fn noise_is_no_current() {
        for open in [None, Some(0), Some(1), Some(2)] {
            assert_eq!(Motor { q: 20.0, open, ..MOTOR }.look(20 * COUNT), None);
        }
    }
}
