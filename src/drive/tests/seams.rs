//! The seams of a board: a gate driver with registers, and an encoder that is no vernier.

use super::*;
use crate::angle::MechanicalAngle;
use crate::board::encoder::AbsoluteEncoder;
use crate::board::gate_driver::{self, GateDriver};
use crate::drive::absolute::{AbsoluteChannels, AbsoluteDrive};

/// The registers of a DRV8323 by SPI: eleven bits at five addresses, of which the first two tell faults.
#[derive(Default)]
struct Drv8323 {
    registers: [u16; 5],
    /// The line is cut: every bit reads one.
    cut: bool,
}

/// FAULT of the fault status register 1; address and value of the gate drive's register, as a board would want it.
const FAULT: u16 = 1 << 10;
const GATE_DRIVE: (usize, u16) = (3, 0b011_0100_0100);

impl Drv8323 {
    fn read(&self, address: usize) -> Result<u16, ()> {
        if self.cut { Err(()) } else { Ok(self.registers[address]) }
    }
}

impl GateDriver for Drv8323 {
    type Error = ();
    type Report = [u16; 2];

    fn configure(&mut self) -> Result<(), ()> {
        let (address, value) = GATE_DRIVE;
        self.registers[address] = value;
        if self.read(address)? == value { Ok(()) } else { Err(()) }
    }

    fn report(&mut self) -> Result<Option<[u16; 2]>, ()> {
        let report = [self.read(0)?, self.read(1)?];
        Ok((report[0] & FAULT != 0).then_some(report))
    }
}

/// A task's look, and what the drive makes of it.
fn look(bench: &mut Bench, driver: &mut Drv8323) {
    if let Some(fault) = gate_driver::look(driver) {
        bench.command(Command::Trip(fault)).unwrap();
    }
}

#[test]
fn a_gate_drivers_fault_switches_off_and_stays() {
    type Spoil = fn(&mut Drv8323);
    let cases: [Spoil; 2] = [|driver| driver.registers[0] |= FAULT | 1 << 3, |driver| driver.cut = true];
    for spoil in cases {
        let (mut bench, mut driver) = (Bench::running(), Drv8323::default());
        driver.configure().unwrap();
        look(&mut bench, &mut driver);
        assert_eq!((bench.mode(), bench.step().legs), (Mode::Running, Legs::ALL));
        spoil(&mut driver);
        look(&mut bench, &mut driver);
        assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Faulted(Fault::GateDriver)));
        // What went away is still to be cleared by a person.
        driver = Drv8323::default();
        look(&mut bench, &mut driver);
        assert_eq!(bench.command(Command::Arm), Err(Refusal::Mode(Mode::Faulted(Fault::GateDriver))));
        bench.command(Command::Clear).unwrap();
        bench.command(Command::Arm).unwrap();
    }
}

#[test]
fn a_gate_driver_that_does_not_answer_is_not_configured() {
    assert_eq!(Drv8323 { cut: true, ..Drv8323::default() }.configure(), Err(()));
}

/// A magnetic encoder on a bus: 14 bits of angle, and a flag that its magnet is gone.
struct Magnetic {
    zero: MechanicalAngle,
}

impl AbsoluteEncoder for Magnetic {
    type Reading = u16;
    type State = ();
    type Fault = ();

    fn angle(&self, (): &mut (), reading: u16) -> Result<MechanicalAngle, ()> {
        let angle = MechanicalAngle::from_bits(i32::from(reading as i16) << 18);
        if reading & 1 << 14 == 0 { Ok(angle - self.zero) } else { Err(()) }
    }

    fn is_proven((): &()) -> bool {
        true
    }
}

#[test]
fn another_encoder_stands_in_for_the_vernier() {
    let Bench { drive, config, model, rotor, .. } = Bench::running();
    let (interrupt, mut tasks) = Box::leak(Box::new(AbsoluteChannels::<Magnetic>::new())).split();
    let mut drive = AbsoluteDrive::new(drive, interrupt, 4);
    let zero = MechanicalAngle::from_degrees(90.0);
    tasks.install(Box::leak(Box::new(Magnetic { zero }))).ok().unwrap();
    let sample = healthy(model.codes(rotor));
    // Half a turn.
    assert_eq!(drive.step(&sample, 1 << 13).legs, Legs::ALL);
    let angle = drive.angle().unwrap().unwrap();
    assert!((angle - zero).to_degrees().abs() < 0.1, "{angle}");
    for _ in 0..config.tolerated {
        assert_eq!(drive.step(&sample, 1 << 14).legs, Legs::ALL);
    }
    assert_eq!(drive.step(&sample, 1 << 14), Output::OFF);
    assert_eq!(drive.drive().mode(), Mode::Faulted(Fault::Encoder));
}
