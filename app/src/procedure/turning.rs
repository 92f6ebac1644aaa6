//! The motor's parameters, roughly or well, and its cogging.

use super::Completion;
use hallservo::config::Config;
use hallservo::service::identification::{self, Identification};
use hallservo::service::learning::{self, Learning};
#[cfg(feature = "map")]
use hallservo::service::mapping::{self, Mapping};
use hallservo::service::procedure::{self, Error, Procedure as _, State};
use hallservo::service::swings::Swings;
use hallservo::service::{Event, Service};
use hallservo::telemetry::Measurement;
use hallservo_protocol::{Activity, Refusal};

/// One of them, at work.
// The larger one makes no difference: there is one, in a static.
#[allow(clippy::large_enum_variant)]
pub(crate) enum Procedure {
    Motor(Identification),
    Cogging(Learning),
    Swings(Swings),
    #[cfg(feature = "map")]
    Magnets(Mapping),
}

impl Procedure {
    /// Writes an identification to its place.
    pub fn motor(place: &mut Option<Self>, config: &Config) -> Result<(), Refusal<'static>> {
        let plan = identification::Plan::new(config).map_err(Refusal::Procedure)?;
        Self::put(identification::Outset::new(config, &plan), |outset| Self::Motor(Identification::of(outset)), place)
    }

    /// Writes the learning of the cogging to its place.
    pub fn cogging(place: &mut Option<Self>, config: &Config) -> Result<(), Refusal<'static>> {
        let plan = learning::Plan::new(config).map_err(Refusal::Procedure)?;
        Self::put(learning::Outset::new(config, &plan), |outset| Self::Cogging(Learning::of(outset)), place)
    }

    /// Writes the swings to their place.
    pub fn swings(place: &mut Option<Self>, config: &Config) -> Result<(), Refusal<'static>> {
        Self::put(Swings::new(config), Self::Swings, place)
    }

    /// Writes the learning of the map of the magnets to its place.
    #[cfg(feature = "map")]
    pub fn magnets(place: &mut Option<Self>, config: &Config) -> Result<(), Refusal<'static>> {
        let plan = mapping::Plan::new(config).map_err(Refusal::Procedure)?;
        Self::put(Mapping::new(config, &plan), Self::Magnets, place)
    }

    /// Procedures are large for a stack: by a `match`, for `?` moves them over it once more.
    #[inline(always)]
    fn put<T>(
        made: Result<T, Error>,
        procedure: impl FnOnce(T) -> Self,
        place: &mut Option<Self>,
    ) -> Result<(), Refusal<'static>> {
        match made {
            Ok(made) => {
                *place = Some(procedure(made));
                Ok(())
            }
            Err(error) => Err(Refusal::Procedure(error)),
        }
    }

    #[inline(never)]
    fn inner(&mut self) -> &mut dyn procedure::Procedure {
        match self {
            Self::Motor(motor) => motor,
            Self::Cogging(cogging) => cogging,
            Self::Swings(swings) => swings,
            #[cfg(feature = "map")]
            Self::Magnets(magnets) => magnets,
        }
    }

    pub fn event(&mut self, event: &Event) {
        self.inner().event(event);
    }

    pub fn measurement(&mut self, measurement: &Measurement) {
        self.inner().measurement(measurement);
    }

    /// The cogging, where it is being learnt.
    #[cfg(feature = "map")]
    pub const fn learning(&self) -> Option<&Learning> {
        if let Self::Cogging(learning) = self { Some(learning) } else { None }
    }

    /// One step; `Some` at the end.
    pub fn step(&mut self, service: &mut Service, now_ms: u32) -> Option<Completion<'_>> {
        match self.inner().step(service, now_ms) {
            State::Running => None,
            State::Failed(error) => Some(Completion::Failed(self.activity(), error)),
            State::Done => Some(self.found().unwrap_or(Completion::Failed(self.activity(), Error::Inconclusive))),
        }
    }

    /// What it has come to.
    fn found(&self) -> Option<Completion<'_>> {
        match self {
            Self::Motor(motor) => motor.report().map(Completion::Motor),
            Self::Cogging(cogging) => cogging.table().map(Completion::Cogging),
            Self::Swings(swings) => swings.report().map(Completion::Swings),
            #[cfg(feature = "map")]
            Self::Magnets(mapping) => Some(Completion::Magnets(mapping)),
        }
    }

    /// Ends it without a result.
    pub fn cancel(&mut self) {
        self.inner().cancel();
    }

    pub fn progress(&self) -> f32 {
        match self {
            Self::Motor(motor) => motor.progress(),
            Self::Cogging(cogging) => cogging.progress(),
            Self::Swings(swings) => swings.progress(),
            #[cfg(feature = "map")]
            Self::Magnets(magnets) => magnets.progress(),
        }
    }

    pub const fn activity(&self) -> Activity {
        match self {
            Self::Motor(_) => Activity::Identification,
            Self::Cogging(_) => Activity::Cogging,
            Self::Swings(_) => Activity::Swings,
            #[cfg(feature = "map")]
            Self::Magnets(_) => Activity::Magnets,
        }
    }
}
