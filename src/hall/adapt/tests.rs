use super::filter::{STATES, THIRD};
use super::*;
use crate::hall::Channel;
use crate::hall::model::Sensor;
use plant::{Bench, BenchParameters, PlantParameters};

extern crate std;
use std::{println, vec, vec::Vec};

fn adapter(start: Spread) -> Adapter {
    let settings = Settings { start, ..Settings::default() };
    let model = Model::nominal(12, 250.0, ElectricalAngle::THIRD);
    Adapter::new(&settings.validate().unwrap(), &model).unwrap()
}

/// Smallest pivot of the Cholesky decomposition of the correlations; positive only for a positive definite matrix.
fn smallest_pivot(covariance: &Covariance) -> f64 {
    let deviation: Vec<f64> = (0..STATES).map(|k| f64::from(covariance.get(k, k)).sqrt()).collect();
    let mut l = vec![vec![0.0; STATES]; STATES];
    let mut smallest = f64::MAX;
    for i in 0..STATES {
        for j in 0..=i {
            let correlation = f64::from(covariance.get(i, j)) / (deviation[i] * deviation[j]);
            let rest = correlation - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                smallest = smallest.min(rest);
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }
    smallest
}

#[test]
fn ten_million_updates_leave_the_covariance_positive_and_bounded() {
    let mut adapter = adapter(Settings::NOMINAL);
    let plant = PlantParameters::imperfect(5);
    let parameters = BenchParameters {
        halls: plant.halls,
        magnets: plant.magnets,
        adc: plant.adc,
        period_s: 1e-3,
        pole_pairs: 4,
        inertia_kgm2: 1e-5,
        damping_nms: 1.6e-4,
        torque_noise_nm_rthz: 1e-5,
    };
    let mut bench = Bench::new(&parameters, 0.0, 62.8, 1).unwrap();
    let (mut smallest, mut largest) = (f64::MAX, 0.0_f32);
    for k in 0..10_000_000_u32 {
        // Ten seconds each of turning, standing, turning back, and turning fast.
        let speed = [62.8, 0.0, -62.8, 400.0][(k / 10_000 % 4) as usize];
        let torque_nm = (1.6e-4 * speed + 1e-5 * 20.0 * (speed - bench.speed_rad_s())) / 4.0;
        let observation = Observation { codes: bench.step(torque_nm), elapsed: 1, torque_nm: torque_nm as f32 };
        let outcome = adapter.update(&observation);
        assert!(!matches!(outcome, Status::Failed(_)), "{outcome:?} at {k}");
        if k % 10_007 == 0 || k < 1000 {
            if adapter.phase == Phase::Tracking {
                smallest = smallest.min(smallest_pivot(&adapter.covariance));
            }
            for state in THIRD..STATES {
                largest = largest.max(adapter.covariance.get(state, state) / adapter.start[state]);
            }
        }
    }
    println!("smallest pivot {smallest:.1e}, largest variance {largest:.3} of that at the start");
    assert!(smallest > 1e-5, "{smallest:e}");
    assert!(largest <= 1.0);
}

/// The updates must be those of the full matrices.
#[test]
fn an_update_is_the_textbook_s() {
    let mut variances = [0.0; STATES];
    for (k, variance) in variances.iter_mut().enumerate() {
        *variance = 0.01 + 0.003 * k as f32;
    }
    let mut p = Covariance::ZERO;
    p.set_diagonal(&variances);
    p.advance(1e-3, 1.0);
    let mut state = adapter(Settings::NOMINAL).state;
    let mut x = [0.0_f64; STATES];
    let mut full: Vec<Vec<f64>> = (0..STATES).map(|i| (0..STATES).map(|j| p.get(i, j).into()).collect()).collect();
    let measurement =
        |innovation, angle, amplitude, third| Measurement { innovation, noise: 1e-3, angle, amplitude, third };
    let measurements =
        [measurement(0.02, 0.9, 0.4, -0.3), measurement(-0.05, -0.2, 0.95, 0.7), measurement(0.01, -0.7, -0.8, 0.1)];
    // Learnt from, then in part, then followed.
    let single = measurements.iter().enumerate();
    for (share, (sensor, m)) in [1.0, 0.3, 0.0].into_iter().flat_map(|share| single.clone().map(move |m| (share, m))) {
        let own = OFFSET[sensor];
        let mut h = [0.0_f64; STATES];
        (h[ANGLE], h[THIRD], h[own], h[own + 1]) = (m.angle.into(), m.third.into(), 1.0, m.amplitude.into());
        if sensor != 0 {
            h[own + 2] = (-m.angle).into();
        }
        let b: Vec<f64> = full.iter().map(|p| p.iter().zip(&h).map(|(p, h)| p * h).sum()).collect();
        let s = b.iter().zip(&h).map(|(b, h)| b * h).sum::<f64>() + 1e-3;
        assert!((f64::from(m.variance(sensor, &p)) - (s - 1e-3)).abs() < 1e-7);
        let cross = m.cross(sensor, &p);
        p.update_by(m, &cross, &mut state, share);
        for i in 0..STATES {
            // The share of the best gain; a partial update leaves (1 − share)² of what it could explain.
            let of = |state: usize| if state < THIRD { 1.0 } else { f64::from(share) };
            x[i] += of(i) * b[i] / s * f64::from(m.innovation);
            for j in 0..STATES {
                full[i][j] -= (1.0 - (1.0 - of(i)) * (1.0 - of(j))) * b[i] * b[j] / s;
            }
        }
    }
    for i in 0..STATES {
        for j in 0..STATES {
            assert!((f64::from(p.get(i, j)) - full[i][j]).abs() < 1e-7, "{i} {j}");
        }
    }
    let values = [state.angle.to_radians(), state.speed, state.third, state.offset[0], state.amplitude[1] - 1.0];
    for (value, exact) in values.iter().zip([ANGLE, SPEED, THIRD, OFFSET[0], OFFSET[1] + 1].map(|k| x[k])) {
        assert!((f64::from(*value) - exact).abs() < 1e-6, "{value} {exact}");
    }
}

#[test]
fn every_sample_of_every_sensor_is_used_once() {
    let mut window = Window::default();
    let mut used = [[0; 3]; 100];
    for k in 0..100_u16 {
        // Some are lost before the fortieth.
        let elapsed = if k == 40 { 7 } else { 1 };
        match window.push(&[k, k + 1000, k + 2000], elapsed) {
            (sensor, Some(mean)) => {
                assert_eq!(mean, f32::from(k - 1 + 1000 * sensor as u16));
                (0..3).for_each(|back| used[usize::from(k - back)][sensor] += 1);
            }
            (sensor, None) => {
                assert!([0, 1, 40, 41].contains(&k));
                used[usize::from(k)][sensor] += 1;
            }
        }
    }
    assert!(used.iter().all(|sensors| sensors.iter().all(|&times| times <= 1)));
    for whole in [2..38, 42..97] {
        assert!(used[whole].iter().all(|sensors| *sensors == [1; 3]));
    }
}

#[test]
fn the_mean_of_three_samples_is_predicted() {
    let sensor = Sensor { third: 0.05, fifth: 0.01, ..Sensor::sinusoidal(2000.0, 300.0, ElectricalAngle::THIRD) };
    let sensors = CalibratedSensor::new(&sensor, 2.5);
    let mut state = adapter(Settings::NOMINAL).state;
    for k in 0..100_u16 {
        state.angle = ElectricalAngle::from_turns(0.01 * f32::from(k));
        state.speed = FASTEST_SPEED * (0.02 * f32::from(k) - 1.0);
        let step = ElectricalAngle::from_radians(state.speed);
        let mean =
            [-step, ElectricalAngle::ZERO, step].map(|by| sensor.code(state.angle + by)).iter().sum::<f32>() / 3.0;
        let measured = sensors.measure_mean(1, &state, mean, 0.0);
        assert!(measured.innovation.abs() < 2e-4, "{}", measured.innovation);
    }
}

#[test]
fn it_is_as_small_as_documented() {
    assert!((700..=800).contains(&size_of::<Adapter>()), "{}", size_of::<Adapter>());
}

#[test]
fn what_a_person_reads_names_the_sensor() {
    let fault = Fault::Drifted(Channel(2), Parameter::Offset);
    assert!(std::format!("{fault}").contains("offset of Hall 3"));
    assert_eq!(Fault::Lost(Channel(1)).lost(), Some(Channel(1)));
    assert_eq!(fault.lost(), None);
}

/// The second sensor fades to an eighth over forty power-ups; what was learnt is kept from one to the next.
#[test]
fn power_ups_do_not_move_the_limits_from_the_calibration() {
    let config = Settings::default().validate().unwrap();
    let calibrated = Model::nominal(12, 250.0, ElectricalAngle::THIRD);
    let (mut learnt, mut true_model) = (calibrated, calibrated);
    let mut ended = None;
    for boot in 0..40 {
        let mut adapter = Adapter::resume(&config, &calibrated, &learnt).unwrap();
        true_model.sensors[1].amplitude = 250.0 * 0.95_f32.powi(boot);
        for k in 0..8000_u32 {
            // Ten electrical turns a second.
            let angle = ElectricalAngle::from_turns(k as f32 * 0.01 % 1.0);
            let codes = true_model.codes(angle);
            if let Status::Failed(fault) = adapter.update(&Observation { codes, elapsed: 1, torque_nm: 0.0 }) {
                ended = ended.or(Some((boot, fault)));
            }
        }
        learnt = *adapter.model();
        let share = learnt.sensors[1].amplitude / calibrated.sensors[1].amplitude;
        assert!(share >= 0.549, "{share} of the calibration after {boot} power-ups");
    }
    // 0.95¹² is below the limit of 0.55.
    let (boot, fault) = ended.expect("what is beyond the limits is told");
    assert!((10..=14).contains(&boot), "{boot}");
    assert_eq!(fault, Fault::Drifted(Channel(1), Parameter::Amplitude));
}

#[test]
fn what_was_learnt_goes_on_from_where_it_was_and_is_cut_to_the_limits() {
    let config = Settings::default().validate().unwrap();
    let calibrated = Model::nominal(12, 250.0, ElectricalAngle::THIRD);
    let mut learnt = calibrated;
    learnt.sensors[0].offset += 20.0;
    learnt.sensors[2].amplitude *= 0.8;
    learnt.sensors[1].placement += ElectricalAngle::from_degrees(3.0);
    learnt.sensors.iter_mut().for_each(|sensor| sensor.third = 0.04);
    let near = |a: &Model, b: &Model| {
        a.sensors.iter().zip(&b.sensors).all(|(a, b)| {
            (a.offset - b.offset).abs() < 0.01
                && (a.amplitude - b.amplitude).abs() < 0.01
                && (a.placement - b.placement).to_degrees().abs() < 0.01
                && (a.third - b.third).abs() < 1e-5
        })
    };
    assert!(near(Adapter::resume(&config, &calibrated, &learnt).unwrap().model(), &learnt));
    // Of another firmware, or of a record that was learnt without a calibration beside it.
    learnt.sensors[2].amplitude = 54.0;
    let cut = *Adapter::resume(&config, &calibrated, &learnt).unwrap().model();
    assert!((cut.sensors[2].amplitude - 0.55 * 250.0).abs() < 0.1, "{}", cut.sensors[2].amplitude);
}
