//! The second half of the check at arming: does the rotor turn as it is pushed?
//!
//! 1. A push: a voltage along q of the rotor, raised until the rotor turns, until it has moved by [`FAR`]. Where it moved
//!    as it should, the opposite voltage stops it. Where it moved the other way, the opposite voltage is tried; if that
//!    moves it the other way as well, motor wires, Halls and calibration do not belong together.
//! 2. The same along d and against it, each for as long. Neither makes a torque unless the angle is wrong; what they make
//!    of opposite sign tells it from cogging. One that moves the rotor 0.4 times as far as the push means an angle that
//!    is wrong by more than 20 to 30°.
//! 3. All of it once more in the other direction, which takes the rotor back. Where two wires are swapped, the angle
//!    counts the wrong way: its error is twice the way, and cannot be small at both ends of [`APART`].

use super::{Step, largest, no_voltage, turned};
use crate::angle::{ElectricalAngle, Position};
use crate::board::Output;
use crate::commutation::frames::{AlphaBeta, Rotation};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::fault::Fault;
use crate::hall::track::Tracker;

/// Way by which the push is told from noise: 3° electrical, in 2⁻³² turns.
const MOVED: i64 = 35_791_394;
/// Way after which the push is over: 15°.
const FAR: i64 = 5 * MOVED;
/// Way from one end to the other that tells an angle which counts the wrong way: 24°.
const APART: i64 = 8 * MOVED;
/// Longest way in which a sound rotor is stopped: 33°; and 9° where a voltage along d has hardly moved it.
const STOPPED: i64 = 11 * MOVED;
const STOPPED_ACROSS: i64 = 3 * MOVED;
/// All of it takes so many longest pushes at most.
const LONGEST: u32 = 8;
/// How often a rotor may be found turning by itself before it is not pushed at all.
const MOST_WAITED: u32 = 40;
/// Pushes forward at most, each from where the one before came to rest.
const MOST_PUSHES: u32 = 3;

/// The voltage leans by so much a step, 0.3°, in 2⁻³² turns, and by 45° at most.
const LEANS: i32 = 3_579_139;
const LEANS_MOST: i32 = 150 * LEANS;

/// Where a voltage points, seen from the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    /// Along q, and against it.
    Forward,
    Back,
    /// Along d, and against it.
    Along,
    Against,
}

impl Axis {
    fn angle(self) -> ElectricalAngle {
        match self {
            Self::Forward => ElectricalAngle::QUARTER,
            Self::Back => -ElectricalAngle::QUARTER,
            Self::Along => ElectricalAngle::ZERO,
            Self::Against => ElectricalAngle::HALF,
        }
    }

    fn opposite(self) -> Self {
        match self {
            Self::Forward => Self::Back,
            Self::Back => Self::Forward,
            Self::Along => Self::Against,
            Self::Against => Self::Along,
        }
    }

    fn pushes(self) -> bool {
        matches!(self, Self::Forward | Self::Back)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// No voltage: how does the rotor turn by itself?
    Coast,
    /// The voltage along the axis rises.
    Press,
    /// The rotor went the wrong way: what does the opposite voltage do?
    Oppose,
    /// The opposite voltage stops the rotor.
    Stop,
}

/// The check of the rotor and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotorCheck {
    stage: Stage,
    axis: Axis,
    /// Steps of this stage, and of the whole check.
    steps: u32,
    age: u32,
    /// Modulation, what it rises by in a step, where it begins and ends, in 2⁻³¹; and where it ends along d.
    modulation: i32,
    rise: i32,
    least: i32,
    most: i32,
    strongest: i32,
    /// Steps in which the push moved the rotor, and how far; no steps where it did not.
    pushed: u32,
    travel: i64,
    /// How often the rotor was found turning by itself; pushes forward so far; whether this is the way back.
    waited: u32,
    pushes: u32,
    back: bool,
    /// Where the present motion began, and where the first push did; the way from there to the other end.
    from: Position,
    origin: Position,
    apart: i64,
    /// How far a voltage along d has moved the rotor; how far along d has moved it more than against d, at the far end.
    along: i64,
    across: i64,
    /// Farthest that the rotor went the wrong way; its speed when it is to be stopped, in 2⁻³² turns a step.
    farthest: i64,
    speed: i32,
    /// Averaged speed, in 2⁻³² turns a step.
    averaged: i32,
    /// How the rotor turned before the voltage, in 2⁻³² turns a step.
    coasting: i32,
    /// How far the voltage leans from its axis so that the current is along it, in 2⁻³² turns.
    lean: i32,
}

impl RotorCheck {
    /// Begins, with modulations in 2⁻³¹: what they rise by in a step, where they begin and end.
    pub const fn new(rise: i32, least: i32, most: i32) -> Self {
        Self {
            stage: Stage::Coast,
            axis: Axis::Forward,
            steps: 0,
            age: 0,
            modulation: 0,
            rise,
            least,
            most,
            strongest: 0,
            pushed: 0,
            travel: 0,
            waited: 0,
            pushes: 0,
            back: false,
            from: Position::from_bits(0),
            origin: Position::from_bits(0),
            apart: 0,
            along: 0,
            across: 0,
            farthest: 0,
            speed: 0,
            averaged: 0,
            coasting: 0,
            lean: 0,
        }
    }

    /// One step of the check on, with the phase currents in 2⁻¹⁵ of their full scale.
    // Not inlined, so that a board may place it where there is room.
    #[inline(never)]
    pub fn step(&mut self, config: &Config, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Step {
        self.steps += 1;
        self.age += 1;
        self.averaged += (rotor.speed() - self.averaged) >> control.arming.averages;
        if self.age > LONGEST * control.arming.longest_push {
            return Step::Done { step: 0, proven: false };
        }
        match (self.stage, self.axis.pushes()) {
            (Stage::Coast, _) => self.coast(control, rotor, config),
            (Stage::Press, true) => self.push(control, phases, rotor, config),
            (Stage::Press, false) => self.across(control, phases, rotor, config),
            (Stage::Oppose, _) => self.oppose(rotor, config),
            (Stage::Stop, _) => self.stop(control, phases, rotor, config),
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.steps = 0;
    }

    /// A voltage along an axis comes next, as soon as the rotor rests.
    fn then(&mut self, axis: Axis, config: &Config) -> Step {
        self.axis = axis;
        self.enter(Stage::Coast);
        Step::Output(no_voltage(config))
    }

    /// Measures how the rotor turns by itself, until it rests.
    fn coast(&mut self, control: &Control, rotor: &Tracker, config: &Config) -> Step {
        let window = control.arming.longest_push / 4;
        if self.steps == 1 {
            self.from = rotor.smoothed();
        } else if self.steps > window {
            let way = self.way(rotor);
            self.coasting = (way / i64::from(window.max(1))) as i32;
            // What friction does to a rotor that turns looks like a push the wrong way; the shorted windings stop it.
            if way.abs() <= MOVED {
                self.press(rotor);
            } else if self.waited < MOST_WAITED {
                self.waited += 1;
                self.enter(Stage::Coast);
            } else {
                return Step::Done { step: 0, proven: false };
            }
        }
        Step::Output(no_voltage(config))
    }

    /// The rotor rests: the voltage begins.
    fn press(&mut self, rotor: &Tracker) {
        self.from = rotor.smoothed();
        if self.axis.pushes() {
            if self.pushes == 0 {
                self.origin = self.from;
                (self.age, self.waited) = (0, 0);
            }
        } else if self.axis == Axis::Along && !self.back {
            self.apart = self.from.to_bits().wrapping_sub(self.origin.to_bits());
        }
        self.modulation = self.least;
        self.lean = 0;
        self.enter(Stage::Press);
    }

    /// Whether the voltage rises.
    pub fn presses(&self) -> bool {
        self.stage == Stage::Press
    }

    /// The dead time takes its share from each phase, which turns the current of a small voltage by up to 30°. The
    /// voltage leans to the other side until the current is along the axis.
    #[inline(never)]
    pub fn lean(&mut self, config: &Config, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Output {
        if largest(phases) >= control.arming.current / 4 {
            self.lean_towards(config, phases, rotor);
        }
        self.vector(self.axis, rotor, config)
    }

    fn lean_towards(&mut self, config: &Config, phases: [i32; 3], rotor: &Tracker) {
        let [a, b, c] = phases;
        /// √3 in 2⁻¹⁰.
        const SQRT_3: i32 = 1774;
        let beta = (b - c) * SQRT_3;
        let beta = if config.is_reversed() { -beta } else { beta };
        let current = AlphaBeta { alpha: (2 * a - b - c) << 10, beta };
        let current = Rotation::at(rotor.predicted(&config.tracking) + self.axis.angle()).park(current);
        // Less than a sixteenth is noise.
        if current.q.abs() > current.d.abs() / 16 {
            self.lean = (self.lean - current.q.signum() * LEANS).clamp(-LEANS_MOST, LEANS_MOST);
        }
    }

    /// Raises the voltage, while the current allows it.
    fn raise(&mut self, most: i32, control: &Control, phases: [i32; 3]) {
        if largest(phases) < control.arming.push {
            self.modulation = self.modulation.saturating_add(self.rise).min(most);
        }
    }

    /// How far the voltage has moved the rotor.
    fn moved(&self, rotor: &Tracker) -> i64 {
        self.way(rotor) - self.coasted()
    }

    /// How far it would have turned by itself.
    fn coasted(&self) -> i64 {
        i64::from(self.coasting) * i64::from(self.steps)
    }

    /// Way by which a motion that should not be is told from noise, that of the speed before included.
    fn wrong(&self) -> i64 {
        MOVED + self.coasted().abs() / 2
    }

    fn push(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        if self.averaged.unsigned_abs() <= control.arming.turning.unsigned_abs() {
            self.raise(self.most, control, phases);
        }
        let moved = if self.back { -self.moved(rotor) } else { self.moved(rotor) };
        let over = self.steps >= control.arming.longest_push;
        if moved >= FAR || over && moved >= MOVED {
            (self.pushed, self.travel, self.strongest) = (self.steps, moved, self.modulation);
            return self.begin_stop(rotor, config);
        }
        if moved <= -self.wrong() {
            self.pushed = self.steps;
            self.from = rotor.smoothed();
            self.farthest = 0;
            self.enter(Stage::Oppose);
            return self.voltage(self.axis.opposite(), rotor, config);
        }
        if over {
            self.pushed = 0;
            return self.then(Axis::Along, config);
        }
        self.voltage(self.axis, rotor, config)
    }

    fn across(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        self.raise(if self.pushed == 0 { self.most } else { self.strongest }, control, phases);
        let way = self.moved(rotor);
        if self.pushed == 0 {
            // The push did not move it.
            return if way.abs() > self.wrong() {
                Step::Failed(Fault::Commutation)
            } else if self.steps >= control.arming.longest_push {
                Step::Done { step: 0, proven: false }
            } else {
                self.voltage(self.axis, rotor, config)
            };
        }
        if self.steps < self.pushed && way.abs() < self.travel / 2 {
            return self.voltage(self.axis, rotor, config);
        }
        if self.axis == Axis::Along {
            self.along = way;
            return self.begin_stop(rotor, config);
        }
        let across = (self.along - way) / 2;
        let changed = if self.back { (across - self.across).abs() } else { 0 };
        if across.abs() > self.travel / 5 * 2 || changed > self.travel / 5 * 3 {
            return Step::Failed(Fault::Commutation);
        }
        if !self.back {
            self.across = across;
        }
        self.begin_stop(rotor, config)
    }

    fn begin_stop(&mut self, rotor: &Tracker, config: &Config) -> Step {
        self.speed = self.averaged;
        self.from = rotor.smoothed();
        self.enter(Stage::Stop);
        self.voltage(self.axis.opposite(), rotor, config)
    }

    /// The opposite voltage, until the rotor stands. A push that cannot be stopped has a wrong commutation.
    fn stop(&mut self, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Step {
        let (speed, before) = if self.speed < 0 { (-self.averaged, -self.speed) } else { (self.averaged, self.speed) };
        let far = self.way(rotor).abs() > if self.axis.pushes() { STOPPED } else { STOPPED_ACROSS };
        let late = self.steps > self.pushed;
        if far {
            return Step::Failed(Fault::Commutation);
        }
        if self.axis.pushes() {
            if late || speed > 2 * (before + control.arming.turning) {
                return Step::Failed(Fault::Commutation);
            }
            self.raise(self.most, control, phases);
        }
        // It stands by the time that the tracked speed says so.
        let (steps, lag) = (i64::from(self.steps), i64::from(control.arming.lag));
        let lag = steps < 2 * lag || i64::from(speed) * steps > i64::from(before - speed) * lag;
        let turns = before > control.arming.turning / 2 && lag;
        if turns && !late {
            return self.voltage(self.axis.opposite(), rotor, config);
        }
        self.next(config)
    }

    /// From the push to d, from d to its opposite, forward until the ends are far enough from each other, and back.
    fn next(&mut self, config: &Config) -> Step {
        match self.axis {
            Axis::Forward | Axis::Back => self.then(Axis::Along, config),
            Axis::Along => self.then(Axis::Against, config),
            Axis::Against if self.back => Step::Done { step: 0, proven: true },
            Axis::Against => {
                self.pushes += 1;
                self.back = self.apart.abs() >= APART || self.pushes >= MOST_PUSHES;
                self.then(if self.back { Axis::Back } else { Axis::Forward }, config)
            }
        }
    }

    /// With a wrong commutation the opposite voltage stops the rotor and turns it back, and it is found out close to
    /// rest. An outside torque, which made a rotor with the right one move the wrong way, is helped by it.
    fn oppose(&mut self, rotor: &Tracker, config: &Config) -> Step {
        let way = if self.back { -self.way(rotor) } else { self.way(rotor) };
        self.farthest = self.farthest.min(way);
        if way - self.farthest > MOVED / 6 || way < -STOPPED {
            return Step::Failed(Fault::Commutation);
        }
        if self.steps >= 4 * self.pushed {
            // Neither moves it much, as where the angle is wrong by a quarter of a turn.
            self.pushed = 0;
            return self.then(Axis::Along, config);
        }
        self.voltage(self.axis.opposite(), rotor, config)
    }

    fn way(&self, rotor: &Tracker) -> i64 {
        rotor.smoothed().to_bits().wrapping_sub(self.from.to_bits())
    }

    fn voltage(&self, axis: Axis, rotor: &Tracker, config: &Config) -> Step {
        Step::Output(self.vector(axis, rotor, config))
    }

    fn vector(&self, axis: Axis, rotor: &Tracker, config: &Config) -> Output {
        let lean = ElectricalAngle::from_bits(self.lean);
        turned(self.modulation, rotor.predicted(&config.tracking) + axis.angle() + lean, config.order(), config)
    }
}
