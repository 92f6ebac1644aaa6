//! An encoder whose place on the rotor's shaft is known.
//!
//! Once a task has found that encoder and Halls agree ([`AbsoluteTasks::count`](super::AbsoluteTasks::count)), the
//! drive's position counts from the encoder's zero. From then on every step compares the two, electrical turns included,
//! and a running drive fails where they disagree for longer than tolerated. If it
//! [closes the loops](Mounting::closes_loops), the rotor's position, angle and speed that the speed loop, the position
//! loop and the records see are tracked from the encoder. A step's own angle, by which it commutates, is still the
//! Halls', taken up once on top of that.

use super::Drive;
use crate::angle::{ElectricalAngle, MechanicalAngle, PolePairs, Position};
use crate::fault::Fault;
use crate::hall::track::Tracker;
use crate::mode::Mode;

/// How an encoder sits on the rotor's shaft, and what it is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mounting {
    /// Pole pairs of the motor.
    pub pole_pairs: PolePairs,
    /// Whether the encoder counts down where the drive counts up.
    pub reversed: bool,
    /// What the encoder shows where the position is to be zero.
    pub zero: MechanicalAngle,
    /// Electrical angle of the rotor there.
    pub offset: ElectricalAngle,
    /// How far the Halls may be from the encoder, less than half an electrical turn.
    pub tolerance: ElectricalAngle,
    /// Whether speed and position are controlled by the encoder; otherwise it only gives the count its start.
    pub closes_loops: bool,
    /// Whether a running drive that loses the encoder goes on by the Halls; otherwise that is a fault.
    pub falls_back: bool,
}

impl Mounting {
    /// The shaft's angle from the zero in the direction of the drive.
    #[inline(always)]
    pub const fn shaft(&self, encoder: MechanicalAngle) -> MechanicalAngle {
        let bits = encoder.to_bits().wrapping_sub(self.zero.to_bits());
        MechanicalAngle::from_bits(if self.reversed { bits.wrapping_neg() } else { bits })
    }

    /// Electrical position of the rotor within half a mechanical turn of the zero.
    #[inline(always)]
    pub const fn position(&self, encoder: MechanicalAngle) -> Position {
        let electrical = self.shaft(encoder).to_bits() as i64 * self.pole_pairs.get() as i64;
        Position::from_bits(electrical.wrapping_add(self.offset.to_bits() as i64))
    }

    /// Electrical position at the zero: what to take off before a position is told in mechanical turns.
    pub const fn origin(&self) -> Position {
        Position::from_angle(self.offset)
    }

    /// How far a position is from where the encoder says, beyond whole mechanical turns. Divides, so not for every step.
    pub const fn deviation(&self, encoder: MechanicalAngle, position: Position) -> i64 {
        let ahead = position.to_bits().wrapping_sub(self.position(encoder).to_bits());
        Position::from_bits(ahead).within_turn(self.pole_pairs).to_bits()
    }
}

/// The state of a mounted encoder.
pub(super) struct Mounted {
    pub mounting: Mounting,
    /// By the encoder.
    rotor: Tracker,
    /// By the Halls alone, counted since the count began.
    halls: Position,
    /// Whether the position counts from the zero.
    pub absolute: bool,
    /// Whether the count is to begin as soon as the bridge is off.
    count_due: bool,
    /// The encoder has had no angle for longer than tolerated; the Halls carry the count on.
    lost: bool,
    /// Successive steps in which encoder and Halls disagree.
    apart: u16,
}

impl Mounted {
    pub const fn new(mounting: Mounting) -> Self {
        Self {
            mounting,
            rotor: Tracker::at(ElectricalAngle::ZERO),
            halls: Position::from_bits(0),
            absolute: false,
            count_due: false,
            lost: false,
            apart: 0,
        }
    }

    pub const fn count(&mut self) {
        self.count_due = true;
    }

    /// After the drive's own step: `before` is the rotor's position before it, `missed` counts the successive samples
    /// without an angle. A fault, if encoder and Halls disagree.
    #[inline(always)]
    pub fn step(
        &mut self,
        drive: &mut Drive,
        before: Position,
        angle: Option<MechanicalAngle>,
        missed: u16,
    ) -> Option<Fault> {
        if !self.absolute {
            self.wait(drive, angle);
            return None;
        }
        let by_halls = drive.record.rotor.position();
        let moved = by_halls.to_bits().wrapping_sub(before.to_bits());
        if is_open_loop(drive) || moved.wrapping_add(1 << 31) as u64 >= 1_u64 << 32 {
            // The count was begun anew.
            self.absolute = false;
            return None;
        }
        self.halls = self.halls.advance_to(by_halls.angle());
        match angle {
            Some(angle) if !self.lost => {
                // The encoder has checked the step already.
                let _ = self.rotor.step(&drive.config.tracking, self.mounting.position(angle).angle());
            }
            None if missed <= drive.config.tolerated && !self.lost => self.rotor.coast(),
            _ => {
                self.do_without(drive, angle);
                return None;
            }
        }
        if self.mounting.closes_loops {
            drive.record.rotor = self.rotor;
        }
        self.check(drive)
    }

    /// Compares the counts of encoder and Halls.
    #[inline(always)]
    fn check(&mut self, drive: &Drive) -> Option<Fault> {
        let apart = self.rotor.position().to_bits().wrapping_sub(self.halls.to_bits());
        let tolerance = self.mounting.tolerance.to_bits() as i64;
        if apart.wrapping_add(tolerance) as u64 <= 2 * tolerance as u64 {
            self.apart = 0;
            return None;
        }
        self.disagree(drive)
    }

    #[cold]
    fn disagree(&mut self, drive: &Drive) -> Option<Fault> {
        self.apart = self.apart.saturating_add(1);
        if self.apart <= drive.config.tolerated {
            return None;
        }
        // Which of the two is wrong is not known: the count is not to be trusted any more.
        self.absolute = false;
        self.apart = 0;
        Some(Fault::Turns)
    }

    /// Not absolute yet: begins to count when told to, with the bridge off.
    #[cold]
    #[inline(never)]
    fn wait(&mut self, drive: &mut Drive, angle: Option<MechanicalAngle>) {
        let Some(angle) = angle.filter(|_| self.count_due) else { return };
        if drive.mode.drives() || drive.estimator.is_none() || drive.record.missed != 0 {
            return;
        }
        self.count_due = false;
        let here = drive.record.rotor.position();
        let ahead = self.mounting.position(angle).to_bits().wrapping_sub(here.to_bits());
        let turns = ahead.wrapping_add(1 << 31) >> 32;
        if turns != 0 {
            drive.record.rotor.count_on(turns << 32);
            drive.forget_pole();
        }
        self.rotor = drive.record.rotor;
        self.halls = self.rotor.position();
        (self.absolute, self.lost, self.apart) = (true, false, 0);
    }

    /// Without the encoder: the Halls carry the count on. It is taken up again where it fits what they have counted.
    #[cold]
    #[inline(never)]
    fn do_without(&mut self, drive: &Drive, angle: Option<MechanicalAngle>) {
        self.lost = true;
        self.rotor = drive.record.rotor;
        self.halls = self.rotor.position();
        if let Some(angle) = angle {
            let apart = self.mounting.deviation(angle, self.halls).unsigned_abs();
            self.lost = apart > u64::from(self.mounting.tolerance.to_bits().unsigned_abs());
        }
    }

    /// Whether the encoder is in use.
    pub const fn is_used(&self) -> bool {
        self.absolute && !self.lost
    }
}

/// Whether the rotor's place is that of the field.
const fn is_open_loop(drive: &Drive) -> bool {
    matches!(drive.mode, Mode::Aligning | Mode::Calibrating) || drive.estimator.is_none()
}
