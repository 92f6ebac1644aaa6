//! The simulated drive at a pseudo-terminal.

use super::{Event, pour, pump};
use anyhow::{Context, Result};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::sync::mpsc::SyncSender;
use std::thread;

/// Makes one and says its name.
pub(super) fn open(events: SyncSender<Event>) -> Result<String> {
    let control = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).context("cannot make a pseudo-terminal")?;
    grantpt(&control).context("the pseudo-terminal")?;
    unlockpt(&control).context("the pseudo-terminal")?;
    let name = ptsname(&control, Vec::new()).context("the pseudo-terminal")?;
    let name = name.into_string().context("the name of the pseudo-terminal")?;
    // Kept open, so that the line does not break between two tools; and raw, so that nothing is echoed.
    let tool_end = OpenOptions::new().read(true).write(true).open(&name).context("the pseudo-terminal")?;
    let mut attributes = tcgetattr(&tool_end).context("the pseudo-terminal")?;
    attributes.make_raw();
    tcsetattr(&tool_end, OptionalActions::Now, &attributes).context("the pseudo-terminal")?;
    let control = File::from(control);
    let out = control.try_clone().context("the pseudo-terminal")?;
    thread::spawn(move || {
        let _kept = tool_end;
        if events.send(Event::Came(pour(out))).is_ok() {
            let _ = pump(control, &events);
        }
    });
    Ok(name)
}
