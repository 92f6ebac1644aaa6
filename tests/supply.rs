//! Braking into a supply that takes nothing back, and driving from one that gives little.

use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{BackEmf, Cogging, PlantParameters};
use sim::rig::Rig;

/// A motor and its supply as they are, and what the drive is told.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    plant: PlantParameters,
    settings: Settings,
    speed_rad_s: f32,
}

fn plain(control: Control) -> Control {
    Control { guard: GuardSettings { arming_check: false, ..control.guard }, ..control }
}

fn default_motor() -> Case {
    let control = Some(plain(Control { continuous_current_a: 3.0, ..Control::default() }));
    Case {
        name: "default",
        plant: PlantParameters::imperfect(1),
        settings: Settings { commutation: Commutation::FieldOriented, control, ..Settings::default() },
        speed_rad_s: 500.0,
    }
}

/// Amplifiers of ±60 A.
fn strong(plant: &mut PlantParameters, control: Control) -> Control {
    plant.current_sense.gain = 1.65 / 60.0;
    let guard =
        GuardSettings { over_current_a: 50.0, imbalance_a: 5.0, offset_a: 3.0, arming_check: false, ..control.guard };
    Control { current_full_scale_a: 60.0, bridge_continuous_a: 50.0, guard, ..control }
}

/// 50 mΩ, 15 µH, seven pole pairs, four lithium cells behind a diode, the capacitors of a small board.
fn drone() -> Case {
    let mut plant = PlantParameters::imperfect(2).with_pole_pairs(7);
    plant.motor.resistance_ohm = 0.05;
    plant.motor.inductance_h = 15e-6;
    plant.motor.back_emf = BackEmf::sinusoidal(8e-4);
    plant.motor.inertia_kgm2 = 1e-5;
    plant.motor.cogging = [Cogging::NONE; 2];
    plant.inverter.switch_ohm = 2e-3;
    plant.bus.supply_v = 14.8;
    plant.bus.source_ohm = 0.02;
    plant.bus.capacitance_f = 220e-6;
    let control = strong(
        &mut plant,
        Control {
            resistance_ohm: 0.052,
            inductance_h: 15e-6,
            flux_linkage_wb: 8e-4,
            inertia_kgm2: 1e-5,
            max_current_a: 25.0,
            continuous_current_a: 20.0,
            max_speed_rad_s: 1200.0,
            dead_time_ramp_a: 0.5,
            guard: GuardSettings { under_voltage_v: 9.0, over_voltage_v: 20.0, ..GuardSettings::default() },
            ..Control::default()
        },
    );
    Case {
        name: "drone",
        plant,
        settings: Settings {
            commutation: Commutation::FieldOriented,
            pole_pairs: 7,
            max_electrical_hz: 1990.0,
            calibration_modulation: 0.08,
            control: Some(control),
            ..Settings::default()
        },
        speed_rad_s: 1150.0,
    }
}

/// A wheel: 0.1 Ω, 0.2 mH, 15 pole pairs, 0.05 kg·m².
fn hub() -> Case {
    let mut plant = PlantParameters::imperfect(3).with_pole_pairs(15);
    plant.motor.resistance_ohm = 0.1;
    plant.motor.inductance_h = 0.2e-3;
    plant.motor.back_emf = BackEmf::sinusoidal(0.018);
    plant.motor.inertia_kgm2 = 0.05;
    plant.motor.cogging = [Cogging::NONE; 2];
    plant.inverter.switch_ohm = 4e-3;
    let control = strong(
        &mut plant,
        Control {
            resistance_ohm: 0.104,
            inductance_h: 0.2e-3,
            flux_linkage_wb: 0.018,
            inertia_kgm2: 0.05,
            max_current_a: 25.0,
            continuous_current_a: 20.0,
            max_speed_rad_s: 40.0,
            max_acceleration_rad_s2: 150.0,
            speed_bandwidth_hz: 5.0,
            position_bandwidth_hz: 1.0,
            dead_time_ramp_a: 0.5,
            ..Control::default()
        },
    );
    Case {
        name: "hub",
        plant,
        settings: Settings {
            commutation: Commutation::FieldOriented,
            pole_pairs: 15,
            calibration_modulation: 0.12,
            calibration_hz: 5.0,
            control: Some(control),
            ..Settings::default()
        },
        speed_rad_s: 38.0,
    }
}

/// What the drive is not told: resistance, flux linkage and capacitor, times these.
const UNLIKE: [[f64; 3]; 5] = [[1.0, 1.0, 1.0], [0.75, 1.2, 1.0], [1.25, 0.8, 1.0], [0.75, 0.8, 0.5], [0.75, 1.2, 0.5]];

fn armed(case: &Case, unlike: [f64; 3]) -> Rig {
    let mut plant = case.plant;
    plant.motor.resistance_ohm *= unlike[0];
    plant.motor.back_emf.flux_linkage_vs *= unlike[1];
    plant.bus.capacitance_f *= unlike[2];
    let mut rig = Rig::new(&plant, &case.settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.run(0.1, |_, _| ());
    rig.command(Command::Arm).unwrap();
    rig
}

fn speed(rig: &mut Rig, radians_s: f32) {
    rig.command(Command::Speed(rig.control().unwrap().speed(radians_s).unwrap())).unwrap();
}

/// Largest bus voltage on the way to rest, and how long it took, of so many seconds.
fn stop(rig: &mut Rig, seconds: f64) -> (f64, Option<f64>) {
    speed(rig, 0.0);
    let (mut most, mut rest, mut time) = (0.0_f64, None, 0.0);
    rig.run(seconds, |rig, period| {
        time += rig.period_s();
        most = most.max(period.truth.bus_v);
        if rest.is_none() && period.truth.speed_rad_s.abs() < 1.0 {
            rest = Some(time);
        }
    });
    (most, rest)
}

#[test]
fn from_full_speed_to_rest_the_bus_stays_within_its_limit() {
    for case in [default_motor(), drone(), hub()] {
        for unlike in UNLIKE {
            for direction in [1.0, -1.0] {
                let mut rig = armed(&case, unlike);
                let mut rising = 0.0_f64;
                speed(&mut rig, direction * case.speed_rad_s);
                rig.run(3.0, |_, period| rising = rising.max(period.truth.bus_v));
                let reached = rig.plant.truth().speed_rad_s;
                let (most, rest) = stop(&mut rig, 6.0);
                println!(
                    "{} {unlike:?}: from {reached:.0} rad/s in {rest:.3?} s, bus {rising:.2} and {most:.2} V, {:?}",
                    case.name,
                    rig.drive.mode()
                );
            }
        }
    }
}

#[test]
#[ignore]
fn trace() {
    let case = match std::env::var("CASE").as_deref() {
        Ok("drone") => drone(),
        Ok("hub") => hub(),
        _ => default_motor(),
    };
    let mut rig = armed(&case, UNLIKE[0]);
    speed(&mut rig, case.speed_rad_s);
    rig.run(3.0, |_, _| ());
    println!("{:?}", rig.plant.truth().speed_rad_s);
    speed(&mut rig, 0.0);
    for k in 0..60 {
        rig.run(0.0005, |_, _| ());
        let t = rig.plant.truth();
        let s = rig.drive.state();
        let a = case.settings.full_scale_a() / 32768.0;
        println!(
            "{k} w {:.0} bus {:.2} d {:.2} q {:.2} ref {:.2} {:?} {:?}",
            t.speed_rad_s,
            t.bus_v,
            s.current.d as f32 * a,
            s.current.q as f32 * a,
            s.current_reference as f32 * a,
            rig.drive.limits(),
            rig.drive.mode()
        );
    }
}
