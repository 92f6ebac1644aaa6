//! The turning side: inertia, friction, cogging, load, and the dyno that may impose the speed.

use crate::error::{Error, finite, not_negative, positive, require};

/// Friction of the bearings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Torque per mechanical speed, N·m·s/rad.
    pub viscous_nms: f64,
    /// Torque against any motion, N·m.
    pub coulomb_nm: f64,
    /// Torque that a rotor at rest withstands, N·m; not below `coulomb_nm`.
    pub breakaway_nm: f64,
}

impl Friction {
    /// None.
    pub const NONE: Self = Self { viscous_nms: 0.0, coulomb_nm: 0.0, breakaway_nm: 0.0 };

    pub(crate) fn check(&self) -> Result<(), Error> {
        not_negative(self.viscous_nms, "motor.friction.viscous_nms")?;
        not_negative(self.coulomb_nm, "motor.friction.coulomb_nm")?;
        finite(self.breakaway_nm, "motor.friction.breakaway_nm")?;
        require(self.breakaway_nm >= self.coulomb_nm, "motor.friction.breakaway_nm", "at least coulomb_nm")
    }
}

/// One component of the cogging torque, -A·sin(N·θ + phase).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cogging {
    /// Amplitude A, N·m.
    pub amplitude_nm: f64,
    /// Cycles N in a mechanical turn.
    pub cycles_per_turn: u16,
    /// Phase, rad.
    pub phase_rad: f64,
}

impl Cogging {
    /// None.
    pub const NONE: Self = Self { amplitude_nm: 0.0, cycles_per_turn: 1, phase_rad: 0.0 };

    pub(crate) fn check(&self) -> Result<(), Error> {
        not_negative(self.amplitude_nm, "motor.cogging.amplitude_nm")?;
        finite(self.phase_rad, "motor.cogging.phase_rad")
    }

    /// Torque at a mechanical angle in rad, N·m.
    #[must_use]
    pub fn torque_nm(&self, angle_rad: f64) -> f64 {
        if self.amplitude_nm == 0.0 {
            return 0.0;
        }
        let angle = f64::from(self.cycles_per_turn) * angle_rad + self.phase_rad;
        -self.amplitude_nm * libm::sin(angle)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Rotor {
    /// One over the inertia.
    mobility: f64,
    friction: Friction,
    /// Unwrapped mechanical angle.
    pub angle_rad: f64,
    pub speed_rad_s: f64,
    acceleration_rad_s2: f64,
    /// Speed that a dyno imposes.
    pub imposed_rad_s: Option<f64>,
}

/// What a rotor did in one step.
#[derive(Default)]
pub(crate) struct Motion {
    pub turned_rad: f64,
    /// Mean torque of friction along the motion; at rest, what it holds against.
    pub friction_nm: f64,
}

impl Rotor {
    pub fn new(inertia_kgm2: f64, friction: Friction) -> Result<Self, Error> {
        positive(inertia_kgm2, "motor.inertia_kgm2")?;
        friction.check()?;
        Ok(Self {
            mobility: 1.0 / inertia_kgm2,
            friction,
            angle_rad: 0.0,
            speed_rad_s: 0.0,
            acceleration_rad_s2: 0.0,
            imposed_rad_s: None,
        })
    }

    pub fn set_inertia(&mut self, inertia_kgm2: f64) -> Result<(), Error> {
        positive(inertia_kgm2, "inertia_kgm2")?;
        self.mobility = 1.0 / inertia_kgm2;
        Ok(())
    }

    pub fn place(&mut self, angle_rad: f64, speed_rad_s: f64) {
        self.angle_rad = angle_rad;
        self.speed_rad_s = speed_rad_s;
        self.acceleration_rad_s2 = 0.0;
    }

    /// Acceleration per torque; a dyno yields to none.
    pub fn mobility(&self) -> f64 {
        if self.imposed_rad_s.is_some() { 0.0 } else { self.mobility }
    }

    /// Speed expected in the middle of the coming step, from the last step's acceleration: keeps
    /// the coupling of back-EMF and torque, and so the energy balance, of second order.
    pub fn speed_ahead_rad_s(&self, ahead_s: f64) -> f64 {
        match self.imposed_rad_s {
            Some(speed) => speed,
            None => self.speed_rad_s + ahead_s * self.acceleration_rad_s2,
        }
    }

    /// Moves under the torque of everything but friction.
    pub fn step(&mut self, torque_nm: f64, dt_s: f64) -> Motion {
        if let Some(speed) = self.imposed_rad_s {
            self.speed_rad_s = speed;
            self.acceleration_rad_s2 = 0.0;
            self.angle_rad += speed * dt_s;
            return Motion { turned_rad: speed * dt_s, friction_nm: 0.0 };
        }
        let start = self.speed_rad_s;
        if start == 0.0 && torque_nm.abs() <= self.friction.breakaway_nm {
            self.acceleration_rad_s2 = 0.0;
            return Motion { turned_rad: 0.0, friction_nm: -torque_nm };
        }
        let against = if start == 0.0 { torque_nm } else { start };
        let coulomb = self.friction.coulomb_nm.copysign(against);
        let end = self.slowed(start, torque_nm - coulomb, dt_s);
        let (end, turned_rad) = if end * against >= 0.0 {
            (end, 0.5 * (start + end) * dt_s)
        } else {
            // Comes to rest within the step; what torque is left decides whether it turns back.
            let rest_s = dt_s * start / (start - end);
            let back = if torque_nm.abs() <= self.friction.breakaway_nm {
                0.0
            } else {
                self.slowed(0.0, torque_nm + coulomb, dt_s - rest_s)
            };
            (back, 0.5 * (start * rest_s + back * (dt_s - rest_s)))
        };
        self.speed_rad_s = end;
        self.acceleration_rad_s2 = (end - start) / dt_s;
        self.angle_rad += turned_rad;
        Motion { turned_rad, friction_nm: -coulomb - self.friction.viscous_nms * 0.5 * (start + end) }
    }

    /// Speed after a step with viscous friction taken at its middle.
    fn slowed(&self, speed_rad_s: f64, torque_nm: f64, dt_s: f64) -> f64 {
        let kick = dt_s * self.mobility;
        let drag = 0.5 * self.friction.viscous_nms * kick;
        (speed_rad_s * (1.0 - drag) + torque_nm * kick) / (1.0 + drag)
    }
}
