//! The seam for a gate driver that has to be configured and can report a fault, such as a DRV8323 by SPI.
//!
//! Its registers are far too slow for the control interrupt: a task configures it before the drive may be armed, and
//! looks at it every few milliseconds. What it finds reaches the drive as
//! [`Command::Trip`](crate::drive::Command::Trip). What has to act at once, the driver's fault pin, belongs to the
//! timer's break input.

use crate::fault::Fault;

/// A gate driver with registers.
pub trait GateDriver {
    /// Why it could not be talked to.
    type Error;
    /// What it reports.
    type Report;

    /// Writes its configuration and reads it back: dead time, gate currents, gains of its amplifiers. Before the bridge
    /// is on for the first time, and after a fault.
    ///
    /// # Errors
    /// It does not answer, or does not hold what was written; the drive is not to be armed.
    fn configure(&mut self) -> Result<(), Self::Error>;

    /// Reads its fault registers; `None` while all is well.
    ///
    /// # Errors
    /// It does not answer.
    fn report(&mut self) -> Result<Option<Self::Report>, Self::Error>;
}

/// One look at a gate driver: what a task tells the drive by [`Command::Trip`](crate::drive::Command::Trip). A driver
/// that does not answer is one that cannot report anything, and a fault as well.
pub fn look<D: GateDriver>(driver: &mut D) -> Option<Fault> {
    match driver.report() {
        Ok(None) => None,
        Ok(Some(_)) | Err(_) => Some(Fault::GateDriver),
    }
}
