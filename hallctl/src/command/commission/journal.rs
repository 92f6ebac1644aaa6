//! What was found so far, in a file: commissioning goes on where it was broken off, by whatever.

use crate::client::Identity;
use crate::error::{Error, Result};
use crate::out;
use anyhow::Context;
use hallservo::hall::calibrate::{self, report::Report as Sensors};
use hallservo::service::commission::Commission;
use hallservo::service::identify::Report;
use hallservo::service::standstill::Electrical;
use hallservo::service::swings::Rough;
use hallservo::settings::{Control, Entry, Settings, TABLE, find};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What a step has found.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "step", content = "found", rename_all = "snake_case")]
pub(super) enum Found {
    /// R and L.
    Standstill(Electrical),
    /// What the Halls deliver, or why that calibration failed.
    Calibration(std::result::Result<Sensors, calibrate::Error>),
    /// Flux linkage and inertia, roughly.
    Swings(Rough),
    /// The motor.
    Motor(Report),
    /// The measurements do not determine it.
    Unidentified,
}

/// What commissioning finds out, whatever it was before: a person's own value of these would not stay anyway.
const FOUND_OUT: [&str; 15] = [
    "resistance_ohm",
    "inductance_h",
    "saliency",
    "flux_linkage_wb",
    "inertia_kgm2",
    "dead_time_ramp_a",
    "hall_coil_deg_a",
    "hall_delay_us",
    "calibration_current_a",
    "calibration_hz",
    "calibration_align_s",
    "current_bandwidth_hz",
    "speed_bandwidth_hz",
    "position_bandwidth_hz",
    "max_acceleration_rad_s2",
];
/// What follows from a limit that it was told.
const BY_LIMIT: [&str; 2] = ["continuous_current_a", "over_current_a"];

/// Last line of a file that is whole: one cut off between two lines would be read as less.
const END: &str = "# end";

/// Where it is written before it takes its place.
fn beside(path: &Path) -> PathBuf {
    path.with_extension("new")
}

/// A motor on its way.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Journal {
    /// At which port, and what answered there.
    pub port: String,
    pub board: String,
    /// Serial number of its chip. A journal of before there were any is of no drive.
    #[serde(default)]
    pub serial: String,
    /// As it was told.
    pub max_current_a: Option<f32>,
    /// Whether a person has told the pole pairs.
    pub told_pole_pairs: bool,
    /// In the beginning.
    settings: BTreeMap<String, f32>,
    #[serde(default)]
    pub found: Vec<Found>,
}

impl Journal {
    /// Nothing is found yet.
    pub fn new(port: &str, drive: &Identity, max_current_a: Option<f32>, settings: &Settings) -> Self {
        let value = |entry: &Entry| Some((entry.name.into(), entry.get(settings)?));
        Self {
            port: port.into(),
            board: drive.board.clone(),
            serial: drive.serial.clone(),
            max_current_a,
            told_pole_pairs: false,
            settings: TABLE.iter().filter_map(value).collect(),
            found: Vec::new(),
        }
    }

    /// One that was broken off, if there is any.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        let text = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(anyhow::Error::new(error).context(format!("cannot read {}", path.display())).into());
            }
        };
        let bad = |why: &str| {
            let restart = "`--restart` begins anew, and overwrites it";
            Error::Failed(format!("{} is no file of `hallctl commission`: {why}\n  {restart}.", path.display()))
        };
        let journal = toml::from_str(&text).map_err(|error| bad(error.message()))?;
        if !text.trim_end().ends_with(END) {
            return Err(bad(&format!("its last line, `{END}`, is missing")));
        }
        Ok(Some(journal))
    }

    /// Tries whether it can be kept, before the motor turns.
    pub fn probe(path: &Path) -> Result<()> {
        out::probe(&beside(path))
    }

    /// Whole or not at all, whatever happens meanwhile.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = toml::to_string(self).context("the results")? + END + "\n";
        let new = beside(path);
        fs::write(&new, text).with_context(|| format!("cannot write {}", new.display()))?;
        Ok(fs::rename(&new, path).with_context(|| format!("cannot write {}", path.display()))?)
    }

    /// The settings in the beginning.
    pub fn settings(&self) -> Settings {
        let mut settings = Settings { control: Some(Control::default()), ..Settings::default() };
        for (name, value) in &self.settings {
            if let Some(entry) = find(name) {
                // One of another version is as by default.
                let _ = entry.assign(&mut settings, *value);
            }
        }
        settings
    }

    /// What a person has set since it was broken off stays: a limit that was lowered meanwhile must not be raised again.
    /// It is what neither was so in the beginning nor after any step. These settings' names; the limit is one of them unless
    /// it is told again.
    pub fn take_over(&mut self, present: &Settings, told_limit: bool) -> Result<Vec<&'static str>> {
        let stages = self.stages()?;
        let decided = |name| match name {
            "pole_pairs" => true,
            "max_current_a" => told_limit,
            _ if BY_LIMIT.contains(&name) => self.max_current_a.is_some(),
            _ => FOUND_OUT.contains(&name),
        };
        let is_new = |entry: &&Entry| {
            let value = entry.get(present);
            !decided(entry.name) && value.is_some() && stages.iter().all(|stage| entry.get(stage) != value)
        };
        let new: Vec<_> = TABLE.iter().filter(is_new).collect();
        self.settings.extend(new.iter().filter_map(|entry| Some((entry.name.into(), entry.get(present)?))));
        Ok(new.iter().map(|entry| entry.name).collect())
    }

    /// The settings in the beginning and after each step.
    fn stages(&self) -> Result<Vec<Settings>> {
        let mut replay = Self { found: Vec::new(), ..self.clone() };
        let mut stages = vec![self.settings(), *replay.commission()?.settings()];
        for found in &self.found {
            replay.found.push(found.clone());
            stages.push(*replay.commission()?.settings());
        }
        Ok(stages)
    }

    /// Other pole pairs: what depends on them is to be measured again.
    pub fn set_pole_pairs(&mut self, pairs: u8) {
        if self.settings.insert("pole_pairs".into(), pairs.into()) != Some(pairs.into()) {
            self.forget(|found| matches!(found, Found::Swings(_) | Found::Motor(_) | Found::Unidentified));
        }
    }

    /// The calibration is lost.
    pub fn forget_calibration(&mut self) {
        self.forget(|found| !matches!(found, Found::Standstill(_)));
    }

    fn forget(&mut self, from: impl Fn(&Found) -> bool) {
        let kept = self.found.iter().position(from).unwrap_or(self.found.len());
        self.found.truncate(kept);
    }

    /// What is decided by what was found.
    pub fn commission(&self) -> Result<Commission> {
        let mut commission =
            Commission::new(self.settings(), self.max_current_a).map_err(|error| super::words_of(&error))?;
        self.found.iter().try_for_each(|found| take(&mut commission, found))?;
        Ok(commission)
    }
}

/// Hands over what was found.
pub(super) fn take(commission: &mut Commission, found: &Found) -> Result<()> {
    match found {
        Found::Standstill(found) => commission.measured(found).map_err(|error| super::words_of(&error)),
        Found::Calibration(result) => commission
            .calibrated(result.as_ref().map_err(|error| *error))
            .map_err(|error| super::step("the calibration", &error.to_string())),
        Found::Swings(found) => commission.swung(found).map_err(|error| super::words_of(&error)),
        Found::Motor(found) => commission.identified(found).map_err(|error| super::words_of(&error)),
        Found::Unidentified => commission.unidentified().map_err(|error| super::words_of(&error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hallservo::service::commission::Action;

    fn journal() -> Journal {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let drive = Identity { board: "a board".into(), serial: "12".into(), ..Identity::default() };
        let mut journal = Journal::new("tcp:somewhere", &drive, Some(2.0), &settings);
        journal.found = vec![
            Found::Calibration(Err(calibrate::Error::NoFit)),
            Found::Swings(Rough { flux_linkage_wb: 5e-3, inertia_kgm2: 1e-6 }),
            Found::Unidentified,
        ];
        journal
    }

    #[test]
    fn it_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("commission.toml");
        assert!(Journal::read(&path).unwrap().is_none());
        let mut journal = journal();
        // What no JSON has.
        journal.settings.insert("command_timeout_s".into(), f32::INFINITY);
        journal.write(&path).unwrap();
        let read = Journal::read(&path).unwrap().unwrap();
        assert_eq!(format!("{journal:?}"), format!("{read:?}"));
        assert_eq!(read.settings().control.unwrap().guard.command_timeout_s, f32::INFINITY);
        // A line is torn, or it is something else.
        let text = fs::read_to_string(&path).unwrap();
        for bad in [&text[..text.len() / 2], "hello", "[settings]\npole_pairs = 4\n"] {
            fs::write(&path, bad).unwrap();
            assert!(matches!(Journal::read(&path), Err(Error::Failed(why)) if why.contains("--restart")));
        }
    }

    #[test]
    fn what_a_person_has_set_since_stays() {
        let mut journal = journal();
        let mut present = *journal.commission().unwrap().settings();
        let control = present.control.as_mut().unwrap();
        // As it was left in the midst of a step.
        (control.speed_bandwidth_hz, control.resistance_ohm) = (0.5, 7.0);
        assert!(journal.take_over(&present, true).unwrap().is_empty());
        let control = present.control.as_mut().unwrap();
        (control.max_regeneration_a, control.max_speed_rad_s) = (2.0, 30.0);
        assert_eq!(journal.take_over(&present, true).unwrap(), ["max_regeneration_a", "max_speed_rad_s"]);
        let goes_on = journal.commission().unwrap().settings().control.unwrap();
        assert!(goes_on.max_regeneration_a == 2.0 && goes_on.max_speed_rad_s <= 30.0, "{goes_on:?}");
        // The limit is what is told; without, it is a setting like any other.
        present.control.as_mut().unwrap().max_current_a = 0.5;
        assert!(journal.take_over(&present, true).unwrap().is_empty());
        assert_eq!(journal.take_over(&present, false).unwrap(), ["max_current_a"]);
    }

    #[test]
    fn what_depends_on_the_pole_pairs_is_measured_again() {
        let mut journal = journal();
        journal.set_pole_pairs(Settings::default().pole_pairs);
        assert_eq!(journal.found.len(), 3);
        journal.set_pole_pairs(11);
        assert_eq!((journal.found.len(), journal.settings().pole_pairs), (1, 11));
        journal.forget_calibration();
        assert!(journal.found.is_empty());
        assert_eq!(journal.commission().unwrap().action(), Action::Measure);
    }
}
