//! The interrupt's end.

use super::Recording;
use super::tasks::Shared;
use crate::board::{Output, Sample};
use crate::drive::Drive;
use core::sync::atomic::Ordering::Relaxed;
use heapless::spsc::{Consumer, Producer};

/// What the control interrupt owns of a scope.
pub struct Recorder {
    pub(super) come: Consumer<'static, &'static mut Recording, 2>,
    pub(super) done: Producer<'static, &'static mut Recording, 2>,
    pub(super) shared: &'static Shared,
    pub(super) recording: Option<&'static mut Recording>,
}

impl Recorder {
    /// To be called after every step, with what went in and came out, once the bridge has it. It never waits, and
    /// computes with integers only.
    #[inline(always)]
    pub fn take(&mut self, drive: &Drive, sample: &Sample, output: &Output) {
        if self.shared.lent.load(Relaxed) {
            self.go_on(drive, sample, output.pack());
        }
    }

    #[cold]
    #[inline(never)]
    fn go_on(&mut self, drive: &Drive, sample: &Sample, output: u64) {
        let Some(recording) = &mut self.recording else {
            self.recording = self.come.dequeue();
            return;
        };
        recording.take(drive, sample, &Output::unpack(output), self.shared.commanded.load(Relaxed));
        self.shared.triggered.store(recording.is_triggered(), Relaxed);
        if (recording.is_complete() || self.shared.cancelled.load(Relaxed))
            && let Some(recording) = self.recording.take()
        {
            self.shared.lent.store(false, Relaxed);
            // There is one recording, so it has room.
            let _ = self.done.enqueue(recording);
        }
    }
}
