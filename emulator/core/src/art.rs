//! The flash accelerator (RM0440, 3.3.6): an instruction cache of 32 lines and a data cache of 8 lines, of 32 bytes each.
//!
//! Modelled as direct-mapped and always on. A line that is missing costs the wait states once: the chip fetches 64 bits at a
//! time and prefetches the next ones while the core executes.

use crate::memory::FLASH;

const LINE: u32 = 5;

#[derive(Clone, Debug)]
pub struct Art {
    current: u32,
    instructions: [u32; 32],
    data: [u32; 8],
}

impl Default for Art {
    fn default() -> Self {
        Art { current: u32::MAX, instructions: [u32::MAX; 32], data: [u32::MAX; 8] }
    }
}

impl Art {
    #[inline(always)]
    pub fn line_changes(&mut self, pc: u32) -> bool {
        let line = pc >> LINE;
        if line == self.current {
            return false;
        }
        self.current = line;
        pc.wrapping_sub(FLASH) < 1 << 20
    }

    pub fn fetch(&mut self, pc: u32, wait_states: u32) -> u32 {
        let line = pc >> LINE;
        look(&mut self.instructions[line as usize % 32], line, wait_states)
    }

    pub fn load(&mut self, offset: u32, wait_states: u32) -> u32 {
        let line = offset >> LINE;
        look(&mut self.data[line as usize % 8], line, wait_states)
    }

    pub fn flush(&mut self) {
        *self = Art::default();
    }
}

fn look(slot: &mut u32, line: u32, wait_states: u32) -> u32 {
    if std::mem::replace(slot, line) == line { 0 } else { wait_states }
}
