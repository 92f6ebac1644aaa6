//! What a drive has to offer, in the protocol's units: revolutions, revolutions a second, N·m, A, V, °C, s.

/// The modes of the protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// Bridge off.
    #[default]
    Stopped = 0,
    /// Bridge off until it is told to stop, which clears the fault.
    Fault = 1,
    /// On the way to a mode that moves.
    Preparing = 4,
    /// A voltage that turns by itself.
    VoltageFoc = 7,
    /// A current.
    Current = 9,
    /// A position, a velocity, a torque.
    Position = 10,
    /// The watchdog time-out of the last command is over; to be ended by a stop.
    Timeout = 11,
    /// At rest wherever the rotor is.
    ZeroVelocity = 12,
    /// Between two positions.
    StayWithin = 13,
    /// The phases shorted.
    Brake = 15,
}

/// What is commanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Bridge off, faults cleared. To be obeyed whoever controls the drive.
    Stop,
    /// Currents along d and q, A.
    Current {
        /// Along d.
        d: f32,
        /// Along q.
        q: f32,
        /// The watchdog's time, see [`Position::timeout`].
        timeout: f32,
    },
    /// To a position, or along a velocity.
    Position(Position),
    /// To rest, wherever that is.
    ZeroVelocity(Position),
    /// Free between two positions; not a number where there is none.
    StayWithin {
        /// The lower one.
        lower: f32,
        /// The upper one.
        upper: f32,
        /// The rest: `position` and `velocity` mean nothing.
        with: Position,
    },
    /// Phases shorted.
    Brake,
}

/// Of a command of a position. "None" is not a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Where to, revolutions; none: from where it is.
    pub position: f32,
    /// How fast from there on, revolutions a second.
    pub velocity: f32,
    /// Torque in addition, N·m.
    pub torque: f32,
    /// Share of the configured stiffness, 0 to 1.
    pub kp_scale: f32,
    /// Share of the configured damping, 0 to 1.
    pub kd_scale: f32,
    /// Largest torque, N·m; none: what is configured.
    pub max_torque: f32,
    /// Where a velocity ends, revolutions; none: nowhere.
    pub stop_position: f32,
    /// How long the command holds, s; 0: as configured; none: for ever, if the drive allows it.
    pub timeout: f32,
    /// Largest velocity on the way, revolutions a second; negative: without limit; none: as configured.
    pub velocity_limit: f32,
    /// Largest acceleration on the way, revolutions a second squared; negative: without limit; none: as configured.
    pub acceleration_limit: f32,
}

impl Position {
    /// What holds where nothing is said.
    pub const DEFAULT: Self = Self {
        position: 0.0,
        velocity: 0.0,
        torque: 0.0,
        kp_scale: 1.0,
        kd_scale: 1.0,
        max_torque: f32::NAN,
        stop_position: f32::NAN,
        timeout: 0.0,
        velocity_limit: f32::NAN,
        acceleration_limit: f32::NAN,
    };

    /// Whether it is the same in every bit.
    pub fn is_same(&self, other: &Self) -> bool {
        self.bits() == other.bits()
    }

    fn bits(&self) -> [u32; 10] {
        let Self { position, velocity, torque, kp_scale, kd_scale, max_torque, .. } = *self;
        let Self { stop_position, timeout, velocity_limit, acceleration_limit, .. } = *self;
        let first = [position, velocity, torque, kp_scale, kd_scale];
        let rest = [max_torque, stop_position, timeout, velocity_limit, acceleration_limit];
        let [[a, b, c, d, e], [f, g, h, i, j]] = [first, rest].map(|numbers| numbers.map(f32::to_bits));
        [a, b, c, d, e, f, g, h, i, j]
    }
}

/// How the drive is. What is not known is not a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The mode.
    pub mode: Mode,
    /// With the mode [`Mode::Fault`] why, else what limits the drive; 0 for nothing.
    pub fault: u8,
    /// Revolutions.
    pub position: f32,
    /// Revolutions a second.
    pub velocity: f32,
    /// N·m.
    pub torque: f32,
    /// Currents along d and q, A.
    pub current: [f32; 2],
    /// W, positive into the motor.
    pub power: f32,
    /// Bus voltage, V.
    pub voltage: f32,
    /// Of the bridge, °C.
    pub temperature: f32,
    /// Of the motor, °C.
    pub motor_temperature: f32,
    /// Whether the last commanded motion has arrived.
    pub trajectory_complete: bool,
    /// What the position refers to: 0 nothing, 1 the rotor, 2 the output.
    pub home: u8,
    /// Position and velocity by the Halls.
    pub halls: [f32; 2],
    /// The same by the absolute encoder.
    pub encoder: [f32; 2],
    /// What is followed: position, velocity, torque.
    pub control: [f32; 3],
    /// Torques of kp, ki, kd and the feed-forward.
    pub torques: [f32; 4],
    /// Since power-up, wrapping.
    pub milliseconds: u32,
    /// Of the bus.
    pub bus: BusHealth,
}

/// How a CAN is, as the drive sees it; all zero where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusHealth {
    /// Error counter of transmission; above 127 a node is passive, above 255 off the bus.
    pub transmit: u8,
    /// Error counter of reception, up to 127.
    pub receive: u8,
    /// Error flags are passive.
    pub passive: bool,
    /// How often it was off the bus.
    pub off: u32,
    /// Frames for which there was no room.
    pub lost: u32,
}

impl BusHealth {
    /// Nothing has happened.
    pub const NONE: Self = Self { transmit: 0, receive: 0, passive: false, off: 0, lost: 0 };
}

impl State {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        mode: Mode::Stopped,
        fault: 0,
        position: f32::NAN,
        velocity: f32::NAN,
        torque: f32::NAN,
        current: [f32::NAN; 2],
        power: f32::NAN,
        voltage: f32::NAN,
        temperature: f32::NAN,
        motor_temperature: f32::NAN,
        trajectory_complete: false,
        home: 0,
        halls: [f32::NAN; 2],
        encoder: [f32::NAN; 2],
        control: [f32::NAN; 3],
        torques: [f32::NAN; 4],
        milliseconds: 0,
        bus: BusHealth::NONE,
    };
}

/// What the drive says it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// A number for the kind of board.
    pub model: u32,
    /// Major, minor and micro, a byte each.
    pub firmware: u32,
    /// Of the chip, the lowest word first.
    pub serial: [u32; 3],
}

impl Identity {
    /// 16 bytes that tell it from others: the serial number, and the model.
    pub const fn uuid(&self) -> [u32; 4] {
        let [a, b, c] = self.serial;
        [a, b, c, self.model]
    }
}

/// The command is not obeyed: the drive cannot, or somebody else controls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused;

/// A drive.
pub trait Axis {
    /// Who it is.
    fn identity(&self) -> Identity;

    /// How it is.
    fn state(&self) -> State;

    /// Begins to do something, arming where that is needed. To refuse one later the drive reports [`Mode::Fault`].
    ///
    /// # Errors
    /// It does not, and goes on with what it does.
    fn command(&mut self, command: &Command) -> Result<(), Refused>;

    /// The output is at this position now; with `nearest`, up to whole turns of the motor.
    ///
    /// # Errors
    /// Not now.
    fn set_output(&mut self, position: f32, nearest: bool) -> Result<(), Refused>;

    /// The position refers to nothing any more.
    ///
    /// # Errors
    /// Not now.
    fn require_reindex(&mut self) -> Result<(), Refused>;

    /// What is followed begins anew at the position and velocity of the rotor.
    ///
    /// # Errors
    /// Not now.
    fn recapture(&mut self) -> Result<(), Refused>;
}
