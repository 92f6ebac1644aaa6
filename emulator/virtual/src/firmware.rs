//! The boards of this repository: found by their folders, their firmware built.

use anyhow::{Context, Result, bail, ensure};
use chip::Board;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// The folder of all boards.
pub fn boards() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../boards")
}

/// The board of a name.
///
/// # Errors
/// No such board, with those that there are; or what is wrong with its description.
pub fn board(name: &str) -> Result<Arc<Board>> {
    let known = Board::names(&boards())?;
    if !known.iter().any(|known| known == name) {
        bail!("no virtual board {name:?}; there are {}", known.join(", "));
    }
    Ok(Board::load(&boards().join(name))?)
}

/// Builds what `cargo run --release` in the board's folder would flash, and returns its path.
///
/// # Errors
/// The build's failure.
pub fn build(board: &str) -> Result<PathBuf> {
    executable(&boards().join(board), &["build", "--release"], board)
}

/// The same of the firmware for two rings on the shaft, which is a program of its own.
///
/// # Errors
/// The build's failure, as of a board that samples no heads.
pub fn build_with_encoder(board: &str) -> Result<PathBuf> {
    let name = format!("{board}-encoder");
    executable(&boards().join(board), &["build", "--release", "--features", "encoder", "--bin", &name], &name)
}

/// The same of the firmware that speaks on a bus, which may be a program of its own.
///
/// # Errors
/// The build's failure, as of a board without one.
pub fn build_for_bus(board: &Board) -> Result<PathBuf> {
    let can = board.can.with_context(|| format!("the {} has no CAN", board.name))?;
    if !can.own_firmware {
        return build(&board.name);
    }
    let name = format!("{}-can", board.name);
    let arguments = ["build", "--release", "--no-default-features", "--features", "can", "--bin", &name];
    executable(&boards().join(&board.name), &arguments, &name)
}

/// Lets cargo build in a folder, and returns the path of the executable of a name.
///
/// # Errors
/// The build's failure, or no such executable.
pub fn executable(folder: &Path, arguments: &[&str], name: &str) -> Result<PathBuf> {
    let output = Command::new("cargo")
        .args(arguments)
        .arg("--message-format=json-render-diagnostics")
        .current_dir(folder)
        // The toolchain and the flags are the folder's, not those of the command that runs this.
        .env_remove("RUSTUP_TOOLCHAIN")
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .stderr(std::process::Stdio::inherit())
        .output()
        .context("cargo does not start")?;
    ensure!(output.status.success(), "what is in {} does not build", folder.display());
    let messages = serde_json::Deserializer::from_slice(&output.stdout).into_iter::<serde_json::Value>();
    let mut paths = messages.flatten().filter_map(|message| Some(PathBuf::from(message.get("executable")?.as_str()?)));
    paths
        .find(|path| path.file_stem().is_some_and(|stem| stem == name))
        .with_context(|| format!("cargo built no {name} in {}", folder.display()))
}
