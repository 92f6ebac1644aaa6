//! How far the shaft moves the wrong way, by the truth of the plant.

use plant::{MotorParameters, Truth};

/// Where the shaft is commanded to move.
#[derive(Clone, Copy, Debug)]
pub(super) enum Way {
    /// This way round: 1 or −1.
    Round(f64),
    /// To this angle, rad.
    To(f64),
    /// Nowhere.
    Stay,
    /// Nowhere but for this angle to either side, by which the check at arming turns a sound motor, too, rad.
    Check(f64),
}

/// Wrong motion below this is the noise of a drive that does its best, rad: a degree.
const NOISE_RAD: f64 = 0.0175;
/// A rotor that a position loop holds creeps; slower than this it rests, rad/s.
const CREEPS_RAD_S: f64 = 0.1;

/// Watches a shaft.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    way: Way,
    coasting: Coasting,
    start_rad: f64,
    /// How far it has come at best along the way, rad.
    best_rad: f64,
    /// Most wrong motion so far.
    pub wrong_rad: f64,
    /// Periods in which it went on the wrong way, faster than it creeps.
    pub wrong_periods: u32,
    /// Largest true phase current.
    pub current_a: f64,
    /// Highest bus voltage.
    pub bus_v: f64,
    /// Fastest, mechanical rad/s.
    pub speed_rad_s: f64,
}

impl Motion {
    pub fn new(way: Way, motor: &MotorParameters, truth: &Truth) -> Self {
        let coasting = Coasting::new(motor, truth);
        let mut motion = Self {
            way,
            coasting,
            start_rad: truth.mechanical_angle_rad,
            best_rad: 0.0,
            wrong_rad: 0.0,
            wrong_periods: 0,
            current_a: 0.0,
            bus_v: 0.0,
            speed_rad_s: 0.0,
        };
        motion.best_rad = motion.progress(truth.mechanical_angle_rad);
        motion
    }

    /// Another command: the way counts from here.
    pub fn turn_to(&mut self, way: Way, truth: &Truth) {
        self.way = way;
        self.coasting.follow(truth);
        self.start_rad = truth.mechanical_angle_rad;
        self.best_rad = self.progress(truth.mechanical_angle_rad);
    }

    fn progress(&self, angle_rad: f64) -> f64 {
        match self.way {
            Way::Round(sign) => sign * angle_rad,
            Way::To(target_rad) => -(target_rad - angle_rad).abs(),
            Way::Stay | Way::Check(_) => -(angle_rad - self.start_rad).abs(),
        }
    }

    /// One period. `free` tells that it is not the drive that moves the shaft: something outside imposes the motion, or
    /// the bridge is off.
    pub fn look(&mut self, truth: &Truth, free: bool, period_s: f64) {
        self.current_a = truth.currents_a.iter().fold(self.current_a, |most, current| most.max(current.abs()));
        self.bus_v = self.bus_v.max(truth.bus_v);
        self.coasting.step(truth.load_nm, period_s);
        if free {
            return;
        }
        self.speed_rad_s = self.speed_rad_s.max(truth.speed_rad_s.abs());
        let progress = self.progress(truth.mechanical_angle_rad);
        if progress > self.best_rad {
            self.best_rad = progress;
            self.coasting.follow(truth);
        }
        // What a rotor would have done from there with the bridge off is not the drive's.
        let beyond = self.progress(self.coasting.angle_rad) - progress;
        let wrong = (self.best_rad - progress).min(beyond).max(0.0);
        let allowed = if let Way::Check(angle_rad) = self.way { angle_rad } else { NOISE_RAD };
        if wrong > allowed && wrong > self.wrong_rad + CREEPS_RAD_S * period_s {
            self.wrong_periods += 1;
        }
        self.wrong_rad = self.wrong_rad.max(wrong);
    }
}

/// The same rotor with the bridge off.
#[derive(Clone, Debug)]
struct Coasting {
    motor: MotorParameters,
    angle_rad: f64,
    speed_rad_s: f64,
}

impl Coasting {
    fn new(motor: &MotorParameters, truth: &Truth) -> Self {
        Self { motor: *motor, angle_rad: truth.mechanical_angle_rad, speed_rad_s: truth.speed_rad_s }
    }

    fn follow(&mut self, truth: &Truth) {
        (self.angle_rad, self.speed_rad_s) = (truth.mechanical_angle_rad, truth.speed_rad_s);
    }

    fn step(&mut self, load_nm: f64, period_s: f64) {
        let friction = self.motor.friction;
        let load_nm = load_nm - self.motor.cogging.iter().map(|cogging| cogging.torque_nm(self.angle_rad)).sum::<f64>();
        if self.speed_rad_s == 0.0 && load_nm.abs() <= friction.breakaway_nm {
            return;
        }
        let against = if self.speed_rad_s == 0.0 { -load_nm } else { self.speed_rad_s };
        let drag = friction.coulomb_nm.copysign(against) + friction.viscous_nms * self.speed_rad_s;
        let next = self.speed_rad_s - (load_nm + drag) / self.motor.inertia_kgm2 * period_s;
        // It comes to rest before it turns round.
        self.speed_rad_s = if next * against < 0.0 { 0.0 } else { next };
        self.angle_rad += self.speed_rad_s * period_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::{Cogging, Plant, PlantParameters};

    fn truth(angle_rad: f64, speed_rad_s: f64, load_nm: f64) -> Truth {
        let truth = Plant::new(&PlantParameters::ideal(), 0).unwrap().truth();
        Truth { mechanical_angle_rad: angle_rad, speed_rad_s, load_nm, ..truth }
    }

    fn watch(way: Way, load_nm: f64, path: impl Fn(f64) -> f64) -> Motion {
        let motor = PlantParameters::ideal().motor;
        let mut motion = Motion::new(way, &motor, &truth(path(0.0), 0.0, load_nm));
        for k in 1..=1000 {
            motion.look(&truth(path(f64::from(k) / 1000.0), 0.0, load_nm), false, 25e-6);
        }
        motion
    }

    #[test]
    fn only_backward_motion_is_wrong() {
        assert_eq!(watch(Way::Round(1.0), 0.0, |t| t).wrong_rad, 0.0);
        let back = watch(Way::Round(-1.0), 0.0, |t| t);
        assert!((back.wrong_rad - 1.0).abs() < 1e-9 && back.wrong_periods > 900);
        // Forward by 1, then back by 0.4.
        let turned = watch(Way::Round(1.0), 0.0, |t| if t < 0.5 { 2.0 * t } else { 1.0 - 0.8 * (t - 0.5) });
        assert!((turned.wrong_rad - 0.4).abs() < 1e-9);
        assert!((watch(Way::To(1.0), 0.0, |t| -0.5 * t).wrong_rad - 0.5).abs() < 1e-9);
        assert!(watch(Way::To(1.0), 0.0, |t| t).wrong_rad == 0.0);
        assert!((watch(Way::Stay, 0.0, |t| 0.3 * t).wrong_rad - 0.3).abs() < 1e-9);
    }

    #[test]
    fn what_cogging_does_is_not_the_drives() {
        let mut motor = PlantParameters::ideal().motor;
        let cogging = Cogging { amplitude_nm: 20e-3, cycles_per_turn: 4, phase_rad: 0.0 };
        // Up to close to the hill's top at 45°, and down again.
        let fall = |t: f64| (40.0 - 10.0 * (t / 0.025).powi(2)).to_radians();
        let wrong = |motor: &MotorParameters| {
            let mut motion = Motion::new(Way::Round(1.0), motor, &truth(fall(0.0), 0.0, 0.0));
            for k in 1..=1000 {
                motion.look(&truth(fall(f64::from(k) * 25e-6), 0.0, 0.0), false, 25e-6);
            }
            motion.wrong_rad.to_degrees()
        };
        assert!((wrong(&motor) - 10.0).abs() < 1e-9);
        motor.cogging[0] = cogging;
        assert!(wrong(&motor) < 1.0, "{}", wrong(&motor));
    }

    #[test]
    fn what_the_load_does_is_not_the_drives() {
        // 25 ms under 10 mN·m: ½ · 1000 rad/s² · t².
        let fall = |t: f64| -500.0 * (t * 0.025).powi(2);
        assert!(watch(Way::Round(1.0), 10e-3, fall).wrong_rad < 1e-3);
        assert!((watch(Way::Round(1.0), 10e-3, |t| 3.0 * fall(t)).wrong_rad - 0.625).abs() < 2e-3);
    }
}
