//! The timers (RM0440, chapters 28 to 31): counter, prescaler, preloads, compare channels and the outputs of TIM1.
//!
//! Nothing counts: between two counts at which something happens, the time of the next is computed. Times are cycles of
//! HCLK; the timers' clock divides it by a whole number.

mod breaks;
mod compare;
mod outputs;
mod registers;

pub use outputs::{Outputs, dead_time_counts};
pub use registers::Settings;

use bus::Cycle;

/// What a timer has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// As the manual calls it.
    pub name: &'static str,
    /// Width of the counter.
    pub bits: u32,
    /// Compare channels: 6 with complementary outputs, 4, 2, 1 or 0.
    pub channels: usize,
    /// Complementary outputs, break and repetition.
    pub advanced: bool,
}

/// An edge of a trigger output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edge {
    /// None.
    #[default]
    None,
    /// A level rises.
    Rising,
    /// A level falls.
    Falling,
    /// Up and down again at once.
    Pulse,
}

/// What happened at a count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Happened {
    /// TRGO.
    pub trgo: Edge,
    /// TRGO2.
    pub trgo2: Edge,
    /// A reference or an output setting changed: pins may have.
    pub outputs: bool,
    /// The counter has reached zero from above, or wrapped to it.
    pub valley: bool,
}

/// Edges of MOE and of the break flags, to be taken by who keeps the record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoeEdge {
    /// When.
    pub at: Cycle,
    /// The new state.
    pub on: bool,
    /// By which break input (0 or 1) and source (0: pin, 1 to 7: comparator); `None`: software.
    pub cause: Option<(usize, usize)>,
}

const UIF: u32 = 1;
const BIF: u32 = 1 << 7;
const NEVER: Cycle = Cycle::MAX;

/// A timer.
#[derive(Clone, Debug)]
pub struct Timer {
    shape: Shape,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 3],
    ccer: u32,
    psc: u32,
    arr: u32,
    rcr: u32,
    ccr: [u32; 6],
    bdtr: u32,
    dtr2: u32,
    af: [u32; 2],
    /// What acts until the next update.
    psc_acts: u32,
    arr_acts: u32,
    ccr_acts: [u32; 6],
    /// With CCPC: what acts until the next commutation.
    ccmr_acts: [u32; 3],
    ccer_acts: u32,
    repetition: u32,
    count: u32,
    down: bool,
    /// When `count` was reached.
    at: Cycle,
    /// Cycles of HCLK per cycle of the timer's clock.
    ratio: Cycle,
    references: [bool; 6],
    /// When something happens next.
    next: Cycle,
    /// Last time at zero.
    valley: Option<Cycle>,
    /// The outputs of channels 1 to 3.
    pub outputs: Outputs,
    breaks: [bool; 2],
    moe_edges: Vec<MoeEdge>,
}

impl Timer {
    /// As reset leaves it.
    pub fn new(shape: Shape) -> Self {
        let all = if shape.bits == 32 { u32::MAX } else { 0xffff };
        Self {
            shape,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 3],
            ccer: 0,
            psc: 0,
            arr: all,
            rcr: 0,
            ccr: [0; 6],
            bdtr: 0,
            dtr2: 0,
            af: [1, 1],
            psc_acts: 0,
            arr_acts: all,
            ccr_acts: [0; 6],
            ccmr_acts: [0; 3],
            ccer_acts: 0,
            repetition: 0,
            count: 0,
            down: false,
            at: 0,
            ratio: 1,
            references: [false; 6],
            next: NEVER,
            valley: None,
            outputs: Outputs::default(),
            breaks: [false; 2],
            moe_edges: Vec::new(),
        }
    }

    /// Puts the registers into their reset state.
    pub fn reset(&mut self) {
        *self = Self { ratio: self.ratio, ..Self::new(self.shape) };
    }

    /// The timer's clock divides HCLK by this; to be called at the time of the change.
    pub fn set_ratio(&mut self, ratio: Cycle, now: Cycle) {
        self.settle(now);
        self.ratio = ratio;
        self.configure_outputs();
        self.schedule();
    }

    /// Cycles of HCLK that one count lasts.
    fn step(&self) -> Cycle {
        (Cycle::from(self.psc_acts) + 1) * self.ratio
    }

    fn enabled(&self) -> bool {
        self.cr1 & 1 != 0
    }

    fn centred(&self) -> bool {
        self.cr1 & 0x60 != 0
    }

    /// When something happens next, which may be of no interest to anyone outside.
    pub fn next(&self) -> Cycle {
        self.next.min(self.outputs.next())
    }

    /// The next count at which an interrupt or a trigger is possible, or the next turn before it.
    pub fn next_of_interest(&self) -> Cycle {
        let (mms, mms2) = (self.cr2 >> 4 & 7, self.cr2 >> 20 & 0xf);
        if !self.enabled() || self.dier & 0x1f == 0 && mms < 2 && mms2 < 2 {
            return NEVER;
        }
        let triggers = [mms, mms2].map(|mode| match mode {
            3 => 1,
            4..=9 => 1 << (mode - 4),
            10..=15 => 0x38,
            _ => 0,
        });
        let channels = self.dier >> 1 & 0xf | triggers[0] | triggers[1];
        self.at + self.counts_to(channels) * self.step()
    }

    /// Counts to the turn, or to the compare value of one of these channels if that comes first.
    fn counts_to(&self, channels: u32) -> u64 {
        let mut counts = self.turn();
        for channel in (0..self.shape.channels).filter(|channel| channels >> channel & 1 != 0) {
            if let Some(distance) = self.distance(self.ccr_acts[channel]) {
                counts = counts.min(u64::from(distance));
            }
        }
        counts
    }

    /// Whether any interrupt of these flags is up.
    pub fn interrupt(&self, flags: u32) -> bool {
        self.sr & self.dier & flags != 0
    }

    /// Whether a break raises an interrupt.
    pub fn interrupts_at_break(&self) -> bool {
        self.dier & BIF != 0
    }

    /// Break flags share one enable (28.6.4: BIE).
    pub fn break_interrupt(&self) -> bool {
        self.dier & BIF != 0 && self.sr & (BIF | 1 << 8) != 0
    }

    /// Time at which the counter was last at zero.
    pub fn valley(&self) -> Option<Cycle> {
        self.valley
    }

    /// Length of a period in cycles of HCLK, from valley to valley.
    pub fn period(&self) -> Cycle {
        let counts = if self.centred() { 2 * Cycle::from(self.arr_acts) } else { Cycle::from(self.arr_acts) + 1 };
        counts * self.step()
    }

    /// Main output enable.
    pub fn moe(&self) -> bool {
        self.bdtr >> 15 & 1 != 0
    }

    /// Edges of MOE since the last call.
    pub fn take_moe_edges(&mut self) -> Vec<MoeEdge> {
        core::mem::take(&mut self.moe_edges)
    }

    /// Counts to go until this value in the present direction, if it comes before the turn.
    fn distance(&self, target: u32) -> Option<u32> {
        let distance = if self.down { self.count.checked_sub(target) } else { target.checked_sub(self.count) }?;
        (distance > 0).then_some(distance)
    }

    /// The value at which the direction changes or the counter wraps, and how far it is: the step of the wrap
    /// included.
    fn turn(&self) -> u64 {
        let (count, reload) = (u64::from(self.count), u64::from(self.arr_acts));
        if self.centred() {
            if self.down { count } else { reload.saturating_sub(count).max(1) }
        } else if self.down {
            count + 1
        } else if count <= reload {
            reload - count + 1
        } else {
            (1_u64 << self.shape.bits) - count
        }
    }

    fn schedule(&mut self) {
        if !self.enabled() || self.arr_acts == 0 {
            self.next = NEVER;
            return;
        }
        self.next = self.at + self.counts_to(u32::MAX) * self.step();
    }

    /// Moves the counter to where it is now; nothing happens on the way.
    fn settle(&mut self, now: Cycle) {
        if self.enabled() && self.arr_acts != 0 {
            let counts = ((now - self.at) / self.step()) as u32;
            self.count = if self.down { self.count.wrapping_sub(counts) } else { self.count.wrapping_add(counts) };
            self.at += Cycle::from(counts) * self.step();
        } else {
            self.at = now;
        }
    }

    /// Does what is due at [`Timer::next`].
    pub fn fire(&mut self) -> Happened {
        let now = self.next();
        let mut happened = Happened::default();
        if self.outputs.next() == now {
            self.outputs.settle(now);
            happened.outputs = true;
        }
        if self.next == now {
            self.reach(now, &mut happened);
        }
        happened
    }

    fn reach(&mut self, now: Cycle, happened: &mut Happened) {
        let counts = (now - self.at) / self.step();
        let turns = counts == self.turn();
        self.at = now;
        if !turns {
            self.count = if self.down { self.count - counts as u32 } else { self.count + counts as u32 };
        } else if self.centred() {
            self.count = if self.down { 0 } else { self.arr_acts };
            self.down = !self.down;
        } else {
            self.count = if self.down { self.arr_acts } else { 0 };
        }
        if turns {
            happened.valley = if self.centred() { !self.down } else { true };
            if happened.valley {
                self.valley = Some(now);
            }
            self.overflow(happened);
        }
        self.compare(happened);
        self.refresh_references(now, happened);
        self.schedule();
    }

    fn overflow(&mut self, happened: &mut Happened) {
        if self.shape.advanced && self.repetition > 0 {
            self.repetition -= 1;
            return;
        }
        if self.cr1 & 1 << 3 != 0 {
            self.cr1 &= !1;
        }
        self.update(happened, true);
    }

    /// An update event (28.3.2): preloads act from now on.
    fn update(&mut self, happened: &mut Happened, flag: bool) {
        self.repetition = self.rcr;
        if self.cr1 & 2 != 0 {
            return;
        }
        self.psc_acts = self.psc;
        self.arr_acts = self.arr;
        self.ccr_acts = self.ccr;
        if flag {
            self.sr |= UIF;
        }
        if self.bdtr & 1 << 14 != 0 && !self.moe() && self.breaks == [false; 2] {
            self.set_moe(true, self.at, None);
            happened.outputs = true;
        }
        if self.cr2 >> 4 & 7 == 2 {
            happened.trgo = Edge::Pulse;
        }
        if self.cr2 >> 20 & 0xf == 2 {
            happened.trgo2 = Edge::Pulse;
        }
    }

    fn configure_outputs(&mut self) {
        let dts = self.ratio << (self.cr1 >> 8 & 3);
        self.outputs.configure(self.ccer_acts, self.cr2, self.bdtr, self.dtr2, dts);
    }
}
