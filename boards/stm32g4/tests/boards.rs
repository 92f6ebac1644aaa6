//! The boards' constants: every register that decides whether transistors burn, and the settings a drive starts with.

use hallservo::commutation::svpwm::Modulator;
use hallservo::pwm;
use hallservo::settings::Control;
use hallservo::settings::{Error, Settings};
use stm32g4::registers::adc::Sequence;
use stm32g4::registers::{analog, timer};
use stm32g4::wiring::Wiring;

// What only the chip uses.
#[allow(dead_code)]
#[path = "../../b-g431b-esc1/src/constants.rs"]
mod esc1;
#[allow(dead_code)]
#[path = "../../nucleo-g474re-ihm08m1/src/constants.rs"]
mod nucleo;

#[test]
fn timer_of_the_nucleo() {
    let Wiring { gates, source, lead, .. } = nucleo::BRIDGE;
    assert_eq!(nucleo::BRIDGE.period(), 2125);
    // DTG = 85 ticks, 500 ns; LOCK 2; OSSI, OSSR, BKE; BKP = 0, active low; BKF = 1001: 64 ticks, 376 ns.
    assert_eq!(nucleo::BRIDGE.bdtr(), 85 | 2 << 8 | 0b0111 << 10 | 9 << 16);
    assert_eq!(timer::af1(source), 1);
    // L6398: all CCxNP set, idle levels of the lower outputs high.
    assert_eq!(timer::legs(gates, 7).ccer, 0xDDD);
    assert_eq!(timer::cr2(gates), 0x0070_2A01);
    // 24.5 cycles for the Halls, 12.5 for U and W: held 207 and 307 ticks after the trigger.
    assert_eq!(lead, 257);
}

#[test]
fn timer_of_the_esc() {
    let Wiring { gates, source, lead, .. } = esc1::BRIDGE;
    assert_eq!(esc1::BRIDGE.period(), 2125);
    // DTG = 10 000100: 136 ticks, 800 ns; BKP = 1, active high; BKF = 1111: 256 ticks, 1.5 µs.
    assert_eq!(esc1::BRIDGE.bdtr(), 0x84 | 2 << 8 | 0b1111 << 10 | 15 << 16);
    assert_eq!(timer::af1(source), 1 << 1 | 1 << 2 | 1 << 4);
    // L6387: nothing inverted, all idle levels low.
    assert_eq!(timer::legs(gates, 7).ccer, 0x555);
    assert_eq!(timer::cr2(gates), 0x0070_0001);
    // 12.5 cycles each: held 59 and 159 ticks after the trigger.
    assert_eq!(lead, 109);
}

#[test]
fn sequences_of_the_nucleo() {
    // Hall 3 PB14, U PA0, W PC0 on ADC1; bus PA1, V PC1, temperature PC2 on ADC2; PB13 on ADC3; PB12 on ADC4.
    assert_eq!(channels(&nucleo::FIRST), [5, 1, 6]);
    assert_eq!(channels(&nucleo::SECOND), [2, 7, 8]);
    assert_eq!((channels(&nucleo::THIRD), channels(&nucleo::FOURTH)), (vec![5], vec![3]));
    assert_eq!(nucleo::FIRST.jsqr(), 2 | 8 << 2 | 1 << 7 | 5 << 9 | 1 << 15 | 6 << 21);
    // 24.5 cycles (3) for channel 5, 12.5 (2) for 1 and 6.
    assert_eq!(nucleo::FIRST.smpr(), [3 << 15 | 2 << 3 | 2 << 18, 0]);
    // All three Halls at once.
    assert_eq!([nucleo::FIRST.held(0), nucleo::THIRD.held(0), nucleo::FOURTH.held(0)], [107; 3]);
    assert_eq!(nucleo::FIRST.done(), 357);
}

#[test]
fn sequences_of_the_esc() {
    // U PA2, W PB1, Hall 3 PB11, temperature PB14 on ADC1; V PA6, Hall 1 PA4, Hall 2 PC4, bus PA0 on ADC2.
    assert_eq!(channels(&esc1::FIRST), [3, 12, 14, 5]);
    assert_eq!(channels(&esc1::SECOND), [3, 17, 5, 1]);
    assert_eq!(esc1::SECOND.jsqr(), 3 | 8 << 2 | 1 << 7 | 3 << 9 | 17 << 15 | 5 << 21 | 1 << 27);
    // Hall 1 is 25 ADC cycles early: 588 ns.
    assert_eq!(esc1::EARLY, 100);
    assert_eq!(esc1::FIRST.done(), 549);
}

#[test]
fn comparators_of_the_esc_trip_at_sixty_amperes() {
    // At the pins: 4/7 of 3 mΩ · 60 A, above 3.3 V · (1.5 ∥ 2.2) / (22 + 1.5 ∥ 2.2).
    let parallel = 1.5 * 2.2 / 3.7;
    let volts = 3.3 * parallel / (22.0 + parallel) + 60.0 * 0.003 * 4.0 / 7.0;
    assert!((f64::from(esc1::TRIP_UV) * 1e-6 - volts).abs() < 0.5e-3, "{volts}");
    assert_eq!(analog::dac_code(esc1::TRIP_UV), 288);
    // The same bias, sixteen times, is the zero of the ADC.
    let zero = 16.0 * 3.3 * parallel / (22.0 + parallel) / 3.3 * 4096.0;
    assert!((f64::from(esc1::ZERO) - zero).abs() < 1.0, "{zero}");
}

/// A drive must be able to start with what a board gives it, and the timer must agree with the drive.
#[test]
fn settings_are_valid_and_agree_with_the_registers() {
    for (settings, wiring) in [(nucleo::settings(), nucleo::BRIDGE), (esc1::settings(), esc1::BRIDGE)] {
        let config = settings.validate().unwrap();
        assert_eq!((config.period, config.dead_time), (wiring.period(), wiring.dead_time_ticks()));
        assert_eq!(config.adc_bits, 12);
        assert_eq!((settings.pwm_hz, settings.timer_hz), (40e3, 170e6));
    }
}

/// Of the voltage that a bridge without sampling and dead time reaches, 1/√3 of the bus.
#[test]
fn what_sampling_and_dead_time_leave_of_the_voltage() {
    for (settings, hz, expected) in [
        (nucleo::settings(), 40e3, 0.84),
        (nucleo::settings(), 20e3, 0.92),
        (esc1::settings(), 40e3, 0.74),
        (esc1::settings(), 20e3, 0.87),
    ] {
        let period = pwm::period_counts(settings.timer_hz, hz).unwrap();
        let dead_time = pwm::dead_time_counts(settings.timer_hz, hz, settings.dead_time_s).unwrap();
        let highest = pwm::highest_compare(period, settings.timer_hz, settings.sampling_window_s, settings.dead_time_s);
        let limits = pwm::Limits::new(period, 0, highest).unwrap();
        let left = Modulator::longest(period, dead_time, &limits) * 3.0_f64.sqrt();
        assert!((left - expected).abs() < 0.005, "{hz}: {left}");
    }
}

/// Three lithium cells and 12 V supplies: the current control has room for the default motor down to the least bus voltage. A motor for
/// which there is none is told how much there is.
#[test]
fn the_esc_serves_three_cells() {
    let with = |inductance_h: f32, current_bandwidth_hz: f32| {
        let control = esc1::settings().control.unwrap();
        let control = Some(Control { inductance_h, current_bandwidth_hz, ..control });
        Settings { control, ..esc1::settings() }.validate()
    };
    assert_eq!(esc1::settings().control.unwrap().guard.under_voltage_v, 9.0);
    assert!(with(0.43e-3, 1000.0).is_ok());
    let Err(Error::OutOfRange { field: "current_bandwidth_hz", max, .. }) = with(1e-3, 1000.0) else { panic!() };
    assert!((430.0..450.0).contains(&max), "{max}");
    assert!(with(1e-3, 430.0).is_ok());
}

#[test]
fn currents_are_sampled_while_the_lower_transistors_conduct() {
    let last = [2, 1];
    for (k, (settings, wiring, sequence, first)) in
        [(nucleo::settings(), nucleo::BRIDGE, nucleo::FIRST, 1), (esc1::settings(), esc1::BRIDGE, esc1::FIRST, 0)]
            .into_iter()
            .enumerate()
    {
        let Settings { sampling_window_s, timer_hz, .. } = settings;
        let half = sampling_window_s * timer_hz / 2.0;
        // From half a window before the valley the amplifiers settle; then they are sampled until after it.
        let begins = wiring.lead - sequence.begun(first);
        let ends = sequence.held(last[k]) - wiring.lead;
        assert!(begins as f32 + 0.5e-6 * timer_hz < half && (ends as f32) < half, "{begins} {ends} {half}");
    }
}

fn channels(sequence: &Sequence) -> Vec<u8> {
    sequence.0.iter().map(|rank| rank.channel).collect()
}
