//! A table's way into effect and out of it.

use super::{Live, WHOLE};

/// Of the share in a millisecond: all of it in a tenth of a second.
const RISE: i32 = WHOLE.div_euclid(100) + 1;
/// Verdicts in a row against a table that is in effect that end it.
const DOUBTS: u8 = 3;
/// Times that a table is dropped until its pole is not looked for any more; each is forgotten after so many verdicts that
/// are not against it.
const DROPS: u8 = 3;
const FORGOTTEN: u8 = 64;

/// How a table is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Use {
    /// There is none, or it is being learnt.
    #[default]
    None,
    /// Its pole is not known: looked for while the motor runs.
    Searching,
    /// In effect.
    Used,
    /// It did not fit, again and again: another rotor, or Halls that were moved.
    Foreign,
}

/// How far a table is in effect, and for which pole.
#[derive(Debug)]
pub struct Effect {
    live: &'static Live,
    state: Use,
    /// Whether there is a table whose pole can be found.
    findable: bool,
    /// Electrical turns from the table's begin at position zero, and the count of turns that this holds in.
    pole: i32,
    count: u32,
    share: i32,
    doubts: u8,
    /// [`FORGOTTEN`] for each time that it was dropped, less one for each verdict since that was not against it.
    drops: u8,
}

impl Effect {
    /// None.
    pub const fn new(live: &'static Live) -> Self {
        Self { live, state: Use::None, findable: false, pole: 0, count: 0, share: 0, doubts: 0, drops: 0 }
    }

    /// The table that the interrupt reads.
    pub const fn live(&self) -> &'static Live {
        self.live
    }

    /// How it is.
    pub const fn state(&self) -> Use {
        self.state
    }

    /// The pole in use: electrical turns from the table's begin at position zero.
    pub fn used(&self) -> Option<i32> {
        (self.state == Use::Used).then_some(self.pole)
    }

    /// That of the table that is in effect, and how much of it is, of [`WHOLE`].
    pub const fn share(&self) -> (i32, i32) {
        (self.pole, self.share)
    }

    /// None, at once.
    pub fn suspend(&mut self) {
        self.live.end();
        (self.state, self.share) = (Use::None, 0);
    }

    /// Another table, or none. One that was just learnt begins at position zero of this count of turns; otherwise its
    /// pole is looked for, where it can be found.
    pub fn renew(&mut self, findable: bool, learnt_in: Option<u32>) {
        (self.findable, self.drops) = (findable, 0);
        self.search();
        if learnt_in == Some(self.count) {
            (self.state, self.pole) = (Use::Used, 0);
        }
    }

    /// Begins to look for the pole.
    pub fn search(&mut self) {
        self.suspend();
        self.state = if self.findable { Use::Searching } else { Use::None };
        (self.count, self.doubts) = (self.live.count(), 0);
    }

    /// Whether the drive counts its turns anew, and the pole is not known any more.
    pub fn is_lost(&self) -> bool {
        self.count != self.live.count()
    }

    /// A millisecond more of its effect, or less where it is not `wanted`; none where the pole is `lost`. Whether a search
    /// begins.
    pub fn tick(&mut self, lost: bool, wanted: bool) -> bool {
        if self.state != Use::Used {
            return false;
        }
        if lost || self.is_lost() {
            self.search();
            return true;
        }
        if self.doubts < DOUBTS {
            self.set(if wanted { self.share + RISE } else { self.share - RISE });
            return false;
        }
        self.set(self.share - RISE);
        if self.share > 0 {
            return false;
        }
        self.search();
        self.drops = self.drops.saturating_add(FORGOTTEN);
        if self.drops > (DROPS - 1) * FORGOTTEN {
            self.state = Use::Foreign;
        }
        true
    }

    /// A verdict: of one that is used, whether it does not fit; of one whose pole is looked for, the pole that is sure.
    pub fn judge(&mut self, sure: Option<i32>, misfit: bool) {
        match (self.state, sure) {
            (Use::Used, _) if misfit => self.doubts = self.doubts.saturating_add(1),
            (Use::Used, _) => (self.doubts, self.drops) = (0, self.drops.saturating_sub(1)),
            (Use::Searching, Some(pole)) => (self.state, self.pole, self.doubts) = (Use::Used, pole, 0),
            _ => {}
        }
    }

    fn set(&mut self, share: i32) {
        let share = share.clamp(0, WHOLE);
        if share != self.share {
            self.share = share;
            self.live.use_from(self.pole, self.count, share);
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::boxed::Box;

    /// In full effect, then dropped.
    fn drop_it(effect: &mut Effect) {
        effect.judge(Some(0), false);
        (0..200).for_each(|_| _ = effect.tick(false, true));
        (0..DOUBTS).for_each(|_| effect.judge(None, true));
        (0..200).for_each(|_| _ = effect.tick(false, true));
    }

    #[test]
    fn a_drop_is_forgotten_where_the_table_fits_for_long() {
        let mut effect = Effect::new(Box::leak(Box::new(Live::new())));
        effect.renew(true, None);
        for _ in 0..10 {
            drop_it(&mut effect);
            assert_eq!(effect.state(), Use::Searching);
            effect.judge(Some(0), false);
            (0..FORGOTTEN).for_each(|_| effect.judge(None, false));
        }
        (0..DROPS).for_each(|_| drop_it(&mut effect));
        assert_eq!(effect.state(), Use::Foreign);
    }
}
