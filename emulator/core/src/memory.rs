//! RAM and flash as the core sees them, and the instructions decoded from them.

use crate::decode;
use crate::op::Op;
use bus::System;

/// Where the RAM is. Flash is at `0x0800_0000` and again at 0.
#[derive(Clone, Copy, Debug)]
pub struct Map {
    /// Bytes of RAM from `0x2000_0000` on: SRAM1, SRAM2 and CCM SRAM in one piece (RM0440, 2.2).
    pub ram: u32,
    /// Of these, the last ones are the CCM SRAM, which is at `0x1000_0000` as well.
    pub ccm: u32,
}

impl Map {
    /// STM32G474: 80 + 16 + 32 KiB.
    pub const STM32G474: Map = Map { ram: 128 << 10, ccm: 32 << 10 };
    /// STM32G431: 16 + 6 + 10 KiB.
    pub const STM32G431: Map = Map { ram: 32 << 10, ccm: 10 << 10 };
}

pub const FLASH: u32 = 0x0800_0000;
pub const RAM: u32 = 0x2000_0000;
pub const CCM: u32 = 0x1000_0000;

/// What an uninitialised word of RAM holds: what is still there was never used.
pub const PAINT: u32 = 0xACAC_ACAC;

/// A decoded instruction; `length` 0 where none has been decoded yet.
#[derive(Clone, Copy, Debug)]
pub struct Decoded {
    pub op: Op,
    pub length: u8,
}

const FRESH: Decoded = Decoded { op: Op::Undefined, length: 0 };

/// Stores mark code as changed by blocks of 64 bytes.
const BLOCK: u32 = 6;

#[derive(Clone)]
pub struct Memory {
    pub map: Map,
    pub ram: Vec<u8>,
    flash_code: Vec<Decoded>,
    ram_code: Vec<Decoded>,
    ram_has_code: Vec<bool>,
}

/// Where an address leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    Flash(u32),
    Ram(u32),
    Private,
    System,
}

impl Memory {
    pub fn new(map: Map, flash: usize) -> Self {
        Memory {
            map,
            ram: PAINT.to_le_bytes().repeat(map.ram as usize / 4),
            flash_code: vec![FRESH; flash / 2],
            ram_code: vec![FRESH; map.ram as usize / 2],
            ram_has_code: vec![false; (map.ram >> BLOCK) as usize],
        }
    }

    /// The place of a whole access of `bytes`.
    #[inline]
    pub fn place(&self, address: u32, bytes: u32) -> Place {
        let within = |base: u32, size: u32| {
            let offset = address.wrapping_sub(base);
            (offset < size && size - offset >= bytes).then_some(offset)
        };
        let flash = self.flash_code.len() as u32 * 2;
        if let Some(offset) = within(RAM, self.map.ram) {
            Place::Ram(offset)
        } else if let Some(offset) = within(FLASH, flash).or_else(|| within(0, flash)) {
            Place::Flash(offset)
        } else if let Some(offset) = within(CCM, self.map.ccm) {
            Place::Ram(self.map.ram - self.map.ccm + offset)
        } else if (0xE000_0000..0xE004_0000).contains(&address) || address >> 12 == 0xE00FF {
            Place::Private
        } else {
            Place::System
        }
    }

    /// The instruction at `pc`, which is even; `None` where nothing can be fetched.
    #[inline(always)]
    pub fn fetch<S: System>(&mut self, pc: u32, system: &S) -> Option<Decoded> {
        let offset = pc.wrapping_sub(FLASH) as usize / 2;
        if let Some(decoded) = self.flash_code.get(offset)
            && decoded.length != 0
            && pc >= FLASH
        {
            return Some(*decoded);
        }
        self.fetch_slow(pc, system)
    }

    #[inline(never)]
    fn fetch_slow<S: System>(&mut self, pc: u32, system: &S) -> Option<Decoded> {
        let (bytes, code, offset) = match self.place(pc, 2) {
            Place::Flash(offset) => (system.flash(), &mut self.flash_code, offset as usize),
            Place::Ram(offset) => {
                for block in offset >> BLOCK..=(offset + 3).min(self.map.ram - 1) >> BLOCK {
                    self.ram_has_code[block as usize] = true;
                }
                (&self.ram[..], &mut self.ram_code, offset as usize)
            }
            _ => return None,
        };
        let decoded = &mut code[offset / 2];
        if decoded.length == 0 {
            let half = |at: usize| Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?));
            let first = half(offset)?;
            let (op, length) = if decode::is_wide(first) {
                (decode::wide(first, half(offset + 2)?), 4)
            } else {
                (decode::narrow(first), 2)
            };
            *decoded = Decoded { op, length };
        }
        Some(*decoded)
    }

    /// A store has changed RAM: what was decoded there does not hold any more.
    #[inline(always)]
    pub fn stored(&mut self, offset: u32, bytes: u32) {
        if self.ram_has_code[(offset >> BLOCK) as usize] {
            self.forget_ram(offset, bytes);
        }
    }

    #[cold]
    fn forget_ram(&mut self, offset: u32, bytes: u32) {
        // A wide instruction may begin two bytes before.
        let (first, last) = ((offset.max(2) - 2) / 2, (offset + bytes).div_ceil(2));
        let last = last.min(self.ram_code.len() as u32);
        self.ram_code[first as usize..last as usize].fill(FRESH);
    }

    /// The flash has changed there.
    pub fn forget_flash(&mut self, range: core::ops::Range<u32>) {
        let (first, last) = ((range.start.max(2) - 2) / 2, range.end.div_ceil(2));
        let last = last.min(self.flash_code.len() as u32);
        self.flash_code[first as usize..last as usize].fill(FRESH);
    }
}
