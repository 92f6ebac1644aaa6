//! The frames of a bus.

use super::{LINE, Stop};

/// Where they come from.
const BUS: usize = LINE + 1;

/// Hears stops in the frames of a bus that are for this drive.
#[derive(Debug, Default)]
pub struct FrameListener {
    /// Frames handed to the tasks, wrapping.
    handed_on: u32,
}

impl FrameListener {
    /// Before the first frame.
    pub const fn new() -> Self {
        Self { handed_on: 0 }
    }

    /// Every frame that arrives, and whether it was handed to the tasks or is lost for want of room.
    pub fn hear(&mut self, frame: &[u8], handed_on: bool, stop: &Stop) {
        self.handed_on = self.handed_on.wrapping_add(u32::from(handed_on));
        if stops(frame) {
            stop.hear(BUS, self.handed_on);
        }
    }
}

/// Whether it is one that stops. Lines of text count where there is somebody to read them.
pub(super) fn stops(frame: &[u8]) -> bool {
    hallservo_registers::stops(frame, cfg!(feature = "diagnostic"))
}
