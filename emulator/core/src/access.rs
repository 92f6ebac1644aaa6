//! Loads and stores, wherever they go.

use crate::fault::Fault;
use crate::machine::Machine;
use crate::memory::Place;
use bus::{Bus, Complaint, Width};

const fn width(bytes: usize) -> Width {
    match bytes {
        1 => Width::Byte,
        2 => Width::Half,
        _ => Width::Word,
    }
}

fn little<const N: usize>(bytes: &[u8], offset: u32) -> u32 {
    let mut word = [0; 4];
    word[..N].copy_from_slice(&bytes[offset as usize..offset as usize + N]);
    u32::from_le_bytes(word)
}

impl<S: Bus> Machine<S> {
    /// Reads `N` bytes, 1, 2 or 4, zero-extended.
    #[inline(always)]
    pub(crate) fn load<const N: usize>(&mut self, address: u32) -> Result<u32, Fault> {
        let offset = address.wrapping_sub(self.memory.integration.ram);
        if (offset as usize) < self.memory.ram.len() - 3 {
            return Ok(little::<N>(&self.memory.ram, offset));
        }
        self.load_elsewhere::<N>(address)
    }

    #[inline(never)]
    fn load_elsewhere<const N: usize>(&mut self, address: u32) -> Result<u32, Fault> {
        match self.memory.place(address, N as u32) {
            Place::Ram(offset) => Ok(little::<N>(&self.memory.ram, offset)),
            Place::Code(offset) => {
                self.now += self.code_data(offset);
                if self.system.code_is_torn(offset) {
                    self.pend_nmi();
                }
                Ok(little::<N>(self.system.code(), offset))
            }
            _ if !address.is_multiple_of(N as u32) => Err(Fault::Unaligned),
            Place::Private => self.read_private(address, width(N)),
            Place::Bus => {
                let (value, complaint) = self.system.read(address, width(N), self.now);
                self.touched(address, false, complaint)?;
                Ok(value)
            }
        }
    }

    /// Writes the lower `N` bytes.
    #[inline(always)]
    pub(crate) fn store<const N: usize>(&mut self, address: u32, value: u32) -> Result<(), Fault> {
        let offset = address.wrapping_sub(self.memory.integration.ram);
        if (offset as usize) < self.memory.ram.len() - 3 {
            self.store_ram::<N>(offset, value);
            return Ok(());
        }
        self.store_elsewhere::<N>(address, value)
    }

    #[inline(always)]
    fn store_ram<const N: usize>(&mut self, offset: u32, value: u32) {
        let at = offset as usize;
        self.memory.ram[at..at + N].copy_from_slice(&value.to_le_bytes()[..N]);
        self.memory.stored(offset, N as u32);
    }

    #[inline(never)]
    fn store_elsewhere<const N: usize>(&mut self, address: u32, value: u32) -> Result<(), Fault> {
        match self.memory.place(address, N as u32) {
            Place::Ram(offset) => {
                self.store_ram::<N>(offset, value);
                Ok(())
            }
            _ if !address.is_multiple_of(N as u32) => Err(Fault::Unaligned),
            Place::Private => self.write_private(address, width(N), value),
            // A store to code memory programs it, which is the chip's business.
            Place::Code(_) | Place::Bus => {
                let complaint = self.system.write(address, width(N), value, self.now);
                self.touched(address, true, complaint)
            }
        }
    }

    /// After an access to the system: interrupt lines may have changed, time may have passed, and what was wrong is
    /// listed.
    fn touched(&mut self, address: u32, write: bool, complaint: Option<Complaint>) -> Result<(), Fault> {
        self.due = 0;
        let Some(complaint) = complaint else { return Ok(()) };
        let unmapped = complaint == Complaint::Unmapped;
        self.complain(complaint, address, write);
        if unmapped { Err(Fault::Data(address)) } else { Ok(()) }
    }
}
