//! How much stack a function needs at most, with all that it calls.
//!
//! Frames are read off the machine code: whatever a function pushes or subtracts from the stack pointer anywhere
//! counts, in the whole of its code. A function that is only named, and so perhaps called through a pointer, counts as
//! called by who names it. What comes from memory and is called there is not seen: the functions that do so are few,
//! and listed.

use crate::reach::Graph;
use std::collections::{BTreeMap, BTreeSet};

/// Of a function.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Bytes, if the code tells.
    pub bytes: u64,
    /// It moves the stack pointer by a variable.
    pub variable: bool,
    /// It calls through a register.
    pub indirect: bool,
}

impl Frame {
    /// Of a function's halfwords.
    pub fn of(code: &[u16]) -> Self {
        let mut frame = Self::default();
        let mut k = 0;
        while k < code.len() {
            let first = u64::from(code[k]);
            // Instructions of 32 bits begin with 11101, 11110 or 11111 (Armv7-M manual, A5.1).
            let wide = first >> 11 >= 0b11101;
            let second = u64::from(if wide { code.get(k + 1).copied().unwrap_or(0) } else { 0 });
            frame.take(first, second, wide);
            k += if wide { 2 } else { 1 };
        }
        frame
    }

    fn take(&mut self, first: u64, second: u64, wide: bool) {
        let constant = || {
            let (i, imm3, imm8) = (first >> 10 & 1, second >> 12 & 7, second & 0xFF);
            (i << 11 | imm3 << 8 | imm8, imm8)
        };
        self.bytes += match (wide, first) {
            // PUSH, encoding T1: registers and LR.
            (false, 0xB400..=0xB5FF) => 4 * u64::from((first & 0x1FF).count_ones()),
            // SUB (SP minus immediate), T1.
            (false, 0xB080..=0xB0FF) => 4 * (first & 0x7F),
            // PUSH, T2, which is STMDB SP!.
            (true, 0xE92D) => 4 * u64::from(second.count_ones()),
            // STR Rt, [SP, #-imm8]!, which is PUSH, T3.
            (true, 0xF84D) if second & 0xF00 == 0xD00 => second & 0xFF,
            // VPUSH: words.
            (true, 0xED2D | 0xED6D) if second >> 8 & 0xE == 0xA => 4 * (second & 0xFF),
            // SUB.W (SP minus immediate), T2: a modified constant.
            (true, 0xF1AD | 0xF5AD) if second >> 8 & 0xF == 0xD => expand(constant().0),
            // SUBW, T3: a plain one.
            (true, 0xF2AD | 0xF6AD) if second >> 8 & 0xF == 0xD => constant().0,
            _ => 0,
        };
        // SUB SP, SP, Rm; BLX Rm.
        self.variable |= wide && first == 0xEBAD && second >> 8 & 0xF == 0xD;
        self.indirect |= !wide && first & 0xFF87 == 0x4780;
    }
}

/// Modified constant (Armv7-M manual, A5.3.2).
fn expand(imm12: u64) -> u64 {
    let byte = imm12 & 0xFF;
    match (imm12 >> 10, imm12 >> 8 & 3) {
        (0, 0) => byte,
        (0, 1) => byte << 16 | byte,
        (0, 2) => byte << 24 | byte << 8,
        (0, _) => byte * 0x0101_0101,
        _ => u64::from((0x80 | imm12 as u32 & 0x7F).rotate_right((imm12 >> 7 & 0x1F) as u32)),
    }
}

/// The deepest way from a function.
pub struct Deepest {
    /// Bytes of all frames along it.
    pub bytes: u64,
    /// Its functions with their frames, the first one first.
    pub chain: Vec<(String, u64)>,
    /// Functions on any way that call through a register.
    pub indirect: BTreeSet<String>,
}

/// The deepest way from `function`. A function that comes again on a way, which is a recursion, does not count twice.
pub fn deepest(graph: &Graph, function: u64) -> Deepest {
    let mut search = Search { graph, known: BTreeMap::new(), open: BTreeSet::new() };
    let bytes = search.visit(function);
    let mut chain = Vec::new();
    let mut next = Some(function);
    while let Some(at) = next {
        if let Some(frame) = graph.frame(at) {
            chain.push((graph.name(at), frame.bytes));
        }
        next = search.known.get(&at).and_then(|&(_, next)| next);
    }
    let indirect = search
        .known
        .keys()
        .filter(|&&at| graph.frame(at).is_some_and(|f| f.indirect))
        .map(|&at| graph.name(at))
        .collect();
    Deepest { bytes, chain, indirect }
}

struct Search<'a> {
    graph: &'a Graph,
    /// Depth, and where it goes on.
    known: BTreeMap<u64, (u64, Option<u64>)>,
    open: BTreeSet<u64>,
}

impl Search<'_> {
    fn visit(&mut self, at: u64) -> u64 {
        if let Some(&(depth, _)) = self.known.get(&at) {
            return depth;
        }
        if !self.open.insert(at) {
            return 0;
        }
        let mut below = (0, None);
        for next in self.graph.named_by(at) {
            let depth = self.visit(next);
            if depth > below.0 {
                below = (depth, Some(next));
            }
        }
        self.open.remove(&at);
        let depth = below.0 + self.graph.frame(at).map_or(0, |frame| frame.bytes);
        self.known.insert(at, (depth, below.1));
        depth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames() {
        // As an assembler puts them: push {r4-r7, lr}; stmdb sp!, {r8, r9, r10, r11}; vpush {d8-d9}; sub.w sp, sp,
        // #11008; sub sp, #32; subw sp, sp, #2184; str lr, [sp, #-4]!.
        let cases: [(&[u16], u64); 7] = [
            (&[0xB5F0], 20),
            (&[0xE92D, 0x0F00], 16),
            (&[0xED2D, 0x8B04], 16),
            (&[0xF5AD, 0x5D2C], 11_008),
            (&[0xB088], 32),
            (&[0xF6AD, 0x0D88], 2184),
            (&[0xF84D, 0xED04], 4),
        ];
        for (code, bytes) in cases {
            assert_eq!(Frame::of(code), Frame { bytes, ..Frame::default() }, "{code:x?}");
        }
        let all: Vec<u16> = cases.iter().flat_map(|(code, _)| code.iter().copied()).collect();
        assert_eq!(Frame::of(&all).bytes, cases.iter().map(|case| case.1).sum());
    }

    #[test]
    fn calls_through_registers() {
        // blx r3; bl; bx lr.
        assert!(Frame::of(&[0x4798]).indirect);
        assert!(!Frame::of(&[0xF000, 0xF800, 0x4770]).indirect);
        // sub.w sp, sp, r4.
        assert!(Frame::of(&[0xEBAD, 0x0D04]).variable);
    }
}
