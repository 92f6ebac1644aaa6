//! The caches in front of the code memory, for instructions and for data: direct-mapped, always on. A line that is
//! missing costs the wait states once.

use bus::Integration;

#[derive(Clone, Debug)]
pub struct Caches {
    /// Bits of an address within a line.
    line: u32,
    /// Line of the instruction that executes.
    current: u32,
    instructions: Lines,
    data: Lines,
}

impl Caches {
    pub fn new(integration: &Integration) -> Self {
        let cache = integration.cache;
        Caches {
            line: cache.line_bytes.ilog2(),
            current: u32::MAX,
            instructions: Lines::new(cache.instruction_lines),
            data: Lines::new(cache.data_lines),
        }
    }

    #[inline(always)]
    pub fn line_changes(&mut self, pc: u32) -> bool {
        let line = pc >> self.line;
        std::mem::replace(&mut self.current, line) != line
    }

    pub fn fetch(&mut self, pc: u32, wait_states: u32) -> u32 {
        self.instructions.look(pc >> self.line, wait_states)
    }

    pub fn load(&mut self, offset: u32, wait_states: u32) -> u32 {
        self.data.look(offset >> self.line, wait_states)
    }

    pub fn flush(&mut self) {
        self.current = u32::MAX;
        self.instructions.flush();
        self.data.flush();
    }
}

/// The line that each place holds.
#[derive(Clone, Debug)]
struct Lines(Vec<u32>);

impl Lines {
    fn new(count: u32) -> Self {
        assert!(count.is_power_of_two(), "a cache of {count} lines");
        Lines(vec![u32::MAX; count as usize])
    }

    fn look(&mut self, line: u32, wait_states: u32) -> u32 {
        let mask = self.0.len() - 1;
        if std::mem::replace(&mut self.0[line as usize & mask], line) == line { 0 } else { wait_states }
    }

    fn flush(&mut self) {
        self.0.fill(u32::MAX);
    }
}
