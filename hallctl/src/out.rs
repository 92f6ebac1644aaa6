//! Where results go: words for a person, or JSON for a script. A full disk is an error, and no panic.

use crate::error::Result;
use crate::units::Units;
use anyhow::Context;
use serde::Serialize;
use std::fmt::Arguments;
use std::fs::File;
use std::io::{Read, Write, stdin, stdout};
use std::path::Path;

/// Which of the two is wanted.
#[derive(Clone, Copy, Debug)]
pub struct Out {
    /// JSON, one value a line, in the drive's units.
    pub json: bool,
    /// For a person.
    pub units: Units,
}

impl Out {
    /// A line for a person.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn line(self, text: Arguments<'_>) -> Result<()> {
        if !self.json {
            write(format_args!("{text}\n"))?;
        }
        Ok(())
    }

    /// The same for a script.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn value(self, value: &impl Serialize) -> Result<()> {
        if self.json {
            let text = serde_json::to_string(value).context("the result as JSON")?;
            write(format_args!("{text}\n"))?;
        }
        Ok(())
    }

    /// A table for a person; the first row is the head.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn table(self, rows: &[Vec<String>]) -> Result<()> {
        if !self.json {
            write(format_args!("{}", sim::report::table(rows)))?;
        }
        Ok(())
    }
}

fn write(text: Arguments<'_>) -> Result<()> {
    let mut out = stdout().lock();
    Ok(out.write_fmt(text).and_then(|()| out.flush()).context("cannot write to the standard output")?)
}

/// A line for a person.
#[macro_export]
macro_rules! say {
    ($out:expr, $($text:tt)*) => { $out.line(format_args!($($text)*)) };
}

/// Whether a file is the standard input or output.
pub fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Opens a file for writing; `-` is the standard output.
///
/// # Errors
/// It cannot be written.
pub fn create(path: &Path) -> Result<Box<dyn Write>> {
    if is_stream(path) {
        return Ok(Box::new(stdout()));
    }
    Ok(Box::new(File::create(path).with_context(|| format!("cannot write {}", path.display()))?))
}

/// Writes a file; `-` is the standard output.
///
/// # Errors
/// It cannot be written.
pub fn save(path: &Path, text: &str) -> Result<()> {
    let mut file = create(path)?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.flush());
    Ok(written.with_context(|| format!("cannot write {}", path.display()))?)
}

/// Reads a file; `-` is the standard input.
///
/// # Errors
/// It cannot be read.
pub fn load(path: &Path) -> Result<String> {
    let mut text = String::new();
    let read = match is_stream(path) {
        true => stdin().read_to_string(&mut text),
        false => File::open(path).and_then(|mut file| file.read_to_string(&mut text)),
    };
    read.with_context(|| format!("cannot read {}", path.display()))?;
    Ok(text)
}
