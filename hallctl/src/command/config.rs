//! Defaults of the options, in a file.

use crate::error::Result;
use crate::out::Out;
use crate::say;
use crate::units::{PositionUnit, SpeedUnit};
use anyhow::Context;
use directories::ProjectDirs;
use serde::Deserialize;
use serde_json::json;
use std::fs;
use std::io::ErrorKind;
use std::num::NonZeroU64;
use std::path::PathBuf;

/// What the file says.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    pub(super) port: Option<String>,
    pub(super) patience: Option<NonZeroU64>,
    pub(super) speed_unit: Option<SpeedUnit>,
    pub(super) position_unit: Option<PositionUnit>,
}

/// Where it is, whether it is there or not.
fn place() -> Option<PathBuf> {
    Some(ProjectDirs::from("", "", "hallctl")?.config_dir().join("config.toml"))
}

impl Config {
    pub(super) fn read() -> Result<Self> {
        let Some(path) = place() else { return Ok(Self::default()) };
        match fs::read_to_string(&path) {
            Ok(text) => Ok(toml::from_str(&text).with_context(|| format!("in {}", path.display()))?),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(anyhow::Error::new(error).context(format!("cannot read {}", path.display())).into()),
        }
    }

    pub(super) fn show(&self, out: Out) -> Result<()> {
        let path = place().map_or_else(|| "nowhere".into(), |path| path.display().to_string());
        say!(out, "{path}")?;
        let value =
            |name, value: Option<String>| say!(out, "  {name:<14}{}", value.unwrap_or_else(|| "not set".into()));
        value("port", self.port.clone())?;
        value("patience", self.patience.map(|seconds| format!("{seconds} s")))?;
        value("speed_unit", self.speed_unit.map(|unit| unit.name().into()))?;
        value("position_unit", self.position_unit.map(|unit| unit.name().into()))?;
        out.value(&json!({
            "file": path,
            "port": self.port,
            "patience": self.patience,
            "speed_unit": self.speed_unit.map(SpeedUnit::name),
            "position_unit": self.position_unit.map(PositionUnit::name),
        }))
    }
}
