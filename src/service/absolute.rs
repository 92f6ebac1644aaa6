//! The comparison of an absolute encoder with the Halls, for the task that runs it.

use super::Service;
use crate::board::encoder::AbsoluteEncoder;
use crate::drive::absolute::{AbsoluteTasks, SampleOf};
use crate::fault::Fault;
use crate::vernier::turns::Disagreement;

impl<E: AbsoluteEncoder + 'static> AbsoluteTasks<E> {
    /// The next sample, compared with the Halls where both have an angle. A disagreement makes a running drive fail
    /// with [`Fault::Turns`].
    pub fn poll(&mut self, service: &mut Service) -> Option<(SampleOf<E>, Result<(), Disagreement>)> {
        let (sample, agreement) = self.compare_next()?;
        if agreement.is_err() {
            // When the queue is full, the next sample's comparison sends it again.
            let _ = service.trip(Fault::Turns);
        }
        Some((sample, agreement))
    }
}
