//! hallservo for Python: the client of `hallctl`, one drive at a time. `hallservo/__init__.pyi` says what each does.

use hallctl::client::{Client, unexpected};
use hallctl::error::Error;
use hallctl::words;
use hallservo::control::impedance::{Motion, Request};
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Answer, Ask, Calibration, Procedure, Telemetry};
use numpy::PyArray1;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::{Duration, Instant};

pyo3::create_exception!(_hallservo, DriveError, PyException, "The drive refuses, fails, or does not answer; in words.");

fn error(error: Error) -> PyErr {
    DriveError::new_err(error.to_string())
}

/// How long a motor is braked before the bridge is switched off, at most, in the drive's time, ms.
const BRAKING_MS: u64 = 60;
/// From look to look at the drive, at most.
const EVERY: Duration = Duration::from_millis(20);

/// A drive at a port.
#[pyclass(unsendable)]
struct Drive {
    client: Option<Client>,
}

/// Opens a port and asks who is there.
#[pyfunction]
#[pyo3(signature = (port, patience = 3.0))]
fn connect(port: &str, patience: f64) -> PyResult<Drive> {
    let patience = Duration::try_from_secs_f64(patience).map_err(|why| PyValueError::new_err(why.to_string()))?;
    Ok(Drive { client: Some(Client::connect(port, patience).map_err(error)?) })
}

impl Drive {
    fn client(&mut self) -> PyResult<&mut Client> {
        self.client.as_mut().ok_or_else(|| DriveError::new_err("it is closed"))
    }

    fn order(&mut self, ask: Ask<'_>) -> PyResult<()> {
        self.client()?.order(ask).map_err(error)
    }

    /// Waits for what was begun; Ctrl-C ends it.
    fn wait(&mut self, py: Python<'_>) -> PyResult<()> {
        let mut look = (Instant::now(), 0);
        loop {
            self.check(py)?;
            let client = self.client()?;
            let status = client.status().map_err(error)?;
            if status.activity == Activity::None {
                return Ok(());
            }
            client.rest(&mut look, &status).map_err(error)?;
        }
    }

    /// Ctrl-C stops the motor.
    fn check(&mut self, py: Python<'_>) -> PyResult<()> {
        py.check_signals().inspect_err(|_| _ = self.halt())
    }

    /// Brakes, and switches the bridge off.
    fn halt(&mut self) -> PyResult<()> {
        let client = self.client()?;
        // Refused by a drive that turns nothing.
        let _ = client.order(Ask::Speed(0.0));
        let mut until_ms = None;
        loop {
            let status = client.status().map_err(error)?;
            let over = status.uptime_ms >= *until_ms.get_or_insert(status.uptime_ms + BRAKING_MS);
            if over || !status.mode.drives() {
                return client.order(Ask::Disarm).map_err(error);
            }
        }
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

#[pymethods]
impl Drive {
    #[getter]
    fn board(&mut self) -> PyResult<String> {
        Ok(self.client()?.identity().board.clone())
    }

    fn status<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize::pythonize(py, &self.client()?.status().map_err(error)?)?)
    }

    fn arm(&mut self) -> PyResult<()> {
        self.client()?.arm().map_err(error)
    }

    fn stop(&mut self) -> PyResult<()> {
        self.halt()
    }

    fn clear(&mut self) -> PyResult<()> {
        self.order(Ask::Clear)
    }

    fn voltage(&mut self, share: f32) -> PyResult<()> {
        self.order(Ask::Voltage(share))
    }

    fn torque(&mut self, newton_metres: f32) -> PyResult<()> {
        self.order(Ask::Torque(newton_metres))
    }

    fn speed(&mut self, rad_s: f32) -> PyResult<()> {
        self.order(Ask::Speed(rad_s))
    }

    fn position(&mut self, turns: f64) -> PyResult<()> {
        self.order(Ask::Position(turns))
    }

    /// A spring and a damper at the shaft.
    #[pyo3(signature = (
        position = None, *, kp = None, kd = None, torque = 0.0, max_torque = None, velocity = 0.0, stop = None,
        within = None,
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are named in Python")]
    fn impedance(
        &mut self,
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
        self.order(Ask::Impedance(Request {
            kp_nm_rad: kp,
            kd_nms_rad: kd,
            feed_forward_nm: torque,
            max_torque_nm: max_torque,
            motion,
            ..Request::default()
        }))
    }

    fn calibrate<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.order(Ask::Calibrate)?;
        self.wait(py)?;
        let found = self.client()?.ask(Ask::Calibration, |answer| match answer {
            Answer::Calibration(found) => Ok(found),
            other => unexpected(&other),
        });
        match found.map_err(error)? {
            Calibration::Done(report) => Ok(pythonize::pythonize(py, &report)?),
            Calibration::Failed(why) => Err(DriveError::new_err(why.to_string())),
            _ => Err(DriveError::new_err("it was ended by a command or a fault")),
        }
    }

    fn identify<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.order(Ask::Identify)?;
        self.wait(py)?;
        let found = self.client()?.ask(Ask::Identification, |answer| match answer {
            Answer::Identification(found) => Ok(found),
            other => unexpected(&other),
        });
        Self::outcome(py, found.map_err(error)?)
    }

    fn get(&mut self, name: &str) -> PyResult<f32> {
        self.client()?.setting(Ask::Get(name), |setting| setting.value).map_err(error)
    }

    fn set(&mut self, name: &str, value: f32) -> PyResult<f32> {
        self.client()?.setting(Ask::Set { name, value }, |setting| setting.value).map_err(error)
    }

    fn settings<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        let client = self.client()?;
        for number in 0..client.identity().settings {
            match client.setting(Ask::Setting(number), |setting| all.set_item(setting.name, setting.value)) {
                Ok(put) => put?,
                // A drive without current control does not have all.
                Err(Error::Refused(_)) => {}
                Err(other) => return Err(error(other)),
            }
        }
        Ok(all)
    }

    fn save(&mut self) -> PyResult<bool> {
        let saved = self.client()?.ask(Ask::Save, |answer| match answer {
            Answer::Saved { waits } => Ok(!waits),
            other => unexpected(&other),
        });
        saved.map_err(error)
    }

    /// Records for a time, while the motor follows a command if there is one.
    #[pyo3(signature = (seconds, hz = 1000.0, *, torque = None, speed = None, position = None))]
    fn record<'py>(
        &mut self,
        py: Python<'py>,
        seconds: f64,
        hz: f32,
        torque: Option<f32>,
        speed: Option<f32>,
        position: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let asks: Vec<_> = [torque.map(Ask::Torque), speed.map(Ask::Speed), position.map(Ask::Position)]
            .into_iter()
            .flatten()
            .collect();
        // Not a number is none that is right, either.
        if asks.len() > 1 || !(0.0..=1e6).contains(&seconds) {
            return Err(PyValueError::new_err("one of torque, speed and position, and some seconds are wanted"));
        }
        self.order(Ask::Telemetry(hz))?;
        let frames = self.follow(py, seconds, asks.first().copied());
        self.client()?.end_telemetry().map_err(error)?;
        let mut frames = frames?;
        frames.extend(std::iter::from_fn(|| self.client.as_mut()?.telemetry()));
        columns(py, &frames, self.client()?.identity().step_hz)
    }

    /// Stops the motor, if this has moved it, and lets others have the drive.
    fn close(&mut self) -> PyResult<()> {
        let controls = self.client.as_ref().is_some_and(Client::controls);
        let stopped = if controls { self.halt() } else { Ok(()) };
        self.client = None;
        stopped
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    #[pyo3(signature = (*_error))]
    fn __exit__(&mut self, _error: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close()
    }
}

impl Drop for Drive {
    fn drop(&mut self) {
        // Whatever has happened.
        let _ = self.close();
    }
}

impl Drive {
    fn follow(&mut self, py: Python<'_>, seconds: f64, ask: Option<Ask<'static>>) -> PyResult<Vec<Telemetry>> {
        let began = self.client()?.status().map_err(error)?;
        let end_ms = began.uptime_ms + (1000.0 * seconds) as u64;
        let (mut frames, mut look) = (Vec::new(), (Instant::now(), began.uptime_ms));
        loop {
            self.check(py)?;
            if let Some(ask) = ask {
                self.order(ask)?;
            }
            let client = self.client()?;
            let status = client.status().map_err(error)?;
            if let Mode::Faulted(fault) = status.mode {
                return Err(DriveError::new_err(format!("the drive switched off: {fault}")));
            }
            frames.extend(std::iter::from_fn(|| client.telemetry()));
            if status.uptime_ms >= end_ms {
                return Ok(frames);
            }
            client.pause(&mut look, &status, EVERY).map_err(error)?;
        }
    }
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

#[pymodule]
fn _hallservo(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Drive>()?;
    module.add("DriveError", module.py().get_type::<DriveError>())?;
    module.add_function(wrap_pyfunction!(connect, module)?)
}
