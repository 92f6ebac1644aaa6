//! The check after the bridge was switched on, before anything is followed: does each phase answer a voltage with its
//! current, and does the rotor turn the right way?
//!
//! 1. A voltage along phase A, against it, along B and against it, raised until a small current flows. It uses all six
//!    transistors and all three amplifiers, each in both directions.
//! 2. A push: a voltage along q of the rotor, raised until the rotor has moved by [`MOVED`]. Where it moved as it should,
//!    the opposite voltage stops it. Where it moved the other way, the opposite voltage is tried; if that moves it
//!    the other way as well, motor wires, Halls and calibration do not belong together.
//! 3. The same along d, for as long. It makes no torque unless the angle is wrong; one that moves the rotor farther than
//!    the push has means an angle that is wrong by more than 50°.
//!
//! All of it takes some hundredths of a second and moves the rotor by a few electrical degrees. A rotor that does not
//! move, because it is blocked or heavy, proves nothing, and one that turns is not pushed; the
//! [supervision](super::supervision) then goes on asking.

use super::{Demand, Idle};
use crate::angle::{ElectricalAngle, Position};
use crate::board::{Legs, Output, Sample};
use crate::commutation::Modulation;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::fault::Fault;
use crate::hall::track::Tracker;

/// Way by which the push is told from noise: 3° electrical, in 2⁻³² turns.
const MOVED: i64 = 35_791_394;
/// The same along d: 1.2 times as far.
const MOVED_ACROSS: i64 = MOVED / 5 * 6;
/// Steps over which the currents of a voltage are averaged.
const AVERAGED: u32 = 16;
/// How often a rotor may be found turning by itself before it is not pushed at all.
const MOST_WAITED: u32 = 20;
/// Steps for the currents to fade between two voltages, at least and at most.
const FADING: core::ops::Range<u32> = 8..200;

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
    Begin,
    /// Is over.
    Done {
        /// This step of ending it, from 0.
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
    /// A voltage along a phase rises.
    Raise,
    /// It stands while the currents are averaged.
    Hold,
    /// No voltage until the currents have faded.
    Fade,
    /// No voltage: how does the rotor turn by itself?
    Coast,
    /// The voltage along q rises.
    Push,
    /// The rotor went the wrong way: what does the opposite voltage do?
    Oppose,
    /// The rotor went the right way: the opposite voltage stops it.
    Stop,
    /// The voltage along d rises.
    Across,
    /// It is over; what was commanded meanwhile is taken up.
    Over,
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
    /// Currents of each voltage, in 2⁻¹⁵ of the full scale, times [`AVERAGED`].
    currents: [[i32; 3]; 4],
    /// Steps in which the push moved the rotor; none, where it did not.
    pushed: u32,
    /// How often the rotor was found turning by itself.
    waited: u32,
    /// Whether the push is over.
    was_pushed: bool,
    /// Whether the rotor moved as pushed, in the end.
    proven: bool,
    /// Where the present motion began.
    from: Position,
    /// Farthest that the rotor went the wrong way.
    farthest: i64,
    /// How the rotor turned before the push, in 2⁻³² turns a step.
    coasting: i32,
    /// The last command meanwhile.
    pub pending: Option<Pending>,
}

impl Arming {
    /// No check.
    pub const OFF: Self = Self {
        stage: Stage::Off,
        vector: 0,
        steps: 0,
        modulation: 0,
        rise: 0,
        least: 0,
        most: 0,
        currents: [[0; 3]; 4],
        pushed: 0,
        waited: 0,
        was_pushed: false,
        proven: false,
        from: Position::from_bits(0),
        farthest: 0,
        coasting: 0,
        pending: None,
    };

    /// The drive has armed; the next step begins.
    pub fn wait(&mut self) {
        self.enter(Stage::Wait);
    }

    /// Begins, at a bus voltage in 2⁻¹⁵ of its full scale. What was commanded since the drive has armed stays.
    pub fn begin(&mut self, control: &Control, bus: i32) {
        let check = &control.arming;
        // What flowed until now fades first.
        self.enter(Stage::Fade);
        self.vector = 0;
        self.currents = [[0; 3]; 4];
        (self.pushed, self.was_pushed, self.waited) = (0, false, 0);
        self.farthest = 0;
        // Shares of half the bus, of shares of half its full scale.
        let divisor = (bus >> 5).max(1);
        self.rise = ((check.rise / divisor) << 10).max(1);
        self.least = check.least;
        self.most = check.most.saturating_add(self.rise.saturating_mul(check.longest));
        self.modulation = self.least;
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

    /// One step on.
    pub fn step(&mut self, config: &Config, control: &Control, idle: &Idle, rotor: &Tracker, sample: &Sample) -> Step {
        self.steps += 1;
        let phases = idle.phases(control, sample);
        match self.stage {
            Stage::Off => self.finish(false),
            Stage::Wait if self.steps > 1 => Step::Begin,
            Stage::Wait => Step::Output(Output::OFF),
            Stage::Over => Step::Done { step: self.steps, proven: self.proven },
            Stage::Raise => self.raise(control, phases, config),
            Stage::Hold => self.hold(phases, config),
            Stage::Fade => self.fade(control, phases, config),
            Stage::Coast => self.coast(control, rotor, config),
            Stage::Push => self.push(control, phases, rotor, config),
            Stage::Oppose => self.oppose(rotor, config),
            // What rose evenly is made up for by its end in half of the time.
            Stage::Stop if self.steps > self.pushed / 2 => self.end_push(config),
            Stage::Stop => self.turned(-self.modulation, rotor, config),
            Stage::Across => self.across(control, phases, rotor, config),
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.steps = 0;
    }

    fn finish(&mut self, proven: bool) -> Step {
        self.enter(Stage::Over);
        self.proven = proven;
        Step::Done { step: 0, proven }
    }

    fn raise(&mut self, control: &Control, phases: [i32; 3], config: &Config) -> Step {
        self.modulation = self.modulation.saturating_add(self.rise);
        if self.flowing(phases) >= control.arming.current || self.modulation >= self.most {
            self.enter(Stage::Hold);
        }
        self.along_phase(config)
    }

    fn hold(&mut self, phases: [i32; 3], config: &Config) -> Step {
        if let Some(sums) = self.currents.get_mut(self.vector) {
            for (sum, current) in sums.iter_mut().zip(phases) {
                *sum += current;
            }
        }
        if self.steps >= AVERAGED {
            self.enter(Stage::Fade);
            self.vector += 1;
            self.modulation = self.least;
        }
        self.along_phase(config)
    }

    fn fade(&mut self, control: &Control, phases: [i32; 3], config: &Config) -> Step {
        let faded = largest(phases) < control.arming.current / 4 && self.steps >= FADING.start;
        if faded || self.steps >= FADING.end {
            if !faded && self.vector == 0 {
                // A rotor that turns drives a current of its own, which would be taken for a fault of the wiring.
                return self.finish(false);
            }
            if self.vector < self.currents.len() {
                self.enter(Stage::Raise);
            } else if let Some(fault) = wiring_fault(&self.currents, control.arming.current) {
                return Step::Failed(fault);
            } else {
                self.enter(Stage::Coast);
            }
        }
        Step::Output(no_voltage(config))
    }

    /// Measures how the rotor turns by itself.
    fn coast(&mut self, control: &Control, rotor: &Tracker, config: &Config) -> Step {
        let window = control.arming.longest_push / 4;
        if self.steps == 1 {
            self.from = rotor.smoothed();
        } else if self.steps > window {
            let way = self.way(rotor);
            self.coasting = (way / i64::from(window.max(1))) as i32;
            // What friction does to a rotor that turns looks like a push the wrong way; the shorted windings stop it.
            if way.abs() > MOVED {
                self.waited += 1;
                if self.waited > MOST_WAITED {
                    return self.finish(self.pushed > 0);
                }
                self.enter(Stage::Coast);
                return Step::Output(no_voltage(config));
            }
            self.from = rotor.smoothed();
            self.modulation = self.least;
            self.enter(if self.was_pushed { Stage::Across } else { Stage::Push });
        }
        Step::Output(no_voltage(config))
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
        let against = if self.vector & 1 == 0 { 0 } else { i32::MIN };
        let phase = if self.vector < 2 { 0 } else { THIRD };
        let angle = ElectricalAngle::from_bits(against.wrapping_add(phase));
        turned(self.modulation, angle, PhaseOrder::FORWARD, config)
    }

    /// Raises the voltage; returns how far the rotor has moved by it.
    fn press(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker) -> i64 {
        if largest(phases) < control.arming.push {
            self.modulation = self.modulation.saturating_add(self.rise).min(self.most.saturating_mul(4));
        }
        self.way(rotor) - i64::from(self.coasting) * i64::from(self.steps)
    }

    fn push(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        let moved = self.press(control, phases, rotor);
        if moved >= MOVED {
            self.pushed = self.steps;
            self.enter(Stage::Stop);
            return self.turned(-self.modulation, rotor, config);
        }
        if moved <= -MOVED {
            self.pushed = self.steps;
            self.from = rotor.smoothed();
            self.enter(Stage::Oppose);
        } else if self.steps >= control.arming.longest_push {
            return self.end_push(config);
        }
        self.turned(self.modulation, rotor, config)
    }

    fn end_push(&mut self, config: &Config) -> Step {
        self.was_pushed = true;
        self.enter(Stage::Coast);
        Step::Output(no_voltage(config))
    }

    fn across(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        if self.press(control, phases, rotor).abs() >= MOVED_ACROSS {
            return Step::Failed(Fault::Commutation);
        }
        let moved = self.pushed > 0;
        if self.steps >= if moved { self.pushed } else { control.arming.longest_push } {
            return self.finish(moved);
        }
        turned(self.modulation, rotor.predicted(&config.tracking), config.order(), config)
    }

    /// With a wrong commutation the opposite voltage stops the rotor and turns it back, and it is found out close to
    /// rest. An outside torque, which made a rotor with the right one move the wrong way, is helped by it.
    fn oppose(&mut self, rotor: &Tracker, config: &Config) -> Step {
        let way = self.way(rotor);
        self.farthest = self.farthest.min(way);
        if way - self.farthest > MOVED / 6 {
            return Step::Failed(Fault::Commutation);
        }
        if self.steps >= 4 * self.pushed {
            return self.finish(false);
        }
        self.turned(-self.modulation, rotor, config)
    }

    fn way(&self, rotor: &Tracker) -> i64 {
        rotor.smoothed().to_bits().wrapping_sub(self.from.to_bits())
    }

    /// A voltage along q of the rotor.
    fn turned(&self, modulation: i32, rotor: &Tracker, config: &Config) -> Step {
        let lead = if modulation < 0 { -ElectricalAngle::QUARTER } else { ElectricalAngle::QUARTER };
        turned(modulation.saturating_abs(), rotor.predicted(&config.tracking) + lead, config.order(), config)
    }
}

/// A third of a turn.
const THIRD: i32 = 1_431_655_765;

/// All three legs alike.
pub(super) fn no_voltage(config: &Config) -> Output {
    output(0, ElectricalAngle::ZERO, PhaseOrder::FORWARD, config)
}

/// A voltage vector at an angle.
fn turned(modulation: i32, angle: ElectricalAngle, order: PhaseOrder, config: &Config) -> Step {
    Step::Output(output(modulation, angle, order, config))
}

fn output(modulation: i32, angle: ElectricalAngle, order: PhaseOrder, config: &Config) -> Output {
    let amplitude = config.limits.amplitude(Modulation::from_bits((modulation >> 16) as i16));
    let axes = Axes::new(amplitude, order, config.limits.half());
    Output { compare: sinusoidal::compare(angle, &axes), legs: Legs::ALL }
}

/// The largest phase current.
fn largest(phases: [i32; 3]) -> i32 {
    phases.iter().map(|current| current.abs()).max().unwrap_or(0)
}

/// What the currents of the four voltages, times [`AVERAGED`], tell of the wiring.
fn wiring_fault(currents: &[[i32; 3]; 4], wanted: i32) -> Option<Fault> {
    const OPEN: [Fault; 3] = [Fault::OpenPhaseA, Fault::OpenPhaseB, Fault::OpenPhaseC];
    const BLIND: [Fault; 3] = [Fault::AmplifierA, Fault::AmplifierB, Fault::AmplifierC];
    let [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2], [d0, d1, d2]] = *currents;
    // How much flows in each phase, out of the bridge and into it.
    let ranges = [[a0, b0, c0, d0], [a1, b1, c1, d1], [a2, b2, c2, d2]]
        .map(|[a, b, c, d]| [a.max(b).max(c).max(d), -a.min(b).min(c).min(d)]);
    let most = ranges.iter().map(|[up, down]| *up.max(down)).max().unwrap_or(0);
    if most < wanted * AVERAGED as i32 / 4 {
        return Some(Fault::NoCurrent);
    }
    let unbalanced = currents.iter().any(|[a, b, c]| (a + b + c).abs() > most / 4);
    if let Some(phase) = ranges.iter().position(|[up, down]| *up.max(down) < most / 5) {
        return if unbalanced { BLIND } else { OPEN }.get(phase).copied();
    }
    if unbalanced {
        return Some(Fault::CurrentImbalance);
    }
    // A half bridge of which one transistor does not conduct.
    if let Some(phase) = ranges.iter().position(|[up, down]| *up.min(down) < most / 5) {
        return OPEN.get(phase).copied();
    }
    // Along A, then along B: the phase carries the largest current, and that in the voltage's direction.
    let own_and_others = [[a0 - b0, a1 - b1, a2 - b2], [c1 - d1, c0 - d0, c2 - d2]];
    let wrong = own_and_others.iter().position(|[own, one, other]| *own < one.abs().max(other.abs()) + most / 4);
    BLIND.get(wrong?).copied()
}
