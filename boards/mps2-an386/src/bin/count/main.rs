//! Instructions executed by each function of the fast path and by its peers, over a sweep of inputs, with the errors.
//!
//! Prints a table in Markdown and fails when a function exceeds its budget.
#![no_std]
#![no_main]

mod call;
mod trig;

use call::{Arguments, Counter, Function, Results};
use cortex_m_rt::entry;
use defmt::{Display2Format, println};
use mps2_an386::{failure, success};

/// A function to count.
pub struct Row {
    /// What it computes.
    item: &'static str,
    /// Who computes it.
    by: &'static str,
    function: Function,
    /// The largest number of instructions that the worst input may take.
    budget: Option<u32>,
    /// The arguments number `index` of the sweep.
    arguments: fn(index: u32) -> Arguments,
    /// The error of a result against f64, in the unit of the item.
    error: fn(&Arguments, &Results) -> f64,
}

const SWEEP: u32 = 1 << 14;

#[entry]
fn main() -> ! {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        failure()
    };
    let counter = Counter::new(&mut core.SYST);
    println!("| item | by | min | mean | max | budget | error |");
    println!("|---|---|---|---|---|---|---|");
    let mut exceeded = false;
    for row in trig::ROWS {
        exceeded |= !row.print(&counter);
    }
    if exceeded { failure() } else { success() }
}

impl Row {
    /// Counts, prints and tells whether the row is within its budget.
    fn print(&self, counter: &Counter) -> bool {
        let (mut least, mut most, mut sum, mut error) = (u32::MAX, 0, 0, 0.0_f64);
        for index in 0..SWEEP {
            let arguments = (self.arguments)(index);
            // SAFETY: every row's arguments are made for its function.
            let (results, instructions) = unsafe { counter.call(self.function, arguments) };
            least = least.min(instructions);
            most = most.max(instructions);
            sum += instructions;
            error = error.max((self.error)(&arguments, &results).abs());
        }
        let within = self.budget.is_none_or(|budget| most <= budget);
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            self.item,
            self.by,
            least,
            Display2Format(&format_args!("{:.1}", sum as f32 / SWEEP as f32)),
            most,
            Display2Format(&Budget(self.budget, within)),
            Display2Format(&format_args!("{error:.1e}")),
        );
        within
    }
}

struct Budget(Option<u32>, bool);

impl core::fmt::Display for Budget {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self(None, _) => Ok(()),
            Self(Some(budget), true) => write!(f, "{budget}"),
            Self(Some(budget), false) => write!(f, "**{budget} exceeded**"),
        }
    }
}
