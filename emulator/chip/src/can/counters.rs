//! Error counters, and what a node may do by them (RM0440, 44.3.3 and 44.4.13; ISO 11898-1, 12.1).

/// Error of a frame, as LEC and DLEC tell it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// More than five equal bits.
    Stuff = 1,
    /// A bit of fixed form has the wrong level.
    Form = 2,
    /// Nobody has acknowledged.
    Ack = 3,
    /// Recessive was sent and dominant seen.
    Bit1 = 4,
    /// Dominant was sent and recessive seen; in bus-off, each sequence of recessive bits.
    Bit0 = 5,
}

/// What may be done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Everything.
    #[default]
    Active,
    /// Error flags are recessive, and a second frame waits.
    Passive,
    /// Nothing.
    Off,
}

/// The counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Of transmission; over 255 is bus-off.
    pub transmit: u32,
    /// Of reception, up to 127, and whether it is beyond.
    pub receive: u32,
    /// All errors since the last reading, up to 255 (CEL).
    pub logged: u32,
    off: bool,
}

impl Counters {
    /// By the counters.
    pub fn state(&self) -> State {
        if self.off {
            State::Off
        } else if self.transmit > 127 || self.receive > 127 {
            State::Passive
        } else {
            State::Active
        }
    }

    /// One of them has reached 96.
    pub fn warns(&self) -> bool {
        self.transmit >= 96 || self.receive >= 96
    }

    /// A frame of its own has gone.
    pub fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
    }

    /// A frame of another has come.
    pub fn received(&mut self) {
        self.receive = if self.receive > 127 { 119 } else { self.receive.saturating_sub(1) };
    }

    /// A frame of its own has failed. Where nobody is there to acknowledge, a passive node does not count on.
    pub fn failed(&mut self, kind: Kind) {
        self.log();
        if kind != Kind::Ack || self.state() != State::Passive {
            self.transmit += 8;
        }
        self.off |= self.transmit > 255;
    }

    /// A frame of another has been found wrong.
    pub fn disturbed(&mut self, weight: u32) {
        self.log();
        self.receive = (self.receive + weight).min(128);
    }

    /// It was off long enough.
    pub fn recover(&mut self) {
        *self = Self { logged: self.logged, ..Self::default() };
    }

    fn log(&mut self) {
        self.logged = (self.logged + 1).min(255);
    }

    /// ECR.
    pub fn register(&self) -> u32 {
        let passive = u32::from(self.receive > 127);
        self.transmit.min(255) | self.receive.min(127) << 8 | passive << 15 | self.logged << 16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirty_two_failures_are_bus_off_and_a_lonely_node_stays_passive() {
        let mut counters = Counters::default();
        for failure in 1..=32 {
            counters.failed(Kind::Bit1);
            let state = if failure > 31 { State::Off } else { counters.state() };
            assert_eq!(state == State::Passive, (16..=31).contains(&failure), "{failure}");
            assert_eq!(counters.warns(), failure >= 12);
        }
        assert_eq!(counters.state(), State::Off);
        let mut lonely = Counters::default();
        for _ in 0..1000 {
            lonely.failed(Kind::Ack);
        }
        assert_eq!((lonely.transmit, lonely.state(), lonely.logged), (128, State::Passive, 255));
    }

    #[test]
    fn a_receiver_becomes_passive_and_no_more() {
        let mut counters = Counters::default();
        for _ in 0..100 {
            counters.disturbed(9);
        }
        assert_eq!((counters.state(), counters.register() & 0xff00), (State::Passive, 0xff00));
        counters.received();
        assert_eq!((counters.state(), counters.receive), (State::Active, 119));
    }
}
