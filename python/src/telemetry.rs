//! Telemetry for a time, as an array for each quantity.

use crate::Drive;
use hallctl::client::Client;
use hallctl::error::Error;
use hallctl::words;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Telemetry};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

pub(crate) fn telemetry<'py>(
    drive: &Drive,
    py: Python<'py>,
    seconds: f64,
    hz: f32,
    command: Option<Ask<'static>>,
) -> PyResult<Bound<'py, PyDict>> {
    // Not a number is none that is right, either.
    if !(0.0..=1e6).contains(&seconds) {
        return Err(PyValueError::new_err("some seconds are wanted"));
    }
    if hz.is_nan() || hz <= 0.0 {
        return Err(PyValueError::new_err("a number of frames a second above 0 is wanted"));
    }
    // One that was interrupted has left its latest.
    drive.with(py, |client| {
        while client.telemetry().is_some() {}
        Ok(())
    })?;
    drive.order(py, Ask::Telemetry(hz))?;
    let end_ms = drive.with(py, Client::status)?.uptime_ms + (1000.0 * seconds) as u64;
    let mut frames = Vec::new();
    let followed = drive.follow(py, command, |client, status| {
        frames.extend(std::iter::from_fn(|| client.telemetry()));
        match status.mode {
            Mode::Faulted(fault) => Err(Error::Failed(words::switched_off(fault))),
            _ => Ok(status.uptime_ms >= end_ms),
        }
    });
    drive.with(py, Client::end_telemetry)?;
    followed?;
    frames.extend(drive.with(py, |client| Ok(std::iter::from_fn(|| client.telemetry()).collect::<Vec<_>>()))?);
    columns(py, &frames, drive.step_hz(py)?)
}

/// An array for each quantity.
fn columns<'py>(py: Python<'py>, frames: &[Telemetry], step_hz: f64) -> PyResult<Bound<'py, PyDict>> {
    type Column = (&'static str, fn(&Telemetry) -> f64);
    const COLUMNS: [Column; 11] = [
        ("angle_deg", |frame| frame.angle_deg.into()),
        ("speed_rad_s", |frame| frame.speed_rad_s.into()),
        ("position_turns", |frame| frame.position_turns),
        ("current_d_a", |frame| frame.current_a[0].into()),
        ("current_q_a", |frame| frame.current_a[1].into()),
        ("voltage_d_v", |frame| frame.voltage_v[0].into()),
        ("voltage_q_v", |frame| frame.voltage_v[1].into()),
        ("bus_v", |frame| frame.bus_v.into()),
        ("hall_1", |frame| frame.codes[0].into()),
        ("hall_2", |frame| frame.codes[1].into()),
        ("hall_3", |frame| frame.codes[2].into()),
    ];
    let columns = PyDict::new(py);
    let first = frames.first().map_or(0, |frame| frame.step);
    // On the drive's clock, which wraps.
    let time_s = frames.iter().map(|frame| f64::from(frame.step.wrapping_sub(first)) / step_hz);
    columns.set_item("time_s", PyArray1::from_iter(py, time_s))?;
    for (name, of) in COLUMNS {
        columns.set_item(name, PyArray1::from_iter(py, frames.iter().map(of)))?;
    }
    Ok(columns)
}
