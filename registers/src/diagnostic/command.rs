//! What a line asks for.

use super::answer::{Answer, Part};
use super::host::{Change, Host};
use super::lines::Note;
use super::source::{Channel, Group, Source};
use super::{Diagnostic, Rate};
use core::str::SplitAsciiWhitespace;

const UNKNOWN_SUB_COMMAND: Answer = Answer::Word("ERR unknown subcommand");
// Clients look for these words.
const UNKNOWN_GROUP: Answer = Answer::Word("ERR unknown group");
const UNKNOWN_FIELD: Answer = Answer::Word("ERR error reading: there is no such setting");
const UNKNOWN_CHANNEL: Answer = Answer::Word("ERR unknown name");

impl Diagnostic {
    /// Begins what a line asks for.
    pub(super) fn carry_out<H: Host>(&mut self, host: &mut H, line: &str) -> Answer {
        let mut words = line.split_ascii_whitespace();
        let (group, name) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        match group {
            "conf" => self.configuration(host, name, words),
            "tel" => self.telemetry(name, words),
            _ => Answer::Word(Note::Unknown.text()),
        }
    }

    fn configuration<H: Host>(&mut self, host: &mut H, name: &str, mut words: SplitAsciiWhitespace<'_>) -> Answer {
        let change = match name {
            "write" => Change::Save,
            "load" => Change::Load,
            "default" => Change::Default,
            "list" => return Answer::Names { groups: true },
            "enumerate" => {
                return words.next().map_or(Answer::dump(), |name| {
                    Group::find(name).map_or(UNKNOWN_GROUP, |group| Answer::Lines { group, from: 0, behind: &[] })
                });
            }
            "get" => {
                return place(host, words.next())
                    .map_or_else(|answer| answer, |(group, number, index)| Answer::Value { group, number, index });
            }
            "set" => {
                let (group, number) = match place(host, words.next()) {
                    Ok((group, number, 0)) => (group, number),
                    // What can be set is no list.
                    Ok(_) => return UNKNOWN_FIELD,
                    Err(answer) => return answer,
                };
                match group.change(host, number, words.next().unwrap_or_default()) {
                    Ok(change) => change,
                    Err(why) => return self.refuse(format_args!("error setting: {why}")),
                }
            }
            "schema" => return blob(words.next(), Part::Schema, "cschema"),
            "data" => return blob(words.next(), Part::Data, "cdata"),
            _ => return UNKNOWN_SUB_COMMAND,
        };
        // A dump can be restored though it has values that cannot be set, as long as they are the same.
        if is_so(host, change) {
            return Answer::DONE;
        }
        host.begin(change);
        Answer::Awaited
    }

    fn telemetry(&mut self, name: &str, mut words: SplitAsciiWhitespace<'_>) -> Answer {
        match name {
            "list" => return Answer::Names { groups: false },
            "stop" => {
                for channel in &mut self.channels {
                    *channel = Rate { as_text: channel.as_text, ..Rate::default() };
                }
                return Answer::DONE;
            }
            "text" => {
                self.channels.iter_mut().for_each(|channel| channel.as_text = true);
                return Answer::DONE;
            }
            "get" | "schema" | "rate" | "fmt" => {}
            _ => return UNKNOWN_SUB_COMMAND,
        }
        let Some(channel) = words.next().and_then(Channel::find) else { return UNKNOWN_CHANNEL };
        match name {
            "get" => return Answer::Emit(channel),
            "schema" => {
                return Answer::Blob { source: Source::Channel(channel), part: Part::Schema, announced: "schema" };
            }
            _ => {}
        }
        let Some(Ok(number)) = words.next().map(str::parse::<u16>) else {
            return Answer::Word("ERR not a whole number from 0 to 65535");
        };
        let rate = &mut self.channels[channel as usize];
        match name {
            "rate" => *rate = Rate { period_ms: number, left_ms: number, is_due: false, ..*rate },
            _ => rate.as_text = number != 0,
        }
        Answer::DONE
    }
}

/// Whether a change would change nothing.
fn is_so(host: &impl Host, change: Change) -> bool {
    match change {
        Change::Set(number, value) => host.setting(number).is_some_and(|setting| setting.value == value),
        Change::Id(id) => host.id() == id,
        Change::Save | Change::Load | Change::Default => false,
    }
}

/// What `group.field` or `group.field.index` names.
fn place(host: &impl Host, name: Option<&str>) -> Result<(Group, u16, u16), Answer> {
    let (group, field) = name.unwrap_or_default().split_once('.').ok_or(UNKNOWN_GROUP)?;
    let group = Group::find(group).ok_or(UNKNOWN_GROUP)?;
    let (field, index) = field.split_once('.').unwrap_or((field, "0"));
    let number = group.position(host, field).ok_or(UNKNOWN_FIELD)?;
    Ok((group, number, index.parse().map_err(|_| UNKNOWN_FIELD)?))
}

fn blob(name: Option<&str>, part: Part, announced: &'static str) -> Answer {
    let group = name.and_then(Group::find);
    group.map_or(UNKNOWN_CHANNEL, |group| Answer::Blob { source: Source::Group(group), part, announced })
}
