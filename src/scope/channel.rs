//! What can be recorded.

use crate::angle::TURN;
use crate::config::Config;
use core::f32::consts::TAU;

/// A quantity of the control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Channel {
    /// Current of a phase.
    PhaseA,
    /// The same.
    PhaseB,
    /// The same.
    PhaseC,
    /// Current along d.
    CurrentD,
    /// Current along q.
    CurrentQ,
    /// Reference of the current along d; 0 while the bridge is off.
    ReferenceD,
    /// Reference of the current along q; 0 while the bridge is off.
    ReferenceQ,
    /// Voltage along d, field-oriented.
    VoltageD,
    /// Voltage along q, field-oriented.
    VoltageQ,
    /// Share of the period for which the upper transistor of a leg conducts; 0 while the bridge is off.
    DutyA,
    /// The same.
    DutyB,
    /// The same.
    DutyC,
    /// Electrical angle.
    Angle,
    /// Mechanical speed.
    Speed,
    /// Its reference.
    SpeedReference,
    /// Mechanical position.
    Position,
    /// Its reference, while a position is followed.
    PositionReference,
    /// Bus voltage.
    Bus,
    /// A Hall as sampled.
    Hall1,
    /// The same.
    Hall2,
    /// The same.
    Hall3,
}

impl Channel {
    /// All of them, with the names that people use.
    pub const ALL: [(Self, &'static str); 21] = [
        (Self::PhaseA, "phase_a"),
        (Self::PhaseB, "phase_b"),
        (Self::PhaseC, "phase_c"),
        (Self::CurrentD, "i_d"),
        (Self::CurrentQ, "i_q"),
        (Self::ReferenceD, "i_d_ref"),
        (Self::ReferenceQ, "i_q_ref"),
        (Self::VoltageD, "v_d"),
        (Self::VoltageQ, "v_q"),
        (Self::DutyA, "duty_a"),
        (Self::DutyB, "duty_b"),
        (Self::DutyC, "duty_c"),
        (Self::Angle, "angle"),
        (Self::Speed, "speed"),
        (Self::SpeedReference, "speed_ref"),
        (Self::Position, "position"),
        (Self::PositionReference, "position_ref"),
        (Self::Bus, "bus"),
        (Self::Hall1, "hall_1"),
        (Self::Hall2, "hall_2"),
        (Self::Hall3, "hall_3"),
    ];

    /// The same by their numbers.
    #[cfg(feature = "serde")]
    const NUMBERED: [Self; Self::ALL.len()] = {
        let mut channels = [Self::PhaseA; Self::ALL.len()];
        let mut k = 0;
        while k < channels.len() {
            channels[k] = Self::ALL[k].0;
            k += 1;
        }
        channels
    };

    /// Unit of what is shown.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::PhaseA | Self::PhaseB | Self::PhaseC => "A",
            Self::CurrentD | Self::CurrentQ | Self::ReferenceD | Self::ReferenceQ => "A",
            Self::VoltageD | Self::VoltageQ | Self::Bus => "V",
            Self::DutyA | Self::DutyB | Self::DutyC => "",
            Self::Angle => "°",
            Self::Speed | Self::SpeedReference => "rad/s",
            Self::Position | Self::PositionReference => "turns",
            Self::Hall1 | Self::Hall2 | Self::Hall3 => "codes",
        }
    }

    /// Whether it is a position, which counts from the user's zero.
    pub const fn is_position(self) -> bool {
        matches!(self, Self::Position | Self::PositionReference)
    }

    /// Value of one unit of the raw number, for `step_hz` control periods a second; `None` without the current sensing
    /// that it needs.
    pub fn scale(self, config: &Config, step_hz: f32) -> Option<f32> {
        let pole_pairs = f32::from(config.pole_pairs.get());
        let scale = config.control.as_ref().map(|control| &control.scale);
        match self {
            Self::PhaseA | Self::PhaseB | Self::PhaseC => scale.map(|scale| scale.amperes / 32_768.0),
            Self::CurrentD | Self::CurrentQ | Self::ReferenceD | Self::ReferenceQ => {
                scale.map(|scale| scale.amperes / 268_435_456.0)
            }
            Self::VoltageD | Self::VoltageQ | Self::Bus => scale.map(|scale| scale.volts / 32_768.0),
            Self::DutyA | Self::DutyB | Self::DutyC => Some(1.0 / f32::from(config.period.max(1))),
            Self::Angle => Some(360.0 / TURN),
            Self::Speed => Some(step_hz / TURN * TAU / pole_pairs),
            Self::SpeedReference => scale.map(|scale| 1.0 / scale.per_radian_s()),
            Self::Position => Some(1.0 / 65_536.0 / pole_pairs),
            Self::PositionReference => scale.map(|_| 1.0 / 65_536.0 / pole_pairs),
            Self::Hall1 | Self::Hall2 | Self::Hall3 => Some(1.0),
        }
    }
}

/// Its number in a byte, which is what postcard makes of a variant. Derived, it takes 150 bytes more of a drive's flash.
#[cfg(feature = "serde")]
impl serde::Serialize for Channel {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_u8(*self as u8)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Channel {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let number = u8::deserialize(from)?;
        Self::NUMBERED.get(usize::from(number)).copied().ok_or_else(|| serde::de::Error::custom("no such channel"))
    }
}
