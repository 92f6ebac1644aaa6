//! `hallctl settings`.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::out::{self, Out};
use crate::{say, words};
use clap::Subcommand;
use hallservo::service::procedure;
use hallservo::settings::{self, Control, Kind, Settings, about, find};
use hallservo_protocol::{Answer, Ask, Problem, Record, Setting};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// All, with their ranges
    List {
        /// With what each is about
        #[arg(long)]
        about: bool,
    },
    /// One
    Get {
        /// Its name
        name: String,
    },
    /// Another value, while the bridge is off, bandwidths at any time; until the power goes, or for good after `save`.
    /// Those of an encoder (encoder_…) are stored at once
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
    /// Back to those in the flash; those of an encoder are what is set
    Load,
    /// Back to the board's defaults, but for those of an encoder
    Reset,
    /// Write all to a TOML file
    Export {
        /// The file, - for the standard output
        file: PathBuf,
    },
    /// Set what a TOML file has, all of it or nothing; keep it by `save`
    Import {
        /// The file, - for the standard input
        file: PathBuf,
    },
}

pub(super) fn run(client: &mut Client, command: &Command, out: Out) -> Result<()> {
    match command {
        Command::List { about } => list(client, *about, out),
        Command::Get { name } => {
            let found = client.setting(Ask::Get(name), |setting| (show(setting, out), about(name)))?;
            found.0?;
            say!(out, "  {}", found.1)
        }
        Command::Set { name, value } => set(client, name, value, out),
        Command::Save => {
            let waits = save(client)?;
            say!(out, "{}", saved(waits))?;
            out.value(&json!({ "saved": !waits }))
        }
        Command::Accept => {
            client.order(Ask::Accept)?;
            say!(out, "accepted until the power goes; `hallctl settings save` keeps them")?;
            super::done(out, Ok(()))
        }
        Command::Load => super::done(out, client.order(Ask::Load)),
        Command::Reset => super::done(out, client.order(Ask::Restore)),
        Command::Export { file } => export(client, file),
        Command::Import { file } => import(client, file, out),
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

/// The drive's settings.
pub(super) fn read(client: &mut Client) -> Result<Settings> {
    let mut settings = Settings { control: Some(Control::default()), ..Settings::default() };
    let mut controls = false;
    each(client, |setting| {
        if let Some(entry) = find(setting.name)
            && entry.assign(&mut settings, setting.value).is_ok()
        {
            controls |= entry.name == "current_full_scale_a";
        }
    })?;
    // Without current control, a drive has not all of them; and a board may lack one for what it has no pin for.
    if !controls {
        return Err(Error::Refused(words::procedure_error(&procedure::Error::NoControl)));
    }
    Ok(settings)
}

fn list(client: &mut Client, with_about: bool, out: Out) -> Result<()> {
    let mut lines = Vec::new();
    let mut values = Vec::new();
    each(client, |setting| {
        lines.push(line(setting));
        if with_about {
            lines.extend(wrapped(about(setting.name)));
        }
        values.push(value(setting));
    })?;
    for line in lines {
        say!(out, "{line}")?;
    }
    say!(out, "* differs from the board's default; `--about` says what they are about")?;
    out.value(&values)
}

/// Indented lines of no more than a terminal's 80 columns.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines = vec![String::from("   ")];
    for word in text.split_whitespace() {
        if lines.last().is_some_and(|line| line.chars().count() + word.chars().count() >= 80) {
            lines.push("   ".into());
        }
        lines.last_mut().into_iter().for_each(|line| *line += &format!(" {word}"));
    }
    lines
}

/// Of a terminal's 80 columns.
fn line(setting: &Setting<'_>) -> String {
    let value = words::value(setting, setting.value);
    let changed = if setting.value == setting.default { ' ' } else { '*' };
    let range = match setting.kind {
        _ if setting.fixed => "the board's".into(),
        Kind::Switch => "no|yes".into(),
        Kind::Choice(names) => names.into(),
        _ => format!("{} … {}", words::short(setting.min), words::short(setting.max)),
    };
    format!("{changed} {:<24} {value:>14} {:<6} {range}", setting.name, setting.unit)
}

fn show(setting: &Setting<'_>, out: Out) -> Result<()> {
    let gap = if setting.unit.is_empty() { "" } else { " " };
    say!(out, "{} = {}{gap}{}", setting.name, words::value(setting, setting.value), setting.unit)?;
    out.value(&value(setting))
}

/// All of it for a script.
fn value(setting: &Setting<'_>) -> Value {
    let of = |value: f32| match setting.kind {
        Kind::Switch => json!(value != 0.0),
        Kind::Choice(_) => json!(words::value(setting, value)),
        // As many digits as a float has.
        Kind::Real | Kind::Whole => value.to_string().parse::<f64>().map_or(Value::Null, |value| json!(value)),
    };
    json!({
        "name": setting.name,
        "value": of(setting.value),
        "default": of(setting.default),
        "unit": setting.unit,
        "min": setting.min,
        "max": setting.max,
        "fixed": setting.fixed,
        "about": about(setting.name),
    })
}

/// The number of what a person wrote.
fn number(client: &mut Client, name: &str, text: &str) -> Result<f32> {
    let found = client.setting(Ask::Get(name), |setting| {
        words::parse(setting, text).ok_or_else(|| {
            let wanted = match setting.kind {
                Kind::Switch => "yes or no".into(),
                Kind::Choice(names) => names.replace('|', ", "),
                Kind::Real | Kind::Whole => "a number".into(),
            };
            let text = if text.is_empty() { "nothing" } else { text };
            Error::Refused(format!("it takes {wanted}, not {text}"))
        })
    });
    match found.and_then(|number| number) {
        Err(Error::Refused(why)) => Err(Error::Refused(format!("{name}: {why}"))),
        number => number,
    }
}

fn set(client: &mut Client, name: &str, value: &str, out: Out) -> Result<()> {
    let value = number(client, name, value)?;
    let set = client.setting(Ask::Set { name, value }, |setting| show(setting, out));
    set.map_err(|error| of_another(client, name, error))?
}

/// A refusal that names another setting than the one that is to be set says so.
fn of_another(client: &mut Client, name: &str, error: Error) -> Error {
    match error {
        Error::Refused(why) => match why.split_whitespace().next() {
            Some(other) if other != name && client.setting(Ask::Get(other), |_| ()).is_ok() => {
                Error::Refused(format!("{name} limits {other}: {why}\n  Set {other} first."))
            }
            _ => Error::Refused(with_name(name, why)),
        },
        error => error,
    }
}

/// A reason, which names the setting once.
fn with_name(name: &str, why: String) -> String {
    let named = why.split_whitespace().next().is_some_and(|word| word.trim_end_matches(':') == name);
    if named { why } else { format!("{name}: {why}") }
}

/// True where they are kept only when the bridge is off.
pub(super) fn save(client: &mut Client) -> Result<bool> {
    client.ask(Ask::Save, |answer| match answer {
        Answer::Saved { waits } => Ok(waits),
        other => unexpected(&other),
    })
}

pub(super) const fn saved(waits: bool) -> &'static str {
    if waits { "will be saved when the bridge is off and the rotor rests: `hallctl stop`" } else { "saved" }
}

/// First words and last line of an exported file. One that was cut may still be read, with a number that has lost digits.
const BEGIN: &str = "# Settings of ";
const END: &str = "# End of the settings.";

fn export(client: &mut Client, path: &Path) -> Result<()> {
    let identity = client.identity();
    let mut text =
        format!("{BEGIN}{}, firmware {}, serial number {}\n", identity.board, identity.firmware, identity.serial);
    let now = humantime::format_rfc3339_seconds(SystemTime::now());
    text += &format!("# Exported {now} from {}\n", client.port());
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
    let _ = writeln!(text, "\n{END}");
    out::save(path, text)
}

fn import(client: &mut Client, path: &Path, out: Out) -> Result<()> {
    let text = out::load(path)?;
    // Below it somebody may have added what is their own.
    if text.starts_with(BEGIN) && !text.lines().any(|line| line.trim_end() == END) {
        return Err(anyhow::anyhow!("{} has been cut: its line {END:?} is not there", path.display()).into());
    }
    let table = match text.parse::<toml::Table>() {
        Ok(table) => table,
        Err(error) => return Err(no_value(client, path, &text, &error)),
    };
    // A file of which nothing is left must not look as if it had been taken over.
    if table.is_empty() {
        return Err(anyhow::anyhow!("there is no setting in {}", path.display()).into());
    }
    let (mut wanted, mut before, mut changes) = (Vec::<(&str, f32)>::new(), BTreeMap::new(), Vec::new());
    for (name, value) in &table {
        let text = match value {
            toml::Value::String(text) => text.clone(),
            value => value.to_string(),
        };
        wanted.push((name, number(client, name, &text)?));
        let to = wanted.last().map_or(f32::NAN, |(_, to)| *to);
        let (value, fixed, change) = client.setting(Ask::Get(name), |setting| {
            let change = MOTOR.contains(&setting.name) && setting.value != to;
            (setting.value, setting.fixed, change.then(|| Change::of(setting, to)))
        })?;
        if fixed {
            return Err(Error::Refused(format!("{name}: {}", settings::Error::Fixed)));
        }
        before.insert(name.as_str(), value);
        changes.extend(change);
    }
    let status = client.status()?;
    let is_set_up = status.calibrated || status.stored[Record::Settings as usize] != Problem::Blank;
    changes.retain(|_| is_set_up);
    // Pole pairs first, on which all else depends.
    changes.sort_by_key(|change: &Change| MOTOR.iter().position(|name| *name == change.name));
    let mut changed = Vec::new();
    set_in_turn(client, wanted, &mut changed).map_err(|error| put_back(client, error, &changed, &before))?;
    say!(out, "{} settings set; `hallctl settings save` keeps them", table.len())?;
    if !changes.is_empty() {
        let had = if status.calibrated { "is calibrated" } else { "has settings of its own in the flash" };
        let words: Vec<_> = changes.iter().map(|change| change.words.as_str()).collect();
        say!(out, "The drive {had}, and the file changes what is known of its motor: {}", words.join(", "))?;
    }
    let motor = changes.iter().map(|Change { name, from, to, .. }| json!({ "name": name, "from": from, "to": to }));
    out.value(&json!({ "set": table.len(), "motor": motor.collect::<Vec<_>>() }))
}

/// Settings of the motor itself.
const MOTOR: [&str; 8] = [
    "pole_pairs",
    "resistance_ohm",
    "inductance_h",
    "saliency",
    "flux_linkage_wb",
    "inertia_kgm2",
    "max_current_a",
    "continuous_current_a",
];

/// One of them that a file changes.
struct Change {
    name: String,
    from: f64,
    to: f64,
    words: String,
}

impl Change {
    fn of(setting: &Setting<'_>, to: f32) -> Self {
        let unit = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
        let [from_words, to_words] = [setting.value, to].map(|value| words::value(setting, value));
        let words = format!("{} from {from_words} to {to_words}{unit}", setting.name);
        // As many digits as a float has.
        let [from, to] = [setting.value, to].map(|value| value.to_string().parse().unwrap_or(f64::NAN));
        Self { name: setting.name.into(), from, to, words }
    }
}

/// That a line is no TOML: with what its setting takes, where it names one. The parser takes any word for a number.
fn no_value(client: &mut Client, path: &Path, text: &str, error: &toml::de::Error) -> Error {
    let at = error.span().map_or(0, |span| span.start);
    let before = text.get(..at).unwrap_or_default();
    let (number, begin) = (before.matches('\n').count(), before.rfind('\n').map_or(0, |end| end + 1));
    let line = text.get(begin..).and_then(|rest| rest.lines().next()).unwrap_or_default();
    let place = format!("in {}, line {}", path.display(), number + 1);
    if let Some((name, value)) = line.split_once('=') {
        let (name, value) = (name.trim(), value.split('#').next().unwrap_or_default().trim());
        match client.setting(Ask::Get(name), |setting| takes(setting.kind)) {
            Ok(wanted) => return anyhow::anyhow!("{place}: {name} takes {wanted}, not {value}").into(),
            Err(Error::Refused(why)) => return anyhow::anyhow!("{place}: {name}: {why}").into(),
            Err(_) => {}
        }
    }
    anyhow::anyhow!("{place}: {}", error.message()).into()
}

/// What a setting takes in a file.
fn takes(kind: Kind<'_>) -> String {
    match kind {
        Kind::Switch => "true or false".into(),
        Kind::Choice(names) => names.split('|').map(|name| format!("{name:?}")).collect::<Vec<_>>().join(" or "),
        Kind::Real | Kind::Whole => "a number".into(),
    }
}

/// Takes back what was changed, the last first: so the drive has had, and allowed, every step before.
fn put_back(client: &mut Client, error: Error, changed: &[&str], before: &BTreeMap<&str, f32>) -> Error {
    if matches!(error, Error::Interrupted) {
        client.carry_on();
    }
    let mut kept = Vec::new();
    for name in changed.iter().rev() {
        let Some(&value) = before.get(name) else { continue };
        if client.setting(Ask::Set { name, value }, |_| ()).is_err() {
            kept.push(*name);
        }
    }
    match error {
        Error::Refused(why) if kept.is_empty() => Error::Refused(format!("{why}\n  No setting is changed.")),
        Error::Refused(why) => {
            Error::Refused(format!("{why}\n  What was changed before, and could not be put back: {}.", kept.join(", ")))
        }
        error => error,
    }
}

/// Sets several.
pub(super) fn set_all(client: &mut Client, wanted: Vec<(&str, f32)>) -> Result<()> {
    set_in_turn(client, wanted, &mut Vec::new())
}

/// Some ranges depend on other settings, so what is refused at first may be allowed later. Those that were set are added to
/// `changed`.
fn set_in_turn<'a>(client: &mut Client, mut left: Vec<(&'a str, f32)>, changed: &mut Vec<&'a str>) -> Result<()> {
    loop {
        let before = left.len();
        let mut refused = None;
        let mut rest = Vec::new();
        for (name, value) in left {
            match client.setting(Ask::Set { name, value }, |_| ()) {
                Ok(()) => changed.push(name),
                Err(Error::Refused(why)) => {
                    refused = Some(Error::Refused(with_name(name, why)));
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
