//! RAM and code memory as the core sees them, and the instructions decoded from them.

use crate::decode;
use crate::op::Op;
use bus::{Bus, Integration};

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
    pub integration: Integration,
    pub ram: Vec<u8>,
    code: Vec<Decoded>,
    ram_code: Vec<Decoded>,
    ram_has_code: Vec<bool>,
}

/// Where an address leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    Code(u32),
    Ram(u32),
    Private,
    Bus,
}

impl Memory {
    pub fn new(integration: Integration, code_bytes: usize) -> Self {
        let ram_bytes = integration.ram_bytes as usize;
        Memory {
            integration,
            ram: PAINT.to_le_bytes().repeat(ram_bytes / 4),
            code: vec![FRESH; code_bytes / 2],
            ram_code: vec![FRESH; ram_bytes / 2],
            ram_has_code: vec![false; ram_bytes >> BLOCK],
        }
    }

    fn code_bytes(&self) -> u32 {
        self.code.len() as u32 * 2
    }

    /// Whether an instruction comes out of the code memory at its own address.
    #[inline(always)]
    pub fn is_code(&self, pc: u32) -> bool {
        pc.wrapping_sub(self.integration.code) < self.code_bytes()
    }

    /// The place of a whole access of `bytes`.
    #[inline]
    pub fn place(&self, address: u32, bytes: u32) -> Place {
        let within = |base: u32, size: u32| {
            let offset = address.wrapping_sub(base);
            (offset < size && size - offset >= bytes).then_some(offset)
        };
        let Integration { code, code_aliases, ram, ram_bytes, ram_aliases, .. } = self.integration;
        let in_code = |base| within(base, self.code_bytes());
        if let Some(offset) = within(ram, ram_bytes) {
            Place::Ram(offset)
        } else if let Some(offset) = in_code(code).or_else(|| code_aliases.iter().find_map(|&base| in_code(base))) {
            Place::Code(offset)
        } else if let Some(offset) =
            ram_aliases.iter().find_map(|alias| Some(alias.offset + within(alias.address, alias.bytes)?))
        {
            Place::Ram(offset)
        } else if (0xE000_0000..0xE004_0000).contains(&address) || address >> 12 == 0xE00FF {
            Place::Private
        } else {
            Place::Bus
        }
    }

    /// The instruction at `pc`, which is even; `None` where nothing can be fetched.
    #[inline(always)]
    pub fn fetch<S: Bus>(&mut self, pc: u32, system: &S) -> Option<Decoded> {
        let offset = pc.wrapping_sub(self.integration.code) as usize / 2;
        if let Some(decoded) = self.code.get(offset)
            && decoded.length != 0
        {
            return Some(*decoded);
        }
        self.fetch_slow(pc, system)
    }

    #[inline(never)]
    fn fetch_slow<S: Bus>(&mut self, pc: u32, system: &S) -> Option<Decoded> {
        let (bytes, code, offset) = match self.place(pc, 2) {
            Place::Code(offset) => (system.code(), &mut self.code, offset as usize),
            Place::Ram(offset) => {
                for block in offset >> BLOCK..=(offset + 3).min(self.integration.ram_bytes - 1) >> BLOCK {
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

    /// The code memory has changed there.
    pub fn forget_code(&mut self, range: core::ops::Range<u32>) {
        let (first, last) = ((range.start.max(2) - 2) / 2, range.end.div_ceil(2));
        let last = last.min(self.code.len() as u32);
        self.code[first as usize..last as usize].fill(FRESH);
    }
}
