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
    /// Sum of the periods.
    #[serde(skip)]
    periods: Cycle,
    /// When it was last entered, and the origin of that time.
    #[serde(skip)]
    last: Option<(Cycle, Option<Cycle>)>,
}

impl Activity {
    /// Mean of the periods, cycles; not a number where there is none.
    pub fn mean_period(&self) -> f64 {
        self.periods as f64 / self.period.count as f64
    }
}

#[derive(Clone)]
struct Frame {
    exception: u16,
    entered: Cycle,
    instructions: u64,
    /// Instructions and cycles of those that pre-empted it.
    others: (u64, u64),
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
    pub(crate) fn entered(&mut self, exception: u16, now: Cycle, origin: Option<Cycle>, instructions: u64) {
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
        self.stack.push(Frame { exception, entered: now, instructions, others: (0, 0) });
    }

    pub(crate) fn left(&mut self, exception: u16, now: Cycle, instructions: u64) {
        let Some(frame) = self.stack.pop_if(|frame| frame.exception == exception) else { return };
        let whole = (instructions - frame.instructions, now - frame.entered);
        let activity = self.activities.entry(exception).or_default();
        activity.duration.add(whole.1 as f64);
        activity.instructions.add((whole.0 - frame.others.0) as f64);
        activity.cycles.add((whole.1 - frame.others.1) as f64);
        if let Some(below) = self.stack.last_mut() {
            below.others.0 += whole.0;
            below.others.1 += whole.1;
        }
    }
}
