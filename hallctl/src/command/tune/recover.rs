//! A loop that swings may go so far that the drive switches off. For a trial that is an answer, and the next one goes on.

use crate::client::Client;
use crate::command::motion::AT_REST_RAD_S;
use crate::error::{Error, Result};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo_protocol::Ask;
use std::time::Instant;

/// What a loop that swings comes to.
pub(super) const BY_SWINGING: [Fault; 3] = [Fault::FollowingError, Fault::Commutation, Fault::OverSpeed];
/// A load behind its shaft has come to rest, in the drive's time, ms.
const STILL_MS: u64 = 300;
/// Longest wait for that, ms.
const LONGEST_MS: u64 = 3_000;

/// What comes of work; none if the drive switched off because a loop swings. It is armed again then.
pub(super) fn unless_it_swings<T>(
    client: &mut Client,
    work: impl FnOnce(&mut Client) -> Result<T>,
) -> Result<Option<T>> {
    match unless(client, &BY_SWINGING, work)? {
        Ok(done) => Ok(Some(done)),
        Err(error) => {
            if again(client)? {
                Ok(None)
            } else {
                Err(error)
            }
        }
    }
}

/// What comes of work; what ended it, if the drive switched off by one of some faults, which it still has then.
pub(super) fn unless<T>(
    client: &mut Client,
    faults: &[Fault],
    work: impl FnOnce(&mut Client) -> Result<T>,
) -> Result<Result<T>> {
    match work(client) {
        Err(error @ (Error::Failed(_) | Error::Refused(_))) => match client.status()?.mode {
            Mode::Faulted(fault) if faults.contains(&fault) => Ok(Err(error)),
            _ => Err(error),
        },
        result => result.map(Ok),
    }
}

/// Whether the drive is armed again: not where the rotor is still too fast, for something else drives it.
fn again(client: &mut Client) -> Result<bool> {
    wait(client, |_| Ok(()))?;
    let most_rad_s = client.setting(Ask::Get("max_speed_rad_s"), |setting| setting.value)?;
    if client.status()?.speed_rad_s.abs() > most_rad_s {
        return Ok(false);
    }
    client.order(Ask::Clear)?;
    client.arm().map(|()| true)
}

/// Waits until the load behind the shaft swings no more, while the drive holds the rotor at rest; a loop that swings by
/// itself is waited for in vain.
pub(super) fn calm(client: &mut Client) -> Result<()> {
    wait(client, |client| client.order(Ask::Speed(0.0)))
}

/// Switches the bridge off, forgets one of some faults, and waits until the load behind the shaft swings no more.
pub(super) fn off(client: &mut Client, faults: &[Fault]) -> Result<()> {
    client.order(Ask::Disarm)?;
    if matches!(client.status()?.mode, Mode::Faulted(fault) if faults.contains(&fault)) {
        client.order(Ask::Clear)?;
    }
    wait(client, |_| Ok(()))
}

fn wait(client: &mut Client, hold: impl Fn(&mut Client) -> Result<()>) -> Result<()> {
    let began_ms = client.status()?.uptime_ms;
    let (mut moved_ms, mut look) = (began_ms, (Instant::now(), began_ms));
    loop {
        hold(client)?;
        let status = client.status()?;
        let now_ms = status.uptime_ms;
        if status.speed_rad_s.abs() > AT_REST_RAD_S {
            moved_ms = now_ms;
        }
        if now_ms >= moved_ms + STILL_MS || now_ms >= began_ms + LONGEST_MS {
            return Ok(());
        }
        client.rest(&mut look, &status)?;
    }
}
