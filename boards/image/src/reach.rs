//! What a function reaches: every function it calls or names and every table it names, and so on.

use crate::stack::Frame;
use anyhow::{Context, Result};
use object::{Object, ObjectSection, ObjectSymbol, RelocationFlags, SymbolKind, elf};
use std::collections::{BTreeMap, BTreeSet};

/// A function or a table.
#[derive(Clone, Copy, PartialEq)]
struct Thing {
    size: u64,
    is_code: bool,
}

/// What the names of lld's veneers begin with.
const VENEERS: [&str; 2] = ["__Thumbv7ABSLongThunk_", "__ThumbV7PILongThunk_"];

/// Who names whom, by address.
pub struct Graph {
    names: BTreeMap<String, u64>,
    things: BTreeMap<u64, Thing>,
    edges: BTreeMap<u64, BTreeSet<u64>>,
    frames: BTreeMap<u64, Frame>,
}

impl Graph {
    pub fn new(image: &object::File) -> Result<Self> {
        let mut graph =
            Self { names: BTreeMap::new(), things: BTreeMap::new(), edges: BTreeMap::new(), frames: BTreeMap::new() };
        for symbol in image.symbols().filter(|symbol| symbol.size() > 0) {
            let is_code = symbol.kind() == SymbolKind::Text;
            // Bit 0 of a function's address says that it is Thumb code.
            let address = if is_code { symbol.address() & !1 } else { symbol.address() };
            graph.names.insert(symbol.name()?.to_owned(), address);
            graph.things.insert(address, Thing { size: symbol.size(), is_code });
        }
        for section in image.sections().filter(crate::is_loaded) {
            let data = section.data()?;
            // The lower half of an address, by register, until the upper one comes.
            let mut lower = BTreeMap::new();
            for (at, relocation) in section.relocations() {
                let RelocationFlags::Elf { r_type } = relocation.flags() else { continue };
                let bytes = &data[(at - section.address()) as usize..];
                let word = |k: usize| u32::from(u16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]));
                let target = match r_type {
                    elf::R_ARM_ABS32 => u64::from(word(0) | word(1) << 16),
                    elf::R_ARM_THM_PC22 | elf::R_ARM_THM_JUMP24 => branch(at, word(0), word(1)),
                    elf::R_ARM_THM_MOVW_ABS_NC => {
                        lower.insert(register(word(1)), immediate(word(0), word(1)));
                        continue;
                    }
                    elf::R_ARM_THM_MOVT_ABS => {
                        let Some(lower) = lower.get(&register(word(1))) else { continue };
                        u64::from(lower | immediate(word(0), word(1)) << 16)
                    }
                    _ => continue,
                };
                graph.connect(at, target);
            }
        }
        graph.connect_veneers();
        graph.read_frames(image)?;
        Ok(graph)
    }

    /// The linker leads calls that are too far for a branch over veneers, which are named after their target.
    fn connect_veneers(&mut self) {
        let veneers: Vec<_> = self
            .names
            .iter()
            .filter_map(|(name, &at)| {
                let target = VENEERS.iter().find_map(|prefix| name.strip_prefix(prefix))?;
                Some((at, *self.names.get(target)?))
            })
            .collect();
        for (at, target) in veneers {
            self.connect(at, target);
        }
    }

    /// Frames of all functions. Mapping symbols tell the code from the constants between ($t and $d; ELF for Arm,
    /// 5.5.5).
    fn read_frames(&mut self, image: &object::File) -> Result<()> {
        let mut data = BTreeMap::new();
        for symbol in image.symbols() {
            let name = symbol.name()?;
            if name.starts_with("$d") || name.starts_with("$t") {
                data.insert(symbol.address() & !1, name.starts_with("$d"));
            }
        }
        let is_data = |at: u64| data.range(..=at).next_back().is_some_and(|(_, &is_data)| is_data);
        for section in image.sections().filter(crate::is_loaded) {
            let bytes = section.data()?;
            let end = section.address() + bytes.len() as u64;
            for (&start, thing) in self.things.range(section.address()..end).filter(|(_, thing)| thing.is_code) {
                let code: Vec<u16> = (start..(start + thing.size).min(end - 1))
                    .step_by(2)
                    .filter(|&at| !is_data(at))
                    .map(|at| {
                        let k = (at - section.address()) as usize;
                        u16::from_le_bytes([bytes[k], bytes[k + 1]])
                    })
                    .collect();
                self.frames.insert(start, Frame::of(&code));
            }
        }
        Ok(())
    }

    /// What a function or a table names.
    pub fn named_by(&self, at: u64) -> impl Iterator<Item = u64> {
        self.edges.get(&at).into_iter().flatten().copied()
    }

    /// Frame of a function; a table has none.
    pub fn frame(&self, at: u64) -> Option<&Frame> {
        self.frames.get(&at)
    }

    /// Name of what is at an address.
    pub fn name(&self, at: u64) -> String {
        let name = self.names.iter().find(|&(_, &address)| address == at).map_or("?", |(name, _)| name);
        format!("{:#}", rustc_demangle::demangle(name))
    }

    /// Address of a function.
    pub fn find(&self, function: &str) -> Result<u64> {
        self.names.get(function).copied().with_context(|| format!("no function {function} in the image"))
    }

    fn connect(&mut self, from: u64, to: u64) {
        if let (Some(from), Some(to)) = (self.containing(from), self.containing(to)) {
            self.edges.entry(from).or_default().insert(to);
        }
    }

    fn containing(&self, address: u64) -> Option<u64> {
        let (&start, thing) = self.things.range(..=address).next_back()?;
        (address < start + thing.size).then_some(start)
    }

    /// Bytes of code and of tables.
    pub fn reach(&self, function: &str) -> Result<(u64, u64)> {
        let seen = self.reached(self.find(function)?);
        let bytes = |code| seen.iter().map(|at| self.things[at]).filter(|t| t.is_code == code).map(|t| t.size).sum();
        Ok((bytes(true), bytes(false)))
    }

    /// Everything that a function names, and what that names, and so on.
    pub fn reached(&self, function: u64) -> BTreeSet<u64> {
        let (mut seen, mut open) = (BTreeSet::from([function]), vec![function]);
        while let Some(thing) = open.pop() {
            for next in self.named_by(thing) {
                if seen.insert(next) {
                    open.push(next);
                }
            }
        }
        seen
    }
}

/// Target of a Thumb BL or B.W (Armv7-M manual, A7.7.12 and A7.7.18, encodings T1 and T4).
fn branch(at: u64, first: u32, second: u32) -> u64 {
    let bit = |word: u32, n: u32| word >> n & 1;
    let sign = bit(first, 10);
    let i1 = 1 ^ bit(second, 13) ^ sign;
    let i2 = 1 ^ bit(second, 11) ^ sign;
    let offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1;
    let offset = i64::from((offset << 7) as i32 >> 7);
    at.wrapping_add_signed(4 + offset)
}

/// The 16 bits that MOVW and MOVT move (A7.7.76, encoding T3; A7.7.79).
fn immediate(first: u32, second: u32) -> u32 {
    (first & 0xF) << 12 | (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | (second & 0xFF)
}

/// The register that they move it to.
fn register(second: u32) -> u32 {
    second >> 8 & 0xF
}
