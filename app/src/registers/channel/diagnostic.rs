//! The drive as the diagnostic channel sees it: its settings as a configuration, which changes as it does for any other
//! tool.

use super::super::CLIENT;
use super::super::axis::Drive;
use crate::encoder::Encoder;
use crate::requests::{Awaited, Step};
use crate::{Ask, Request};
use core::fmt;
use embedded_storage::nor_flash::NorFlash;
use hallservo::settings::{self, TABLE, find};
use hallservo_protocol::{Answer, Refusal};
use hallservo_registers::axis::Command;
use hallservo_registers::diagnostic::{Build, Change, Diagnostic, Halls, Host, Kind, Setting};

/// Ticks until a control interrupt that does not answer, or a flash, is given up.
const PATIENCE: u32 = 100;

/// The setting that is the address on the bus, of a drive that has it.
const BUS_ID: &str = "bus_id";

/// The channel.
pub(in super::super) struct Channel(Diagnostic);

impl Channel {
    pub const fn new() -> Self {
        Self(Diagnostic::new())
    }

    /// What frames carry to it and from it.
    pub const fn tunnel(&mut self) -> &mut Diagnostic {
        &mut self.0
    }

    /// After a frame.
    #[inline(never)]
    pub fn serve<F: NorFlash, E: Encoder>(&mut self, drive: &mut Drive<'_, F, E>) {
        self.0.serve(drive);
    }

    /// Once a millisecond, while nothing else waits for the drive.
    #[inline(never)]
    pub fn tick<F: NorFlash, E: Encoder>(&mut self, drive: &mut Drive<'_, F, E>) {
        drive.proceed();
        self.0.tick(drive);
    }
}

/// The change of the settings that is on its way.
pub(in super::super) struct Pending(Option<Progress>);

impl Pending {
    pub const fn new() -> Self {
        Self(None)
    }

    /// Whether the drive owes an answer.
    pub const fn waits(&self) -> bool {
        matches!(self.0, Some(Progress::Awaited(Awaited::Reply(_), _)))
    }
}

/// How far a change is.
#[derive(Clone, Copy)]
enum Progress {
    /// The drive has not been told.
    Wanted(Change),
    /// The drive or the flash is at work, for so many ticks.
    Awaited(Awaited, u32),
    /// It is over.
    Over(Result<(), Why>),
}

/// Why a change is refused.
#[derive(Clone, Copy)]
pub(crate) enum Why {
    Refused(Refusal<'static>),
    /// The flash is written when the bridge is off.
    Later,
    /// The address on the bus follows from the board.
    Address,
}

impl<F: NorFlash, E: Encoder> Drive<'_, F, E> {
    fn proceed(&mut self) {
        let progress = match self.pending.0.take() {
            Some(Progress::Wanted(change)) => self.begin_change(change),
            Some(Progress::Awaited(awaited, ticks)) => match self.tasks.awaited(awaited) {
                Some(answer) => Progress::over(answer),
                None if ticks < PATIENCE => Progress::Awaited(awaited, ticks + 1),
                None => {
                    self.tasks.give_up(awaited);
                    Progress::Over(Err(Why::Refused(Refusal::NoAnswer)))
                }
            },
            other => {
                self.pending.0 = other;
                return;
            }
        };
        if matches!(progress, Progress::Over(_)) && !self.tasks.mode().drives() {
            // Nobody has to wait for a client that only wanted to set something.
            self.tasks.controller.release(CLIENT);
        }
        self.pending.0 = Some(progress);
    }

    fn begin_change(&mut self, change: Change) -> Progress {
        let name = |number: u16| match TABLE.get(usize::from(number)) {
            Some(entry) => entry.name,
            None => self.tasks.encoder.setting(number - TABLE.len() as u16).map_or("", |setting| setting.name),
        };
        let ask = match change {
            Change::Set(number, value) => Ask::Set { name: name(number).as_bytes(), value },
            Change::Save => Ask::Save,
            Change::Load => Ask::Load,
            Change::Default => Ask::Restore,
            Change::Id(id) if find(BUS_ID).is_some() => Ask::Set { name: BUS_ID.as_bytes(), value: id.into() },
            Change::Id(_) => return Progress::Over(Err(Why::Address)),
        };
        let mut answer = Answer::Done;
        match self.tasks.begin(&Request { id: 0, client: CLIENT, unattended: false, ask }, &mut answer) {
            Step::Answered => Progress::over(answer),
            Step::Await(awaited) => Progress::Awaited(awaited, 0),
        }
    }
}

impl Progress {
    fn over(answer: Answer<'static>) -> Self {
        Self::Over(match answer {
            Answer::Refused(refusal) => Err(Why::Refused(refusal)),
            Answer::Saved { waits: true } => Err(Why::Later),
            _ => Ok(()),
        })
    }
}

impl<F: NorFlash, E: Encoder> Host for Drive<'_, F, E> {
    type Refusal = Why;

    fn settings(&self) -> u16 {
        TABLE.len() as u16 + E::SETTINGS
    }

    #[inline(never)]
    fn setting(&self, number: u16) -> Option<Setting<'_>> {
        let Some(entry) = TABLE.get(usize::from(number)) else {
            let setting = self.tasks.encoder.setting(number - TABLE.len() as u16)?;
            return Some(Setting { name: setting.name, kind: kind(setting.kind), value: setting.value });
        };
        let value = entry.get(&self.tasks.settings)?;
        Some(Setting { name: entry.name, kind: kind(entry.kind()), value })
    }

    fn id(&self) -> u8 {
        let setting = find(BUS_ID).and_then(|entry| entry.get(&self.tasks.settings));
        setting.map_or(self.id, |id| id as u8)
    }

    fn begin(&mut self, change: Change) {
        self.pending.0 = Some(Progress::Wanted(change));
    }

    fn outcome(&mut self) -> Option<Result<(), Why>> {
        match self.pending.0.take() {
            Some(Progress::Over(result)) => Some(result),
            other => {
                self.pending.0 = other;
                None
            }
        }
    }

    fn renew(&mut self, motion: &Command) -> bool {
        self.sequence.renew(motion, self.tasks)
    }

    fn build(&self) -> Build {
        let crate::Identity { board, firmware, .. } = self.tasks.identity;
        Build { board, release: firmware, commit: COMMIT }
    }

    fn halls(&self) -> Halls {
        self.tasks.halls()
    }
}

const fn kind(kind: settings::Kind<'static>) -> Kind<'static> {
    match kind {
        settings::Kind::Real => Kind::Real,
        settings::Kind::Whole => Kind::Whole,
        settings::Kind::Switch => Kind::Switch,
        settings::Kind::Choice(names) => Kind::Choice(names),
    }
}

/// The commit that this was built from, where the build was told: `HALLSERVO_COMMIT`, forty hexadecimal digits.
const COMMIT: [u8; 20] = match option_env!("HALLSERVO_COMMIT") {
    Some(text) => commit(text.as_bytes()),
    None => [0; 20],
};

const fn commit(digits: &[u8]) -> [u8; 20] {
    assert!(digits.len() == 40, "HALLSERVO_COMMIT has forty digits");
    let mut bytes = [0; 20];
    let mut place = 0;
    while place < bytes.len() {
        bytes[place] = digit(digits[2 * place]) << 4 | digit(digits[2 * place + 1]);
        place += 1;
    }
    bytes
}

const fn digit(digit: u8) -> u8 {
    match (digit as char).to_digit(16) {
        Some(value) => value as u8,
        None => panic!("HALLSERVO_COMMIT has hexadecimal digits"),
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Later => f.write_str("not yet: it is saved when the bridge is off and the rotor at rest"),
            Self::Address => f.write_str("the address follows from the board"),
            Self::Refused(Refusal::Setting(error)) => error.fmt(f),
            Self::Refused(Refusal::Drive(why)) => why.fmt(f),
            Self::Refused(Refusal::Demand(why)) => why.fmt(f),
            Self::Refused(Refusal::NothingStored(_)) => f.write_str("the flash holds no settings"),
            Self::Refused(Refusal::Flash) => f.write_str("the flash did not take it"),
            Self::Refused(Refusal::Busy(_)) => f.write_str("a procedure is at work, which d stop ends"),
            Self::Refused(Refusal::Controlled) => f.write_str("another tool controls the drive"),
            Self::Refused(Refusal::NoAnswer) => f.write_str("the control interrupt does not answer"),
            Self::Refused(_) => f.write_str("the drive cannot now"),
        }
    }
}
