//! How often, how late and how long handlers run.

use bus::Cycle;
use measure::Range;
use serde::Serialize;
use std::collections::BTreeMap;

/// One exception's handler. Core cycles.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Activity {
    /// From pending to the first instruction.
    pub latency: Range,
    /// Between two first instructions.
    pub period: Range,
    /// From the first instruction to the return, handlers that pre-empted it included.
    pub duration: Range,
    /// Its own instructions, without those of handlers that pre-empted it.
    pub instructions: Range,
    /// Own cycles.
    pub cycles: Range,
    /// From the origin that the bus names (the trigger of a conversion, say) to its first instruction.
    pub since_origin: Range,
    /// Of these, waited for the code memory.
    pub waited: Range,
    /// How many took so many own cycles, in steps of [`BIN`]; by the begin of the step.
    pub histogram: BTreeMap<Cycle, u64>,
    /// Sums of own cycles and of those waited.
    #[serde(skip)]
    sums: [Cycle; 2],
    /// Sum of the periods.
    #[serde(skip)]
    periods: Cycle,
    /// When it was last entered, and the origin of that time.
    #[serde(skip)]
    last: Option<(Cycle, Option<Cycle>)>,
}

/// Cycles of a step of [`Activity::histogram`].
pub const BIN: Cycle = 10;

impl Activity {
    /// Means of own cycles and of those waited for the code memory.
    pub fn mean_cycles(&self) -> [f64; 2] {
        self.sums.map(|sum| sum as f64 / self.cycles.count as f64)
    }

    /// Mean of the periods, cycles; not a number where there is none.
    pub fn mean_period(&self) -> f64 {
        self.periods as f64 / self.period.count as f64
    }
}

#[derive(Clone)]
struct Frame {
    exception: u16,
    spent: Spent,
    /// Of those that pre-empted it.
    others: Spent,
}

/// What the core has spent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Spent {
    /// Instructions.
    pub instructions: u64,
    /// Cycles.
    pub cycles: Cycle,
    /// Of these, waited for the code memory.
    pub waited: Cycle,
}

impl Spent {
    pub(crate) fn since(self, before: Self) -> Self {
        Spent {
            instructions: self.instructions - before.instructions,
            cycles: self.cycles - before.cycles,
            waited: self.waited - before.waited,
        }
    }

    /// And more.
    pub fn add(&mut self, more: Self) {
        self.instructions += more.instructions;
        self.cycles += more.cycles;
        self.waited += more.waited;
    }
}

/// Since the last reset, whatever else was forgotten.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entries {
    /// How often a handler began.
    pub count: u64,
    /// What led to the last time.
    pub origin: Option<Cycle>,
}

/// All of them.
#[derive(Clone, Default)]
pub struct Profile {
    entries: BTreeMap<u16, Entries>,
    activities: BTreeMap<u16, Activity>,
    pending_since: BTreeMap<u16, Cycle>,
    stack: Vec<Frame>,
}

impl Profile {
    /// By exception number.
    pub fn activities(&self) -> &BTreeMap<u16, Activity> {
        &self.activities
    }

    /// How often an exception's handler began since the last reset.
    pub fn entries(&self, exception: u16) -> Entries {
        self.entries.get(&exception).copied().unwrap_or_default()
    }

    /// Begins anew, e.g. after the firmware has started up.
    pub fn clear(&mut self) {
        self.activities.clear();
    }

    pub(crate) fn abandon(&mut self) {
        self.stack.clear();
        self.entries.clear();
        self.pending_since.clear();
        self.activities.values_mut().for_each(|activity| activity.last = None);
    }

    pub(crate) fn pended(&mut self, mut set: u128, now: Cycle) {
        while set != 0 {
            self.pending_since.entry(set.trailing_zeros() as u16).or_insert(now);
            set &= set - 1;
        }
    }

    /// `origin`: when what this interrupt tells of began.
    pub(crate) fn entered(&mut self, exception: u16, origin: Option<Cycle>, spent: Spent) {
        let now = spent.cycles;
        let activity = self.activities.entry(exception).or_default();
        if let Some(since) = self.pending_since.remove(&exception) {
            activity.latency.add((now - since) as f64);
        }
        let entries = self.entries.entry(exception).or_default();
        *entries = Entries { count: entries.count + 1, origin };
        let last = activity.last.replace((now, origin));
        if let Some((last, _)) = last {
            activity.period.add((now - last) as f64);
            activity.periods += now - last;
        }
        if let Some(at) = origin
            && last.is_none_or(|(_, before)| before != origin)
        {
            activity.since_origin.add((now - at) as f64);
        }
        self.stack.push(Frame { exception, spent, others: Spent::default() });
    }

    /// Returns what the handler took of its own.
    pub(crate) fn left(&mut self, exception: u16, spent: Spent) -> Option<Spent> {
        let frame = self.stack.pop_if(|frame| frame.exception == exception)?;
        let whole = spent.since(frame.spent);
        let own = whole.since(frame.others);
        let activity = self.activities.entry(exception).or_default();
        activity.duration.add(whole.cycles as f64);
        activity.instructions.add(own.instructions as f64);
        activity.cycles.add(own.cycles as f64);
        activity.waited.add(own.waited as f64);
        activity.sums[0] += own.cycles;
        activity.sums[1] += own.waited;
        *activity.histogram.entry(own.cycles / BIN * BIN).or_default() += 1;
        if let Some(below) = self.stack.last_mut() {
            below.others.add(whole);
        }
        Some(own)
    }
}
