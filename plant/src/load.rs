//! A load on a shaft that twists: a second inertia behind a torsion spring with damping, and play.

use crate::error::{Error, not_negative, positive, require};
use crate::rotor::{Friction, Motion, Rotor};
use core::f64::consts::TAU;

/// A second inertia, which the rotor turns by a spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadParameters {
    /// Inertia, kg·m².
    pub inertia_kgm2: f64,
    /// Torque of the spring per twist, N·m/rad.
    pub stiffness_nm_rad: f64,
    /// Torque of the spring per speed of the twist, N·m·s/rad.
    pub damping_nms_rad: f64,
    /// By how much the rotor turns from one flank to the other before it takes the load along, rad.
    pub backlash_rad: f64,
    /// Friction of the load's own bearings.
    pub friction: Friction,
}

impl LoadParameters {
    /// Neither play nor friction; rotor and load, both free, swing against each other at so many hertz with this
    /// damping ratio.
    #[must_use]
    pub fn resonant(rotor_kgm2: f64, inertia_kgm2: f64, resonance_hz: f64, damping_ratio: f64) -> Self {
        let reduced_kgm2 = 1.0 / (1.0 / rotor_kgm2 + 1.0 / inertia_kgm2);
        let omega = TAU * resonance_hz;
        Self {
            inertia_kgm2,
            stiffness_nm_rad: reduced_kgm2 * omega * omega,
            damping_nms_rad: 2.0 * damping_ratio * reduced_kgm2 * omega,
            backlash_rad: 0.0,
            friction: Friction::NONE,
        }
    }

    /// How far the spring is twisted when the rotor is so far ahead of the load, rad.
    #[must_use]
    pub fn twist_rad(&self, ahead_rad: f64) -> f64 {
        let half_rad = 0.5 * self.backlash_rad;
        ahead_rad - ahead_rad.clamp(-half_rad, half_rad)
    }
}

/// Turn of the resonance's phase in one step, rad: the steps shift its frequency by 1/24 of the square.
const FINE_RAD: f64 = 0.1;
/// Steps of the load in one of the simulation, at most.
const MOST_STEPS: f64 = 64.0;

/// What rotor and load did in one step.
#[derive(Default)]
pub(crate) struct Coupled {
    /// Of the rotor.
    pub rotor: Motion,
    /// By how much the load has turned.
    pub turned_rad: f64,
    /// What the shaft's damping and the load's friction took.
    pub lost_j: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct Load {
    parameters: LoadParameters,
    pub inertia: Rotor,
    /// Of the resonance, rad/s.
    omega: f64,
}

impl Load {
    /// `usual_s` is the step that comes up most.
    pub fn new(parameters: &LoadParameters, rotor_kgm2: f64, usual_s: f64) -> Result<Self, Error> {
        positive(parameters.inertia_kgm2, "motor.load.inertia_kgm2")?;
        positive(parameters.stiffness_nm_rad, "motor.load.stiffness_nm_rad")?;
        not_negative(parameters.damping_nms_rad, "motor.load.damping_nms_rad")?;
        not_negative(parameters.backlash_rad, "motor.load.backlash_rad")?;
        let mobility = 1.0 / rotor_kgm2 + 1.0 / parameters.inertia_kgm2;
        let omega = libm::sqrt(parameters.stiffness_nm_rad * mobility);
        require(
            omega * usual_s <= FINE_RAD * MOST_STEPS,
            "motor.load.stiffness_nm_rad",
            "so small that the load swings slower than the bridge switches",
        )?;
        let inertia = Rotor::new(parameters.inertia_kgm2, parameters.friction)?;
        Ok(Self { parameters: *parameters, inertia, omega })
    }

    /// Moves both, the rotor under the torque of everything but friction and the load, the load against `load_nm`.
    pub fn step(&mut self, rotor: &mut Rotor, torque_nm: f64, load_nm: f64, span_s: f64) -> Coupled {
        let steps = libm::ceil(self.omega * span_s / FINE_RAD).clamp(1.0, MOST_STEPS);
        let dt_s = span_s / steps;
        let mut sum = Coupled::default();
        for _ in 0..steps as u32 {
            let (shaft_nm, spring_nm) = self.shaft(rotor, torque_nm, load_nm, dt_s);
            let moved = rotor.step(torque_nm - shaft_nm, dt_s);
            let load = self.inertia.step(shaft_nm - load_nm, dt_s);
            sum.rotor.turned_rad += moved.turned_rad;
            sum.rotor.friction_nm += moved.friction_nm / steps;
            sum.turned_rad += load.turned_rad;
            sum.lost_j += (shaft_nm - spring_nm) * (moved.turned_rad - load.turned_rad);
            sum.lost_j -= load.friction_nm * load.turned_rad;
        }
        sum
    }

    /// Torque of the shaft and what the spring has of it, in the middle of the step: to drift half a step, to be kicked,
    /// and to drift the other half is the leapfrog, which neither gains nor loses energy in the long run.
    fn shaft(&self, rotor: &Rotor, torque_nm: f64, load_nm: f64, dt_s: f64) -> (f64, f64) {
        let LoadParameters { stiffness_nm_rad, damping_nms_rad, .. } = self.parameters;
        let half_s = 0.5 * dt_s;
        let (turns, follows) = (rotor.mobility(), self.inertia.mobility());
        let rate = rotor.speed_rad_s - self.inertia.speed_rad_s;
        let ahead_rad = rotor.angle_rad - self.inertia.angle_rad + half_s * rate;
        let twist_rad = self.parameters.twist_rad(ahead_rad);
        let free = twist_rad == 0.0 && self.parameters.backlash_rad > 0.0;
        if free {
            return (0.0, 0.0);
        }
        let spring_nm = stiffness_nm_rad * twist_rad;
        // Damping with the speed that it has in the middle of the step, after half of what it does itself.
        let apart = torque_nm * turns + load_nm * follows - spring_nm * (turns + follows);
        let rate = (rate + half_s * apart) / (1.0 + half_s * damping_nms_rad * (turns + follows));
        let shaft_nm = spring_nm + damping_nms_rad * rate;
        // A flank pushes and does not pull.
        let pulls = self.parameters.backlash_rad > 0.0 && shaft_nm * twist_rad < 0.0;
        (if pulls { 0.0 } else { shaft_nm }, spring_nm)
    }
}
