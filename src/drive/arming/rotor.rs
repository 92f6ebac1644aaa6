//! The second half of the check at arming: does the rotor turn as it is pushed?
//!
//! 1. A push: a voltage along q of the rotor, raised until the rotor turns, until it has moved by [`FAR`]. Where it moved
//!    as it should, the opposite voltage stops it. Where it moved the other way, the opposite voltage is tried; if that
//!    moves it the other way as well, motor wires, Halls and calibration do not belong together.
//! 2. A field that stands where the rotor's is. It holds a sound rotor where it has come to rest, and cogging cannot turn
//!    it away. Where the angle is wrong, it pulls the rotor along, which swings by up to twice the error: beyond [`HELD`],
//!    and not slowing down, the angle is wrong by more than some 13°.
//! 3. The field is turned back, slowly, and forward again, and the rotor has to follow it. Where two wires are swapped, the
//!    angle counts the wrong way, and it goes forward at first, or goes on falling back.
//!
//!    The field gets twice as strong as the push meanwhile, so that cogging, which may be as strong as that, is weak beside it.
//!
//! Cogging may carry a sound rotor on where it is to stop or to be held. So one that has not gone far is left to come to rest,
//! held once more, and passes if it follows the field then.
//!
//! A load behind a coupling or with play makes the rotor swing. It is pushed when it has come to rest; after the stop a
//! voltage against its motion brakes the swing; and the field that holds it then is as strong as it may be.

use super::{Step, largest, no_voltage, turned};
use crate::angle::{ElectricalAngle, Position};
use crate::board::Output;
use crate::commutation::frames::{AlphaBeta, Rotation};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::fault::Fault;
use crate::hall::track::Tracker;

/// Way by which the push is told from noise: 3° electrical, in 2⁻²⁶ turns as all ways are.
const MOVED: i32 = 559_241;
/// Way after which the push is over: 12°.
const FAR: i32 = 4 * MOVED;
/// Longest way in which a sound rotor is stopped: 27°.
const STOPPED: i32 = 9 * MOVED;
/// Farthest that a field along its own moves a sound rotor: 21°; twice as far where it slows down.
const HELD: i32 = 7 * MOVED;
/// Way in which no field along its own pulls a sound rotor as fast as the push did: 6°.
const PULLED: i32 = 2 * MOVED;
/// Way against the field that is turned back which no sound rotor goes: 9°.
const AGAINST: i32 = 3 * MOVED;
/// The field is turned back by so much at most, 75°, in 2⁻³² turns; a sound rotor has followed it before.
const TURNED: u32 = 894_784_853;
/// All of it takes so many longest pushes at most.
const LONGEST: u32 = 8;
/// How often a rotor may be found turning by itself before it is not pushed at all.
const MOST_WAITED: u32 = 40;
/// Farthest that the rotor is left to swing after the stop: 6°.
const SETTLES: i32 = 2 * MOVED;
/// How often one that was stopped may be found swinging before the field holds it.
const MOST_SETTLED: u32 = 6;

/// The voltage leans by so much a step, 0.3°, in 2⁻³² turns, and by 45° at most.
const LEANS: i32 = 3_579_139;
const LEANS_MOST: i32 = 150 * LEANS;

/// Which way the rotor is pushed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    Forward,
    Back,
}

impl Axis {
    fn angle(self) -> ElectricalAngle {
        match self {
            Self::Forward => ElectricalAngle::QUARTER,
            Self::Back => -ElectricalAngle::QUARTER,
        }
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
    /// No voltage until the rotor rests: a load behind a coupling swings it yet.
    Settle,
    /// A field that stands where the rotor's is holds it.
    Hold,
    /// The field turns back.
    Turn,
}

/// What a stage comes to in a step.
enum Act {
    /// The voltage along an axis, or along the field that holds the rotor.
    Push(Axis),
    /// No voltage.
    Free,
    /// The commutation is wrong.
    Fail,
    /// It is over.
    End { proven: bool },
}

/// The check of the rotor and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotorCheck {
    stage: Stage,
    /// Steps of this stage, and of the check.
    steps: u32,
    age: u32,
    /// Modulation, what it rises by in a step, where it begins and ends, in 2⁻³¹; and where the push ended.
    modulation: i32,
    rise: i32,
    least: i32,
    most: i32,
    strongest: i32,
    /// Steps in which the push moved the rotor; none where it did not. Those before the rotor began to move.
    pushed: u32,
    rested: u32,
    /// How often the rotor was found turning by itself.
    waited: u32,
    /// Where the push began, and where the present motion did.
    began: Position,
    from: Position,
    /// Where the field stands that holds the rotor, how far it is still to be turned back, and by how much in a step, in
    /// 2⁻³² turns.
    anchor: ElectricalAngle,
    left: u32,
    rate: u32,
    /// Whether the rotor has followed the field that turned back, and forward again.
    has_followed: bool,
    proven: bool,
    /// Whether the rotor was not stopped or not held once: it passes only if it follows the field that turns.
    suspected: bool,
    /// How far the push had moved it in three quarters of its longest time; farthest that the rotor went the wrong way; while it
    /// is held, how far it had come in half the time of the push.
    farthest: i32,
    /// Its speed when it is to be stopped, and its fastest while it is held, in 2⁻³² turns a control step.
    speed: i32,
    /// Averaged speed, in 2⁻³² turns a step.
    averaged: i32,
    /// How the rotor turned before the voltage, in 2⁻²⁶ turns a step.
    coasting: i32,
    /// How far the voltage leans from its axis so that the current is along it, in 2⁻³² turns.
    lean: i32,
}

impl RotorCheck {
    /// Begins, with modulations in 2⁻³¹: what they rise by in a step, where they begin and end.
    pub const fn new(rise: i32, least: i32, most: i32) -> Self {
        Self {
            stage: Stage::Coast,
            steps: 0,
            age: 0,
            modulation: 0,
            rise,
            least,
            most,
            strongest: 0,
            pushed: 0,
            rested: 0,
            waited: 0,
            began: Position::from_bits(0),
            from: Position::from_bits(0),
            anchor: ElectricalAngle::ZERO,
            left: 0,
            rate: 0,
            has_followed: false,
            proven: false,
            suspected: false,
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
        // Waiting for rest takes as long as it takes.
        self.age += u32::from(self.stage != Stage::Settle);
        self.averaged += (rotor.speed() - self.averaged) >> control.arming.averages;
        let way = self.way(rotor);
        let act = match self.stage {
            _ if self.age > LONGEST * u32::from(control.arming.longest_push) => Self::give_up(),
            Stage::Coast => self.coast(way, control, rotor),
            Stage::Press => self.push(way, control, phases, rotor, config),
            Stage::Oppose => self.oppose(way, rotor, config),
            Stage::Stop => self.stop(way, control, phases, rotor),
            Stage::Settle => self.settle(way, control, phases, rotor, config),
            Stage::Hold => self.hold(way, control, phases, rotor),
            Stage::Turn => self.turn(way, control, phases, rotor, config),
        };
        match act {
            Act::Push(axis) => Step::Output(self.vector(self.direction(axis, rotor, config), config)),
            // Shorted, the back-EMF of strong magnets drives more than the motor is to carry.
            Act::Free if largest(&phases) > control.max_current => Step::Output(Output::OFF),
            Act::Free => Step::Output(no_voltage(config)),
            Act::End { proven } if proven || !self.suspected => Step::Done { step: 0, proven },
            Act::End { .. } | Act::Fail => Step::Failed(Fault::Commutation),
        }
    }

    /// After a failure: whether the rotor is to be held once more, because cogging may have carried it on. Not where it has gone
    /// far from where it was pushed, or moved against the push, and not twice.
    #[cfg_attr(not(feature = "small"), inline(never))]
    pub fn begin_again(&mut self, control: &Control, rotor: &Tracker) -> bool {
        let carried = matches!(self.stage, Stage::Stop | Stage::Hold) && self.pushed > 0;
        self.from = self.began;
        let near = self.way(rotor).unsigned_abs() <= control.arming.carried;
        (self.age, self.waited) = (0, 0);
        self.enter(Stage::Settle);
        let again = carried && near && !self.suspected;
        self.suspected = true;
        again
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.steps = 0;
    }

    /// Measures how the rotor turns by itself, until it rests.
    fn coast(&mut self, way: i32, control: &Control, rotor: &Tracker) -> Act {
        if self.is_watched(way, control, rotor) {
            let window = u32::from(control.arming.longest_push) / 2;
            self.coasting = way / window.max(1) as i32;
            // What friction or cogging does to a rotor that turns looks like a push the wrong way; the shorted windings
            // stop it.
            if self.rests(control) {
                self.press(rotor);
            } else if self.waited < MOST_WAITED {
                self.waited += 1;
                self.enter(Stage::Coast);
            } else {
                return Self::give_up();
            }
        }
        Act::Free
    }

    /// Watches the rotor; whether it has done so for long enough.
    fn is_watched(&mut self, way: i32, control: &Control, rotor: &Tracker) -> bool {
        if self.steps == 1 {
            self.from = rotor.smoothed();
            self.farthest = 0;
        } else {
            self.farthest = self.farthest.max(way.abs());
        }
        self.steps > u32::from(control.arming.longest_push) / 2
    }

    /// Whether the rotor that was watched rests; one that swings comes back to where it was.
    fn rests(&self, control: &Control) -> bool {
        self.farthest <= MOVED && self.averaged.unsigned_abs() <= control.arming.turning.unsigned_abs() / 2
    }

    /// A voltage against the motion brakes what still swings or drags the rotor on. Where that takes it far, the field is to
    /// hold it. One that is suspected is left to come to rest: with a wrong angle, the voltage would drive it.
    fn settle(&mut self, way: i32, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Act {
        let (speed, full) = (self.averaged.saturating_abs(), control.arming.turning);
        let slow = speed < full / 4;
        let watched = self.is_watched(way, control, rotor);
        if self.proven {
            if slow && self.steps > u32::from(control.arming.longest_push) / 8 || self.waited >= MOST_SETTLED {
                return Act::End { proven: true };
            }
        } else {
            let far =
                !self.suspected && (rotor.angle() - self.anchor).to_bits().unsigned_abs() >> 6 > SETTLES.unsigned_abs();
            if far || watched && (self.rests(control) || self.waited >= MOST_SETTLED) {
                return self.begin_hold(self.least, rotor, config);
            }
        }
        if watched {
            self.waited += 1;
            self.enter(Stage::Settle);
        }
        if slow || self.suspected && !self.proven {
            return Act::Free;
        }
        // The back-EMF adds to what brakes.
        if largest(&phases) > i32::from(control.arming.push) {
            self.strongest -= (self.strongest - self.least) / 4;
        }
        self.modulation = if speed < full { self.strongest / 2 + self.least / 2 } else { self.strongest };
        Act::Push(if self.averaged > 0 { Axis::Back } else { Axis::Forward })
    }

    /// It takes too long, or the rotor does not rest.
    const fn give_up() -> Act {
        Act::End { proven: false }
    }

    /// The rotor rests: the voltage begins.
    fn press(&mut self, rotor: &Tracker) {
        self.from = rotor.smoothed();
        self.began = self.from;
        (self.age, self.waited) = (0, 0);
        self.modulation = self.least;
        self.lean = 0;
        self.enter(Stage::Press);
    }

    /// Whether the voltage rises.
    pub fn presses(&self) -> bool {
        matches!(self.stage, Stage::Press | Stage::Hold | Stage::Turn)
    }

    /// The dead time takes its share from each phase, which turns the current of a small voltage by up to 30°. The
    /// voltage leans to the other side until the current is along the axis.
    #[inline(never)]
    pub fn lean(&mut self, config: &Config, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Output {
        if largest(&phases) >= i32::from(control.arming.current) / 4 {
            self.lean_towards(config, phases, rotor);
        }
        self.vector(self.direction(Axis::Forward, rotor, config), config)
    }

    fn lean_towards(&mut self, config: &Config, phases: [i32; 3], rotor: &Tracker) {
        let [a, b, c] = phases;
        /// √3 in 2⁻¹⁰.
        const SQRT_3: i32 = 1774;
        let beta = (b - c) * SQRT_3;
        let beta = if config.is_reversed() { -beta } else { beta };
        let current = AlphaBeta { alpha: (2 * a - b - c) << 10, beta };
        let current = Rotation::at(self.direction(Axis::Forward, rotor, config)).park(current);
        // Less than a sixteenth is noise.
        if current.q.abs() > current.d.abs() / 16 {
            self.lean = (self.lean - current.q.signum() * LEANS).clamp(-LEANS_MOST, LEANS_MOST);
        }
    }

    /// Raises the voltage, while the current allows it.
    #[cfg_attr(feature = "small", inline(never))]
    fn raise(&mut self, most: i32, control: &Control, phases: [i32; 3]) {
        if largest(&phases) < i32::from(control.arming.push) {
            self.modulation = self.modulation.saturating_add(self.rise).min(most);
        }
    }

    /// How far the voltage has moved the rotor.
    fn moved(&self, way: i32) -> i32 {
        way - self.coasted()
    }

    /// How far it would have turned by itself.
    fn coasted(&self) -> i32 {
        self.coasting.wrapping_mul(self.steps as i32)
    }

    /// Whether it has gone no farther than it would by itself, or than a field along its own holds it back.
    fn coasts(&self, way: i32) -> bool {
        let coasted = self.coasted();
        let most = coasted + coasted / 2;
        (most.min(0) - MOVED..=most.max(0) + MOVED).contains(&way)
    }

    /// Way by which a motion that should not be is told from noise, that of the speed before included.
    fn wrong(&self) -> i32 {
        MOVED + self.coasted().abs() / 2
    }

    fn push(&mut self, way: i32, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Act {
        if self.averaged.unsigned_abs() <= control.arming.turning.unsigned_abs() {
            self.raise(self.most, control, phases);
        }
        let moved = self.moved(way);
        if moved < MOVED {
            self.rested = self.steps;
        }
        let longest = u32::from(control.arming.longest_push);
        if self.steps == longest / 4 * 3 {
            self.farthest = moved;
        }
        let over = self.steps >= longest;
        if moved >= FAR || over && moved >= MOVED {
            (self.pushed, self.strongest) = (self.steps, self.modulation);
            return self.begin_stop(rotor);
        }
        if moved <= -self.wrong() {
            self.pushed = self.steps;
            self.from = rotor.smoothed();
            self.farthest = 0;
            self.enter(Stage::Oppose);
            return Act::Push(Axis::Back);
        }
        if over {
            self.pushed = 0;
            // A heavy rotor rolls on with what little speed the push has given it.
            self.coasting += (moved - self.farthest).max(0) / (longest / 4).max(1) as i32;
            return self.begin_hold(self.least, rotor, config);
        }
        Act::Push(Axis::Forward)
    }

    /// The field that stands where the rotor's is, and how strong it is at first.
    fn begin_hold(&mut self, modulation: i32, rotor: &Tracker, config: &Config) -> Act {
        self.from = rotor.smoothed();
        self.anchor = rotor.predicted(&config.tracking);
        (self.modulation, self.lean) = (modulation, 0);
        self.enter(Stage::Hold);
        Act::Free
    }

    /// A sound rotor stays where it is, and where the angle is wrong, it is pulled away.
    fn hold(&mut self, way: i32, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Act {
        // The spring of a load that swings is to be weak beside the field.
        let swings = self.waited > 0 || self.suspected;
        self.raise(if self.pushed == 0 || swings { self.most } else { self.strongest }, control, phases);
        if self.pushed == 0 {
            // The push did not move it.
            return if !self.coasts(way) {
                Act::Fail
            } else if self.steps >= u32::from(control.arming.longest_push) {
                Act::End { proven: false }
            } else {
                Act::Push(Axis::Forward)
            };
        }
        let speed = self.averaged.saturating_abs();
        self.speed = if self.steps <= 2 * u32::from(control.arming.lag) { speed } else { self.speed.max(speed) };
        let far = way.abs();
        // What the rotor still turned with, the field slows down; a wrong one makes it faster.
        let faster = speed > (self.speed / 8 * 7).max(control.arming.turning);
        // Forward, and nearly as fast as by the push itself, it is pulled on by a third of that force and more. Back, cogging
        // may pull as much. One that only goes on with the speed that the stop has left it does not gain: by the time of
        // the push it is twice as far as by half of it, one that is pulled four times and more.
        if self.steps == self.pushed / 2 {
            self.farthest = way;
        }
        let gains = i64::from(way) * i64::from(self.pushed) > i64::from(3 * self.farthest) * i64::from(self.steps);
        let soon = |least, quarters| way > least && 4 * self.steps < quarters * self.pushed;
        let at_once = self.steps > self.pushed / 2 && gains && (soon(PULLED, 5) || soon(FAR, 7));
        if far > 2 * HELD || far > HELD && (faster || self.suspected) || faster && at_once {
            return Act::Fail;
        }
        // One that it pulls away goes on until it is too far; a sound one swings and is let go where it stands. An angle
        // that is off by 30° moves it as far in twice the time of the push as the push did.
        let turns = speed > control.arming.turning / 4;
        if self.steps < 2 * self.pushed || turns && self.steps < 8 * self.pushed {
            return Act::Push(Axis::Forward);
        }
        self.begin_turn(rotor)
    }

    /// The field turns back, and forward again, as far as it has to for a rotor that cogging holds, in four times the time
    /// of the push.
    fn begin_turn(&mut self, rotor: &Tracker) -> Act {
        self.from = rotor.smoothed();
        self.left = TURNED;
        self.rate = TURNED / (4 * self.pushed).max(1);
        self.enter(Stage::Turn);
        Act::Push(Axis::Forward)
    }

    /// A sound rotor follows the field both ways. One whose angle counts the wrong way follows the other way. Where it stood
    /// against the field, it falls away from it, back at first, and goes on when the field turns forward.
    fn turn(&mut self, way: i32, control: &Control, phases: [i32; 3], rotor: &Tracker, config: &Config) -> Act {
        // Cogging, which may be as strong as the push that has turned the rotor, is to be weak beside the field.
        self.raise(self.strongest.saturating_mul(2).max(self.modulation).min(self.most), control, phases);
        if way > AGAINST && !self.has_followed || way < -2 * HELD {
            return Act::Fail;
        }
        if way > FAR {
            self.proven = true;
            // What has turned it may brake it.
            self.strongest = self.modulation;
            self.waited = 0;
            return self.begin_settle(rotor);
        }
        if way < -FAR && !self.has_followed {
            self.has_followed = true;
            self.anchor = rotor.predicted(&config.tracking);
            return self.begin_turn(rotor);
        }
        if self.steps > 6 * self.pushed {
            return Act::End { proven: false };
        }
        let by = self.rate.min(self.left);
        self.left -= by;
        let by = ElectricalAngle::from_bits(by as i32);
        self.anchor += if self.has_followed { by } else { -by };
        Act::Push(Axis::Forward)
    }

    fn begin_stop(&mut self, rotor: &Tracker) -> Act {
        self.speed = self.averaged;
        self.from = rotor.smoothed();
        self.enter(Stage::Stop);
        Act::Push(Axis::Back)
    }

    /// The opposite voltage, until the rotor stands. A push that cannot be stopped has a wrong commutation.
    fn stop(&mut self, way: i32, control: &Control, phases: [i32; 3], rotor: &Tracker) -> Act {
        let (speed, before) = if self.speed < 0 { (-self.averaged, -self.speed) } else { (self.averaged, self.speed) };
        let halfway = self.steps > self.pushed / 2;
        // To three quarters in half the time of the push, to half in all of it, but for what cogging and the noise of the speed
        // make of a slow one.
        let (steps, pushed) = (i64::from(self.steps), i64::from(self.pushed));
        let slows =
            i64::from(speed - control.arming.turning / 8 * 5) * 2 * pushed <= i64::from(before) * (2 * pushed - steps);
        let late = self.steps > self.pushed || halfway && !slows;
        if late || way.abs() > STOPPED || speed > 2 * (before + control.arming.turning) {
            return Act::Fail;
        }
        if halfway {
            self.raise(self.most, control, phases);
        }
        // The back-EMF adds to what brakes: that of strong magnets was an over-current.
        if largest(&phases) > control.max_current {
            self.modulation -= (self.modulation - self.least) / 8;
        }
        // It stands by the time that the tracked speed says so, but not at once: the field of the current that turns round
        // reaches the Halls, and looks like a motion of the rotor.
        let lag = i64::from(control.arming.lag);
        let earliest = (2 * lag).max((pushed - i64::from(self.rested)) / 4);
        let lag = steps < earliest || i64::from(speed) * steps > i64::from(before - speed) * lag;
        let turns = before > control.arming.turning / 2 && lag;
        if turns {
            return Act::Push(Axis::Back);
        }
        self.begin_settle(rotor)
    }

    fn begin_settle(&mut self, rotor: &Tracker) -> Act {
        self.anchor = rotor.angle();
        self.enter(Stage::Settle);
        Act::Free
    }

    /// With a wrong commutation the opposite voltage stops the rotor and turns it back, and it is found out close to
    /// rest. An outside torque, which made a rotor with the right one move the wrong way, is helped by it.
    fn oppose(&mut self, way: i32, rotor: &Tracker, config: &Config) -> Act {
        self.farthest = self.farthest.min(way);
        if way - self.farthest > MOVED / 6 || way < -STOPPED {
            return Act::Fail;
        }
        if self.steps >= 4 * self.pushed {
            // Neither moves it much, as where the angle is wrong by a quarter of a turn.
            self.pushed = 0;
            return self.begin_hold(self.least, rotor, config);
        }
        Act::Push(Axis::Back)
    }

    /// How far the rotor is from where the present motion began.
    fn way(&self, rotor: &Tracker) -> i32 {
        (rotor.smoothed().to_bits().wrapping_sub(self.from.to_bits()) >> 6) as i32
    }

    /// Where the voltage is to point.
    fn direction(&self, axis: Axis, rotor: &Tracker, config: &Config) -> ElectricalAngle {
        match self.stage {
            Stage::Hold | Stage::Turn => self.anchor,
            _ => rotor.predicted(&config.tracking) + axis.angle(),
        }
    }

    fn vector(&self, direction: ElectricalAngle, config: &Config) -> Output {
        turned(self.modulation, direction + ElectricalAngle::from_bits(self.lean), config.order(), config)
    }
}
