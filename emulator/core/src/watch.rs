//! What the instructions of one exception's handler take: in all, and in the longest run of it.

use crate::profile::Spent;
use bus::Cycle;
use std::collections::BTreeMap;

/// The watch over an exception.
#[derive(Clone, Default)]
pub(crate) struct Watch {
    /// Whose handler is watched.
    pub exception: Option<u16>,
    pub all: BTreeMap<u32, Spent>,
    pub longest: Option<Longest>,
    /// Instructions of the present run.
    run: Vec<(u32, Spent)>,
}

/// The longest run of a watched handler.
#[derive(Clone, Debug)]
pub struct Longest {
    /// When it was over.
    pub at: Cycle,
    /// What it took.
    pub spent: Spent,
    /// What its instructions took, by address.
    pub by_address: BTreeMap<u32, Spent>,
}

impl Watch {
    /// An instruction of the handler.
    pub fn note(&mut self, address: u32, spent: Spent) {
        self.run.push((address, spent));
    }

    /// An exception's handler has returned, which took so much of its own.
    pub fn left(&mut self, exception: u16, spent: Spent, now: Cycle) {
        if self.exception != Some(exception) {
            return;
        }
        add(&mut self.all, &self.run);
        if self.longest.as_ref().is_none_or(|longest| longest.spent.cycles < spent.cycles) {
            let mut by_address = BTreeMap::new();
            add(&mut by_address, &self.run);
            self.longest = Some(Longest { at: now, spent, by_address });
        }
        self.run.clear();
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        *self = Watch { exception: self.exception, run: std::mem::take(&mut self.run), ..Watch::default() };
    }

    /// A reset has ended the run.
    pub fn abandon(&mut self) {
        self.run.clear();
    }
}

fn add(sums: &mut BTreeMap<u32, Spent>, run: &[(u32, Spent)]) {
    for &(address, spent) in run {
        sums.entry(address).or_default().add(spent);
    }
}
