//! Both papers done again: each figure, table and number beside the printed one, on one page.

pub mod claim;
mod coils;
mod commutated;
mod eccentric;
mod filter;
mod hand;
mod rings;
mod sensors;
mod switching;

use super::Common;
use crate::report::{Report, print_table};
use anyhow::Result;
use claim::{Claim, Paper, Verdict};
use serde::Serialize;

/// The figures of `papers --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Seed of the motors, sensors and rings.
    pub seed: u64,
    /// Everything, in the order of the papers.
    pub claims: Vec<Claim>,
}

/// `papers`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a simulated drive that refuses its sensors.
pub fn main(common: &Common) -> Result<()> {
    common.prepare()?;
    let summary = run(common.seed)?;
    println!("The figures, tables and numbers of both papers, done again (seed {}):\n", common.seed);
    print_table(&summary.table());
    println!();
    common.finish("papers", &summary, &summary.report()?)
}

/// Does everything again.
///
/// # Errors
/// A simulated drive that refuses its sensors.
pub fn run(seed: u64) -> Result<Summary> {
    let claims = [
        sensors::claims(seed)?,
        hand::claims(seed)?,
        coils::claims(seed)?,
        switching::claims()?,
        commutated::claims(seed)?,
        filter::claims(seed)?,
        rings::claims(seed)?,
    ];
    Ok(Summary { seed, claims: claims.concat() })
}

/// The verdicts in the order in which they are counted.
const VERDICTS: [Verdict; 6] = [
    Verdict::Reproduced,
    Verdict::Better,
    Verdict::Misprint,
    Verdict::Incomparable,
    Verdict::Unprinted,
    Verdict::Missed,
];

impl Summary {
    /// Every number, for the terminal.
    fn table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![["", "printed", "the paper's method, here", "ours", ""].map(String::from).to_vec()];
        for claim in &self.claims {
            rows.push(vec![claim.heading()]);
            let figures = claim.figures.iter().map(claim::Figure::row);
            rows.extend(figures.map(|row| [vec![format!("    {}", row[0])], row[1..].to_vec()].concat()));
        }
        rows
    }

    /// How many numbers came to what, for each paper.
    fn counts(&self) -> Vec<Vec<String>> {
        let count = |paper: Paper, verdict: Verdict| {
            let claims = self.claims.iter().filter(|claim| claim.paper == paper);
            claims.flat_map(|claim| &claim.figures).filter(|figure| figure.verdict == verdict).count()
        };
        let head = ["numbers", "linear Halls", "vernier"].map(String::from).to_vec();
        let row = |verdict: Verdict| {
            let [halls, vernier] = [Paper::LinearHalls, Paper::Vernier].map(|paper| count(paper, verdict));
            (halls + vernier > 0).then(|| vec![verdict.words().into(), halls.to_string(), vernier.to_string()])
        };
        std::iter::once(head).chain(VERDICTS.into_iter().filter_map(row)).collect()
    }

    fn report(&self) -> Result<Report> {
        let mut report = Report::new("The two papers, done again");
        report.lead(
            "hallservo implements two papers: one finds a motor's angle from three cheap magnetic sensors, the other a \
             shaft's absolute angle from two magnetised rings. Here each of their figures, tables and numbers is made \
             again by the code that runs on the chip, against simulated motors and rings.",
        );
        report.text(
            "For each: the equation, the printed number, the number found here, and why they differ. Where an \
             equation is wrong in print, the corrected one is used, and the page says so. A Hall is a sensor of the \
             magnetic field. A pole pair is a north and a south magnet; one of them passing is an electrical turn, \
             so that 1° of a motor with four pole pairs is 4° electrical.",
        );
        report.table(&self.counts());
        report.text(
            "“Conditions unknown”: the paper gives a number but not all that it depends on, so that it is printed \
             beside ours and not compared. “No number in print”: a figure whose curves the paper shows without \
             numbers; ours are there to be checked. Nothing here was measured on a motor.",
        );
        for paper in [Paper::LinearHalls, Paper::Vernier] {
            report.chapter(paper.title());
            for claim in self.claims.iter().filter(|claim| claim.paper == paper) {
                add(&mut report, claim)?;
            }
        }
        Ok(report)
    }
}

fn add(report: &mut Report, claim: &Claim) -> Result<()> {
    report.heading(&claim.heading()).text(claim.seen);
    for (plot, caption) in &claim.plots {
        report.plot(plot, caption)?;
    }
    if !claim.table.is_empty() {
        report.table(&claim.table);
    }
    report.table(&claim.figures_table()).text(&claim.conclusion);
    report.preformatted(claim.equation);
    report.text(&format!("Conditions. {}", claim.conditions));
    if let Some(erratum) = claim.erratum {
        report.note(&format!("Wrong in print. {erratum}"));
    }
    Ok(())
}
