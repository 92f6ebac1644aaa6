use super::*;

/// The example motor of Simpkins and Todorov.
const R: f32 = 3.75;
const L: f32 = 0.36e-3;

#[test]
fn the_corrected_numbers_of_equation_18() {
    let near = |found: f32, expected: f32| assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
    near(ripple_frequency(R, L, 1.0), 518e3);
    near(ripple_frequency(R, L, 3.5), 146e3);
    near(ripple_percent(R, L, 51.8e3), 9.57);
    near(ripple_percent(R, L, 50e3), 9.89);
    for percent in [0.1, 1.0, 10.0, 60.0, 99.0] {
        near(ripple_percent(R, L, ripple_frequency(R, L, percent)), percent);
    }
}

#[test]
fn the_corrected_numbers_of_equation_19() {
    let bits = |hz| resolution_bits(hz, 50e-9);
    assert!((bits(10e3) - 11.97).abs() < 5e-3 && (bits(40e3) - 9.97).abs() < 5e-3);
    assert!((libm::exp2f(bits(10e3)) - 4000.0).abs() < 1.0 && (libm::exp2f(bits(40e3)) - 1000.0).abs() < 1.0);
}

#[test]
fn a_square_wave_to_zero_doubles_the_loss() {
    assert_eq!(square_wave_loss(1.0), 2.0);
    assert_eq!(square_wave_loss(0.0), 1.0);
}

#[test]
fn dead_time_is_never_shorter_than_asked() {
    let timer_hz = 170e6;
    for tenth_ns in 0..20_000 {
        let seconds = tenth_ns as f32 * 1e-10;
        let counts = dead_time_counts(timer_hz, 40e3, seconds).unwrap();
        let exact = f64::from(seconds) * f64::from(timer_hz);
        assert!(f64::from(counts) >= exact - 1e-4 && f64::from(counts) < exact + 1.0, "{tenth_ns} {counts}");
    }
    assert_eq!(dead_time_counts(timer_hz, 40e3, 800e-9), Ok(136));
    assert_eq!(dead_time_counts(timer_hz, 40e3, 801e-9), Ok(137));
    for wrong in [-1e-9, 3e-6, f32::NAN] {
        assert!(dead_time_counts(timer_hz, 40e3, wrong).is_err());
    }
}

#[test]
fn period_in_counts() {
    assert_eq!(period_counts(170e6, 40e3), Ok(2125));
    for (timer, pwm) in [(170e6, 1e3), (170e6, 10e6), (170e6, 0.0), (170e6, -40e3), (f32::NAN, 40e3)] {
        assert!(matches!(period_counts(timer, pwm), Err(Error::Period(_))), "{timer} {pwm}");
    }
}

#[test]
fn the_sampling_window_bounds_the_duty() {
    let high = highest_compare(2125, 170e6, 1e-6, 0.5e-6);
    // The lower transistor conducts from `high` to `period` and back.
    let low_side_s = 2.0 * f32::from(2125 - high) / 170e6;
    assert!((1.5e-6..1.52e-6).contains(&low_side_s), "{low_side_s}");
    assert_eq!(highest_compare(100, 170e6, 1.0, 0.0), 0);
}

#[test]
fn amplitudes_stay_in_the_limits() {
    let limits = Limits::new(2125, 100, 2085).unwrap();
    assert_eq!(limits.amplitude(Modulation::ZERO), Amplitude::ZERO);
    for bits in (i16::MIN..=i16::MAX).step_by(7) {
        let command = Modulation::from_bits(bits);
        let counts = limits.amplitude(command).to_counts();
        let asked = 1062.0 * command.to_num::<f64>();
        assert!(counts.abs() <= 960.0);
        assert_eq!(limits.limits(command), (counts - asked).abs() > 0.01, "{bits} {counts}");
    }
    for (period, low, high) in [(2125, 1060, 1066), (2125, 100, 1060), (2125, 0, 2200), (10, 0, 10)] {
        assert_eq!(Limits::new(period, low, high), Err(Error::Limits { low, high }));
    }
}

#[test]
fn the_frequency_fits_motor_and_bridge() {
    let needs = FrequencyNeeds {
        resistance_ohm: R,
        inductance_h: L,
        ripple_percent: 3.5,
        cycle_s: 1.0 / 170e6,
        least_bits: 10.0,
        highest_hz: 100e3,
        lowest_hz: 20e3,
    };
    let choice = needs.choose().unwrap();
    assert!((choice.pwm_hz / 73e3 - 1.0).abs() < 0.01 && choice.reached, "{choice:?}");
    assert!((choice.ripple_percent - 3.5).abs() < 0.01);
    // The paper's amplifier ends at 50 kHz.
    let slow = FrequencyNeeds { highest_hz: 50e3, ..needs }.choose().unwrap();
    assert!(slow.pwm_hz == 50e3 && !slow.reached && slow.ripple_percent > 5.0);
    // The resolution ends at 2/(T·2^bits).
    let coarse = FrequencyNeeds { cycle_s: 50e-9, ..needs }.choose().unwrap();
    assert!((coarse.bits - 10.0).abs() < 1e-3 && !coarse.reached);
    // A slow motor does not need more than what cannot be heard.
    let lazy = FrequencyNeeds { inductance_h: 10e-3, ..needs }.choose().unwrap();
    assert!(lazy.pwm_hz == 20e3 && lazy.reached);
    for bad in [
        FrequencyNeeds { resistance_ohm: f32::NAN, ..needs },
        FrequencyNeeds { inductance_h: 0.0, ..needs },
        FrequencyNeeds { ripple_percent: 100.0, ..needs },
        FrequencyNeeds { lowest_hz: 200e3, ..needs },
    ] {
        assert_eq!(bad.choose(), None);
    }
}

#[test]
fn a_fraction_is_rounded_and_saturates() {
    for (fraction, bits) in [(0.5, 16_384), (-0.100_02, -3277), (1.0, 32_767), (-7.0, -32_767), (f32::NAN, 0)] {
        assert_eq!(modulation(fraction).to_bits(), bits, "{fraction}");
    }
}

#[test]
fn both_ends_of_a_fraction_are_the_same() {
    assert_eq!(modulation(-1.0), -modulation(1.0));
    assert_eq!((modulation(-2.0), modulation(f32::NAN)), (modulation(-1.0), Modulation::ZERO));
}
