//! The telemetry channels. One list gives each its schema and its data.

use super::piece::Piece;
use super::value::{Type, Value};
use crate::axis::{BusHealth, Identity, Mode, State};

/// What `halls` tells: what the rotor's angle comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Halls {
    /// ADC codes.
    pub codes: [u16; 3],
    /// Length of the vector that the three make together: 1 as calibrated; not a number without a calibration.
    pub amplitude: f32,
    /// Electrical, degrees.
    pub angle_deg: f32,
    /// Whether there is a calibration.
    pub calibrated: bool,
}

/// What `firmware` and `git` tell beside the [`Identity`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Build {
    /// Name of the board.
    pub board: &'static str,
    /// Version of the firmware, in words.
    pub release: &'static str,
    /// Commit that it was built from; all zeros where that is not known.
    pub commit: [u8; 20],
}

/// What a telemetry channel tells.
pub(super) trait Record {
    /// Names and types of its fields.
    const FIELDS: &'static [(&'static str, Type<'static>)];

    /// Its data.
    fn write(&self, piece: &mut Piece<'_>);
}

macro_rules! record {
    ($record:ty: |$this:ident| { $($name:literal: $type:ty = $value:expr,)* }) => {
        impl Record for $record {
            const FIELDS: &'static [(&'static str, Type<'static>)] = &[$(($name, <$type as Value>::TYPE),)*];

            fn write(&self, piece: &mut Piece<'_>) {
                let $this = self;
                $(<$type as Value>::write(&$value, piece);)*
            }
        }
    };
}

// Names and units are those that clients plot without being told. Ours are behind.
record!(State: |state| {
    "mode": Mode = state.mode,
    "fault": u8 = state.fault,
    "position": f32 = state.position,
    "velocity": f32 = state.velocity,
    "torque_Nm": f32 = state.torque,
    "d_A": f32 = state.current[0],
    "q_A": f32 = state.current[1],
    "power_W": f32 = state.power,
    "bus_V": f32 = state.voltage,
    "fet_temp_C": f32 = state.temperature,
    "motor_temp_C": f32 = state.motor_temperature,
    "control_position": f32 = state.control[0],
    "control_velocity": f32 = state.control[1],
    "control_torque_Nm": f32 = state.control[2],
    "trajectory_done": bool = state.trajectory_complete,
    "halls_position": f32 = state.halls[0],
    "halls_velocity": f32 = state.halls[1],
    "encoder_position": f32 = state.encoder[0],
    "encoder_velocity": f32 = state.encoder[1],
});

record!(BusHealth: |bus| {
    "transmit_errors": u8 = bus.transmit,
    "receive_errors": u8 = bus.receive,
    "passive": bool = bus.passive,
    "off": u32 = bus.off,
    "lost": u32 = bus.lost,
});

record!(Halls: |halls| {
    "code": [u16; 3] = halls.codes,
    "amplitude": f32 = halls.amplitude,
    "angle_deg": f32 = halls.angle_deg,
    "calibrated": bool = halls.calibrated,
});

record!((Identity, Build): |whole| {
    "version": u32 = whole.0.firmware,
    "serial_number": [u32; 3] = whole.0.serial,
    "model": u32 = whole.0.model,
    "board": &'static str = whole.1.board,
    "release": &'static str = whole.1.release,
});

record!(Build: |build| {
    "hash": [u8; 20] = build.commit,
    // Changes on top of the commit, and its time, are not recorded.
    "dirty": bool = false,
    "timestamp": u64 = 0,
});

impl Value for Mode {
    // By number: those that the protocol has, whether this drive does or not.
    const TYPE: Type<'static> = Type::Choice(
        "stopped|fault|enabling|calibrating|calibration_complete|pwm|voltage|voltage_foc|voltage_dq|current|position|\
         timeout|zero_velocity|stay_within|measure_inductance|brake",
    );

    fn write(&self, piece: &mut Piece<'_>) {
        (*self as u8).write(piece);
    }
}
