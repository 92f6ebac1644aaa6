//! Motors of every impedance, each on a board that fits it, to be commissioned.

use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{Cogging, Friction, Noise, PlantParameters, SenseParameters};

/// A motor on a board that fits it.
#[derive(Clone, Copy, Debug)]
pub struct Motor {
    /// Of one word.
    pub name: &'static str,
    /// Resistance of a phase.
    pub ohm: f64,
    /// Inductance of a phase.
    pub henry: f64,
    /// Flux linkage, Wb.
    pub flux_vs: f64,
    /// Inertia.
    pub inertia_kgm2: f64,
    /// Pole pairs.
    pub pairs: u8,
    /// Largest current of the motor, A.
    pub limit_a: f32,
    /// Of the board's current sensing, A.
    pub full_scale_a: f32,
    /// Supply.
    pub bus_v: f64,
    /// Of the board.
    pub dead_time_s: f32,
    /// Friction as a share of the torque at the limit.
    pub friction: f64,
    /// The same of the cogging.
    pub cogging: f64,
}

#[rustfmt::skip]
/// Motors from 20 mΩ and 8 µH to 20 Ω and 10 mH.
pub const MOTORS: [Motor; 20] = [
    motor("gimbal-7",       10.0,  5e-3,    6e-3,  2e-5, 7,  0.3, 16.0, 12.0, 0.5e-6, 0.03, 0.03),
    motor("gimbal-11",      10.0,  5e-3,    5e-3,  5e-5, 11, 0.3, 16.0, 16.0, 0.8e-6, 0.03, 0.03),
    motor("drone-15uh",     0.05,  15e-6,   1e-3,  1e-5, 7,  15.0, 32.0, 16.0, 0.8e-6, 0.02, 0.03),
    motor("drone-20uh",     0.05,  20e-6,   1e-3,  5e-6, 7,  10.0, 16.0, 12.0, 0.5e-6, 0.02, 0.03),
    motor("drone-60a",      0.05,  20e-6,   1e-3,  1e-5, 7,  20.0, 60.0, 24.0, 0.8e-6, 0.02, 0.03),
    motor("20mohm",         0.02,  8e-6,    0.8e-3, 2e-5, 7, 25.0, 60.0, 24.0, 0.8e-6, 0.02, 0.02),
    motor("20mohm-32a",     0.02,  8e-6,    0.8e-3, 2e-5, 7, 20.0, 32.0, 12.0, 0.5e-6, 0.02, 0.02),
    motor("hub",            0.1,   0.25e-3, 23e-3, 0.05, 15, 15.0, 32.0, 24.0, 0.5e-6, 0.02, 0.02),
    motor("paper",          3.75,  0.36e-3, 5e-3,  1e-5, 4,  3.0, 8.25, 24.0, 0.5e-6, 0.005, 0.006),
    motor("20ohm",          20.0,  10e-3,   10e-3, 2e-5, 7,  0.5, 16.0, 24.0, 0.5e-6, 0.02, 0.02),
    motor("slotless",       1.0,   0.1e-3,  6e-3,  1e-6, 1,  4.0, 16.0, 24.0, 0.5e-6, 0.02, 0.0),
    // Near what they can turn, and without friction; heavy and light.
    motor("drone-stiff",    0.05,  20e-6,   1e-3,  1e-5, 7,  15.0, 32.0, 16.0, 0.8e-6, 0.10, 0.08),
    motor("drone-loose",    0.05,  20e-6,   1e-3,  1e-5, 7,  15.0, 32.0, 16.0, 0.8e-6, 0.0, 0.0),
    motor("drone-heavy",    0.05,  20e-6,   1e-3,  1e-3, 7,  15.0, 32.0, 16.0, 0.8e-6, 0.02, 0.02),
    motor("gimbal-stiff",   10.0,  5e-3,    6e-3,  2e-5, 7,  0.3, 16.0, 12.0, 0.5e-6, 0.10, 0.10),
    motor("gimbal-loose",   10.0,  5e-3,    6e-3,  2e-5, 7,  0.3, 16.0, 12.0, 0.5e-6, 0.0, 0.0),
    motor("paper-heavy",    3.75,  0.36e-3, 5e-3,  1e-3, 4,  3.0, 8.25, 24.0, 0.5e-6, 0.005, 0.006),
    motor("direct-drive",   2.0,   2e-3,    30e-3, 2e-3, 21, 4.0, 16.0, 24.0, 0.5e-6, 0.03, 0.03),
    motor("hoverboard",     0.15,  0.3e-3,  25e-3, 0.3,  15, 20.0, 32.0, 24.0, 0.8e-6, 0.02, 0.02),
    motor("22-pairs",       0.08,  60e-6,   4e-3,  2e-4, 22, 30.0, 60.0, 24.0, 0.8e-6, 0.02, 0.02),
];

#[rustfmt::skip]
#[allow(clippy::too_many_arguments)]
const fn motor(
    name: &'static str, ohm: f64, henry: f64, flux_vs: f64, inertia_kgm2: f64, pairs: u8, limit_a: f32,
    full_scale_a: f32, bus_v: f64, dead_time_s: f32, friction: f64, cogging: f64,
) -> Motor {
    Motor {
        name, ohm, henry, flux_vs, inertia_kgm2, pairs, limit_a, full_scale_a, bus_v, dead_time_s, friction, cogging,
    }
}

impl Motor {
    /// The motor and its board, imperfect.
    pub fn plant(&self, seed: u64) -> PlantParameters {
        let mut plant = PlantParameters::imperfect(seed);
        let motor = &mut plant.motor;
        motor.resistance_ohm = self.ohm;
        motor.inductance_h = self.henry;
        motor.back_emf.flux_linkage_vs = self.flux_vs;
        motor.inertia_kgm2 = self.inertia_kgm2;
        motor.pole_pairs = self.pairs;
        let torque_nm = 1.5 * f64::from(self.pairs) * self.flux_vs * f64::from(self.limit_a);
        let coulomb_nm = self.friction * torque_nm;
        motor.friction = Friction { viscous_nms: 1e-3 * coulomb_nm, coulomb_nm, breakaway_nm: 1.2 * coulomb_nm };
        motor.cogging[0] = Cogging {
            amplitude_nm: self.cogging * torque_nm,
            cycles_per_turn: 6 * u16::from(self.pairs),
            phase_rad: motor.cogging[0].phase_rad,
        };
        motor.cogging[1] = Cogging::NONE;
        plant.inverter.switch_ohm = if self.ohm < 1.0 { 2e-3 } else { 0.02 };
        plant.inverter.dead_time_s = self.dead_time_s.into();
        plant.bus.supply_v = self.bus_v;
        plant.bus.source_ohm = if self.ohm < 1.0 { 0.02 } else { 0.1 };
        plant.current_sense = SenseParameters { gain: 1.65 / f64::from(self.full_scale_a), ..plant.current_sense };
        plant
    }

    /// What a board comes with, and the pole pairs.
    pub fn settings(&self) -> Settings {
        let guard = GuardSettings {
            under_voltage_v: 9.0,
            offset_a: 0.1 * self.full_scale_a,
            imbalance_a: 0.1 * self.full_scale_a,
            command_timeout_s: 60.0,
            ..GuardSettings::default()
        };
        let full_scale_a = self.full_scale_a;
        let control =
            Control { bridge_continuous_a: 1000.0, current_full_scale_a: full_scale_a, guard, ..Control::default() };
        Settings {
            dead_time_s: self.dead_time_s,
            pole_pairs: self.pairs,
            control: Some(control),
            ..Settings::default()
        }
    }
}

/// How much the Halls differ in what they see of it at most: in size, as a share, and in direction, degrees.
const APART: (f64, f64) = (0.2, 15.0);

/// The field of the windings at Halls that do not see it alike.
pub fn with_windings(mut plant: PlantParameters, share: f64, rated_a: f64, seed: u64) -> PlantParameters {
    let mut random = Noise::new(seed ^ 0xC011);
    let phase_rad = plant.hall_phase_rad;
    for hall in &mut plant.halls {
        let own = share * (1.0 + APART.0 * random.uniform());
        let turned_rad = APART.1.to_radians() * random.uniform();
        *hall = hall.with_windings(own, rated_a, phase_rad + turned_rad);
    }
    plant
}
