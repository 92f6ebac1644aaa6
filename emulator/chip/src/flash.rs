//! Embedded flash memory (RM0440, chapters 3 and 4): programming, erasing, and what a power cut leaves behind: double
//! words that their error correction (3.3.4) cannot make good.

use crate::bits::{bit, field, unmodelled, wrong};
use bus::Complaint;
use core::ops::Range;
use std::collections::BTreeSet;

const NAME: &str = "FLASH";
const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
const OPTION_KEYS: [u32; 2] = [0x0819_2a3b, 0x4c5d_6e7f];

/// FLASH_ACR.PRFTEN.
const PRFTEN: u32 = 8;

const PG: u32 = 0;
const PER: u32 = 1;
const MER1: u32 = 2;
const MER2: u32 = 15;
const STRT: u32 = 16;
const EOPIE: u32 = 24;
const ERRIE: u32 = 25;
const OPTLOCK: u32 = 30;
const LOCK: u32 = 31;

const EOP: u32 = 1;
const PROGERR: u32 = 1 << 3;
const PGAERR: u32 = 1 << 5;
const SIZERR: u32 = 1 << 6;
const PGSERR: u32 = 1 << 7;
const ERRORS: u32 = 0xc3fa;
const BSY: u32 = 1 << 16;
/// FLASH_ECCR.ECCD, and the flags of that register.
const ECCD: u32 = 31;
const ECC_FLAGS: u32 = 0xf000_0000;
/// FLASH_OPTR.DBANK on category 3 devices.
const DBANK: u32 = 22;

/// Typical durations of the data sheet (DS12288, table 53), s.
const PROGRAM_S: f64 = 81.69e-6;
const ERASE_S: f64 = 22.02e-3;

/// An operation that the controller carries out.
#[derive(Clone, Debug, PartialEq)]
enum Operation {
    Program { at: u32, data: [u8; 8] },
    Erase(Range<u32>),
}

/// How an operation began: for how long it holds the core, and whether the power goes in its midst.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Begun {
    /// The core, fetching from bank 1, waits for this long, s.
    pub stall_s: f64,
    /// The power goes.
    pub power_cut: bool,
}

/// The controller and the array.
#[derive(Clone, Debug)]
pub struct Flash {
    memory: Vec<u8>,
    changes: Vec<Range<u32>>,
    /// Double words that a power cut has left neither as they were nor as they should be.
    torn: BTreeSet<u32>,
    /// Two banks where DBANK is set; category 2 devices have one.
    category_3: bool,
    acr: u32,
    cr: u32,
    sr: u32,
    eccr: u32,
    optr: u32,
    keys: usize,
    option_keys: usize,
    /// Sealed by a wrong key until reset (3.3.5).
    sealed: bool,
    /// First half of a double word.
    latched: Option<(u32, u32)>,
    busy: Option<(f64, Operation)>,
    /// Programmed double words and erased pages so far.
    pub operations: u64,
    cut_after: Option<u64>,
    garbage: u64,
}

impl Flash {
    /// An array as erased.
    pub fn new(bytes: usize, category_3: bool, dual_bank: bool) -> Self {
        let optr = if category_3 { 0xffef_f8aa & !(u32::from(!dual_bank) << DBANK) } else { 0xffef_f8aa };
        Self {
            memory: vec![0xff; bytes],
            changes: Vec::new(),
            torn: BTreeSet::new(),
            category_3,
            acr: 0x0004_0600,
            cr: 0xc000_0000,
            sr: 0,
            eccr: 0,
            optr,
            keys: 0,
            option_keys: 0,
            sealed: false,
            latched: None,
            busy: None,
            operations: 0,
            cut_after: None,
            garbage: 0x9e37_79b9_7f4a_7c15,
        }
    }

    /// Registers as reset leaves them; the array stays, and an operation under way ends undone.
    pub fn reset(&mut self) {
        let fresh = Self::new(0, self.category_3, true);
        let memory = core::mem::take(&mut self.memory);
        let changes = core::mem::take(&mut self.changes);
        let torn = core::mem::take(&mut self.torn);
        let (optr, operations, cut_after, garbage) = (self.optr, self.operations, self.cut_after, self.garbage);
        *self = Self { memory, changes, torn, optr, operations, cut_after, garbage, ..fresh };
    }

    /// The array.
    pub fn memory(&self) -> &[u8] {
        &self.memory
    }

    /// Puts an image into the array, as a programmer would.
    pub fn load(&mut self, offset: usize, bytes: &[u8]) {
        self.memory[offset..offset + bytes.len()].copy_from_slice(bytes);
        self.changes.push(offset as u32..(offset + bytes.len()) as u32);
    }

    /// What changed since the last call.
    pub fn take_changes(&mut self) -> Vec<Range<u32>> {
        core::mem::take(&mut self.changes)
    }

    /// The power goes in the middle of the operation that follows this many more.
    pub fn cut_power_after(&mut self, operations: u64) {
        self.cut_after = Some(operations);
    }

    /// FLASH_ACR.LATENCY.
    pub fn wait_states(&self) -> u32 {
        self.acr & 0xf
    }

    /// FLASH_ACR.PRFTEN.
    pub fn prefetch(&self) -> bool {
        bit(self.acr, PRFTEN)
    }

    /// Whether the interrupt line is up.
    pub fn interrupt(&self) -> bool {
        bit(self.cr, EOPIE) && self.sr & EOP != 0 || bit(self.cr, ERRIE) && self.sr & ERRORS != 0
    }

    /// When the operation under way ends, s.
    pub fn ends_s(&self) -> Option<f64> {
        self.busy.as_ref().map(|(end, _)| *end)
    }

    /// Ends what is over.
    pub fn advance(&mut self, now_s: f64) {
        if self.busy.as_ref().is_some_and(|(end, _)| *end <= now_s)
            && let Some((_, operation)) = self.busy.take()
        {
            match operation {
                Operation::Program { at, data } => self.put(at, &data),
                Operation::Erase(range) => self.put(range.start, &vec![0xff; range.len()]),
            }
            self.sr &= !BSY;
            if bit(self.cr, EOPIE) {
                self.sr |= EOP;
            }
        }
    }

    /// Data are read; whether they cannot be corrected, which FLASH_ECCR tells from then on.
    pub fn reads_torn(&mut self, offset: u32) -> bool {
        let at = offset & !7;
        if self.torn.is_empty() || !self.torn.contains(&at) {
            return false;
        }
        let bank = u32::from(self.dual_bank() && at >= self.bank_bytes());
        self.eccr = self.eccr & !0x003f_ffff | 1 << ECCD | bank << 21 | (at - bank * self.bank_bytes());
        true
    }

    fn put(&mut self, at: u32, bytes: &[u8]) {
        let end = at + bytes.len() as u32;
        self.torn.retain(|torn| !(at..end).contains(torn));
        self.memory[at as usize..at as usize + bytes.len()].copy_from_slice(bytes);
        self.changes.push(at..at + bytes.len() as u32);
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => self.acr,
            0x04..=0x0c => 0,
            0x10 => self.sr,
            0x14 => self.cr,
            0x18 => self.eccr,
            0x20 => self.optr,
            _ => return Err(unmodelled(NAME, offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now_s: f64) -> Result<Begun, Complaint> {
        match offset {
            0x00 => self.acr = value & 0x0004_7f0f,
            0x08 => {
                if !key(&mut self.keys, KEYS, value) || self.sealed || !bit(self.cr, LOCK) {
                    self.sealed = true;
                    return Err(wrong(NAME, "KEYR: a wrong key; the controller stays locked until reset (3.3.5)"));
                }
                if self.keys == 2 {
                    self.keys = 0;
                    self.cr &= !(1 << LOCK);
                }
            }
            0x0c => {
                if !key(&mut self.option_keys, OPTION_KEYS, value) || bit(self.cr, LOCK) {
                    return Err(wrong(NAME, "OPTKEYR: a wrong key (3.4.2)"));
                }
                if self.option_keys == 2 {
                    self.option_keys = 0;
                    self.cr &= !(1 << OPTLOCK);
                }
            }
            0x10 => self.sr &= !(value & (ERRORS | EOP)),
            0x14 => return self.write_cr(value, now_s),
            0x18 => {
                let left = self.eccr & ECC_FLAGS & !value;
                self.eccr = self.eccr & 0x003f_ffff | value & 1 << 24 | left;
            }
            _ => return Err(unmodelled(NAME, offset)),
        }
        Ok(Begun::default())
    }

    fn write_cr(&mut self, value: u32, now_s: f64) -> Result<Begun, Complaint> {
        if bit(self.cr, LOCK) {
            if (value ^ self.cr) & !(1 << LOCK) != 0 {
                return Err(wrong(NAME, "CR is written while it is locked (3.7.6)"));
            }
            return Ok(Begun::default());
        }
        if self.sr & BSY != 0 {
            return Err(wrong(NAME, "CR is written while an operation is under way (3.3.6)"));
        }
        if value & (1 << 17 | 1 << 18 | 1 << 27) != 0 {
            return Err(wrong(NAME, "CR: option programming and fast programming are not modelled"));
        }
        let optlock = if bit(value, OPTLOCK) { 1 << OPTLOCK } else { self.cr & 1 << OPTLOCK };
        self.cr = value & !(1 << STRT | 1 << OPTLOCK) | optlock;
        if !bit(value, STRT) {
            return Ok(Begun::default());
        }
        if self.sr & ERRORS != 0 {
            self.sr |= PGSERR;
            return Err(wrong(NAME, "an operation is started while error flags are set: PGSERR"));
        }
        match self.to_erase() {
            Some(range) => Ok(self.begin(Operation::Erase(range), ERASE_S, now_s)),
            None => {
                self.sr |= PGSERR;
                Err(wrong(NAME, "STRT without PER, or a page that is not there: PGSERR"))
            }
        }
    }

    fn dual_bank(&self) -> bool {
        self.category_3 && bit(self.optr, DBANK)
    }

    fn bank_bytes(&self) -> u32 {
        self.memory.len() as u32 / if self.dual_bank() { 2 } else { 1 }
    }

    /// The page of PNB and BKER, or a whole bank.
    fn to_erase(&self) -> Option<Range<u32>> {
        let bank = self.bank_bytes();
        if bit(self.cr, MER1) || bit(self.cr, MER2) {
            return Some(if bit(self.cr, MER1) { 0..bank } else { bank..2 * bank });
        }
        let page = if self.category_3 && !self.dual_bank() { 4096 } else { 2048 };
        let base = if self.dual_bank() && bit(self.cr, 11) { bank } else { 0 };
        let start = base + field(self.cr, 3, 7) * page;
        (bit(self.cr, PER) && start + page <= base + bank).then_some(start..start + page)
    }

    /// A store to the array: half of a double word (3.3.7).
    pub fn store(&mut self, at: u32, bytes: u32, value: u32, now_s: f64) -> Result<Begun, Complaint> {
        let refused = if self.sr & BSY != 0 || !bit(self.cr, PG) || bit(self.cr, LOCK) || self.sr & ERRORS != 0 {
            PGSERR
        } else if bytes != 4 {
            SIZERR
        } else if self.latched.map_or(!at.is_multiple_of(8), |(first, _)| at != first + 4) {
            PGAERR
        } else {
            0
        };
        if refused != 0 {
            self.latched = None;
            self.sr |= refused;
            return Err(wrong(NAME, format!("a store to the array is refused: {}", error_name(refused))));
        }
        let Some((first, low)) = self.latched.take() else {
            self.latched = Some((at, value));
            return Ok(Begun::default());
        };
        let data = (u64::from(low) | u64::from(value) << 32).to_le_bytes();
        let old = &self.memory[first as usize..first as usize + 8];
        if data != [0; 8] && old.iter().any(|byte| *byte != 0xff) {
            self.sr |= PROGERR;
            return Err(wrong(NAME, "a double word is programmed that is not erased: PROGERR"));
        }
        Ok(self.begin(Operation::Program { at: first, data }, PROGRAM_S, now_s))
    }

    fn begin(&mut self, operation: Operation, takes_s: f64, now_s: f64) -> Begun {
        self.operations += 1;
        let place = match &operation {
            Operation::Program { at, .. } => *at,
            Operation::Erase(range) => range.start,
        };
        if let Some(left) = self.cut_after.take() {
            if left == 0 {
                self.tear(&operation);
                return Begun { stall_s: 0.0, power_cut: true };
            }
            self.cut_after = Some(left - 1);
        }
        self.sr |= BSY;
        self.busy = Some((now_s + takes_s, operation));
        // Bank 1 can be read while bank 2 is written (3.3.8).
        let stall_s = if self.dual_bank() && place >= self.bank_bytes() { 0.0 } else { takes_s };
        Begun { stall_s, power_cut: false }
    }

    /// Half done: some cells have changed, some not.
    fn tear(&mut self, operation: &Operation) {
        match operation {
            Operation::Program { at, data } => {
                let torn = data.map(|byte| byte | self.random() as u8);
                self.put(*at, &torn);
                if torn != *data && torn != [0xff; 8] {
                    self.torn.insert(*at);
                }
            }
            Operation::Erase(range) => {
                let mut torn = self.memory[range.start as usize..range.end as usize].to_vec();
                for byte in &mut torn {
                    *byte |= self.random() as u8;
                }
                let old = self.memory[range.start as usize..range.end as usize].to_vec();
                self.put(range.start, &torn);
                let words = range.clone().step_by(8).zip(torn.chunks(8).zip(old.chunks(8)));
                self.torn.extend(words.filter(|(_, (new, old))| new != old).map(|(at, _)| at));
            }
        }
    }

    fn random(&mut self) -> u64 {
        self.garbage ^= self.garbage << 13;
        self.garbage ^= self.garbage >> 7;
        self.garbage ^= self.garbage << 17;
        self.garbage >> 24
    }
}

/// Counts the keys of an unlocking sequence; `false` for a wrong one.
fn key(given: &mut usize, keys: [u32; 2], value: u32) -> bool {
    let right = keys.get(*given) == Some(&value);
    *given = if right { *given + 1 } else { 0 };
    right
}

fn error_name(flag: u32) -> &'static str {
    match flag {
        PGSERR => "PGSERR, not unlocked, not in programming mode, busy, or errors not cleared",
        SIZERR => "SIZERR, not a word",
        _ => "PGAERR, not a double word in order",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CR: u32 = 0x14;
    const SR: u32 = 0x10;
    const ECCR: u32 = 0x18;

    fn unlocked() -> Flash {
        let mut flash = Flash::new(128 << 10, false, false);
        for key in KEYS {
            flash.write(0x08, key, 0.0).unwrap();
        }
        flash
    }

    fn program(flash: &mut Flash, at: u32, data: u64, now_s: f64) -> Result<Begun, Complaint> {
        flash.store(at, 4, data as u32, now_s)?;
        flash.store(at + 4, 4, (data >> 32) as u32, now_s)
    }

    #[test]
    fn a_double_word_takes_its_time_and_holds_the_core() {
        let mut flash = unlocked();
        flash.write(CR, 1, 0.0).unwrap();
        let begun = program(&mut flash, 0x1_f800, 0x1122_3344_5566_7788, 1.0).unwrap();
        assert_eq!(begun.stall_s, PROGRAM_S);
        flash.advance(1.0 + 81e-6);
        assert_ne!(flash.read(SR).unwrap() & BSY, 0);
        flash.advance(1.0 + 82e-6);
        assert_eq!(flash.read(SR).unwrap(), 0);
        assert_eq!(flash.memory()[0x1_f800], 0x88);
        assert_eq!(flash.take_changes().first(), Some(&(0x1_f800..0x1_f808)));
    }

    #[test]
    fn errors_are_those_of_the_manual() {
        let mut flash = unlocked();
        assert!(program(&mut flash, 0, 0, 0.0).is_err(), "PG is not set");
        assert_eq!(flash.read(SR).unwrap(), PGSERR);
        flash.write(SR, PGSERR, 0.0).unwrap();
        flash.write(CR, 1, 0.0).unwrap();
        assert!(flash.store(0, 2, 0, 0.0).is_err());
        assert_eq!(flash.read(SR).unwrap(), SIZERR);
        flash.write(SR, SIZERR, 0.0).unwrap();
        assert!(flash.store(4, 4, 0, 0.0).is_err());
        assert_eq!(flash.read(SR).unwrap(), PGAERR);
        flash.write(SR, PGAERR, 0.0).unwrap();
        program(&mut flash, 8, 5, 0.0).unwrap();
        flash.advance(1.0);
        assert!(program(&mut flash, 8, 4, 1.0).is_err(), "not erased");
        assert_eq!(flash.read(SR).unwrap(), PROGERR);
        flash.write(SR, PROGERR, 1.0).unwrap();
        assert!(program(&mut flash, 8, 0, 1.0).is_ok(), "zeros are always allowed");
    }

    #[test]
    fn a_wrong_key_seals_until_reset() {
        let mut flash = Flash::new(2048, false, false);
        assert!(flash.write(0x08, 1, 0.0).is_err());
        for key in KEYS {
            assert!(flash.write(0x08, key, 0.0).is_err());
        }
        assert!(bit(flash.read(CR).unwrap(), LOCK));
        flash.reset();
        for key in KEYS {
            flash.write(0x08, key, 0.0).unwrap();
        }
        assert!(!bit(flash.read(CR).unwrap(), LOCK));
    }

    #[test]
    fn pages_lie_as_dbank_says() {
        for (dual, expected) in [(true, 0x4_0000 + 5 * 2048..0x4_0000 + 6 * 2048), (false, 5 * 4096..6 * 4096)] {
            let mut flash = Flash::new(512 << 10, true, dual);
            for key in KEYS {
                flash.write(0x08, key, 0.0).unwrap();
            }
            flash.load(0, &vec![0; 512 << 10]);
            flash.take_changes();
            let begun = flash.write(CR, 1 << PER | 5 << 3 | 1 << 11 | 1 << STRT, 0.0).unwrap();
            assert_eq!(begun.stall_s > 0.0, !dual, "bank 2 does not hold a core that runs from bank 1");
            flash.advance(0.03);
            assert_eq!(flash.take_changes(), std::slice::from_ref(&expected));
            let erased = flash.memory().iter().filter(|byte| **byte == 0xff).count();
            assert_eq!(erased, expected.len());
        }
    }

    #[test]
    fn a_power_cut_leaves_the_operation_half_done() {
        let mut flash = unlocked();
        flash.write(CR, 1, 0.0).unwrap();
        flash.cut_power_after(1);
        assert!(!program(&mut flash, 0, 0, 0.0).unwrap().power_cut);
        flash.advance(1.0);
        assert!(program(&mut flash, 8, 0, 1.0).unwrap().power_cut);
        let torn = &flash.memory()[8..16];
        assert!(torn != [0; 8] && torn != [0xff; 8], "{torn:x?}");
        flash.reset();
        assert_eq!(flash.read(SR).unwrap(), 0);
        // Its error correction notices when it is read, until the page is erased.
        assert!(!flash.reads_torn(4) && flash.read(ECCR).unwrap() == 0);
        assert!(flash.reads_torn(12) && flash.read(ECCR).unwrap() == 1 << ECCD | 8);
        flash.write(ECCR, 1 << ECCD, 1.0).unwrap();
        assert_eq!(flash.read(ECCR).unwrap(), 8);
        for key in KEYS {
            flash.write(0x08, key, 1.0).unwrap();
        }
        flash.write(CR, 1 << PER | 1 << STRT, 1.0).unwrap();
        flash.advance(2.0);
        assert!(!flash.reads_torn(12));
    }
}
