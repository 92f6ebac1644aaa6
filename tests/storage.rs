//! Records in a simulated flash whose power is cut at every operation.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use hallservo::angle::ElectricalAngle;
use hallservo::control::cogging::by_pole::{WAVES, Wave, Waves};
use hallservo::control::cogging::{POINTS, Table};
use hallservo::hall::model::Model;
use hallservo::storage::{self, Error, Store, calibration, cogging};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

const BLOCK: usize = 2048;
const WORD: usize = 8;
const SIZE: usize = storage::size(240);
const LONGEST: usize = Store::<Flash, SIZE>::LONGEST;

#[derive(Debug, PartialEq, Clone, Copy)]
struct Cut;

impl NorFlashError for Cut {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Double words and pages of 2 KiB, as in an STM32G4: an erased bit can be cleared once.
#[derive(Clone)]
struct Flash {
    bytes: Vec<u8>,
    /// Words written and pages erased until the power goes.
    left: Option<u32>,
    operations: u32,
    random: Pcg64,
}

impl Flash {
    fn new(seed: u64) -> Self {
        Self { bytes: vec![0xff; 6 * BLOCK], left: None, operations: 0, random: Pcg64::seed_from_u64(seed) }
    }

    /// Whether the power lasts for one operation more.
    fn powered(&mut self) -> Result<bool, Cut> {
        self.operations += 1;
        match &mut self.left {
            None => Ok(true),
            Some(0) => {
                self.left = Some(0);
                Ok(false)
            }
            Some(left) => {
                *left -= 1;
                Ok(true)
            }
        }
    }
}

impl ErrorType for Flash {
    type Error = Cut;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Cut> {
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = BLOCK;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Cut> {
        assert!((from as usize).is_multiple_of(BLOCK) && to - from == BLOCK as u32);
        let powered = self.powered()?;
        for byte in &mut self.bytes[from as usize..to as usize] {
            // A cut erase leaves any bits that were not yet set.
            *byte |= if powered { 0xff } else { self.random.next_u32() as u8 };
        }
        if powered { Ok(()) } else { Err(Cut) }
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Cut> {
        assert!((offset as usize).is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD));
        for (k, word) in bytes.chunks(WORD).enumerate() {
            let place = offset as usize + k * WORD;
            assert!(self.bytes[place..place + WORD].iter().all(|&byte| byte == 0xff), "written twice");
            let powered = self.powered()?;
            for (cell, byte) in self.bytes[place..place + WORD].iter_mut().zip(word) {
                *cell = if powered { *byte } else { byte | self.random.next_u32() as u8 };
            }
            if !powered {
                return Err(Cut);
            }
        }
        Ok(())
    }
}

fn store(flash: Flash) -> Store<Flash, SIZE> {
    Store::new(flash, 2 * BLOCK as u32, 0, 1).unwrap()
}

fn load(flash: &Flash) -> Result<Vec<u8>, Error<Cut>> {
    let mut record = [0; LONGEST];
    let length = store(flash.clone()).load(&mut record)?;
    Ok(record[..length].to_vec())
}

/// A flash after saving some records.
fn saved(seed: u64, records: &[Vec<u8>]) -> Flash {
    let mut store = store(Flash::new(seed));
    records.iter().for_each(|record| store.save(record).unwrap());
    store.free()
}

#[test]
fn a_cut_at_any_operation_leaves_the_old_record_or_the_new() {
    let (mut kept, mut replaced) = (0, 0);
    for seed in 0..50 {
        let mut random = Pcg64::seed_from_u64(seed);
        let records: Vec<Vec<u8>> =
            (0..5).map(|_| (0..random.random_range(1..LONGEST)).map(|_| random.next_u32() as u8).collect()).collect();
        for before in 0..4 {
            let (old, new) = (&records[..before], &records[before]);
            let whole = saved(seed, old);
            let mut counting = store(whole.clone());
            counting.save(new).unwrap();
            let operations = counting.free().operations - whole.operations;
            for cut in 0..operations {
                let mut flash = Flash { left: Some(cut), ..whole.clone() };
                let mut cut_store = store(flash);
                assert_eq!(cut_store.save(new), Err(Error::Flash(Cut)));
                flash = Flash { left: None, ..cut_store.free() };
                match (load(&flash), old.last()) {
                    (Ok(record), _) if record == *new => replaced += 1,
                    (Ok(record), Some(old)) => {
                        assert_eq!(record, *old);
                        kept += 1;
                    }
                    // A first record that was cut off is no reason to be afraid.
                    (Err(Error::Blank), None) => kept += 1,
                    (other, _) => panic!("seed {seed}, record {before}, cut {cut}: {other:?}"),
                }
                // And the next save works.
                let mut again = store(flash);
                again.save(new).unwrap();
                assert_eq!(load(&again.free()).unwrap(), *new);
            }
        }
    }
    println!("{kept} cuts kept the old record, {replaced} came after the last bit of the new");
    assert!(kept > 1000);
}

/// The three kinds of records that an application keeps: its slot, and a version.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Calibration,
    Cogging,
    Settings,
}

const KINDS: [Kind; 3] = [Kind::Calibration, Kind::Cogging, Kind::Settings];
const SETTINGS: usize = 100;

type Records<'a> = Store<&'a mut Flash, { storage::size(cogging::LENGTH) }>;

impl Kind {
    fn save(self, flash: &mut Flash, record: &[u8]) -> Result<(), Error<Cut>> {
        self.store(flash).save(record)
    }

    fn load(self, flash: &mut Flash) -> Result<Vec<u8>, Error<Cut>> {
        let mut record = [0; cogging::LENGTH];
        let length = self.store(flash).load(&mut record)?;
        Ok(record[..length].to_vec())
    }

    /// All in the same two blocks.
    fn store(self, flash: &mut Flash) -> Records<'_> {
        let version = [calibration::VERSION, cogging::VERSION, 0x0301][self as usize];
        Store::new(flash, 0, self as usize, version).unwrap()
    }

    /// A record as long as they are.
    fn record(self, random: &mut Pcg64) -> Vec<u8> {
        match self {
            Self::Calibration => {
                let mut model = Model::nominal(12, random.random_range(200.0..300.0), ElectricalAngle::THIRD);
                model.sensors[1].third = 0.05;
                calibration::encode(&model).to_vec()
            }
            Self::Cogging => cogging::encode(&table(random), 8.25).to_vec(),
            Self::Settings => (0..random.random_range(1..=SETTINGS)).map(|_| random.next_u32() as u8).collect(),
        }
    }
}

fn table(random: &mut Pcg64) -> Table {
    Table([(); POINTS].map(|()| random.random_range(-3000..3000)))
}

#[test]
fn a_cut_in_one_kind_of_record_touches_no_other() {
    let mut cuts = [0; 3];
    for seed in 0..10 {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut flash = Flash::new(seed);
        let mut last: [Option<Vec<u8>>; 3] = [None, None, None];
        for _ in 0..9 {
            let kind = KINDS[random.random_range(0..3_usize)];
            let new = kind.record(&mut random);
            let mut whole = flash.clone();
            kind.save(&mut whole, &new).unwrap();
            for cut in 0..whole.operations - flash.operations {
                let mut after = Flash { left: Some(cut), ..flash.clone() };
                assert_eq!(kind.save(&mut after, &new), Err(Error::Flash(Cut)));
                after.left = None;
                for other in KINDS {
                    match (other.load(&mut after), &last[other as usize]) {
                        (Ok(record), _) if other == kind && record == new => {}
                        (Ok(record), Some(old)) => assert_eq!(record, *old),
                        (Err(Error::Blank), None) => {}
                        (wrong, _) => panic!("seed {seed}, {kind:?} cut at {cut}: {other:?} is {wrong:?}"),
                    }
                }
                kind.save(&mut after, &new).unwrap();
                assert_eq!(kind.load(&mut after).unwrap(), new);
                cuts[kind as usize] += 1;
            }
            flash = whole;
            last[kind as usize] = Some(new);
        }
    }
    println!("cuts while saving calibration, table, settings: {cuts:?}");
    assert!(cuts.iter().all(|cuts| *cuts > 200));
}

#[test]
fn a_record_of_another_kind_is_not_taken_for_ones_own() {
    let mut flash = Flash::new(4);
    Kind::Calibration.save(&mut flash, &Kind::Calibration.record(&mut Pcg64::seed_from_u64(4))).unwrap();
    let mut misplaced = Records::new(&mut flash, 0, 0, cogging::VERSION).unwrap();
    assert_eq!(misplaced.load(&mut [0; 300]), Err(Error::Version { found: calibration::VERSION }));
}

#[test]
fn a_table_comes_back_as_it_was_in_amperes() {
    let mut flash = Flash::new(5);
    let table = table(&mut Pcg64::seed_from_u64(5));
    Kind::Cogging.save(&mut flash, &cogging::encode(&table, 8.25)).unwrap();
    let record = Kind::Cogging.load(&mut flash).unwrap();
    assert_eq!(cogging::decode(&record, 8.25), Some(table));
    // Amplifiers of twice the range: half the numbers.
    let halved = cogging::decode(&record, 16.5).unwrap();
    assert!(table.0.iter().zip(halved.0).all(|(whole, half)| (whole - 2 * half).abs() <= 1));
    for bad in [0.0, -1.0, f32::NAN, 0.1] {
        assert_eq!(cogging::decode(&record, bad), None, "{bad}");
    }
    assert_eq!(cogging::decode(&record[1..], 8.25), None);
    assert_eq!(cogging::decode(&cogging::encode(&table, f32::NAN), 8.25), None);
}

#[test]
fn what_differs_from_pole_to_pole_is_behind_the_table() {
    let mut random = Pcg64::seed_from_u64(4);
    let table = table(&mut random);
    for count in 0..=WAVES {
        let wave = |_| Wave { order: random.random_range(1..=255), sine: random.random(), cosine: random.random() };
        let waves = Waves::of((0..count).map(wave));
        let mut place = [0; cogging::LONGEST];
        let record = cogging::encode_with(&table, &waves, 8.25, &mut place).to_vec();
        assert_eq!(cogging::decode(&record, 8.25), Some(table));
        assert_eq!(cogging::decode_by_pole(&record, 8.25), Some(waves.clone()));
        let halved = cogging::decode_by_pole(&record, 16.5).unwrap();
        assert!((halved.rms() - waves.rms() / 2.0).abs() < 1.0, "{} {}", halved.rms(), waves.rms());
        assert_eq!(cogging::decode_by_pole(&record, f32::NAN), None);
        for shorter in 0..record.len() {
            let whole = shorter >= cogging::LENGTH && (shorter - cogging::LENGTH).is_multiple_of(5);
            let record = &record[..shorter];
            assert_eq!(cogging::decode(record, 8.25).is_some(), whole, "{shorter}");
            assert_eq!(cogging::decode_by_pole(record, 8.25).is_some(), whole, "{shorter}");
        }
    }
    // A record of before has none.
    assert_eq!(cogging::decode_by_pole(&cogging::encode(&table, 8.25), 8.25), Some(Waves::NONE));
    // As many orders as fit, and one more.
    assert_eq!(cogging::decode(&[0; cogging::LONGEST + 5], 8.25), None);
}

#[test]
fn what_is_not_a_record_is_named() {
    assert_eq!(load(&Flash::new(1)), Err(Error::Blank));
    let flash = saved(1, &[vec![1, 2, 3], vec![4, 5, 6]]);
    // A flipped bit in the newer record brings the older back, in both none.
    let mut one = flash.clone();
    one.bytes[3 * BLOCK + 17] ^= 4;
    assert_eq!(load(&one).unwrap(), [1, 2, 3]);
    one.bytes[2 * BLOCK + 8] ^= 1;
    assert_eq!(load(&one), Err(Error::Corrupt));
    let mut foreign = Flash::new(1);
    foreign.bytes[2 * BLOCK..3 * BLOCK].fill(0x5a);
    assert_eq!(load(&foreign), Err(Error::Corrupt));
    let mut other = Store::<_, SIZE>::new(flash.clone(), 2 * BLOCK as u32, 0, 2).unwrap();
    assert_eq!(other.load(&mut [0; 10]), Err(Error::Version { found: 1 }));
    assert_eq!(store(flash.clone()).load(&mut [0; 2]), Err(Error::TooLong));
    assert_eq!(store(flash.clone()).save(&[0; LONGEST + 1]), Err(Error::TooLong));
    for start in [1, 5 * BLOCK as u32, u32::MAX] {
        assert!(matches!(Store::<_, SIZE>::new(flash.clone(), start, 0, 1), Err(Error::Place)));
    }
}

#[test]
fn every_bit_of_a_record_is_guarded() {
    let flash = saved(2, &[(0..60).collect()]);
    for byte in 0..16 + 60 {
        for bit in 0..8 {
            let mut damaged = flash.clone();
            damaged.bytes[2 * BLOCK + byte] ^= 1 << bit;
            assert_eq!(load(&damaged), Err(Error::Corrupt), "byte {byte} bit {bit}");
        }
    }
}

#[test]
fn a_model_comes_back_as_it_was() {
    let mut model = Model::nominal(12, 250.0, ElectricalAngle::THIRD);
    model.sensors[1].third = 0.05;
    model.sensors[2].fifth = -0.01;
    model.alignment = ElectricalAngle::from_degrees(77.0);
    for reversed in [false, true] {
        model.reversed = reversed;
        let flash = saved(3, &[calibration::encode(&model).to_vec()]);
        assert_eq!(calibration::decode(&load(&flash).unwrap()), Some(model));
    }
    let mut record = calibration::encode(&model);
    record[64] = 2;
    assert_eq!(calibration::decode(&record), None);
    assert_eq!(calibration::decode(&record[1..]), None);
}

#[test]
fn what_is_stored_is_used_at_the_next_power_up() {
    use hallservo::drive::Command;
    use hallservo::mode::Mode;
    use hallservo::settings::Settings;
    use plant::PlantParameters;
    use rig::{Rig, error_deg};
    use sim::statistics::Statistics;

    let motor = PlantParameters::imperfect(5);
    let mut flash = store(Flash::new(5));
    let model = Rig::new(&motor, &Settings::default(), 5).unwrap().calibrate(|_| ()).unwrap().model;
    flash.save(&calibration::encode(&model)).unwrap();

    // The next day, other noise, the rotor elsewhere: no calibration, the drive is ready at once.
    let mut record = [0; LONGEST];
    let length = flash.load(&mut record).unwrap();
    let stored = calibration::decode(&record[..length]).unwrap();
    let mut rig = Rig::new(&motor, &Settings::default(), 6).unwrap();
    rig.service.install(&stored).unwrap();
    for _ in 0..5 {
        rig.step();
    }
    assert_eq!(rig.drive.mode(), Mode::Ready);
    rig.command(Command::Arm).unwrap();
    rig.drive_with(0.2).unwrap();
    let mut errors = Statistics::default();
    for k in 0..rig.periods(0.8) {
        let period = rig.step();
        if k > rig.periods(0.4) {
            errors.push(error_deg(rig.drive.tracker().angle(), period.truth.electrical_angle_rad));
        }
        if k % 40 == 0 {
            rig.serve();
        }
    }
    assert!(errors.rms() < 0.2, "{}", errors.rms());
}
