//! What survives a power cut: three kinds of records, when they are saved, and what is wrong with those found.

use embedded_storage::nor_flash::NorFlash;
use hallservo::hall::model::Model;
use hallservo::storage::{Error, LONGEST, Store, calibration};
use hallservo_protocol::{Problem, Record};

/// Kinds of records, each with two blocks.
pub const KINDS: u32 = 3;
/// Versions of the records' forms.
const VERSIONS: [u16; KINDS as usize] = [calibration::VERSION, 1, 1];
/// Least difference between what is learnt and what is stored for it to be worth a save: 1 % of an amplitude in offset or amplitude,
/// 0.5° (electrical) of placement, 1 % of third harmonic. It is above what noise moves the parameters by, and below what is felt.
pub const WORTH: f32 = 0.01;
/// The same for the placement, electrical degrees.
pub const WORTH_DEG: f32 = 0.5;
/// Least time between two saves of what is learnt. At this rate the 10 000 erases of a block of an STM32G4, two blocks in turn,
/// last for 138 days of constant learning, and learning ends where nothing differs any more.
pub const REST_S: u64 = 600;

/// The flash with its blocks.
pub(crate) struct Saving<F> {
    flash: F,
    place: u32,
}

impl<F: NorFlash> Saving<F> {
    pub const fn new(flash: F, place: u32) -> Self {
        Self { flash, place }
    }

    fn store(&mut self, kind: Record) -> Result<Store<&mut F>, Problem> {
        let place = self.place + 2 * kind as u32 * F::ERASE_SIZE as u32;
        Store::new(&mut self.flash, place, VERSIONS[kind as usize]).map_err(|_| Problem::Flash)
    }

    /// Copies a record and tells its length, or why there is none.
    pub fn load(&mut self, kind: Record, record: &mut [u8; LONGEST]) -> Result<usize, Problem> {
        self.store(kind)?.load(record).map_err(|error| match error {
            Error::Blank => Problem::Blank,
            Error::Version { found } => Problem::Version(found),
            Error::Corrupt | Error::TooLong | Error::NotKept => Problem::Corrupt,
            Error::Place | Error::Flash(_) => Problem::Flash,
        })
    }

    /// Saves a record; it stalls the core for as long as an erase takes.
    pub fn save(&mut self, kind: Record, record: &[u8]) -> Result<(), Problem> {
        self.store(kind)?.save(record).map_err(|_| Problem::Flash)
    }
}

/// Whether two models differ by more than [`WORTH`].
pub(crate) fn differ(a: &Model, b: &Model) -> bool {
    (a.alignment, a.reversed) != (b.alignment, b.reversed)
        || a.sensors.iter().zip(&b.sensors).any(|(a, b)| {
            let least = WORTH * b.amplitude;
            libm::fabsf(a.offset - b.offset) > least
                || libm::fabsf(a.amplitude - b.amplitude) > least
                || libm::fabsf((a.placement - b.placement).to_degrees()) > WORTH_DEG
                || libm::fabsf(a.third - b.third) > WORTH
        })
}
