//! What may befall a drive from outside, and what may break.

use super::dice::Dice;
use super::scenario::Temper;
use plant::{AmplifierFault, HallFault, Rail, Transistor};
use rig::motors::Motor;

/// Torques, N·m; times, ms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Disturbance {
    /// A load that stays.
    Load(f64),
    Shock(f64, u32),
    /// A torque to and fro, of so many hertz.
    Shake(f64, f64, u32),
    /// So many times the rotor's inertia.
    Inertia(f64),
    /// The shaft is held fast.
    Seize(u32),
    /// Something turns the shaft, as a share of the speed that the supply's voltage gives.
    Turn(f64, u32),
    /// Of the Halls, °C.
    Warm(f64),
    /// The supply as a share of what it was, and then again what it was.
    Dip(f64, u32),
    Supply(f64),
    Hall(usize, HallFault),
    /// Its wire makes contact now and then.
    LooseHall(usize, u32),
    /// The converter's reference is so many times what it is to be.
    Reference(f64),
    Amplifier(usize, AmplifierFault),
    /// A winding's wire.
    Open(usize),
    Dead(usize, Transistor),
    /// What the Halls see has turned on the shaft, electrical degrees.
    Slip(f64),
}

/// The torque at the largest current.
pub(super) fn torque_nm(motor: &Motor) -> f64 {
    1.5 * f64::from(motor.pairs) * motor.flux_vs * f64::from(motor.limit_a)
}

/// From outside.
pub(super) fn draw(dice: &mut Dice, temper: Temper, motor: &Motor) -> Disturbance {
    let (most_nm, share) = (torque_nm(motor), dice.share());
    if temper == Temper::Calm {
        return match dice.below(4) {
            0 => Disturbance::Shock(0.3 * share * most_nm, dice.between(2.0, 50.0) as u32),
            1 => Disturbance::Warm(dice.within(0.0, 60.0)),
            // It cannot hold for ever what warms the winding too much.
            _ => Disturbance::Load(0.25 * share * most_nm),
        };
    }
    // What a control that fits its motor has to stand: no other motor, and no hammer.
    let (kinds, hardest) = if temper == Temper::Driven { (11, 3.0) } else { (12, 20.0) };
    match dice.below(kinds) {
        0..3 => Disturbance::Load(1.3 * share * most_nm),
        3 | 4 => {
            Disturbance::Shock(share.signum() * most_nm * dice.between(0.5, hardest), dice.between(1.0, 50.0) as u32)
        }
        5 => Disturbance::Shake(share * most_nm, dice.between(1.0, 200.0), dice.between(100.0, 9000.0) as u32),
        6 => Disturbance::Seize(dice.between(20.0, 4000.0) as u32),
        7 => Disturbance::Turn(share, dice.between(20.0, 1000.0) as u32),
        8 => Disturbance::Warm(dice.within(-20.0, 100.0)),
        9 => Disturbance::Dip(dice.within(0.2, 0.95), dice.between(1.0, 500.0) as u32),
        10 => Disturbance::Supply(dice.within(0.5, 1.1)),
        _ => Disturbance::Inertia(dice.around(8.0)),
    }
}

/// Something breaks.
pub(super) fn breakage(dice: &mut Dice) -> Disturbance {
    let one = dice.below(3);
    match dice.below(12) {
        0 | 1 => Disturbance::LooseHall(one, dice.between(5.0, 2000.0) as u32),
        2 => Disturbance::Hall(one, HallFault::Open(dice.one_of(&[Rail::High, Rail::Low]))),
        3 => Disturbance::Hall(one, HallFault::StuckAt(dice.within(0.0, 3.3))),
        4 => Disturbance::Hall(one, HallFault::ShortedTo(dice.below(3))),
        5 => Disturbance::Hall(one, HallFault::Noisy(dice.between(1e-3, 0.3))),
        6 => Disturbance::Reference(dice.around(1.3)),
        7 => Disturbance::Amplifier(one, AmplifierFault::Dead),
        8 => Disturbance::Amplifier(one, AmplifierFault::Gain(dice.around(3.0))),
        9 => Disturbance::Open(one),
        10 => Disturbance::Dead(one, dice.one_of(&[Transistor::Upper, Transistor::Lower])),
        _ => Disturbance::Slip(180.0 * dice.share()),
    }
}
