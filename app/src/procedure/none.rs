//! No procedures: the drive was set up with a firmware that has them.

use super::Completion;
use hallservo::config::Config;
use hallservo::service::procedure::Error;
use hallservo::service::{Event, Service};
use hallservo::telemetry::Measurement;
use hallservo_protocol::{Activity, Refusal};

/// None is ever at work.
pub(crate) enum Procedure {}

impl Procedure {
    pub const fn motor(_: &mut Option<Self>, _: &Config) -> Result<(), Refusal<'static>> {
        Err(Refusal::Procedure(Error::Elsewhere))
    }

    pub const fn cogging(_: &mut Option<Self>, _: &Config) -> Result<(), Refusal<'static>> {
        Err(Refusal::Procedure(Error::Elsewhere))
    }

    pub const fn swings(_: &mut Option<Self>, _: &Config) -> Result<(), Refusal<'static>> {
        Err(Refusal::Procedure(Error::Elsewhere))
    }

    pub const fn event(&mut self, _: &Event) {
        match *self {}
    }

    pub const fn measurement(&mut self, _: &Measurement) {
        match *self {}
    }

    pub const fn step(&mut self, _: &mut Service, _: u32) -> Option<Completion<'_>> {
        match *self {}
    }

    pub const fn cancel(&mut self) {
        match *self {}
    }

    pub const fn progress(&self) -> f32 {
        match *self {}
    }

    pub const fn activity(&self) -> Activity {
        match *self {}
    }
}
