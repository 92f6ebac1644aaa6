//! The whole plant: repeatability, the imperfect motor's statistics, rejected parameters.
use crate::common::*;
use plant::{BackEmf, HallLayout, InverterModel, Legs, MotorParameters, Plant, PlantParameters, Shape};
use std::f64::consts::PI;

/// FNV-1a over everything sampled while the imperfect motor is dragged round by a rotating field.
fn fingerprint(parameters: &PlantParameters, seed: u64, periods: u32) -> u64 {
    let mut plant = Plant::new(parameters, seed).unwrap();
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    for period in 0..periods {
        let codes = plant.sample();
        for code in codes.halls.into_iter().chain(codes.currents).chain([codes.bus]) {
            hash = (hash ^ u64::from(code)).wrapping_mul(0x0100_0000_01b3);
        }
        // A six-sided field, four turns of it; no sine, so that the command is exact everywhere.
        let legs =
            [[0.8, 0.3, 0.3], [0.7, 0.7, 0.2], [0.3, 0.8, 0.3], [0.2, 0.7, 0.7], [0.3, 0.3, 0.8], [0.7, 0.2, 0.7]]
                [(period / 100 % 6) as usize];
        plant.advance(&Legs::pwm(legs));
    }
    let truth = plant.truth();
    for value in truth.currents_a.into_iter().chain([truth.mechanical_angle_rad, truth.speed_rad_s, truth.bus_v]) {
        hash = (hash ^ value.to_bits()).wrapping_mul(0x0100_0000_01b3);
    }
    hash
}

/// The same seed gives the same bits, on every machine: these numbers must come out on the chip,
/// too.
#[test]
fn results_are_a_function_of_the_seed_alone() {
    let imperfect = PlantParameters::imperfect(1);
    assert_eq!(fingerprint(&imperfect, 1, 2400), fingerprint(&imperfect, 1, 2400));
    assert_ne!(fingerprint(&imperfect, 1, 2400), fingerprint(&imperfect, 2, 2400));
    assert_ne!(PlantParameters::imperfect(1), PlantParameters::imperfect(2));
    assert_eq!(fingerprint(&imperfect, 1, 2400), 11_545_745_163_316_819_545);

    let mut charged = imperfect;
    charged.bus.regenerative = true;
    assert_eq!(fingerprint(&charged, 1, 2400), 15_109_617_797_135_344_660);

    let mut switched = imperfect;
    switched.inverter.model = InverterModel::Switched;
    switched.motor.back_emf =
        BackEmf { shape: Shape::Trapezoidal { flat_deg: 120.0 }, fifth: 0.02, ..BackEmf::sinusoidal(5e-3) };
    switched.halls[0].bandwidth_hz = Some(20e3);
    switched.halls[1].saturation.knee = 0.05;
    assert_eq!(fingerprint(&switched, 1, 2400), 1_732_831_574_208_150_679);
}

/// Over 400 seeds every error stays in its range, reaches out to nine tenths of it, and averages
/// to nothing within four standard errors.
#[test]
fn the_imperfect_motor_is_as_imperfect_as_promised() {
    let nominal_v = 250.0 * 3.3 / 4096.0;
    let seeds = 400;
    let all: Vec<_> = (0..seeds).map(|seed| PlantParameters::imperfect_with(seed, HallLayout::Deg60)).collect();
    for sensor in 0..3 {
        let spread = |of: &dyn Fn(&PlantParameters) -> f64| {
            let most = all.iter().map(|p| of(p).abs()).fold(0.0, f64::max);
            assert!((0.9..=1.0).contains(&most), "{most}");
            let mean = all.iter().map(of).sum::<f64>() / seeds as f64;
            close(mean, 0.0, 4.0 / (3.0 * seeds as f64).sqrt());
        };
        let nominal_rad = HallLayout::Deg60.placement_rad(sensor);
        spread(&|p| (p.halls[sensor].placement_rad - nominal_rad) / (8.0 * PI / 180.0));
        spread(&|p| (p.halls[sensor].amplitude_v / nominal_v - 1.0) / 0.3);
        spread(&|p| (p.halls[sensor].offset_v - 1.65) / (0.1 * nominal_v));
        spread(&|p| p.hall_phase_rad / PI);
        assert!(all.iter().all(|p| p.halls[sensor].third == 0.05));
        assert!(all.iter().all(|p| p.halls[sensor].noise == 0.01));
    }
    assert_eq!(all[0].adc.bits, 12);
}

/// Two leads exchanged turn the motor the other way.
#[test]
fn exchanged_leads_reverse_the_motor() {
    let run = |sequence| {
        let mut parameters = PlantParameters::ideal();
        parameters.motor.back_emf.sequence = sequence;
        parameters.motor.friction.viscous_nms = 1e-4;
        let mut plant = Plant::new(&parameters, 0).unwrap();
        for period in 0..40_000 {
            let angle = f64::from(period) * 1e-3;
            let duty = |k: f64| 0.5 + 0.2 * (angle - k * 2.0 * PI / 3.0).cos();
            plant.advance(&Legs::pwm([duty(0.0), duty(1.0), duty(2.0)]));
        }
        plant.truth().mechanical_angle_rad
    };
    let forward = run(plant::PhaseSequence::Abc);
    close(forward, 10.0, 0.3);
    close(run(plant::PhaseSequence::Acb), -forward, 1e-9);
}

type Spoil = fn(&mut PlantParameters);

#[test]
fn bad_parameters_are_named() {
    let rejected = |spoil: Spoil| {
        let mut parameters = PlantParameters::imperfect(0);
        spoil(&mut parameters);
        Plant::new(&parameters, 0).unwrap_err()
    };
    let cases: [(Spoil, &str); 22] = [
        (|p| p.motor.resistance_ohm = 0.0, "motor.resistance_ohm"),
        (|p| p.motor.inductance_h = -1.0, "motor.inductance_h"),
        (|p| p.motor.pole_pairs = 65, "motor.pole_pairs"),
        (|p| p.motor.inertia_kgm2 = 0.0, "motor.inertia_kgm2"),
        (|p| p.motor.load_nm = f64::NAN, "motor.load_nm"),
        (|p| p.motor.back_emf.flux_linkage_vs = 0.0, "motor.back_emf.flux_linkage_vs"),
        (|p| p.motor.back_emf.shape = Shape::Trapezoidal { flat_deg: 180.0 }, "motor.back_emf.shape.flat_deg"),
        (|p| p.motor.back_emf.seventh = f64::INFINITY, "motor.back_emf.seventh"),
        (|p| p.motor.friction.breakaway_nm = 0.0, "motor.friction.breakaway_nm"),
        (|p| p.motor.cogging[1].amplitude_nm = -1.0, "motor.cogging.amplitude_nm"),
        (|p| p.inverter.pwm_hz = 0.0, "inverter.pwm_hz"),
        (|p| p.inverter.dead_time_s = 1e-5, "inverter.dead_time_s"),
        (|p| p.inverter.model = InverterModel::Averaged { steps: 0 }, "inverter.model.steps"),
        (|p| p.bus.supply_v = -1.0, "bus.supply_v"),
        (
            |p| {
                p.bus.regenerative = false;
                p.bus.source_ohm = 0.0;
            },
            "bus.regenerative",
        ),
        (|p| p.halls[2].noise = -0.01, "halls.noise"),
        (|p| p.halls[2].saturation.high_v = -1.0, "halls.saturation.high_v"),
        (|p| p.halls[2].saturation.knee = 1.1, "halls.saturation.knee"),
        (|p| p.halls[2].bandwidth_hz = Some(0.0), "halls.bandwidth_hz"),
        (|p| p.hall_phase_rad = f64::NAN, "hall_phase_rad"),
        (|p| p.adc.bits = 7, "adc.bits"),
        (|p| p.current_sense.noise_v = -1.0, "current_sense.noise_v"),
    ];
    for (spoil, field) in cases {
        let error = rejected(spoil);
        assert_eq!(error.field, field);
        assert!(error.to_string().starts_with(field));
    }
    assert_eq!(
        rejected(|p| p.halls[2].noise = -0.01).to_string(),
        "halls.noise (number 3) must be finite and not below zero"
    );
    let mut plant = ideal();
    assert_eq!(plant.set_load(f64::NAN).unwrap_err().field, "load_nm");
    assert_eq!(plant.set_supply(-1.0).unwrap_err().field, "bus.supply_v");
    assert_eq!(plant.place(f64::NAN, 0.0).unwrap_err().field, "mechanical_angle_rad");
    assert_eq!(plant.set_dyno(Some(f64::NAN)).unwrap_err().field, "speed_rad_s");
    assert_eq!(plant.set_temperature(f64::NAN).unwrap_err().field, "celsius");
}

/// The documentation promises an idle speed of about 5660 rpm.
#[test]
fn the_papers_motor_idles_as_documented() {
    let mut parameters = PlantParameters::ideal();
    parameters.motor = MotorParameters::paper();
    let mut plant = Plant::new(&parameters, 0).unwrap();
    for _ in 0..30_000 {
        plant.advance(&on_q_axis(&plant, 12.0));
    }
    let rpm = plant.truth().speed_rad_s * 60.0 / (2.0 * PI);
    close(rpm, 5660.0, 5.0);
}
