//! The check after the bridge was switched on, before anything is followed: does each phase answer a voltage with its
//! current, and does the rotor turn the right way?
//!
//! 1. A voltage along phase A, against it, along B and against it, raised until a small current flows. It uses all six
//!    transistors and all three amplifiers, each in both directions.
//! 2. A push, and a field that holds the rotor and turns it back: the [`rotor`]. What it finds wrong may be a load that was
//!    [let go](let_go).
//!
//! All of it takes some 0.2 s and moves the rotor by some 30 electrical degrees and back, by more where cogging carries
//! it on. A rotor that does not move, because it is blocked or heavy, proves nothing, and one that turns
//! is not pushed; the [supervision](super::supervision) then goes on asking.

mod let_go;
mod rotor;

use super::Demand;
use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output};
use crate::commutation::Modulation;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
use crate::config::Config;
use crate::control::config::{ARMING_EVERY as EVERY, Config as Control};
use crate::fault::Fault;
use crate::hall::track::Tracker;
use let_go::LetGo;
use rotor::RotorCheck;

/// Control steps over which the currents of a voltage are averaged.
const AVERAGED: u32 = 16;
/// How often it is looked whether a rotor rests before it is taken for one that something turns.
const LONGEST_SETTLED: u32 = 20;
/// Steps for the currents to fade between two voltages, at least and at most.
const FADING: core::ops::Range<u32> = 4..100;

/// What was commanded during the check, and is done after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pending {
    /// To follow something.
    Demand(Demand),
    /// A voltage.
    Voltage(Modulation),
}

/// What a step of the check comes to.
pub(super) enum Step {
    /// Goes on.
    Output(Output),
    /// Is to begin.
    Begin {
        /// Whether the rotor turns so slowly that it can be checked.
        slow: bool,
    },
    /// Is over.
    Done {
        /// This step of ending it, from 1.
        step: u32,
        /// Whether the rotor moved as pushed.
        proven: bool,
    },
    /// Something is wrong.
    Failed(Fault),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// No check.
    Off,
    /// The bridge is about to be switched on.
    Wait,
    /// No voltage until the rotor rests.
    Settle,
    /// A voltage along a phase rises.
    Raise,
    /// It stands until the rotor rests.
    Steady,
    /// It stands while the currents are averaged.
    Hold,
    /// No voltage until the currents have faded.
    Fade,
    /// The rotor is pushed.
    Rotor,
    /// The bridge is off: does something else turn the rotor?
    LetGo,
    /// Over; whether the rotor moved as pushed.
    Over { proven: bool },
}

/// The check and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arming {
    stage: Stage,
    /// Number of the voltage: along and against A, along and against B.
    vector: usize,
    /// Steps of this stage.
    steps: u32,
    /// Modulation and what it rises by in a step, in 2⁻³¹; where a rise begins and ends.
    modulation: i32,
    rise: i32,
    least: i32,
    most: i32,
    /// Where the rotor was, and how far it has gone, in 2⁻³² electrical turns; how often it was looked whether it rests.
    from: i32,
    farthest: u32,
    settled: u32,
    /// Whether the rotor swung when the currents told of a fault, and all of it is done once more, with a rotor at rest.
    again: bool,
    /// Currents of each voltage, in 2⁻¹⁵ of the full scale, times [`AVERAGED`].
    currents: [[i32; 3]; 4],
    rotor: RotorCheck,
    let_go: LetGo,
    /// What the steps between do.
    held: Output,
    /// The last command meanwhile.
    pub pending: Option<Pending>,
}

impl Arming {
    /// No check.
    // A constant would lie in the flash with all its zeros: 120 bytes.
    #[inline(always)]
    pub const fn off() -> Self {
        Self {
            stage: Stage::Off,
            vector: 0,
            steps: 0,
            modulation: 0,
            rise: 0,
            least: 0,
            most: 0,
            from: 0,
            farthest: 0,
            settled: 0,
            again: false,
            currents: [[0; 3]; 4],
            rotor: RotorCheck::new(0, 0, 0),
            let_go: LetGo::NEW,
            held: Output::OFF,
            pending: None,
        }
    }

    /// The drive has armed; the next step begins.
    pub fn wait(&mut self) {
        self.held = Output::OFF;
        self.enter(Stage::Wait);
    }

    /// Begins, at a bus voltage in 2⁻¹⁵ of its full scale. What was commanded since the drive has armed stays.
    pub fn begin(&mut self, control: &Control, bus: i32) {
        let check = &control.arming;
        self.again = false;
        self.begin_currents();
        // Shares of half the bus, of shares of half its full scale.
        let divisor = (bus >> 5).max(1);
        self.rise = ((check.rise / divisor) << 10).max(1);
        self.least = check.least;
        self.modulation = self.least;
        self.most = check.most.saturating_add(self.rise.saturating_mul(check.longest.into()));
        self.rotor = RotorCheck::new((self.rise / 4).max(1), self.least, self.most.saturating_mul(4));
    }

    fn begin_currents(&mut self) {
        self.enter(Stage::Settle);
        (self.settled, self.vector) = (0, 0);
        self.currents = [[0; 3]; 4];
    }

    /// What the last step was told to do.
    pub const fn held(&self) -> Output {
        self.held
    }

    /// Breaks off.
    pub fn end(&mut self) {
        self.stage = Stage::Off;
        self.pending = None;
    }

    /// Whether it is under way.
    pub fn is_active(&self) -> bool {
        self.stage != Stage::Off
    }

    /// One step of the check on, with the phase currents in 2⁻¹⁵ of their full scale.
    pub fn step(&mut self, config: &Config, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Step {
        self.steps += 1;
        let step = match self.stage {
            Stage::Off => Step::Done { step: 2, proven: false },
            Stage::Wait if self.steps == 1 => Step::Output(Output::OFF),
            Stage::Wait => Step::Begin { slow: control.arming.enabled && !turns(rotor, control) },
            Stage::Settle => self.settle(control, phases, rotor, config),
            Stage::Raise => self.raise(control, phases, config),
            Stage::Steady => self.steady(control, phases, rotor, config),
            Stage::Hold => self.hold(phases, config),
            Stage::Fade => self.fade(control, phases, rotor, config),
            Stage::Rotor => match self.rotor.step(config, control, phases, rotor) {
                Step::Done { proven, .. } => self.over(proven, config),
                Step::Failed(_) => {
                    self.enter(Stage::LetGo);
                    self.let_go.begin(control, rotor)
                }
                step => step,
            },
            Stage::LetGo => match self.let_go.step(control, rotor) {
                Step::Done { .. } => self.over(false, config),
                Step::Failed(_) if self.rotor.begin_again(control, rotor) => {
                    self.enter(Stage::Rotor);
                    Step::Output(no_voltage(config))
                }
                step => step,
            },
            Stage::Over { proven } => Step::Done { step: self.steps, proven },
        };
        if let Step::Output(output) = step {
            self.held = output;
        }
        step
    }

    /// The control step between two of the check, in which the drive may have a command to take up.
    #[inline(never)]
    pub fn between(&mut self, config: &Config, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Output {
        match self.stage {
            Stage::Hold => self.sum(phases),
            Stage::Rotor if self.rotor.presses() => self.held = self.rotor.lean(config, control, phases, rotor),
            _ => {}
        }
        self.held
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.steps = 0;
    }

    /// Brakes a rotor that turns slowly by shorting its windings, until it rests. Through the low sides throughout: half of the
    /// period each, the dead time would take what a slow rotor induces.
    #[cfg_attr(not(feature = "small"), inline(never))]
    fn settle(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        // A quarter of the period of a swing looks like rest.
        if let Some(rests) =
            self.watched(u32::from(control.arming.watched) << (2 * u32::from(self.again)), control, rotor)
        {
            // One that drives a current turns, whatever flux linkage the settings know.
            let rests = rests && largest(&phases) < i32::from(control.arming.current) / 4;
            self.enter(if rests { Stage::Fade } else { Stage::Settle });
            if self.settled >= LONGEST_SETTLED {
                return self.over(false, config);
            }
        }
        Step::Output(Output { compare: [0; 3], legs: Legs::ALL })
    }

    /// After so many steps, whether the rotor has rested in them.
    fn watched(&mut self, steps: u32, control: &Control, rotor: &Tracker) -> Option<bool> {
        let position = rotor.smoothed().to_bits() as i32;
        if self.steps == 1 {
            (self.from, self.farthest) = (position, 0);
        }
        // One that swings comes back to where it was.
        let way = position.wrapping_sub(self.from).unsigned_abs();
        self.farthest = if turns(rotor, control) { u32::MAX } else { self.farthest.max(way) };
        (self.steps > steps).then(|| {
            self.settled += 1;
            self.farthest <= control.arming.rests_within
        })
    }

    /// Ends, a little in each of the next steps.
    fn over(&mut self, proven: bool, config: &Config) -> Step {
        self.enter(Stage::Over { proven });
        Step::Output(no_voltage(config))
    }

    fn raise(&mut self, control: &Control, phases: [i32; 3], config: &Config) -> Step {
        self.modulation = self.modulation.saturating_add(self.rise);
        if self.flowing(phases) >= i32::from(control.arming.current) || self.modulation >= self.most {
            self.enter(if self.again { Stage::Steady } else { Stage::Hold });
        }
        self.along_phase(config)
    }

    /// A light rotor turns towards the voltage, and its back-EMF changes the currents until it is there. What it took off the
    /// current is taken off the voltage, then.
    #[cfg_attr(not(feature = "small"), inline(never))]
    fn steady(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        if self.flowing(phases) > i32::from(control.arming.current) {
            self.modulation = (self.modulation - self.rise).max(0);
        }
        if let Some(rests) = self.watched(control.arming.watched.into(), control, rotor) {
            let over = rests || self.settled >= LONGEST_SETTLED;
            self.enter(if over { Stage::Hold } else { Stage::Steady });
        }
        self.along_phase(config)
    }

    fn hold(&mut self, phases: [i32; 3], config: &Config) -> Step {
        self.sum(phases);
        if self.steps >= AVERAGED / EVERY {
            self.enter(Stage::Fade);
            self.vector += 1;
            self.modulation = self.least;
        }
        self.along_phase(config)
    }

    /// Sums up the currents of the present voltage.
    fn sum(&mut self, phases: [i32; 3]) {
        if let Some(sums) = self.currents.get_mut(self.vector) {
            for (sum, current) in sums.iter_mut().zip(phases) {
                *sum += current;
            }
        }
    }

    fn fade(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        // Where a voltage has set the rotor turning, its back-EMF drives a current until the shorted windings have braked it.
        let faded = largest(&phases) < i32::from(control.arming.current) / 8 && self.steps >= FADING.start;
        if faded || self.steps >= FADING.end {
            if !faded && self.vector == 0 && turns(rotor, control) {
                // A rotor that turns drives a current of its own, which would be taken for a fault of the wiring.
                return self.over(false, config);
            }
            let nothing = self.shows_nothing(control);
            if self.vector == 1 && nothing {
                // Where A is open, or all is blind, the opposite voltage would show as little, and turn a light rotor over.
                self.vector += 1;
            }
            // With one open phase, one of A and B carries a current.
            if self.vector < self.currents.len() && !(self.vector > 2 && nothing) {
                self.enter(Stage::Raise);
            } else if let Some(fault) = wiring_fault(&self.currents, control.arming.current.into()) {
                let may_swing = turns(rotor, control) && fault != Fault::NoCurrent;
                if self.again || !may_swing {
                    return Step::Failed(fault);
                }
                self.again = true;
                self.begin_currents();
            } else {
                self.enter(Stage::Rotor);
            }
        }
        Step::Output(no_voltage(config))
    }

    /// Whether no voltage so far has made a current.
    fn shows_nothing(&self, control: &Control) -> bool {
        let largest = self.currents.iter().map(largest).max().unwrap_or(0);
        largest < i32::from(control.arming.current) * AVERAGED as i32 / 4
    }

    /// The current in the direction of the present voltage. The phase that it is along carries it, the other two half
    /// of it each, so that one blind amplifier does not matter.
    fn flowing(&self, phases: [i32; 3]) -> i32 {
        let share = |(phase, current): (usize, i32)| {
            let current = if phase == self.vector / 2 { current } else { -2 * current };
            if self.vector & 1 == 0 { current } else { -current }
        };
        phases.into_iter().enumerate().map(share).max().unwrap_or(0)
    }

    /// The present voltage, along a phase or against it.
    fn along_phase(&self, config: &Config) -> Step {
        let against = if self.vector & 1 == 0 { ElectricalAngle::ZERO } else { ElectricalAngle::HALF };
        let phase = if self.vector < 2 { ElectricalAngle::ZERO } else { ElectricalAngle::THIRD };
        Step::Output(turned(self.modulation, against + phase, PhaseOrder::FORWARD, config))
    }
}

/// Whether the rotor turns too fast to be shorted.
fn turns(rotor: &Tracker, control: &Control) -> bool {
    rotor.speed().unsigned_abs() > control.arming.turns.unsigned_abs()
}

/// All three legs alike.
pub(super) fn no_voltage(config: &Config) -> Output {
    turned(0, ElectricalAngle::ZERO, PhaseOrder::FORWARD, config)
}

/// A voltage vector at an angle.
fn turned(modulation: i32, angle: ElectricalAngle, order: PhaseOrder, config: &Config) -> Output {
    let amplitude = config.limits.amplitude(Modulation::from_bits((modulation >> 16) as i16));
    let axes = Axes::new(amplitude, order, config.limits.half());
    Output { compare: sinusoidal::compare(angle, &axes), legs: Legs::ALL }
}

/// The largest phase current.
#[cfg_attr(feature = "small", inline(never))]
fn largest(phases: &[i32; 3]) -> i32 {
    phases.iter().map(|current| current.abs()).max().unwrap_or(0)
}

/// What the currents of the four voltages, times [`AVERAGED`], tell of the wiring.
// Not inlined, so that a board may place it where there is room.
#[cfg_attr(not(feature = "small"), inline(never))]
fn wiring_fault(currents: &[[i32; 3]; 4], reference: i32) -> Option<Fault> {
    const OPEN: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];
    const BLIND: [Fault; 3] = [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC];
    let [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2], [d0, d1, d2]] = *currents;
    // How much flows in each phase, out of the bridge and into it.
    let mut ranges = [[0; 2]; 3];
    for sums in currents {
        for ([up, down], sum) in ranges.iter_mut().zip(sums) {
            (*up, *down) = ((*up).max(*sum), (*down).max(-sum));
        }
    }
    let most = ranges.iter().map(|[up, down]| *up.max(down)).max().unwrap_or(0);
    if most < reference * AVERAGED as i32 / 4 {
        return Some(Fault::NoCurrent);
    }
    // The three of a voltage sum to zero. Opposite voltages differ by twice what an amplifier does not show, and errors of
    // the zeros cancel.
    let [along_a, against_a, along_b, against_b] = currents.map(|[a, b, c]| a + b + c);
    let hidden = (along_a - against_a).abs().max((along_b - against_b).abs());
    if let Some(phase) = ranges.iter().position(|[up, down]| *up.max(down) < most / 5) {
        return if hidden > most / 2 { BLIND } else { OPEN }.get(phase).copied();
    }
    // An amplifier that shows half of it, in a phase that carries half of it, hides a quarter.
    if hidden > most / 3 {
        return Some(Fault::CurrentImbalance);
    }
    // A half bridge of which one transistor does not conduct. The back-EMF of a light rotor that follows the voltages can take
    // most of what flows one way in C.
    if let Some(phase) = ranges.iter().position(|[up, down]| *up.min(down) < most / 10) {
        return OPEN.get(phase).copied();
    }
    // Along A, then along B: the phase carries the largest current, and that in the voltage's direction.
    let own_and_others = [[a0 - b0, a1 - b1, a2 - b2], [c1 - d1, c0 - d0, c2 - d2]];
    let wrong = own_and_others.iter().position(|[own, one, other]| *own < one.abs().max(other.abs()) + most / 4);
    BLIND.get(wrong?).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What each amplifier shows while the voltages along and against A and B drive a current of `I`, with an error of the
    /// zeros, and with phase B shown by `shown` of what flows.
    fn currents(flowing: [[i32; 3]; 2], zeros: [i32; 3], shown: i32) -> [[i32; 3]; 4] {
        let [along_a, along_b] = flowing;
        [(along_a, 1), (along_a, -1), (along_b, 1), (along_b, -1)]
            .map(|([a, b, c], sign)| [a * sign + zeros[0], b * sign * shown + zeros[1], c * sign + zeros[2]])
    }

    const REFERENCE: i32 = 100;
    const I: i32 = REFERENCE * AVERAGED as i32;
    const SOUND: [[i32; 3]; 2] = [[I, -I / 2, -I / 2], [-I / 2, I, -I / 2]];
    /// A voltage along B makes no current where B is open.
    const OPEN_B: [[i32; 3]; 2] = [[I, 0, -I], [0, 0, 0]];

    #[test]
    fn errors_of_the_zeros_do_not_make_an_open_phase_a_blind_amplifier() {
        for zero in [-I / 12, 0, I / 12] {
            let open = currents(OPEN_B, [zero; 3], 1);
            assert_eq!(wiring_fault(&open, REFERENCE), Some(Fault::OpenPhaseB), "{zero}");
            let blind = currents(SOUND, [zero; 3], 0);
            assert_eq!(wiring_fault(&blind, REFERENCE), Some(Fault::AmplifierB), "{zero}");
        }
        assert_eq!(wiring_fault(&currents(SOUND, [0; 3], 1), REFERENCE), None);
    }
}
