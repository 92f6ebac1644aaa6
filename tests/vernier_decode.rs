//! The vernier decoder against every reading that ideal rings can give, and against a scan of the whole table.

use baseline::rings::{PairTable, ZeroTable, decode_by_search};
use hallservo::vernier::decode::{AverageTable, IdealTable};
use hallservo::vernier::rings::Rings;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

/// What the vernier's head shows at a position in counts of the reference ring, rounded.
fn vernier_at(position: u64, p: u64, q: u64, bits: u8) -> u16 {
    (((2 * position * q + p) / (2 * p)) % (1 << bits)) as u16
}

/// Decodes every reading of a turn by every method.
fn check_every_reading(p: u8, q: u8, bits: u8) {
    let rings = Rings::new(p, q, bits).unwrap();
    let ideal = IdealTable::new(&rings);
    let average = AverageTable::new(&rings, &[0; 64]);
    let mut storage = vec![0; usize::from(p) << bits];
    let pairs = PairTable::new(rings, &mut storage).unwrap();
    let zeros = ZeroTable::new(rings);
    let shift = 16 - u32::from(bits);
    let largest_residual = ((i32::from(p) << shift) + 1) / 2;

    for position in 0..u64::from(p) << bits {
        let x = (position % (1 << bits)) as u16;
        let y = vernier_at(position, p.into(), q.into(), bits);
        let pole_pair = (position >> bits) as u8;

        for found in [pairs.decode(x, y), decode_by_search(&rings, x, y), zeros.decode(x, y)] {
            assert_eq!(found.pole_pair, pole_pair, "{p}/{q} {bits} {position}");
            assert!(found.distance.abs() <= 1);
            assert_eq!(u64::from(found.position(&rings, x)), position);
        }
        let decoded = ideal.decode(rings.reading(x), rings.reading(y));
        assert_eq!(decoded, average.decode(rings.reading(x), rings.reading(y)));
        assert_eq!(decoded.pole_pair, pole_pair, "{p}/{q} {bits} {position}");
        assert!(decoded.residual.abs() <= largest_residual, "{decoded:?}");
        let exact = ((u128::from(position) << 32) / (u128::from(p) << bits)) as i32;
        let error = decoded.angle.to_bits().wrapping_sub(exact);
        assert!(error.abs() <= 32, "{p}/{q} {bits} {position}: {error}");
    }
}

#[test]
fn every_reading_of_the_papers_rings_at_12_bit() {
    check_every_reading(37, 45, 12);
    check_every_reading(45, 37, 12);
}

#[test]
fn every_reading_at_8_10_14_and_16_bit() {
    for bits in [8, 10, 14, 16] {
        check_every_reading(37, 45, bits);
    }
}

#[test]
fn every_reading_of_other_rings() {
    let rings = [
        (2, 3),
        (3, 2),
        (3, 4),
        (5, 7),
        (7, 11),
        (8, 9),
        (16, 15),
        (1, 64),
        (64, 1),
        (23, 32),
        (31, 32),
        (36, 49),
        (50, 61),
        (63, 64),
        (64, 63),
    ];
    for (p, q) in rings {
        check_every_reading(p, q, 12);
    }
    check_every_reading(63, 64, 8);
}

/// Every pair of readings decodes to the entry that a scan of the table finds, whatever the averages are.
#[test]
fn two_entries_hold_the_nearest() {
    let mut random = Pcg32::seed_from_u64(4);
    for (p, q) in [(37, 45), (45, 37), (2, 3), (63, 64), (64, 63), (1, 64), (19, 7)] {
        let rings = Rings::new(p, q, 16).unwrap();
        for spread in [0, 100, 8_000, 32_767_i16] {
            let averages: [i16; 64] = core::array::from_fn(|_| random.random_range(-spread..=spread));
            let table = AverageTable::new(&rings, &averages);
            let corners = [(0, 0), (u16::MAX, 0), (0, u16::MAX), (u16::MAX, u16::MAX)];
            let anywhere = (0..20_000).map(|_| (random.random(), random.random()));
            for (x, y) in corners.into_iter().chain(anywhere) {
                check_nearest(&rings, &table, &averages, x, y);
            }
        }
    }
}

fn check_nearest(rings: &Rings, table: &AverageTable, averages: &[i16; 64], x: u16, y: u16) {
    use hallservo::vernier::rings::Ring::{Reference, Vernier};
    let p = i64::from(rings.pole_pairs(Reference));
    let q = i64::from(rings.pole_pairs(Vernier));
    let turn = p << 16;
    let difference = q * i64::from(x) - p * i64::from(y);
    // Distance from the average of a pole pair, on the circle of p entries.
    let distance = |k: i64| {
        let entry = i64::from(averages[k as usize]) - ((q * k) << 16);
        let ahead = (difference - entry).rem_euclid(turn);
        if ahead > turn / 2 { ahead - turn } else { ahead }
    };
    let nearest = (0..p).map(|k| distance(k).abs()).min().unwrap();
    let decoded = table.decode(x, y);
    let found = distance(decoded.pole_pair.into());
    assert_eq!(found.abs(), nearest, "{rings:?} {x} {y} {decoded:?}");
    // With one or two pole pairs an entry can be as near one way round as the other.
    if p > 2 {
        assert_eq!(i64::from(decoded.residual), found);
    }
}

/// The margin is what it is said to be: a bit less decodes, a bit more does not.
#[test]
fn the_margin_is_the_margin() {
    let rings = Rings::new(37, 45, 16).unwrap();
    let table = IdealTable::new(&rings);
    let margin = rings.margin().counts;
    for position in (0..37_u64 << 16).step_by(1009) {
        let (x, y) = (position as u16, vernier_at(position, 37, 45, 16));
        let pole_pair = (position >> 16) as u8;
        for sign in [1.0, -1.0] {
            let shifted = |counts: f32| y.wrapping_add((sign * counts) as i16 as u16);
            assert_eq!(table.decode(x, shifted(margin - 1.5)).pole_pair, pole_pair);
            assert_ne!(table.decode(x, shifted(margin + 1.5)).pole_pair, pole_pair);
        }
    }
}
