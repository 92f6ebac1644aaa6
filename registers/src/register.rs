//! The registers that there are: number, quantity, and whether they are read or written.

use crate::frame::{Fault, Format, Number};

/// What a register holds, which decides how it is scaled as an integer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A.
    Current,
    /// N·m.
    Torque,
    /// V.
    Voltage,
    /// °C.
    Temperature,
    /// s.
    Time,
    /// Revolutions.
    Position,
    /// Revolutions a second.
    Velocity,
    /// Revolutions a second squared.
    Acceleration,
    /// A share, 1 the whole.
    Share,
    /// W.
    Power,
    /// An integer, which is not scaled.
    Integer,
    /// An integer that wraps at the ends of its format; as a float at 2²³.
    Counter,
    /// Four bytes that are no number.
    Word,
}

impl Quantity {
    /// What an integer's unit is, for the three sizes; 1 where nothing is scaled.
    pub const fn units(self) -> [f32; 3] {
        match self {
            Self::Current | Self::Temperature => [1.0, 0.1, 0.001],
            Self::Torque => [0.5, 0.01, 0.001],
            Self::Voltage => [0.5, 0.1, 0.001],
            Self::Time => [0.01, 0.001, 0.000_001],
            Self::Position => [0.01, 0.0001, 0.000_01],
            Self::Velocity => [0.1, 0.000_25, 0.000_01],
            Self::Acceleration => [0.05, 0.001, 0.000_01],
            Self::Share => [1.0 / 127.0, 1.0 / 32_767.0, 1.0 / 2_147_483_647.0],
            Self::Power => [10.0, 0.05, 0.0001],
            Self::Integer | Self::Counter | Self::Word => [1.0; 3],
        }
    }

    fn unit(self, format: Format) -> f32 {
        let [byte, short, long] = self.units();
        match format {
            Format::Int8 => byte,
            Format::Int16 => short,
            Format::Int32 => long,
            Format::Float => 1.0,
        }
    }

    const fn is_scaled(self) -> bool {
        !matches!(self, Self::Integer | Self::Counter | Self::Word)
    }

    /// Whether it may be had in a format.
    pub const fn has(self, format: Format) -> bool {
        !matches!(self, Self::Word) || matches!(format, Format::Int32)
    }
}

/// Largest integer of a format; its negative is the least, for the one below stands for "not a number".
const fn largest(format: Format) -> i32 {
    match format {
        Format::Int8 => i8::MAX as i32,
        Format::Int16 => i16::MAX as i32,
        Format::Int32 | Format::Float => i32::MAX,
    }
}

/// What a register holds at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// Of a quantity in its unit; not a number where it is not known.
    Real(f32),
    /// Of an integer, a counter or a word.
    Bits(i32),
}

/// As it is in a frame. An integer that is too small for its value has the nearest that it can have.
pub fn encode(content: Content, quantity: Quantity, format: Format) -> Number {
    let most = largest(format);
    match (content, format) {
        (Content::Real(value), Format::Float) => Number::Float(value),
        (Content::Real(value), _) if value.is_nan() => Number::Integer(-most - 1, format),
        (Content::Real(value), _) => {
            // Saturates.
            let scaled = libm::roundf(value / quantity.unit(format)) as i32;
            Number::Integer(scaled.clamp(-most, most), format)
        }
        (Content::Bits(bits), Format::Float) if quantity == Quantity::Counter => {
            Number::Float((bits as u32 % (1 << 23)) as f32)
        }
        (Content::Bits(bits), Format::Float) => Number::Float(bits as f32),
        // Its lowest bytes are what is written.
        (Content::Bits(bits), _) if matches!(quantity, Quantity::Counter | Quantity::Word) => {
            Number::Integer(bits, format)
        }
        (Content::Bits(bits), _) => Number::Integer(bits.clamp(-most, most), format),
    }
}

/// What a number of a frame stands for. Infinite is as good as not a number.
pub fn decode(number: Number, quantity: Quantity) -> Content {
    match number {
        Number::Integer(bits, _) if !quantity.is_scaled() => Content::Bits(bits),
        Number::Integer(bits, format) if bits < -largest(format) => Content::Real(f32::NAN),
        Number::Integer(bits, format) => Content::Real(bits as f32 * quantity.unit(format)),
        Number::Float(value) if !quantity.is_scaled() => {
            Content::Bits(if value.is_nan() { i32::MIN } else { value as i32 })
        }
        Number::Float(value) => Content::Real(if value.is_finite() { value } else { f32::NAN }),
    }
}

/// Who may do what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Only read.
    Read,
    /// Only written.
    Write,
    /// Both.
    Both,
}

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Its number.
    pub number: u16,
    /// What it holds.
    pub quantity: Quantity,
    /// Whether it is read or written.
    pub access: Access,
}

/// The table. A row: number, name of the constant, name in the documentation, quantity, access.
macro_rules! registers {
    ($($number:literal $constant:ident $name:literal $quantity:ident $access:ident;)*) => {
        $(#[doc = $name] pub const $constant: u32 = $number;)*

        /// All registers, in the order of their numbers.
        pub const TABLE: &[Register] = &[
            $(Register { number: $number, quantity: Quantity::$quantity, access: Access::$access },)*
        ];

        /// What a register is called; for people.
        pub const fn name(number: u32) -> Option<&'static str> {
            match number {
                $($number => Some($name),)*
                _ => None,
            }
        }
    };
}

registers! {
    0x000 MODE "mode" Integer Both;
    0x001 POSITION "position" Position Read;
    0x002 VELOCITY "velocity" Velocity Read;
    0x003 TORQUE "torque" Torque Read;
    0x004 Q_CURRENT "current along q" Current Read;
    0x005 D_CURRENT "current along d" Current Read;
    0x006 ABSOLUTE_POSITION "absolute position" Position Read;
    0x007 POWER "electrical power" Power Read;
    0x00a MOTOR_TEMPERATURE "temperature of the motor" Temperature Read;
    0x00b TRAJECTORY_COMPLETE "trajectory complete" Integer Read;
    0x00c HOME_STATE "home state" Integer Read;
    0x00d VOLTAGE "bus voltage" Voltage Read;
    0x00e TEMPERATURE "temperature of the bridge" Temperature Read;
    0x00f FAULT "fault" Integer Read;
    0x01c COMMAND_Q_CURRENT "commanded current along q" Current Both;
    0x01d COMMAND_D_CURRENT "commanded current along d" Current Both;
    0x020 COMMAND_POSITION "commanded position" Position Both;
    0x021 COMMAND_VELOCITY "commanded velocity" Velocity Both;
    0x022 COMMAND_TORQUE "feed-forward torque" Torque Both;
    0x023 COMMAND_KP_SCALE "scale of kp" Share Both;
    0x024 COMMAND_KD_SCALE "scale of kd" Share Both;
    0x025 COMMAND_MAX_TORQUE "maximum torque" Torque Both;
    0x026 COMMAND_STOP_POSITION "stop position" Position Both;
    0x027 COMMAND_TIMEOUT "watchdog time-out" Time Both;
    0x028 COMMAND_VELOCITY_LIMIT "velocity limit" Velocity Both;
    0x029 COMMAND_ACCELERATION_LIMIT "acceleration limit" Acceleration Both;
    0x02b COMMAND_ILIMIT_SCALE "scale of the integral's limit" Share Both;
    0x02d COMMAND_IGNORE_BOUNDS "ignore position bounds" Integer Both;
    0x030 PROPORTIONAL_TORQUE "torque of kp" Torque Read;
    0x031 INTEGRAL_TORQUE "torque of ki" Torque Read;
    0x032 DERIVATIVE_TORQUE "torque of kd" Torque Read;
    0x033 FEED_FORWARD_TORQUE "torque of the feed-forward" Torque Read;
    0x034 TOTAL_TORQUE "torque of all of them" Torque Read;
    0x038 CONTROL_POSITION "control position" Position Read;
    0x039 CONTROL_VELOCITY "control velocity" Velocity Read;
    0x03a CONTROL_TORQUE "control torque" Torque Read;
    0x03b POSITION_ERROR "error of the position" Position Read;
    0x03c VELOCITY_ERROR "error of the velocity" Velocity Read;
    0x03d TORQUE_ERROR "error of the torque" Torque Read;
    0x040 WITHIN_LOWER "stay within: lower bound" Position Both;
    0x041 WITHIN_UPPER "stay within: upper bound" Position Both;
    0x042 WITHIN_TORQUE "stay within: feed-forward torque" Torque Both;
    0x043 WITHIN_KP_SCALE "stay within: scale of kp" Share Both;
    0x044 WITHIN_KD_SCALE "stay within: scale of kd" Share Both;
    0x045 WITHIN_MAX_TORQUE "stay within: maximum torque" Torque Both;
    0x046 WITHIN_TIMEOUT "stay within: watchdog time-out" Time Both;
    0x047 WITHIN_ILIMIT_SCALE "stay within: scale of the integral's limit" Share Both;
    0x048 WITHIN_IGNORE_BOUNDS "stay within: ignore position bounds" Integer Both;
    0x050 ENCODER_0_POSITION "position of encoder 0, the Halls" Position Read;
    0x051 ENCODER_0_VELOCITY "velocity of encoder 0, the Halls" Velocity Read;
    0x052 ENCODER_1_POSITION "position of encoder 1, the absolute one" Position Read;
    0x053 ENCODER_1_VELOCITY "velocity of encoder 1, the absolute one" Velocity Read;
    0x058 ENCODER_VALIDITY "encoders that are valid" Integer Read;
    0x070 MILLISECONDS "milliseconds" Counter Read;
    0x100 MODEL_NUMBER "model number" Word Read;
    0x101 FIRMWARE_VERSION "version of the firmware" Word Read;
    0x102 MAP_VERSION "version of the register map" Integer Read;
    0x110 MULTIPLEX_ID "identifier on the bus" Integer Read;
    0x120 SERIAL_NUMBER_1 "serial number, bits 0 to 31" Word Read;
    0x121 SERIAL_NUMBER_2 "serial number, bits 32 to 63" Word Read;
    0x122 SERIAL_NUMBER_3 "serial number, bits 64 to 95" Word Read;
    0x130 SET_OUTPUT_NEAREST "set output nearest" Position Write;
    0x131 SET_OUTPUT_EXACT "set output exact" Position Write;
    0x132 REQUIRE_REINDEX "require reindex" Integer Write;
    0x133 RECAPTURE "recapture position and velocity" Integer Write;
    0x150 UUID_1 "UUID, bytes 0 to 3" Word Read;
    0x151 UUID_2 "UUID, bytes 4 to 7" Word Read;
    0x152 UUID_3 "UUID, bytes 8 to 11" Word Read;
    0x153 UUID_4 "UUID, bytes 12 to 15" Word Read;
    0x154 UUID_MASK_1 "only for the UUID, bytes 0 to 3" Word Write;
    0x155 UUID_MASK_2 "only for the UUID, bytes 4 to 7" Word Write;
    0x156 UUID_MASK_3 "only for the UUID, bytes 8 to 11" Word Write;
    0x157 UUID_MASK_4 "only for the UUID, bytes 12 to 15" Word Write;
    0x158 UUID_MASK_CAPABLE "UUID mask usable" Integer Read;
    0x700 BUS_TRANSMIT_ERRORS "CAN: error counter of sending, 0 to 255" Integer Read;
    0x701 BUS_RECEIVE_ERRORS "CAN: error counter of receiving, 0 to 127" Integer Read;
    0x702 BUS_PASSIVE "CAN: error flags are passive" Integer Read;
    0x703 BUS_OFF_COUNT "CAN: how often off the bus" Integer Read;
    0x704 BUS_LOST_FRAMES "CAN: frames for which there was no room" Integer Read;
}

/// A register to be read or to be written in a format.
///
/// # Errors
/// Why not.
pub fn find(number: u32, writes: bool, format: Format) -> Result<Quantity, Fault> {
    let place = TABLE.binary_search_by_key(&number, |register| register.number.into()).map_err(|_| Fault::Unknown)?;
    let Register { quantity, access, .. } = *TABLE.get(place).ok_or(Fault::Unknown)?;
    let allowed = access == Access::Both || (access == Access::Write) == writes;
    if allowed && quantity.has(format) { Ok(quantity) } else { Err(Fault::Access) }
}
