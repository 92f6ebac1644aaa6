//! The bridge edge by edge: centre-aligned carrier, dead time, diodes.

use crate::inverter::{Leg, Legs, clipped};
use crate::windings::Terminal;

/// What a half bridge does at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// The low side conducts.
    Low,
    /// The high side conducts.
    High,
    /// Both are off: the diodes decide.
    Neither,
}

impl Switch {
    /// What it does to its terminal.
    pub(crate) fn terminal(self, bus_v: f64) -> Terminal {
        match self {
            Self::Low => Terminal::Driven(0.0),
            Self::High => Terminal::Driven(bus_v),
            Self::Neither => Terminal::Open,
        }
    }
}

/// A leg's timetable over one period.
#[derive(Clone, Copy, Debug)]
struct Timetable {
    /// Neither switch is on before this, for dead time begun in the period before.
    from_s: f64,
    /// Low side off.
    rise_s: f64,
    /// High side off.
    fall_s: f64,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Open,
    Low,
    High,
    Pulse,
}

/// How a leg left the period before.
#[derive(Clone, Copy, Debug, Default)]
struct Before {
    dead_s: f64,
    high: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct SwitchedLegs {
    period_s: f64,
    dead_time_s: f64,
    before: [Before; 3],
    now: [Timetable; 3],
}

/// At most this many spans in a period: five edges a leg, and three cuts that keep the rotor from
/// turning far in one span.
pub(crate) const MOST_SPANS: usize = 19;

impl SwitchedLegs {
    pub fn new(period_s: f64, dead_time_s: f64) -> Self {
        Self {
            period_s,
            dead_time_s,
            before: [Before::default(); 3],
            now: [Timetable { from_s: 0.0, rise_s: 0.0, fall_s: 0.0, kind: Kind::Open }; 3],
        }
    }

    /// Starts a period; returns the ends of its spans in order, the last being the period's end.
    pub fn start(&mut self, legs: &Legs) -> [f64; MOST_SPANS] {
        let mut ends_s = [self.period_s; MOST_SPANS];
        let mut count = 0;
        let mut mark = |at_s: f64, period_s: f64| {
            if at_s > 0.0 && at_s < period_s {
                ends_s[count] = at_s;
                count += 1;
            }
        };
        for quarter in [0.25, 0.5, 0.75] {
            mark(quarter * self.period_s, self.period_s);
        }
        for phase in 0..3 {
            let leg = if legs.enabled { legs.legs[phase] } else { Leg::Open };
            let table = self.schedule(leg, self.before[phase]);
            self.now[phase] = table;
            self.before[phase] = self.left_behind(table);
            mark(table.from_s, self.period_s);
            if table.kind == Kind::Pulse {
                for at_s in [table.rise_s, table.fall_s] {
                    mark(at_s, self.period_s);
                    mark(at_s + self.dead_time_s, self.period_s);
                }
            }
        }
        ends_s.sort_unstable_by(f64::total_cmp);
        ends_s
    }

    fn schedule(&self, leg: Leg, before: Before) -> Timetable {
        let (kind, duty) = match leg {
            Leg::Open => (Kind::Open, 0.0),
            Leg::Pwm(duty) => match clipped(duty) {
                0.0 => (Kind::Low, 0.0),
                1.0 => (Kind::High, 1.0),
                duty => (Kind::Pulse, duty),
            },
        };
        let changes_over = before.high != (kind == Kind::High);
        Timetable {
            from_s: if changes_over { self.dead_time_s } else { before.dead_s },
            rise_s: 0.5 * (1.0 - duty) * self.period_s,
            fall_s: 0.5 * (1.0 + duty) * self.period_s,
            kind,
        }
    }

    fn left_behind(&self, table: Timetable) -> Before {
        let over_s = table.fall_s + self.dead_time_s - self.period_s;
        Before {
            dead_s: if table.kind == Kind::Pulse && over_s > 0.0 { over_s } else { 0.0 },
            high: table.kind == Kind::High,
        }
    }

    fn switch(&self, phase: usize, at_s: f64) -> Switch {
        let table = &self.now[phase];
        if table.kind == Kind::Open || at_s < table.from_s {
            return Switch::Neither;
        }
        match table.kind {
            Kind::Open => Switch::Neither,
            Kind::Low => Switch::Low,
            Kind::High => Switch::High,
            Kind::Pulse if at_s < table.rise_s => Switch::Low,
            Kind::Pulse if at_s < table.rise_s + self.dead_time_s => Switch::Neither,
            Kind::Pulse if at_s < table.fall_s => Switch::High,
            Kind::Pulse if at_s < table.fall_s + self.dead_time_s => Switch::Neither,
            Kind::Pulse => Switch::Low,
        }
    }

    /// What the half bridges do within the span that contains this instant.
    pub fn switches(&self, at_s: f64) -> [Switch; 3] {
        [0, 1, 2].map(|phase| self.switch(phase, at_s))
    }
}

/// Current that the high sides draw from the bus.
pub(crate) fn drawn_a(switches: &[Switch; 3], currents_a: &[f64; 3]) -> f64 {
    let mut sum = 0.0;
    for (switch, current) in switches.iter().zip(currents_a) {
        if *switch == Switch::High {
            sum += current;
        }
    }
    sum
}
