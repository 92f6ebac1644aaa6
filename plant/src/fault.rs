//! What breaks between the drive and the motor while it runs.

use crate::switched::Switch;
use crate::windings::Terminal;

/// A transistor of a half bridge. Its diode lives on when it is dead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transistor {
    /// To the positive rail.
    Upper,
    /// To the negative rail.
    Lower,
}

/// What has happened to a current amplifier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AmplifierFault {
    /// It shows no current, whatever flows.
    Dead,
    /// It goes on showing this current, A.
    Frozen(f64),
    /// It shows so many times the current.
    Gain(f64),
}

impl AmplifierFault {
    fn shown_a(self, current_a: f64) -> f64 {
        match self {
            Self::Dead => 0.0,
            Self::Frozen(shown_a) => shown_a,
            Self::Gain(gain) => gain * current_a,
        }
    }
}

/// Which wire is connected where: the first end of wire k is k, the other is [`of`](Self::of) it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wires([usize; 3]);

impl Wires {
    /// Each where it belongs.
    pub const STRAIGHT: Self = Self([0, 1, 2]);

    /// Each moved on by so many places.
    #[must_use]
    pub const fn moved_on(by: usize) -> Self {
        Self([by % 3, (by + 1) % 3, (by + 2) % 3])
    }

    /// Two exchanged: all but the one of this number.
    #[must_use]
    pub const fn swapped(all_but: usize) -> Self {
        let mut wires = [0, 1, 2];
        let (one, other) = ((all_but + 1) % 3, (all_but + 2) % 3);
        (wires[one], wires[other]) = (other, one);
        Self(wires)
    }

    /// Where the other end of a wire (0 to 2) is.
    #[must_use]
    pub const fn of(self, wire: usize) -> usize {
        self.0[wire]
    }

    /// What is at the other ends, seen from the first.
    pub(crate) fn seen<T: Copy>(self, other: &[T; 3]) -> [T; 3] {
        self.0.map(|end| other[end])
    }
}

/// All that is broken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Faults {
    /// Of each leg.
    pub dead: [Option<Transistor>; 3],
    pub amplifiers: [Option<AmplifierFault>; 3],
    /// Of each winding.
    pub cut: [bool; 3],
    /// From the bridge to the windings.
    pub motor_wires: Wires,
    /// From the converter to the sensors.
    pub hall_wires: Wires,
}

impl Faults {
    pub const NONE: Self = Self {
        dead: [None; 3],
        amplifiers: [None; 3],
        cut: [false; 3],
        motor_wires: Wires::STRAIGHT,
        hall_wires: Wires::STRAIGHT,
    };

    /// Whether a transistor is dead: what that means depends on each edge.
    pub fn in_bridge(&self) -> bool {
        self.dead != [None; 3]
    }

    /// What the half bridges really do.
    pub fn switches(&self, commanded: [Switch; 3]) -> [Switch; 3] {
        let mut real = commanded;
        for (switch, dead) in real.iter_mut().zip(self.dead) {
            if matches!(
                (&switch, dead),
                (Switch::High, Some(Transistor::Upper)) | (Switch::Low, Some(Transistor::Lower))
            ) {
                *switch = Switch::Neither;
            }
        }
        real
    }

    /// The windings' terminals, of those of the legs.
    pub fn at_windings(&self, at_legs: &[Terminal; 3]) -> [Terminal; 3] {
        let mut terminals = [Terminal::Cut; 3];
        for leg in 0..3 {
            let winding = self.motor_wires.of(leg);
            if !self.cut[winding] {
                terminals[winding] = at_legs[leg];
            }
        }
        terminals
    }

    /// The legs' currents, of those of the windings.
    pub fn at_legs(&self, at_windings: &[f64; 3]) -> [f64; 3] {
        self.motor_wires.seen(at_windings)
    }

    /// What the amplifiers of the lower shunts show. Past a lower transistor that is dead only its diode leads, into
    /// the motor.
    pub fn shown_a(&self, legs_a: &[f64; 3]) -> [f64; 3] {
        let mut shown = *legs_a;
        for (leg, shown_a) in shown.iter_mut().enumerate() {
            if self.dead[leg] == Some(Transistor::Lower) && *shown_a < 0.0 {
                *shown_a = 0.0;
            }
            if let Some(fault) = self.amplifiers[leg] {
                *shown_a = fault.shown_a(*shown_a);
            }
        }
        shown
    }
}
