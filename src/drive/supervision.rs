//! Supervision of the motion of a drive with current sensing: does the rotor do what it is driven to do, and do voltages
//! and currents belong to the motor of the settings?
//!
//! | danger | found by |
//! |---|---|
//! | wrong commutation: wires, Halls or a calibration of another motor | the rotor turns against the torque, and faster and faster, before the back-EMF has shown that the commutation is right |
//! | an open phase, a blind amplifier | voltages that resistance, inductance and back-EMF do not explain |
//! | the rotor does not follow | too far from its reference |
//! | outside of the position bounds | the position |
//! | a stop that does not come to rest | time |

use crate::commutation::frames::Dq;
use crate::control::config::{Model, Motion};
use crate::fault::Fault;
use crate::hall::track::Tracker;
use crate::math::high;
use crate::schedule::OUTER;
use crate::telemetry::State;

/// Checks that show the back-EMF of a right commutation.
const PROOF: u32 = 4;
/// Checks that find the rotor turning after a stop.
const TURNING: u32 = 2;

/// What is counted from check to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Supervision {
    /// Checks in a row that have shown a right commutation, up to [`PROOF`].
    proofs: u32,
    /// Position at the last check, way against the torque and least speed on it.
    position: i64,
    against: i64,
    slowest: i32,
    /// What the check of the model has noted: currents, their change since the last check, speed, the voltage less that
    /// at resistance and inductance, the back-EMF that there should be, and what may be wrong with all that.
    current: Dq,
    changed: i32,
    speed: i32,
    emf: Dq,
    expected: i32,
    dropped: i32,
    explained: i32,
    /// Unexplained voltage, summed up.
    misfit: i32,
    /// Checks with a speed far from its reference.
    late: u32,
    /// Checks since a stop, and those after its time that found the rotor turning.
    stopping: u32,
    turning: u32,
}

/// Whether the rotor is outside of its bounds by more than it may be from its reference.
pub(super) fn is_outside(motion: &Motion, rotor: &Tracker) -> bool {
    let position = rotor.position().to_bits() >> OUTER.ilog2();
    let [least, most] = motion.bounds;
    position < least - motion.far || position > most + motion.far
}

/// A product of a current or a speed with a factor in 2⁻¹⁶.
#[inline(always)]
const fn times(current: i32, factor: i32) -> i32 {
    ((current as i64 * factor as i64) >> 16) as i32
}

impl Supervision {
    /// Nothing is known yet.
    pub const NONE: Self = Self {
        proofs: 0,
        position: 0,
        against: 0,
        slowest: i32::MAX,
        current: Dq { d: 0, q: 0 },
        changed: 0,
        speed: 0,
        emf: Dq { d: 0, q: 0 },
        expected: 0,
        dropped: 0,
        explained: i32::MAX / 2,
        misfit: 0,
        late: 0,
        stopping: 0,
        turning: 0,
    };

    /// The commutation has been seen to turn the rotor the right way.
    pub fn prove(&mut self) {
        self.proofs = PROOF;
    }

    /// Whether the rotor turns against the torque, faster and faster, though nothing has shown that the commutation is
    /// right. A rotor that brakes becomes slower.
    #[inline(always)]
    pub fn turns_against(&mut self, motion: &Motion, current: i32, rotor: &Tracker) -> Option<Fault> {
        let position = rotor.position().to_bits();
        let way = position.wrapping_sub(self.position);
        self.position = position;
        if self.proofs >= PROOF || current.abs() < motion.current {
            return None;
        }
        let against = if current < 0 { way } else { -way };
        self.against = (self.against + against).clamp(0, 2 * motion.wrong_way);
        let speed = rotor.speed().saturating_abs();
        self.slowest = if self.against == 0 { i32::MAX } else { self.slowest.min(speed) };
        let faster = speed > self.slowest.saturating_add(motion.turning);
        (self.against > motion.wrong_way && faster).then_some(Fault::Commutation)
    }

    /// Whether the rotor is too far from its position, or for too long from its speed.
    #[inline(always)]
    pub fn is_late(&mut self, motion: &Motion, position_error: i64, speed_error: i32) -> Option<Fault> {
        let late = speed_error.saturating_abs() > motion.far_speed;
        self.late = if late { self.late + 1 } else { self.late.saturating_sub(4) };
        let far = position_error.unsigned_abs() > motion.far as u64;
        (far || self.late > motion.late).then_some(Fault::FollowingError)
    }

    /// Whether a stop has not come to rest in its time.
    #[inline(always)]
    pub fn stops(&mut self, motion: &Motion, stopping: bool, speed: i32) -> Option<Fault> {
        if !stopping {
            self.stop_again();
            return None;
        }
        self.stopping = self.stopping.saturating_add(1);
        let turns = self.stopping > motion.stop && speed.saturating_abs() > motion.turning;
        self.turning = if turns { self.turning + 1 } else { self.turning.saturating_sub(1) };
        (self.turning > TURNING).then_some(Fault::NotStopped)
    }

    /// Gives a stop its time once more.
    pub fn stop_again(&mut self) {
        (self.stopping, self.turning) = (0, 0);
    }

    /// First part of the check of the model: the voltage that is left for the back-EMF.
    #[inline(always)]
    pub fn note_emf(&mut self, model: &Model, state: &State, speed: i32) {
        let (v, i) = (state.voltage, state.current);
        let reactance = high(speed, model.reactance);
        self.emf = Dq {
            d: v.d - times(i.d, model.resistance) + times(i.q, reactance),
            q: v.q - times(i.q, model.resistance) - times(i.d, reactance),
        };
        self.changed = (i.d - self.current.d).abs().max((i.q - self.current.q).abs());
        (self.current, self.speed) = (i, speed);
    }

    /// Second part: what the motor should induce, and what may be wrong with it. The back-EMF may be as much off as it
    /// is large, and the resistance three times as large.
    #[inline(always)]
    pub fn explain(&mut self, model: &Model) {
        let (d, q) = (self.current.d.abs(), self.current.q.abs());
        self.expected = high(self.speed, model.flux);
        self.dropped = times(d.max(q) + d.min(q) / 2, model.resistance);
        let change = times(self.changed, model.change);
        self.explained = model.dead + 2 * self.dropped + self.expected.abs() + change;
    }

    /// Last part: sums up what is unexplained. A back-EMF along q, well above what may be wrong with it, shows that the
    /// commutation is right.
    #[inline(always)]
    pub fn check_model(&mut self, model: &Model) -> Option<Fault> {
        let Self { emf, expected, dropped, explained, .. } = *self;
        let unexplained = emf.d.abs().max((emf.q - expected).abs());
        self.misfit = (self.misfit + unexplained - explained).clamp(0, 1 << 28);
        let along = if self.speed < 0 { -emf.q } else { emf.q };
        let expected = expected.abs();
        let clear = expected > 2 * model.dead + dropped && along > expected / 2 && along > 2 * emf.d.abs();
        self.proofs = if clear { (self.proofs + 1).min(PROOF) } else { self.proofs };
        if self.misfit <= model.most {
            return None;
        }
        let wrong = along < -(emf.d.abs() / 4) && expected > model.dead;
        Some(if wrong { Fault::Commutation } else { Fault::CurrentModel })
    }
}
