//! Springs and dampers on their way to the drive.

use super::{Origin, QueueFull, Service};
use crate::control::Impedance;
use crate::drive::Command;
use crate::telemetry::Reference;

impl Service {
    /// Adds memory for a spring and a damper; with two, one can be filled while the drive uses the other. Gives the
    /// memory back where there are two already.
    pub fn add_impedance(&mut self, place: &'static mut Impedance) -> Option<&'static mut Impedance> {
        self.impedances.push(place).err()
    }

    /// Lets the drive follow a spring and a damper, copied to memory that was [added](Self::add_impedance); its answer
    /// is a later [`Event::Reply`](super::Event::Reply).
    ///
    /// # Errors
    /// [`QueueFull`]: that, or the drive has not taken up the last one yet. Nothing has changed then.
    pub fn follow_impedance(&mut self, impedance: &Impedance) -> Result<(), QueueFull> {
        while !self.impedances.is_full()
            && let Some(unused) = self.tasks.impedances.dequeue()
        {
            let _ = self.impedances.push(unused);
        }
        let place = self.impedances.pop().ok_or(QueueFull)?;
        *place = *impedance;
        self.enqueue(Command::Impedance(place), Origin::User).map_err(|refused| {
            if let Command::Impedance(place) = refused {
                let _ = self.impedances.push(place);
            }
            QueueFull
        })
    }

    /// Where the reference of the spring and the damper is, as of the last 64 steps; while one is followed.
    pub fn reference(&self) -> Reference {
        self.tasks.told.get()
    }
}
