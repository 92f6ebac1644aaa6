//! hallservo for Python: the client of `hallctl`, one drive at a time. `hallservo/__init__.pyi` says what each does.

mod follow;
mod record;
mod telemetry;

use hallctl::client::{Client, unexpected};
use hallctl::error::Error;
use hallctl::{scope, values, words};
use hallservo::control::impedance::{Motion, Request};
use hallservo_protocol::{Activity, Answer, Ask, Calibration, Procedure};
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pyo3::create_exception!(_hallservo, DriveError, PyException, "The drive refuses, fails, or does not answer; in words.");

fn error(error: Error) -> PyErr {
    DriveError::new_err(error.to_string())
}

/// How long a motor is braked before the bridge is switched off, at most, in the drive's time, ms.
const BRAKING_MS: u64 = 60;

/// Ends from another thread what a drive is doing: it brakes, switches the bridge off, and what waits for it raises.
#[pyclass(frozen)]
struct Cancel(AtomicBool);

#[pymethods]
impl Cancel {
    #[new]
    fn new() -> Self {
        Self(AtomicBool::new(false))
    }

    /// What goes on is to end, or (not) may go on again.
    fn set(&self, ends: bool) {
        self.0.store(ends, Ordering::Relaxed);
    }
}

/// A drive at a port. Requests of several threads have their turn one after the other.
#[pyclass(frozen, module = "hallservo")]
struct Drive {
    client: Mutex<Option<Client>>,
    cancel: Option<Py<Cancel>>,
    /// Who has opened it. A process that forks from that one and ends does not stop the motor.
    process: u32,
}

/// Opens a port and asks who is there.
#[pyfunction]
#[pyo3(signature = (port, patience = 3.0))]
fn connect(py: Python<'_>, port: &str, patience: f64) -> PyResult<Drive> {
    cancellable(py, port, patience, None)
}

/// The same for a drive that another thread may cancel.
#[pyfunction]
#[pyo3(signature = (port, patience, cancel))]
fn cancellable(py: Python<'_>, port: &str, patience: f64, cancel: Option<Py<Cancel>>) -> PyResult<Drive> {
    let patience = Duration::try_from_secs_f64(patience).ok().filter(|patience| !patience.is_zero());
    let patience = patience.ok_or_else(|| PyValueError::new_err("patience: a number of seconds above 0 is wanted"))?;
    let client = py.detach(|| Client::connect(port, patience)).map_err(error)?;
    Ok(Drive { client: Mutex::new(Some(client)), cancel, process: process::id() })
}

impl Drive {
    /// To be called where other threads of Python may run: one of them may have it, and wait for the interpreter.
    fn lock(&self) -> MutexGuard<'_, Option<Client>> {
        self.client.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets other threads of Python run meanwhile.
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Client) -> hallctl::error::Result<R> + Send,
    ) -> PyResult<R> {
        if self.process != process::id() {
            return Err(DriveError::new_err("another process has opened it: connect anew in this one"));
        }
        let done = py.detach(|| self.lock().as_mut().map(work));
        done.ok_or_else(|| DriveError::new_err("it is closed"))?.map_err(error)
    }

    fn step_hz(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |client| Ok(client.identity().step_hz))
    }

    fn order(&self, py: Python<'_>, ask: Ask<'_>) -> PyResult<()> {
        self.with(py, |client| client.order(ask))
    }

    /// Waits for what was begun; Ctrl-C ends it.
    fn wait(&self, py: Python<'_>) -> PyResult<()> {
        let mut look = (Instant::now(), 0);
        loop {
            self.check(py)?;
            let look = &mut look;
            let rests = self.with(py, |client| {
                let status = client.status()?;
                let rests = status.activity == Activity::None;
                if !rests {
                    client.rest(look, &status)?;
                }
                Ok(rests)
            })?;
            if rests {
                return Ok(());
            }
        }
    }

    /// Ctrl-C stops the motor, and so does another thread that cancels.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        let cancelled = self.cancel.as_ref().is_some_and(|cancel| cancel.get().0.load(Ordering::Relaxed));
        let goes_on = if cancelled { Err(DriveError::new_err("cancelled")) } else { py.check_signals() };
        goes_on.inspect_err(|_| _ = self.halt(py))
    }

    /// Brakes, and switches the bridge off.
    fn halt(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, halt)
    }

    /// What a procedure has come to.
    fn outcome<T: serde::Serialize>(py: Python<'_>, outcome: Procedure<T>) -> PyResult<Bound<'_, PyAny>> {
        match outcome {
            Procedure::Done(report) => Ok(pythonize::pythonize(py, &report)?),
            Procedure::Failed(why) => Err(DriveError::new_err(words::procedure_error(&why))),
            Procedure::None | Procedure::Running => Err(DriveError::new_err("the drive was restarted meanwhile")),
        }
    }
}

fn halt(client: &mut Client) -> hallctl::error::Result<()> {
    // Refused by a drive that turns nothing.
    let _ = client.order(Ask::Speed(0.0));
    let mut until_ms = None;
    loop {
        let status = client.status()?;
        let over = status.uptime_ms >= *until_ms.get_or_insert(status.uptime_ms + BRAKING_MS);
        if over || !status.mode.drives() {
            return client.order(Ask::Disarm);
        }
    }
}

#[pymethods]
impl Drive {
    #[getter]
    fn board(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |client| Ok(client.identity().board.clone()))
    }

    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize::pythonize(py, &self.with(py, values::status)?)?)
    }

    fn arm(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, Client::arm)
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.halt(py)
    }

    fn clear(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, Client::clear)
    }

    fn voltage(&self, py: Python<'_>, share: f32) -> PyResult<()> {
        self.order(py, Ask::Voltage(share))
    }

    fn torque(&self, py: Python<'_>, newton_metres: f32) -> PyResult<()> {
        self.order(py, Ask::Torque(newton_metres))
    }

    fn speed(&self, py: Python<'_>, rad_s: f32) -> PyResult<()> {
        self.order(py, Ask::Speed(rad_s))
    }

    fn position(&self, py: Python<'_>, turns: f64) -> PyResult<()> {
        self.order(py, Ask::Position(turns))
    }

    /// A spring and a damper at the shaft.
    #[pyo3(signature = (
        position = None, *, kp = None, kd = None, torque = 0.0, max_torque = None, velocity = 0.0, stop = None,
        within = None,
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are named in Python")]
    fn impedance(
        &self,
        py: Python<'_>,
        position: Option<f64>,
        kp: Option<f32>,
        kd: Option<f32>,
        torque: f32,
        max_torque: Option<f32>,
        velocity: f32,
        stop: Option<f64>,
        within: Option<(f64, f64)>,
    ) -> PyResult<()> {
        let motion = match within {
            Some((least, most)) => Motion::Within { least_turns: Some(least), most_turns: Some(most) },
            None => Motion::To {
                position_turns: position,
                speed_rad_s: velocity,
                stop_turns: stop,
                max_speed_rad_s: None,
                max_acceleration_rad_s2: None,
            },
        };
        self.order(
            py,
            Ask::Impedance(Request {
                kp_nm_rad: kp,
                kd_nms_rad: kd,
                feed_forward_nm: torque,
                max_torque_nm: max_torque,
                motion,
                ..Request::default()
            }),
        )
    }

    fn calibrate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.order(py, Ask::Calibrate)?;
        self.wait(py)?;
        let found = self.with(py, |client| {
            client.ask(Ask::Calibration, |answer| match answer {
                Answer::Calibration(found) => Ok(found),
                other => unexpected(&other),
            })
        })?;
        match found {
            Calibration::Done(report) => Ok(pythonize::pythonize(py, &values::calibration(&report))?),
            Calibration::Failed(why) => Err(DriveError::new_err(why.to_string())),
            _ => Err(DriveError::new_err("it was ended by a command or a fault")),
        }
    }

    fn identify<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.order(py, Ask::Identify)?;
        self.wait(py)?;
        let found = self.with(py, |client| {
            client.ask(Ask::Identification, |answer| match answer {
                Answer::Identification(found) => Ok(found),
                other => unexpected(&other),
            })
        })?;
        Self::outcome(py, found)
    }

    fn get(&self, py: Python<'_>, name: &str) -> PyResult<f32> {
        self.with(py, |client| client.setting(Ask::Get(name), |setting| setting.value))
    }

    fn set(&self, py: Python<'_>, name: &str, value: f32) -> PyResult<f32> {
        self.with(py, |client| client.setting(Ask::Set { name, value }, |setting| setting.value))
    }

    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = self.with(py, |client| {
            let mut all = Vec::new();
            for number in 0..client.identity().settings {
                match client.setting(Ask::Setting(number), |setting| (setting.name.to_string(), setting.value)) {
                    Ok(setting) => all.push(setting),
                    // A drive without current control does not have all.
                    Err(Error::Refused(_)) => {}
                    Err(other) => return Err(other),
                }
            }
            Ok(all)
        })?;
        let settings = PyDict::new(py);
        all.into_iter().try_for_each(|(name, value)| settings.set_item(name, value))?;
        Ok(settings)
    }

    fn save(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |client| {
            client.ask(Ask::Save, |answer| match answer {
                Answer::Saved { waits } => Ok(!waits),
                other => unexpected(&other),
            })
        })
    }

    /// Telemetry for a time, while the motor follows a command if there is one.
    #[pyo3(signature = (seconds, hz = 1000.0, *, torque = None, speed = None, position = None))]
    fn telemetry<'py>(
        &self,
        py: Python<'py>,
        seconds: f64,
        hz: f32,
        torque: Option<f32>,
        speed: Option<f32>,
        position: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let command = follow::command(torque, speed, position)?;
        telemetry::telemetry(self, py, seconds, hz, command)
    }

    /// Records with the drive's scope.
    #[pyo3(signature = (
        channels = None, *, every = 1, rows = None, trigger = "now", before = 0.25, seconds = None, torque = None,
        speed = None, position = None,
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are named in Python")]
    fn record<'py>(
        &self,
        py: Python<'py>,
        channels: Option<Vec<String>>,
        every: u16,
        rows: Option<u16>,
        trigger: &str,
        before: f64,
        seconds: Option<f64>,
        torque: Option<f32>,
        speed: Option<f32>,
        position: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let rows = match rows {
            Some(rows) => rows,
            None => self.with(py, |client| Ok(scope::status(client)?.capacity))?,
        };
        let setup = record::setup(channels, every, rows, trigger, before)?;
        record::record(self, py, setup, seconds, follow::command(torque, speed, position)?)
    }

    /// Stops the motor, if this has moved it, and lets others have the drive.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let client = py.detach(|| self.lock().take());
        let moved = |client: &Client| client.controls() && self.process == process::id();
        match client {
            Some(mut client) if moved(&client) => py.detach(|| halt(&mut client)).map_err(error),
            _ => Ok(()),
        }
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    #[pyo3(signature = (*_error))]
    fn __exit__(&self, py: Python<'_>, _error: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py)
    }
}

impl Drop for Drive {
    fn drop(&mut self) {
        // Whatever has happened.
        let _ = Python::attach(|py| self.close(py));
    }
}

#[pymodule]
fn _hallservo(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Drive>()?;
    module.add_class::<Cancel>()?;
    module.add("DriveError", module.py().get_type::<DriveError>())?;
    module.add_function(wrap_pyfunction!(connect, module)?)?;
    module.add_function(wrap_pyfunction!(cancellable, module)?)
}
