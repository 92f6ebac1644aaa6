//! What has fields with values: the groups of the configuration, and the telemetry channels.

use super::host::{Change, Host, Kind, Setting};
use super::piece::Piece;
use super::record::{Build, Halls, Record};
use super::value::{Type, Value};
use crate::axis::{BusHealth, Identity, State};

/// Most bytes of the data of a channel, with names of 40 bytes.
pub(super) const DATA: usize = 128;

/// A group of the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Group {
    /// The address on the bus.
    Id,
    /// What tells this drive from all others: cannot be set, and is not dumped with the rest.
    Uuid,
    /// The settings.
    Servo,
}

/// A telemetry channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    ServoStats,
    Halls,
    Can,
    Firmware,
    Git,
}

/// Either.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Group(Group),
    Channel(Channel),
}

/// A field of the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Field<'a> {
    pub name: &'a str,
    pub kind: Type<'a>,
}

impl Group {
    pub const ALL: [Self; 3] = [Self::Id, Self::Uuid, Self::Servo];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Id => "id",
            Self::Uuid => "uuid",
            Self::Servo => "servo",
        }
    }

    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|group| group.name() == name)
    }

    /// Fields, some of which may not be there.
    fn len(self, host: &impl Host) -> u16 {
        match self {
            Self::Id | Self::Uuid => 1,
            Self::Servo => host.settings(),
        }
    }

    /// The number of the field with a name.
    pub fn position(self, host: &impl Host, name: &str) -> Option<u16> {
        (0..self.len(host)).find(|number| self.field(host, *number).is_some_and(|field| field.name == name))
    }

    #[inline(never)]
    fn field(self, host: &impl Host, number: u16) -> Option<Field<'_>> {
        match self {
            Self::Id => Some(Field { name: "id", kind: Type::U8 }),
            Self::Uuid => Some(Field { name: "uuid", kind: Type::Array(16, &Type::U8) }),
            Self::Servo => host.setting(number).map(|Setting { name, kind, .. }| Field { name, kind: kind.into() }),
        }
    }

    /// The data of a field.
    #[inline(never)]
    fn value(self, host: &impl Host, number: u16, piece: &mut Piece<'_>) {
        match self {
            Self::Id => host.id().write(piece),
            Self::Uuid => host.identity().uuid().write(piece),
            Self::Servo => {
                let Some(Setting { kind, value, .. }) = host.setting(number) else { return };
                match kind {
                    Kind::Real => value.write(piece),
                    Kind::Whole => piece.bytes(&(value as i32).to_le_bytes()),
                    Kind::Switch | Kind::Choice(_) => (value as u8).write(piece),
                }
            }
        }
    }

    fn data<'a>(self, host: &impl Host, number: u16, room: &'a mut [u8]) -> &'a [u8] {
        let mut data = Piece::new(room);
        self.value(host, number, &mut data);
        data.written()
    }

    /// What sets a field to what a person wrote.
    pub fn change(self, host: &impl Host, number: u16, text: &str) -> Result<Change, &'static str> {
        const NUMBER: &str = "not a number";
        match self {
            Self::Id => text.parse().map(Change::Id).map_err(|_| "not a whole number from 0 to 255"),
            Self::Uuid => Err("it cannot be set"),
            Self::Servo => {
                let setting = host.setting(number).ok_or("no such setting")?;
                let value = match (text.parse::<f32>(), setting.kind) {
                    (Ok(value), _) => value,
                    (Err(_), Kind::Switch) => match text {
                        "true" | "yes" => 1.0,
                        "false" | "no" => 0.0,
                        _ => return Err("neither yes nor no"),
                    },
                    (Err(_), Kind::Choice(names)) => {
                        names.split('|').position(|name| name == text).ok_or("none of its names")? as f32
                    }
                    (Err(_), _) => return Err(NUMBER),
                };
                Ok(Change::Set(number, value))
            }
        }
    }
}

impl Channel {
    pub const ALL: [Self; 5] = [Self::ServoStats, Self::Halls, Self::Can, Self::Firmware, Self::Git];

    pub const fn name(self) -> &'static str {
        match self {
            Self::ServoStats => "servo_stats",
            Self::Halls => "halls",
            Self::Can => "can",
            Self::Firmware => "firmware",
            Self::Git => "git",
        }
    }

    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.name() == name)
    }

    const fn fields(self) -> &'static [(&'static str, Type<'static>)] {
        match self {
            Self::ServoStats => State::FIELDS,
            Self::Halls => Halls::FIELDS,
            Self::Can => BusHealth::FIELDS,
            Self::Firmware => <(Identity, Build)>::FIELDS,
            Self::Git => Build::FIELDS,
        }
    }

    /// All data, as they are now.
    #[inline(never)]
    fn write(self, host: &impl Host, piece: &mut Piece<'_>) {
        match self {
            Self::ServoStats => host.state().write(piece),
            Self::Halls => host.halls().write(piece),
            Self::Can => host.state().bus.write(piece),
            Self::Firmware => (host.identity(), host.build()).write(piece),
            Self::Git => host.build().write(piece),
        }
    }
}

impl Source {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Group(group) => group.name(),
            Self::Channel(channel) => channel.name(),
        }
    }

    /// Fields, some of which may not be there.
    pub fn len(self, host: &impl Host) -> u16 {
        match self {
            Self::Group(group) => group.len(host),
            Self::Channel(channel) => channel.fields().len() as u16,
        }
    }

    /// Declares a field in a schema.
    pub fn declare(self, host: &impl Host, number: u16, piece: &mut Piece<'_>) {
        let field = match self {
            Self::Group(group) => group.field(host, number),
            Self::Channel(channel) => {
                channel.fields().get(usize::from(number)).map(|&(name, kind)| Field { name, kind })
            }
        };
        if let Some(Field { name, kind }) = field {
            kind.field(name, piece);
        }
    }

    /// The data of a field; all data of a channel at once, as they belong together.
    pub fn data(self, host: &impl Host, number: u16, piece: &mut Piece<'_>) {
        match self {
            Self::Group(group) => group.value(host, number, piece),
            Self::Channel(channel) if number == 0 => channel.write(host, piece),
            Self::Channel(_) => {}
        }
    }
}

/// A field of a group with its value, as lines.
pub(super) fn print_field(group: Group, host: &impl Host, number: u16, piece: &mut Piece<'_>) {
    let Some(Field { name, kind }) = group.field(host, number) else { return };
    let mut room = [0; DATA];
    print(group.name(), name, &kind, group.data(host, number, &mut room), piece);
}

/// The value of a field of a group; of one that has several, that with an index.
pub(super) fn print_value(
    group: Group,
    host: &impl Host,
    number: u16,
    index: usize,
    piece: &mut Piece<'_>,
) -> Option<()> {
    let Field { kind, .. } = group.field(host, number)?;
    let mut room = [0; DATA];
    let data = group.data(host, number, &mut room);
    let (each, length) = each(&kind);
    each.print(data.get(index * each.size(data)..).filter(|_| index < length)?, piece);
    Some(())
}

/// A channel with its values, as lines.
pub(super) fn print_channel(channel: Channel, host: &impl Host, piece: &mut Piece<'_>) {
    let mut room = [0; DATA];
    let mut data = Piece::new(&mut room);
    channel.write(host, &mut data);
    let mut rest = data.written();
    for (name, kind) in channel.fields() {
        print(channel.name(), name, kind, rest, piece);
        rest = rest.get(kind.size(rest)..).unwrap_or_default();
    }
}

/// The type of the values of a field, and how many there are.
fn each<'a>(kind: &Type<'a>) -> (Type<'a>, usize) {
    match *kind {
        Type::Array(length, each) => (*each, length.into()),
        kind => (kind, 1),
    }
}

#[inline(never)]
fn print(source: &str, name: &str, kind: &Type<'_>, data: &[u8], piece: &mut Piece<'_>) {
    use core::fmt::Write;
    let (each, length) = each(kind);
    for index in 0..length {
        piece.text(&[source, ".", name]);
        if matches!(kind, Type::Array(..)) {
            // What has no room is left out.
            let _ = write!(piece, ".{index}");
        }
        piece.text(&[" "]);
        each.print(data.get(index * each.size(data)..).unwrap_or_default(), piece);
        piece.text(&["\r\n"]);
    }
}

impl<'a> From<Kind<'a>> for Type<'a> {
    fn from(kind: Kind<'a>) -> Self {
        match kind {
            Kind::Real => Self::F32,
            Kind::Whole => Self::I32,
            Kind::Switch => Self::Bool,
            Kind::Choice(names) => Self::Choice(names),
        }
    }
}
