//! What a user may tell a drive.

use super::dice::Dice;
use super::scenario::Temper;
use hallservo::commutation::Commutation;

/// A command. Shares are of the largest that the settings allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wish {
    Arm,
    Disarm,
    Clear,
    Voltage(f64),
    Torque(f64),
    Speed(f64),
    /// So far from where it says that it is, turns.
    Move(f64),
    /// Stiffness as a share of the largest torque a radian, damping ratio, and so far from here, turns.
    Spring(f64, f64, f64),
    Commutate(Commutation),
    /// A setting, so many times what it is.
    Scale(&'static str, f32),
    Set(&'static str, f32),
    AntiCogging(bool),
    LearnCogging,
    LearnMagnets,
    Calibrate,
}

/// Those that may be set while it turns.
const BANDWIDTHS: [&str; 4] =
    ["tracking_bandwidth_hz", "current_bandwidth_hz", "speed_bandwidth_hz", "position_bandwidth_hz"];

/// Any one.
pub(super) fn draw(dice: &mut Dice, temper: Temper) -> Wish {
    let share = dice.share();
    match dice.below(if temper <= Temper::Driven { 26 } else { 34 }) {
        0 | 1 => Wish::Arm,
        2 => Wish::Disarm,
        3..=8 => Wish::Speed(share),
        9 | 10 => Wish::Speed(0.0),
        11..=14 => Wish::Torque(share),
        15..=19 => Wish::Move(share.signum() * dice.between(1e-3, 20.0)),
        20..=22 => {
            Wish::Spring(dice.between(0.02, 1.0), dice.within(0.3, 1.5), share.signum() * dice.between(1e-3, 0.8))
        }
        23 => Wish::AntiCogging(share > 0.0),
        24 => Wish::Set("adaptation", f32::from(u8::from(share > 0.0))),
        25 => Wish::Arm,
        // From here on what needs thought of a user.
        26 | 27 => Wish::Voltage(share),
        28 => Wish::Commutate(dice.one_of(&[Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented])),
        29 | 30 => Wish::Scale(dice.one_of(&BANDWIDTHS), dice.around(3.0) as f32),
        31 => Wish::Clear,
        32 => dice.one_of(&[Wish::LearnCogging, Wish::LearnMagnets, Wish::Calibrate, Wish::Disarm]),
        _ => another_setting(dice),
    }
}

/// Refused while the bridge is on.
fn another_setting(dice: &mut Dice) -> Wish {
    match dice.below(5) {
        0 => Wish::Scale("max_speed_rad_s", dice.around(2.0) as f32),
        1 => Wish::Scale("max_acceleration_rad_s2", dice.around(5.0) as f32),
        2 => Wish::Scale("max_current_a", dice.within(0.3, 1.0) as f32),
        3 => Wish::Set("run_on_two_halls", f32::from(u8::from(dice.chance(0.5)))),
        _ => Wish::Scale("following_error_turns", dice.around(3.0) as f32),
    }
}
