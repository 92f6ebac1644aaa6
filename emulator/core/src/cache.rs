//! The accelerator in front of the code memory: direct-mapped caches for instructions and for data, always on, and the
//! prefetch of the next line where it is switched on.
//!
//! The memory delivers a word of [`Cache::word_bytes`](bus::Cache::word_bytes) in one access of 1 + wait states cycles.
//! How much of a line a miss fills, and whether the next miss waits for that, the reference manual does not say:
//! [`Fill`] has both bounds.

use bus::{Cycle, Fill, Integration};

#[derive(Clone, Debug)]
pub struct Caches {
    /// Bits of an address within a line, and within a word of the memory.
    line: u32,
    word: u32,
    pub fill: Fill,
    /// Word, or line, of the instruction that executes.
    current: u32,
    instructions: Lines,
    data: Lines,
    /// The line that is being filled, and the one to be prefetched behind it.
    filling: Filling,
    prefetch: Option<Filling>,
    /// Cycles waited in all.
    pub waited: Cycle,
}

/// A line whose words arrive one after the other.
#[derive(Clone, Copy, Debug)]
struct Filling {
    line: u32,
    /// The word that comes first; the others follow, around the end.
    first: u32,
    /// When its access began.
    begin: Cycle,
}

/// What the memory is programmed to.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    pub wait_states: u32,
    pub prefetch: bool,
}

impl Caches {
    pub fn new(integration: &Integration) -> Self {
        let cache = integration.cache;
        Caches {
            line: cache.line_bytes.ilog2(),
            word: cache.word_bytes.ilog2(),
            fill: Fill::default(),
            current: u32::MAX,
            instructions: Lines::new(cache.instruction_lines),
            data: Lines::new(cache.data_lines),
            filling: Filling { line: u32::MAX, first: 0, begin: 0 },
            prefetch: None,
            waited: 0,
        }
    }

    /// Whether an instruction lies in another word than the one before: only then there is something to look up.
    #[inline(always)]
    pub fn word_changes(&mut self, pc: u32) -> bool {
        let word = pc >> self.word;
        std::mem::replace(&mut self.current, word) != word
    }

    /// Cycles that the fetch of an instruction waits.
    pub fn fetch(&mut self, pc: u32, now: Cycle, speed: Speed) -> Cycle {
        let (line, word) = (pc >> self.line, self.word_of(pc));
        if !self.instructions.take(line) {
            match self.prefetch.take_if(|next| next.line == line) {
                Some(next) => self.filling = next,
                None => {
                    let begin = self.free(now, speed);
                    self.filling = Filling { line, first: word, begin };
                }
            }
            if speed.prefetch {
                let begin = self.end(&self.filling, speed).max(now);
                self.prefetch = Some(Filling { line: line + 1, first: 0, begin });
            }
        }
        let wait = if self.filling.line == line { self.arrives(word, speed).saturating_sub(now) } else { 0 };
        self.waited += wait;
        wait
    }

    /// Cycles that a load from the code memory waits.
    pub fn load(&mut self, offset: u32, now: Cycle, speed: Speed) -> Cycle {
        if self.data.take(offset >> self.line) {
            return 0;
        }
        let begin = self.free(now, speed);
        // Fills its line as well, with no word of it an instruction.
        self.filling = Filling { line: u32::MAX, first: 0, begin };
        self.prefetch = None;
        let wait = begin - now + Cycle::from(speed.wait_states);
        self.waited += wait;
        wait
    }

    pub fn flush(&mut self) {
        self.current = u32::MAX;
        self.instructions.flush();
        self.data.flush();
        self.filling = Filling { line: u32::MAX, first: 0, begin: 0 };
        self.prefetch = None;
    }

    fn word_of(&self, pc: u32) -> u32 {
        pc >> self.word & ((1 << (self.line - self.word)) - 1)
    }

    /// When a word of the line that is being filled is there.
    fn arrives(&self, word: u32, speed: Speed) -> Cycle {
        let Filling { first, begin, .. } = self.filling;
        let after = match self.fill {
            Fill::AtOnce => 0,
            Fill::WordByWord => word.wrapping_sub(first) & ((1 << (self.line - self.word)) - 1),
        };
        begin + Cycle::from(after) * access(speed) + Cycle::from(speed.wait_states)
    }

    /// When a line has been filled.
    fn end(&self, filling: &Filling, speed: Speed) -> Cycle {
        let words = match self.fill {
            Fill::AtOnce => 1,
            Fill::WordByWord => 1 << (self.line - self.word),
        };
        filling.begin + words * access(speed)
    }

    /// When a miss can begin. A prefetch is given up after the access that is under way.
    fn free(&mut self, now: Cycle, speed: Speed) -> Cycle {
        if self.fill == Fill::AtOnce {
            return now;
        }
        let filled = if self.filling.begin == 0 { 0 } else { self.end(&self.filling, speed) };
        match self.prefetch.take() {
            Some(next) if next.begin <= now && now < self.end(&next, speed) => {
                next.begin + (now - next.begin).div_ceil(access(speed)) * access(speed)
            }
            _ => filled.max(now),
        }
    }
}

/// Cycles of an access to the memory.
fn access(speed: Speed) -> Cycle {
    Cycle::from(speed.wait_states) + 1
}

/// The line that each place holds.
#[derive(Clone, Debug)]
struct Lines(Vec<u32>);

impl Lines {
    fn new(count: u32) -> Self {
        assert!(count.is_power_of_two(), "a cache of {count} lines");
        Lines(vec![u32::MAX; count as usize])
    }

    /// Whether a line is held; it is from now on.
    fn take(&mut self, line: u32) -> bool {
        let mask = self.0.len() - 1;
        std::mem::replace(&mut self.0[line as usize & mask], line) == line
    }

    fn flush(&mut self) {
        self.0.fill(u32::MAX);
    }
}
