//! What a drive has on its shaft beside the Halls: the type parameter of [`Supervisor`](crate::Supervisor).
//!
//! [`NoEncoder`], which costs nothing, or with the feature `encoder` a [`Vernier`].

#[cfg(feature = "encoder")]
mod vernier;

#[cfg(feature = "encoder")]
pub use vernier::{Vernier, VernierMemory};

#[cfg(feature = "encoder")]
use hallservo::angle::ElectricalAngle;
use hallservo::angle::Position;
use hallservo::config::Config;
use hallservo::drive::Drive;
use hallservo::mode::Mode;
use hallservo::service::{Event, Service};
use hallservo::settings::Settings;
use hallservo_protocol::{Activity, Problem, Refusal, Setting};
#[cfg(feature = "encoder")]
use hallservo_protocol::{Answer, EncoderAsk, EncoderRefusal};

/// An encoder, or none. What the tasks ask of it does nothing unless it is overridden.
pub trait Encoder: Sized + 'static {
    /// What the control interrupt owns: a [`Drive`], or one with an encoder.
    type Drive: 'static;
    /// The interrupt's ends of the queues.
    type Interrupt;
    /// What is static.
    type Memory: 'static;
    /// That, empty.
    const MEMORY: Self::Memory;
    /// Most bytes of its record in the flash; 0 for none.
    const RECORD: usize = 0;
    /// Number of its settings.
    const SETTINGS: u16 = 0;

    /// Both ends.
    fn start(memory: &'static mut Self::Memory, settings: &Settings) -> (Self, Self::Interrupt);

    /// What the control interrupt owns.
    fn drive(drive: Drive, interrupt: Self::Interrupt, settings: &Settings) -> Self::Drive;

    /// Takes what the flash holds.
    fn restore(&mut self, _record: Result<&[u8], Problem>) {}

    /// What the flash is to hold, if it does not yet.
    fn record<'a>(&mut self, _place: &'a mut [u8]) -> Option<&'a [u8]> {
        None
    }

    /// Whether that was saved.
    fn saved(&mut self, _result: Result<(), Problem>) {}

    /// What is wrong with what the flash holds.
    fn problem(&self) -> Problem {
        Problem::None
    }

    /// Everything that is due every millisecond. True when a calibration has ended after which the rotor is to come to
    /// rest.
    fn tick(&mut self, _service: &mut Service, _settings: &Settings, _mode: Mode, _now_ms: u64) -> bool {
        false
    }

    /// Whether what was found is in use and in the flash.
    fn is_settled(&self) -> bool {
        true
    }

    /// What the service delivers.
    fn event(&mut self, _event: &Event) {}

    /// What keeps the drive busy, and how far it is.
    fn activity(&self) -> (Activity, f32) {
        (Activity::None, 0.0)
    }

    /// Ends what keeps the drive busy. The bridge is switched off, too.
    fn cancel(&mut self) {}

    /// Electrical position where the drive's position is zero.
    fn origin(&self) -> Position {
        Position::from_bits(0)
    }

    /// Puts the bounds of the position where it will be zero with these settings.
    fn place(&mut self, _config: &mut Config, _settings: &Settings) {}

    /// Whether the drive has to be sent its settings again, as its bounds are elsewhere.
    fn has_moved(&self, _settings: &Settings) -> bool {
        false
    }

    /// The position at rest, where the encoder knows it better than the records.
    fn position(&self) -> Option<Position> {
        None
    }

    /// Whether the drive may be armed, and sent to a position.
    ///
    /// # Errors
    /// The position is not known, and nothing is to move before it is.
    fn may_move(&self, _position: bool, _settings: &Settings) -> Result<(), Refusal<'static>> {
        Ok(())
    }

    /// A setting by its number or its name.
    fn setting(&self, _number: u16) -> Option<Setting<'static>> {
        None
    }

    /// The number of a setting.
    fn find(_name: &[u8]) -> Option<u16> {
        None
    }

    /// Sets one.
    ///
    /// # Errors
    /// Why not.
    fn set(&mut self, _number: u16, _value: f32, _mode: Mode) -> Result<(), Refusal<'static>> {
        Ok(())
    }

    /// By how much the Halls are ahead of it at rest, in the drive's direction, where their zero may be taken from it.
    ///
    /// # Errors
    /// Why not.
    #[cfg(feature = "encoder")]
    fn halls_ahead(&self, _mode: Mode) -> Result<ElectricalAngle, Refusal<'static>> {
        Err(Refusal::Encoder(EncoderRefusal::None))
    }

    /// Answers what concerns the encoder alone.
    ///
    /// # Errors
    /// Why it is not done.
    #[cfg(feature = "encoder")]
    fn ask(
        &mut self,
        _ask: EncoderAsk,
        _service: &Service,
        _settings: &Settings,
        _mode: Mode,
    ) -> Result<Answer<'static>, Refusal<'static>> {
        Err(Refusal::Encoder(EncoderRefusal::None))
    }
}

/// The Halls alone.
#[derive(Clone, Copy, Debug)]
pub struct NoEncoder;

impl Encoder for NoEncoder {
    type Drive = Drive;
    type Interrupt = ();
    type Memory = ();
    const MEMORY: () = ();

    #[inline(always)]
    fn start((): &'static mut (), _: &Settings) -> (Self, ()) {
        (Self, ())
    }

    #[inline(always)]
    fn drive(drive: Drive, (): (), _: &Settings) -> Drive {
        drive
    }
}
