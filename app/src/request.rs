//! From a request to its answer. What the drive has to obey is answered when it has.

use crate::history::ENTRIES;
use crate::procedure::Procedure;
use crate::settings::{self, Entry, Settings, TABLE, find};
use crate::supervisor::Supervisor;
use crate::wire;
use embedded_storage::nor_flash::NorFlash;
use hallservo::commutation::modulation;
use hallservo::control::settings::Config;
use hallservo::drive::Command;
use hallservo_protocol::{
    self as protocol, Activity, Answer, Ask, Calibration, Commutation, Hello, History, Refusal, Setting,
};

/// Fastest telemetry, Hz.
const FASTEST: f32 = 1000.0;

/// What a request leads to.
pub(crate) enum Step {
    /// An answer at once.
    Answer(Answer<'static>),
    /// An answer when the drive has obeyed.
    Obeyed(After),
    /// An answer when the settings are in the flash.
    Saved,
}

/// What to answer when the drive has obeyed.
#[derive(Clone, Copy)]
pub(crate) enum After {
    Done,
    Disarmed,
    Calibrating,
    Cleared,
    Set(&'static Entry),
}

type Outcome = Result<Step, Refusal<'static>>;

impl<F: NorFlash> Supervisor<F> {
    /// Begins what is asked.
    #[inline(never)]
    pub fn begin(&mut self, id: u16, ask: Ask<'_>) -> Step {
        self.attempt(id, ask).unwrap_or_else(|refusal| Step::Answer(Answer::Refused(refusal)))
    }

    fn attempt(&mut self, id: u16, ask: Ask<'_>) -> Outcome {
        let answer = match ask {
            Ask::Hello => self.hello(),
            Ask::Status => Answer::Status(self.status()),
            // What comes of it is told when it is over.
            Ask::Calibration if self.activity() == Activity::Calibration => Answer::Calibration(Calibration::Turning),
            Ask::Identification if self.activity() == Activity::Identification => {
                Answer::Identification(protocol::Procedure::Turning)
            }
            Ask::Cogging if self.activity() == Activity::Cogging => Answer::Cogging(protocol::Procedure::Turning),
            Ask::Calibration => Answer::Calibration(self.calibration),
            Ask::Identification => Answer::Identification(self.identification),
            Ask::Cogging => Answer::Cogging(self.cogging),
            Ask::Setting(number) => {
                let entry = TABLE.get(usize::from(number)).ok_or(Refusal::NoSetting)?;
                Answer::Setting(self.setting(entry)?)
            }
            Ask::Get(name) => Answer::Setting(self.setting(find(name).ok_or(Refusal::NoSetting)?)?),
            Ask::Telemetry(hz) => {
                if !(0.0..=FASTEST).contains(&hz) {
                    return Err(Refusal::Beyond { value: hz, most: FASTEST });
                }
                self.stream(id, hz);
                Answer::Done
            }
            Ask::History(number) => {
                let entry = self.history.entry(number.min(ENTRIES as u8));
                Answer::History(History { total: self.history.total(), entry })
            }
            Ask::Disarm => {
                self.cancel();
                return self.obey(Command::Disarm, After::Disarmed);
            }
            _ if self.activity() != Activity::None => return Err(Refusal::Busy(self.activity())),
            _ => return self.command(ask),
        };
        Ok(Step::Answer(answer))
    }

    /// What is refused while something goes on.
    fn command(&mut self, ask: Ask<'_>) -> Outcome {
        match ask {
            Ask::Arm => self.obey(Command::Arm, After::Done),
            Ask::Clear => self.obey(Command::Clear, After::Cleared),
            Ask::Voltage(share) => {
                let share = at_most(share, self.settings.drive.max_modulation)?;
                self.obey(Command::Drive(modulation(share)), After::Done)
            }
            Ask::Torque(torque) => {
                let current = self.control()?.torque(torque).map_err(wire::demand)?;
                self.obey(Command::Current(current), After::Done)
            }
            Ask::Speed(speed) => {
                let speed = self.control()?.speed(speed).map_err(wire::demand)?;
                self.obey(Command::Speed(speed), After::Done)
            }
            Ask::Position(turns) => {
                let position = self.control()?.position(turns).map_err(wire::demand)?;
                self.obey(Command::Position(position), After::Done)
            }
            Ask::Commutate(commutation) => {
                let number = match commutation {
                    Commutation::Block => 0.0,
                    Commutation::Sinusoidal => 1.0,
                    Commutation::FieldOriented => 2.0,
                };
                self.change("commutation", number)
            }
            Ask::Calibrate => self.obey(Command::Calibrate, After::Calibrating),
            Ask::Identify => {
                self.identify()?;
                Ok(Step::Answer(Answer::Done))
            }
            Ask::LearnCogging => {
                self.learn_cogging()?;
                Ok(Step::Answer(Answer::Done))
            }
            Ask::Balance(true) if !self.has_table() => Err(Refusal::NoTable),
            Ask::Balance(on) => self.change("anti_cogging", u8::from(on).into()),
            Ask::Set { name, value } => self.change(name, value),
            Ask::Save => {
                self.ask_to_save();
                let waits = !self.is_at_rest();
                Ok(if waits { Step::Answer(Answer::Saved { waits }) } else { Step::Saved })
            }
            // A record that a power cut has left half written may be a break of the bridge when it is read.
            Ask::Load if self.mode().drives() => Err(Refusal::Mode(wire::mode(self.mode()))),
            Ask::Load => {
                let settings = self.load_settings().map_err(Refusal::NothingStored)?;
                self.adopt(settings, After::Done)
            }
            Ask::Restore => self.adopt(self.defaults, After::Done),
            // Answered by `attempt`.
            Ask::Hello
            | Ask::Status
            | Ask::Disarm
            | Ask::Calibration
            | Ask::Identification
            | Ask::Cogging
            | Ask::Setting(_)
            | Ask::Get(_)
            | Ask::Telemetry(_)
            | Ask::History(_) => Ok(Step::Answer(Answer::Done)),
        }
    }

    // Procedures are large: their way over the stack is not to add to that of other requests.
    #[inline(never)]
    fn identify(&mut self) -> Result<(), Refusal<'static>> {
        self.may_turn()?;
        Procedure::motor(self.procedure, self.service.config())?;
        self.identification = protocol::Procedure::Turning;
        Ok(())
    }

    #[inline(never)]
    fn learn_cogging(&mut self) -> Result<(), Refusal<'static>> {
        self.may_turn()?;
        Procedure::cogging(self.procedure, self.service.config())?;
        self.cogging = protocol::Procedure::Turning;
        Ok(())
    }

    fn obey(&mut self, command: Command, after: After) -> Outcome {
        self.send(command)?;
        Ok(Step::Obeyed(after))
    }

    fn adopt(&mut self, settings: Settings, after: After) -> Outcome {
        self.configure(settings)?;
        Ok(Step::Obeyed(after))
    }

    fn change(&mut self, name: &str, value: f32) -> Outcome {
        let entry = find(name).ok_or(Refusal::NoSetting)?;
        self.adopt(self.settings.with(name, value)?, After::Set(entry))
    }

    fn control(&self) -> Result<&Config, Refusal<'static>> {
        self.service.config().control.as_ref().ok_or(Refusal::NoControl)
    }

    pub fn hello(&self) -> Answer<'static> {
        let identity = self.identity;
        let settings = TABLE.len() as u16;
        Answer::Hello(Hello { board: identity.board, firmware: identity.firmware, settings, step_hz: self.step_hz() })
    }

    fn setting(&self, entry: &Entry) -> Result<Setting<'static>, Refusal<'static>> {
        let settings::Entry { name, unit, kind, fixed, .. } = *entry;
        let value = entry.get(&self.settings).ok_or(Refusal::NoControl)?;
        let default = entry.get(&self.defaults).ok_or(Refusal::NoControl)?;
        let (min, max) = entry.range(&self.settings);
        Ok(Setting { name, unit, kind, value, default, min, max, fixed })
    }

    /// What to answer, once the drive has.
    pub fn obeyed(&mut self, after: After) -> Option<Answer<'static>> {
        match (self.take_reply()?, after) {
            // Off is off.
            (Err(Refusal::Mode(_)), After::Disarmed) | (Ok(()), _) => {}
            (Err(refusal), _) => return Some(Answer::Refused(refusal)),
        }
        Some(match after {
            After::Done | After::Disarmed => Answer::Done,
            After::Calibrating => {
                self.calibration = Calibration::Turning;
                Answer::Done
            }
            After::Cleared => {
                self.relearn();
                Answer::Done
            }
            After::Set(entry) => self.setting(entry).map_or_else(Answer::Refused, Answer::Setting),
        })
    }

    /// What to answer, once the settings are saved.
    pub fn kept(&self) -> Option<Answer<'static>> {
        let kept = self.settings_saved()?;
        Some(if kept { Answer::Saved { waits: false } } else { Answer::Refused(Refusal::Flash) })
    }
}

/// `value` if it is a number of at most this magnitude.
fn at_most(value: f32, most: f32) -> Result<f32, Refusal<'static>> {
    if value.abs() <= most { Ok(value) } else { Err(Refusal::Beyond { value, most }) }
}
