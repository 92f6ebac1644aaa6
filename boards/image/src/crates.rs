//! Bytes of an image by the crate that they come from.

use anyhow::Result;
use object::{Object, ObjectSymbol, SymbolKind};
use std::collections::BTreeMap;

/// Code, tables and variables of a crate, in bytes.
#[derive(Default)]
struct Bytes {
    code: u64,
    tables: u64,
    variables: u64,
}

/// Prints a table, the largest first. What several crates share by name, such as constants without one, is its own row.
pub fn print(image: &object::File) -> Result<()> {
    let mut crates = BTreeMap::<String, Bytes>::new();
    let (mut named, mut last) = (0, None);
    let mut symbols: Vec<_> = image.symbols().filter(|symbol| symbol.size() > 0).collect();
    symbols.sort_by_key(|symbol| symbol.address());
    for symbol in symbols {
        // Functions that the linker has folded have one address.
        if last.replace(symbol.address()) == Some(symbol.address()) {
            continue;
        }
        let Some(section) = symbol.section_index().and_then(|index| image.section_by_index(index).ok()) else {
            continue;
        };
        if !crate::is_loaded(&section) {
            continue;
        }
        let bytes = crates.entry(origin(&format!("{:#}", rustc_demangle::demangle(symbol.name()?)))).or_default();
        if symbol.kind() == SymbolKind::Text {
            bytes.code += symbol.size();
        } else if crate::has_flag(&section, object::elf::SHF_WRITE) {
            bytes.variables += symbol.size();
        } else {
            bytes.tables += symbol.size();
        }
        named += if crate::has_flag(&section, object::elf::SHF_WRITE) { 0 } else { symbol.size() };
    }
    let unnamed = crate::sizes(image).0.saturating_sub(named);
    crates.insert("(constants without a name, padding)".into(), Bytes { tables: unnamed, ..Bytes::default() });
    let mut rows: Vec<_> = crates.into_iter().collect();
    rows.sort_by_key(|(_, bytes)| std::cmp::Reverse(bytes.code + bytes.tables + bytes.variables));
    println!("| crate | code | tables | variables |\n|---|---:|---:|---:|");
    for (name, Bytes { code, tables, variables }) in rows {
        println!("| {name} | {code} | {tables} | {variables} |");
    }
    Ok(())
}

/// The crate that a function belongs to: the first one of its path that is not of the language itself, as what is
/// generic belongs to who uses it; our own large crates by module.
fn origin(name: &str) -> String {
    if name.starts_with("OUTLINED_FUNCTION") {
        return "(parts that several functions share)".into();
    }
    if name.starts_with("__aeabi") || name.starts_with("mem") || name.contains("compiler_builtins") {
        return "(arithmetic and copying for the compiler)".into();
    }
    let paths = name.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).filter(|path| {
        // What begins with it is a method of the type before.
        path.contains("::") && !path.starts_with("::")
    });
    let path = paths.clone().find(|path| !["core::", "alloc::"].iter().any(|own| path.starts_with(own)));
    let Some(path) = path.or(paths.clone().next()) else { return "(interrupts and what has no path)".into() };
    let mut parts = path.split("::").filter(|part| !part.is_empty());
    match (parts.next(), parts.next()) {
        (Some(name @ ("hallservo" | "hallservo_app" | "stm32g4")), Some(module)) => format!("{name}::{module}"),
        (Some(name), _) => name.to_owned(),
        _ => "(interrupts and what has no path)".into(),
    }
}
