//! The experiments: hallservo's control code in a closed loop with the simulated motor, with figures and plots.

/// As that of the standard library, but a full output is said in words, and no panic.
macro_rules! println {
    () => { $crate::report::line(format_args!("")) };
    ($($text:tt)*) => { $crate::report::line(format_args!($($text)*)) };
}

pub mod experiment;
pub mod statistics;

pub use plots as report;

/// How much a long test tries: `few` in plain `cargo test`, so that nobody waits for it, and `all` with the environment
/// variable FULL, as `.ci/long` does. Who asks for more by ROTORS wants all of the rest, too.
pub fn of<T>(few: T, all: T) -> T {
    let full = ["FULL", "ROTORS"].iter().any(|name| std::env::var_os(name).is_some());
    if full { all } else { few }
}

/// Both of a pair with the environment variable FULL; in plain `cargo test` the first at even numbers, the second at odd.
pub fn either<T: Copy>(number: usize, pair: [T; 2]) -> impl Iterator<Item = T> {
    pair.into_iter().skip(of(number % 2, 0)).step_by(of(2, 1))
}

/// Over how many rotors, motors or cases a long test goes: a few, or what the environment variable ROTORS says.
///
/// # Panics
/// ROTORS that are no number: a run that is meant to be long is not to be short.
pub fn rotors(few: u64) -> u64 {
    std::env::var("ROTORS").map_or(few, |rotors| rotors.parse().expect("ROTORS is a number"))
}
