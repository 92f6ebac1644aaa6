//! The experiments, one a file: each has its options, runs, and returns a summary and a report.

pub mod adapt;
pub mod attack;
pub mod cogging;
pub mod coil;
pub mod commutation;
pub mod delay;
pub mod endurance;
pub mod faults;
pub mod identify;
pub mod magnets;
pub mod papers;
pub mod pwm;
pub mod servo;
pub mod spin;
pub mod vernier;

use crate::report::Report;
use anyhow::{Context, Result};
use rig::motors::Motor;
use serde::Serialize;
use std::fs;
use std::path::PathBuf;

/// Options that every experiment has.
#[derive(Clone, Debug, clap::Args)]
pub struct Common {
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Folder for the report; it is made if it does not exist
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub out: PathBuf,
}

/// Options of an experiment with the motors of the list.
#[derive(Clone, Debug, clap::Args)]
pub struct OfMotors {
    #[command(flatten)]
    common: Common,
    /// Only motors whose name contains this
    #[arg(long)]
    motor: Option<String>,
}

impl OfMotors {
    fn has(&self, motor: &Motor) -> bool {
        self.motor.as_ref().is_none_or(|name| motor.name.contains(name))
    }
}

impl Common {
    /// Makes the folder and tries the files before the work begins, not after it.
    ///
    /// # Errors
    /// Names what cannot be written.
    pub fn prepare(&self) -> Result<()> {
        fs::create_dir_all(&self.out).with_context(|| format!("cannot make the folder {}", self.out.display()))?;
        let probe = self.out.join(".writable");
        fs::write(&probe, "").with_context(|| format!("cannot write into the folder {}", self.out.display()))?;
        fs::remove_file(&probe).with_context(|| format!("cannot tidy up {}", probe.display()))?;
        match &self.json {
            Some(file) => fs::write(file, "").with_context(|| format!("cannot write {}", file.display())),
            None => Ok(()),
        }
    }

    /// Writes the summary and the report, and says where they are.
    ///
    /// # Errors
    /// Names the file that cannot be written.
    pub fn finish(&self, name: &str, summary: &impl Serialize, report: &Report) -> Result<()> {
        if let Some(file) = &self.json {
            let json = serde_json::to_string_pretty(summary)?;
            fs::write(file, json + "\n").with_context(|| format!("cannot write {}", file.display()))?;
            println!("Figures: {}", file.display());
        }
        let file = self.out.join(format!("{name}.html"));
        fs::write(&file, report.html()).with_context(|| format!("cannot write {}", file.display()))?;
        println!("Report:  {}", file.display());
        Ok(())
    }
}
