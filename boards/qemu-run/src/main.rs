//! Runs a firmware in QEMU's Cortex-M4F and decodes the defmt frames that it writes by semihosting.
//!
//! The exit code is the firmware's, so that a failed check inside the emulated chip fails the command.

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, Frame, Location, Locations, Table};
use std::io::Read;
use std::process::{Command, ExitCode, Stdio};
use std::{env, fs};

/// Virtual time advances 2⁷ ns with every instruction, and with nothing else as long as the core never sleeps: runs
/// repeat to the instruction. The timers of the machine count 25 MHz, 3.2 ticks an instruction.
const ICOUNT: &str = "shift=7";

fn main() -> Result<ExitCode> {
    let elf = env::args_os().nth(1).context("usage: qemu-run FIRMWARE")?;
    let image = fs::read(&elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let table = Table::parse(&image)?.context("the firmware has no defmt section")?;
    let locations = table.get_locations(&image)?;

    let mut qemu = Command::new("qemu-system-arm")
        .args(["-machine", "mps2-an386", "-cpu", "cortex-m4"])
        .args(["-display", "none", "-serial", "none", "-monitor", "none"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .args(["-icount", ICOUNT])
        .arg("-kernel")
        .arg(&elf)
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot start qemu-system-arm; boards/setup installs it")?;

    let mut frames = qemu.stdout.take().context("no pipe from QEMU")?;
    let decoded = decode(&mut frames, &table, &locations);
    if decoded.is_err() {
        qemu.kill()?;
    }
    let status = qemu.wait()?;
    decoded?;
    Ok(match status.code() {
        Some(code) => ExitCode::from(u8::try_from(code).unwrap_or(u8::MAX)),
        None => bail!("QEMU was killed: {status}"),
    })
}

fn decode(frames: &mut impl Read, table: &Table, locations: &Locations) -> Result<()> {
    let mut decoder = table.new_stream_decoder();
    let mut buffer = [0; 4096];
    loop {
        let length = frames.read(&mut buffer)?;
        if length == 0 {
            return Ok(());
        }
        decoder.received(&buffer[..length]);
        loop {
            match decoder.decode() {
                Ok(frame) => print(&frame, locations.get(&frame.index())),
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => bail!("malformed defmt frame"),
            }
        }
    }
}

/// `println!` is the firmware's output and comes as it is; log lines carry their level, time and place.
fn print(frame: &Frame, location: Option<&Location>) {
    let Some(level) = frame.level() else {
        return println!("{}", frame.display_message());
    };
    let time = frame.display_timestamp().map_or_else(String::new, |time| time.to_string());
    let place = location.map_or_else(String::new, |location| {
        let file = location.file.file_name().unwrap_or_default();
        format!("{}:{}", file.display(), location.line)
    });
    println!("{:5} {time} {} ({place})", level.as_str(), frame.display_message());
}
