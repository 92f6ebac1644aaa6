//! The board contract: all that a port has to fulfil. One [`Sample`] in, one [`Output`] out, once a PWM period.
//!
//! The timer counts up and down (centre-aligned); *valley* is where the lower transistors conduct and the shunts carry
//! the phase currents. Once a period, at the valley:
//!
//! 1. The ADCs hold Halls, currents, bus voltage and thermistors. That instant is the sample's; an input that is held
//!    earlier is brought up to it by [`sensing::SkewCompensation`], and how far it is from the valley is told to the drive
//!    by the setting [`halls_held_s`](crate::settings::Settings::halls_held_s).
//! 2. The end of the conversion is the control interrupt, the highest of all. It builds a [`Sample`] and calls
//!    [`Drive::step`](crate::drive::Drive::step).
//! 3. It writes the [`Output`] to preloaded compare registers, which the timer takes up at the next valley, or switches
//!    the bridge off at once. When the outputs may be enabled is [`timing::OutputEnable`]'s business.
//!
//! Beside that a board may have a [gate driver](gate_driver::GateDriver) that is configured and has faults of its own,
//! and an [absolute encoder](encoder::AbsoluteEncoder) on the shaft.

pub mod encoder;
pub mod gate_driver;
pub mod sensing;
pub mod timing;

use crate::hall::Codes;

/// What the ADCs delivered at one instant: right-aligned codes of `adc_bits` bits, as in the
/// [settings](crate::settings::Settings::adc_bits).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Halls 1 to 3, as they come: the calibration finds offset, amplitude, order and direction. A code at either end
    /// of the range is a broken sensor or wire.
    pub halls: Codes,
    /// Currents of phases A to C, positive **into** the motor. The middle of the range, 2^(bits−1), is zero and
    /// `current_full_scale_a` lies between it and the end; what the amplifiers really show without a current the drive
    /// learns while the bridge is off. Valid while the lower transistors conduct. Only a drive with
    /// [`control`](crate::control) looks at these and at the following.
    pub currents: Codes,
    /// Bus voltage: zero is zero, and the end of the range is `bus_full_scale_v`.
    pub bus: u16,
    /// Thermistors of bridge and motor.
    pub temperatures: [TemperatureCode; 2],
    /// Control periods that passed without a step since the last one.
    pub lost: LostPeriods,
}

/// Reading of a thermistor as an NTC to ground with a pull-up to the reference gives it: the higher, the colder. Or
/// that there is none.
///
/// ```
/// use hallservo::board::TemperatureCode;
/// assert_eq!(TemperatureCode::new(2048).code(), Some(2048));
/// assert_eq!(TemperatureCode::MISSING.code(), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TemperatureCode(u16);

impl TemperatureCode {
    /// The board has no such thermistor: nothing is held back and nothing fails. In the interrupt, colder than any
    /// other.
    pub const MISSING: Self = Self(u16::MAX);

    /// A code of the ADC; one of the largest of 16 bits counts as one less.
    #[inline(always)]
    pub const fn new(code: u16) -> Self {
        Self(if code == u16::MAX { code - 1 } else { code })
    }

    /// The code, if there is a thermistor.
    pub const fn code(self) -> Option<u16> {
        if self.0 == u16::MAX { None } else { Some(self.0) }
    }

    /// As 16 bits, for a task that gets them through an atomic.
    #[inline(always)]
    pub const fn to_bits(self) -> u16 {
        self.0
    }

    /// From those.
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }
}

impl Default for TemperatureCode {
    fn default() -> Self {
        Self::MISSING
    }
}

/// Control periods that passed without a step. A running drive with current control fails at the first.
///
/// ```
/// use hallservo::board::LostPeriods;
/// assert!(LostPeriods::counted(1).any() && !LostPeriods::NOT_COUNTED.any());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
// 16 bits as the bus voltage beside it, so that one access reads both.
pub struct LostPeriods(u16);

impl LostPeriods {
    /// The board cannot tell: the drive takes every step for the next period, and a missed deadline is no fault.
    pub const NOT_COUNTED: Self = Self(0);

    /// By the board's count, as of a [`PeriodCounter`](timing::PeriodCounter): so many, 255 also for more.
    #[inline(always)]
    pub const fn counted(periods: u8) -> Self {
        Self(periods as u16)
    }

    /// Whether there were any.
    #[inline(always)]
    pub const fn any(self) -> bool {
        self.0 != 0
    }

    #[inline(always)]
    pub(crate) const fn count(self) -> u16 {
        self.0
    }
}

/// What keeps the bridge off, whatever the commands say: a period with it is one of
/// [`Drive::step_off`](crate::drive::Drive::step_off).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Interlock {
    /// The enable input is off: a fault where the bridge is on, and a refusal to switch it on.
    Disabled,
    /// A request to disarm has come in, and has not had its turn yet.
    Stop,
}

/// Which legs of the bridge switch; the others are open, both transistors off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Legs(u8);

impl Legs {
    /// The bridge is off.
    pub const NONE: Self = Self(0);
    /// All three switch.
    pub const ALL: Self = Self(7);

    /// All but one, 0 to 2; any other number is none to leave out.
    pub const fn without(leg: u8) -> Self {
        Self(if leg < 3 { 7 & !(1 << leg) } else { 7 })
    }

    /// Whether a leg, 0 to 2, switches.
    pub const fn contains(self, leg: u8) -> bool {
        leg < 3 && self.0 >> leg & 1 != 0
    }

    /// Bit 0 is phase A.
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// What the board does with its bridge until the next step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output {
    /// Compare values of phases A, B and C in timer counts, 0 to the settings' `period`: the leg's **upper** transistor
    /// conducts for `compare` of the `period` counts of each half of a PWM period, about the peak; the lower one for
    /// the rest, about the valley. To be preloaded; they act from the next valley on, all at once. Without meaning
    /// while `legs` is [`Legs::NONE`].
    pub compare: [u16; 3],
    /// Which legs switch, from the same valley on; both transistors of the others are off. [`Legs::NONE`] is at once:
    /// the bridge is off before the interrupt returns.
    pub legs: Legs,
}

impl Output {
    /// The bridge is off.
    pub const OFF: Self = Self { compare: [0; 3], legs: Legs::NONE };

    /// In two words, which functions take and return in registers.
    #[inline(always)]
    pub const fn pack(self) -> u64 {
        let [a, b, c] = self.compare;
        a as u64 | (b as u64) << 16 | (c as u64) << 32 | (self.legs.0 as u64) << 48
    }

    /// From what [`Self::pack`] has made.
    #[inline(always)]
    pub const fn unpack(bits: u64) -> Self {
        Self { compare: [bits as u16, (bits >> 16) as u16, (bits >> 32) as u16], legs: Legs((bits >> 48) as u8) }
    }
}
