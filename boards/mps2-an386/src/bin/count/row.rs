//! A row of the table: a function, its inputs and what is wrong with its results.

use crate::call::{Arguments, Counter, Function, Results};
use defmt::{Display2Format, println};
use mps2_an386::{failure, success};

/// Inputs of a sweep. Functions without branches take the same number of instructions everywhere; for the others it
/// must be enough to meet their rarest path.
pub const SWEEP: u32 = 1 << 14;

/// A function to count.
pub struct Row {
    item: &'static str,
    by: &'static str,
    function: Function,
    arguments: fn(index: u32) -> Arguments,
    error: fn(&Arguments, &Results) -> f64,
    budget: Option<u32>,
}

impl Row {
    /// `by` computes `item` in `function`, which is safe to call with the `arguments` number 0 to 2³² of the sweep; the
    /// `error` of a result is in the unit of the item, against f64.
    pub const fn new(
        item: &'static str,
        by: &'static str,
        function: Function,
        arguments: fn(index: u32) -> Arguments,
        error: fn(&Arguments, &Results) -> f64,
    ) -> Self {
        Self { item, by, function, arguments, error, budget: None }
    }

    /// The largest number of instructions that the worst input may take.
    pub const fn budget(mut self, instructions: u32) -> Self {
        self.budget = Some(instructions);
        self
    }

    /// Prepares, prints the table of all rows, and ends the program: as a failure where one is over its budget.
    pub fn table(init: fn(), tables: &[&[Self]]) -> ! {
        let Some(mut core) = cortex_m::Peripherals::take() else { failure() };
        let counter = Counter::new(&mut core.SYST);
        init();
        println!("| item | by | min | mean | max | budget | largest error |");
        println!("|---|---|---:|---:|---:|---:|---:|");
        let mut within = true;
        for row in tables.iter().copied().flatten() {
            within &= row.print(&counter);
        }
        if within { success() } else { failure() }
    }

    /// Counts, prints and tells whether the row is within its budget.
    fn print(&self, counter: &Counter) -> bool {
        let (mut least, mut most, mut sum, mut error) = (u32::MAX, 0, 0, 0.0_f64);
        for index in 0..SWEEP {
            let arguments = (self.arguments)(index);
            // SAFETY: rows pair functions with arguments made for them.
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

/// Forgets the signature of a function.
macro_rules! function {
    ($name:ident) => {
        // SAFETY: a function pointer is one word whatever it points to; `Row::new` says what it may be called with.
        unsafe { core::mem::transmute::<*const (), crate::call::Function>($name as *const ()) }
    };
}
pub(crate) use function;
