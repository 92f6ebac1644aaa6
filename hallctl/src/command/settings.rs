//! `hallctl settings`.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::words;
use anyhow::{Context, anyhow};
use clap::Subcommand;
use hallservo::settings::{Kind, about};
use hallservo_protocol::{Answer, Ask, Setting};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// All, with their ranges
    List,
    /// One
    Get {
        /// Its name
        name: String,
    },
    /// Another value, while the bridge is off; it holds until the power goes, or for good after `save`
    #[command(allow_negative_numbers = true)]
    Set {
        /// Its name
        name: String,
        /// A number, yes or no, or one of its names
        value: String,
    },
    /// Keep them in the flash
    Save,
    /// Confirm them as they are, after those in the flash could not be taken over; `save` does, too, for good
    Accept,
    /// Back to those in the flash
    Load,
    /// Back to the board's defaults
    Reset,
    /// Write all to a TOML file
    Export {
        /// The file
        file: PathBuf,
    },
    /// Set what a TOML file has; keep it by `save`
    Import {
        /// The file
        file: PathBuf,
    },
}

pub(super) fn run(client: &mut Client, command: &Command) -> Result<()> {
    match command {
        Command::List => list(client),
        Command::Get { name } => client.setting(Ask::Get(name), show),
        Command::Set { name, value } => set(client, name, value),
        Command::Save => save(client),
        Command::Accept => {
            client.order(Ask::Accept)?;
            println!("accepted until the power goes; `hallctl settings save` keeps them");
            Ok(())
        }
        Command::Load => client.order(Ask::Load),
        Command::Reset => client.order(Ask::Restore),
        Command::Export { file } => export(client, file),
        Command::Import { file } => import(client, file),
    }
}

/// Hands every setting that this drive has to `take`.
pub(super) fn each(client: &mut Client, mut take: impl FnMut(&Setting<'_>)) -> Result<()> {
    for number in 0..client.identity().settings {
        match client.setting(Ask::Setting(number), &mut take) {
            // A drive without current control does not have all.
            Ok(()) | Err(Error::Refused(_)) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn list(client: &mut Client) -> Result<()> {
    each(client, |setting| {
        let value = words::value(setting, setting.value);
        let changed = if setting.value == setting.default { ' ' } else { '*' };
        let range = match setting.kind {
            _ if setting.fixed => "the board's".into(),
            Kind::Switch => "no|yes".into(),
            Kind::Choice(names) => names.into(),
            _ => format!("{} … {}", words::short(setting.min), words::short(setting.max)),
        };
        println!("{changed} {:<24}{value:>15} {:<7} {range:<32} {}", setting.name, setting.unit, about(setting.name));
    })?;
    println!("* differs from the board's default");
    Ok(())
}

fn show(setting: &Setting<'_>) {
    let gap = if setting.unit.is_empty() { "" } else { " " };
    println!("{} = {}{gap}{}", setting.name, words::value(setting, setting.value), setting.unit);
}

/// The number of what a person wrote.
fn number(client: &mut Client, name: &str, text: &str) -> Result<f32> {
    client.setting(Ask::Get(name), |setting| {
        words::parse(setting, text).ok_or_else(|| {
            let wanted = match setting.kind {
                Kind::Switch => "yes or no".into(),
                Kind::Choice(names) => names.replace('|', ", "),
                Kind::Real | Kind::Whole => "a number".into(),
            };
            Error::Other(anyhow!("{name} takes {wanted}, not {text}"))
        })
    })?
}

fn set(client: &mut Client, name: &str, value: &str) -> Result<()> {
    let value = number(client, name, value)?;
    client.setting(Ask::Set { name, value }, show)
}

pub(super) fn save(client: &mut Client) -> Result<()> {
    let waits = client.ask(Ask::Save, |answer| match answer {
        Answer::Saved { waits } => Ok(waits),
        other => unexpected(&other),
    })?;
    println!("{}", if waits { "will be saved when the bridge is off: `hallctl disarm`" } else { "saved" });
    Ok(())
}

fn export(client: &mut Client, path: &Path) -> Result<()> {
    let identity = client.identity();
    let mut text = format!("# {}, firmware {}\n", identity.board, identity.firmware);
    each(client, |setting| {
        let value = words::value(setting, setting.value);
        let value = match setting.kind {
            Kind::Switch => (value == "yes").to_string(),
            Kind::Choice(_) => format!("{value:?}"),
            Kind::Real | Kind::Whole => value,
        };
        let fixed = if setting.fixed { "# the board's: " } else { "" };
        let unit = if setting.unit.is_empty() { String::new() } else { format!(" [{}]", setting.unit) };
        // Writing into a string does not fail.
        let _ = writeln!(text, "\n# {}{unit}\n{fixed}{} = {value}", about(setting.name), setting.name);
    })?;
    Ok(fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?)
}

fn import(client: &mut Client, path: &Path) -> Result<()> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let table: toml::Table = text.parse().with_context(|| format!("in {}", path.display()))?;
    let mut left: Vec<(&str, f32)> = Vec::new();
    for (name, value) in &table {
        let text = match value {
            toml::Value::String(text) => text.clone(),
            value => value.to_string(),
        };
        left.push((name, number(client, name, &text)?));
    }
    set_all(client, left)?;
    println!("{} settings set; `hallctl settings save` keeps them", table.len());
    Ok(())
}

/// Sets several: some ranges depend on other settings, so what is refused at first may be allowed later.
pub(super) fn set_all(client: &mut Client, mut left: Vec<(&str, f32)>) -> Result<()> {
    loop {
        let before = left.len();
        let mut refused = None;
        let mut rest = Vec::new();
        for (name, value) in left {
            match client.setting(Ask::Set { name, value }, |_| ()) {
                Ok(()) => {}
                Err(Error::Refused(why)) => {
                    refused = Some(Error::Refused(format!("{name}: {why}")));
                    rest.push((name, value));
                }
                Err(error) => return Err(error),
            }
        }
        match refused {
            None => return Ok(()),
            Some(error) if rest.len() == before => return Err(error),
            Some(_) => left = rest,
        }
    }
}
