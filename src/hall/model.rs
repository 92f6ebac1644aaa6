//! What a linear Hall delivers at an angle: the model that calibration and adaptation estimate.
//!
//! Simpkins and Todorov, eq. (1) and (3), with electrical instead of mechanical phases and with the odd harmonics of
//! the magnet's field, which all sensors see alike but for their placement ψ:
//!
//! ```text
//! code = offset + amplitude · (sin x + third · sin 3x + fifth · sin 5x),   x = θ_Hall − ψ
//! ```
//!
//! θ_Hall is the rotor's angle as the sensors count it; the electrical angle, whose zero is the axis of phase A, is
//! `±(θ_Hall − φ)`. From the Halls alone φ cannot be known (errata to eq. (10)): it comes from the alignment.

use crate::angle::ElectricalAngle;
use crate::hall::{Channel, Codes, Halls};
use crate::trig;

/// One sensor: minimum α and maximum β of the paper are `offset ∓ amplitude`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sensor {
    /// o: mean of the signal, in ADC codes; from the calibration.
    pub offset: f32,
    /// A: amplitude of the fundamental, in ADC codes; at least 4; from the calibration.
    pub amplitude: f32,
    /// ψ: electrical phase against the first sensor; from the calibration.
    pub placement: ElectricalAngle,
    /// h₃: third harmonic, share of the amplitude, −0.5 to 0.5; positive makes the wave flat, negative pointed.
    pub third: f32,
    /// h₅: fifth harmonic, share of the amplitude, −0.5 to 0.5.
    pub fifth: f32,
}

impl Sensor {
    /// In the place of a sensor that is not there: no sensor has no amplitude.
    pub const ABSENT: Self = Self::sinusoidal(0.0, 0.0, ElectricalAngle::ZERO);

    /// A sensor without harmonics.
    pub const fn sinusoidal(offset: f32, amplitude: f32, placement: ElectricalAngle) -> Self {
        Self { offset, amplitude, placement, third: 0.0, fifth: 0.0 }
    }

    /// sin x, sin 3x and sin 5x at a Hall angle.
    pub(crate) fn harmonics(&self, hall: ElectricalAngle) -> [f32; 3] {
        odd(hall - self.placement, trig::sin)
    }

    /// The wave, about ±1, at a Hall angle.
    pub fn wave(&self, hall: ElectricalAngle) -> f32 {
        let [s1, s3, s5] = self.harmonics(hall);
        s1 + self.third * s3 + self.fifth * s5
    }

    /// The slope of the wave, per radian.
    pub fn slope(&self, hall: ElectricalAngle) -> f32 {
        let [c1, c3, c5] = odd(hall - self.placement, trig::cos);
        c1 + 3.0 * self.third * c3 + 5.0 * self.fifth * c5
    }

    /// The ADC code at a Hall angle, before quantisation.
    pub fn code(&self, hall: ElectricalAngle) -> f32 {
        self.offset + self.amplitude * self.wave(hall)
    }
}

/// A function of the angle, of three times and of five times the angle.
fn odd(angle: ElectricalAngle, function: fn(ElectricalAngle) -> fixed::types::I2F30) -> [f32; 3] {
    let multiple = |k: i32| ElectricalAngle::from_bits(angle.to_bits().wrapping_mul(k));
    [function(angle), function(multiple(3)), function(multiple(5))].map(trig::float)
}

/// Three sensors, or [two](Self::of_two), and the alignment to the stator.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Model {
    /// The sensors in the order of their ADC channels.
    pub sensors: [Sensor; 3],
    /// φ: the Hall angle where the electrical angle is zero.
    pub alignment: ElectricalAngle,
    /// Whether the electrical angle falls while the Hall angle rises.
    pub reversed: bool,
}

impl Model {
    /// Sensors as a data sheet promises them: equal, `spacing` apart, in the middle of the ADC's range.
    pub fn nominal(adc_bits: u8, amplitude: f32, spacing: ElectricalAngle) -> Self {
        let offset = (1_u32 << adc_bits) as f32 / 2.0;
        let sensor = |placement| Sensor::sinusoidal(offset, amplitude, placement);
        Self {
            sensors: [sensor(ElectricalAngle::ZERO), sensor(spacing), sensor(spacing + spacing)],
            alignment: ElectricalAngle::ZERO,
            reversed: false,
        }
    }

    /// The same without the third sensor.
    #[must_use]
    pub const fn of_two(&self) -> Self {
        let [first, second, _] = self.sensors;
        Self { sensors: [first, second, Sensor::ABSENT], ..*self }
    }

    /// How many sensors there are.
    pub fn halls(&self) -> Halls {
        if self.sensors[2].amplitude == 0.0 { Halls::Two } else { Halls::Three }
    }

    /// The sensor that is not there, if one is not.
    pub fn absent(&self) -> Option<Channel> {
        (self.halls() == Halls::Two).then_some(Channel::THIRD)
    }

    /// The same sensors with the zero of the electrical angle moved on: every angle is less by this.
    #[must_use]
    pub fn with_zero_at(&self, electrical: ElectricalAngle) -> Self {
        Self { alignment: self.hall(electrical), ..*self }
    }

    /// The electrical angle at a Hall angle.
    pub fn electrical(&self, hall: ElectricalAngle) -> ElectricalAngle {
        let angle = hall - self.alignment;
        if self.reversed { -angle } else { angle }
    }

    /// The Hall angle at an electrical angle.
    pub fn hall(&self, electrical: ElectricalAngle) -> ElectricalAngle {
        self.alignment + if self.reversed { -electrical } else { electrical }
    }

    /// The ADC codes at an electrical angle, rounded and kept within 16 bit.
    pub fn codes(&self, electrical: ElectricalAngle) -> Codes {
        let hall = self.hall(electrical);
        self.sensors.map(|sensor| crate::float::nearest(sensor.code(hall)).clamp(0, 65_535) as u16)
    }
}
