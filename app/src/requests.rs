//! From a request to its answer. A command is answered when the control interrupt has.

use crate::encoder::Encoder;
use crate::history::ENTRIES;
use crate::procedure::Procedure;
#[cfg(feature = "scope")]
use crate::scope::From;
use crate::tasks::Tasks;
use crate::{Ask, Identity, Request};
use embedded_storage::nor_flash::NorFlash;
use hallservo::angle::Position;
use hallservo::commutation::{Modulation, modulation};
use hallservo::control::config::BadDemand;
use hallservo::control::config::Config;
use hallservo::drive;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
#[cfg(feature = "scope")]
use hallservo::scope::BORROWS;
use hallservo::settings::{self, Entry, Settings, TABLE, find};
#[cfg(feature = "encoder")]
use hallservo_protocol::EncoderAsk;
#[cfg(feature = "scope")]
use hallservo_protocol::ScopeAsk;
use hallservo_protocol::{self as protocol, Activity, Answer, Calibration, Hello, History, Record, Refusal, Setting};
#[cfg(feature = "map")]
use hallservo_protocol::{MagnetsAsk, MagnetsRefusal};

const UNKNOWN: Refusal<'static> = Refusal::Setting(settings::Error::Unknown);

/// Fastest telemetry, Hz.
const FASTEST: f32 = 1000.0;

/// What a request leads to.
pub(crate) enum Step {
    /// An answer at once, which is at its place.
    Answered,
    /// An answer later.
    Await(Awaited),
}

/// What the answer to a request waits for.
#[derive(Clone, Copy)]
pub(crate) enum Awaited {
    /// The drive's answer to a command.
    Reply(Command),
    /// The save of the settings.
    Saved,
}

/// The request behind a command to the drive.
#[derive(Clone, Copy)]
pub(crate) enum Command {
    Plain,
    Disarm,
    Calibrate,
    Clear,
    Set(&'static Entry),
}

type StepResult = Result<Step, Refusal<'static>>;

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Begins to answer a request.
    // An answer is written right to its place: put there in the end, whatever its kind, it takes 470 bytes more of a chip's
    // flash.
    #[inline(never)]
    pub fn begin(&mut self, request: &Request<'_>, answer: &mut Answer<'static>) -> Step {
        *answer = Answer::Done;
        self.controller.hear(request.client, self.now_ms);
        #[cfg(feature = "scope")]
        if let Ask::Scope(ask) = &request.ask {
            self.ask_scope(ask, request.client, answer);
            return Step::Answered;
        }
        // It may have lain in a buffer since before the drive has stopped its motor.
        if self.controller.bars(request.client) && request.ask.is_set_point() {
            *answer = Answer::Refused(Refusal::Drive(drive::Refusal::Fault(Fault::CommandTimeout)));
            return Step::Answered;
        }
        self.attempt(request, answer).unwrap_or_else(|refusal| {
            *answer = Answer::Refused(refusal);
            Step::Answered
        })
    }

    fn attempt(&mut self, request: &Request<'_>, answer: &mut Answer<'static>) -> StepResult {
        let Request { id, client, unattended, ask } = *request;
        if E::SETTINGS > 0
            && let Some(number) = encoder_setting::<E>(ask)
        {
            *answer = self.encoder_setting(number)?;
            return Ok(Step::Answered);
        }
        let activity = self.activity();
        match ask {
            Ask::Hello => *answer = self.hello(),
            Ask::Status => *answer = Answer::Status(self.status()),
            // Its result is answered to a later request.
            Ask::Calibration if activity == Activity::Calibration => {
                *answer = Answer::Calibration(Calibration::Running)
            }
            Ask::Identification if activity == Activity::Identification => {
                *answer = Answer::Identification(protocol::Procedure::Running);
            }
            Ask::Cogging if activity == Activity::Cogging => *answer = Answer::Cogging(protocol::Procedure::Running),
            Ask::Swings if activity == Activity::Swings => *answer = Answer::Swings(protocol::Procedure::Running),
            Ask::Swings => *answer = Answer::Swings(self.swings),
            Ask::Window => *answer = Answer::Window(self.window.take()),
            Ask::Reference => *answer = Answer::Reference(self.reference()),
            Ask::Calibration => *answer = Answer::Calibration(self.calibration),
            Ask::Identification => *answer = Answer::Identification(self.identification),
            Ask::Cogging => *answer = Answer::Cogging(self.cogging),
            Ask::Setting(number) => *answer = self.setting(TABLE.get(usize::from(number))),
            Ask::Get(name) => *answer = self.setting(find(name)),
            #[cfg(feature = "encoder")]
            Ask::Encoder(EncoderAsk::Status) => *answer = self.ask_encoder(EncoderAsk::Status)?,
            #[cfg(feature = "map")]
            Ask::Magnets(MagnetsAsk::Status) => {
                *answer = Answer::Magnets(self.magnets.status(
                    self.is_mapping(),
                    self.service.config(),
                    self.settings.full_scale_a(),
                ))
            }
            #[cfg(feature = "map")]
            Ask::Magnets(MagnetsAsk::Points(first)) => *answer = self.magnets.points(first)?,
            Ask::Telemetry(hz) => {
                if !(0.0..=FASTEST).contains(&hz) {
                    return Err(Refusal::Demand(BadDemand { value: hz, most: FASTEST }));
                }
                self.stream(id, hz);
            }
            Ask::History(number) => {
                let entry = self.history.entry(number.min(ENTRIES as u8));
                *answer = Answer::History(History { total: self.history.total(), entry });
            }
            Ask::Release => {
                self.controller.release(client);
            }
            Ask::Disarm => {
                self.controller.end();
                self.cancel();
                self.disarm()?;
                return Ok(Step::Await(Awaited::Reply(Command::Disarm)));
            }
            _ if self.controller.is_other(client) => return Err(Refusal::Controlled),
            Ask::Speed(0.0) if activity != Activity::None => {
                self.controller.take(client, unattended, self.now_ms);
                return self.brake();
            }
            _ if activity != Activity::None => return Err(Refusal::Busy(activity)),
            _ => {
                self.controller.take(client, unattended, self.now_ms);
                return self.attempt_when_idle(ask, answer);
            }
        }
        Ok(Step::Answered)
    }

    /// Requests that are refused while a procedure runs.
    fn attempt_when_idle(&mut self, ask: Ask<'_>, answer: &mut Answer<'static>) -> StepResult {
        if E::SETTINGS > 0
            && let Ask::Set { name, value } = ask
            && let Some(number) = E::find(name)
        {
            let mode = self.mode();
            self.encoder.set(number, value, mode)?;
            *answer = self.encoder_setting(number)?;
            return Ok(Step::Answered);
        }
        match ask {
            Ask::Arm | Ask::Calibrate | Ask::Identify | Ask::LearnCogging if self.unconfirmed => {
                Err(Refusal::Unconfirmed(self.stored[Record::Settings as usize]))
            }
            Ask::Accept => {
                self.unconfirmed = false;
                Ok(Step::Answered)
            }
            Ask::Arm => {
                self.encoder.may_move(false, &self.settings)?;
                self.command(drive::Command::Arm, Command::Plain)
            }
            Ask::Clear => self.command(drive::Command::Clear, Command::Clear),
            Ask::Voltage(share) => {
                let share = at_most(share, self.settings.max_modulation)?;
                self.command(drive::Command::Drive(modulation(share)), Command::Plain)
            }
            Ask::Torque(torque) => {
                let current = self.control()?.torque(torque).map_err(Refusal::Demand)?;
                self.command(drive::Command::Current(current), Command::Plain)
            }
            Ask::Speed(speed) => {
                let speed = self.control()?.speed(speed).map_err(Refusal::Demand)?;
                self.command(drive::Command::Speed(speed), Command::Plain)
            }
            Ask::Position(turns) => {
                self.encoder.may_move(true, &self.settings)?;
                let position = self.control()?.position(turns).map_err(Refusal::Demand)?;
                let origin = self.encoder.origin();
                let position = Position::from_bits(position.to_bits().wrapping_add(origin.to_bits()));
                self.command(drive::Command::Position(position), Command::Plain)
            }
            Ask::Impedance(request) => {
                self.impedance(&request)?;
                Ok(Step::Await(Awaited::Reply(Command::Plain)))
            }
            Ask::Commutate(commutation) => self.change(b"commutation", (commutation as u8).into()),
            Ask::Calibrate => self.command(drive::Command::Calibrate, Command::Calibrate),
            Ask::Identify | Ask::LearnCogging | Ask::Swing => {
                self.may_turn()?;
                match ask {
                    Ask::Identify => self.identify()?,
                    Ask::LearnCogging => self.learn_cogging()?,
                    _ => self.swing()?,
                }
                Ok(Step::Answered)
            }
            Ask::Measure { begins, probe } => self.command(drive::Command::Measure { begins, probe }, Command::Plain),
            Ask::AntiCogging(true) if !self.has_table() => Err(Refusal::NoTable),
            Ask::AntiCogging(on) => self.change(b"anti_cogging", u8::from(on).into()),
            Ask::Set { name, value } => self.change(name, value),
            #[cfg(feature = "encoder")]
            Ask::Encoder(EncoderAsk::Calibrate { by_hand: false }) if self.unconfirmed => {
                Err(Refusal::Unconfirmed(self.stored[Record::Settings as usize]))
            }
            #[cfg(feature = "map")]
            Ask::Magnets(ask) => {
                self.ask_magnets(ask)?;
                Ok(Step::Answered)
            }
            #[cfg(feature = "encoder")]
            Ask::Encoder(EncoderAsk::Align) => {
                self.align()?;
                Ok(Step::Answered)
            }
            #[cfg(feature = "encoder")]
            Ask::Encoder(ask) => {
                *answer = self.ask_encoder(ask)?;
                // The bounds of the position go with its zero.
                if self.encoder.has_moved(&self.settings) {
                    return self.resend();
                }
                Ok(Step::Answered)
            }
            Ask::Save => {
                self.request_save();
                if self.is_at_rest() {
                    return Ok(Step::Await(Awaited::Saved));
                }
                *answer = Answer::Saved { waits: true };
                Ok(Step::Answered)
            }
            // A record that a power cut has left half written may be a break of the bridge when it is read.
            Ask::Load if self.mode().drives() => Err(Refusal::Drive(drive::Refusal::Mode(self.mode()))),
            Ask::Load => self.load(),
            Ask::Restore => self.restore(),
            // Answered before.
            Ask::Hello
            | Ask::Status
            | Ask::Disarm
            | Ask::Calibration
            | Ask::Identification
            | Ask::Cogging
            | Ask::Swings
            | Ask::Window
            | Ask::Reference
            | Ask::Setting(_)
            | Ask::Get(_)
            | Ask::Telemetry(_)
            | Ask::History(_)
            | Ask::Release => Ok(Step::Answered),
            #[cfg(feature = "scope")]
            Ask::Scope(_) => Ok(Step::Answered),
        }
    }

    #[cfg(feature = "scope")]
    fn ask_scope(&mut self, ask: &ScopeAsk, client: u32, answer: &mut Answer<'static>) {
        let (now_ms, step_hz) = (self.now_ms, self.step_hz());
        let origin = (self.encoder.origin().to_bits() >> 16) as i32;
        // The sums of a calibration are where the rows would be.
        if BORROWS && matches!(ask, ScopeAsk::Begin { .. }) && self.activity() == Activity::Calibration {
            *answer = Answer::Refused(Refusal::Busy(Activity::Calibration));
            return;
        }
        self.scope.ask(ask, From { client, now_ms, service: self.service, step_hz, origin }, answer);
    }

    #[cfg(feature = "encoder")]
    fn ask_encoder(&mut self, ask: EncoderAsk) -> Result<Answer<'static>, Refusal<'static>> {
        let mode = self.mode();
        self.encoder.ask(ask, self.service, &self.settings, mode)
    }

    fn encoder_setting(&self, number: u16) -> Result<Answer<'static>, Refusal<'static>> {
        self.encoder.setting(number).map(Answer::Setting).ok_or(UNKNOWN)
    }

    // Procedures are large: not inlined, they do not add to the stack of other requests.
    #[inline(never)]
    fn identify(&mut self) -> Result<(), Refusal<'static>> {
        Procedure::motor(self.procedure, self.service.config())?;
        self.identification = protocol::Procedure::Running;
        Ok(())
    }

    #[inline(never)]
    fn swing(&mut self) -> Result<(), Refusal<'static>> {
        Procedure::swings(self.procedure, self.service.config())?;
        self.swings = protocol::Procedure::Running;
        Ok(())
    }

    #[inline(never)]
    fn learn_cogging(&mut self) -> Result<(), Refusal<'static>> {
        Procedure::cogging(self.procedure, self.service.config())?;
        #[cfg(feature = "map")]
        self.magnets.begin_by_pole(&self.settings);
        self.cogging = protocol::Procedure::Running;
        Ok(())
    }

    /// What changes the map of the magnets.
    #[cfg(feature = "map")]
    #[inline(never)]
    fn ask_magnets(&mut self, ask: MagnetsAsk) -> Result<(), Refusal<'static>> {
        match ask {
            MagnetsAsk::Learn if E::SETTINGS > 0 => Err(Refusal::Magnets(MagnetsRefusal::Encoder)),
            MagnetsAsk::Learn if self.unconfirmed => Err(Refusal::Unconfirmed(self.stored[Record::Settings as usize])),
            MagnetsAsk::Learn => {
                self.may_turn()?;
                Procedure::magnets(self.procedure, self.service.config())?;
                self.magnets.begin(&self.settings);
                Ok(())
            }
            MagnetsAsk::Forget => {
                self.magnets.forget();
                self.relearn();
                Ok(())
            }
            // Answered by `attempt`.
            MagnetsAsk::Status | MagnetsAsk::Points(_) => Ok(()),
        }
    }

    /// Ends what goes on by braking; a calibration leaves the bridge on until it is disarmed.
    fn brake(&mut self) -> StepResult {
        self.cancel();
        match self.mode() {
            Mode::Aligning | Mode::Calibrating => self.command(drive::Command::Drive(Modulation::ZERO), Command::Plain),
            _ => Ok(Step::Answered),
        }
    }

    #[inline(never)]
    fn command(&mut self, command: drive::Command, kind: Command) -> StepResult {
        self.send(command)?;
        Ok(Step::Await(Awaited::Reply(kind)))
    }

    #[inline(never)]
    fn reconfigure(&mut self, settings: &Settings, kind: Command) -> StepResult {
        self.configure(settings)?;
        Ok(Step::Await(Awaited::Reply(kind)))
    }

    // Settings are large: what copies them has a stack frame of its own.
    #[inline(never)]
    fn load(&mut self) -> StepResult {
        let mut settings = self.settings;
        self.load_settings(&mut settings).map_err(Refusal::NothingStored)?;
        self.reconfigure(&settings, Command::Plain)
    }

    #[cfg(feature = "encoder")]
    #[inline(never)]
    fn resend(&mut self) -> StepResult {
        self.reconfigure(&{ self.settings }, Command::Plain)
    }

    #[inline(never)]
    fn restore(&mut self) -> StepResult {
        self.reconfigure(&{ self.defaults }, Command::Plain)
    }

    #[inline(never)]
    fn change(&mut self, name: &[u8], value: f32) -> StepResult {
        let entry = find(name).ok_or(UNKNOWN)?;
        let mut settings = self.settings;
        entry.change(&mut settings, value).map_err(Refusal::Setting)?;
        if entry.is_tunable() {
            self.retune(&settings)?;
            return Ok(Step::Await(Awaited::Reply(Command::Set(entry))));
        }
        self.reconfigure(&settings, Command::Set(entry))
    }

    fn control(&self) -> Result<&Config, Refusal<'static>> {
        self.service.config().control.as_ref().ok_or(Refusal::Drive(drive::Refusal::NoControl))
    }

    pub fn hello(&self) -> Answer<'static> {
        let Identity { board, firmware, serial } = self.identity;
        let settings = TABLE.len() as u16 + E::SETTINGS;
        Answer::Hello(Hello { board, firmware, serial, settings, step_hz: self.step_hz() })
    }

    #[inline(never)]
    fn setting(&self, entry: Option<&Entry>) -> Answer<'static> {
        let Some(entry) = entry else { return Answer::Refused(UNKNOWN) };
        let (name, unit, kind, fixed) = (entry.name, entry.unit(), entry.kind(), entry.fixed(&self.defaults));
        let (Some(value), Some(default), Some((min, max))) =
            (entry.get(&self.settings), entry.get(&self.defaults), entry.range(&self.settings))
        else {
            return Answer::Refused(Refusal::Drive(drive::Refusal::NoControl));
        };
        Answer::Setting(Setting { name, unit, kind, value, default, min, max, fixed })
    }

    /// The answer that a request waits for, once it is known.
    pub fn awaited(&mut self, awaited: Awaited) -> Option<Answer<'static>> {
        match awaited {
            Awaited::Reply(command) => self.take_reply().map(|reply| self.answer_to(command, reply)),
            Awaited::Saved => self.settings_saved().map(|saved| match saved {
                true => Answer::Saved { waits: false },
                false => Answer::Refused(Refusal::Flash),
            }),
        }
    }

    fn answer_to(&mut self, command: Command, reply: drive::Reply) -> Answer<'static> {
        match (command, reply) {
            // A bridge that is off already has nothing to disarm.
            (Command::Disarm, Err(drive::Refusal::Mode(_))) => return Answer::Done,
            (_, Err(refusal)) => return Answer::Refused(Refusal::Drive(refusal)),
            (Command::Plain | Command::Disarm, Ok(())) => {}
            (Command::Calibrate, Ok(())) => {
                self.calibration = Calibration::Running;
                self.set_sensors_aside();
            }
            (Command::Clear, Ok(())) => {
                // Before the next request, which may be to arm.
                self.install();
                self.relearn();
            }
            (Command::Set(entry), Ok(())) => return self.setting(Some(entry)),
        }
        Answer::Done
    }

    /// Gives up an answer that nothing waits for any more.
    pub const fn give_up(&mut self, awaited: Awaited) {
        if let Awaited::Reply(_) = awaited {
            self.abandon_reply();
        }
    }
}

/// The number of the encoder's setting that is asked for.
fn encoder_setting<E: Encoder>(ask: Ask<'_>) -> Option<u16> {
    match ask {
        Ask::Setting(number) => number.checked_sub(TABLE.len() as u16),
        Ask::Get(name) => E::find(name),
        _ => None,
    }
}

/// `value` if it is a number of at most this magnitude.
fn at_most(value: f32, most: f32) -> Result<f32, Refusal<'static>> {
    if value.abs() <= most { Ok(value) } else { Err(Refusal::Demand(BadDemand { value, most })) }
}
