//! What a drive with current sensing does beside the current control, a share in each step so that none has to do everything.
//!
//! | step | every 8 steps: the [outer loops](OUTER), and what is urgent |
//! |---|---|
//! | 0, 1 | trajectory: what is left of the way, and the time since the last command; the next speed |
//! | 2 | position control; a command |
//! | 3 | sum of the currents, temperatures; the Halls compared with each other |
//! | 4 | speed control |
//! | 5, 7 | the next row of the other table |
//! | 6 | cogging, limit of the current |
//!
//! | row | every 32 steps: a [cycle](CYCLE) |
//! |---|---|
//! | 0 | bus voltage for the current control |
//! | 1, 5 | record |
//! | 2 | currents and voltages noted down, where the current has settled since the outer loops changed it |
//! | 3 | alignment |
//! | 4 | speed for the current control; stall |
//! | 6 | reduction of the largest current by the temperatures; over-speed |
//! | 7 | currents and voltages handed over |

use super::{Demand, Drive, Sample};
use crate::control::Speed;
use crate::fault::{Fault, Limits};
pub use crate::schedule::{CYCLE, OUTER};

/// The first step with a chance of a record.
const RECORD: u32 = 7;

impl Drive {
    /// The share of the slow work that belongs to this step. What is found wrong makes a running drive fail.
    #[inline(always)]
    pub(super) fn attend(&mut self, sample: &Sample) {
        self.tick = self.tick.wrapping_add(1);
        match self.tick % CYCLE {
            0 | 8 | 16 | 24 => self.look_ahead(),
            1 | 9 | 17 | 25 => self.go(),
            2 | 10 | 18 | 26 => self.chase(sample),
            3 | 11 | 19 | 27 => self.check(sample),
            4 | 12 | 20 | 28 => self.turn(),
            6 | 14 | 22 | 30 => self.choose(),
            5 => self.scale(sample),
            13 => self.note(sample),
            21 => self.induce(),
            29 => self.derate(sample),
            RECORD | 23 => self.record_served(sample),
            15 => self.refine(),
            _ => self.hand_over_served(),
        }
    }

    #[inline(never)]
    fn look_ahead(&mut self) {
        let Some(control) = &self.config.control else { return };
        self.servo.look_ahead(control);
        if self.servo.watch.is_silent(control) {
            self.silence();
        }
    }

    #[inline(never)]
    fn go(&mut self) {
        if let Some(control) = &self.config.control {
            self.servo.go(control);
        }
    }

    #[inline(never)]
    fn chase(&mut self, sample: &Sample) {
        if self.serves {
            self.receive(sample);
        }
        if let Some(control) = &self.config.control {
            self.servo.chase(control, &self.live.rotor);
        }
    }

    #[inline(never)]
    fn turn(&mut self) {
        if let Some(control) = &self.config.control {
            self.servo.turn(control, &self.live.rotor);
        }
    }

    #[inline(never)]
    fn choose(&mut self) {
        if let Some(control) = &self.config.control {
            self.servo.choose(control, &self.live.rotor, self.cogging.as_deref());
        }
    }

    #[inline(never)]
    fn check(&mut self, sample: &Sample) {
        self.compare(sample);
        let Some(control) = &self.config.control else { return };
        let watch = &mut self.servo.watch;
        if let Some(fault) = watch.balance(control, sample).or_else(|| watch.heat(control, sample)) {
            self.fail(fault);
        }
    }

    #[inline(never)]
    fn scale(&mut self, sample: &Sample) {
        if let Some(control) = &self.config.control {
            self.servo.scale(control, sample);
        }
    }

    #[inline(never)]
    fn induce(&mut self) {
        let Some(control) = &self.config.control else { return };
        let speed = self.live.rotor.speed();
        self.servo.induce(control, speed);
        if self.servo.stalls(control, speed) {
            self.fail(Fault::Stall);
        }
    }

    #[inline(never)]
    fn derate(&mut self, sample: &Sample) {
        let Some(control) = &self.config.control else { return };
        self.servo.watch.derate(control, sample, 0);
        self.servo.watch.derate(control, sample, 1);
        if self.is_too_fast() {
            self.fail(Fault::OverSpeed);
        }
    }

    #[inline(never)]
    fn refine(&mut self) {
        if let Some(control) = &self.config.control {
            self.servo.refine(control, self.live.rotor.speed());
        }
    }

    #[inline(never)]
    fn note(&mut self, sample: &Sample) {
        let Some(control) = &self.config.control else { return };
        let number = self.first.wrapping_add(self.tick);
        self.servo.note(control, &self.live.rotor, number, sample);
    }

    /// Compares the three Halls with each other; where they disagree, this step finds the angle as after a missed sample.
    #[inline(always)]
    fn compare(&mut self, sample: &Sample) {
        if let Some(estimator) = &self.serving
            && !estimator.agree(&sample.halls)
        {
            self.resting = self.serving.take();
        }
    }

    /// No command for too long.
    #[cold]
    #[inline(never)]
    fn silence(&mut self) {
        let Some(control) = &self.config.control else { return };
        if !control.guard.stops {
            self.fail(Fault::CommandTimeout);
        } else if !self.servo.limits.contains(Limits::TIMEOUT) && self.mode.drives() {
            self.servo.limits = self.servo.limits.with(Limits::TIMEOUT);
            self.servo.follow(control, Demand::Speed(Speed(0)), &self.live.rotor);
            self.publish();
        }
    }

    /// Begins or ceases to follow something. The schedule begins such that the next record, and so every one after it, is due in its slot;
    /// a slot comes before the angle is found, so a record there is of the step before.
    pub(super) fn serve_if(&mut self, serves: bool) {
        if serves && !self.serves {
            self.record_due = RECORD;
            self.state_due = RECORD;
            // A command does so before the step attends.
            self.tick = RECORD.wrapping_sub(self.until_record).wrapping_sub(2);
            self.first = self.live.sequence.wrapping_sub(RECORD);
        } else if self.serves && !serves {
            let next = self.tick.wrapping_add(1);
            self.until_record = (self.record_due.wrapping_sub(next) as i32).max(1) as u32;
            self.live.sequence = self.first.wrapping_add(next).wrapping_add(self.until_record);
        }
        self.serves = serves;
    }

    #[inline(always)]
    const fn is_due(&self, due: u32) -> bool {
        self.serves && due.wrapping_sub(self.tick) as i32 <= 0
    }

    #[inline(never)]
    fn record_served(&mut self, sample: &Sample) {
        if self.is_due(self.record_due) {
            self.record_due = self.record_due.wrapping_add(self.config.record_every);
            self.live.status = self.live.status.with_limits(self.limits());
            self.live.codes = sample.halls;
            self.live.sequence = self.first.wrapping_add(self.tick);
            let _ = self.channels.records.enqueue(self.live);
        }
    }

    #[inline(never)]
    fn hand_over_served(&mut self) {
        if self.is_due(self.state_due) {
            self.state_due = self.state_due.wrapping_add(self.config.record_every.next_multiple_of(CYCLE));
            self.hand_over();
        }
    }

    /// Currents and voltages as noted last.
    #[inline(always)]
    pub(super) fn hand_over(&mut self) {
        let _ = self.channels.measurements.enqueue(self.servo.noted);
    }
}
