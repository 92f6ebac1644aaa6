//! Motors of every impedance, from the default settings and a current limit to speed control.

use hallservo::service::procedure::{Procedure, State};
use hallservo::service::standstill::{Electrical, Standstill};
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{Cogging, Friction, PlantParameters, SenseParameters};
use sim::rig::Rig;

/// A motor on a board.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    ohm: f64,
    henry: f64,
    flux_vs: f64,
    inertia_kgm2: f64,
    pairs: u8,
    limit_a: f32,
    full_scale_a: f32,
    bus_v: f64,
    dead_time_s: f32,
    /// Friction and cogging as shares of the torque at the limit.
    friction: f64,
    cogging: f64,
}

#[rustfmt::skip]
const CASES: [Case; 11] = [
    case("gimbal, 7 pairs",   10.0,  5e-3,    6e-3,  2e-5, 7,  0.3, 16.0, 12.0, 0.5e-6, 0.03, 0.03),
    case("gimbal, 11 pairs",  10.0,  5e-3,    5e-3,  5e-5, 11, 0.3, 16.0, 16.0, 0.8e-6, 0.03, 0.03),
    case("drone, 15 µH",      0.05,  15e-6,   1e-3,  1e-5, 7,  15.0, 32.0, 16.0, 0.8e-6, 0.02, 0.03),
    case("drone, 20 µH",      0.05,  20e-6,   1e-3,  5e-6, 7,  10.0, 16.0, 12.0, 0.5e-6, 0.02, 0.03),
    case("drone, 60 A",       0.05,  20e-6,   1e-3,  1e-5, 7,  20.0, 60.0, 24.0, 0.8e-6, 0.02, 0.03),
    case("20 mΩ, 8 µH",       0.02,  8e-6,    0.8e-3, 2e-5, 7, 25.0, 60.0, 24.0, 0.8e-6, 0.02, 0.02),
    case("20 mΩ on 32 A",     0.02,  8e-6,    0.8e-3, 2e-5, 7, 20.0, 32.0, 12.0, 0.5e-6, 0.02, 0.02),
    case("hub",               0.1,   0.25e-3, 23e-3, 0.05, 15, 15.0, 32.0, 24.0, 0.5e-6, 0.02, 0.02),
    case("paper's",           3.75,  0.36e-3, 5e-3,  1e-5, 4,  3.0, 8.25, 24.0, 0.5e-6, 0.005, 0.006),
    case("20 Ω, 10 mH",       20.0,  10e-3,   10e-3, 2e-5, 7,  0.5, 16.0, 24.0, 0.5e-6, 0.02, 0.02),
    case("slotless, 1 pair",  1.0,   0.1e-3,  6e-3,  1e-6, 1,  4.0, 16.0, 24.0, 0.5e-6, 0.02, 0.0),
];

#[rustfmt::skip]
#[allow(clippy::too_many_arguments)]
const fn case(
    name: &'static str, ohm: f64, henry: f64, flux_vs: f64, inertia_kgm2: f64, pairs: u8, limit_a: f32,
    full_scale_a: f32, bus_v: f64, dead_time_s: f32, friction: f64, cogging: f64,
) -> Case {
    Case {
        name, ohm, henry, flux_vs, inertia_kgm2, pairs, limit_a, full_scale_a, bus_v, dead_time_s, friction, cogging,
    }
}

impl Case {
    fn plant(&self, seed: u64) -> PlantParameters {
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
        plant.current_sense =
            SenseParameters { gain: 1.65 / f64::from(self.full_scale_a), ..plant.current_sense };
        plant
    }

    /// What a board comes with, and the pole pairs.
    fn settings(&self) -> Settings {
        let guard = GuardSettings {
            under_voltage_v: 9.0,
            offset_a: 0.1 * self.full_scale_a,
            imbalance_a: 0.1 * self.full_scale_a,
            ..GuardSettings::default()
        };
        let full_scale_a = self.full_scale_a;
        let control = Control { current_full_scale_a: full_scale_a, guard, ..Control::default() };
        Settings { dead_time_s: self.dead_time_s, pole_pairs: self.pairs, control: Some(control), ..Settings::default() }
    }
}

/// A drive at a motor, and the largest current that truly flowed.
struct Bench {
    rig: Rig,
    largest_a: f64,
}

impl Bench {
    fn run(&mut self, procedure: &mut dyn Procedure) -> State {
        for ms in 0..120_000_u32 {
            let state = procedure.serve(&mut self.rig.service, ms);
            if state != State::Running {
                return state;
            }
            for _ in 0..40 {
                self.step();
            }
        }
        panic!("stuck at {}", procedure.progress());
    }

    fn step(&mut self) {
        let period = self.rig.step();
        self.largest_a = period.truth.currents_a.iter().fold(self.largest_a, |most, a| most.max(a.abs()));
    }
}

fn limited(mut settings: Settings, limit_a: f32) -> Settings {
    let control = settings.control.as_mut().unwrap();
    control.max_current_a = limit_a;
    control.continuous_current_a = limit_a / 2.0;
    control.guard.over_current_a = (1.5 * limit_a).min(0.99 * control.current_full_scale_a);
    settings
}

fn measured(case: &Case, seed: u64) -> (Electrical, f64) {
    let settings = limited(case.settings(), case.limit_a);
    let rig = Rig::new(&case.plant(seed), &settings, seed).unwrap();
    let mut bench = Bench { rig, largest_a: 0.0 };
    let mut standstill = Standstill::new(&bench.rig.config).unwrap();
    let state = bench.run(&mut standstill);
    assert_eq!(state, State::Done, "{}", case.name);
    assert!(!bench.rig.drive.mode().drives());
    (*standstill.report().unwrap(), bench.largest_a)
}

#[test]
fn resistance_and_inductance_are_measured_at_standstill() {
    for case in &CASES {
        let (found, largest_a) = measured(case, 1);
        let plant = case.plant(1);
        let exact = plant.motor.resistance_ohm + plant.inverter.switch_ohm;
        let off_r = found.resistance_ohm.value / exact - 1.0;
        let off_l = found.inductance_h.value / plant.motor.inductance_h - 1.0;
        println!("{:18} R {:+.1} %  L {:+.1} %  {largest_a:.2} A\n{found}", case.name, 100.0 * off_r, 100.0 * off_l);
    }
    for case in &CASES {
        let (found, _) = measured(case, 1);
        let mut settings = limited(case.settings(), case.limit_a);
        let control = settings.control.as_mut().unwrap();
        control.resistance_ohm = found.resistance_ohm.value as f32;
        control.inductance_h = found.inductance_h.value as f32;
        control.current_bandwidth_hz = 40.0;
        control.speed_bandwidth_hz = 1.0;
        control.position_bandwidth_hz = 0.5;
        for hz in [10.0, 5.0, 2.5] {
            settings.calibration_hz = hz;
            let mut rig = Rig::new(&case.plant(1), &settings, 1).unwrap();
            let mut largest_a = 0.0_f64;
            let mut result = None;
            rig.command(hallservo::drive::Command::Calibrate).unwrap();
            for k in 0..40 * 60_000 {
                let period = rig.step();
                largest_a = period.truth.currents_a.iter().fold(largest_a, |most, a| most.max(a.abs()));
                if k % 40 == 0 {
                    while let Some(event) = rig.service.poll() {
                        match event {
                            hallservo::service::Event::Calibrated(found) => result = Some(Ok(found.report)),
                            hallservo::service::Event::Refused(error) => result = Some(Err(error)),
                            _ => {}
                        }
                    }
                    if result.is_some() || matches!(rig.drive.mode(), hallservo::mode::Mode::Faulted(_)) {
                        break;
                    }
                }
            }
            let text = match result {
                Some(Ok(r)) => format!(
                    "lag {:.1} swing {:.1} residual {:.2}",
                    r.lag.to_degrees(),
                    r.hunting_deg,
                    r.residual_pct
                ),
                Some(Err(e)) => e.to_string(),
                None => format!("{:?}", rig.drive.mode()),
            };
            println!("{:18} {hz:4} Hz {largest_a:.2} A: {text}", case.name);
        }
    }
}
