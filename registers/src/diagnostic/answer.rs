//! Answers, of which only the next piece is ever written.

use super::host::Host;
use super::piece::{Piece, Stage};
use super::source::{self, Channel, Group, Source};
use super::value::{BEGIN, FINAL};
use core::fmt::Write;

/// What is left of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// Nothing.
    None,
    /// The drive has to say what has become of a change.
    Awaited,
    /// One line.
    Word(&'static str),
    /// The drive's refusal.
    Refused,
    /// The names of the groups or the channels.
    Names { groups: bool },
    /// The values of a group from a field on, and of `groups` behind it.
    Lines { group: Group, from: u16, behind: &'static [Group] },
    /// One value.
    Value { group: Group, number: u16, index: u16 },
    /// The data of a channel.
    Emit(Channel),
    /// A schema or the data of something, announced by these words and its name.
    Blob { source: Source, part: Part, announced: &'static str },
    /// So many bytes of it from a field on.
    Fields { source: Source, part: Part, from: u16, left: u16 },
}

/// Of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Schema,
    Data,
}

/// Groups that a dump is made of.
const DUMPED: &[Group] = &[Group::Id, Group::Servo];

impl Answer {
    /// It is done.
    pub const DONE: Self = Self::Word("OK");

    /// All values of the configuration that another drive may have as well.
    pub const fn dump() -> Self {
        Self::lines(DUMPED)
    }

    /// The values of groups.
    pub const fn lines(groups: &'static [Group]) -> Self {
        match groups {
            [] => Self::DONE,
            [group, behind @ ..] => Self::Lines { group: *group, from: 0, behind },
        }
    }

    /// Writes the next piece, and returns what is left.
    pub fn piece<H: Host>(
        self,
        host: &H,
        stage: &mut Stage,
        sentence: &str,
        as_text: impl FnOnce(Channel) -> bool,
    ) -> Self {
        match self {
            Self::None | Self::Awaited => return self,
            Self::Word(word) => _ = stage.fill(|piece| piece.text(&[word, "\r\n"])),
            Self::Refused => {
                stage.fill(|piece| {
                    // What has no room is left out.
                    let _ = write!(piece, "ERR {sentence}");
                    piece.text(&["\r\n"]);
                });
            }
            Self::Names { groups } => _ = stage.fill(|piece| names(groups, piece)),
            Self::Lines { group, from, behind } => {
                if from >= Source::Group(group).len(host) {
                    return Self::lines(behind);
                }
                stage.fill(|piece| source::print_field(group, host, from, piece));
                return Self::Lines { group, from: from + 1, behind };
            }
            Self::Value { group, number, index } => _ = stage.fill(|piece| value(group, host, number, index, piece)),
            Self::Emit(channel) => {
                let as_text = as_text(channel);
                stage.fill(|piece| emit(channel, as_text, host, piece));
                if as_text {
                    return Self::DONE;
                }
            }
            Self::Blob { source, part, announced } => {
                let fields = source.len(host);
                let total = (0..=fields + 1).map(|number| stage.fill(|piece| field(source, part, host, number, piece)));
                let total = total.sum::<usize>();
                stage.fill(|piece| announce(announced, source, total, piece));
                return Self::Fields { source, part, from: 0, left: total as u16 };
            }
            Self::Fields { source, part, from, left } => {
                if left == 0 {
                    return Self::None;
                }
                let length = stage.fill(|piece| field(source, part, host, from, piece));
                // As many bytes as were announced, should the settings be others meanwhile.
                let is_last = from > source.len(host);
                let length = if is_last { left.into() } else { length.min(left.into()) };
                stage.resize(length);
                return Self::Fields { source, part, from: from + 1, left: left - length as u16 };
            }
        }
        Self::None
    }
}

/// A part of a schema or of data: 0 the beginning, then the fields, then the end.
fn field(source: Source, part: Part, host: &impl Host, number: u16, piece: &mut Piece<'_>) {
    match (part, number.checked_sub(1)) {
        (Part::Schema, None) => piece.bytes(&BEGIN),
        (Part::Schema, Some(number)) if number < source.len(host) => source.declare(host, number, piece),
        (Part::Schema, Some(_)) => piece.bytes(&FINAL),
        (Part::Data, Some(number)) if number < source.len(host) => source.data(host, number, piece),
        (Part::Data, _) => {}
    }
}

fn announce(words: &str, source: Source, length: usize, piece: &mut Piece<'_>) {
    piece.text(&[words, " ", source.name(), "\r\n"]);
    piece.bytes(&(length as u32).to_le_bytes());
}

fn names(groups: bool, piece: &mut Piece<'_>) {
    if groups {
        Group::ALL.iter().for_each(|group| piece.text(&[group.name(), "\r\n"]));
    } else {
        Channel::ALL.iter().for_each(|channel| piece.text(&[channel.name(), "\r\n"]));
    }
    piece.text(&["OK\r\n"]);
}

fn value(group: Group, host: &impl Host, number: u16, index: u16, piece: &mut Piece<'_>) {
    match source::print_value(group, host, number, index.into(), piece) {
        Some(()) => piece.text(&["\r\n"]),
        None => piece.text(&["ERR error reading: there is no such value\r\n"]),
    }
}

/// The data of a channel as they are now.
pub(super) fn emit(channel: Channel, as_text: bool, host: &impl Host, piece: &mut Piece<'_>) {
    if as_text {
        return source::print_channel(channel, host, piece);
    }
    let mut room = [0; source::DATA];
    let mut data = Piece::new(&mut room);
    Source::Channel(channel).data(host, 0, &mut data);
    let data = data.written();
    announce("emit", Source::Channel(channel), data.len(), piece);
    piece.bytes(data);
}
