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
        if due.iter().any(|due| *due < most / 2 || *due < COUNT * LEAST / 2) {
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
