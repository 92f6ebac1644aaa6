//! Samples that lack a current.

use super::*;

/// A sum that is wrong: of 150 steps, those that lack a current, and how it ends.
fn watched(lacks: impl Fn(u32) -> bool) -> Mode {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    bench.arm();
    let sample = Sample { currents: [2048, 2448, 2048], ..healthy(bench.model.codes(bench.rotor)) };
    for k in 0..150 {
        if lacks(k) {
            // A vector of which B is on top.
            bench.drive.leave_out(900, 1700, -30);
        }
        bench.drive.step(&sample);
    }
    bench.mode()
}

#[test]
fn the_sum_is_watched_in_the_others() {
    let imbalance = Mode::Faulted(Fault::CurrentImbalance);
    assert_eq!(watched(|_| false), imbalance);
    // Where B follows from the other two, nothing tells that it was wrong.
    assert_eq!(watched(|_| true), Mode::Running);
    // Eight of sixteen: every second check. It neither proves nor disproves.
    assert_eq!(watched(|k| k / 8 % 2 == 0), imbalance);
}
