//! A command that is sent again and again until something is over.

use crate::Drive;
use hallctl::client::Client;
use hallctl::error::Result;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Status};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// From look to look at the drive, at most.
const EVERY: Duration = Duration::from_millis(20);

/// What the motor is to follow, if anything.
pub(crate) fn command(
    torque: Option<f32>,
    speed: Option<f32>,
    position: Option<f64>,
) -> PyResult<Option<Ask<'static>>> {
    let all = [torque.map(Ask::Torque), speed.map(Ask::Speed), position.map(Ask::Position)];
    let mut asked = all.into_iter().flatten();
    match (asked.next(), asked.next()) {
        (command, None) => Ok(command),
        _ => Err(PyValueError::new_err("one of torque, speed and position is wanted")),
    }
}

impl Drive {
    /// Sends a command, if there is one, until `over`, which looks at the drive each time. The first one takes the control,
    /// the next ones keep it: a process that was suspended meanwhile does not set the motor in motion again.
    pub(crate) fn follow(
        &self,
        py: Python<'_>,
        command: Option<Ask<'static>>,
        mut over: impl FnMut(&mut Client, &Status) -> Result<bool> + Send,
    ) -> PyResult<()> {
        let mut look = (Instant::now(), self.with(py, Client::status)?.uptime_ms);
        let mut goes_on = false;
        loop {
            self.check(py)?;
            let (look, over) = (&mut look, &mut over);
            let again = std::mem::replace(&mut goes_on, true);
            let is_over = self.with(py, |client| {
                let order = if again { Client::repeat } else { Client::order };
                let ordered = command.map_or(Ok(()), |command| order(client, command));
                let status = client.status()?;
                // A drive that has switched off refuses, and it is the other's to judge.
                if !matches!(status.mode, Mode::Faulted(_)) {
                    ordered?;
                }
                let is_over = over(client, &status)?;
                if !is_over {
                    client.pause(look, &status, EVERY)?;
                }
                Ok(is_over)
            })?;
            if is_over {
                return Ok(());
            }
        }
    }
}
