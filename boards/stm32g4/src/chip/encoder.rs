//! What a board has on the motor's shaft beside the Halls: nothing, or with the feature `encoder` two rings.

#[cfg(not(feature = "encoder"))]
pub use without::*;

#[cfg(feature = "encoder")]
pub use rings::*;

/// The Halls alone.
#[cfg(not(feature = "encoder"))]
mod without {
    use crate::chip::Board;
    use hallservo::board::{Interlock, Output, Sample};
    use hallservo::drive::Drive;
    use hallservo_app::encoder::NoEncoder;

    /// What the tasks have of it.
    pub type OnShaft = NoEncoder;
    /// What the control interrupt has.
    pub type OwnDrive = Drive;

    /// The drive in it.
    #[inline(always)]
    pub const fn own(drive: &OwnDrive) -> &Drive {
        drive
    }

    /// One control period.
    #[inline(always)]
    pub fn period<B: Board>(_: &mut B, drive: &mut Drive, sample: &Sample, interlock: Option<Interlock>) -> Output {
        match interlock {
            None => drive.step(sample),
            Some(interlock) => drive.step_off(sample, interlock),
        }
    }
}

/// Two rings under two opposite heads each.
#[cfg(feature = "encoder")]
mod rings {
    use crate::chip::Board;
    use hallservo::board::{Interlock, Output, Sample};
    use hallservo::drive::absolute::AbsoluteDrive;
    use hallservo::vernier::encoder::Encoder;
    use hallservo_app::encoder::Vernier;

    /// Heads over each ring.
    pub const HEADS: usize = 2;
    /// What the tasks have of it.
    pub type OnShaft = Vernier<HEADS>;
    /// What the control interrupt has.
    pub type OwnDrive = AbsoluteDrive<Encoder<HEADS>>;

    /// The drive in it.
    #[inline(always)]
    pub fn own(drive: &OwnDrive) -> &hallservo::drive::Drive {
        drive.drive()
    }

    /// One control period.
    #[inline(always)]
    pub fn period<B: Board>(
        board: &mut B,
        drive: &mut OwnDrive,
        sample: &Sample,
        interlock: Option<Interlock>,
    ) -> Output {
        let reading = board.heads();
        match interlock {
            None => drive.step(sample, reading),
            Some(interlock) => drive.step_off(sample, interlock, reading),
        }
    }
}
