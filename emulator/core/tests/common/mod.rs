//! A chip that is nothing but flash, and the small firmwares on it and in QEMU.

// Not every test and example uses all of it.
#![allow(dead_code)]

use bus::{Complaint, Cycle, Disturbance, Facts, ResetCause, System, Trace, Width};
use cortex::{Image, Machine, Map, Stop};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const HCLK: f64 = 170e6;

/// Flash, and nothing at any other address.
pub struct Bare {
    flash: Vec<u8>,
}

impl System for Bare {
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

    fn flash(&self) -> &[u8] {
        &self.flash
    }

    fn take_flash_changes(&mut self) -> Vec<core::ops::Range<u32>> {
        Vec::new()
    }

    fn reset(&mut self, _: ResetCause) {}

    fn hclk_hz(&self) -> f64 {
        HCLK
    }

    fn seconds(&self, at: Cycle) -> f64 {
        at as f64 / HCLK
    }

    fn flash_wait_states(&self) -> u32 {
        4
    }

    fn disturb(&mut self, _: &Disturbance, _: Cycle) -> Result<(), String> {
        Err("a chip without a board".into())
    }

    fn take_serial(&mut self) -> Vec<u8> {
        Vec::new()
    }

    fn facts(&self) -> Facts {
        Facts::default()
    }

    fn take_trace(&mut self) -> Trace {
        Trace::default()
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
    let flash = image.flash(128 << 10).expect("it fits");
    (Machine::new(Bare { flash }, Map::STM32G431), image)
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
