//! `image ELF` prints the flash and the RAM of a firmware in bytes, `image ELF FUNCTION…` the code and the tables that
//! each function reaches. The latter needs an image linked with `--emit-relocs`.

mod reach;

use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};
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
    let graph = reach::Graph::new(&image)?;
    println!("| function | code bytes | table bytes |");
    println!("|---|---:|---:|");
    for function in functions {
        let (code, tables) = graph.reach(&function)?;
        println!("| {function} | {code} | {tables} |");
    }
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
        if zero || has_flag(&section, elf::SHF_WRITE) {
            ram += section.size();
        }
    }
    (flash, ram)
}

/// Whether it has a place in the chip's memory, unlike symbols and debug information.
fn is_loaded(section: &object::Section) -> bool {
    has_flag(section, elf::SHF_ALLOC)
}

fn has_flag(section: &object::Section, flag: u32) -> bool {
    matches!(section.flags(), SectionFlags::Elf { sh_flags } if sh_flags & u64::from(flag) != 0)
}
