//! The experiments: hallservo's control code in a closed loop with the simulated motor, with figures and plots.

pub mod experiment;
pub mod paper_filter;
pub mod rig;
pub mod statistics;

pub use plots as report;

/// A result for each number of a range, in its order, computed on all cores.
pub fn parallel<T: Send>(range: std::ops::Range<u64>, work: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let work = &work;
    let share = |core: u64| {
        let own = range.clone().filter(move |number| number % cores == core);
        move || own.map(|number| (number, work(number))).collect::<Vec<_>>()
    };
    let mut results = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|core| scope.spawn(share(core))).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("a worker panicked")).collect::<Vec<_>>()
    });
    results.sort_by_key(|(number, _)| *number);
    results.into_iter().map(|(_, result)| result).collect()
}
