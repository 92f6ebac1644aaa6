//! `image ELF` prints the flash and the RAM of a firmware in bytes, `image ELF --memory FILE FLASH RAM` beside what a
//! `memory.x` has of them, and fails where less than these is left, `image ELF --crates` prints them by the crates that they
//! come from, and `image ELF FUNCTION…` the code and the tables that each function reaches.
//!
//! `image ELF --interrupt FUNCTION` fails if the function can reach a panic, the log or a critical section; `image ELF
//! --stack THREAD PREEMPTING… CONTROL` tells the deepest stack, and fails if the memory for it (`_stack_end` to
//! `_stack_start`) is smaller. All but the first need an image linked with `--emit-relocs`.

mod crates;
mod memory;
mod reach;
mod stack;

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind, elf};
use std::{env, fs};

fn main() -> Result<()> {
    let mut arguments = env::args().skip(1);
    let path = arguments.next().context("usage: image ELF [FUNCTION…]")?;
    let data = fs::read(&path).with_context(|| format!("cannot read {path}"))?;
    let image = object::File::parse(&*data)?;
    let functions: Vec<String> = arguments.collect();
    if functions.is_empty() {
        let (flash, ram) = sizes(&image);
        println!("{flash} bytes of flash, {ram} bytes of RAM without the stack");
        return Ok(());
    }
    if let [option, path, flash, ram] = &functions[..]
        && option == "--memory"
    {
        return fits(&image, path, [flash.parse()?, ram.parse()?, 0]);
    }
    if functions == ["--crates"] {
        return crates::print(&image);
    }
    let graph = reach::Graph::new(&image)?;
    match functions.split_first() {
        Some((option, functions)) if option == "--interrupt" => return interrupt(&graph, functions),
        Some((option, functions)) if option == "--stack" => return stack_fits(&image, &graph, functions),
        _ => {}
    }
    println!("| function | code bytes | table bytes |");
    println!("|---|---:|---:|");
    for function in functions {
        let (code, tables) = graph.reach(&function)?;
        println!("| {function} | {code} | {tables} |");
    }
    Ok(())
}

/// The linker has refused what is too large; this says how much is left, and wants so much of it.
fn fits(image: &object::File, path: &str, wanted: [u64; 3]) -> Result<()> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {path}"))?;
    let (flash, ram) = sizes(image);
    let taken = [("FLASH", flash), ("RAM", ram), ("CCM", ccm(image))];
    for ((name, taken), wanted) in taken.into_iter().zip(wanted).filter(|((_, taken), _)| *taken > 0) {
        let room = memory::length(&text, name).with_context(|| format!("{path} has no LENGTH of {name}"))?;
        println!("{name}: {taken} bytes of {room}, {} left", room.saturating_sub(taken));
        ensure!(taken + wanted <= room, "{name}: {wanted} bytes have to be left");
    }
    Ok(())
}

/// What a control interrupt must not reach: it would wait, or not come back.
const FORBIDDEN: [&str; 4] = ["panic", "_defmt_", "_critical_section_1_0_", "unwrap_failed"];

fn interrupt(graph: &reach::Graph, functions: &[String]) -> Result<()> {
    for function in functions {
        let reached = graph.reached(graph.find(function)?);
        let names: Vec<String> = reached.iter().map(|&at| graph.name(at)).collect();
        let is_bad = |name: &String| FORBIDDEN.iter().any(|bad| name.contains(bad));
        if let Some((&at, _)) = reached.iter().zip(&names).find(|(_, name)| is_bad(name)) {
            anyhow::bail!("{function} can reach it: {}", graph.way(graph.find(function)?, at).join(" → "));
        }
        println!(
            "{function} and what it reaches, {} functions and tables: no panic, no log, no critical section",
            names.len()
        );
    }
    Ok(())
}

/// Bytes that an exception pushes: 26 words with those of the FPU, and one to align (Armv7-M manual, B1.5.7).
const EXCEPTION: u64 = 27 * 4;

fn stack_fits(image: &object::File, graph: &reach::Graph, functions: &[String]) -> Result<()> {
    let [thread, preempting @ .., control] = functions else { anyhow::bail!("at least a thread and an interrupt") };
    let mut total = 0;
    let add = |function: &str, entry: u64| -> Result<u64> {
        let deepest = stack::deepest(graph, graph.find(function)?);
        println!("{function}: {} bytes of stack; the deepest way:", deepest.bytes + entry);
        for (name, bytes) in deepest.chain.iter().filter(|(_, bytes)| *bytes >= 100) {
            println!("  {bytes:6} {name}");
        }
        println!("  calls through registers: {}", deepest.indirect.len());
        Ok(deepest.bytes + entry)
    };
    total += add(thread, 0)?;
    let mut most = 0;
    for function in preempting {
        most = most.max(add(function, EXCEPTION)?);
    }
    total += most + add(control, EXCEPTION)?;
    let place =
        |name: &str| image.symbol_by_name(name).map(|symbol| symbol.address()).context("no bounds of the stack");
    let room = place("_stack_start")? - place("_stack_end")?;
    println!("{total} bytes of stack at most, of {room}");
    ensure!(total <= room, "the stack is too small by {} bytes", total - room);
    Ok(())
}

/// Bytes of flash and of RAM: initialised data are in both.
fn sizes(image: &object::File) -> (u64, u64) {
    let (mut flash, mut ram) = (0, 0);
    for section in image.sections().filter(is_loaded) {
        let zero = section.kind() == SectionKind::UninitializedData;
        if !zero {
            flash += section.size();
        }
        // Those of the CCM SRAM the linker has checked.
        if (zero || has_flag(&section, elf::SHF_WRITE)) && section.address() >= RAM {
            ram += section.size();
        }
    }
    (flash, ram)
}

/// Bytes of the CCM SRAM.
fn ccm(image: &object::File) -> u64 {
    let is_ccm = |section: &object::Section| is_loaded(section) && (CCM..RAM).contains(&section.address());
    image.sections().filter(is_ccm).map(|section| section.size()).sum()
}

/// Where the CCM SRAM begins.
const CCM: u64 = 0x1000_0000;

/// Where the RAM begins, whatever of it appears elsewhere.
const RAM: u64 = 0x2000_0000;

/// Whether it has a place in the chip's memory, unlike symbols and debug information.
fn is_loaded(section: &object::Section) -> bool {
    has_flag(section, elf::SHF_ALLOC)
}

fn has_flag(section: &object::Section, flag: u32) -> bool {
    matches!(section.flags(), SectionFlags::Elf { sh_flags } if sh_flags & u64::from(flag) != 0)
}
