//! The whole chip on its board, as a motor firmware sets it up.

mod common;

use bus::Bus;
use chip::{Disturbance, HallFault};
use common::{Bench, GPIO, TIM1, boards, esc, nucleo};
use std::sync::Arc;

const PERIOD: u64 = 4250;

fn spinning(board: &Arc<chip::Board>) -> Bench {
    let mut bench = Bench::new(board);
    bench.clocks();
    bench.switching(85);
    bench
}

#[test]
fn pwm_and_dead_time_come_out_of_the_pins() {
    for board in &boards() {
        let mut bench = spinning(board);
        bench.run(100 * PERIOD);
        let facts = bench.chip.facts();
        let pwm = facts.pwm.unwrap();
        assert!((pwm.hz - 40e3).abs() < 1e-6, "{}", pwm.hz);
        assert_eq!((pwm.mode.as_str(), pwm.reload), ("centre-aligned 1", 2125));
        assert!((pwm.dead_time_ns - 500.0).abs() < 1e-9);
        assert_eq!(facts.findings, []);
        for leg in &facts.legs {
            for range in [leg.dead_time_rising_ns, leg.dead_time_falling_ns] {
                assert!((99..=101).contains(&range.count), "{range:?}");
                assert!((range.min - 500.0).abs() < 1e-3 && (range.max - 500.0).abs() < 1e-3, "{range:?}");
            }
            assert_eq!(leg.shoot_through, 0);
        }
        let inverted = board.driver.low_inverted;
        assert_eq!(facts.legs[0].timer_on_level[1], if inverted { "low" } else { "high" });
        assert_eq!(facts.moe.len(), 1);
        assert_eq!((facts.moe[0].on, facts.moe[0].by.as_str()), (true, "software"));
    }
}

#[test]
fn a_voltage_on_a_held_rotor_drives_the_current_of_ohms_law() {
    for board in &boards() {
        let mut bench = spinning(board);
        bench.duties([1062 + 200, 1062 - 100, 1062 - 100]);
        // The rotor aligns with phase U and stays.
        bench.run(20_000 * PERIOD);
        let truth = bench.chip.truth();
        assert!(truth.speed_rad_s.abs() < 1.0, "{}", truth.speed_rad_s);
        // 300 counts of 2125 between U and the others, two thirds of it on U's 3.75 Ω and 20 mΩ; the dead time of
        // 500 ns takes 1/50 of the bus, with the diodes a little more, from either.
        let duty = 300.0 / 2125.0 - 2.0 * 500e-9 * 40e3;
        let expected = duty * truth.bus_v * 2.0 / 3.0 / 3.77;
        let current = truth.currents_a[0];
        assert!((current / expected - 1.0).abs() < 0.05, "{} {current} {expected}", board.name);
    }
}

#[test]
fn the_motor_sees_what_the_simulations_own_inverter_would_give_it() {
    let mut parameters = plant::PlantParameters::ideal();
    parameters.inverter.model = plant::InverterModel::Switched;
    parameters.inverter.dead_time_s = 500e-9;
    parameters.inverter.diode_v = 0.7;
    let mut bench = Bench { chip: chip::Chip::new(esc(), true, &parameters, 1).unwrap(), now: 0 };
    bench.clocks();
    bench.timer(85);
    bench.gate_pins();
    let counts = [1300, 900, 1000];
    bench.duties(counts);
    bench.write(TIM1 + 0x14, 1);
    bench.moe();
    bench.count();
    bench.run(400 * PERIOD);
    let mut other = plant::Plant::new(&parameters, 1).unwrap();
    let legs = plant::Legs::pwm(counts.map(|count| f64::from(count) / 2125.0));
    // The first period has nothing preloaded yet.
    for _ in 0..401 {
        other.advance(&legs);
    }
    bench.write(TIM1 + 0x10, 0);
    let (here, there) = (bench.chip.truth(), other.truth());
    assert!(there.currents_a[0] > 0.3, "{:?}", there.currents_a);
    for phase in 0..3 {
        assert!((here.currents_a[phase] - there.currents_a[phase]).abs() < 5e-3, "{here:?} {there:?}");
    }
    assert!((here.mechanical_angle_rad - there.mechanical_angle_rad).abs() < 1e-3, "{here:?} {there:?}");
}

#[test]
fn a_turning_voltage_turns_the_rotor_either_way() {
    for (board, direction) in [(&nucleo(), 1.0), (&esc(), -1.0)] {
        let mut bench = spinning(board);
        // A field that reaches 10 turns a second, electrical.
        let mut angle = 0.0_f64;
        for step in 0..4000 {
            angle += direction * core::f64::consts::TAU * 10.0 * f64::from(step.min(2000)) / 2000.0 * 10.0 / 40e3;
            let third = core::f64::consts::TAU / 3.0;
            bench.duties([0.0, 1.0, 2.0].map(|k| (1062.0 + 400.0 * (angle - k * third).cos()) as u32));
            bench.run(10 * PERIOD - 12);
        }
        let truth = bench.chip.truth();
        // Four pole pairs.
        let expected = direction * core::f64::consts::TAU * 10.0 / 4.0;
        assert!((truth.speed_rad_s / expected - 1.0).abs() < 0.5, "{} of {expected}", truth.speed_rad_s);
        assert!((truth.mechanical_angle_rad * 4.0 / angle - 1.0).abs() < 0.2, "{} {angle}", truth.mechanical_angle_rad);
        assert_eq!(bench.chip.facts().findings, []);
    }
}

#[test]
fn converters_sample_at_the_valley_all_at_once() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.timer(85);
    bench.gate_pins();
    // Hall 3, currents U and W; bus and current V; Halls 2 and 1.
    bench.converter(0, &[(5, 2), (1, 1), (6, 1)], true);
    bench.converter(1, &[(2, 2), (7, 1)], false);
    bench.converter(2, &[(5, 2)], false);
    bench.converter(3, &[(3, 2)], false);
    bench.count();
    bench.moe();
    bench.run(PERIOD / 2);
    let mut interrupts = Vec::new();
    bench.run_seeing(50 * PERIOD, |chip, now| {
        if chip.interrupts() >> 18 & 1 != 0 {
            for (converter, ranks) in [(0, 3), (1, 2), (2, 1), (3, 1)] {
                for rank in 0..ranks {
                    let (code, complaint) = chip.read(common::ADC[converter] + 0x80 + 4 * rank, bus::Width::Word, now);
                    assert_eq!(complaint, None);
                    assert!((100..4000).contains(&code), "ADC{} rank {rank}: {code}", converter + 1);
                }
            }
            assert_eq!(chip.write(common::ADC[0], bus::Width::Word, 0x60, now), None);
            interrupts.push(now);
        }
    });
    assert_eq!(interrupts.len(), 50);
    assert!(interrupts.windows(2).all(|pair| pair[1] - pair[0] == PERIOD));
    let facts = bench.chip.facts();
    assert_eq!((facts.missed_triggers, facts.unread_sequences), (0, 0));
    assert_eq!(facts.triggers, 50);
    assert_eq!(facts.findings, []);
    assert_eq!(facts.sampling.len(), 7);
    // 2.125 periods of latency and 12.5 of sampling at 42.5 MHz.
    for entry in facts.sampling.iter().filter(|entry| entry.signal.starts_with("hall")) {
        assert!((entry.start_ns.min - 50.0).abs() < 1e-6 && (entry.start_ns.max - 50.0).abs() < 1e-6, "{entry:?}");
        assert!((entry.held_ns.max - 14.625 / 0.0425).abs() < 1e-6, "{entry:?}");
        assert!((entry.end_ns.max - 27.125 / 0.0425).abs() < 1e-6, "{entry:?}");
        assert_eq!(entry.trigger, "TIM1_TRGO2");
    }
    let first = &facts.sampling.iter().find(|entry| entry.adc == "ADC1" && entry.rank == 1).unwrap().signal;
    assert_eq!(first, "hall 3 at PB14");
}

#[test]
fn a_compare_channel_triggers_ahead_of_the_valley() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.timer(85);
    bench.gate_pins();
    // OC4REF, PWM mode 1 without preload: it rises 59 counts before the valley; MMS2 = 0111.
    bench.write(TIM1 + 0x40, 59);
    bench.write(TIM1 + 0x1c, 0x6078);
    bench.write(TIM1 + 0x04, 7 << 20 | 0x2a00);
    bench.converter(0, &[(5, 2)], true);
    bench.count();
    bench.run(20 * PERIOD);
    let facts = bench.chip.facts();
    assert_eq!(facts.triggers, 20);
    let held = facts.sampling[0].held_ns;
    // 59 cycles before, then 14.625 periods of four cycles.
    let expected = (14.625 * 4.0 - 59.0) / 0.17;
    assert!((held.min - expected).abs() < 1e-6 && (held.max - expected).abs() < 1e-6, "{held:?} {expected}");
    let (line, trigger) = bench.chip.last_sampling().unwrap();
    assert_eq!(line, 18);
    assert!(bench.now - trigger < PERIOD + 100, "the one before is complete");
}

#[test]
fn data_that_nobody_fetches_is_counted() {
    let mut bench = spinning(&nucleo());
    bench.converter(0, &[(5, 2)], true);
    bench.run(10 * PERIOD);
    assert_eq!(bench.chip.facts().unread_sequences, 0, "nobody has begun to read");
    bench.jdr(0, 0);
    bench.run(10 * PERIOD);
    let unread = bench.chip.facts().unread_sequences;
    assert!((9..=10).contains(&unread), "{unread}");
    // A flash operation holds the core: no excuse while the bridge is on.
    for on in [true, false] {
        if !on {
            let bdtr = bench.read(TIM1 + 0x44);
            bench.write(TIM1 + 0x44, bdtr & !(1 << 15));
        }
        if on {
            bench.write(common::FLASH + 0x08, 0x4567_0123);
            bench.write(common::FLASH + 0x08, 0xcdef_89ab);
        }
        bench.jdr(0, 0);
        bench.write(common::FLASH + 0x14, 1 << 1 | 9 << 3 | 1 << 16);
        let before = bench.chip.facts().unread_sequences;
        let stall = bench.chip.take_stall();
        bench.run(stall);
        assert_eq!(bench.chip.facts().unread_sequences > before, on);
    }
    // Fetched too early is found, once the core is free.
    bench.run(3 * PERIOD);
    bench.write(common::ADC[0], 0x60);
    bench.run_seeing(2 * PERIOD, |chip, now| {
        if chip.interrupts() >> 18 & 1 != 0 {
            chip.read(common::ADC[0] + 0x80, bus::Width::Word, now);
            chip.write(common::ADC[0], bus::Width::Word, 0x60, now);
        }
    });
    assert_eq!(bench.chip.facts().findings, []);
    for _ in 0..40 {
        bench.run(PERIOD / 40);
        bench.jdr(0, 0);
    }
    bench.run(PERIOD);
    assert_eq!(bench.chip.facts().findings[0].1, "ADC1: JDR1 is read while its rank converts");
}

#[test]
fn shunts_show_the_current_of_the_low_side_and_fall_with_it() {
    for (board, converter, channel, gain, zero) in
        [(&nucleo(), 0, 1, 0.0518, 1.71), (&esc(), 0, 3, 0.003 * 64.0 / 7.0, 16.0 * 0.128571)]
    {
        let mut bench = spinning(board);
        if board.trip.is_none() {
            // OPAMP1: PA1, gain 16, output at PA2.
            bench.write(0x4001_0300, 1 | 2 << 5 | 3 << 14);
        }
        bench.converter(converter, &[(channel, 2)], false);
        bench.duties([1062 + 200, 1062 - 100, 1062 - 100]);
        bench.run(1000 * PERIOD);
        let current = bench.chip.truth().currents_a[0];
        assert!(current > 0.2, "{current}");
        let volts = f64::from(bench.jdr(converter, 0)) / 4096.0 * 3.3;
        let shown = (zero - volts) / gain;
        assert!((shown - current).abs() < 0.05, "{}: {shown} of {current}", board.name);
    }
}

#[test]
fn without_its_opamp_a_shunt_shows_nothing() {
    let mut bench = spinning(&esc());
    bench.converter(0, &[(3, 2)], false);
    bench.run(10 * PERIOD);
    assert!(bench.jdr(0, 0) < 8, "noise alone");
}

#[test]
fn hall_wires_break_as_asked() {
    let mut bench = spinning(&nucleo());
    bench.converter(3, &[(3, 2)], false);
    bench.converter(2, &[(5, 2)], false);
    bench.run(10 * PERIOD);
    let healthy = [bench.jdr(3, 0), bench.jdr(2, 0)];
    assert!(healthy.iter().all(|code| (1500..2600).contains(code)), "{healthy:?}");
    for (fault, expected) in [(HallFault::Ground, 0), (HallFault::Supply, 4095), (HallFault::Open, 0)] {
        bench.chip.disturb(&Disturbance::Hall(0, fault), bench.now).unwrap();
        bench.run(3 * PERIOD);
        assert_eq!(bench.jdr(3, 0), expected, "{fault:?}");
    }
    bench.chip.disturb(&Disturbance::Hall(0, HallFault::Good), bench.now).unwrap();
    bench.chip.disturb(&Disturbance::SwapHalls(0, 1), bench.now).unwrap();
    bench.run(3 * PERIOD);
    let swapped = [bench.jdr(2, 0), bench.jdr(3, 0)];
    for (before, after) in healthy.iter().zip(swapped) {
        assert!(before.abs_diff(after) < 20, "{healthy:?} {swapped:?}");
    }
    bench.chip.disturb(&Disturbance::Hall(1, HallFault::Stuck), bench.now).unwrap();
    bench.run(2 * PERIOD);
    let stuck = bench.jdr(2, 0);
    bench.run(5 * PERIOD);
    assert_eq!(bench.jdr(2, 0), stuck, "not even noise");
    assert!(bench.chip.disturb(&Disturbance::Hall(3, HallFault::Good), bench.now).is_err());
}

#[test]
fn the_break_pin_switches_off_at_once() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.alternate(b'A', 6, 6);
    bench.switching(85 | 1 << 12);
    bench.write(TIM1 + 0x0c, 1 << 7);
    bench.run(10 * PERIOD + 1000);
    let before = bench.chip.seconds(bench.now);
    bench.chip.disturb(&Disturbance::BreakPin(Some(false)), bench.now).unwrap();
    assert_eq!(bench.chip.interrupts() >> 24 & 1, 1);
    assert_eq!(bench.read(TIM1 + 0x44) >> 15 & 1, 0);
    let facts = bench.chip.facts();
    let last = facts.moe.last().unwrap();
    assert_eq!((last.on, last.by.as_str(), last.at_s), (false, "break TIM1_BKIN", before));
    assert!(bench.try_write(TIM1 + 0x44, 85 | 1 << 12 | 3 << 10 | 1 << 15).is_some(), "still broken");
    // No edge follows.
    let edges = facts.legs[0].dead_time_rising_ns.count;
    bench.run(10 * PERIOD);
    assert_eq!(bench.chip.facts().legs[0].dead_time_rising_ns.count, edges);
    bench.chip.disturb(&Disturbance::BreakPin(None), bench.now).unwrap();
    bench.write(TIM1 + 0x10, !(1 << 7));
    bench.moe();
    assert_eq!(bench.read(TIM1 + 0x44) >> 15 & 1, 1);
    assert_eq!(bench.chip.interrupts() >> 24 & 1, 0);
}

#[test]
fn too_much_current_trips_the_shields_comparators() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.alternate(b'A', 6, 6);
    bench.switching(85 | 1 << 12);
    bench.run(10 * PERIOD);
    let at_s = bench.chip.seconds(bench.now);
    bench.chip.disturb(&Disturbance::Overcurrent(1, -40.0), bench.now).unwrap();
    bench.run(PERIOD);
    let facts = bench.chip.facts();
    let last = facts.moe.last().unwrap();
    assert_eq!((last.on, last.by.as_str()), (false, "break TIM1_BKIN"));
    assert!(last.at_s - at_s < 25e-6, "within a period");
}

#[test]
fn comparators_against_a_dac_are_the_small_boards_break() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    // DAC3 at 231.4 mV, COMP1, COMP2 and COMP4 against it; BKCMP1E, 2E, 4E; active high.
    bench.write(0x5000_1020, 288 | 288 << 16);
    bench.write(0x5000_1000, 0x0001_0001);
    for comparator in [0x4001_0200, 0x4001_0204, 0x4001_020c] {
        bench.write(comparator, 1 | 4 << 4);
    }
    bench.write(TIM1 + 0x60, 0x16);
    bench.switching(85 | 1 << 12 | 1 << 13);
    for (phase, comparator) in [(0, "COMP1"), (1, "COMP2"), (2, "COMP4")] {
        bench.run(10 * PERIOD);
        assert_eq!(bench.read(TIM1 + 0x44) >> 15 & 1, 1);
        bench.chip.disturb(&Disturbance::Overcurrent(phase, -58.0), bench.now).unwrap();
        bench.run(2 * PERIOD);
        assert_eq!(bench.read(TIM1 + 0x44) >> 15 & 1, 1, "58 A is below");
        bench.chip.disturb(&Disturbance::Overcurrent(phase, -62.0), bench.now).unwrap();
        bench.run(PERIOD);
        let facts = bench.chip.facts();
        let last = facts.moe.last().unwrap();
        assert_eq!((last.on, last.by.clone()), (false, format!("break {comparator}")));
        bench.chip.disturb(&Disturbance::Overcurrent(phase, 0.0), bench.now).unwrap();
        bench.write(TIM1 + 0x10, !(1 << 7));
        bench.moe();
    }
    assert_eq!(bench.chip.facts().pwm.unwrap().breaks, ["COMP1", "COMP2", "COMP4"]);
}

#[test]
fn the_bridge_is_off_while_moe_is_and_after_a_reset() {
    for board in &boards() {
        let mut bench = spinning(board);
        bench.run(10 * PERIOD);
        bench.duties([2000, 100, 100]);
        bench.run(100 * PERIOD);
        assert!(bench.chip.truth().currents_a[0] > 1.0);
        let bdtr = bench.read(TIM1 + 0x44);
        bench.write(TIM1 + 0x44, bdtr & !(1 << 15));
        // The current dies through the diodes.
        bench.run(20 * PERIOD);
        assert_eq!(bench.chip.truth().currents_a, [0.0; 3], "{}", board.name);
        bench.moe();
        bench.run(100 * PERIOD);
        assert!(bench.chip.truth().currents_a[0] > 1.0);
        bench.chip.reset(bus::ResetCause::Watchdog);
        bench.run(20 * PERIOD);
        assert_eq!(bench.chip.truth().currents_a, [0.0; 3], "{}", board.name);
        assert_eq!(bench.chip.facts().moe.last().unwrap().by, "reset");
    }
}

#[test]
fn an_open_leg_floats_and_its_pins_stay_driven() {
    // OSSR drives the disabled output of a leg to its inactive level; forcing the reference low does the rest.
    for board in &boards() {
        let mut bench = spinning(board);
        bench.run(2 * PERIOD);
        bench.write(TIM1 + 0x18, 0x4878);
        let low = board.driver.low_inverted;
        bench.write(TIM1 + 0x20, if low { 0xd9d } else { 0x515 });
        let edges = bench.chip.facts().legs[1].dead_time_rising_ns.count;
        bench.run(20 * PERIOD);
        let facts = bench.chip.facts();
        assert_eq!(facts.legs[1].dead_time_rising_ns.count, edges, "{}", board.name);
        let idr = bench.read(GPIO + 0x10);
        assert_eq!(idr >> 9 & 1, 0, "CH2 is driven low");
        assert_eq!(facts.legs.iter().map(|leg| leg.shoot_through).sum::<u64>(), 0);
    }
}

#[test]
fn with_ccpc_the_legs_wait_for_a_commutation() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    bench.timer(85);
    bench.write(TIM1 + 0x04, 1 | 2 << 20);
    bench.write(TIM1 + 0x14, 1 | 1 << 5);
    bench.gate_pins();
    bench.count();
    bench.moe();
    bench.run(10 * PERIOD);
    bench.write(TIM1 + 0x18, 0x4878);
    bench.write(TIM1 + 0x20, 0x515);
    let count = |bench: &Bench| bench.chip.facts().legs[1].dead_time_rising_ns.count;
    let before = count(&bench);
    bench.run(10 * PERIOD);
    assert!(count(&bench) >= before + 9, "not yet");
    bench.write(TIM1 + 0x14, 1 << 5);
    let before = count(&bench);
    bench.run(10 * PERIOD);
    assert!(count(&bench) <= before + 1);
}
