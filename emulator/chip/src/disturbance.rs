use serde::Serialize;

/// What a script does to the board.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum Disturbance {
    /// A Hall's wire: 0 to 2.
    Hall(usize, HallFault),
    /// Two Halls' wires are exchanged.
    SwapHalls(usize, usize),
    /// The supply's voltage.
    Bus(f64),
    /// A current that flows out of a phase (0 to 2) through a short, in addition to the motor's, amperes.
    Overcurrent(usize, f64),
    /// Level of the break pin; `None` lets go of it.
    BreakPin(Option<bool>),
    /// Whether the contact of the enable input is closed.
    Enable(bool),
    /// Load torque at the shaft, N·m.
    Load(f64),
    /// Bytes into the serial port's RX, at its baud rate.
    Serial(Vec<u8>),
    /// The power goes away in the middle of the flash operation (program or erase) that follows this many more.
    PowerCut(u64),
    /// Power goes and comes back at once.
    PowerCycle,
    /// A brake holds the shaft at an angle, rad; `None` lets it go.
    Hold(Option<f64>),
    /// Something breaks of the encoder; `None`: it is as good as before.
    #[serde(skip)]
    Encoder(Option<plant::heads::Defect>),
}

/// How a Hall's wire is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum HallFault {
    /// As it should be.
    Good,
    /// Open: the input floats to its pull-down's level.
    Open,
    /// Shorted to ground.
    Ground,
    /// Shorted to the supply.
    Supply,
    /// Its output stays at the level of this moment.
    Stuck,
}
