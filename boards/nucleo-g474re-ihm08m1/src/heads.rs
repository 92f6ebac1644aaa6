//! The heads of an encoder: constants, with reasons. They are sampled in the same triggered group as everything else.
//!
//! ADC2 has two pins to spare for them once ADC1 takes the temperature. The other two are reached by followers inside the
//! chip, whose outputs go to ADC5. That repeats the timing of ADC2 rank by rank, so that the two heads of a ring are held
//! at once, and the two rings one conversion apart, which the firmware makes up for by the speed.

use super::constants::{BUS, FIRST, FOURTH, SECOND, SHORT, THIRD};
use stm32g4::registers::adc::{Rank, Sequence};

/// As without heads, and the temperature: Hall 3, U, W, temperature.
pub const FIRST_WITH: Sequence = Sequence(&[FIRST.0[0], FIRST.0[1], FIRST.0[2], SECOND.0[2]]);
/// Bus, V, the first head of ring 1 at PC4 and of ring 2 at PC5.
pub const SECOND_WITH: Sequence = Sequence(&[SECOND.0[0], SECOND.0[1], Rank::new(5, SHORT), Rank::new(11, SHORT)]);
/// Twice nothing of use; the second head of ring 1 at PC3 by OPAMP5, and of ring 2 at PB11 by OPAMP4.
pub const FIFTH: Sequence =
    Sequence(&[Rank::new(3, BUS), Rank::new(5, SHORT), Rank::new(3, SHORT), Rank::new(5, SHORT)]);

/// How much later the heads of ring 2 are held than those of ring 1, in timer counts.
pub const LATER: u32 = SECOND_WITH.held(3) - SECOND_WITH.held(2);

// What the settings and the interrupt rely on is as without heads.
const _: () = assert!(FIRST_WITH.held(1) == FIRST.held(1) && FIRST_WITH.held(2) == FIRST.held(2));
const _: () = assert!(FIRST_WITH.held(0) == THIRD.held(0) && FIRST_WITH.held(0) == FOURTH.held(0));
const _: () = assert!(FIRST_WITH.done() >= SECOND_WITH.done() && FIRST_WITH.done() >= FIFTH.done());
const _: () = assert!(FIFTH.held(2) == SECOND_WITH.held(2) && FIFTH.held(3) == SECOND_WITH.held(3));
