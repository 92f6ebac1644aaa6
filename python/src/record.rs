//! A recording of the drive's scope, as an array for each channel.

use crate::Drive;
use hallctl::client::Client;
use hallctl::error::Error;
use hallctl::scope::{self, Recording};
use hallctl::units::Units;
use hallctl::words;
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Setup, State, Trigger};
use hallservo_protocol::Ask;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Duration;

/// What is recorded unless something else is asked for, as by `hallctl record`.
const USUAL: [Channel; 4] = [Channel::ReferenceQ, Channel::CurrentQ, Channel::SpeedReference, Channel::Speed];
/// From look to look while the rows before the trigger are taken.
const EVERY: Duration = Duration::from_millis(5);
/// The time for which the last row is still on its way when all are counted, ms.
const MARGIN_MS: u64 = 2;

/// What is to be recorded, out of the words of a script.
pub(crate) fn setup(
    channels: Option<Vec<String>>,
    every: u16,
    rows: u16,
    trigger: &str,
    before: f64,
) -> PyResult<Setup> {
    let named = |names: Vec<String>| names.iter().map(|name| scope::channel(name)).collect::<Result<_, _>>();
    let channels: Vec<_> = channels.map_or(Ok(USUAL.to_vec()), named).map_err(PyValueError::new_err)?;
    let trigger = scope::trigger(trigger).map_err(PyValueError::new_err)?.trigger(Units::default());
    if !(0.0..=0.99).contains(&before) {
        return Err(PyValueError::new_err("a share from 0 to 0.99 can be before the trigger"));
    }
    scope::setup(&channels, every, rows, before, trigger).map_err(|why| PyValueError::new_err(why.to_string()))
}

/// Records; as soon as the rows before the trigger are taken, the motor follows a command, if there is one.
pub(crate) fn record<'py>(
    drive: &Drive,
    py: Python<'py>,
    setup: Setup,
    seconds: Option<f64>,
    command: Option<Ask<'static>>,
) -> PyResult<Bound<'py, PyDict>> {
    let seconds = seconds.unwrap_or(f64::INFINITY);
    if seconds.is_nan() || seconds < 0.0 {
        return Err(PyValueError::new_err("some seconds are wanted"));
    }
    let id = drive.with(py, |client| scope::begin(client, setup))?;
    let before = if setup.trigger == Trigger::Now { 0 } else { setup.before };
    let rows_s = f64::from(setup.every) * f64::from(before) / drive.step_hz(py)?;
    let begun = if command.is_some() { pass(drive, py, rows_s) } else { Ok(()) };
    let recorded = begun.and_then(|()| complete(drive, py, &setup, seconds, command));
    // Free for others, whatever has happened.
    if recorded.is_err() {
        let _ = drive.with(py, scope::end);
    }
    recorded?;
    let recording = drive.with(py, |client| scope::finish(client, id, seconds))?;
    arrays(py, &recording)
}

/// Lets time of the drive pass.
fn pass(drive: &Drive, py: Python<'_>, seconds: f64) -> PyResult<()> {
    let until_ms = drive.with(py, Client::status)?.uptime_ms + (1000.0 * seconds) as u64 + MARGIN_MS;
    while drive.with(py, Client::status)?.uptime_ms < until_ms {
        drive.check(py)?;
        drive.with(py, |client| client.listen(EVERY))?;
    }
    Ok(())
}

/// Until all rows are there, `seconds` of the drive's time at most.
fn complete(drive: &Drive, py: Python<'_>, setup: &Setup, seconds: f64, command: Option<Ask<'static>>) -> PyResult<()> {
    let began_ms = drive.with(py, Client::status)?.uptime_ms;
    drive.follow(py, command, |client, status| {
        let state = scope::status(client)?.state;
        if let (Mode::Faulted(fault), Some(_), State::Waiting) = (status.mode, command, state)
            && setup.trigger != Trigger::Fault
        {
            return Err(Error::Failed(words::switched_off(fault)));
        }
        let is_over = !matches!(state, State::Waiting | State::Triggered);
        let passed_ms = status.uptime_ms.saturating_sub(began_ms);
        if !is_over && passed_ms as f64 > 1000.0 * seconds {
            return Err(scope::late(state, seconds));
        }
        Ok(is_over)
    })
}

/// An array for each channel.
fn arrays<'py>(py: Python<'py>, recording: &Recording) -> PyResult<Bound<'py, PyDict>> {
    let arrays = PyDict::new(py);
    arrays.set_item("time_s", PyArray1::from_slice(py, &recording.time_s))?;
    for (channel, values) in recording.channels.iter().zip(&recording.values) {
        arrays.set_item(scope::name(*channel), PyArray1::from_slice(py, values))?;
    }
    Ok(arrays)
}
