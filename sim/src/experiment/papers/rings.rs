//! The vernier paper: its table and three methods, its errors and what compensates them.

use super::claim::{Claim, Figure, Paper};
use super::eccentric::{self, ECCENTRICITY_MM, HEADS_DEG};
use crate::experiment::Common;
use crate::experiment::vernier::plots::Bench;
use crate::experiment::vernier::{self, Build, Options};
use crate::report::Plot;
use anyhow::{Context, Result};
use baseline::rings::{PairTable, ZeroTable, decode_by_search};
use hallservo::vernier::decode::{AverageTable, IdealTable};
use hallservo::vernier::rings::Rings;

/// Counts of a head to a pole pair, and pole pairs of the rings.
const COUNTS: f64 = 4096.0;
pub const PAIRS: [f64; 2] = [37.0, 45.0];
/// Half the distance of two values of the table, counts.
const MARGIN: f64 = COUNTS / 2.0 / PAIRS[0];

/// All of the paper.
///
/// # Errors
/// None: the rings are coprime.
pub fn claims(seed: u64) -> Result<Vec<Claim>> {
    let build = |pairs| Build { eccentricity: ECCENTRICITY_MM, head_angle: HEADS_DEG, pairs };
    let mut bench = Bench::<2>::new(&build(true), seed)?;
    let mut claims = vec![
        stored_values(&mut bench),
        methods()?,
        eccentric::worked_case(),
        eccentric::opposite_heads(),
        eccentric::construction(seed)?,
    ];
    claims.push(linearity(&mut bench));
    claims.push(selection(&mut bench));
    claims.push(table_values(&mut bench));
    claims.push(ordinals(&mut bench, [build(false), build(true)], seed)?);
    Ok(claims)
}

/// A claim of this paper with nothing in it.
pub fn claim(place: &'static str, title: &'static str) -> Claim {
    Claim {
        paper: Paper::Vernier,
        place,
        title,
        seen: "",
        equation: "",
        conditions: "",
        conclusion: String::new(),
        erratum: None,
        figures: Vec::new(),
        table: Vec::new(),
        plots: Vec::new(),
    }
}

fn stored_values(bench: &mut Bench<2>) -> Claim {
    let mut values: Vec<_> = (0..37).map(|k| (PAIRS[1] * f64::from(k) / PAIRS[0]).rem_euclid(1.0) * COUNTS).collect();
    values.sort_by(f64::total_cmp);
    let least = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::MAX, f64::min);
    Claim {
        seen: "Wherever the inner ring shows zero, the outer one shows another value: 37 values, evenly spread, tell \
               which of the 37 pole pairs it is. Their distance is what all errors together may not exceed by \
               half.",
        equation: "(2), (3)  X_o[k] = mod(r₂/r₁ · (x_i + (k−1) N)),  k = 1 … pp_i;     distance d = N / pp_i",
        conditions: "37 and 45 pole pairs, 12 bit, x_i = 0, ideal rings; “calibrated” has eccentric ones.",
        conclusion: "The paper gives the formula d = N/pp_i without its value for its own rings.".into(),
        erratum: Some(
            "(1) and (2) print (x_i + (k−1)·pp_i) and k = 1 … N: a turn has pp_i pole pairs of N counts, as in (3).",
        ),
        figures: vec![
            Figure::new("least distance of two values", "counts", least).reproduces(COUNTS / PAIRS[0], 1e-9),
            Figure::new("margin, half of it", "counts", least / 2.0),
            Figure::new("margin, mechanical", "°", least / 2.0 / COUNTS / PAIRS[1] * 360.0),
        ],
        plots: vec![(bench.stored_values(), "The table, ideal and as the calibration averages it.")],
        ..claim("Fig. 2", "the stored values")
    }
}

/// Wrong pole pairs of each of the paper's methods and of ours, over every reading of a turn.
fn wrong(rings: &Rings, pairs: &PairTable) -> [usize; 4] {
    let (ideal, zeros) = (IdealTable::new(rings), ZeroTable::new(*rings));
    let mut wrong = [0; 4];
    for position in 0..37 * 4096_u32 {
        let x = (position & 4095) as u16;
        let y = ((2 * position * 45 + 37) / 74) as u16 & 4095;
        let ours = ideal.decode(rings.reading(x), rings.reading(y)).pole_pair;
        let paper = [pairs.decode(x, y), decode_by_search(rings, x, y), zeros.decode(x, y)];
        let found = [paper[0].pole_pair, paper[1].pole_pair, paper[2].pole_pair, ours];
        for (wrong, found) in wrong.iter_mut().zip(found) {
            *wrong += usize::from(u32::from(found) != position >> 12);
        }
    }
    wrong
}

/// Instructions of a row of the counts, as last printed on the emulated Cortex-M4F: `boards/mps2-an386`, `count`.
fn instructions(item: &str, by: &str) -> Result<f64> {
    let counts = include_str!("../../../../docs/recorded/count.md");
    let row = counts.lines().find(|row| row.starts_with(&format!("| {item} | {by} |"))).context("no such row")?;
    Ok(row.split('|').nth(5).context("no largest count")?.trim().parse()?)
}

fn methods() -> Result<Claim> {
    let rings = Rings::new(37, 45, 12)?;
    let mut storage = vec![0; 37 * 4096];
    let words = storage.len();
    let pairs = PairTable::new(rings, &mut storage).context("a table of all pairs")?;
    let wrong = wrong(&rings, &pairs);
    let counts = |by| instructions("two rings → angle", by);
    let [stored, computed, combined, ours] =
        ["paper, all pairs stored", "paper, all computed", "paper, 37 stored", "hallservo"].map(counts);
    let (stored, computed, combined, ours) = (stored?, computed?, combined?, ours?);
    let row = |name: &str, bytes: usize, looks: &str, instructions: f64, wrong: usize| {
        vec![name.to_string(), bytes.to_string(), looks.into(), instructions.to_string(), wrong.to_string()]
    };
    let head =
        ["method", "table, bytes", "entries looked at", "instructions", "wrong of 151552"].map(String::from).to_vec();
    let (ideal, average) = (size_of::<IdealTable>(), size_of::<AverageTable>());
    Ok(Claim {
        seen: "The paper offers three ways from two readings to the pole pair, and takes the third as the best for an \
               8-bit controller. All three are right; here none of the 37 entries has to be searched, for the place in \
               the table is computed.",
        equation: "first: a table of all pairs     second: (3), computed for each k     third: (8) z = mod(x_o − \
                   r₂/r₁ x_i), then a search of 37 values\n\
                   here: u = 45 x_i − 37 x_o is close to a whole number n of N counts; n is the index of the table",
        conditions: "37 and 45 pole pairs, 12 bit, every reading of ideal rings. Instructions at most, from two \
                     readings to the angle, on an emulated Cortex-M4F (boards/mps2-an386, count), as last recorded; \
                     the paper's methods in integers like ours, and with the same product for the angle. The paper \
                     gives none.",
        conclusion: format!(
            "The search makes the difference: {stored} to {computed} instructions with it, {ours} without. The \
             averages of rings as they are take a table of {average} bytes, of which two entries are looked at; \
             correction, average and check against the past make it {} instructions.",
            instructions("the same, corrected and checked", "hallservo")?
        ),
        figures: vec![
            Figure::new("table of the first method", "bytes", 2.0 * words as f64),
            Figure::new("values that the third method stores", "", PAIRS[0]).reproduces(37.0, 0.0),
            Figure::new("table here, ideal rings", "bytes", ideal as f64),
            Figure::new("table here, averaged rings", "bytes", average as f64),
            Figure::new("instructions against the first method", "", ours).improves_on(stored),
            Figure::new("instructions against the second method", "", ours).improves_on(computed),
            Figure::new("instructions against the third method", "", ours).improves_on(combined),
            Figure::new("readings at which the methods are wrong", "", wrong.iter().sum::<usize>() as f64),
        ],
        table: vec![
            head,
            row("first: all pairs stored", 2 * words, "37", stored, wrong[0]),
            row("second: all values computed", 0, "37", computed, wrong[1]),
            row("third: one computed, 37 stored", 74, "37", combined, wrong[2]),
            row("here, ideal rings", ideal, "1", ours, wrong[3]),
        ],
        ..claim("Eq. (1) to (9)", "three ways to the pole pair")
    })
}

/// Options of the experiment `vernier` without faults.
fn options(build: Build, seed: u64) -> Options {
    let common = Common { seed, json: None, out: "report".into() };
    Options { common, build, positions: 20_000, trials: 0 }
}

/// Largest magnitude of a series.
fn largest(plot: &Plot, series: usize) -> f64 {
    plot.series[series].points.iter().map(|point| point.1.abs()).fold(0.0, f64::max)
}

fn linearity(bench: &mut Bench<2>) -> Claim {
    let plot = bench.linearity();
    let figures = vec![
        Figure::new("largest error of a head as read", "counts", largest(&plot, 0)),
        Figure::new("largest error of a head corrected", "counts", largest(&plot, 1)),
    ];
    Claim {
        seen: "A magnet's field is not a perfect sine, so a head errs within each pole pair in the same way. A table \
               takes it off.",
        equation: "corrected reading = reading − table[reading]",
        conditions: "2° of first and second harmonic, one count of noise in the calibration, none here. The paper \
                     calls its figure the nature of the error and gives no scale.",
        conclusion: "What is left is mostly the rounding of the head, a count.".into(),
        figures,
        plots: vec![(plot, "One head over a pole pair.")],
        ..claim("Fig. 4", "the error of a head within a pole pair")
    }
}

fn selection(bench: &mut Bench<2>) -> Claim {
    let (all, selected) = bench.pole_pairs();
    // A curve for each pole pair.
    let curves = |name: &str| selected.series.iter().filter(|series| series.name == name).count() as f64;
    let (kept, omitted) = (curves("kept"), curves("omitted"));
    Claim {
        seen: "The error of a head is found without a better encoder: turn the shaft, take off the trend, lay the \
               pole pairs over each other and average those that are alike. Where the speed jumps, a pole pair is \
               left out.",
        equation: "(30)  S_i = 100 (1 − ‖f_i − f̄‖ / ‖f̄ − mean f̄‖) %",
        conditions: "A shaft whose speed varies by 5 %; in the second figure it is jolted over a tenth of the turn. \
                     The paper gives neither its speeds nor its threshold; here −100 %.",
        conclusion: "The calibration refuses a run of which it would have to omit more than a quarter.".into(),
        erratum: Some(
            "(30) is printed as 100 (1 − ‖f_i − f̄‖) / ‖f̄ − f̄‖, which divides by zero: read as the usual fit.",
        ),
        figures: vec![
            Figure::new("pole pairs of the jolted turn kept", "", kept),
            Figure::new("pole pairs of the jolted turn omitted", "", omitted),
        ],
        plots: vec![(all, "Fig. 7: all pole pairs of a turn."), (selected, "Fig. 8: kept, omitted, and the average.")],
        ..claim("Fig. 7, 8", "the error of a head, found by turning")
    }
}

/// By how far each curve strays from its middle at most, counts.
fn spread(plot: &Plot) -> f64 {
    let one = |points: &[(f64, f64)]| {
        let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p.1), high.max(p.1)));
        (high - low) / 2.0
    };
    plot.series.iter().map(|series| one(&series.points)).fold(0.0, f64::max)
}

fn table_values(bench: &mut Bench<2>) -> Claim {
    let (uncompensated, compensated) = (bench.uncompensated(), bench.compensated());
    Claim {
        seen: "The measured values should be straight lines at the same distance. Uncompensated they run into each \
               other, and the pole pair is ambiguous; with opposite heads and corrected they keep apart.",
        equation: "z_o = mod(x_o − r₂/r₁ · x_i), over x_i\n\
                   unambiguous while each stays within ± N / (2 pp_i) = ± 55.35 counts",
        conditions: "37 and 45 pole pairs, 0.05 mm eccentric, heads 40° apart, 2° of first and second harmonic, \
                     opposite heads up to 1° off. The paper gives no eccentricity for its figure.",
        conclusion: format!(
            "Uncompensated the curves take {:.2} of the margin, so that they meet; compensated {:.2}.",
            spread(&uncompensated) / MARGIN,
            spread(&compensated) / MARGIN
        ),
        figures: vec![
            Figure::new("a curve strays from its middle by, uncompensated", "counts", spread(&uncompensated)),
            Figure::new("a curve strays from its middle by, compensated", "counts", spread(&compensated)),
        ],
        plots: vec![
            (uncompensated, "Fig. 9 a: one head a ring, uncorrected."),
            (compensated, "Fig. 9 b: opposite heads averaged, corrected."),
        ],
        ..claim("Fig. 9", "values of the table, uncompensated and compensated")
    }
}

fn ordinals(bench: &mut Bench<2>, [single, pairs]: [Build; 2], seed: u64) -> Result<Claim> {
    let (single, pairs) = (vernier::run(&options(single, seed))?, vernier::run(&options(pairs, seed))?);
    let share = |wrong: usize, positions: usize| 100.0 * wrong as f64 / positions as f64;
    Ok(Claim {
        seen: "The number of the pole pair should rise like a staircase. Uncompensated it jumps about; compensated it \
               does not miss a step.",
        equation: "(9)  α = (x_i + (k − 1) N) / (pp_i N) · 2π",
        conditions: "As for Fig. 9; 20 000 random positions. The paper shows curves without numbers.",
        conclusion:
            "So the linearity can be had without expensive equipment, as the paper says: the calibration takes \
                     some turns of the shaft at any roughly steady speed."
                .into(),
        figures: vec![
            Figure::new(
                "wrong pole pairs, one head a ring, uncompensated",
                "%",
                share(single.uncalibrated_wrong_pole_pairs, single.positions),
            ),
            Figure::new("wrong pole pairs, compensated", "%", share(pairs.wrong_pole_pairs, pairs.positions)),
            Figure::new("error compensated, without the constant, RMS", "°", pairs.error_deg_rms),
            Figure::new("error compensated, largest", "°", pairs.error_deg_max),
        ],
        plots: vec![
            (bench.readings(), "Fig. 10, top: readings of the first heads."),
            (bench.ordinals(), "Fig. 10, middle and bottom: the number of the pole pair."),
        ],
        ..claim("Fig. 10", "the pole pair, found")
    })
}
