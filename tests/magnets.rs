//! Rotors with uneven magnets: what `cargo run --release -- magnets` measures on many.

use sim::experiment::magnets::{kinds, measure};

/// The short form has two rotors, the whole one six.
#[test]
fn the_map_takes_off_what_uneven_magnets_do_to_the_angle() {
    let cheap = kinds().into_iter().find(|kind| kind.name.contains("cheap")).unwrap();
    let row = measure(&cheap, 1..sim::of(3, 7)).unwrap();
    for (seed, (calibrated, mapped)) in row.rotors.iter().zip(&row.mapped).enumerate() {
        println!("{seed}: {calibrated:?} becomes {mapped:?}");
        // The rotor is as bad as it is meant to be, or the map would have nothing to do.
        assert!(calibrated.steady_deg_rms > 1.0, "{seed}");
        assert!(mapped.steady_deg_rms < 0.2 && mapped.reversing_deg_rms < 0.3, "{seed}: {mapped:?}");
    }
}
