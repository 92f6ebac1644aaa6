//! What the drive finds out by turning its motor, with the feature `procedures`; without, nothing of it is left in the
//! image.

#[cfg(not(feature = "procedures"))]
mod none;
#[cfg(feature = "procedures")]
mod turning;

use hallservo::control::cogging::Table;
use hallservo::service::identify::Report;
#[cfg(feature = "map")]
use hallservo::service::mapping::Mapping;
use hallservo::service::procedure::Error;
use hallservo::service::swings::Rough;
use hallservo_protocol::Activity;
#[cfg(not(feature = "procedures"))]
pub(crate) use none::Procedure;
#[cfg(feature = "procedures")]
pub(crate) use turning::Procedure;

/// How a procedure ended, with what it has found, which is large.
#[cfg_attr(not(feature = "procedures"), expect(dead_code))]
pub(crate) enum Completion<'a> {
    Motor(&'a Report),
    Cogging(&'a Table),
    Swings(&'a Rough),
    #[cfg(feature = "map")]
    Magnets(&'a Mapping),
    Failed(Activity, Error),
}
