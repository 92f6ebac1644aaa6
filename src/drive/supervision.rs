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
use crate::control::current::PARK_BITS;
use crate::fault::Fault;
use crate::hall::track::Tracker;
use crate::math::high;
use crate::schedule::coarse;
use crate::telemetry::State;

/// Parts of the supervision.
pub(crate) const PARTS: u8 = 8;
/// Steps from a change of the current's reference to a measurement, in which the current follows.
pub(crate) const SETTLING: u32 = 6;
/// Checks that show the back-EMF of a right commutation.
const PROOF: u8 = 4;
/// Current below which it tells nothing of the torque, in 2⁻¹⁵ of the full scale.
const QUIET: i32 = 32;
/// Checks for which the tracked speed may go on rising when the torque has turned.
const LAG: u8 = 3;
/// Checks without a current after which none is expected any more.
const NO_CURRENT: u8 = 4;
/// Multiple of the speed of a rotor that turns, from which on it is fast: 48 Hz electrical.
const FAST: i32 = 16;
/// Checks by which a wrong commutation is found that turns a rotor from rest.
const SOON: u8 = 6;
/// The work of some turns by the largest current, over the current that makes a torque plain, as a power of two.
const WORK: u32 = 14;
/// Checks that may find the rotor turning when a stop has had its time.
const UNSTOPPED: u8 = 2;

/// What is counted from check to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Supervision {
    /// Parts done so far.
    part: u8,
    /// Checks that have shown a right commutation, up to [`PROOF`].
    proofs: u8,
    /// Sum of the currents against the motion, and how many; the speed before, and the least one.
    braking: i32,
    braked: u8,
    before_speed: i32,
    slowest: i32,
    /// Since the rotor turned back: the speed at first, and the work of the currents that drove it.
    first_speed: i32,
    work: i32,
    /// The current before the last change of its reference before a measurement, in 2⁻²⁸ of the full scale.
    pub before: Dq,
    /// What the check of the model has noted, part by part: voltage, current, and by how much that has changed since, along the
    /// axis where it was more.
    voltage: Dq,
    current: Dq,
    change: i32,
    /// Checks in a row that found no current.
    without_current: u8,
    /// Back-EMF along q and the one that there should have been, when last a current flowed or none was asked for.
    before_emf: i32,
    before_expected: i32,
    /// Reference of the current along q, and how much it has changed since the check before.
    reference: i32,
    reference_change: u16,
    /// What the current along q misses of its reference, now and at the check before.
    missing: i32,
    missing_before: i32,
    /// Voltage that the proportional control has for what is missing now and was not before.
    voltage_ahead: i32,
    /// Whether the current is nearer to its reference than half of that.
    follows: bool,
    speed: i32,
    /// The voltage less what drops at resistance and inductance, and the back-EMF of the speed.
    emf: Dq,
    expected: i32,
    /// What drops at the resistance.
    dropped: i32,
    /// How much of the voltage is beyond what the model allows, if positive.
    unexplained: i32,
    /// Unexplained voltage, summed up.
    misfit: i32,
    /// Sum of the currents against the motion at which to look again at a rotor that got faster meanwhile; how much faster it was.
    looked: i32,
    gained: i32,
    /// Checks with a speed far from its reference.
    late: u16,
    /// Checks since a stop, and those after its time that found the rotor turning.
    stopping: u16,
    unstopped: u8,
}

/// Whether the rotor is outside of its bounds by more than it may be from its reference.
pub(super) fn is_outside(motion: &Motion, rotor: &Tracker) -> bool {
    let position = coarse(rotor.position()).to_bits();
    let [least, most] = motion.bounds;
    position < least - motion.far || position > most + motion.far
}

/// A product of a current, of 16 bits, with a factor in 2⁻¹⁶.
#[inline(always)]
const fn times(current: i32, factor: i32) -> i32 {
    high(current << 16, factor)
}

impl Supervision {
    /// Nothing is known yet.
    pub const NONE: Self = Self {
        part: 0,
        proofs: 0,
        braking: 0,
        braked: 0,
        before_speed: 0,
        slowest: 0,
        looked: 0,
        gained: 0,
        first_speed: 0,
        work: 0,
        voltage: Dq::ZERO,
        current: Dq::ZERO,
        before: Dq::ZERO,
        change: 0,
        without_current: 0,
        before_emf: 0,
        before_expected: 0,
        reference: 0,
        reference_change: 0,
        missing: 0,
        missing_before: 0,
        voltage_ahead: 0,
        follows: true,
        speed: 0,
        emf: Dq::ZERO,
        expected: 0,
        dropped: 0,
        unexplained: i32::MIN / 2,
        misfit: 0,
        late: 0,
        stopping: 0,
        unstopped: 0,
    };

    /// Nothing is known yet, but what was: a commutation that was right is right for a rotor that has turned since.
    pub const fn begin_again(&mut self) {
        *self = Self { proofs: self.proofs, ..Self::NONE };
    }

    /// The commutation has been seen to turn the rotor the right way.
    pub fn prove(&mut self) {
        self.proofs = PROOF;
    }

    /// Whether the commutation is right has to be seen anew.
    pub const fn doubt(&mut self) {
        (self.proofs, self.work) = (0, 0);
    }

    /// Whether it has been seen to be right.
    #[inline(always)]
    pub const fn is_proven(&self) -> bool {
        self.proofs >= PROOF
    }

    /// The next part of the supervision.
    #[inline(always)]
    pub const fn next_part(&mut self) -> u8 {
        self.part = self.part.wrapping_add(1);
        self.part % PARTS
    }

    /// Whether the rotor turns against the torque, faster and faster, though nothing has shown that the commutation is
    /// right. A rotor that brakes becomes slower.
    #[inline(always)]
    pub fn turns_against(&mut self, motion: &Motion, current: i32, speed: i32) -> Option<Fault> {
        let turned_back = (speed ^ self.before_speed) < 0;
        self.before_speed = speed;
        let (braking, speed) = if speed < 0 { (current, -speed) } else { (-current, speed) };
        if braking < 2 * QUIET || turned_back {
            // It is driven, or nothing flows but what the amplifiers' noise and offsets show.
            (self.braking, self.braked) = (0, 0);
            (self.looked, self.gained) = (motion.impulse, 0);
            self.turns_along(motion, -braking, speed, turned_back);
            return None;
        }
        self.braking = self.braking.saturating_add(braking);
        self.braked = self.braked.saturating_add(1);
        self.slowest = if self.braked <= LAG { speed } else { self.slowest.min(speed) };
        // An angle that uneven magnets mislead makes the measured speed swing in proportion to itself, by up to two thirds
        // from its least to its largest. With a wrong commutation a rotor does not come to be fast, or to brake for long,
        // without having been found out.
        let lasts = self.braked > SOON || self.slowest > FAST * motion.turning_speed;
        let swing = if lasts { self.slowest } else { (self.slowest >> 2) + (self.slowest >> 3) };
        let gained = speed - self.slowest;
        if gained <= motion.turning_speed + swing || self.braking <= self.looked {
            return None;
        }
        self.is_turned_by(braking, gained).then_some(Fault::Commutation)
    }

    /// Whether the current turns a rotor that got faster against it. A load that was let go, as by a brake, does so as well,
    /// while the current is still rising, but by less and less; a wrong commutation by as much as the current has done.
    #[cfg_attr(not(feature = "small"), cold, inline(never))]
    #[cfg_attr(feature = "small", inline(always))]
    fn is_turned_by(&mut self, current: i32, gained: i32) -> bool {
        self.looked = self.braking << 1;
        match core::mem::replace(&mut self.gained, gained) {
            0 => current * i32::from(self.braked) <= self.braking + (self.braking >> 2),
            before => (gained >> 3) * 5 > before,
        }
    }

    /// A rotor that has become more than twice as fast by the work of some turns shows that the commutation is right: a
    /// wrong one lets it swing about where it has no torque, or brakes it.
    #[cfg_attr(not(feature = "small"), cold, inline(never))]
    #[cfg_attr(feature = "small", inline(always))]
    fn turns_along(&mut self, motion: &Motion, current: i32, speed: i32, turned_back: bool) {
        let before = if turned_back { 0 } else { self.work };
        self.first_speed = if before <= 0 { speed } else { self.first_speed };
        self.work = before.saturating_add(current * (speed >> 16));
        if self.work > motion.impulse << WORK && speed >> 1 > self.first_speed + motion.turning_speed {
            self.prove();
        }
    }

    /// Whether the rotor is too far from its speed for too long.
    #[inline(always)]
    pub fn is_late(&mut self, motion: &Motion, speed_error: i32) -> Option<Fault> {
        let late = speed_error.saturating_abs() > motion.far_speed;
        self.late = if late { self.late + 1 } else { self.late.saturating_sub(4) };
        (self.late > motion.late).then_some(Fault::FollowingError)
    }

    /// No speed is commanded, or none that the rotor is far from.
    #[inline(always)]
    pub fn is_in_time(&mut self) {
        self.late = 0;
    }

    /// Whether a stop has not come to rest in its time.
    #[inline(always)]
    pub fn stops(&mut self, motion: &Motion, stopping: bool, speed: i32) -> Option<Fault> {
        if !stopping {
            self.stop_again();
            return None;
        }
        self.stopping = self.stopping.saturating_add(1);
        let turns = self.stopping > motion.stop && speed.saturating_abs() > motion.turning_speed;
        self.unstopped = if turns { self.unstopped + 1 } else { self.unstopped.saturating_sub(1) };
        (self.unstopped > UNSTOPPED).then_some(Fault::NotStopped)
    }

    /// Gives a stop its time once more.
    pub fn stop_again(&mut self) {
        (self.stopping, self.unstopped) = (0, 0);
    }

    /// Whether there has been no current for so long that none is expected any more.
    #[inline(always)]
    const fn is_without_current(&self) -> bool {
        self.without_current > NO_CURRENT
    }

    /// Whether the commutation may be wrong, and a current may flow that turns the rotor the wrong way: at the last check
    /// there was one, or none was asked for.
    #[inline(always)]
    pub const fn is_unsure(&self) -> bool {
        !self.is_proven() && (self.without_current == 0 || self.follows)
    }

    /// Whether a current is asked for and none comes.
    #[inline(always)]
    const fn misses_its_current(&self) -> bool {
        self.is_without_current() && !self.follows
    }

    /// The current has a new way to go: all that is missing of it may be on its way.
    pub const fn begin_following(&mut self) {
        self.missing_before = 0;
    }

    /// First part of the check of the model: what was noted last.
    #[inline(always)]
    pub fn note(&mut self, state: &State, speed: i32) {
        (self.voltage, self.current, self.speed) = (state.voltage, state.current, speed);
        let [d, q] = [state.current.d - (self.before.d >> PARK_BITS), state.current.q - (self.before.q >> PARK_BITS)];
        self.change = d.abs().max(q.abs());
        let reference = state.current_reference;
        self.missing = reference - state.current.q;
        self.reference_change = (reference - self.reference).unsigned_abs() as u16;
        self.reference = reference;
        self.follows = self.missing.abs() <= reference.abs() / 2 + 2 * QUIET;
    }

    /// Second part: the voltage that is left for the back-EMF, and the one that is ahead of its current.
    #[inline(always)]
    pub fn note_emf(&mut self, model: &Model) {
        // What was missing at the last check, too, does not come; what has changed since does.
        let before = core::mem::replace(&mut self.missing_before, self.missing);
        let newly_missing = (self.missing - before).abs().min(32_767);
        self.voltage_ahead = times(newly_missing, model.proportional);
        let (v, i) = (self.voltage, self.current);
        let reactance = high(self.speed, model.reactance);
        self.emf = Dq {
            d: v.d - times(i.d, model.resistance) + times(i.q, reactance),
            q: v.q - times(i.q, model.resistance) - times(i.d, reactance),
        };
    }

    /// Third part: what the motor should induce, and what resistance takes.
    #[inline(always)]
    pub fn note_motor(&mut self, model: &Model) {
        let (d, q) = (self.current.d.abs(), self.current.q.abs());
        self.expected = high(self.speed, model.flux);
        // A voltage for a current that was just asked for is ahead of it where the inductance is large. It is not for one
        // that never comes.
        let ahead = if self.is_without_current() { 0 } else { i32::from(self.reference_change / 2) };
        let current = d.max(q) + d.min(q) / 2 + ahead;
        self.dropped = times(current.min(32_767), model.resistance);
    }

    /// Fourth part: what may be wrong. The back-EMF may be as much off as it is large, and the resistance three times as
    /// large; a current that changes by more than its noise needs a voltage for it, as while a torque is asked for to and fro, and
    /// one that was just asked for has it already.
    #[inline(always)]
    pub fn explain(&mut self, model: &Model) {
        let change = times((self.change - 4 * QUIET).clamp(0, 32_767), model.change);
        self.unexplained = -(model.dead + 2 * self.dropped + self.expected.abs() + change + self.voltage_ahead);
    }

    /// Fifth part: what is unexplained. A back-EMF in the right direction may be several times as large as it
    /// should be, or as large as it likes where the current follows its reference: the flux linkage may not be known
    /// yet.
    #[inline(always)]
    pub fn compare(&mut self, model: &Model) {
        let (along, expected) =
            if self.expected < 0 { (-self.emf.q, -self.expected) } else { (self.emf.q, self.expected) };
        let off = along - expected;
        let along_q = match off {
            ..=0 => -off,
            _ if self.follows => 0,
            _ => off - 4 * expected,
        };
        self.unexplained += self.emf.d.abs().max(along_q);
        // One look, in the moment in which a current is asked for, is not enough.
        self.unexplained = self.unexplained.min(model.most);
    }

    /// Sixth part: sums it up. Where a current is asked for and none comes, all of the voltage is back-EMF: what of it has
    /// changed since then though the speed has not, or lies across, is unexplained, and nothing makes up for what was
    /// wrong before.
    #[inline(always)]
    pub fn sum_up(&mut self, model: &Model) {
        let Self { current, emf, expected, before_emf, before_expected, .. } = *self;
        let flows = current.d.abs().max(current.q.abs()) >= 2 * QUIET;
        self.without_current = if flows { 0 } else { self.without_current.saturating_add(1) };
        if self.misses_its_current() {
            let changed =
                (emf.q - before_emf).abs() - 5 * (expected - before_expected).abs() - expected.abs() - model.dead;
            let across = emf.d.abs() - emf.q.abs() / 2 - model.dead / 2;
            self.unexplained = self.unexplained.max((changed - self.voltage_ahead).max(across).max(0));
        } else {
            (self.before_emf, self.before_expected) = (emf.q, expected);
        }
        self.misfit = (self.misfit + self.unexplained).clamp(0, 1 << 28);
    }

    /// Last part. A back-EMF along q, well above what may be wrong with it, shows that the commutation is right.
    #[inline(always)]
    pub fn judge(&mut self, model: &Model) -> Option<Fault> {
        let Self { emf, dropped, .. } = *self;
        let along = if self.speed < 0 { -emf.q } else { emf.q };
        let (across, expected) = (emf.d.abs(), self.expected.abs());
        if self.misfit > model.most {
            // A commutation that was right stays right. Without a current none turns the rotor, right or wrong.
            let unknown = !self.is_proven() && !self.is_without_current();
            let wrong = unknown && along < -(across >> 2) && expected > model.dead;
            return Some(if wrong { Fault::Commutation } else { Fault::CurrentModel });
        }
        if expected > 2 * model.dead + dropped && along > expected >> 1 && along > 2 * across {
            self.proofs = (self.proofs + 1).min(PROOF);
        }
        None
    }
}
