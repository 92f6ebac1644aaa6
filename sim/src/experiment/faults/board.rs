//! The boards as they are shipped.

use anyhow::{Context, Result, anyhow};
use hallservo::settings::{Control, Entry, Kind, Settings, find};

/// A board and the settings in which it differs from the library's default.
pub(super) struct Board {
    pub name: &'static str,
    file: &'static str,
}

/// All of them. A test in each board's folder compares the file with what the firmware starts with.
pub(super) const BOARDS: [Board; 3] = [
    Board { name: "ESC1", file: include_str!("../../../../boards/b-g431b-esc1/settings.toml") },
    Board { name: "G431RB-IHM16M1", file: include_str!("../../../../boards/nucleo-g431rb-ihm16m1/settings.toml") },
    Board { name: "G474RE-IHM08M1", file: include_str!("../../../../boards/nucleo-g474re-ihm08m1/settings.toml") },
];

impl Board {
    /// What its firmware starts with.
    pub fn settings(&self) -> Result<Settings> {
        let mut settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let table: toml::Table = self.file.parse().with_context(|| format!("the settings of {}", self.name))?;
        for (name, value) in &table {
            let entry = find(name).with_context(|| format!("no setting is called {name}"))?;
            let number = number(entry, value).with_context(|| format!("{name} is not {value}"))?;
            entry.assign(&mut settings, number).map_err(|error| anyhow!("{name}: {error}"))?;
        }
        Ok(settings)
    }
}

fn number(entry: &Entry, value: &toml::Value) -> Option<f32> {
    match (entry.kind(), value) {
        (Kind::Choice(names), toml::Value::String(name)) => Some(names.split('|').position(|one| one == name)? as f32),
        (_, toml::Value::Boolean(yes)) => Some(f32::from(u8::from(*yes))),
        (_, toml::Value::Float(number)) => Some(*number as f32),
        (_, toml::Value::Integer(number)) => Some(*number as f32),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_board_has_settings_that_a_drive_can_start_with() {
        for board in &BOARDS {
            let settings = board.settings().unwrap();
            settings.validate().unwrap();
            assert_ne!(settings, Settings { control: Some(Control::default()), ..Settings::default() });
        }
    }
}
