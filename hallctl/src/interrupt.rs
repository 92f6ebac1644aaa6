//! Ctrl-C, and the requests to end that a terminal or a system sends.

use anyhow::Context;
use std::process::exit;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Exit code of a command that a signal has ended, as shells have it for Ctrl-C.
pub const EXIT: u8 = 130;
/// As many signals end the process at once.
const IMPATIENT: u32 = 3;

static SIGNALS: AtomicU32 = AtomicU32::new(0);

/// From now on a signal does not end the process, but what it is doing.
///
/// # Errors
/// Those of the system.
pub fn catch() -> anyhow::Result<()> {
    let heard = || {
        if SIGNALS.fetch_add(1, Relaxed) + 1 >= IMPATIENT {
            exit(EXIT.into());
        }
    };
    ctrlc::set_handler(heard).context("cannot catch Ctrl-C")
}

/// Whether a signal has come.
pub fn came() -> bool {
    SIGNALS.load(Relaxed) > 0
}
