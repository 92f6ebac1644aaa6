//! The schedule of what a drive with current sensing does beside the current control: a part in each step, which keeps
//! the longest step short.
//!
//! [`Drive::attend`] is the table: the outer loops and what is urgent come every [`OUTER`] steps, the rest once in a
//! [`CYCLE`] or in a [`LONG`] one. A row is a slot; a step has exactly one, before the angle of the step is known.

use super::servo::{Context, Servo};
use super::{Demand, Drive, Paths, Route, Sample};
use crate::commutation::Commutation;
use crate::control::Speed;
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::schedule::LONG;
pub use crate::schedule::{CYCLE, OUTER};

/// Tick of the first slot that may hand over a record.
const RECORD: u32 = 7;

/// Tick of the slot that trims the alignment, every other time.
const ALIGNMENT: u32 = 15;

/// The present slot, and when records and measurements are due.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    /// Steps so far, wrapping; the slot is the remainder by [`LONG`].
    tick: u32,
    /// Whether records are handed over in slots: while a current, a speed or a position is followed.
    pub records: bool,
    /// Sequence number of the previous step, less the tick.
    first: u32,
    /// Tick of the next record, and of the next measurement.
    record_due: u32,
    measurement_due: u32,
}

impl Schedule {
    pub const fn new() -> Self {
        Self { tick: 0, records: false, first: 0, record_due: 0, measurement_due: 0 }
    }

    /// Goes on without this step's slot.
    pub const fn skip(&mut self) {
        self.tick = self.tick.wrapping_add(1);
    }

    /// Whether this step is number 0 to 7 of its group of [`OUTER`].
    #[cfg(not(feature = "no-chopper"))]
    #[inline(always)]
    pub const fn is_step(&self, number: u32) -> bool {
        self.tick % OUTER == number
    }

    /// Whether the next slot is the one that trims the alignment.
    pub const fn trims_next(&self) -> bool {
        self.tick.wrapping_add(1) % (2 * LONG) == ALIGNMENT
    }

    /// Whether this step's slot is one of those that may take up a command.
    pub const fn is_even(&self) -> bool {
        self.tick & 1 == 0
    }

    /// The rotor's position is looked at each fourth [`LONG`]: whether this is every other of these looks.
    #[inline(always)]
    pub const fn is_odd_part(&self) -> bool {
        (self.tick / LONG) & 4 != 0
    }

    #[inline(always)]
    const fn is_due(&self, due: u32) -> bool {
        self.records && due.wrapping_sub(self.tick) as i32 <= 0
    }

    /// Sequence number of the step whose angle is known in a slot: the previous one.
    const fn sequence(&self) -> u32 {
        self.first.wrapping_add(self.tick)
    }
}

impl Drive {
    /// Runs the slot of this step. A fault that it finds makes a running drive fail.
    ///
    /// Returns the estimator for the rest of a short step; `None` where the step has to go on as a general one.
    #[inline(always)]
    pub(super) fn attend(&mut self, sample: &Sample) -> Option<&Estimator> {
        let schedule = &mut self.servo.schedule;
        schedule.tick = schedule.tick.wrapping_add(1);
        match schedule.tick % LONG {
            // Every 8 steps.
            0 | 8 | 16 | 24 | 32 | 40 | 48 | 56 => return self.trajectory_slot(sample),
            1 | 9 | 17 | 25 | 33 | 41 | 49 | 57 => self.rare_slot(sample, |servo, _, with| {
                servo.advance_trajectory(with);
                #[cfg(not(feature = "small"))]
                servo.look_up_cogging(with);
            }),
            2 | 10 | 18 | 26 | 34 | 42 | 50 | 58 => return self.command_slot(sample),
            3 | 11 | 19 | 27 | 35 | 43 | 51 | 59 => return self.protection_slot(sample),
            4 | 12 | 20 | 28 | 36 | 44 | 52 | 60 => self.slot(sample, |servo, _, with| servo.speed_loop(with)),
            6 | 14 | 22 | 30 | 38 | 46 | 54 | 62 => self.reference_slot(sample),
            // Every 32 steps.
            RECORD | 39 => self.record_slot(sample),
            5 | 37 => self.rare_slot(sample, |servo, paths, with| {
                servo.note_current();
                paths.field_oriented.take_up_bus(with.config, with.sample);
            }),
            // Slots 13 and 45 are late after a change of the current reference, so the currents that they note have
            // settled.
            13 | 45 => self.rare_slot(sample, Self::measurement_slot),
            31 => self.swing_slot(sample),
            63 => self.reluctance_slot(sample),
            // Every 64 steps.
            ALIGNMENT => self.alignment_slot(sample),
            21 => return self.speed_slot(sample),
            // The speed, what has to be burnt at it, and soon after what may brake: a load that has been let go speeds up.
            23 => return self.over_speed_slot(sample),
            29 => self.burn_slot(sample),
            47 => self.rare_slot(sample, |servo, paths, with| {
                let field = &paths.field_oriented;
                servo.protection.limit_braking(with.config, field.bus());
                servo.protection.limit_weakening(with.config, field.induced());
            }),
            53 => return self.supervision_slot(sample),
            61 => self.window_slot(sample),
            _ => return self.heat_slot(sample),
        }
        self.estimator()
    }

    /// The estimator, if the step may still go on as a short one.
    fn estimator_if_short(&self) -> Option<&Estimator> {
        if self.route == Route::FieldOriented { self.estimator() } else { None }
    }

    /// Work of the servo, for a drive that has currents to control.
    #[inline(always)]
    fn with_servo<R>(
        &mut self,
        sample: &Sample,
        work: impl FnOnce(&mut Servo, &mut Paths, &Context) -> R,
    ) -> Option<R> {
        let config = self.config.control.as_ref()?;
        Some(work(&mut self.servo, &mut self.paths, &Context { config, rotor: &self.record.rotor, sample }))
    }

    /// The same as a slot that finds no fault.
    #[inline(never)]
    fn slot(&mut self, sample: &Sample, work: impl FnOnce(&mut Servo, &mut Paths, &Context)) {
        self.with_servo(sample, work);
    }

    /// The same of what lies in slower memory where the fast one is small: it is due less often, or does little.
    #[inline(never)]
    fn rare_slot(&mut self, sample: &Sample, work: impl FnOnce(&mut Servo, &mut Paths, &Context)) {
        self.with_servo(sample, work);
    }

    /// The plan of the trajectory to a commanded position; the command time-out.
    #[inline(never)]
    fn trajectory_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        let overdue = self.with_servo(sample, |servo, _, with| {
            servo.plan_trajectory(with);
            servo.protection.timeout.is_overdue()
        });
        if overdue == Some(true) {
            self.command_timeout();
            return self.estimator_if_short();
        }
        self.estimator()
    }

    /// The reference of the current; what the map takes off the angle.
    #[inline(never)]
    fn reference_slot(&mut self, sample: &Sample) {
        self.with_servo(sample, |servo, _, with| servo.update_reference(with));
        self.look_up_correction();
    }

    /// A command, and the position loop.
    #[inline(never)]
    fn command_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        let waits = self.servo.schedule.records && self.channels.commands.ready();
        if waits {
            self.receive(sample);
        }
        self.with_servo(sample, |servo, _, with| servo.position_loop(with));
        if waits { self.estimator_if_short() } else { self.estimator() }
    }

    /// The three Halls compared with each other, the sum of the currents. Where the Halls disagree, the
    /// rest of the step finds the angle as after a missed sample.
    #[inline(never)]
    fn protection_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        // The check at arming tells more of amplifiers that disagree; and what follows from two never disagrees.
        let checks = self.arming.is_active() || self.third_current.is_missing_now();
        let fault = self.with_servo(sample, |servo, _, with| {
            if checks { None } else { servo.protection.currents.imbalance(with.config, with.sample) }
        });
        if let Some(Some(fault)) = fault {
            self.fail(fault);
            return None;
        }
        self.estimator().filter(|estimator| estimator.agree(&sample.halls))
    }

    /// Notes currents and voltages for the tasks.
    #[inline(always)]
    fn measurement_slot(servo: &mut Servo, paths: &mut Paths, with: &Context) {
        servo.note(with, &paths.field_oriented, &paths.idle, servo.schedule.sequence());
    }

    /// The current along d for braking.
    #[inline(never)]
    fn burn_slot(&mut self, sample: &Sample) {
        let controls_field = self.config.commutation == Commutation::FieldOriented;
        self.with_servo(sample, |servo, paths, with| {
            servo.burn(with.config, paths.field_oriented.bus(), controls_field);
        });
    }

    /// In turns: weakens the magnets' field and trims the alignment; what the supply has to drive with.
    #[inline(never)]
    fn alignment_slot(&mut self, sample: &Sample) {
        let trims = (self.servo.schedule.tick / LONG).is_multiple_of(2);
        self.with_servo(sample, |servo, paths, with| {
            let field = &mut paths.field_oriented;
            let along_d = servo.reference.current.d;
            if !trims {
                servo.has_burnt = servo.protection.burns();
                servo.protection.limit_driving(with.config, field.bus());
                return;
            }
            let (free, weakening) = (field.free(), &mut servo.protection.weakening);
            if weakening.is_needed(along_d, free) {
                weakening.step(&with.config.weakening, along_d, free);
            }
            // The trim takes R·i_d off the voltage along d, and R is known to a quarter only: so not while a current along d
            // burns what braking returns. Where the field is weakened that is little beside the back-EMF, and a wrong angle
            // would make a torque of that current.
            if weakening.is_allowed() || !servo.has_burnt && !servo.protection.burns() {
                field.trim_alignment(with.config, with.rotor.speed(), along_d, free);
            }
        });
    }

    /// Feed-forward of the back-EMF for the present speed; the check for a stall.
    #[inline(never)]
    fn speed_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        let stalled = self.with_servo(sample, |servo, paths, with| {
            paths.field_oriented.take_up_speed(with.config, with.rotor.speed());
            servo.is_stalled(with)
        });
        if stalled == Some(true) {
            self.fail(Fault::Stall);
            return None;
        }
        self.estimator()
    }

    /// A part of the supervision. Until the commutation is proven, three of four look whether the rotor speeds up against its
    /// torque; the fourth, and all of them where a current is asked for and none flows, go on with the check of voltages
    /// against currents.
    #[inline(never)]
    fn supervision_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        if !self.servo.supervised {
            return self.estimator();
        }
        let turn = self.servo.schedule.tick & (3 * LONG) != 0;
        let asks = turn && self.servo.supervision.is_unsure();
        let fault = self.with_servo(
            sample,
            |servo, _, with| {
                if asks { servo.turns_against(with) } else { servo.supervise(with) }
            },
        );
        let fault = fault.flatten();
        if fault == Some(Fault::NotStopped) && self.brakes(sample) {
            return self.estimator_if_short();
        }
        self.fail_if(fault)
    }

    /// Shorts the windings, where a stop that has failed is to end so; once.
    #[cold]
    #[inline(never)]
    fn brakes(&mut self, sample: &Sample) -> bool {
        let brakes = self.config.control.as_ref().is_some_and(|control| control.motion.brakes);
        if !brakes || !self.servo.follows() {
            return false;
        }
        self.servo.supervision.stop_again();
        // Or a voltage of before would be compared with the currents of shorted windings. No command has come meanwhile.
        self.reset_servo(sample);
        self.servo.limits = Limits::TIMEOUT;
        self.servo.release();
        self.paths.voltage.release(&self.config);
        self.publish();
        true
    }

    fn fail_if(&mut self, fault: Option<Fault>) -> Option<&Estimator> {
        if let Some(fault) = fault {
            self.fail(fault);
            return None;
        }
        self.estimator()
    }

    /// What the supply leaves to the current; too high a speed.
    #[inline(never)]
    fn over_speed_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        let controls_field = self.config.commutation == Commutation::FieldOriented;
        self.with_servo(sample, |servo, paths, with| {
            let (speed, bus) = (with.rotor.speed(), paths.field_oriented.bus());
            servo.protection.take_up(with.config, speed, bus, controls_field);
        });
        // Twice in a row, or in more than a third of the checks, as where uneven magnets make the measured speed swing.
        // Halls that have just broken show a speed that lasts until they are found to contradict each other, and they are
        // what has to be named.
        let too_fast = self.config.control.is_some() && self.is_too_fast();
        let count = &mut self.servo.too_fast;
        *count = if too_fast { *count + 2 } else { count.saturating_sub(1) };
        let still = *count >= 4;
        if still {
            *count = 0;
        }
        self.fail_if(still.then_some(Fault::OverSpeed))
    }

    #[inline(never)]
    fn record_slot(&mut self, sample: &Sample) {
        let Schedule { record_due, .. } = self.servo.schedule;
        if self.servo.schedule.is_due(record_due) {
            self.servo.schedule.record_due = record_due.wrapping_add(self.config.record_every);
            let heavier = self.servo.inertia.doubled > 0;
            self.record.status = self.record.status.with_limits(self.limits()).with_heavier(heavier);
            self.record.codes = sample.halls;
            self.record.sequence = self.servo.schedule.sequence();
            let _ = self.channels.records.enqueue(self.record);
        }
    }

    /// In turns: what the rotor's position and its speed allow, and a part of the protection against heat.
    #[inline(never)]
    fn heat_slot(&mut self, sample: &Sample) -> Option<&Estimator> {
        let part = self.servo.schedule.tick / LONG;
        let fault = self.with_servo(sample, |servo, paths, with| {
            match part & 3 {
                0 => servo.attend_to_position(with),
                2 => return servo.attend_to_motion(with),
                _ => return servo.heat(part / 2, &paths.field_oriented, with),
            }
            None
        });
        self.fail_if(fault.flatten())
    }

    /// What is left to the current; the reference of a spring and a damper for the tasks.
    #[inline(never)]
    fn window_slot(&mut self, sample: &Sample) {
        self.with_servo(sample, |servo, _, with| servo.protection.narrow(with.config));
        if matches!(self.servo.demand(), Demand::Impedance) {
            self.channels.told.tell(self.servo.reference_of_impedance());
        }
    }

    /// A measurement to the tasks, or, one time in eight on the way to a position or there, a look for a swing about it: the
    /// measurement comes half a cycle later then.
    #[inline(never)]
    fn swing_slot(&mut self, sample: &Sample) {
        let looks = self.servo.schedule.tick & (7 * LONG) == 0;
        if looks && matches!(self.servo.demand(), Demand::Position(_)) {
            self.with_servo(sample, |servo, _, with| servo.look_for_swing(with));
        } else {
            self.hand_over_slot();
        }
    }

    /// The current along d that has a share in the torque; a measurement to the tasks.
    #[inline(never)]
    fn reluctance_slot(&mut self, sample: &Sample) {
        let controls_field = self.config.commutation == Commutation::FieldOriented;
        self.with_servo(sample, |servo, _, with| {
            let q = if controls_field { servo.current_reference() } else { 0 };
            servo.protection.weakening.share_torque(&with.config.weakening, q);
        });
        self.hand_over_slot();
    }

    #[inline(never)]
    fn hand_over_slot(&mut self) {
        let Schedule { measurement_due, .. } = self.servo.schedule;
        if self.servo.schedule.is_due(measurement_due) {
            let every = self.config.record_every.next_multiple_of(CYCLE);
            self.servo.schedule.measurement_due = measurement_due.wrapping_add(every);
            self.hand_over_measurement();
        }
    }

    /// Currents and voltages as noted last.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub(super) fn hand_over_measurement(&mut self) {
        let _ = self.channels.measurements.enqueue(self.servo.measurement);
    }

    /// No command for too long: a fault, or the drive is stopped by its speed control.
    #[cold]
    #[inline(never)]
    fn command_timeout(&mut self) {
        let Some(control) = &self.config.control else { return };
        if self.arming.is_active() {
            // What was commanded since the drive has armed is too old to be done after the check.
            self.arming.pending = None;
        } else if !control.guard.stops {
            self.fail(Fault::CommandTimeout);
        } else if !self.servo.limits.contains(Limits::TIMEOUT) && self.mode.drives() {
            self.servo.limits = self.servo.limits.with(Limits::TIMEOUT);
            self.servo.follow(control, Demand::Speed(Speed(0)), &self.record.rotor);
            self.publish();
        }
    }

    /// Switches between records by the schedule and records counted by `until_record`. The tick is set such that the
    /// next record is due in a record slot, and so every later one. A slot runs before the step's angle is known, so
    /// its record is that of the previous step.
    pub(super) fn record_by_schedule(&mut self, records: bool) {
        let schedule = &mut self.servo.schedule;
        if records && !schedule.records {
            schedule.record_due = RECORD;
            schedule.measurement_due = RECORD;
            // A command switches before the slot of its own step has run.
            schedule.tick = RECORD.wrapping_sub(self.until_record).wrapping_sub(2);
            schedule.first = self.record.sequence.wrapping_sub(RECORD);
        } else if schedule.records && !records {
            let next = schedule.tick.wrapping_add(1);
            self.until_record = (schedule.record_due.wrapping_sub(next) as i32).max(1) as u32;
            self.record.sequence = schedule.first.wrapping_add(next).wrapping_add(self.until_record);
        }
        schedule.records = records;
    }
}
