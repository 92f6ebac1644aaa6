//! What happens once with a demand or with other gains, not in every step: the loops begin, or go on.

use super::{Demand, Inertia, Servo, coarse};
use crate::control::config::Config;
use crate::control::trajectory::Trajectory;
use crate::control::velocity::Integrator;
use crate::control::{Current, Speed};
use crate::hall::track::Tracker;

impl Servo {
    /// Takes up a demand. After one of another kind, the loops start from the present position, speed and current.
    // A period with a set-point is the longest of a drive that turns: saving registers once less is 20 cycles of it, where there
    // is memory for a second copy.
    #[cfg_attr(not(feature = "small"), inline(always))]
    pub fn follow(&mut self, config: &Config, demand: Demand, rotor: &Tracker) {
        if !self.continues(demand) {
            self.trajectory = Trajectory::at(coarse(rotor.smoothed()), rotor.speed());
            self.speed_reference = rotor.speed();
            self.current_request = self.current_reference();
            self.speed_integrator = Integrator::holding(self.current_request);
            self.following.begin(self.inertia.doubled);
        }
        self.demand = demand;
        self.protection.most_of_demand = i32::MAX;
        match demand {
            Demand::Voltage | Demand::Speed(_) => {}
            Demand::Current(Current(current)) => {
                (self.asked, self.current_request) = (current, current);
                self.set_reference(config, current);
            }
            Demand::Position(position) => {
                if self.trajectory.speed() == 0 {
                    self.following.forget(self.inertia.doubled);
                }
                let goal = coarse(position);
                if goal != self.goal {
                    self.inertia.begin_way();
                }
                (self.goal, self.limits_on_way) = (goal, config.trajectory);
                self.following.soften_like_before(&mut self.limits_on_way);
            }
            Demand::Impedance => self.begin_impedance(config),
        }
    }

    /// Whether the demand that was just taken up turns the current round: it may be on its way at each look at it.
    pub fn turns_round(&mut self, rotor: &Tracker) -> bool {
        let turns = match self.demand {
            Demand::Voltage => false,
            Demand::Current(Current(current)) => self.set_points.steps(current),
            Demand::Speed(Speed(speed)) => self.set_points.comes_back(speed),
            // In 2⁻¹⁶ electrical turns, wrapping.
            Demand::Position(position) => self.set_points.comes_back((position.to_bits() >> 16) as i32),
            Demand::Impedance => {
                self.speed_reference = self.shaft.deviate(&self.trajectory, rotor);
                self.set_points.steps(self.current_of_impedance(rotor))
            }
        };
        if turns {
            self.supervision.begin_following();
        }
        turns
    }

    /// After other gains: the speed loop's integrator makes up for what the position and the speed loop would ask for
    /// now, so that the current stays.
    pub fn go_on(&mut self, config: &Config, rotor: &Tracker) {
        self.inertia = Inertia::NEW;
        if !self.moves() {
            return;
        }
        let speed = self.trajectory.speed();
        if let Demand::Position(_) = self.demand {
            let (reference, measured) = (self.trajectory.position(), coarse(rotor.smoothed()));
            self.speed_reference = config.position.speed(reference, measured, speed, config.max_speed_reference);
        }
        let error = self.speed_reference.wrapping_sub(rotor.speed());
        let forward = config.velocity.feed_forward(self.trajectory.acceleration());
        self.speed_integrator = Integrator::asking(&config.velocity, self.asked.wrapping_sub(forward), error);
    }

    /// Whether a demand goes on from the reference of the one before. That of a speed is at no position that means
    /// anything.
    fn continues(&self, demand: Demand) -> bool {
        match demand {
            Demand::Voltage | Demand::Current(_) | Demand::Speed(_) => self.moves(),
            Demand::Position(_) | Demand::Impedance => match self.demand {
                Demand::Position(_) => true,
                Demand::Impedance => demand == Demand::Impedance && self.shaft.has_reference(),
                _ => false,
            },
        }
    }
}
