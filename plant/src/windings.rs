//! Three windings in a star, solved exactly over spans of constant voltage.

use crate::error::{Error, positive};

/// What the inverter does with a terminal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Terminal {
    /// Held at a voltage against the negative rail.
    Driven(f64),
    /// Left to the diodes.
    Open,
    /// A broken wire: nothing flows.
    Cut,
}

/// Terminal voltages at which the diodes conduct.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Diodes {
    pub low_v: f64,
    pub high_v: f64,
}

/// Decay of a current over one span: what of it is lost, and the weight of the old in the mean.
#[derive(Clone, Copy, Debug)]
struct Decay {
    span_s: f64,
    lost: f64,
    old_in_mean: f64,
}

impl Decay {
    fn over(span_s: f64, time_constant_s: f64) -> Self {
        let relative = span_s / time_constant_s;
        let lost = -libm::expm1(-relative);
        Self { span_s, lost, old_in_mean: lost / relative }
    }
}

/// An open phase below this current has stopped conducting: far below anything measured, far
/// above rounding.
const EXTINCT_A: f64 = 1e-9;

#[derive(Clone, Debug)]
pub(crate) struct Windings {
    inductance_h: f64,
    conductance_s: f64,
    time_constant_s: f64,
    usual: Decay,
    pub currents_a: [f64; 3],
}

/// Means over a span.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Flow {
    pub currents_a: [f64; 3],
    pub terminals_v: [f64; 3],
    /// Current drawn from the positive rail through diodes; not positive.
    pub returned_a: f64,
}

/// Voltages while one set of phases conducts.
struct Conduction {
    /// Terminal voltage of the phases that conduct.
    held_v: [Option<f64>; 3],
    star_v: f64,
}

impl Windings {
    /// `resistance_ohm` of a winding and what drives it; `usual_s` is the span that comes up most.
    pub fn new(resistance_ohm: f64, inductance_h: f64, usual_s: f64) -> Result<Self, Error> {
        positive(resistance_ohm, "motor.resistance_ohm")?;
        positive(inductance_h, "motor.inductance_h")?;
        let time_constant_s = inductance_h / resistance_ohm;
        Ok(Self {
            inductance_h,
            conductance_s: 1.0 / resistance_ohm,
            time_constant_s,
            usual: Decay::over(usual_s, time_constant_s),
            currents_a: [0.0; 3],
        })
    }

    /// The resistance from now on.
    pub fn set_resistance(&mut self, resistance_ohm: f64) {
        self.conductance_s = 1.0 / resistance_ohm;
        self.time_constant_s = self.inductance_h / resistance_ohm;
        self.usual = Decay::over(self.usual.span_s, self.time_constant_s);
    }

    /// Ends the currents of windings that are cut. Two that remain conserve the flux of their loop, so each gives half
    /// of what the third carried; one alone has no way back.
    pub fn cut(&mut self, cut: &[bool; 3]) {
        let lost_a: f64 = (0..3).filter(|&phase| cut[phase]).map(|phase| self.currents_a[phase]).sum();
        let whole = cut.iter().filter(|&&cut| !cut).count();
        for (current_a, &cut) in self.currents_a.iter_mut().zip(cut) {
            *current_a = if cut || whole < 2 { 0.0 } else { *current_a + lost_a / whole as f64 };
        }
    }

    /// Lets the currents flow for a span of constant terminal voltages and back-EMF.
    pub fn advance(&mut self, terminals: &[Terminal; 3], emf_v: &[f64; 3], diodes: Diodes, span_s: f64) -> Flow {
        if let [Terminal::Driven(a), Terminal::Driven(b), Terminal::Driven(c)] = *terminals {
            return self.driven(&[a, b, c], emf_v, span_s);
        }
        let mut mean = Flow::default();
        let mut left_s = span_s;
        // A phase goes out at most once for each time that it starts to conduct; three phases
        // rarely do so twice in a span. The last part takes what is left in one.
        for part in 0..6 {
            let conduction = self.conduction(terminals, emf_v, diodes);
            let target_a = self.targets(&conduction, emf_v);
            let mut part_s = left_s;
            if part < 5 {
                for phase in 0..3 {
                    if terminals[phase] == Terminal::Open {
                        part_s = part_s.min(self.extinction_s(phase, target_a[phase]));
                    }
                }
            }
            let whole = part_s >= left_s;
            let flow = self.flow(&conduction, &target_a, emf_v, terminals, part_s);
            let weight = if whole && part == 0 { 1.0 } else { part_s / span_s };
            mean.add(&flow, weight);
            if whole {
                break;
            }
            left_s -= part_s;
        }
        mean
    }

    /// The same where every terminal is held, as nearly always: no diode conducts.
    fn driven(&mut self, terminals_v: &[f64; 3], emf_v: &[f64; 3], span_s: f64) -> Flow {
        let decay = self.decay(span_s);
        let across_v = less(terminals_v, emf_v);
        let star_v = (across_v[0] + across_v[1] + across_v[2]) * (1.0 / 3.0);
        let mut mean_a = [0.0; 3];
        for phase in 0..3 {
            let target_a = (across_v[phase] - star_v) * self.conductance_s;
            let old_a = self.currents_a[phase];
            mean_a[phase] = target_a + (old_a - target_a) * decay.old_in_mean;
            self.currents_a[phase] = old_a + (target_a - old_a) * decay.lost;
        }
        Flow { currents_a: mean_a, terminals_v: *terminals_v, returned_a: 0.0 }
    }

    fn decay(&self, span_s: f64) -> Decay {
        if span_s == self.usual.span_s { self.usual } else { Decay::over(span_s, self.time_constant_s) }
    }

    /// The same with a flux of each phase beyond what the inductance links, which follows from the share of the span and
    /// the currents. In parts so short that the currents are exact to some thousandths of their change.
    pub fn advance_in_iron<Flux: Fn(&[f64; 3]) -> [f64; 3]>(
        &mut self,
        terminals: &[Terminal; 3],
        emf_v: &[f64; 3],
        diodes: Diodes,
        span_s: f64,
        flux_vs_at: impl Fn(f64) -> Flux,
    ) -> Flow {
        let parts = libm::ceil(span_s / (0.05 * self.time_constant_s)).clamp(1.0, 20.0);
        let (part_s, share) = (span_s / parts, 1.0 / parts);
        let mut mean = Flow::default();
        let mut beyond_v = [0.0; 3];
        for part in 0..parts as u32 {
            let begin_vs = flux_vs_at(share * f64::from(part))(&self.currents_a);
            let end_vs = flux_vs_at(share * f64::from(part + 1));
            let flow = self.advance_until(terminals, emf_v, diodes, part_s, &mut beyond_v, |currents_a| {
                let end_vs = end_vs(currents_a);
                [0, 1, 2].map(|k| (end_vs[k] - begin_vs[k]) / part_s)
            });
            mean.add(&flow, share);
        }
        mean
    }

    /// With a voltage in each phase, beside the back-EMF, that follows from the currents at the end; `beyond_v` is about what
    /// it is, and then what it was.
    fn advance_until(
        &mut self,
        terminals: &[Terminal; 3],
        emf_v: &[f64; 3],
        diodes: Diodes,
        span_s: f64,
        beyond_v: &mut [f64; 3],
        induced_v: impl Fn(&[f64; 3]) -> [f64; 3],
    ) -> Flow {
        let before_a = self.currents_a;
        let mut last: Option<([f64; 3], [f64; 3])> = None;
        let mut tries = 0;
        loop {
            let flow = self.advance(terminals, &sum(emf_v, beyond_v), diodes, span_s);
            let off_v = less(&induced_v(&self.currents_a), beyond_v);
            // Where diodes switch, it may not settle.
            tries += 1;
            if off_v.iter().all(|off| off.abs() < 1e-7) || tries == 60 {
                return flow;
            }
            self.currents_a = before_a;
            let tried_v = *beyond_v;
            *beyond_v = sum(&tried_v, &off_v);
            // What the step before has changed tells how far to go (Anderson's acceleration).
            if let Some((tried_before_v, off_before_v)) = last {
                let (moved_v, changed_v) = (less(&tried_v, &tried_before_v), less(&off_v, &off_before_v));
                let share = dot(&off_v, &changed_v) / dot(&changed_v, &changed_v);
                if share.abs() < 2.0 {
                    *beyond_v = less(beyond_v, &sum(&moved_v, &changed_v).map(|volts| share * volts));
                }
            }
            last = Some((tried_v, off_v));
        }
    }

    /// Which phases conduct, and where that puts the star point.
    fn conduction(&mut self, terminals: &[Terminal; 3], emf_v: &[f64; 3], diodes: Diodes) -> Conduction {
        let mut held_v = [None; 3];
        for phase in 0..3 {
            held_v[phase] = match terminals[phase] {
                Terminal::Cut => None,
                Terminal::Driven(volts) => Some(volts),
                Terminal::Open if self.currents_a[phase] > EXTINCT_A => Some(diodes.low_v),
                Terminal::Open if self.currents_a[phase] < -EXTINCT_A => Some(diodes.high_v),
                Terminal::Open => {
                    self.currents_a[phase] = 0.0;
                    None
                }
            };
        }
        if held_v == [None; 3] {
            return rectifier(terminals, emf_v, diodes);
        }
        loop {
            let star_v = star_point(&held_v, emf_v);
            // The floating terminal furthest beyond a rail is the next to conduct.
            let mut furthest = (0.0, None);
            for phase in 0..3 {
                if held_v[phase].is_none() && terminals[phase] != Terminal::Cut {
                    let volts = star_v + emf_v[phase];
                    let (above, below) = (volts - diodes.high_v, diodes.low_v - volts);
                    if above > furthest.0 {
                        furthest = (above, Some((phase, diodes.high_v)));
                    }
                    if below > furthest.0 {
                        furthest = (below, Some((phase, diodes.low_v)));
                    }
                }
            }
            match furthest.1 {
                Some((phase, volts)) => held_v[phase] = Some(volts),
                None => return Conduction { held_v, star_v },
            }
        }
    }

    /// Currents that the voltages would settle at.
    fn targets(&self, conduction: &Conduction, emf_v: &[f64; 3]) -> [f64; 3] {
        let mut target_a = [0.0; 3];
        for phase in 0..3 {
            if let Some(volts) = conduction.held_v[phase] {
                target_a[phase] = (volts - emf_v[phase] - conduction.star_v) * self.conductance_s;
            }
        }
        target_a
    }

    /// When a freewheeling current reaches zero on its way to a target beyond; never: infinity.
    fn extinction_s(&self, phase: usize, target_a: f64) -> f64 {
        let current = self.currents_a[phase];
        if current == 0.0 || target_a * current >= 0.0 {
            return f64::INFINITY;
        }
        self.time_constant_s * libm::log1p(-current / target_a)
    }

    fn flow(
        &mut self,
        conduction: &Conduction,
        target_a: &[f64; 3],
        emf_v: &[f64; 3],
        terminals: &[Terminal; 3],
        span_s: f64,
    ) -> Flow {
        let decay = self.decay(span_s);
        let mut flow = Flow::default();
        for phase in 0..3 {
            let (old, target) = (self.currents_a[phase], target_a[phase]);
            let mean = target + (old - target) * decay.old_in_mean;
            self.currents_a[phase] = old + (target - old) * decay.lost;
            flow.currents_a[phase] = mean;
            flow.terminals_v[phase] = conduction.held_v[phase].unwrap_or(conduction.star_v + emf_v[phase]);
            if terminals[phase] == Terminal::Open && mean < 0.0 {
                flow.returned_a += mean;
            }
        }
        flow
    }
}

impl Flow {
    fn add(&mut self, part: &Self, weight: f64) {
        for phase in 0..3 {
            self.currents_a[phase] += weight * part.currents_a[phase];
            self.terminals_v[phase] += weight * part.terminals_v[phase];
        }
        self.returned_a += weight * part.returned_a;
    }
}

fn sum(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn less(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Star point of the phases that conduct: their currents add up to nothing.
fn star_point(held_v: &[Option<f64>; 3], emf_v: &[f64; 3]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for phase in 0..3 {
        if let Some(volts) = held_v[phase] {
            sum += volts - emf_v[phase];
            count += 1;
        }
    }
    sum * [0.0, 1.0, 0.5, 1.0 / 3.0][count]
}

/// Nothing driven, nothing flowing: the diodes conduct once the line-to-line EMF exceeds the bus.
/// Otherwise the star point is taken to lie midway, where leakage would leave it.
fn rectifier(terminals: &[Terminal; 3], emf_v: &[f64; 3], diodes: Diodes) -> Conduction {
    let whole = (0..3).find(|&phase| terminals[phase] != Terminal::Cut).unwrap_or(0);
    let (mut most, mut least) = (whole, whole);
    for phase in 0..3 {
        if terminals[phase] == Terminal::Cut {
            continue;
        }
        if emf_v[phase] > emf_v[most] {
            most = phase;
        }
        if emf_v[phase] < emf_v[least] {
            least = phase;
        }
    }
    let mut held_v = [None; 3];
    if emf_v[most] - emf_v[least] > diodes.high_v - diodes.low_v {
        held_v[most] = Some(diodes.high_v);
        held_v[least] = Some(diodes.low_v);
    }
    let middle_emf = 0.5 * (emf_v[most] + emf_v[least]);
    Conduction { held_v, star_v: 0.5 * (diodes.low_v + diodes.high_v) - middle_emf }
}
