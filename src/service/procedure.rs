//! What all procedures that turn the motor share, and how a task runs one.
//!
//! A task owns a [`Procedure`] and, about once a millisecond, passes on what the service delivers:
//!
//! ```no_run
//! use hallservo::service::learning::{Learning, Plan};
//! use hallservo::service::procedure::{Error, Procedure, State};
//! # use hallservo::{config::Config, service::Service};
//!
//! # fn task(service: &mut Service, config: &Config, now_ms: impl Fn() -> u32) -> Result<(), Error> {
//! let mut learning = Learning::new(config, &Plan::new(config)?)?;
//! let end = loop {
//!     while let Some(event) = service.poll() {
//!         learning.event(&event); // and whatever else the task does with events
//!     }
//!     while let Some(measurement) = service.measurement() {
//!         learning.measurement(&measurement);
//!     }
//!     match learning.step(service, now_ms()) {
//!         State::Running => {} // learning.progress() for a display
//!         end => break end,
//!     }
//! };
//! # let _ = end; Ok(()) }
//! ```
//!
//! A procedure begins and ends with the bridge off, field-oriented in between, with commands of its own that the task
//! does not see. It cannot get stuck: its time is the task's clock, and everything that it waits for has a limit. A
//! task that commands the drive meanwhile spoils it; `Command::Disarm` ends it.

use super::{Event, Service};
use crate::control::config::BadDemand;
use crate::drive::Refusal;
use crate::fault::Fault;
use crate::telemetry::Measurement;
use core::fmt;

/// Least rate of records and measurements.
pub(super) const LEAST_RECORD_HZ: f32 = 100.0;

/// A sequence of commands to a drive, with a result, run by a task.
pub trait Procedure {
    /// Takes an event of the service's [`poll`](Service::poll).
    fn event(&mut self, event: &Event);

    /// Takes a measurement of [`Service::measurement`].
    fn measurement(&mut self, measurement: &Measurement);

    /// One step, after the events and measurements were taken; to be called about once a millisecond with the task's
    /// clock, which may wrap. The first call begins.
    fn step(&mut self, service: &mut Service, now_ms: u32) -> State;

    /// Ends without a result, with [`Error::Cancelled`]: a turning rotor is braked first.
    fn cancel(&mut self);

    /// 0 to 1.
    fn progress(&self) -> f32;
}

/// For a task that has no other use for events and measurements. Apart, so that a chip that does not need it has none
/// of it.
pub trait Serve: Procedure {
    /// Polls the service and steps.
    fn serve(&mut self, service: &mut Service, now_ms: u32) -> State {
        while let Some(event) = service.poll() {
            self.event(&event);
        }
        while let Some(measurement) = service.measurement() {
            self.measurement(&measurement);
        }
        self.step(service, now_ms)
    }
}

impl<P: Procedure + ?Sized> Serve for P {}

/// Where a procedure is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// At work.
    Running,
    /// At its end, the bridge off and the result there.
    Done,
    /// Without a result, the bridge off.
    Failed(Error),
}

/// Why a procedure failed, or cannot begin.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// The drive was set up without current control.
    NoControl,
    /// There are fewer than a hundred records a second.
    FewRecords,
    /// A part of the plan is not in its range.
    Plan {
        /// Name of the field. It is not serialised: who makes a plan is there.
        #[cfg_attr(feature = "serde", serde(skip, default = "unnamed"))]
        field: &'static str,
    },
    /// The drive cannot be asked for a speed or a current of the plan.
    Demand(BadDemand),
    /// The drive refused a command.
    Refused(Refusal),
    /// A fault switched the bridge off.
    Fault(Fault),
    /// A command switched the bridge off.
    Disarmed,
    /// The drive gives no answer, or sends no records.
    NoAnswer,
    /// The rotor did not reach a speed or a place in time: blocked, too heavy a load, or a wrong setting of the motor.
    NotReached,
    /// The measurements do not determine the result.
    Inconclusive,
    /// There is no room for the result: two tables have to be lent to the service.
    NoTable,
    /// The task ended it.
    Cancelled,
    /// A phase got voltage, and no current to speak of flowed.
    NoCurrent {
        /// The phase, counted from 0.
        phase: u8,
    },
    /// The phases' resistances are not alike: a bad contact, or an amplifier that shows too little.
    Uneven,
    /// This firmware has no such procedure; the board has another one for setting up.
    Elsewhere,
}

/// The name of a field that was not serialised.
#[cfg(feature = "serde")]
const fn unnamed() -> &'static str {
    "field"
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoControl => write!(f, "the drive is set up without current control"),
            Self::FewRecords => write!(f, "record_hz must be at least {LEAST_RECORD_HZ} for this"),
            Self::Plan { field } => write!(f, "the plan's {field} is out of its range"),
            Self::Demand(bad) => bad.fmt(f),
            Self::Refused(refusal) => write!(f, "the drive refuses: {refusal}"),
            Self::Fault(fault) => fault.fmt(f),
            Self::Disarmed => write!(f, "the bridge was switched off"),
            Self::NoAnswer => write!(f, "the drive does not answer"),
            Self::NotReached => {
                write!(f, "the rotor did not follow: blocked, loaded, or a wrong setting of the motor")
            }
            Self::Inconclusive => write!(f, "the measurements do not determine the result"),
            Self::NoCurrent { phase } => write!(
                f,
                "no current answers the voltage at phase {}: is the motor connected, is there power?",
                (b'A' + phase) as char
            ),
            Self::Uneven => {
                write!(
                    f,
                    "the phases' resistances differ: check the motor's wires and the current sensing; or a heavy rotor swung \
                     about the field meanwhile, which friction at the shaft calms"
                )
            }
            Self::NoTable => write!(f, "the service has no table to fill"),
            Self::Cancelled => write!(f, "cancelled"),
            Self::Elsewhere => {
                write!(f, "this firmware cannot: set the drive up with the one that it is delivered with")
            }
        }
    }
}

impl core::error::Error for Error {}
