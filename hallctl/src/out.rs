//! Where results go: words for a person, or JSON for a script. A full disk is an error, and no panic.

use crate::error::{Error, Result};
use crate::interrupt;
use crate::units::Units;
use anyhow::Context;
use serde::Serialize;
use std::fmt::Arguments;
use std::fs::{self, File};
use std::io::{self, BufRead, Write, stdin, stdout};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

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
            write(format_args!("{}", plots::table(rows)))?;
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

/// A line on the standard error, beside results. A terminal that is gone takes none, which is no reason to panic.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr().lock(), $($text)*);
    }};
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

/// A file for a table, whose name says how it is written; without an extension, as CSV.
///
/// # Errors
/// Another extension.
pub fn table(text: &str) -> std::result::Result<PathBuf, String> {
    named(text, &["csv", "json", "html"], ".csv, .json or .html")
}

/// The same where it is written as CSV.
///
/// # Errors
/// Another extension.
pub fn csv(text: &str) -> std::result::Result<PathBuf, String> {
    named(text, &["csv", "txt"], ".csv or .txt")
}

/// The same where it is a page with diagrams.
///
/// # Errors
/// Another extension.
pub fn page(text: &str) -> std::result::Result<PathBuf, String> {
    named(text, &["html"], ".html")
}

/// A file with one of some extensions, or without any.
fn named(text: &str, extensions: &[&str], words: &str) -> std::result::Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().map(|extension| extension.to_str()) {
        None => Ok(path),
        Some(Some(found)) if extensions.contains(&found) => Ok(path),
        _ => Err(format!("the file's name has to end in {words}")),
    }
}

/// Tries whether a file can be written, before the work begins; what is in it stays.
///
/// # Errors
/// It cannot.
pub fn probe(path: &Path) -> Result<()> {
    if path.is_dir() {
        let error = anyhow::Error::from(io::Error::from(io::ErrorKind::IsADirectory));
        return Err(error.context(format!("cannot write {}", path.display())).into());
    }
    // Who reads from a pipe would take that for its end.
    if is_stream(path) || is_special(path) {
        return Ok(());
    }
    let is_new = !path.exists();
    let tried = File::options().write(true).create(true).truncate(false).open(path);
    let tried = tried.and_then(|_| if is_new { fs::remove_file(path) } else { Ok(()) });
    Ok(tried.with_context(|| format!("cannot write {}", path.display()))?)
}

/// Writes a file, whole or not at all: what it held before is lost only when all is written. `-` is the standard output.
///
/// # Errors
/// It cannot be written.
pub fn save(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    let written = if is_stream(path) || is_special(path) {
        let mut file = create(path)?;
        file.write_all(content.as_ref()).and_then(|()| file.flush())
    } else {
        replace(path, content.as_ref())
    };
    Ok(written.with_context(|| format!("cannot write {}", path.display()))?)
}

/// Whether it is there and no file: a device, a pipe, a folder.
fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| !found.is_file())
}

/// By way of a file beside it.
fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    // A link goes on leading to the file.
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.into());
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.new", std::process::id()));
    let beside = path.with_file_name(name);
    let mut file = match File::create_new(&beside) {
        // A file that may be written in a folder that may not.
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => return fs::write(path, content),
        file => file?,
    };
    let written = file.write_all(content).and_then(|()| match path.metadata() {
        Ok(before) => file.set_permissions(before.permissions()),
        Err(_) => Ok(()),
    });
    let written = written.and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        // It is nobody's any more.
        let _ = fs::remove_file(&beside);
    }
    written
}

/// Reads a file; `-` is the standard input.
///
/// # Errors
/// It cannot be read, or a signal came meanwhile.
pub fn load(path: &Path) -> Result<String> {
    let read = match is_stream(path) {
        true => unless_interrupted(|| io::read_to_string(stdin().lock()))?,
        false => fs::read_to_string(path),
    };
    Ok(read.with_context(|| format!("cannot read {}", path.display()))?)
}

/// A line of the standard input; empty where it has ended.
///
/// # Errors
/// It cannot be read, or a signal came meanwhile.
pub fn answer() -> Result<String> {
    let mut line = String::new();
    let read = unless_interrupted(move || stdin().lock().read_line(&mut line).map(|_| line))?;
    Ok(read.context("the answer")?)
}

/// From look to look whether a signal has come.
const LOOK: Duration = Duration::from_millis(50);

/// Reads what may never come. A signal is heard but does not end a read, which is left to a thread.
fn unless_interrupted<T: Send + 'static>(
    read: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> Result<io::Result<T>> {
    let (sender, receiver) = channel();
    thread::spawn(move || sender.send(read()));
    loop {
        match receiver.recv_timeout(LOOK) {
            Ok(read) => return Ok(read),
            Err(_) if interrupt::came() => return Err(Error::Interrupted),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(Err(io::ErrorKind::UnexpectedEof.into())),
        }
    }
}
