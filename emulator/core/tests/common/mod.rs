//! A chip that is nothing but memory, and the small firmwares on it and in QEMU.

// Not every test and example uses all of it.
#![allow(dead_code)]

use bus::{Bus, Cache, Complaint, Cycle, Integration, ResetCause, Width};
use cortex::{Image, Machine, Stop};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const CLOCK_HZ: f64 = 170e6;

/// The memories of QEMU's machine `mps2-an386` that the firmwares are linked for.
const INTEGRATION: Integration = Integration {
    code: 0,
    code_aliases: &[],
    cache: Cache { line_bytes: 32, word_bytes: 8, instruction_lines: 32, data_lines: 8 },
    ram: 0x2000_0000,
    ram_bytes: 32 << 10,
    ram_aliases: &[],
    priority_bits: 4,
    systick_reference: 8,
};

/// Code memory, and nothing at any other address.
pub struct Bare {
    code: Vec<u8>,
}

impl Bus for Bare {
    fn integration(&self) -> Integration {
        INTEGRATION
    }

    fn read(&mut self, _: u32, _: Width, _: Cycle) -> (u32, Option<Complaint>) {
        (0, Some(Complaint::Unmapped))
    }

    fn write(&mut self, _: u32, _: Width, _: u32, _: Cycle) -> Option<Complaint> {
        Some(Complaint::Unmapped)
    }

    fn advance(&mut self, _: Cycle) -> Cycle {
        Cycle::MAX
    }

    fn interrupts(&self) -> u128 {
        0
    }

    fn take_reset(&mut self) -> Option<ResetCause> {
        None
    }

    fn reset(&mut self, _: ResetCause) {}

    fn code(&self) -> &[u8] {
        &self.code
    }

    fn code_wait_states(&self) -> u32 {
        4
    }

    fn clock_hz(&self) -> f64 {
        CLOCK_HZ
    }

    fn seconds(&self, at: Cycle) -> f64 {
        at as f64 / CLOCK_HZ
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmwares")
}

/// Builds all small firmwares, once.
pub fn elf(name: &str) -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let target = BUILT.get_or_init(|| {
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| folder().join("target"), PathBuf::from);
        let done = Command::new("cargo")
            .args(["build", "--quiet", "--release", "--target-dir"])
            .arg(&target)
            .current_dir(folder())
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS")
            .status()
            .expect("cargo starts");
        assert!(done.success(), "the firmwares do not build; boards/setup installs the target");
        target
    });
    target.join("thumbv7em-none-eabihf/release").join(name)
}

pub fn machine(name: &str) -> (Machine<Bare>, Image) {
    let image = Image::parse(std::fs::read(elf(name)).expect("a built firmware")).expect("a firmware");
    let code = image.code(&INTEGRATION, 128 << 10).expect("it fits");
    (Machine::new(Bare { code }), image)
}

/// Runs to the end, and gives the text that came by semihosting.
pub fn run(machine: &mut Machine<Bare>) -> String {
    machine.debugger = true;
    let mut text = String::new();
    loop {
        match machine.run(u64::MAX - 1) {
            Stop::Breakpoint(0xAB) => {}
            other => panic!("{other:?} after\n{text}\n{:#x?}", machine.faults),
        }
        let registers = machine.registers();
        match registers[0] {
            4 => {
                let length = (0..).take_while(|&at| machine.ram(registers[1] + at, 1).unwrap()[0] != 0).count();
                text += core::str::from_utf8(machine.ram(registers[1], length as u32).unwrap()).unwrap();
            }
            0x18 => return text,
            other => panic!("semihosting operation {other:#x}"),
        }
    }
}

/// What the same firmware prints in QEMU.
pub fn qemu(name: &str) -> String {
    let output = Command::new("qemu-system-arm")
        .args(["-machine", "mps2-an386", "-cpu", "cortex-m4", "-display", "none", "-serial", "none"])
        .args(["-monitor", "none", "-semihosting-config", "enable=on,target=native", "-icount", "shift=7", "-kernel"])
        .arg(elf(name))
        .output()
        .expect("qemu-system-arm; boards/setup installs it");
    // SYS_WRITE0 goes to standard error.
    String::from_utf8(output.stderr).unwrap() + &String::from_utf8(output.stdout).unwrap()
}
