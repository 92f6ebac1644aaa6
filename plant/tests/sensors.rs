//! Hall sensors and converter: statistics, harmonics, limits, faults.
use crate::common::*;
use plant::{
    AdcParameters, HallFault, HallLayout, HallParameters, Harmonic, Legs, Plant, PlantParameters, Rail, Saturation,
    Unevenness,
};
use std::f64::consts::{PI, TAU};

const LSB_V: f64 = 3.3 / 65536.0;

/// Ideal, but read with 16 bit, so that rounding stays below 0.5 LSB of 50 µV.
fn fine() -> PlantParameters {
    let mut parameters = PlantParameters::ideal();
    parameters.adc = AdcParameters::ideal(16, 3.3);
    parameters
}

/// Voltage that the converter shows for a sensor at an electrical angle.
fn volts_at(plant: &Plant, sensor: usize, electrical_rad: f64) -> f64 {
    let mut plant = plant.clone();
    plant.place(electrical_rad / PAIRS, 0.0).unwrap();
    f64::from(plant.sample().halls[sensor]) * LSB_V
}

/// Each harmonic as asked, locked to the fundamental. Rounding to 50 µV averages out over the
/// 7200 angles of the sum: 2 µV.
#[test]
fn halls_show_what_they_are_made_of() {
    let mut parameters = fine();
    parameters.hall_phase_rad = 0.4;
    for (sensor, hall) in parameters.halls.iter_mut().enumerate() {
        *hall = HallParameters {
            third: 0.05,
            fifth: -0.03,
            ..HallParameters::ideal(
                1.5 + 0.1 * sensor as f64,
                0.3 + 0.1 * sensor as f64,
                HallLayout::Deg60Reversed.placement_rad(sensor) + 0.1,
            )
        };
        hall.saturation = Saturation::hard(3.3);
    }
    let plant = Plant::new(&parameters, 0).unwrap();
    for sensor in 0..3 {
        let lag = 0.4 + 0.1 - PI / 3.0 * sensor as f64;
        let amplitude = 0.3 + 0.1 * sensor as f64;
        for (n, height) in [(1.0, 1.0), (2.0, 0.0), (3.0, 0.05), (5.0, -0.03), (7.0, 0.0)] {
            let (sin, cos) = fourier(|angle| volts_at(&plant, sensor, angle), n);
            close(sin, amplitude * height * (n * lag).cos(), 2e-6);
            close(cos, -amplitude * height * (n * lag).sin(), 2e-6);
        }
        let (_, twice_mean) = fourier(|angle| volts_at(&plant, sensor, angle), 0.0);
        close(0.5 * twice_mean, 1.5 + 0.1 * sensor as f64, 2e-6);
    }
}

/// Harmonics of one's own, in any phase, beside those locked to the fundamental.
#[test]
fn harmonics_need_not_be_locked() {
    let mut parameters = fine();
    let own = [(0.04, 0.3), (0.02, -1.1), (0.03, 2.0), (-0.01, 0.7), (0.015, 3.0), (0.02, -2.0)];
    parameters.halls[1].harmonics = own.map(|(size, phase_rad)| Harmonic { size, phase_rad });
    parameters.halls[1].third = 0.05;
    let plant = Plant::new(&parameters, 0).unwrap();
    let lag = TAU / 3.0;
    for (k, (size, phase_rad)) in own.into_iter().enumerate() {
        let n = k as f64 + 2.0;
        let (sin, cos) = fourier(|angle| volts_at(&plant, 1, angle), n);
        let locked = if k == 1 { 0.05 } else { 0.0 };
        close(sin, size * (phase_rad - n * lag).cos() + locked * (n * lag).cos(), 2e-6);
        close(cos, size * (phase_rad - n * lag).sin() - locked * (n * lag).sin(), 2e-6);
    }
}

/// Each sensor sees the magnet that is below it: the strength where the wave is at its peaks, the displacement where it
/// goes through zero.
#[test]
fn uneven_magnets_pass_the_sensors_one_after_the_other() {
    let mut parameters = fine();
    parameters.magnets = Unevenness { gain: 0.2, pitch_deg: 8.0, ..Unevenness::NONE }.magnets(5);
    parameters.halls[2].turns_away = 2;
    for hall in &mut parameters.halls {
        hall.saturation = Saturation::hard(3.3);
    }
    let plant = Plant::new(&parameters, 0).unwrap();
    let mut plants = plant.clone();
    for (sensor, place) in [0.0, TAU / 3.0 / PAIRS, (2.0 * TAU / 3.0 + 2.0 * TAU) / PAIRS].into_iter().enumerate() {
        for pole in 0..8 {
            let (strength, displaced) = parameters.magnets.pole(pole);
            // The field is at its peak a displacement behind the middle of the pole.
            let sign = if pole % 2 == 0 { 1.0 } else { -1.0 };
            plants.place(place + (f64::from(pole) + 0.5) * PI / PAIRS, 0.0).unwrap();
            let volts = f64::from(plants.sample().halls[sensor]) * LSB_V;
            close(volts, 1.65 + sign * strength * displaced.cos(), LSB_V);
        }
    }
    // Three times a turn apart, the same place is seen again.
    for sensor in 0..3 {
        let at = |turns: f64| volts_at(&plant, sensor, 1.0 + TAU * turns);
        assert_ne!(at(0.0), at(1.0));
        close(at(0.0), at(PAIRS), LSB_V);
    }
}

/// Two per cent of the magnets' field along q turn what the Halls see by 1.15° electrical.
#[test]
fn the_field_of_the_windings_turns_that_of_the_magnets() {
    let halls = Unevenness { coil: 0.02, rated_a: 3.0, ..Unevenness::NONE }.halls(fine().halls, 0.0, 1);
    let angle: f64 = 0.8;
    // A current vector along q.
    let currents = [0.0, 1.0, 2.0].map(|phase| -3.0 * (angle - phase * TAU / 3.0).sin());
    let field = halls.map(|hall| {
        let stray: f64 = hall.coupling_v_a.iter().zip(currents).map(|(volts, amperes)| volts * amperes).sum();
        (angle - hall.placement_rad).sin() + stray / hall.amplitude_v
    });
    let sum = |of: fn(f64) -> f64| (0..3).map(|k| field[k] * of(TAU / 3.0 * k as f64)).sum::<f64>();
    let seen = sum(f64::cos).atan2(-sum(f64::sin));
    close(deg(seen - angle), deg(0.02_f64.atan()), 1e-9);
}

#[test]
fn layouts_are_what_they_say() {
    for (layout, spacing) in [
        (HallLayout::Deg120, 120.0),
        (HallLayout::Deg120Reversed, -120.0),
        (HallLayout::Deg60, 60.0),
        (HallLayout::Deg60Reversed, -60.0),
    ] {
        for sensor in 0..3 {
            close(deg(layout.placement_rad(sensor)), spacing * sensor as f64, 1e-12);
        }
    }
}

/// Mean, deviation, skewness, kurtosis and the independence of neighbours, each within four of its
/// standard errors for 40 000 samples.
#[test]
fn hall_noise_is_gaussian_of_the_size_asked_for() {
    let mut parameters = fine();
    for hall in &mut parameters.halls {
        hall.noise = 0.01;
        hall.amplitude_v = 0.8;
    }
    let mut plant = Plant::new(&parameters, 7).unwrap();
    let (n, deviation) = (40_000, 0.008);
    let samples: Vec<[f64; 3]> = (0..n).map(|_| plant.sample().halls.map(|code| f64::from(code) * LSB_V)).collect();
    let mean_of = |of: &dyn Fn(&[f64; 3]) -> f64| samples.iter().map(of).sum::<f64>() / f64::from(n);
    let error = 4.0 / f64::from(n).sqrt();
    for sensor in 0..3 {
        let mean = mean_of(&|s| s[sensor]);
        let place = HallLayout::Deg120.placement_rad(sensor);
        close(mean, 1.65 - 0.8 * place.sin(), error * deviation);
        let moment = |power| mean_of(&|s| ((s[sensor] - mean) / deviation).powi(power));
        close(moment(2), 1.0, error * 2f64.sqrt());
        close(moment(3), 0.0, error * 6f64.sqrt());
        close(moment(4), 3.0, error * 96f64.sqrt());
        let other = (sensor + 1) % 3;
        let middle = mean_of(&|s| s[other]);
        let together = mean_of(&|s| (s[sensor] - mean) * (s[other] - middle));
        close(together / (deviation * deviation), 0.0, error);
        let next: f64 = samples.windows(2).map(|w| (w[0][sensor] - mean) * (w[1][sensor] - mean)).sum();
        close(next / f64::from(n) / (deviation * deviation), 0.0, error);
    }
}

#[test]
fn temperature_and_currents_reach_the_halls() {
    let mut parameters = fine();
    parameters.halls[1].offset_drift_v_k = 1e-3;
    parameters.halls[1].amplitude_drift_k = -2e-3;
    parameters.halls[1].coupling_v_a = [0.01, -0.02, 0.005];
    let mut plant = Plant::new(&parameters, 0).unwrap();
    plant.set_dyno(Some(0.0)).unwrap();
    plant.set_temperature(75.0).unwrap();
    hold(&mut plant, Legs::pwm([0.6, 0.3, 0.4]), 200);
    let [a, b, c] = plant.truth().currents_a;
    let field = -0.9 * (2.0 * PI / 3.0).sin();
    let expected = 1.65 + 0.05 + field + 0.01 * a - 0.02 * b + 0.005 * c;
    assert!(a > 0.5);
    close(f64::from(plant.sample().halls[1]) * LSB_V, expected, 0.51 * LSB_V);
}

/// The windings' field turns with the current vector, as the rotor's with the rotor.
#[test]
fn the_windings_are_a_magnet_of_a_share() {
    for placement_rad in [0.0, 2.0, 4.3] {
        let hall = HallParameters::ideal(1.65, 0.9, placement_rad).with_windings(0.05, 3.0, 0.4);
        for k in 0..36 {
            let direction = TAU * f64::from(k) / 36.0;
            let currents = [0.0, 1.0, 2.0].map(|phase| 2.0 * (direction - phase * TAU / 3.0).cos());
            let volts: f64 = hall.coupling_v_a.iter().zip(currents).map(|(c, i)| c * i).sum();
            close(volts, 0.05 * 0.9 * (2.0 / 3.0) * (direction - 0.4 - placement_rad).sin(), 1e-12);
        }
    }
}

/// Hard clipping stops at the rails; a knee bends smoothly, never passes them, and leaves what is
/// below it alone.
#[test]
fn saturation_holds_the_rails() {
    let shape = |knee: f64| {
        let mut parameters = fine();
        parameters.halls[0].amplitude_v = 2.5;
        parameters.halls[0].saturation = Saturation { low_v: 0.2, high_v: 3.1, knee };
        let plant = Plant::new(&parameters, 0).unwrap();
        move |angle: f64| volts_at(&plant, 0, angle)
    };
    let (hard, soft) = (shape(1.0), shape(0.8));
    for i in 0..720 {
        let angle = TAU * f64::from(i) / 720.0;
        let field = 1.65 + 2.5 * angle.sin();
        close(hard(angle), field.clamp(0.2, 3.1), 0.51 * LSB_V);
        let bent = soft(angle);
        let beyond = (field - 1.65).abs() - 0.8 * 1.45;
        if beyond <= 0.0 {
            close(bent, field, 0.51 * LSB_V);
        } else {
            let room = 0.2 * 1.45;
            let out = 0.8 * 1.45 + room * (beyond / room).tanh();
            close(bent, 1.65 + out.copysign(field - 1.65), 0.51 * LSB_V);
        }
        assert!((0.2 - LSB_V..=3.1 + LSB_V).contains(&bent));
    }
}

/// A first-order lag at ω·τ = 1 delays by 45° and weakens by √2. The input taken as straight
/// between samples (48 a turn) errs by (ωT)²/12 = 0.15 %, which with rounding sets the tolerance.
#[test]
fn bandwidth_lags_as_a_first_order_system() {
    let mut parameters = fine();
    let hz = 40e3 / 48.0;
    parameters.halls[0].bandwidth_hz = Some(hz);
    let mut plant = Plant::new(&parameters, 0).unwrap();
    plant.set_dyno(Some(TAU * hz / PAIRS)).unwrap();
    for _ in 0..480 {
        plant.advance(&Legs::OFF);
    }
    let (mut sin, mut cos) = (0.0, 0.0);
    for _ in 0..48 {
        plant.advance(&Legs::OFF);
        let angle = plant.truth().electrical_angle_rad;
        let volts = f64::from(plant.sample().halls[0]) * LSB_V;
        sin += volts * angle.sin() / 24.0;
        cos += volts * angle.cos() / 24.0;
    }
    close(sin.hypot(cos), 0.5f64.sqrt(), 0.002);
    close(deg(cos.atan2(sin)), -45.0, 0.1);
}

/// A delay keeps the size and turns the phase by what the rotor turns in it, in steps and between them.
#[test]
fn a_delay_is_the_same_signal_later() {
    for delay_s in [12.5e-6, 25e-6, 60e-6, 0.5e-3] {
        let mut parameters = fine();
        let hz = 40e3 / 96.0;
        parameters.halls[0].delay_s = delay_s;
        let mut plant = Plant::new(&parameters, 0).unwrap();
        plant.set_dyno(Some(TAU * hz / PAIRS)).unwrap();
        for _ in 0..480 {
            plant.advance(&Legs::OFF);
        }
        let (mut sin, mut cos) = (0.0, 0.0);
        for _ in 0..96 {
            plant.advance(&Legs::OFF);
            let angle = plant.truth().electrical_angle_rad;
            let volts = f64::from(plant.sample().halls[0]) * LSB_V;
            sin += volts * angle.sin() / 48.0;
            cos += volts * angle.cos() / 48.0;
        }
        close(sin.hypot(cos), 1.0, 0.002);
        close(deg(cos.atan2(sin)), -360.0 * hz * delay_s, 0.1);
    }
}

#[test]
fn faults_come_and_go() {
    let mut plant = Plant::new(&fine(), 0).unwrap();
    plant.place(0.5 / PAIRS, 0.0).unwrap();
    let healthy = plant.sample();
    let code = |volts: f64| (volts / LSB_V).round() as u16;
    plant.set_hall_fault(0, Some(HallFault::StuckAt(1.0)));
    plant.set_hall_fault(1, Some(HallFault::Open(Rail::Low)));
    plant.set_hall_fault(2, Some(HallFault::Open(Rail::High)));
    assert_eq!(plant.sample().halls, [code(1.0), 0, 65535]);
    for sensor in 0..3 {
        plant.set_hall_fault(sensor, None);
    }
    assert_eq!(plant.sample(), healthy);
    plant.set_hall_fault(2, Some(HallFault::ShortedTo(0)));
    let shorted = plant.sample().halls;
    assert_eq!(shorted[0], shorted[2]);
    let mean = (f64::from(healthy.halls[0]) + f64::from(healthy.halls[2])) / 2.0;
    close(f64::from(shorted[0]), mean, 1.0);
    assert_eq!(shorted[1], healthy.halls[1]);
    plant.set_hall_fault(2, Some(HallFault::Noisy(0.1)));
    let far = (0..200).filter(|_| plant.sample().halls[2].abs_diff(healthy.halls[2]) > code(0.1)).count();
    assert!((40..90).contains(&far), "{far}"); // 32 % of 200, give or take four deviations
}

/// Every code of an 8-bit converter, by bisecting for the voltage where it begins: half a step
/// below its nominal voltage, moved by gain and offset errors.
#[test]
fn converter_rounds_and_clips() {
    let mut parameters = PlantParameters::ideal();
    parameters.adc = AdcParameters { bits: 8, reference_v: 2.56, gain_error: 0.01, offset_lsb: 0.3 };
    let mut plant = Plant::new(&parameters, 0).unwrap();
    let mut code_at = |volts: f64| {
        plant.set_hall_fault(0, Some(HallFault::StuckAt(volts)));
        plant.sample().halls[0]
    };
    for code in 1..=255 {
        let begins = (f64::from(code) - 0.5 - 0.3) * 0.01 / 1.01;
        assert_eq!(code_at(begins - 1e-9), code - 1);
        assert_eq!(code_at(begins + 1e-9), code);
    }
    assert_eq!(code_at(-5.0), 0);
    assert_eq!(code_at(9.0), 255);
}

#[test]
fn currents_and_bus_are_read_as_scaled() {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    hold(&mut plant, Legs::pwm([0.9, 0.5, 0.2]), 200);
    let (truth, codes) = (plant.truth(), plant.sample());
    let lsb_v = 3.3 / 4096.0;
    for k in 0..3 {
        let amps = (f64::from(codes.currents[k]) * lsb_v - 1.65) / 0.2;
        close(amps, truth.currents_a[k], 0.51 * lsb_v / 0.2);
    }
    close(f64::from(codes.bus) * lsb_v * 11.0, 24.0, 0.51 * lsb_v * 11.0);
}
