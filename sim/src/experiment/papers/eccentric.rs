//! What rings off the axis do to the vernier: the worked case, opposite heads, the paper's construction.

use super::claim::{Claim, Figure};
use super::rings::{PAIRS, claim};
use crate::experiment::vernier;
use crate::report::{Plot, Series};
use anyhow::Result;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::eccentricity::{Geometry, ring_angle};
use hallservo::vernier::encoder::{Calibration, Encoder};
use hallservo::vernier::rings::Rings;
use plant::construction::{Construction, Imperfections};
use plant::rings::Ring;
use std::f64::consts::{PI, TAU};

/// The worked case: mm, degrees, mm.
const RADII_MM: [f64; 2] = [14.0, 12.0];
pub const HEADS_DEG: f64 = 40.0;
pub const ECCENTRICITY_MM: f64 = 0.05;

/// Peak of (12) by exact geometry, degrees.
fn exact_deg(radii_mm: [f64; 2], heads_deg: f64, eccentricity_mm: f64) -> f64 {
    let heads = heads_deg.to_radians();
    let beta = |radius: f64, angle: f64| (radius * angle.sin()).atan2(radius * angle.cos() + eccentricity_mm);
    let error = |shaft: f64| {
        let error = beta(radii_mm[0], shaft) - beta(radii_mm[1], shaft - heads) - heads;
        (error - TAU * (error / TAU).round()).abs()
    };
    (0..7200).map(|k| error(TAU * f64::from(k) / 7200.0)).fold(0.0, f64::max).to_degrees()
}

/// Eq. (19), with the sign of its last term.
fn formula_deg(sign: f64, heads_deg: f64) -> f64 {
    let [a, b] = RADII_MM.map(|radius| 1.0 / radius);
    (a * a + b * b + sign * 2.0 * a * b * heads_deg.to_radians().cos()).sqrt().to_degrees() * ECCENTRICITY_MM
}

/// The worked case.
pub fn worked_case() -> Claim {
    let exact = exact_deg(RADII_MM, HEADS_DEG, ECCENTRICITY_MM);
    let library = Geometry {
        reference_radius: RADII_MM[0] as f32,
        vernier_radius: RADII_MM[1] as f32,
        head_angle: HEADS_DEG.to_radians() as f32,
    };
    let angles = || (0..=36).map(|k| 5.0 * f64::from(k));
    let series = vec![
        Series::new("exact geometry, (10) to (12)", angles().map(|at| (at, exact_deg(RADII_MM, at, ECCENTRICITY_MM)))),
        Series::new("(19), corrected", angles().map(|at| (at, formula_deg(-1.0, at)))),
        Series::new("(19), as printed", angles().map(|at| (at, formula_deg(1.0, at)))),
    ];
    Claim {
        seen: "Rings that are 0.05 mm off the axis make the two heads contradict each other. The closer the heads sit, \
               the less: the print says the opposite.",
        equation: "(19)  max = e √(1/r₁² + 1/r₂² − 2 cos Θ / (r₁ r₂))          printed with +",
        conditions: "r₁ = 14 mm, r₂ = 12 mm, Θ = 40°, e = 0.05 mm, as printed.",
        conclusion: format!(
            "With a minus the formula is that of exact geometry. So the angle of the heads does matter: {:.3}° with \
             heads in line, {:.3}° with opposite ones.",
            exact_deg(RADII_MM, 0.0, ECCENTRICITY_MM),
            exact_deg(RADII_MM, 180.0, ECCENTRICITY_MM)
        ),
        erratum: Some(
            "(17) is the difference of two sines; (18) to (20) give the amplitude of their sum. So 8.34 °/mm and \
             0.417° are 2.7 times too large, and “r₁, r₂ and Θ do not play a significant role” does not hold.",
        ),
        figures: vec![
            Figure::new("largest error by the printed formula", "°", formula_deg(1.0, HEADS_DEG))
                .reproduces(0.417, 2e-3),
            Figure::new("largest error by the corrected formula", "°", formula_deg(-1.0, HEADS_DEG)).corrects(0.417),
            Figure::new("largest error by exact geometry", "°", exact).corrects(0.417),
            Figure::new("sensitivity", "°/mm", f64::from(library.sensitivity().to_degrees())).corrects(8.3357),
            Figure::new("with heads in line", "°", exact_deg(RADII_MM, 0.0, ECCENTRICITY_MM)),
            Figure::new("with opposite heads", "°", exact_deg(RADII_MM, 180.0, ECCENTRICITY_MM)),
        ],
        plots: vec![(
            Plot::new("Largest contradiction of two heads", "angle between the heads Θ / °", "error / °", series),
            "The printed formula and the corrected one cross at 90° only.",
        )],
        ..claim("Eq. (10) to (20)", "the worked case of eccentricity")
    }
}

/// Peak error in degrees of one head and of the mean of two opposite ones, without its constant.
fn pair_deg(misplaced_deg: f64) -> f64 {
    let ring = Ring { radius_mm: RADII_MM[0], eccentricity_mm: ECCENTRICITY_MM, ..Ring::new(45, 2.0) };
    let near = |angle: f64| angle - TAU * (angle / TAU).round();
    let mean = |shaft: f64| {
        let one = near(ring.angle_under(0.0, shaft) - shaft);
        one + near(ring.angle_under(PI + misplaced_deg.to_radians(), shaft) + PI - shaft - one) / 2.0
    };
    let errors: Vec<_> = (0..3600).map(|k| mean(TAU * f64::from(k) / 3600.0)).collect();
    let constant = errors.iter().sum::<f64>() / errors.len() as f64;
    errors.iter().map(|error| (error - constant).abs()).fold(0.0, f64::max).to_degrees()
}

/// Opposite heads.
pub fn opposite_heads() -> Claim {
    let ratio = (ECCENTRICITY_MM / RADII_MM[0]) as f32;
    let one = (0..3600)
        .map(|k| TAU as f32 * k as f32 / 3600.0)
        .map(|shaft| {
            let error = ring_angle(ratio, shaft) - shaft;
            (error - TAU as f32 * (error / TAU as f32).round()).abs()
        })
        .fold(0.0, f32::max);
    let degrees = || (0..=20).map(|k| f64::from(k) / 10.0);
    Claim {
        seen: "A second head opposite the first one sees the eccentricity with the other sign. Their mean is nearly \
               free of it, even if the second head is some degrees off.",
        equation: "(β + β′)/2 = α − ε/2 − (e/r) sin(ε/2) cos(α − ε/2) + (e/r)²/2 cos ε sin(2α − ε) + …",
        conditions: "r = 14 mm, e = 0.05 mm, exact geometry, the constant ε/2 removed. Our copy of the paper lacks \
                     equations (22) to (29); this one is derived from (16).",
        conclusion: "Two degrees of placement error leave a 57th of what one head has.".into(),
        figures: vec![
            Figure::new("one head, largest error", "°", f64::from(one.to_degrees())),
            Figure::new("two exactly opposite heads", "°", pair_deg(0.0)),
            Figure::new("the second 0.5° off", "°", pair_deg(0.5)),
            Figure::new("the second 1° off", "°", pair_deg(1.0)),
            Figure::new("the second 2° off", "°", pair_deg(2.0)),
        ],
        plots: vec![(
            Plot::new(
                "What opposite heads leave of the eccentricity",
                "placement error ε / °",
                "largest error / °",
                vec![Series::new("mean of two heads", degrees().map(|at| (at, pair_deg(at))))],
            ),
            "By exact geometry.",
        )],
        ..claim("Eq. (21) to (29), Fig. 6", "opposite heads")
    }
}

/// Share of wrong pole pairs in per cent, and the largest residual, of ideal rings that are merely eccentric.
fn eccentric<const HEADS: usize>(eccentricity_mm: f64, seed: u64) -> Result<(f64, f64)> {
    let rings = Rings::new(37, 45, 12)?;
    let imperfections = Imperfections { eccentricity_mm, ..Imperfections::NONE };
    let mut construction = Construction::new([37, 45], 2.0, HEADS_DEG.to_radians(), 12, &imperfections, seed);
    for ring in &mut construction.rings {
        ring.eccentricity_direction_rad = 0.0;
    }
    let encoder = Encoder::<HEADS>::new(&rings, &Calibration::ideal(&rings), MechanicalAngle::from_degrees(1.0))?;
    let (mut wrong, mut residual) = (0, 0);
    const POSITIONS: u32 = 20_000;
    for position in 0..POSITIONS {
        let turns = (f64::from(position) + 0.5) / f64::from(POSITIONS);
        let decoded = encoder.decode(vernier::read(&rings, &mut construction, turns * TAU));
        let error = f64::from(decoded.angle.to_bits() as u32) / 2f64.powi(32) - turns;
        wrong += u32::from((error - error.round()).abs() > 0.5 / PAIRS[0]);
        residual = residual.max(decoded.residual.abs());
    }
    Ok((100.0 * f64::from(wrong) / f64::from(POSITIONS), rings.residual_counts(residual).into()))
}

/// The paper's rings off the axis.
///
/// # Errors
/// None: the rings are coprime.
pub fn construction(seed: u64) -> Result<Claim> {
    let share = |tenth: u32| eccentric::<1>(f64::from(tenth) / 200.0, seed).map(|(wrong, _)| wrong);
    let curve = (0..=12).map(|k| Ok((f64::from(k) / 200.0, share(k)?))).collect::<Result<Vec<_>>>()?;
    let radius = |pairs: f64| pairs * 2.0 / TAU;
    let (pairs_wrong, pairs_residual) = eccentric::<2>(0.3, seed)?;
    Ok(Claim {
        seen: "The paper built a ring of ferrite with 37 and 45 pole pairs of 2 mm under 12-bit heads. With one head \
               a ring, 40° apart, it fails if the rings are 0.035 mm off the axis; with opposite heads 0.3 mm do no \
               harm.",
        equation: "r = pp · L / 2π;   margin = ± N / (2 pp_i) counts",
        conditions: "37 and 45 pole pairs, L = 2 mm, 12 bit, as printed; ideal rings but for the eccentricity, table \
                     for ideal rings, 20 000 positions. The angle of the heads is that of the worked case: the paper \
                     does not give that of its construction, nor its eccentricity.",
        conclusion: "The radii that follow from the pole pairs, 14.3 and 11.8 mm, are those of the worked case.".into(),
        figures: vec![
            Figure::new("radius of the outer ring", "mm", radius(PAIRS[1])).reproduces(RADII_MM[0], 0.03),
            Figure::new("radius of the inner ring", "mm", radius(PAIRS[0])).reproduces(RADII_MM[1], 0.03),
            Figure::new("wrong pole pairs at 0.030 mm, one head a ring", "%", eccentric::<1>(0.030, seed)?.0),
            Figure::new("wrong pole pairs at 0.035 mm", "%", eccentric::<1>(0.035, seed)?.0),
            Figure::new("wrong pole pairs at 0.05 mm", "%", eccentric::<1>(0.05, seed)?.0),
            Figure::new("wrong pole pairs at 0.3 mm, opposite heads", "%", pairs_wrong),
            Figure::new("largest residual there, of 55.35", "counts", pairs_residual),
        ],
        plots: vec![(
            Plot::new(
                "Wrong pole pairs with one head a ring",
                "eccentricity / mm",
                "wrong positions / %",
                vec![Series::new("heads 40° apart", curve)],
            ),
            "Nothing is wrong up to 0.030 mm; then it fails at once.",
        )],
        ..claim("Section V", "the construction with 37 and 45 pole pairs")
    })
}
