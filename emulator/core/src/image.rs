//! The firmware file: what is flashed, and the way from an address back to function, file and line.

use addr2line::Context as Lines;
use anyhow::{Context, Result, bail, ensure};
use bus::Integration;
use gimli::{EndianRcSlice, RunTimeEndian};
use object::{Object, ObjectSection, ObjectSegment, ObjectSymbol, SymbolKind};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::rc::Rc;

type Reader = EndianRcSlice<RunTimeEndian>;

/// A firmware in ELF.
pub struct Image {
    /// The file itself, for defmt's table.
    pub elf: Vec<u8>,
    /// Physical address and bytes of what is flashed.
    pub segments: Vec<(u32, Vec<u8>)>,
    symbols: BTreeMap<String, u32>,
    functions: BTreeMap<u32, (u32, String)>,
    lines: Lines<Reader>,
}

/// Where in the firmware an address is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Place {
    /// Demangled.
    pub function: String,
    /// File name and line, where the firmware has debug information.
    pub line: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.line {
            Some(line) => write!(f, "{} ({line})", self.function),
            None => f.write_str(&self.function),
        }
    }
}

impl Image {
    /// Parses a file; refuses what is no Arm firmware.
    pub fn parse(elf: Vec<u8>) -> Result<Image> {
        let file = object::File::parse(&*elf).context("not an ELF file")?;
        ensure!(file.architecture() == object::Architecture::Arm, "not for Arm, but {:?}", file.architecture());
        let mut segments = Vec::new();
        for segment in file.segments() {
            let bytes = segment.data()?;
            if !bytes.is_empty() {
                segments.push((physical(&file, &segment)?, bytes.to_vec()));
            }
        }
        if segments.is_empty() {
            bail!("nothing to flash: was it linked with link.x?");
        }
        let mut symbols = BTreeMap::new();
        let mut functions = BTreeMap::new();
        for symbol in file.symbols() {
            let Ok(name) = symbol.name() else { continue };
            let address = symbol.address() as u32;
            if symbol.kind() == SymbolKind::Text && symbol.size() != 0 {
                let name = format!("{:#}", rustc_demangle::demangle(name));
                functions.insert(address & !1, (symbol.size() as u32, name));
            }
            symbols.insert(name.to_owned(), address);
        }
        let lines = Lines::from_dwarf(dwarf(&file)?)?;
        Ok(Image { elf, segments, symbols, functions, lines })
    }

    /// Address of a symbol by its mangled name.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }

    /// Function and line of an address; of an inlined function, the innermost.
    pub fn place(&self, address: u32) -> Place {
        let address = address & !1;
        let around = self.functions.range(..=address).next_back();
        let function = match around {
            Some((&start, (size, name))) if address - start < *size => name.clone(),
            _ => format!("{address:#010x}"),
        };
        let line = self.lines.find_location(address.into()).ok().flatten().as_ref().and_then(short);
        Place { function, line }
    }

    /// All lines that an address stands for: the innermost inlined function's first, its callers' after it.
    pub fn source(&self, address: u32) -> Vec<String> {
        let mut lines = Vec::new();
        let Ok(mut frames) = self.lines.find_frames((address & !1).into()).skip_all_loads() else { return lines };
        while let Ok(Some(frame)) = frames.next() {
            lines.extend(frame.location.as_ref().and_then(short));
        }
        lines
    }

    /// The function that an address was written in, inlined or not, other than those of the language and of crates from
    /// a registry; else the function that it was compiled into.
    pub fn author(&self, address: u32) -> String {
        let within = || self.place(address).function;
        let Ok(mut frames) = self.lines.find_frames((address & !1).into()).skip_all_loads() else { return within() };
        while let Ok(Some(frame)) = frames.next() {
            let file = frame.location.as_ref().and_then(|location| location.file).unwrap_or_default();
            let is_foreign = ["/library/", "/registry/", "/rustc/"].iter().any(|part| file.contains(part));
            if let Some(function) = frame.function.filter(|_| !is_foreign)
                && let Ok(name) = function.raw_name()
            {
                return format!("{:#}", rustc_demangle::demangle(&name));
            }
        }
        within()
    }

    /// The image as code memory of `size` bytes, erased where nothing is.
    pub fn code(&self, integration: &Integration, size: usize) -> Result<Vec<u8>> {
        let mut code = vec![0xFF; size];
        for (address, bytes) in &self.segments {
            let bases = std::iter::once(&integration.code).chain(integration.code_aliases);
            let start = bases.map(|base| address.wrapping_sub(*base) as usize).find(|start| *start < size);
            let place = start.and_then(|start| code.get_mut(start..)?.get_mut(..bytes.len()));
            let place = place.with_context(|| {
                format!("{} bytes at {address:#010x} are not within the {} KiB of code memory", bytes.len(), size >> 10)
            })?;
            place.copy_from_slice(bytes);
        }
        Ok(code)
    }
}

/// File name without its path, and line.
fn short(location: &addr2line::Location<'_>) -> Option<String> {
    let file = location.file?.rsplit(['/', '\\']).next()?;
    Some(format!("{file}:{}", location.line?))
}

/// `object` gives virtual addresses; initialised data is flashed elsewhere, at the physical one.
fn physical(file: &object::File<'_>, segment: &object::Segment<'_, '_>) -> Result<u32> {
    use object::read::elf::ProgramHeader;
    let object::File::Elf32(elf) = file else { bail!("not a 32-bit ELF file") };
    let endian = elf.endian();
    let (offset, _) = segment.file_range();
    let header = elf.elf_program_headers().iter().find(|header| {
        u64::from(header.p_offset(endian)) == offset
            && u64::from(header.p_vaddr(endian)) == segment.address()
            && header.p_type(endian) == object::elf::PT_LOAD
    });
    Ok(header.context("a segment without a program header")?.p_paddr(endian))
}

fn dwarf(file: &object::File<'_>) -> Result<gimli::Dwarf<Reader>> {
    gimli::Dwarf::load(|section| {
        let bytes = file.section_by_name(section.name()).and_then(|section| section.uncompressed_data().ok());
        Ok(EndianRcSlice::new(Rc::from(&*bytes.unwrap_or_default()), RunTimeEndian::Little))
    })
}
