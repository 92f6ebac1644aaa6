//! Completions and manual pages.

use super::Arguments;
use crate::error::Result;
use anyhow::Context;
use clap::CommandFactory;
use std::fs;
use std::io::{Write, stdout};
use std::path::Path;

pub(super) fn completions(shell: clap_complete::Shell) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "hallctl", &mut text);
    let mut out = stdout();
    Ok(out.write_all(&text).and_then(|()| out.flush()).context("cannot write to the standard output")?)
}

pub(super) fn pages(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let written = clap_mangen::generate_to(Arguments::command(), folder);
    Ok(written.with_context(|| format!("cannot write into {}", folder.display()))?)
}
