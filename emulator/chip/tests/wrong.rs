//! Four motor firmwares with a mistake each, which has to be told by name.

mod common;

use bus::{Bus, Complaint};
use common::{ADC, Bench, RCC, TIM1, boards, esc, nucleo};

const PERIOD: u64 = 4250;

fn findings(bench: &Bench) -> Vec<String> {
    bench.chip.facts().findings.into_iter().map(|(_, what)| what).collect()
}

#[test]
fn no_dead_time() {
    for board in &boards() {
        let mut bench = Bench::new(board);
        bench.clocks();
        bench.switching(0);
        bench.run(10 * PERIOD);
        let facts = bench.chip.facts();
        let found = findings(&bench);
        assert!(found.iter().any(|what| what.starts_with("dead time: leg U")), "{found:?}");
        assert_eq!(facts.legs[0].dead_time_rising_ns.min, 0.0);
        // A driver with a dead time of its own prevents it.
        let shoots = facts.legs.iter().all(|leg| leg.shoot_through > 0);
        assert_eq!(shoots, board.driver.own_dead_time_s < board.driver.overlap_s, "{}", board.name);
    }
}

#[test]
fn moe_before_the_idle_states() {
    for board in &boards() {
        let mut bench = Bench::new(board);
        bench.clocks();
        bench.timer(85);
        bench.write(TIM1 + 0x04, 2 << 20);
        bench.gate_pins();
        bench.count();
        bench.moe();
        if board.driver.low_inverted {
            bench.write(TIM1 + 0x04, 2 << 20 | 0x2a00);
            let found = findings(&bench);
            let first = "idle states: MOE is set while TIM1_CH1N would switch PA7 on when it falls";
            assert!(found.iter().any(|what| what == first), "{found:?}");
            assert!(found.iter().any(|what| what.contains("written while MOE is set")), "{found:?}");
        } else {
            assert_eq!(findings(&bench), [] as [String; 0], "all low is off");
        }
    }
    let mut bench = Bench::new(&esc());
    bench.clocks();
    bench.timer(85);
    bench.write(TIM1 + 0x44, 85);
    bench.gate_pins();
    bench.moe();
    let found = findings(&bench);
    assert!(found.iter().any(|what| what.contains("OSSI is clear")), "{found:?}");
}

#[test]
fn wrong_alternate_function() {
    for (board, port, pin, told) in [
        (&esc(), b'B', 15, "alternate function: PB15 is AF6 while MOE is set; TIM1_CH3N is AF4"),
        (&nucleo(), b'A', 8, "alternate function: PA8 is AF4 while MOE is set; TIM1_CH1 is AF6"),
    ] {
        let mut bench = Bench::new(board);
        bench.clocks();
        bench.timer(85);
        bench.gate_pins();
        bench.alternate(port, pin, if pin == 15 { 6 } else { 4 });
        bench.count();
        bench.moe();
        bench.run(10 * PERIOD);
        assert_eq!(findings(&bench), [told]);
        let leg = if pin == 15 { 2 } else { 0 };
        assert_eq!(bench.chip.facts().legs[leg].dead_time_rising_ns.count, 0, "nothing comes out");
    }
}

#[test]
fn converter_without_clock() {
    for board in &boards() {
        let mut bench = Bench::new(board);
        bench.clocks();
        let enable = bench.read(RCC + 0x4c);
        bench.write(RCC + 0x4c, enable & !(1 << 13));
        let unclocked = Some(Complaint::Unclocked { peripheral: "ADC12" });
        assert_eq!(bench.try_write(ADC[0] + 0x08, 1 << 28), unclocked);
        let (value, complaint) = bench.chip.read(ADC[0] + 0x08, bus::Width::Word, bench.now);
        assert_eq!((value, complaint), (0, unclocked));
    }
    // The enable is there, the kernel clock is not.
    let mut bench = Bench::new(&esc());
    bench.clocks();
    bench.write(ADC[0] + 0x08, 1 << 28);
    bench.run(3500);
    let complaint = bench.try_write(ADC[0] + 0x08, 1 << 28 | 1 << 31).unwrap().to_string();
    assert!(complaint.contains("without a clock"), "{complaint}");
}
