//! What the emulator says about a firmware: faults with their place, wrong accesses, durations of handlers.

mod common;

use bus::Complaint;
use cortex::{Stop, system_name};

/// A store to nowhere: the report names the exception, the function and its line, the address and the registers.
#[test]
fn a_hard_fault_is_reported_with_function_and_line() {
    let (mut machine, image) = common::machine("hardfault");
    let text = common::run(&mut machine);
    assert_eq!(text, "HFSR 40000000 CFSR 00008200 BFAR 90000010 R0 90000010\n");
    let [fault] = &machine.faults[..] else { panic!("{:?}", machine.faults) };
    assert_eq!((fault.exception, fault.address), ("HardFault", Some(0x9000_0010)));
    assert_eq!(fault.registers[0], 0x9000_0010);
    let place = image.place(fault.pc);
    assert_eq!(place.function, "hardfault::write_to");
    assert!(
        image.source(fault.pc).iter().any(|line| line.starts_with("hardfault.rs:")),
        "{:?}",
        image.source(fault.pc)
    );
    let wrong: Vec<_> = machine.complaints().collect();
    assert_eq!(wrong.len(), 1);
    assert_eq!((&wrong[0].complaint, wrong[0].write, wrong[0].count), (&Complaint::Unmapped, true, 1));
}

/// Without a debugger a breakpoint instruction is a hard fault, and one in the handler locks the core up.
#[test]
fn a_breakpoint_without_a_debugger_ends_in_a_lockup() {
    let (mut machine, _) = common::machine("hardfault");
    assert_eq!(machine.run(1_000_000), Stop::Time);
    let told: Vec<_> = machine.faults.iter().map(|fault| fault.exception).collect();
    assert_eq!(told, ["HardFault", "lockup"]);
}

/// SysTick comes every 50 001 cycles; from its pending to the handler's first instruction are the 12 cycles of an
/// entry, and what is left of the instruction that was interrupted.
#[test]
fn handlers_are_timed() {
    let (mut machine, _) = common::machine("exceptions");
    common::run(&mut machine);
    let tick = &machine.profile().activities()[&15];
    assert_eq!(system_name(15), Some("SysTick"));
    assert_eq!(tick.duration.count, 6);
    assert_eq!((tick.latency.min, tick.period.min), (12.0, 50_001.0));
    assert!(machine.asleep() > 250_000, "{}", machine.asleep());
    // A handler that is pre-empted is not charged with the other one's instructions.
    let outer = &machine.profile().activities()[&(cortex::FIRST_IRQ + 4)];
    assert!(outer.duration.max > outer.cycles.max + 100.0, "{outer:?}");
}
