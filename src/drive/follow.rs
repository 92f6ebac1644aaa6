//! A step that follows a current, a speed or a position.

use super::{Drive, Sample};
use crate::angle::ElectricalAngle;
use crate::commutation::sinusoidal::{self, Axes};
use crate::commutation::{Commutation, Legs, Output};
use crate::mode::Mode;

impl Drive {
    /// A running step that follows a current, a speed or a position.
    #[inline(always)]
    pub(super) fn serve(&mut self, sample: &Sample) -> Output {
        self.attend(sample);
        let Some(estimator) = &self.serving else { return Output::unpack(self.serve_slowly(sample)) };
        // No sample was missed, so there is nothing to do when one is found.
        let Ok(angle) = estimator.angle_in_range(&sample.halls) else { return Output::unpack(self.stumble(sample)) };
        if self.live.rotor.step(&self.config.tracking, angle).is_err() && !self.leaps(angle, sample) {
            return Output::OFF;
        }
        if !self.is_healthy(sample) {
            return Output::OFF;
        }
        let compare = self.servo.field(&self.live.rotor, &self.config.tracking, sample);
        Output { compare, legs: Legs::ALL }
    }

    /// The codes are no angle: this step finds out as after a missed sample.
    #[cold]
    #[inline(never)]
    fn stumble(&mut self, sample: &Sample) -> u64 {
        self.resting = self.serving.take();
        self.serve_slowly(sample)
    }

    /// The angle is not where the rotor can be; whether the drive runs on.
    #[cold]
    #[inline(never)]
    fn leaps(&mut self, angle: ElectricalAngle, sample: &Sample) -> bool {
        self.jumped(angle) || self.runs_on(sample.halls)
    }

    /// Field-oriented, whatever was missed.
    #[inline(never)]
    fn field(&mut self, sample: &Sample) -> u64 {
        let compare = self.servo.field(&self.live.rotor, &self.config.tracking, sample);
        Output { compare, legs: Legs::ALL }.pack()
    }

    /// The same with local feedback, or after samples were missed, or when a command has ended it.
    #[cold]
    #[inline(never)]
    fn serve_slowly(&mut self, sample: &Sample) -> u64 {
        if self.mode == Mode::Running && self.is_healthy(sample) {
            self.observe(&sample.halls);
        }
        // The command may have been to disarm, the angle implausible.
        if self.mode != Mode::Running {
            return Output::OFF.pack();
        }
        if self.config.commutation != Commutation::FieldOriented {
            return self.locally(sample).pack();
        }
        self.field(sample)
    }

    /// With the local feedback: one current, one voltage.
    #[inline(never)]
    fn locally(&mut self, sample: &Sample) -> Output {
        let Some(control) = &self.config.control else { return Output::OFF };
        let (rotor, order) = (&self.live.rotor, self.config.order());
        let vector = rotor.predicted(&self.config.tracking) + ElectricalAngle::QUARTER;
        let block = self.config.commutation == Commutation::Block;
        let legs = block.then(|| self.sextant.conducting(order));
        let modulation = self.servo.local(control, rotor, sample, legs);
        let limits = &self.config.limits;
        self.servo.cut_off(limits.limits(modulation));
        let amplitude = limits.amplitude(modulation);
        if block {
            self.sextant = self.sextant.follow(vector);
            return self.sextant.output(order, amplitude, limits.half());
        }
        let axes = Axes::new(amplitude, order, limits.half());
        Output { compare: sinusoidal::compare(vector, &axes), legs: Legs::ALL }
    }
}
