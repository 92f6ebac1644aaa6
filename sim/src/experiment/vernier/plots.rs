//! The paper's Figures 2, 4, 7, 8, 9 and 10, before and after compensation.

use super::{Build, Options, Summary, calibrate, read};
use crate::report::{Plot, Report, Series};
use anyhow::Result;
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::calibrate::curve;
use hallservo::vernier::correct::NODES;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use plant::construction::{Construction, UnsteadyShaft};
use std::f64::consts::TAU;

/// Counts of a 12-bit head to a pole pair.
const COUNTS: f64 = 4096.0;
/// Pole pairs of the rings.
const PAIRS: [f64; 2] = [37.0, 45.0];

/// The report with all plots.
///
/// # Errors
/// Nothing to plot.
pub fn report(options: &Options, summary: &Summary) -> Result<Report> {
    let mut report = Report::new("Vernier: absolute angle from two rings");
    report.lead(
        "Two rings with 37 and 45 pole pairs know the absolute angle at power-up. Off the axis they contradict each \
         other; calibrated they do not.",
    );
    if let Some(refusal) = &summary.refusal {
        report.text(&format!("Calibration refused: {refusal}. The encoder goes on uncalibrated."));
    }
    let plots = if options.build.pairs {
        Bench::<2>::new(&options.build, options.common.seed)?.plots()
    } else {
        Bench::<1>::new(&options.build, options.common.seed)?.plots()
    };
    for (plot, caption) in plots {
        report.plot(&plot, caption)?;
    }
    report.heading("Figures").table(&summary.table());
    if !summary.faults.is_empty() {
        report.heading("Faults injected into the running encoder").table(&summary.fault_table());
    }
    Ok(report)
}

/// An encoder on the bench, and its calibration.
pub struct Bench<const HEADS: usize> {
    rings: Rings,
    construction: Construction,
    ideal: Calibration<HEADS>,
    calibration: Calibration<HEADS>,
    seed: u64,
}

impl<const HEADS: usize> Bench<HEADS> {
    /// Built and calibrated.
    ///
    /// # Errors
    /// None: a calibration that is refused leaves the ideal one.
    pub fn new(build: &Build, seed: u64) -> Result<Self> {
        let rings = build.rings()?;
        let mut construction = build.construction(seed);
        let ideal = Calibration::ideal(&rings);
        // A refused calibration leaves the ideal one, and plots that show why.
        let calibration =
            calibrate(build, &mut construction, seed).map_or(ideal.clone(), |(calibration, _)| calibration);
        Ok(Self { rings, construction, ideal, calibration, seed })
    }

    /// All of them, each with its caption.
    fn plots(&mut self) -> Vec<(Plot, &'static str)> {
        let (all, selected) = self.pole_pairs();
        vec![
            (
                self.stored_values(),
                "What the vernier shows where the reference is at zero, for ideal rings and as averaged by the \
                 calibration (Bakos et al., Figure 2).",
            ),
            (self.linearity(), "Error of one head over a pole pair, before and after correction (Figure 4)."),
            (all, "Readings less the trend, the pole pairs of a turn over each other (Figure 7)."),
            (
                selected,
                "The same when the shaft is jolted: pole pairs unlike the average are omitted from it (Figure 8).",
            ),
            (
                self.uncompensated(),
                "z over the place in the pole pair for six entries that are neighbours in the table, one head a ring, \
                 uncorrected (Figure 9 a).",
            ),
            (self.compensated(), "The same with all heads averaged and corrected (Figure 9 b)."),
            (self.readings(), "Readings of the first heads (Figure 10, top)."),
            (
                self.ordinals(),
                "Number of the pole pair without and with calibration; right is a staircase (Figure 10, middle and \
                 bottom).",
            ),
        ]
    }

    /// Figure 9 a.
    pub fn uncompensated(&mut self) -> Plot {
        self.table_values("Table values, uncompensated", &self.ideal.clone(), true)
    }

    /// Figure 9 b.
    pub fn compensated(&mut self) -> Plot {
        self.table_values("Table values, compensated", &self.calibration.clone(), false)
    }

    /// Figure 2.
    pub fn stored_values(&self) -> Plot {
        let value = |k: usize, average: f64| {
            // z = −u / p, and u = −q·k + average at the zeros of the reference.
            let z = (PAIRS[1] * k as f64 - average / 65536.0) / PAIRS[0];
            (k as f64, z.rem_euclid(1.0) * COUNTS)
        };
        let ideal = (0..37).map(|k| value(k, 0.0));
        let measured = (0..37).map(|k| value(k, self.calibration.averages[k].into()));
        Plot::new(
            "Stored values",
            "pole pair",
            "z / counts",
            vec![Series::new("ideal", ideal), Series::new("calibrated", measured)],
        )
    }

    /// Figure 4.
    pub fn linearity(&mut self) -> Plot {
        let curve = self.calibration.reference[0];
        let (head, ring) = (&self.construction.heads[0][0], &self.construction.rings[0]);
        let mut series = [("as read", Vec::new()), ("corrected", Vec::new())];
        for step in 0..1000 {
            let shaft = f64::from(step) / 1000.0 * TAU / PAIRS[0];
            // What eccentricity does is not the head's: the place on the ring is the truth.
            let place = ring.angle_under(head.mounted_rad, shaft) * PAIRS[0] / TAU;
            let reading = self.rings.reading(head.digital(ring, shaft, 0.5));
            for ((_, points), reading) in series.iter_mut().zip([reading, curve.correct(reading)]) {
                let error = f64::from(reading) / 65536.0 - place;
                points.push((place * 360.0, (error - error.round()) * COUNTS));
            }
        }
        let series = series.map(|(name, points)| Series::new(name, points)).to_vec();
        Plot::new("Linearity error", "place in the pole pair / ° electrical", "error / counts", series)
    }

    /// The pole pairs of a turn of one head, and those of a jolted turn with the average of those kept.
    pub fn pole_pairs(&mut self) -> (Plot, Plot) {
        let steady = self.curve_run(0.0);
        let all = steady.curves().enumerate();
        let all = all.map(|(k, curve)| Series::new(format!("pole pair {}", k + 1), points(&curve))).collect();
        let jolted = self.curve_run(0.4);
        let mut selected = Vec::new();
        if let Ok(average) = jolted.average() {
            let named = |kept| if kept { "kept" } else { "omitted" };
            let curves = jolted.curves().zip(average.kept);
            selected.extend(curves.map(|(curve, kept)| Series::new(named(kept), points(&curve))));
            selected.push(Series::new("average", points(&average.errors)));
        }
        let plot = |title, series| Plot::new(title, "reading / ° electrical", "error / counts", series);
        (plot("Pole pairs over each other", all), plot("Selection of pole pairs", selected))
    }

    /// A turn of the first head over the reference ring; `jolt` speeds the shaft up by that share for a tenth of it.
    fn curve_run(&mut self, jolt: f64) -> curve::Run {
        let mut run = curve::Run::new(37);
        let mut shaft = UnsteadyShaft::new(TAU / super::build::SAMPLES_A_TURN, super::build::RIPPLE, self.seed);
        let mut ahead = 0.0;
        for _ in 0..2 * super::build::SAMPLES_A_TURN as usize {
            let angle = shaft.turn();
            let within = (angle / TAU).rem_euclid(1.0);
            if within < 0.1 {
                ahead += jolt * (within * 10.0 * TAU).sin() * TAU / super::build::SAMPLES_A_TURN;
            }
            let reading: Reading<HEADS> = read(&self.rings, &mut self.construction, angle + ahead);
            // An error would end the run early, which the plot shows.
            if run.push(reading.reference[0]).unwrap_or(true) {
                break;
            }
        }
        run
    }

    fn table_values(&mut self, title: &str, calibration: &Calibration<HEADS>, first_heads: bool) -> Plot {
        let mut series: Vec<_> = (0..6).map(|n| Series::new(format!("n = {n}"), [])).collect();
        let limit = MechanicalAngle::from_degrees(1.0);
        let Ok(encoder) = Encoder::new(&self.rings, calibration, limit) else {
            return Plot::new(title, "", "", series);
        };
        for step in 0..37 * 400 {
            let turns = f64::from(step) / (37.0 * 400.0);
            let mut reading: Reading<HEADS> = read(&self.rings, &mut self.construction, turns * TAU);
            if first_heads {
                for head in 1..HEADS {
                    // Every head shows what the first one does.
                    let phase = |curve: &hallservo::vernier::correct::Curve| (curve.phase.to_bits() >> 16) as u16;
                    reading.reference[head] = reading.reference[0].wrapping_add(phase(&calibration.reference[head]));
                    reading.vernier[head] = reading.vernier[0].wrapping_add(phase(&calibration.vernier[head]));
                }
            }
            let ([x, y], _) = encoder.correct(reading);
            let z = f64::from(y) - PAIRS[1] / PAIRS[0] * f64::from(x);
            // The entry of the true pole pair; z is taken near it.
            let pole_pair = (turns * PAIRS[0] - f64::from(x) / 65536.0).round();
            let n = (PAIRS[1] * pole_pair).rem_euclid(PAIRS[0]);
            if n < 6.0 {
                let ideal = n / PAIRS[0];
                let off = z / 65536.0 - ideal;
                let value = (ideal + off - off.round()) * COUNTS;
                series[n as usize].points.push((f64::from(x) / 65536.0 * 360.0, value));
            }
        }
        for series in &mut series {
            series.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        Plot::new(title, "place in the pole pair / ° electrical", "z / counts", series)
    }

    /// Figure 10, top.
    pub fn readings(&mut self) -> Plot {
        let mut points = [Vec::new(), Vec::new()];
        for step in 0..1200 {
            let degrees = f64::from(step) / 20.0;
            let reading: Reading<HEADS> = read(&self.rings, &mut self.construction, degrees.to_radians());
            points[0].push((degrees, f64::from(reading.reference[0] >> 4)));
            points[1].push((degrees, f64::from(reading.vernier[0] >> 4)));
        }
        let [reference, vernier] = points;
        Plot::new(
            "Readings",
            "shaft angle / °",
            "reading / counts",
            vec![Series::new("37 pole pairs", reference), Series::new("45 pole pairs", vernier)],
        )
    }

    /// Figure 10, middle and bottom.
    pub fn ordinals(&mut self) -> Plot {
        let limit = MechanicalAngle::from_degrees(1.0);
        let calibrations = [("without", self.ideal.clone()), ("with calibration", self.calibration.clone())];
        let series = calibrations.into_iter().filter_map(|(name, calibration)| {
            let encoder = Encoder::new(&self.rings, &calibration, limit).ok()?;
            let points = (0..3600).map(|step| {
                let degrees = f64::from(step) / 10.0;
                let reading = read(&self.rings, &mut self.construction, degrees.to_radians());
                (degrees, encoder.decode(reading).pole_pair.into())
            });
            Some(Series::new(name, points.collect::<Vec<_>>()))
        });
        let series = series.collect();
        Plot::new("Number of the pole pair", "shaft angle / °", "number of the pole pair", series)
    }
}

/// A curve in counts over electrical degrees.
fn points(curve: &[f32; NODES]) -> impl Iterator<Item = (f64, f64)> {
    curve.iter().enumerate().map(|(node, &error)| (node as f64 * 360.0 / NODES as f64, f64::from(error) * COUNTS))
}
