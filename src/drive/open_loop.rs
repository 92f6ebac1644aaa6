//! The open-loop path: alignment and the calibration's sweeps. A field rises, stands, and turns once forward and once
//! backward, whatever the rotor does. Its strength is a voltage; with current sensing, one that makes a current.

use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output};
use crate::commutation::Modulation;
use crate::commutation::frames::Dq;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
pub use crate::config::{OpenLoop as Config, Regulator};
use crate::control::current::PARK_BITS;
use crate::hall::calibrate::Sweep;
use crate::math::clamp;
use crate::pwm;

/// Turns for the rotor to swing in before recording: speeding up takes the first half of them.
const SETTLE_TURNS: u64 = 2;

/// The square of the speed by 2 to the power of this is its change in a step: full speed is reached after one turn, and
/// braked within a quarter of one, 50 ms at 10 Hz.
const SPEED_UP_BITS: u32 = 33;
const BRAKE_BITS: u32 = 31;

/// Largest modulation of a field whose current is regulated: 0.9, in 2⁻³¹. The limits of the PWM may be less.
const STRONGEST: i32 = 1_932_735_283;

/// Where in the motion the field is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// Rising.
    Rise,
    /// Standing, for so many more steps.
    Stand(u32),
    /// Turning the rotor up to speed.
    Settle(Sweep),
    /// Turning at constant speed.
    Record(Sweep),
    /// Finished.
    Done,
    /// Coming to rest, until the bridge is switched off.
    Brake,
}

/// The field of the open-loop path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OpenLoop {
    stage: Stage,
    field: ElectricalAngle,
    /// Speed of the field in 2⁻³² electrical turns a step.
    speed: i32,
    /// Share of the full field, in 2⁻³¹.
    risen: i32,
    /// Modulation in 2⁻³¹.
    strength: i32,
    /// Way in the sweep's direction in 2⁻³² electrical turns, since the stage began.
    travelled: u64,
}

impl OpenLoop {
    /// Off, about to rise.
    pub const OFF: Self =
        Self { stage: Stage::Rise, field: ElectricalAngle::ZERO, speed: 0, risen: 0, strength: 0, travelled: 0 };

    /// One step on; tells the stage it belongs to.
    pub fn step(&mut self, config: &Config) -> Stage {
        match self.stage {
            Stage::Rise => self.rise(config),
            Stage::Stand(0) => self.stage = Stage::Settle(Sweep::Forward),
            Stage::Stand(left) => self.stage = Stage::Stand(left - 1),
            Stage::Settle(sweep) => {
                self.move_field(config, sweep);
                self.end_stage_after(SETTLE_TURNS, Stage::Record(sweep));
            }
            Stage::Record(sweep) => {
                self.move_field(config, sweep);
                let next = if sweep == Sweep::Forward { Stage::Settle(Sweep::Backward) } else { Stage::Done };
                self.end_stage_after(config.turns.into(), next);
            }
            Stage::Brake => {
                self.change_speed(config, 0, BRAKE_BITS);
            }
            Stage::Done => {}
        }
        self.stage
    }

    fn rise(&mut self, config: &Config) {
        self.risen = self.risen.saturating_add(config.rise);
        if self.risen == i32::MAX {
            self.stage = Stage::Stand(config.stand);
        }
        if config.regulator.is_none() {
            self.strength = ((self.risen >> 15) + 1) * i32::from(config.modulation.to_bits());
        }
    }

    /// Gives the sweeps up: the field comes to rest, and the rotor with it.
    pub const fn brake(&mut self) {
        self.stage = Stage::Brake;
    }

    /// Changes the strength towards the current that the field is to have by now.
    pub fn regulate(&mut self, regulator: &Regulator, measured: Dq) {
        let reference = ((self.risen >> 15) * regulator.current) >> 16;
        let square = |x: i32| i64::from(x) * i64::from(x);
        let lacking = square(reference) - square(measured.d >> PARK_BITS) - square(measured.q >> PARK_BITS);
        let change = (lacking * i64::from(regulator.gain)) >> 16;
        let slew = i64::from(regulator.slew);
        self.strength = self.strength.saturating_add(change.min(slew).max(-slew) as i32).clamp(0, STRONGEST);
    }

    /// Changes the speed so that it is reached after one turn from rest, and moves on.
    fn move_field(&mut self, config: &Config, sweep: Sweep) {
        let target = if sweep == Sweep::Forward { config.speed } else { -config.speed };
        self.change_speed(config, target, SPEED_UP_BITS);
        // Only what goes the right way counts: not the slowing down before the reversal.
        if self.speed.signum() == target.signum() {
            self.travelled = self.travelled.wrapping_add(u64::from(self.speed.unsigned_abs()));
        }
    }

    /// Changes the speed towards another, and moves on.
    fn change_speed(&mut self, config: &Config, target: i32, bits: u32) {
        // v² / 2 turns: at least one, or nothing ever moves.
        let slew = ((i64::from(config.speed) * i64::from(config.speed)) >> bits).max(1) as i32;
        self.speed = self.speed.wrapping_add(target.wrapping_sub(self.speed).min(slew).max(-slew));
        self.field += ElectricalAngle::from_bits(self.speed);
    }

    /// Goes on to the next stage when the field has turned so far.
    fn end_stage_after(&mut self, turns: u64, next: Stage) {
        if self.travelled >= turns << 32 {
            self.travelled = 0;
            self.stage = next;
        }
    }

    /// Angle of the field.
    pub const fn field(&self) -> ElectricalAngle {
        self.field
    }

    /// Strength of the field.
    pub const fn modulation(&self) -> Modulation {
        Modulation::from_bits((self.strength >> 16) as i16)
    }

    /// What the legs do.
    pub fn output(&self, limits: &pwm::Limits) -> Output {
        let axes = Axes::new(limits.amplitude(self.modulation()), PhaseOrder::FORWARD, limits.half());
        Output { compare: sinusoidal::compare(self.field, &axes), legs: Legs::ALL }
    }

    /// The same with what the dead time takes from each leg, by the currents of the phases in 2⁻¹⁵ of the full scale.
    pub fn compensated(&self, regulator: &Regulator, limits: &pwm::Limits, phases: [i32; 3]) -> Output {
        let Output { mut compare, legs } = self.output(limits);
        for (compare, phase) in compare.iter_mut().zip(phases) {
            // A current beyond the ramp: all of it; no product overflows.
            let taken = clamp((phase * regulator.slope) >> 16, regulator.dead_time);
            *compare = limits.nearest(i32::from(*compare) + taken);
        }
        Output { compare, legs }
    }

    /// Whether both sweeps are done.
    pub const fn is_done(&self) -> bool {
        matches!(self.stage, Stage::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(strength: f32, stand: u32, speed: i32, turns: u32) -> Config {
        Config { modulation: Modulation::from_num(strength), rise: 1 << 23, stand, speed, turns, regulator: None }
    }

    #[test]
    fn turns_both_ways_over_whole_turns() {
        let config = config(0.2, 1000, 4_294_967, 3);
        let mut open_loop = OpenLoop::OFF;
        let (mut bins, mut last, mut steps) = ([[0_u32; 8]; 2], 0_i32, 0);
        loop {
            let stage = open_loop.step(&config);
            steps += 1;
            match stage {
                Stage::Record(sweep) => {
                    bins[sweep as usize][open_loop.field().to_bits() as u32 as usize >> 29] += 1;
                    assert_eq!(open_loop.speed.unsigned_abs(), 4_294_967);
                    assert_eq!(open_loop.speed > 0, sweep == Sweep::Forward);
                    assert_eq!(open_loop.modulation(), config.modulation);
                }
                Stage::Done => break,
                _ => {}
            }
            assert!((open_loop.speed - last).abs() < 5000, "a jump of the speed");
            last = open_loop.speed;
            assert!(steps < 50_000);
        }
        for count in bins.iter().flatten() {
            assert!((375 - 2..=375 + 2).contains(count), "{bins:?}");
        }
        assert!(open_loop.is_done());
    }

    #[test]
    fn the_field_rises_evenly_and_then_stands() {
        let config = config(0.5, 100, 1_000_000, 1);
        let mut open_loop = OpenLoop::OFF;
        let mut risen = 0;
        while open_loop.step(&config) == Stage::Rise {
            risen += 1;
            let expected = f32::from(risen as u16) / 512.0;
            assert!((open_loop.modulation().to_num::<f32>() - expected).abs() < 1e-4);
        }
        assert_eq!(risen, 255);
        for _ in 0..100 {
            assert!(matches!(open_loop.step(&config), Stage::Stand(_)));
            assert!(open_loop.modulation() == config.modulation && open_loop.field() == ElectricalAngle::ZERO);
        }
        assert_eq!(open_loop.step(&config), Stage::Settle(Sweep::Forward));
    }
}
