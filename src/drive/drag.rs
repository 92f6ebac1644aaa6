//! The calibration's motion: a field that rises, stands, and turns once forward and once backward, open loop.

use crate::angle::ElectricalAngle;
use crate::commutation::Modulation;
pub use crate::config::OpenLoop as Config;
use crate::hall::calibrate::Sweep;

/// Turns for the rotor to swing in before recording: speeding up takes the first half of them.
const SETTLE_TURNS: u64 = 2;

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
}

/// The field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Drag {
    stage: Stage,
    field: ElectricalAngle,
    speed: i32,
    /// Modulation in 2⁻³¹.
    strength: i32,
    travelled: u64,
}

impl Drag {
    /// Off, about to rise.
    pub const OFF: Self =
        Self { stage: Stage::Rise, field: ElectricalAngle::ZERO, speed: 0, strength: 0, travelled: 0 };

    /// One step on; tells the stage it belongs to.
    pub fn step(&mut self, config: &Config) -> Stage {
        match self.stage {
            Stage::Rise => self.rise(config),
            Stage::Stand(0) => self.stage = Stage::Settle(Sweep::Forward),
            Stage::Stand(left) => self.stage = Stage::Stand(left - 1),
            Stage::Settle(sweep) => {
                self.turn(config, sweep);
                self.until(SETTLE_TURNS, Stage::Record(sweep));
            }
            Stage::Record(sweep) => {
                self.turn(config, sweep);
                let next = if sweep == Sweep::Forward { Stage::Settle(Sweep::Backward) } else { Stage::Done };
                self.until(config.turns.into(), next);
            }
            Stage::Done => {}
        }
        self.stage
    }

    fn rise(&mut self, config: &Config) {
        let full = i32::from(config.modulation.to_bits()) << 16;
        self.strength = self.strength.saturating_add(config.rise).min(full);
        if self.strength == full {
            self.stage = Stage::Stand(config.stand);
        }
    }

    /// Changes the speed so that it is reached after one turn from rest, and moves on.
    fn turn(&mut self, config: &Config, sweep: Sweep) {
        let target = if sweep == Sweep::Forward { config.speed } else { -config.speed };
        // v² / 2 turns: at least one, or nothing ever moves.
        let slew = ((i64::from(config.speed) * i64::from(config.speed)) >> 33).max(1) as i32;
        self.speed = self.speed.wrapping_add(target.wrapping_sub(self.speed).min(slew).max(-slew));
        self.field += ElectricalAngle::from_bits(self.speed);
        // Only what goes the right way counts: not the slowing down before the reversal.
        if self.speed.signum() == target.signum() {
            self.travelled = self.travelled.wrapping_add(u64::from(self.speed.unsigned_abs()));
        }
    }

    fn until(&mut self, turns: u64, next: Stage) {
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

    /// Whether both sweeps are done.
    pub const fn is_done(&self) -> bool {
        matches!(self.stage, Stage::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(strength: f32, stand: u32, speed: i32, turns: u32) -> Config {
        Config { modulation: Modulation::from_num(strength), rise: 1 << 22, stand, speed, turns }
    }

    #[test]
    fn turns_both_ways_over_whole_turns() {
        let config = config(0.2, 1000, 4_294_967, 3);
        let mut drag = Drag::OFF;
        let (mut bins, mut last, mut steps) = ([[0_u32; 8]; 2], 0_i32, 0);
        loop {
            let stage = drag.step(&config);
            steps += 1;
            match stage {
                Stage::Record(sweep) => {
                    bins[sweep as usize][drag.field().to_bits() as u32 as usize >> 29] += 1;
                    assert_eq!(drag.speed.unsigned_abs(), 4_294_967);
                    assert_eq!(drag.speed > 0, sweep == Sweep::Forward);
                    assert_eq!(drag.modulation(), config.modulation);
                }
                Stage::Done => break,
                _ => {}
            }
            assert!((drag.speed - last).abs() < 5000, "a jump of the speed");
            last = drag.speed;
            assert!(steps < 50_000);
        }
        for count in bins.iter().flatten() {
            assert!((375 - 2..=375 + 2).contains(count), "{bins:?}");
        }
        assert!(drag.is_done());
    }

    #[test]
    fn the_field_rises_evenly_and_then_stands() {
        let config = config(0.5, 100, 1_000_000, 1);
        let mut drag = Drag::OFF;
        let mut risen = 0;
        while drag.step(&config) == Stage::Rise {
            risen += 1;
            let expected = f32::from(risen as u16) / 512.0;
            assert!((drag.modulation().to_num::<f32>() - expected).abs() < 1e-4);
        }
        assert_eq!(risen, 255);
        for _ in 0..100 {
            assert!(matches!(drag.step(&config), Stage::Stand(_)));
            assert!(drag.modulation() == config.modulation && drag.field() == ElectricalAngle::ZERO);
        }
        assert_eq!(drag.step(&config), Stage::Settle(Sweep::Forward));
    }
}
