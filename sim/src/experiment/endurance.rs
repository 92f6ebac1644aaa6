//! Sound Halls for hours: whether the adaptation ever blames one, and how soon it names one that breaks after that.
//!
//! Every kind of uneven rotor turns, sways, coasts, is turned by hand and pushed, at −20 to 80 °C, with disturbed and lost
//! samples and a torque that is told up to twice or half as large as it is. The filter knows of none of these.

mod course;
mod life;

use super::Common;
use super::magnets::{Kind, kinds};
use crate::report::{Report, print_table};
use anyhow::{Result, ensure};
use hallservo::hall::calibrate;
use indicatif::{ParallelProgressIterator, ProgressBar, ProgressStyle};
pub use life::{Life, Loss, live};
use rayon::prelude::*;

/// How long each rotor lives, s.
const LIFE_S: f64 = 600.0;

/// Options of `endurance`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Hours of all rotors together
    #[arg(long, default_value_t = 10.0)]
    hours: f64,
    /// Print each rotor of which a Hall was blamed, whose angle was lost, or whose broken Hall was not named within a turn
    #[arg(long)]
    each: bool,
}

/// Lives of these seeds, the kinds one after the other; none where the calibration refuses the rotor.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn lives(seeds: std::ops::Range<u64>, seconds: f64) -> Result<Vec<Option<Life>>> {
    let kinds = kinds();
    let style = ProgressStyle::with_template("{wide_bar} {pos} of {len} rotors, {eta} left")?;
    let bar = ProgressBar::new(seeds.end - seeds.start).with_style(style);
    let life = |seed: u64| match live(&kinds[(seed % kinds.len() as u64) as usize], seed, seconds) {
        Err(error) if error.is::<calibrate::Error>() => Ok(None),
        life => life.map(Some),
    };
    seeds.into_par_iter().progress_with(bar).map(life).collect()
}

/// The row of these lives.
fn row(name: &str, lives: &[&Life]) -> Vec<String> {
    let sum = |of: fn(&Life) -> f64| lives.iter().map(|life| of(life)).sum::<f64>();
    let seconds = sum(|life| life.seconds);
    let losses: Vec<_> = lives.iter().filter_map(|life| life.loss).collect();
    let mut named: Vec<_> = losses.iter().filter(|loss| loss.is_named).filter_map(|loss| loss.turns).collect();
    named.sort_by(f64::total_cmp);
    let error_deg = (sum(|life| life.seconds * life.error_deg_rms.powi(2)) / seconds).sqrt();
    vec![
        name.into(),
        format!("{:.1}", seconds / 3600.0),
        lives.iter().filter(|life| life.alarm.is_some()).count().to_string(),
        format!("{:.2}°", error_deg),
        format!("{:.1} s", sum(|life| life.astray_s)),
        format!("{:.0} %", 100.0 * sum(|life| life.seconds * life.learning) / seconds),
        format!("{} of {}", named.len(), losses.len()),
        named.get(named.len().saturating_sub(1) * 99 / 100).map_or("–".into(), |turns| format!("{turns:.2}")),
        named.last().map_or("–".into(), |turns| format!("{turns:.2}")),
    ]
}

fn table(lives: &[Life]) -> Vec<Vec<String>> {
    let head = ["", "h", "blamed", "error", "lost for", "learns", "broken, named", "99 % after / turns", "last after"];
    let mut table = vec![head.map(String::from).to_vec()];
    let of = |is_meant: &dyn Fn(&Life) -> bool| lives.iter().filter(|life| is_meant(life)).collect::<Vec<_>>();
    let mut groups: Vec<_> = kinds().iter().map(|&Kind { name, .. }| (name, of(&|life| life.kind == name))).collect();
    groups.push(("with three Halls", of(&|life| life.two_apart_deg.is_none())));
    groups.push(("with two", of(&|life| life.two_apart_deg.is_some())));
    groups.push(("all", of(&|_| true)));
    table.extend(groups.iter().filter(|(_, lives)| !lives.is_empty()).map(|(name, lives)| row(name, lives)));
    table
}

/// What is worth a look at.
fn tell(life: &Life) {
    let Life { kind, seed, two_apart_deg, seconds, alarm, astray_s, loss, .. } = life;
    let halls = two_apart_deg.map_or("three Halls".into(), |apart| format!("two Halls {apart}° apart"));
    let who = format!("{kind}, {halls}, seed {seed}");
    if let Some(alarm) = alarm {
        println!("{who}: after {seconds:.1} s {alarm}");
    }
    if *astray_s > 0.0 {
        println!("{who}: the angle was lost for {astray_s:.2} s");
    }
    match loss {
        Some(Loss { turns: Some(turns), is_named: true }) if *turns <= 1.0 => {}
        Some(Loss { turns: Some(turns), is_named: true }) => println!("{who}: broken, named after {turns:.2} turns"),
        Some(Loss { turns: Some(_), is_named: false }) => println!("{who}: broken, and another fault was told"),
        Some(Loss { turns: None, .. }) => println!("{who}: broken, and never named"),
        None => {}
    }
}

/// `endurance`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written.
pub fn main(options: &Options) -> Result<()> {
    ensure!(options.hours > 0.0 && options.hours <= 1e5, "--hours must be above 0, and at most 100 000");
    options.common.prepare()?;
    let rotors = (3600.0 * options.hours / LIFE_S).ceil() as u64;
    let lives = lives(options.common.seed..options.common.seed.saturating_add(rotors), LIFE_S)?;
    let refused = lives.iter().filter(|life| life.is_none()).count();
    let lives: Vec<_> = lives.into_iter().flatten().collect();
    if options.each {
        lives.iter().for_each(tell);
    }
    let table = table(&lives);
    print_table(&table);
    println!("\n{rotors} rotors, {refused} of them refused by the calibration.");
    let mut report = Report::new("Sound Halls for hours");
    report.lead(
        "Rotors of every kind turn, sway, coast, are turned by hand and pushed, warm and cold, with disturbed and lost \
         samples: whether the adaptation blames a sound Hall, and how soon it names one that is broken after that.",
    );
    report.text(
        "The error is that of the filter's own angle, electrical and RMS, which controls nothing; it counts as lost beyond \
         45°. Learns: the share of the samples of which parameters were learnt. A broken Hall is named after so many \
         electrical turns; of two Halls the adaptation blames none.",
    );
    report.table(&table);
    options.common.finish("endurance", &lives, &report)
}
