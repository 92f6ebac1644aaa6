//! A load that is let go while the rotor is checked, as by a holding brake, looks like a wrong commutation. So the bridge goes
//! off before that is reported, and the rotor is watched: what a wrong commutation has driven rolls on or swings; what something
//! else turns gets faster and faster, which proves nothing.

use super::Step;
use crate::angle::Position;
use crate::board::Output;
use crate::control::config::Config as Control;
use crate::fault::Fault;
use crate::hall::track::Tracker;

/// An electrical turn, in 2⁻²⁶ turns as all ways are.
const TURN: i32 = 1 << 26;
/// Half of the way that is told from noise: 1.5°.
const NOISE: i32 = 279_620;

/// The watched rotor.
#[derive(Clone, Copy, Debug)]
pub(super) struct LetGo {
    steps: u32,
    from: Position,
    /// When it was last looked at, the step of it, how far it had come by then, and how fast it was, in 2⁻³² turns a control step.
    looked: u32,
    way: i32,
    speed: i32,
    /// Averaged speed.
    averaged: i32,
    /// How often it has got faster, one time after the other.
    gained: u32,
}

impl LetGo {
    /// Nothing is watched.
    pub const NEW: Self =
        Self { steps: 0, from: Position::from_bits(0), looked: 0, way: 0, speed: 0, averaged: 0, gained: 0 };

    /// The bridge goes off.
    // Not inlined, so that a board may place it where there is room.
    #[cfg_attr(not(feature = "small"), inline(never))]
    pub fn begin(&mut self, control: &Control, rotor: &Tracker) -> Step {
        let looked = u32::from(control.arming.longest_push) / 128;
        *self = Self { from: rotor.smoothed(), looked, averaged: rotor.speed(), ..Self::NEW };
        Step::Output(Output::OFF)
    }

    /// One step of the check on. The way is compared with that in half the time, and the speed with that at half the time, again
    /// and again in twice the time.
    #[cfg_attr(not(feature = "small"), inline(never))]
    pub fn step(&mut self, control: &Control, rotor: &Tracker) -> Step {
        self.steps += 1;
        self.averaged += (rotor.speed() - self.averaged) >> control.arming.averages;
        let way = ((rotor.smoothed().to_bits().wrapping_sub(self.from.to_bits()) >> 6) as i32).wrapping_abs();
        let speed = self.averaged.wrapping_abs();
        if self.steps == 2 * self.looked {
            // Rolling on doubles the way, a constant torque makes it four times as long.
            let gains = way / 2 - self.way > self.way / 8 + NOISE && speed > self.speed;
            self.gained = if gains { self.gained + 1 } else { 0 };
            if self.gained >= 3 || self.gained == 2 && way > TURN {
                return Step::Done { step: 0, proven: false };
            }
            self.looked = self.steps;
        }
        if self.steps == self.looked {
            (self.way, self.speed) = (way, speed);
        }
        let longest = u32::from(control.arming.longest_push);
        let may_gain = self.steps < 2 * longest || self.gained > 0 && self.steps < 4 * longest;
        if may_gain { Step::Output(Output::OFF) } else { Step::Failed(Fault::Commutation) }
    }
}
