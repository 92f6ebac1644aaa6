//! Load and store instructions.

use crate::fault::Fault;
use crate::machine::Machine;
use crate::op::{Cell, Index};
use bus::Bus;

impl<S: Bus> Machine<S> {
    #[inline(always)]
    pub(crate) fn load_cell(&mut self, cell: Cell, address: u32) -> Result<u32, Fault> {
        Ok(match cell {
            Cell::Word => self.load::<4>(address)?,
            Cell::Half => self.load::<2>(address)?,
            Cell::Byte => self.load::<1>(address)?,
            Cell::SignedHalf => i32::from(self.load::<2>(address)? as i16) as u32,
            Cell::SignedByte => i32::from(self.load::<1>(address)? as i8) as u32,
        })
    }

    #[inline(always)]
    pub(crate) fn store_cell(&mut self, cell: Cell, address: u32, value: u32) -> Result<(), Fault> {
        match cell {
            Cell::Word => self.store::<4>(address, value),
            Cell::Half | Cell::SignedHalf => self.store::<2>(address, value),
            Cell::Byte | Cell::SignedByte => self.store::<1>(address, value),
        }
    }

    /// Writes a register that a load has for destination: the program counter branches.
    #[inline(always)]
    pub(crate) fn loaded(&mut self, rt: u8, value: u32) -> Result<(), Fault> {
        if rt == 15 {
            return self.branch_exchange(value);
        }
        self.set(rt, value);
        Ok(())
    }

    /// The address of the access, and the base afterwards.
    #[inline(always)]
    pub(crate) fn indexed(&self, rn: u8, index: Index, offset: i32) -> (u32, u32) {
        let base = self.reg(rn);
        let moved = base.wrapping_add_signed(offset);
        match index {
            Index::Offset => (moved, base),
            Index::Pre => (moved, moved),
            Index::Post => (base, moved),
        }
    }

    pub(crate) fn load_dual(&mut self, rt: u8, rt2: u8, rn: u8, index: Index, offset: i32) -> Result<(), Fault> {
        let (address, base) = if rn == 15 {
            ((self.reg(15) & !3).wrapping_add_signed(offset), 0)
        } else {
            self.indexed(rn, index, offset)
        };
        aligned(address)?;
        let (first, second) = (self.load::<4>(address)?, self.load::<4>(address.wrapping_add(4))?);
        if index != Index::Offset {
            self.set(rn, base);
        }
        self.set(rt, first);
        self.set(rt2, second);
        self.now += 2;
        Ok(())
    }

    pub(crate) fn store_dual(&mut self, rt: u8, rt2: u8, rn: u8, index: Index, offset: i32) -> Result<(), Fault> {
        let (address, base) = self.indexed(rn, index, offset);
        aligned(address)?;
        self.store::<4>(address, self.reg(rt))?;
        self.store::<4>(address.wrapping_add(4), self.reg(rt2))?;
        if index != Index::Offset {
            self.set(rn, base);
        }
        self.now += 2;
        Ok(())
    }

    /// Lowest address of a transfer of `count` words, and the base afterwards.
    fn block(&self, rn: u8, before: bool, count: u32) -> (u32, u32) {
        let base = self.reg(rn);
        if before {
            let low = base.wrapping_sub(4 * count);
            (low, low)
        } else {
            (base, base.wrapping_add(4 * count))
        }
    }

    pub(crate) fn load_multiple(&mut self, rn: u8, before: bool, back: bool, list: u16) -> Result<(), Fault> {
        let count = list.count_ones();
        let (mut address, base) = self.block(rn, before, count);
        aligned(address)?;
        let mut values = [0; 16];
        for value in &mut values[..count as usize] {
            *value = self.load::<4>(address)?;
            address = address.wrapping_add(4);
        }
        if back {
            self.set(rn, base);
        }
        let mut rest = list;
        for &value in &values[..count as usize] {
            self.loaded(rest.trailing_zeros() as u8, value)?;
            rest &= rest - 1;
        }
        self.now += u64::from(count);
        Ok(())
    }

    pub(crate) fn store_multiple(&mut self, rn: u8, before: bool, back: bool, list: u16) -> Result<(), Fault> {
        let count = list.count_ones();
        let (mut address, base) = self.block(rn, before, count);
        aligned(address)?;
        let mut rest = list;
        while rest != 0 {
            self.store::<4>(address, self.reg(rest.trailing_zeros() as u8))?;
            address = address.wrapping_add(4);
            rest &= rest - 1;
        }
        if back {
            self.set(rn, base);
        }
        self.now += u64::from(count);
        Ok(())
    }

    pub(crate) fn load_exclusive(&mut self, cell: Cell, rt: u8, rn: u8, offset: u16) -> Result<(), Fault> {
        let address = self.reg(rn).wrapping_add(offset.into());
        exactly_aligned(cell, address)?;
        let value = self.load_cell(cell, address)?;
        self.cpu.exclusive = Some(address);
        self.set(rt, value);
        self.now += 1;
        Ok(())
    }

    pub(crate) fn store_exclusive(&mut self, cell: Cell, rd: u8, rt: u8, rn: u8, offset: u16) -> Result<(), Fault> {
        let address = self.reg(rn).wrapping_add(offset.into());
        exactly_aligned(cell, address)?;
        let holds = self.cpu.exclusive.take().is_some();
        if holds {
            self.store_cell(cell, address, self.reg(rt))?;
        }
        self.set(rd, u32::from(!holds));
        self.now += 1;
        Ok(())
    }

    /// TBB and TBH.
    pub(crate) fn table_branch(&mut self, half: bool, rn: u8, rm: u8) -> Result<(), Fault> {
        let (base, index) = (self.reg(rn), self.reg(rm));
        let entry = if half {
            self.load::<2>(base.wrapping_add(index << 1))?
        } else {
            self.load::<1>(base.wrapping_add(index))?
        };
        self.now += 1;
        self.branch(self.reg(15).wrapping_add(2 * entry));
        Ok(())
    }

    pub(crate) fn float_load(&mut self, double: bool, d: u8, rn: u8, offset: i16) -> Result<(), Fault> {
        let address = self.float_address(rn, offset);
        aligned(address)?;
        self.now += 1;
        let first = self.load::<4>(address)?;
        if double {
            self.cpu.s[usize::from(d) + 1] = self.load::<4>(address.wrapping_add(4))?;
            self.now += 1;
        }
        self.cpu.s[usize::from(d)] = first;
        Ok(())
    }

    pub(crate) fn float_store(&mut self, double: bool, d: u8, rn: u8, offset: i16) -> Result<(), Fault> {
        let address = self.float_address(rn, offset);
        aligned(address)?;
        self.now += 1;
        self.store::<4>(address, self.cpu.s[usize::from(d)])?;
        if double {
            self.store::<4>(address.wrapping_add(4), self.cpu.s[usize::from(d) + 1])?;
            self.now += 1;
        }
        Ok(())
    }

    fn float_address(&self, rn: u8, offset: i16) -> u32 {
        let base = self.reg(rn);
        let base = if rn == 15 { base & !3 } else { base };
        base.wrapping_add_signed(offset.into())
    }

    pub(crate) fn float_multiple(
        &mut self,
        is_load: bool,
        rn: u8,
        before: bool,
        back: bool,
        first: u8,
        count: u8,
    ) -> Result<(), Fault> {
        let (mut address, base) = self.block(rn, before, count.into());
        aligned(address)?;
        for register in usize::from(first)..usize::from(first + count) {
            if is_load {
                self.cpu.s[register] = self.load::<4>(address)?;
            } else {
                self.store::<4>(address, self.cpu.s[register])?;
            }
            address = address.wrapping_add(4);
        }
        if back {
            self.set(rn, base);
        }
        self.now += u64::from(count);
        Ok(())
    }
}

/// What moves more than one word must be aligned (A3.2.1).
fn aligned(address: u32) -> Result<(), Fault> {
    if address & 3 == 0 { Ok(()) } else { Err(Fault::Unaligned) }
}

fn exactly_aligned(cell: Cell, address: u32) -> Result<(), Fault> {
    let mask = match cell {
        Cell::Word => 3,
        Cell::Half | Cell::SignedHalf => 1,
        Cell::Byte | Cell::SignedByte => 0,
    };
    if address & mask == 0 { Ok(()) } else { Err(Fault::Unaligned) }
}
