//! Finds or builds the firmware of a board.

use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of a board's firmware in this repository.
pub fn folder(board: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../boards").join(board)
}

/// Builds what `cargo run --release` in the board's folder would flash, and returns its path.
///
/// # Errors
/// The build's failure, or a board without a folder.
pub fn build(board: &str) -> Result<PathBuf> {
    let folder = folder(board);
    ensure!(folder.is_dir(), "there is no firmware in {}", folder.display());
    executable(&folder, &["build", "--release"], board)
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
