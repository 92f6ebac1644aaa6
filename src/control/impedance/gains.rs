//! Stiffness and damping, what limits them, and their integers.

use crate::angle::TURN;
use crate::control::config::Config as Control;
use crate::hall::track;
use crate::schedule::OUTER;
use core::f32::consts::TAU;

/// Stiffness and damping at the shaft.
///
/// What limits them is the time from a motion to the torque that answers it: τp for the position, which the hold between
/// two computations and the current control make (0.37 ms with the default settings), and τd = τp + (2ᵃ⁺¹ − 2)/f for the
/// speed, which the tracker smooths (1.12 ms). A damper may take half of the inertia J in that time, kd + kp τp ≤ J / 2τd; the
/// spring's natural frequency may be a quarter of what the delay turns by a radian, kp ≤ J / 16τd².
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gains {
    /// Stiffness kp, N·m/rad.
    pub kp_nm_rad: f32,
    /// Damping kd, N·m·s/rad.
    pub kd_nms_rad: f32,
}

/// What of the drive limits them.
pub(super) struct Loop {
    inertia_kgm2: f32,
    /// The largest stiffness that the integers hold, N·m/rad.
    representable: f32,
    /// From the position to the torque, s.
    position_s: f32,
    /// From the speed to the torque, s.
    speed_s: f32,
}

/// Steps from the sample that the position loop's slot works with to the middle of the time for which the reference
/// holds: the sample is of the step before, the reference is taken up four steps later.
const HOLD: f32 = 5.0 + (OUTER as f32 - 1.0) / 2.0;
/// … and the speed loop's: two steps later.
const LATER: f32 = 2.0;

impl Loop {
    pub fn new(control: &Control, tracking: &track::Config) -> Self {
        let step_s = 1.0 / control.scale.step_hz;
        let position_s = HOLD * step_s + 1.0 / control.current_rad_s;
        Self {
            inertia_kgm2: control.motor.inertia_kgm2,
            representable: 0.49 / per_strain(control),
            position_s,
            speed_s: position_s + (tracking.speed_lag() - LATER) * step_s,
        }
    }

    /// The largest gains, each with as much of the other as it allows.
    #[inline(never)]
    pub fn largest(&self) -> Gains {
        let damping = self.inertia_kgm2 / (2.0 * self.speed_s);
        Gains {
            kp_nm_rad: (self.inertia_kgm2 / (16.0 * self.speed_s * self.speed_s)).min(self.representable),
            kd_nms_rad: damping - damping * self.position_s / (8.0 * self.speed_s),
        }
    }

    /// What the position and speed loops amount to, within the largest.
    pub fn usual(&self, control: &Control) -> Gains {
        let most = self.largest();
        let kd = control.velocity.proportional() as f32 / TURN / per_speed(control);
        let kd = kd.min(most.kd_nms_rad);
        let rad_s = control.position.rad_s(control.scale.step_hz / OUTER as f32);
        Gains { kp_nm_rad: (rad_s * kd).min(most.kp_nm_rad), kd_nms_rad: kd }
    }
}

/// The gains of the interrupt: current in 2⁻³² per strain and per speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Spring {
    pub stiffness: i32,
    pub damping: i32,
}

/// Bits by which a strain is coarser than a position of the outer loops: 2⁻²³ electrical turns, up to ± 256 of which
/// count.
const STRAIN_BITS: u32 = 6;

impl Spring {
    /// Neither.
    pub const NONE: Self = Self { stiffness: 0, damping: 0 };

    /// Of gains within the largest. What the spring's delay takes of the damping is added to it, so that the shaft feels
    /// the damping that was asked for.
    pub(super) fn new(gains: &Gains, lags: &Loop, control: &Control) -> Self {
        let fixed = |gain: f32| crate::float::nearest((gain * TURN).min(2_147_483_520.0));
        let damping = gains.kd_nms_rad + gains.kp_nm_rad * lags.position_s;
        Self { stiffness: fixed(gains.kp_nm_rad * per_strain(control)), damping: fixed(damping * per_speed(control)) }
    }

    /// The deviation that makes a strain.
    #[inline(always)]
    pub const fn deviation(strain: i32) -> i64 {
        (strain as i64) << STRAIN_BITS
    }

    /// A deviation of the position, of the outer loops' unit; beyond 2³¹ it counts as that.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn strain(deviation: i64) -> i32 {
        let deviation = deviation >> STRAIN_BITS;
        let narrow = deviation as i32;
        if narrow as i64 == deviation {
            narrow
        } else if deviation < 0 {
            -i32::MAX
        } else {
            i32::MAX
        }
    }

    /// A strain in electrical turns.
    pub fn turns(strain: i32) -> f32 {
        strain as f32 * ((1 << STRAIN_BITS) * OUTER) as f32 / TURN
    }

    /// The current of a strain and of a deviation of the speed.
    #[inline(always)]
    pub const fn current(&self, strain: i32, speed: i32) -> i32 {
        ((strain as i64 * self.stiffness as i64 + speed as i64 * self.damping as i64) >> 32) as i32
    }
}

/// Units of current in a newton metre.
fn per_torque(control: &Control) -> f32 {
    control.scale.per_ampere() / control.motor.torque_constant(control.scale.pole_pairs)
}

/// Units of current per unit of speed in a newton metre second per radian.
fn per_speed(control: &Control) -> f32 {
    per_torque(control) / control.scale.per_radian_s()
}

/// Units of current per strain in a newton metre per radian.
fn per_strain(control: &Control) -> f32 {
    per_torque(control) * TAU / control.scale.pole_pairs * Spring::turns(1)
}
