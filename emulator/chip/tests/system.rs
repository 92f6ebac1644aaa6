//! Clocks, flash, serial port, watchdog and time driver through the bus.

mod common;

use bus::{Bus, Complaint, ResetCause, Width};
use chip::Disturbance;
use common::{Bench, FLASH, GPIO, IWDG, PWR, RCC, USART2, WWDG, boards, esc, nucleo};

#[test]
fn it_reaches_170_mhz_without_a_complaint() {
    for board in &boards() {
        let mut bench = Bench::new(board);
        assert_eq!(bench.chip.clock_hz(), 16e6);
        bench.clocks();
        assert_eq!(bench.chip.clock_hz(), 170e6);
        let (start, at_s) = (bench.now, bench.chip.seconds(bench.now));
        bench.run(1_700_000);
        assert!((bench.chip.seconds(start + 1_700_000) - at_s - 0.01).abs() < 1e-12);
        let clock = |name: &str| bench.chip.facts().clocks.iter().find(|clock| clock.name == name).unwrap().hz;
        assert_eq!((clock("SYSCLK"), clock("PCLK1"), clock("APB2 timers")), (170e6, 170e6, 170e6));
    }
}

#[test]
fn boost_and_wait_states_are_asked_for() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    let complaint = bench.try_write(PWR + 0x80, 0x100).unwrap().to_string();
    assert!(complaint.contains("R1MODE (CR5, bit 8) is not cleared"), "{complaint}");
    bench.write(PWR + 0x80, 0);
    let complaint = bench.try_write(FLASH, 3).unwrap().to_string();
    assert!(complaint.contains("3 wait states at 170 MHz, 4 are needed"), "{complaint}");
}

#[test]
fn nothing_is_silently_accepted() {
    let mut bench = Bench::new(&esc());
    assert_eq!(bench.try_write(GPIO, 0), Some(Complaint::Unclocked { peripheral: "GPIOA" }));
    bench.set(RCC + 0x48, 1);
    assert_eq!(
        bench.try_write(0x4002_0008, 1),
        Some(Complaint::Unmodelled { peripheral: "DMA1", register: 8 }),
        "clocked, and without a model"
    );
    assert_eq!(bench.try_write(RCC + 0xb0, 1), Some(Complaint::Unmodelled { peripheral: "RCC", register: 0xb0 }));
    assert_eq!(bench.try_write(0x5000_0400, 1), Some(Complaint::Unmapped), "the small chip has no ADC3");
    assert_eq!(bench.try_write(0x4100_0000, 1), Some(Complaint::Unmapped));
    assert!(matches!(
        bench.chip.write(RCC + 2, Width::Half, 1, bench.now),
        Some(Complaint::Wrong { peripheral: "RCC", .. })
    ));
}

#[test]
fn a_peripheral_reset_resets() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.timer(85);
    bench.set(RCC + 0x40, 1 << 11);
    bench.write(RCC + 0x40, 0);
    assert_eq!(bench.read(common::TIM1 + 0x2c), 0xffff);
    assert_eq!(bench.read(common::TIM1 + 0x44), 0);
}

#[test]
fn factory_words_and_identification() {
    let mut bench = Bench::new(&nucleo());
    assert_eq!(bench.chip.read(0x1fff_75e0, Width::Half, 1).0, 512);
    assert_ne!(bench.chip.read(0x1fff_7590, Width::Word, 1).0, 0);
    assert_eq!(bench.chip.read(0xe004_2000, Width::Word, 1).0 & 0xfff, 0x469);
}

fn unlock(bench: &mut Bench) {
    for key in [0x4567_0123, 0xcdef_89ab] {
        bench.write(FLASH + 0x08, key);
    }
}

#[test]
fn flash_is_written_through_the_bus_and_holds_the_core() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    unlock(&mut bench);
    bench.write(FLASH + 0x14, 1 << 1 | 63 << 3 | 1 << 16);
    let stall = bench.chip.take_stall();
    // 22.02 ms of 170 MHz, rounded up.
    assert!((3_743_400..=3_743_401).contains(&stall), "{stall}");
    assert_eq!(bench.chip.take_stall(), 0);
    bench.run(stall);
    assert_eq!(bench.read(FLASH + 0x10), 0);
    bench.write(FLASH + 0x14, 1);
    bench.write(0x0801_f800, 0x1234_5678);
    bench.write(0x0801_f804, 0x9abc_def0);
    let stall = bench.chip.take_stall();
    bench.run(stall);
    assert_eq!(bench.read(0x0801_f800), 0x1234_5678);
    assert_eq!(bench.chip.read(0x0801_f805, Width::Byte, bench.now).0, 0xde);
    assert_eq!(bench.chip.take_code_changes(), [0x1_f800..0x2_0000, 0x1_f800..0x1_f808]);
    assert_eq!(bench.chip.facts().flash_operations, 2);
}

#[test]
fn a_power_cut_asks_for_a_power_on_reset() {
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    bench.chip.disturb(&Disturbance::PowerCut(1), bench.now).unwrap();
    unlock(&mut bench);
    bench.write(FLASH + 0x14, 1 << 1 | 127 << 3 | 1 << 11 | 1 << 16);
    assert_eq!(bench.chip.take_stall(), 0, "the other bank");
    bench.run(4_000_000);
    assert_eq!(bench.chip.take_reset(), None);
    bench.write(FLASH + 0x14, 1);
    bench.write(0x0807_f800, 0);
    bench.write(0x0807_f804, 0);
    assert_eq!(bench.chip.take_reset(), Some(ResetCause::PowerOn));
    bench.chip.reset(ResetCause::PowerOn);
    let torn = bench.read(0x0807_f800);
    assert!(torn != 0 && torn != u32::MAX, "{torn:#x}");
    assert_eq!(bench.chip.clock_hz(), 16e6);
    assert_ne!(bench.read(RCC + 0x94) >> 27 & 1, 0, "BORRSTF");
}

#[test]
fn bytes_go_out_and_come_in_over_the_boards_pins() {
    for (board, port, tx, rx) in [(&nucleo(), b'A', 2, 3), (&esc(), b'B', 3, 4)] {
        let mut bench = Bench::new(board);
        bench.clocks();
        let incoming = Disturbance::Serial(b"hello".to_vec());
        assert!(bench.chip.disturb(&incoming, bench.now).is_err(), "no port at the pins yet");
        bench.alternate(port, tx, 7);
        bench.alternate(port, rx, 7);
        bench.write(USART2 + 0x0c, 369);
        bench.write(USART2, 1 | 1 << 2 | 1 << 3 | 1 << 5 | 1 << 4 | 1 << 29);
        for byte in b"ok" {
            bench.write(USART2 + 0x28, u32::from(*byte));
        }
        bench.chip.disturb(&incoming, bench.now).unwrap();
        let mut received = Vec::new();
        bench.run_seeing(170_000, |chip, now| {
            if chip.interrupts() >> 38 & 1 != 0 {
                let flags = chip.read(USART2 + 0x1c, Width::Word, now).0;
                if flags & 1 << 5 != 0 {
                    received.push(chip.read(USART2 + 0x24, Width::Byte, now).0 as u8);
                }
                assert_eq!(chip.write(USART2 + 0x20, Width::Word, flags & 0x1f, now), None);
            }
        });
        assert_eq!(received, b"hello");
        assert_eq!(bench.chip.take_serial(), b"ok");
        let clocks = bench.chip.facts().clocks;
        let baud = clocks.iter().find(|clock| clock.name == "serial TX, baud").unwrap().hz;
        assert!((baud / 460_800.0 - 1.0).abs() < 1e-3);
        // A narrow write is a byte.
        assert_eq!(bench.chip.write(USART2 + 0x28, Width::Byte, 0x41, bench.now), None);
        bench.run(10_000);
        assert_eq!(bench.chip.take_serial(), b"A");
    }
}

#[test]
fn a_transmitter_without_a_pin_is_found() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    bench.alternate(b'B', 3, 5);
    bench.write(USART2 + 0x0c, 369);
    bench.write(USART2, 1 | 1 << 3);
    bench.write(USART2 + 0x28, 7);
    bench.run(10_000);
    assert!(bench.chip.facts().findings[0].1.contains("no pin carries its TX"));
}

#[test]
fn the_watchdog_bites_unless_it_is_fed() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    // 4 · 800 / 32 kHz = 100 ms.
    bench.write(IWDG, 0xcccc);
    bench.write(IWDG, 0x5555);
    bench.write(IWDG + 0x08, 799);
    while bench.read(IWDG + 0x0c) != 0 {}
    bench.write(IWDG, 0xaaaa);
    for _ in 0..10 {
        bench.run(170_000 * 90);
        assert_eq!(bench.chip.take_reset(), None);
        bench.write(IWDG, 0xaaaa);
    }
    let fed = bench.now;
    bench.run(170_000 * 100 - 1000);
    assert_eq!(bench.chip.take_reset(), None);
    bench.run(2000);
    assert_eq!(bench.chip.take_reset(), Some(ResetCause::Watchdog), "fed at {fed}");
    bench.chip.reset(ResetCause::Watchdog);
    assert_eq!(bench.read(RCC + 0x94) >> 29 & 1, 1);
    let watchdog = bench.chip.facts().watchdog.unwrap();
    assert_eq!((watchdog.bites, watchdog.interval_s.count), (1, 11));
    assert!((watchdog.interval_s.max - 0.09).abs() < 1e-4);
}

#[test]
fn the_window_watchdog_bites_within_its_time_and_cannot_be_stopped() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    assert!(bench.try_write(WWDG, 0xc9).is_some(), "not clocked");
    bench.set(RCC + 0x58, 1 << 11);
    bench.write(WWDG, 0xc9);
    let enables = bench.read(RCC + 0x58);
    bench.write(RCC + 0x58, enables & !(1 << 11));
    // 10 counts of 4096 cycles of PCLK1.
    for _ in 0..20 {
        bench.run(9 * 4096 - 100);
        assert_eq!(bench.chip.take_reset(), None);
        bench.write(WWDG, 0xc9);
    }
    let refreshed = bench.now;
    bench.run(10 * 4096 + 100);
    assert_eq!(bench.chip.take_reset(), Some(ResetCause::WindowWatchdog), "refreshed at {refreshed}");
    bench.chip.reset(ResetCause::WindowWatchdog);
    assert_eq!(bench.read(RCC + 0x94) >> 29 & 3, 2);
    let watchdog = bench.chip.facts().window_watchdog.unwrap();
    assert_eq!((watchdog.bites, watchdog.used.count), (1, 20));
    assert!((0.85..0.95).contains(&watchdog.used.max), "{watchdog:?}");
}

#[test]
fn a_time_driver_gets_its_interrupts() {
    const TIM3: u32 = 0x4000_0400;
    let mut bench = Bench::new(&nucleo());
    bench.clocks();
    // A microsecond a count; overflow, half-way, and an alarm at 40 000, as embassy's driver does it.
    bench.write(TIM3 + 0x28, 169);
    bench.write(TIM3 + 0x2c, 0xffff);
    bench.write(TIM3, 1 << 2);
    bench.write(TIM3 + 0x14, 1);
    bench.write(TIM3, 0);
    bench.write(TIM3 + 0x34, 0x8000);
    bench.write(TIM3 + 0x38, 40_000);
    bench.write(TIM3 + 0x0c, 7);
    assert_eq!(bench.read(TIM3 + 0x10), 0, "URS: the update by software leaves no flag");
    bench.write(TIM3, 1);
    let start = bench.now;
    let mut seen = Vec::new();
    bench.run_seeing(170 * 70_000, |chip, now| {
        if chip.interrupts() >> 29 & 1 != 0 {
            let flags = chip.read(TIM3 + 0x10, Width::Word, now).0;
            assert_eq!(chip.write(TIM3 + 0x10, Width::Word, !flags, now), None);
            seen.push(((now - start) / 170, flags & 7));
        }
    });
    assert_eq!(seen, [(32_768, 2), (40_000, 4), (65_536, 1)]);
    let counted = bench.read(TIM3 + 0x24);
    assert_eq!(counted, 70_000 - 65_536);
}
