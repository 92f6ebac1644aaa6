//! Two rings: their calibration, their record, and what they are used for.

mod asks;
mod looks;

use super::Encoder;
use core::mem::MaybeUninit;
use hallservo::angle::{ElectricalAngle, MechanicalAngle, Position};
use hallservo::config::Config;
use hallservo::drive::Drive;
use hallservo::drive::absolute::{
    AbsoluteChannels, AbsoluteDrive, AbsoluteInterrupt, AbsoluteTasks, Mounting, SampleOf,
};
use hallservo::mode::Mode;
use hallservo::service::encoder::EncoderCalibration;
use hallservo::service::procedure::{Procedure as _, State};
use hallservo::service::{Event, Service};
use hallservo::settings::Settings;
use hallservo::storage::vernier::{self, Known};
use hallservo::vernier::continuity::Fault;
use hallservo::vernier::encoder::{self, Calibration};
use hallservo::vernier::rings::{Ring, Rings};
use hallservo::vernier::settings::TABLE;
use hallservo_protocol::{Activity, Answer, EncoderAsk, EncoderCalibration as Outcome, Problem, Refusal, Setting};
use looks::Agreement;

/// Samples that the tasks get in a second: enough for a calibration at a turn a second, and few enough for the tasks.
const SAMPLE_HZ: f32 = 5000.0;
/// How far the Halls may be from the encoder while the motor turns, electrical degrees: the field of the windings reaches
/// them, and heat.
const TOLERANCE_DEG: f32 = 30.0;
/// Share by which the shaft may turn faster than max_electrical_hz before the encoder refuses its steps.
const FASTER: f32 = 1.25;

/// What is static of a [`Vernier`].
pub struct VernierMemory<const HEADS: usize> {
    channels: AbsoluteChannels<encoder::Encoder<HEADS>>,
    encoder: MaybeUninit<encoder::Encoder<HEADS>>,
    decoder: MaybeUninit<Option<encoder::Encoder<HEADS>>>,
    known: MaybeUninit<Known<HEADS>>,
    calibration: MaybeUninit<Option<EncoderCalibration<HEADS>>>,
}

impl<const HEADS: usize> VernierMemory<HEADS> {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            channels: AbsoluteChannels::new(),
            encoder: MaybeUninit::uninit(),
            decoder: MaybeUninit::uninit(),
            known: MaybeUninit::uninit(),
            calibration: MaybeUninit::uninit(),
        }
    }
}

impl<const HEADS: usize> Default for VernierMemory<HEADS> {
    fn default() -> Self {
        Self::new()
    }
}

/// Two rings under one head each, or under two opposite ones: the tasks' side.
pub struct Vernier<const HEADS: usize> {
    tasks: AbsoluteTasks<encoder::Encoder<HEADS>>,
    /// The drive's encoder, while it does not use it.
    free: Option<&'static mut encoder::Encoder<HEADS>>,
    /// The same for the tasks, once calibrated.
    decoder: &'static mut Option<encoder::Encoder<HEADS>>,
    known: &'static mut Known<HEADS>,
    calibration: &'static mut Option<EncoderCalibration<HEADS>>,
    outcome: Outcome,
    problem: Problem,
    unsaved: bool,
    bits: u8,
    /// Whether the drive has the encoder, is to have another one, or none.
    installed: bool,
    install_due: bool,
    /// As the drive was told.
    mounting: Option<Mounting>,
    /// Where the bounds of the position were put.
    placed: Position,
    last: Option<SampleOf<encoder::Encoder<HEADS>>>,
    agreement: Agreement,
    /// By how much the Halls were ahead when they did not agree at rest, electrical degrees.
    disagreed_deg: Option<f32>,
    worst_residual: u32,
    last_fault: Option<Fault>,
    missed: u32,
}

impl<const HEADS: usize> Encoder for Vernier<HEADS> {
    type Drive = AbsoluteDrive<encoder::Encoder<HEADS>>;
    type Interrupt = AbsoluteInterrupt<encoder::Encoder<HEADS>>;
    type Memory = VernierMemory<HEADS>;
    #[expect(clippy::declare_interior_mutable_const, reason = "it only fills a static, once")]
    const MEMORY: Self::Memory = VernierMemory::new();
    const RECORD: usize = vernier::LONGEST;
    const SETTINGS: u16 = TABLE.len() as u16;

    fn start(memory: &'static mut Self::Memory, settings: &Settings) -> (Self, Self::Interrupt) {
        let VernierMemory { channels, encoder, decoder, known, calibration } = memory;
        let (interrupt, tasks) = channels.split();
        let known = known.write(Known::default());
        let free = known.settings.rings(settings.adc_bits).ok().and_then(|rings| {
            let ideal = Calibration::ideal(&rings);
            let made = encoder::Encoder::new(&rings, &ideal, largest_step(&rings, settings)).ok()?;
            Some(encoder.write(made))
        });
        let vernier = Self {
            tasks,
            free,
            decoder: decoder.write(None),
            known,
            calibration: calibration.write(None),
            outcome: Outcome::None,
            problem: Problem::Blank,
            unsaved: false,
            bits: settings.adc_bits,
            installed: false,
            install_due: false,
            mounting: None,
            placed: Position::from_bits(0),
            last: None,
            agreement: Agreement::default(),
            disagreed_deg: None,
            worst_residual: 0,
            last_fault: None,
            missed: 0,
        };
        (vernier, interrupt)
    }

    fn drive(drive: Drive, interrupt: Self::Interrupt, settings: &Settings) -> Self::Drive {
        AbsoluteDrive::new(drive, interrupt, (settings.pwm_hz / SAMPLE_HZ) as u32)
    }

    fn restore(&mut self, record: Result<&[u8], Problem>) {
        let known = record.and_then(|record| vernier::decode(record).ok_or(Problem::Corrupt));
        match known {
            Ok(known) => {
                *self.known = known;
                self.problem = Problem::None;
                self.install_due = self.known.calibration.is_some();
            }
            Err(problem) => self.problem = problem,
        }
        self.mounting = None;
    }

    fn record<'a>(&mut self, place: &'a mut [u8]) -> Option<&'a [u8]> {
        if !self.unsaved || self.calibration.is_some() {
            return None;
        }
        let (record, length) = vernier::encode(self.known);
        let (place, record) = (place.get_mut(..length)?, record.get(..length)?);
        place.copy_from_slice(record);
        Some(place)
    }

    fn saved(&mut self, result: Result<(), Problem>) {
        self.unsaved = false;
        self.problem = result.err().unwrap_or(Problem::None);
    }

    fn problem(&self) -> Problem {
        self.problem
    }

    fn tick(&mut self, service: &mut Service, settings: &Settings, mode: Mode, now_ms: u64) -> bool {
        self.take_samples(mode);
        let ended = self.proceed(service, settings, now_ms as u32);
        self.free = self.free.take().or_else(|| self.tasks.retired());
        self.update_drive(settings);
        ended
    }

    fn is_settled(&self) -> bool {
        !self.unsaved && !self.install_due
    }

    fn event(&mut self, event: &Event) {
        if let Some(calibration) = self.calibration {
            calibration.event(event);
        }
    }

    fn activity(&self) -> (Activity, f32) {
        match &*self.calibration {
            Some(calibration) => (Activity::Encoder, calibration.progress()),
            None if self.install_due => (Activity::Encoder, 1.0),
            None => (Activity::None, 0.0),
        }
    }

    fn cancel(&mut self) {
        if let Some(calibration) = self.calibration {
            calibration.cancel();
        }
    }

    fn origin(&self) -> Position {
        self.mounting.map_or(Position::from_bits(0), |mounting| mounting.origin())
    }

    fn place(&mut self, config: &mut Config, settings: &Settings) {
        self.placed = self.wanted_origin(settings);
        config.shift_bounds(self.placed);
    }

    fn has_moved(&self, settings: &Settings) -> bool {
        self.placed != self.wanted_origin(settings)
    }

    fn position(&self) -> Option<Position> {
        self.last.filter(|sample| sample.used).map(|sample| sample.position)
    }

    fn may_move(&self, position: bool, settings: &Settings) -> Result<(), Refusal<'static>> {
        self.may_be_moved(position, settings)
    }

    fn setting(&self, number: u16) -> Option<Setting<'static>> {
        let row = TABLE.get(usize::from(number))?;
        let (min, max) = row.range;
        Some(Setting {
            name: row.name,
            unit: row.unit,
            kind: row.kind,
            value: row.get(&self.known.settings),
            default: row.get(&hallservo::vernier::settings::Settings::default()),
            min,
            max,
            fixed: false,
        })
    }

    fn find(name: &[u8]) -> Option<u16> {
        TABLE.iter().position(|row| row.name.as_bytes() == name).map(|number| number as u16)
    }

    fn set(&mut self, number: u16, value: f32, mode: Mode) -> Result<(), Refusal<'static>> {
        let name = TABLE.get(usize::from(number)).map_or("", |row| row.name);
        self.change(mode, |settings| settings.with(name, value))
    }

    fn halls_ahead(&self, mode: Mode) -> Result<ElectricalAngle, Refusal<'static>> {
        self.halls_ahead_at_rest(mode)
    }

    fn ask(
        &mut self,
        ask: EncoderAsk,
        service: &Service,
        settings: &Settings,
        mode: Mode,
    ) -> Result<Answer<'static>, Refusal<'static>> {
        self.answer(ask, service, settings, mode)
    }
}

impl<const HEADS: usize> Vernier<HEADS> {
    /// One step of a calibration; true at its end.
    fn proceed(&mut self, service: &mut Service, settings: &Settings, now_ms: u32) -> bool {
        let Some(calibration) = self.calibration else { return false };
        let state = calibration.step(service, now_ms);
        if state == State::Running {
            self.outcome = Outcome::Running(calibration.attempt().copied());
            return false;
        }
        match (calibration.error(state), calibration.outcome()) {
            (None, Some(found)) => {
                self.known.calibration = Some(found.calibration.clone());
                self.known.fitted = found.fitted.map(|fitted| fitted.directed(settings.reversed));
                self.outcome = Outcome::Done(found.report);
                self.unsaved = true;
            }
            (Some(error), _) => self.outcome = Outcome::Failed(error),
            (None, None) => self.outcome = Outcome::None,
        }
        *self.calibration = None;
        self.install_due = self.known.calibration.is_some();
        true
    }

    /// Sends the drive the encoder and its mounting, where these are others than it has.
    fn update_drive(&mut self, settings: &Settings) {
        if self.calibration.is_some() {
            return;
        }
        if self.install_due {
            self.install(settings);
        }
        let wanted = self.wanted(settings);
        if self.installed && wanted != self.mounting && self.tasks.mount(wanted) {
            self.mounting = wanted;
            self.agreement = Agreement::default();
            self.last = None;
        }
    }

    /// Sends the drive the encoder as calibrated. One that it has is taken back first.
    #[inline(never)]
    fn install(&mut self, settings: &Settings) {
        let Some(free) = self.free.take() else {
            self.take_back();
            return;
        };
        self.install_due = false;
        let made = self.rings().and_then(|rings| {
            let calibration = self.known.calibration.as_ref()?;
            encoder::Encoder::new(&rings, calibration, largest_step(&rings, settings)).ok()
        });
        *self.decoder = made;
        match self.decoder {
            Some(made) => {
                free.clone_from(made);
                match self.tasks.install(free) {
                    Ok(()) => self.installed = true,
                    Err(free) => (self.free, self.install_due) = (Some(free), true),
                }
            }
            None => self.free = Some(free),
        }
        self.mounting = None;
    }

    /// Takes the encoder back from the drive, which goes on by the Halls.
    fn take_back(&mut self) {
        if self.installed && self.tasks.remove() {
            (self.installed, self.mounting, self.last) = (false, None, None);
        }
    }

    fn rings(&self) -> Option<Rings> {
        self.known.settings.rings(self.bits).ok()
    }

    /// Electrical position where the position will be zero.
    fn wanted_origin(&self, settings: &Settings) -> Position {
        self.wanted(settings).map_or(Position::from_bits(0), |mounting| mounting.origin())
    }

    /// How the encoder is mounted, as far as that is known, for the drive's present settings.
    fn wanted(&self, settings: &Settings) -> Option<Mounting> {
        let pole_pairs = hallservo::angle::PolePairs::new(settings.pole_pairs)?;
        let fitted = self.known.fitted.filter(|_| self.known.calibration.is_some())?.directed(settings.reversed);
        Some(Mounting {
            pole_pairs,
            reversed: fitted.reversed,
            zero: self.known.zero,
            offset: fitted.electrical(pole_pairs, self.known.zero),
            tolerance: ElectricalAngle::from_degrees(TOLERANCE_DEG),
            closes_loops: self.known.settings.closes_loops,
            falls_back: self.known.settings.falls_back,
        })
    }
}

/// The largest step of the shaft in a control period.
fn largest_step(rings: &Rings, settings: &Settings) -> MechanicalAngle {
    let finest = rings.pole_pairs(Ring::Reference).max(rings.pole_pairs(Ring::Vernier));
    let largest = 0.249 / f32::from(finest);
    let fastest = FASTER * settings.max_electrical_hz / f32::from(settings.pole_pairs) / settings.pwm_hz;
    MechanicalAngle::from_turns(fastest.min(largest))
}
