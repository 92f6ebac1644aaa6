//! What survives a power cut: three kinds of records in the flash.

use embedded_storage::nor_flash::NorFlash;
use hallservo::control::cogging::Table;
#[cfg(feature = "map")]
use hallservo::control::cogging::by_pole::Waves;
use hallservo::hall::estimate;
use hallservo::hall::model::Model;
use hallservo::settings::Settings;
#[cfg(feature = "map")]
use hallservo::storage::map::{self, Known};
use hallservo::storage::{Error, Store, calibration, cogging, settings, size, vernier};
use hallservo_protocol::{Problem, Record};

/// Erasable blocks of the flash: two, of at least 2 KiB, for all kinds.
pub const BLOCKS: u32 = 2;
/// Erasable blocks of its own behind these, for what is known of an encoder.
pub const ENCODER_BLOCKS: u32 = 2;
/// The same behind these, for the map of the magnets.
pub const MAP_BLOCKS: u32 = 2;
/// Most bytes of what is known of an encoder.
pub(crate) const ENCODER: usize = 496;
/// Version of its form.
const ENCODER_VERSION: u16 = vernier::VERSION;
const _: () = assert!(vernier::LONGEST <= ENCODER);
/// Least difference between what is learnt and what is stored for it to be worth a save: 1 % of an amplitude in offset
/// or amplitude, 1 % of third harmonic. It is above what noise moves the parameters by, and below what is felt.
pub const LEAST_CHANGE: f32 = 0.01;
/// The same for the placement, electrical degrees.
pub const LEAST_CHANGE_DEG: f32 = 0.5;
/// Least time between two saves of what is learnt. At this rate the 10 000 erases of a block of an STM32G4, two blocks
/// in turn, last for 138 days of constant learning, and saving ends where nothing differs any more.
pub const SAVE_INTERVAL_S: u64 = 600;

/// Versions of the records' forms.
const VERSIONS: [u16; 3] = [0x0102, 0x0202, settings::VERSION];
/// Bytes of the sensors' record: their model, the calibration that it was learnt from, and the noise of each in ADC
/// codes.
const SENSORS: usize = 2 * calibration::LENGTH + 12;
/// Most bytes of a record: that of the table, or all settings.
const LONGEST: usize = if settings::LONGEST > cogging::LONGEST { settings::LONGEST } else { cogging::LONGEST };

/// All kinds fit a block.
const _: () = assert!(VERSIONS.len() * size(LONGEST) <= 2048);

type Buffer = [u8; size(LONGEST)];

/// What is known of the sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sensors {
    /// As calibrated and learnt since.
    pub model: Model,
    /// As calibrated: what is learnt stays near.
    pub calibrated: Model,
    /// Standard deviations in ADC codes.
    pub noise: [f32; 3],
}

impl Sensors {
    /// Whether they differ by so much that it is worth a save.
    pub fn differ(&self, stored: &Self) -> bool {
        let (a, b) = (&self.model, &stored.model);
        (a.alignment, a.reversed) != (b.alignment, b.reversed)
            || a.sensors.iter().zip(&b.sensors).any(|(a, b)| {
                let least = LEAST_CHANGE * b.amplitude;
                libm::fabsf(a.offset - b.offset) > least
                    || libm::fabsf(a.amplitude - b.amplitude) > least
                    || libm::fabsf((a.placement - b.placement).to_degrees()) > LEAST_CHANGE_DEG
                    || libm::fabsf(a.third - b.third) > LEAST_CHANGE
            })
    }

    /// Counts the way that the settings say.
    pub const fn direct(&mut self, reversed: bool) {
        (self.model.reversed, self.calibrated.reversed) = (reversed, reversed);
    }

    fn encode(&self) -> [u8; SENSORS] {
        let mut record = [0; SENSORS];
        let (models, noise) = record.split_at_mut(2 * calibration::LENGTH);
        for (place, model) in models.chunks_exact_mut(calibration::LENGTH).zip([&self.model, &self.calibrated]) {
            place.copy_from_slice(&calibration::encode(model));
        }
        for (place, noise) in noise.chunks_exact_mut(4).zip(self.noise) {
            place.copy_from_slice(&noise.to_le_bytes());
        }
        record
    }

    fn decode(record: &[u8]) -> Option<Self> {
        let (model, rest) = record.split_at_checked(calibration::LENGTH)?;
        let (calibrated, noise) = rest.split_at_checked(calibration::LENGTH)?;
        let (&[a, b, c], []) = noise.as_chunks() else { return None };
        let noise = [f32::from_le_bytes(a), f32::from_le_bytes(b), f32::from_le_bytes(c)];
        Some(Self { model: calibration::decode(model)?, calibrated: calibration::decode(calibrated)?, noise })
    }
}

#[inline(always)]
const fn problem<E>(error: &Error<E>) -> Problem {
    match error {
        Error::Blank => Problem::Blank,
        Error::Version { found } => Problem::Version(*found),
        Error::Corrupt | Error::TooLong | Error::NotKept => Problem::Corrupt,
        Error::Place | Error::Flash(_) => Problem::Flash,
    }
}

/// From the direction of the settings to that of the phases, or back.
fn directed(table: Table, settings: &Settings) -> Table {
    if settings.reversed { table.reversed() } else { table }
}

/// The flash with its blocks.
pub(crate) struct Storage<F> {
    flash: F,
    first_block: u32,
}

impl<F: NorFlash> Storage<F> {
    pub const fn new(flash: F, first_block: u32) -> Self {
        Self { flash, first_block }
    }

    fn store(&mut self, kind: Record) -> Result<Store<&mut F, { size(LONGEST) }>, Problem> {
        let slot = kind as usize;
        Store::new(&mut self.flash, self.first_block, slot, VERSIONS[slot]).map_err(|_| Problem::Flash)
    }

    fn load<'a>(&mut self, kind: Record, buffer: &'a mut Buffer) -> Result<&'a [u8], Problem> {
        self.store(kind)?.load_into(buffer).map_err(|error| problem(&error))
    }

    /// Saves a record; it stalls the core for as long as an erase takes.
    fn save(&mut self, kind: Record, record: &[u8]) -> Result<(), Problem> {
        self.store(kind)?.save(record).map_err(|_| Problem::Flash)
    }

    fn encoder(&mut self) -> Result<Store<&mut F, { size(ENCODER) }>, Problem> {
        let start = self.first_block + BLOCKS * F::ERASE_SIZE as u32;
        Store::new(&mut self.flash, start, 0, ENCODER_VERSION).map_err(|_| Problem::Flash)
    }

    /// What the flash holds of the encoder.
    pub fn load_encoder<'a>(&mut self, place: &'a mut [u8; ENCODER]) -> Result<&'a [u8], Problem> {
        let length = self.encoder()?.load(place).map_err(|error| problem(&error))?;
        place.get(..length).ok_or(Problem::Corrupt)
    }

    /// Saves what is known of the encoder.
    pub fn save_encoder(&mut self, record: &[u8]) -> Result<(), Problem> {
        self.encoder()?.save(record).map_err(|_| Problem::Flash)
    }

    #[cfg(feature = "map")]
    fn maps(&mut self) -> Result<Store<&mut F, { size(map::LONGEST) }>, Problem> {
        let start = self.first_block + (BLOCKS + ENCODER_BLOCKS) * F::ERASE_SIZE as u32;
        Store::new(&mut self.flash, start, 0, map::VERSION).map_err(|_| Problem::Flash)
    }

    /// The stored map of the magnets.
    #[cfg(feature = "map")]
    pub fn map(&mut self) -> Result<Known, Problem> {
        let mut place = [0; map::LONGEST];
        let length = self.maps()?.load(&mut place).map_err(|error| problem(&error))?;
        match place.get(..length) {
            Some([]) => Err(Problem::Blank),
            record => record.and_then(map::decode).ok_or(Problem::Corrupt),
        }
    }

    /// Saves the map; `None` gives up the one stored, by a record of nothing.
    #[cfg(feature = "map")]
    pub fn save_map(&mut self, known: Option<&Known>) -> Result<(), Problem> {
        let mut place = [0; map::LONGEST];
        let record = known.map_or(&[][..], |known| map::encode(known, &mut place));
        self.maps()?.save(record).map_err(|_| Problem::Flash)
    }

    /// The stored sensors, if they can give an angle, or what is wrong with them.
    #[inline(never)]
    pub fn sensors(&mut self, settings: &Settings) -> Result<Sensors, Problem> {
        let mut buffer = [0; size(LONGEST)];
        let record = self.load(Record::Sensors, &mut buffer)?;
        // As a firmware of before left it where a calibration had been broken off.
        if record.is_empty() {
            return Err(Problem::Blank);
        }
        let mut sensors = Sensors::decode(record).ok_or(Problem::Corrupt)?;
        for model in [&sensors.model, &sensors.calibrated] {
            estimate::validate(model, settings.adc_bits).map_err(|_| Problem::Corrupt)?;
        }
        // The settings may have been saved since.
        sensors.direct(settings.reversed);
        Ok(sensors)
    }

    pub fn save_sensors(&mut self, sensors: &Sensors) -> Result<(), Problem> {
        self.save(Record::Sensors, &sensors.encode())
    }

    /// The stored table of the cogging, for the direction of the settings.
    #[inline(never)]
    pub fn table(&mut self, settings: &Settings) -> Result<Table, Problem> {
        let mut buffer = [0; size(LONGEST)];
        let record = self.load(Record::Cogging, &mut buffer)?;
        let table = cogging::decode(record, settings.full_scale_a()).ok_or(Problem::Corrupt)?;
        Ok(directed(table, settings))
    }

    /// What the flash holds of the cogging that differs from pole to pole, for the direction of the settings.
    #[cfg(feature = "map")]
    pub fn by_pole(&mut self, settings: &Settings) -> Waves {
        let mut buffer = [0; size(LONGEST)];
        let record = self.load(Record::Cogging, &mut buffer).unwrap_or_default();
        let waves = cogging::decode_by_pole(record, settings.full_scale_a()).unwrap_or_default();
        if settings.reversed { waves.reversed() } else { waves }
    }

    /// Stored is the one that counts as the phases do, for the settings may be saved later, or not at all.
    pub fn save_table(
        &mut self,
        table: &Table,
        #[cfg(feature = "map")] by_pole: &Waves,
        settings: &Settings,
    ) -> Result<(), Problem> {
        let (table, full_scale_a) = (directed(*table, settings), settings.full_scale_a());
        #[cfg(feature = "map")]
        {
            let mut place = [0; cogging::LONGEST];
            let by_pole = if settings.reversed { by_pole.reversed() } else { by_pole.clone() };
            self.save(Record::Cogging, cogging::encode_with(&table, &by_pole, full_scale_a, &mut place))
        }
        #[cfg(not(feature = "map"))]
        self.save(Record::Cogging, &cogging::encode(&table, full_scale_a))
    }

    /// The settings to work with, to their place, and what is wrong with those stored.
    pub fn settings(&mut self, defaults: &Settings, place: &mut Settings) -> Problem {
        *place = *defaults;
        match self.apply(defaults, place) {
            Ok(known) if settings::settle(defaults, place) && known => Problem::None,
            Ok(_) => Problem::Foreign,
            Err(problem) => problem,
        }
    }

    // The record has left the stack before the settings are looked at together.
    #[inline(never)]
    fn apply(&mut self, defaults: &Settings, place: &mut Settings) -> Result<bool, Problem> {
        let mut buffer = [0; size(LONGEST)];
        let record = self.load(Record::Settings, &mut buffer)?;
        Ok(settings::apply(defaults, record, place))
    }

    pub fn save_settings(&mut self, settings: &Settings, defaults: &Settings) -> Result<(), Problem> {
        let mut record = [0; LONGEST];
        let length = settings::encode(settings, defaults, &mut record).ok_or(Problem::Flash)?;
        self.save(Record::Settings, record.get(..length).ok_or(Problem::Flash)?)
    }
}
