//! What must not go wrong with the adaptation, whatever happens to it.

use hallservo::angle::ElectricalAngle;
use hallservo::hall::adapt::{Adapter, Fault, Observation, Parameter, Settings, Status};
use hallservo::hall::model::Model;
use hallservo::hall::{Channel, Halls};
use plant::{HallFault, HallParameters, Rail};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sim::experiment::adapt::trial::{self, Motion, Start, Trial};
use sim::statistics::Statistics;
use std::f64::consts::TAU;

fn calibrated(seed: u64, motion: Motion) -> Trial {
    Trial::new(seed, trial::halls(seed), motion, Start::Calibrated).unwrap()
}

/// Two Halls, so far apart.
fn calibrated_of_two(apart_deg: f64, seed: u64, motion: Motion) -> Trial {
    Trial::new(seed, trial::two_halls(apart_deg, seed), motion, Start::Calibrated).unwrap()
}

const APART_DEG: [f64; 5] = [90.0, 120.0, -120.0, 60.0, -90.0];

fn error_deg(trial: &Trial) -> f64 {
    trial::wrapped_deg(f64::from(trial.adapter.hall_angle().to_radians()) - trial.hall_rad())
}

#[test]
fn standing_for_two_hours_moves_nothing() {
    let mut trial = calibrated(3, Motion::Constant(0.0));
    let before = trial.adapter.current();
    let noisy = HallParameters { noise: 0.01, ..trial.halls[0] };
    let mut random = plant::Noise::new(5);
    let codes = trial.bench.step(0.0);
    let known = trial.adapter.deviations();
    for _ in 0..7_200_000 {
        // A rotor at rest: the bench's would be pushed about by its unknown torque.
        let codes = codes.map(|code| (f64::from(code) + random.scaled(noisy.noise * 250.0)).round() as u16);
        let outcome = trial.adapter.update(&Observation { codes, elapsed: 1, torque_nm: 0.0 });
        assert!(matches!(outcome, Status::Acquiring | Status::Tracking), "{outcome:?}");
    }
    assert_eq!(trial.adapter.current(), before);
    let after = trial.adapter.deviations();
    assert_eq!((known.offset, known.amplitude, known.placement), (after.offset, after.amplitude, after.placement));
    assert!(after.angle < 0.02 && after.speed < 1e-3);
}

#[test]
fn swinging_over_a_small_arc_publishes_nothing_and_fails_nothing() {
    let mut trial = calibrated(4, Motion::Constant(0.0));
    let published = *trial.adapter.model();
    // ±8° at 8 Hz, up to 7 rad/s: learning is allowed most of the time.
    let mut learning = 0;
    for k in 0..300_000 {
        let t = f64::from(k) * trial::PERIOD_S;
        trial.bench.set_speed(0.14 * TAU * 8.0 * (TAU * 8.0 * t).cos());
        let codes = trial.bench.step(0.0);
        let outcome = trial.adapter.update(&Observation { codes, elapsed: 1, torque_nm: 0.0 });
        learning += u32::from(outcome == Status::Adapting);
        assert!(!matches!(outcome, Status::Failed(_) | Status::ModelReady), "{outcome:?} at {k}");
    }
    assert!(learning > 30_000, "{learning}");
    assert_eq!(*trial.adapter.model(), published);
}

#[test]
fn lost_samples_and_spikes_are_tolerated() {
    let mut error = Statistics::default();
    for seed in 0..50 {
        let mut trial = calibrated(seed, Motion::Constant(10.0));
        let mut random = Pcg64::seed_from_u64(seed);
        let torque_nm = 1.6e-4 * TAU * 10.0 / 4.0;
        let mut elapsed = 0_u16;
        for k in 0..3000 {
            let mut codes = trial.bench.step(torque_nm);
            elapsed += 1;
            // One in five is lost, and now and then half a second.
            if random.random_bool(0.2) || k % 1000 < 500 && k >= 2000 {
                continue;
            }
            if random.random_bool(0.01) {
                codes[random.random_range(0..3)] = random.random_range(1..4095);
            }
            let observation = Observation { codes, elapsed, torque_nm: torque_nm as f32 };
            elapsed = 0;
            let outcome = trial.adapter.update(&observation);
            assert!(!matches!(outcome, Status::Failed(_)), "seed {seed}: {outcome:?} at {k}");
            if (500..2000).contains(&k) || k > 2600 {
                error.push(error_deg(&trial));
            }
        }
    }
    assert!(error.rms() < 0.27, "{}", error.rms());
}

#[test]
fn a_torque_that_is_not_told_is_found() {
    let mut settled = Statistics::default();
    for seed in 0..50 {
        let mut trial = calibrated(seed, Motion::Constant(10.0));
        for k in 0..4000 {
            // A load of 2 mN·m comes and goes; the drive holds the speed, which the filter takes for acceleration.
            let told = 1.6e-4 * TAU * 10.0 / 4.0 + if k % 2000 < 1000 { 0.0 } else { 2e-3 };
            let codes = trial.bench.step(1.6e-4 * TAU * 10.0 / 4.0);
            let outcome = trial.adapter.update(&Observation { codes, elapsed: 1, torque_nm: told as f32 });
            assert!(!matches!(outcome, Status::Failed(_)), "seed {seed}: {outcome:?} at {k}");
            if k > 1000 && k % 1000 > 500 {
                settled.push(error_deg(&trial));
            }
        }
    }
    assert!(settled.rms() < 0.25, "{}", settled.rms());
}

#[test]
fn a_pushed_rotor_is_caught_and_nobody_is_blamed() {
    for seed in 0..100 {
        let mut trial = calibrated(seed, Motion::Constant(10.0));
        let mut random = Pcg64::seed_from_u64(seed);
        for k in 0..4000 {
            if k % 500 == 499 {
                trial.bench.set_speed(random.random_range(-300.0..300.0));
            }
            let step = trial.step();
            assert!(!matches!(step.outcome, Status::Failed(_)), "seed {seed}: {:?} at {k}", step.outcome);
            assert!(!(450..499).contains(&(k % 500)) || error_deg(&trial).abs() < 2.0, "seed {seed} {k}");
        }
    }
}

#[test]
fn of_two_halls_none_is_blamed_for_pushes_spikes_and_lost_samples() {
    let mut error = Statistics::default();
    for (seed, apart_deg) in (0..100).zip(APART_DEG.into_iter().cycle()) {
        let mut trial = calibrated_of_two(apart_deg, seed, Motion::Constant(10.0));
        let mut random = Pcg64::seed_from_u64(seed);
        let torque_nm = 1.6e-4 * TAU * 10.0 / 4.0;
        let mut elapsed = 0;
        for k in 0..8000 {
            if k < 4000 && k % 500 == 499 {
                trial.bench.set_speed(random.random_range(-300.0..300.0));
            }
            let mut codes = trial.bench.step(torque_nm);
            elapsed += 1;
            if random.random_bool(0.1) {
                continue;
            }
            if random.random_bool(0.005) {
                codes[random.random_range(0..3)] = random.random_range(1..4095);
            }
            let outcome = trial.adapter.update(&Observation { codes, elapsed, torque_nm: torque_nm as f32 });
            elapsed = 0;
            assert!(!matches!(outcome, Status::Failed(_)), "seed {seed}: {outcome:?} at {k}");
            if k > 7000 {
                error.push(error_deg(&trial));
            }
        }
    }
    println!("{:.3}°", error.rms());
    assert!(error.rms() < 0.4, "{}", error.rms());
}

/// A sensor of two that is stuck, or whose wire is broken, is nothing to learn from, and at most both are doubted.
#[test]
fn of_two_halls_a_stuck_one_bends_no_model() {
    let stuck = |amplitudes: f64| HallFault::StuckAt(1.65 + amplitudes * 250.0 * 3.3 / 4096.0);
    let faults = [stuck(0.0), stuck(0.7), stuck(-1.0), HallFault::Open(Rail::Low), HallFault::Open(Rail::High)];
    for (seed, apart_deg) in (0..50).zip(APART_DEG.into_iter().cycle()) {
        let fault = faults[(seed / 5 % 5) as usize];
        let mut trial = calibrated_of_two(apart_deg, seed, Motion::Constant(10.0));
        (0..5000 + 13 * seed).for_each(|_| _ = trial.step());
        let before = *trial.adapter.model();
        trial.bench.set_fault((seed % 2) as usize, Some(fault));
        let outcomes: Vec<_> = (0..20_000).map(|_| trial.step().outcome).collect();
        let worst = reach(trial.adapter.model(), &before, &Settings::default());
        assert!(worst.iter().all(|&share| share < 0.01), "seed {seed}, {fault:?}: {worst:?}");
        let named = outcomes.iter().find(|outcome| matches!(outcome, Status::Failed(_)));
        assert!(matches!(named, None | Some(Status::Failed(Fault::Contradiction))), "seed {seed}: {named:?}");
    }
}

#[test]
fn a_start_from_rest_is_followed() {
    let model = trial::nominal_model();
    let settings = Settings { damping_nms: 0.0, ..Settings::default() };
    let mut adapter = Adapter::new(&settings.validate().unwrap(), &model).unwrap();
    let (mut worst, mut learning) = (0.0_f32, 0);
    for k in 0..20_000 {
        // At rest for long enough to be sure of it, then at once at 2.7 Hz, over 216° and back.
        let swing = f64::from((k - 1000).max(0)) / 700.0;
        let angle = ElectricalAngle::from_turns((0.3 * (TAU * swing).sin()) as f32);
        let outcome = adapter.update(&Observation { codes: model.codes(angle), elapsed: 1, torque_nm: 0.0 });
        learning += u32::from(outcome == Status::Adapting);
        worst = worst.max((adapter.hall_angle() - angle).to_degrees().abs());
    }
    // No inertia starts as suddenly; a calibrated filter trusts the first samples little.
    assert!(worst < 6.0 && learning > 10_000, "{worst}° {learning}");
}

#[test]
fn a_sensor_that_drifts_too_far_is_named_with_what_drifted() {
    let cases = [
        (Parameter::Amplitude, HallParameters { amplitude_drift_k: -0.01, ..trial::halls(1)[1] }),
        (
            Parameter::Offset,
            HallParameters { offset_drift_v_k: 0.01 * trial::halls(1)[1].amplitude_v, ..trial::halls(1)[1] },
        ),
    ];
    for (parameter, drifting) in cases {
        let mut halls = trial::halls(1);
        halls[1] = drifting;
        let mut trial = Trial::new(1, halls, Motion::Constant(10.0), Start::Calibrated).unwrap();
        let mut failed = None;
        for k in 0..200_000 {
            // A kelvin every two seconds.
            trial.bench.set_temperature(25.0 + f64::from(k) * 5e-4);
            if let Status::Failed(fault) = trial.step().outcome {
                failed = Some((fault, k));
                break;
            }
        }
        let (fault, when) = failed.unwrap();
        assert_eq!(fault, Fault::Drifted(Channel(1), parameter), "{when}");
        // 25 % of offset or 45 % of amplitude.
        let expected: i32 = if parameter == Parameter::Offset { 50_000 } else { 90_000 };
        assert!((when - expected).abs() < 5_000, "{fault} at {when}");
    }
}

#[test]
fn two_sensors_lost_leave_no_angle_and_no_panic() {
    let mut trial = calibrated(2, Motion::Constant(10.0));
    (0..500).for_each(|_| _ = trial.step());
    trial.bench.set_fault(0, Some(plant::HallFault::Open(plant::Rail::Low)));
    trial.bench.set_fault(2, Some(plant::HallFault::Open(plant::Rail::High)));
    let outcomes: Vec<_> = (0..500).map(|_| trial.step().outcome).collect();
    assert!(outcomes.contains(&Status::Failed(Fault::AtRail(Channel(0)))));
    assert_eq!(outcomes[499], Status::Acquiring);
}

/// Where a model is farthest from another, in each parameter's limit: offset, amplitude, placement, third harmonic.
fn reach(model: &Model, start: &Model, settings: &Settings) -> [f32; 4] {
    let limits = &settings.limits;
    (0..3).fold([0.0; 4], |worst: [f32; 4], k| {
        let (now, then) = (&model.sensors[k], &start.sensors[k]);
        [
            worst[0].max((now.offset - then.offset).abs() / (limits.offset * then.amplitude)),
            worst[1].max((now.amplitude / then.amplitude - 1.0).abs() / limits.amplitude),
            worst[2].max((now.placement - then.placement).to_degrees().abs() / limits.placement_deg),
            worst[3].max((now.third - then.third).abs() / limits.third),
        ]
    })
}

/// Sensors beyond the box in one parameter each, learnt from the data sheet's model.
#[test]
fn what_is_learnt_is_kept_in_the_box() {
    let (settings, start) = (trial::settings(Start::Nominal), trial::nominal_model());
    let ideal = [0.0, 1.0, 2.0]
        .map(|k| HallParameters { noise: 0.01, ..HallParameters::ideal(1.65, 250.0 * 3.3 / 4096.0, TAU * k / 3.0) });
    let spoil: [fn(&mut [HallParameters; 3]); 4] = [
        |halls| halls[1].offset_v += 0.4 * halls[1].amplitude_v,
        |halls| halls[1].amplitude_v *= 0.4,
        |halls| halls[1].placement_rad += 30_f64.to_radians(),
        |halls| halls.iter_mut().for_each(|hall| hall.third = 0.25),
    ];
    for (parameter, spoil) in spoil.into_iter().enumerate() {
        let mut halls = ideal;
        spoil(&mut halls);
        let mut trial = Trial::new(1, halls, Motion::Constant(10.0), Start::Nominal).unwrap();
        let failed = (0..2000).any(|_| matches!(trial.step().outcome, Status::Failed(_)));
        let reached = reach(&trial.adapter.current(), &start, &settings);
        assert!(failed && reached[parameter] > 0.95, "{parameter}: {reached:?}");
        // An eighth of a turn may have gone by since it was brought back.
        assert!(reached.iter().all(|&share| share < 1.05), "{parameter}: {reached:?}");
        assert_eq!(*trial.adapter.model(), start);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Whatever comes: no panic, numbers stay numbers, and what is published stays in the box.
    #[test]
    fn any_codes_are_survived(seed: u64, two: bool, wild in 0.0..1.0_f64, torque in -1.0_f32..1.0) {
        let nominal = trial::nominal_model();
        let (halls, model) = if two { (Halls::Two, nominal.of_two()) } else { (Halls::Three, nominal) };
        let settings = Settings { halls, ..trial::settings(Start::Nominal) };
        let mut adapter = Adapter::new(&settings.validate().unwrap(), &model).unwrap();
        let mut random = Pcg64::seed_from_u64(seed);
        let (mut angle, mut speed) = (0.0_f32, 0.0_f32);
        for _ in 0..2000 {
            speed = (speed + random.random_range(-0.01..0.01_f32)).clamp(-0.3, 0.3);
            angle += speed;
            let codes = if random.random_bool(wild * wild) {
                [0; 3].map(|_: u16| random.random_range(0..4096))
            } else {
                model.codes(ElectricalAngle::from_turns(angle))
            };
            let elapsed = random.random_range(0..30);
            adapter.update(&Observation { codes, elapsed, torque_nm: torque });
            let known = adapter.deviations();
            prop_assert!(known.angle.is_finite() && known.speed.is_finite() && adapter.speed().is_finite());
            let reached = reach(adapter.model(), &model, &settings);
            prop_assert!(reached.iter().all(|&share| share <= 1.001), "{reached:?}");
        }
    }
}
