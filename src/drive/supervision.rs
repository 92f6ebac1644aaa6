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
use crate::math::high;
use crate::schedule::OUTER;
use crate::telemetry::State;

/// Successive checks that show the back-EMF of a right commutation.
const PROOF: u32 = 8;

/// What the motion is judged by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Reference of the current along q, in 2⁻¹⁵ of the full scale.
    pub current: i32,
    /// Speed and position as measured, in 2⁻³² electrical turns a step and 2⁻³² electrical turns.
    pub speed: i32,
    pub position: i64,
    /// Reference less measured: the speed, if one is followed; the position in the unit of the outer loops, if one is
    /// followed.
    pub speed_error: i32,
    pub position_error: i64,
    /// Whether the drive stops for want of a command.
    pub stopping: bool,
}

impl Seen {
    /// Whether the rotor is outside of its bounds by more than it may be from its reference.
    pub fn is_outside(&self, motion: &Motion) -> bool {
        let position = self.position >> OUTER.ilog2();
        let [least, most] = motion.bounds;
        position < least - motion.far || position > most + motion.far
    }
}

/// What is counted from check to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Supervision {
    /// Checks in a row that have shown a right commutation, up to [`PROOF`].
    proofs: u32,
    /// Position at the last check, way against the torque and least speed on it.
    position: i64,
    against: i64,
    slowest: i32,
    /// Unexplained voltage, summed up, and the currents of the last check.
    misfit: i32,
    current: Dq,
    /// Checks with a speed far from its reference.
    late: u32,
    /// Checks since a stop, and those after its time that found the rotor turning.
    stopping: u32,
    turning: u32,
}

impl Supervision {
    /// Nothing is known yet.
    pub const NONE: Self = Self {
        proofs: 0,
        position: 0,
        against: 0,
        slowest: i32::MAX,
        misfit: 0,
        current: Dq { d: 0, q: 0 },
        late: 0,
        stopping: 0,
        turning: 0,
    };

    /// The commutation has been seen to turn the rotor the right way.
    pub fn prove(&mut self) {
        self.proofs = PROOF;
    }

    const fn is_proven(&self) -> bool {
        self.proofs >= PROOF
    }

    /// The motion since the last check.
    #[inline(never)]
    pub fn check_motion(&mut self, motion: &Motion, seen: &Seen) -> Option<Fault> {
        self.turns_against(motion, seen)
            .or_else(|| self.is_late(motion, seen))
            .or_else(|| seen.is_outside(motion).then_some(Fault::PositionBounds))
            .or_else(|| self.stops(motion, seen))
    }

    /// Whether the rotor turns against the torque, faster and faster, though nothing has shown that the commutation is
    /// right. A rotor that brakes becomes slower.
    fn turns_against(&mut self, motion: &Motion, seen: &Seen) -> Option<Fault> {
        let way = seen.position.wrapping_sub(self.position);
        self.position = seen.position;
        if self.is_proven() || seen.current.abs() < motion.current {
            return None;
        }
        let against = if seen.current < 0 { way } else { -way };
        self.against = (self.against + against).clamp(0, 2 * motion.wrong_way);
        let speed = seen.speed.saturating_abs();
        self.slowest = if self.against == 0 { i32::MAX } else { self.slowest.min(speed) };
        let faster = speed > self.slowest.saturating_add(motion.turning);
        (self.against > motion.wrong_way && faster).then_some(Fault::Commutation)
    }

    /// Whether the rotor is too far from its position, or for too long from its speed.
    fn is_late(&mut self, motion: &Motion, seen: &Seen) -> Option<Fault> {
        let late = seen.speed_error.saturating_abs() > motion.far_speed;
        self.late = if late { self.late + 1 } else { self.late.saturating_sub(4) };
        let far = seen.position_error.unsigned_abs() > motion.far as u64;
        (far || self.late > motion.late).then_some(Fault::FollowingError)
    }

    /// Whether a stop has not come to rest in its time.
    fn stops(&mut self, motion: &Motion, seen: &Seen) -> Option<Fault> {
        if !seen.stopping {
            (self.stopping, self.turning) = (0, 0);
            return None;
        }
        self.stopping = self.stopping.saturating_add(1);
        let turns = self.stopping > motion.stop && seen.speed.saturating_abs() > motion.turning;
        self.turning = if turns { self.turning + 1 } else { self.turning.saturating_sub(1) };
        (self.turning > PROOF).then_some(Fault::NotStopped)
    }

    /// Gives a stop its time once more.
    pub fn stop_again(&mut self) {
        (self.stopping, self.turning) = (0, 0);
    }

    /// Voltages and currents against the motor's model, as noted last.
    #[inline(never)]
    pub fn check_model(&mut self, model: &Model, state: &State, speed: i32) -> Option<Fault> {
        let (v, i) = (state.voltage, state.current);
        let drop = |current: i32| ((i64::from(current) * i64::from(model.resistance)) >> 16) as i32;
        let reactance = high(speed, model.reactance);
        let coupled = |current: i32| ((i64::from(current) * i64::from(reactance)) >> 16) as i32;
        let emf = Dq { d: v.d - drop(i.d) + coupled(i.q), q: v.q - drop(i.q) - coupled(i.d) };
        let expected = high(speed, model.flux);
        let changed = (i.d - self.current.d).abs().max((i.q - self.current.q).abs());
        self.current = i;
        let flowing = i.d.abs().max(i.q.abs()) + i.d.abs().min(i.q.abs()) / 2;
        let change = ((i64::from(changed) * i64::from(model.change)) >> 16) as i32;
        // The settings may be wrong by as much as they say, and the resistance three times as large.
        let explained = model.dead + 2 * drop(flowing) + coupled(flowing).abs() + expected.abs() + change;
        let unexplained = emf.d.abs().max((emf.q - expected).abs());
        self.misfit = (self.misfit + unexplained - explained).clamp(0, 1 << 28);
        // A right commutation: the back-EMF lies along q, and is well above what may be wrong with it.
        let along = if speed < 0 { -emf.q } else { emf.q };
        let clear = expected.abs() > 2 * (model.dead + drop(flowing) / 2);
        if clear && along > expected.abs() / 2 && along > 2 * emf.d.abs() {
            self.proofs = (self.proofs + 1).min(PROOF);
        }
        let wrong = along < -emf.d.abs() / 4;
        (self.misfit > model.most).then_some(if wrong { Fault::Commutation } else { Fault::CurrentModel })
    }
}
