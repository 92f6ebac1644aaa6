//! Whether the rotor is too uneven to learn the sensors from, and when that is tried again.
//!
//! What looks like an uneven rotor may be one that was accelerated before its angle was known well, or sensors far from
//! their calibration, as after a cold night. So it takes some turns to doubt a rotor, of which no model comes,
//! and a doubt is no verdict for ever: after some turns, twice as many each time, the sensors are learnt on trial, from
//! wider variances. What the rotor leaves unexplained counts as noise throughout.

use super::Adapter;
use super::filter::{ANGLE, STATES, THIRD};

/// What parameters learnt of an uneven rotor may have bent the angle by, rad.
const BENT: f32 = 0.05;
/// What a rotor may leave unexplained, relative to the squared amplitude, for parameters to be learnt: 1 % RMS. It is the
/// mean of the sensors: magnets show in all of them. Sensors far from their calibration bend the angle that the motor is
/// controlled by, and a rotor that is shaken by that shows at times in one more than in the others.
const DOUBTFUL: f32 = 1e-4;
/// Electrical turns in doubt before the first trial.
const FIRST_WAIT: u16 = 32;
/// Doublings of that at most: 8192 turns.
const MOST_DOUBLINGS: u8 = 8;
/// Turns that leave a little too much unexplained, less those that do not, after which nothing is learnt; those that
/// leave more count for as many as they leave times too much. It is a mean over as many turns.
const UNEVEN_TURNS: u16 = 24;
/// Even turns before the first model: it takes some to see what is left unexplained.
const FIRST_TURNS: u16 = 8;
/// Variances of the parameters in a trial, over those at the start: twice the deviation.
const WIDER: f32 = 4.0;

/// Doubt in the rotor, and trials of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt {
    /// Whether nothing is learnt.
    pub exists: bool,
    /// Times that it came.
    times: u8,
    /// Turns left until a trial; else how long too much has been left unexplained: [`UNEVEN_TURNS`].
    turns: u16,
}

impl Doubt {
    /// None yet, but no certainty either.
    pub const START: Self = Self { exists: false, times: 0, turns: FIRST_TURNS };

    /// Whether it is there, or a trial goes on that has not come to a model.
    pub const fn is_open(&self) -> bool {
        self.times > 0 && self.turns > 0
    }

    fn begin(&mut self) {
        self.exists = true;
        self.turns = FIRST_WAIT << self.times;
        self.times = (self.times + 1).min(MOST_DOUBLINGS);
    }
}

impl Adapter {
    /// A turn was covered: whether it and those before left so little unexplained that a model can be made. After too
    /// many that did not, back to the calibration: it counts the turn, so it is asked once for each.
    #[inline(never)]
    pub(super) fn is_even(&mut self) -> bool {
        // Where nothing is learnt for the speed, nothing new is known: what a turn before left unexplained, as while it was
        // accelerated, counts once.
        if self.doubt.exists || !self.calibrated || self.fault.is_some() || self.is_too_fast() {
            return true;
        }
        // Once doubted, a rotor has to be clearly even.
        let in_doubtful = if self.doubt.times > 0 { 4.0 / DOUBTFUL } else { 1.0 / DOUBTFUL };
        let times = crate::float::whole_u16(self.mean(|sensor| sensor.unexplained) * in_doubtful);
        let turns = &mut self.doubt.turns;
        *turns = if times == 0 { turns.saturating_sub(1) } else { turns.saturating_add(times) };
        if *turns >= UNEVEN_TURNS {
            self.begin_doubt();
        }
        self.doubt.turns == 0
    }

    fn begin_doubt(&mut self) {
        self.doubt.begin();
        let state = &mut self.state;
        (state.third, state.offset, state.amplitude) = (0.0, [0.0; 3], [1.0; 3]);
        state.placement = core::array::from_fn(|k| self.sensors[k].sensor.placement);
        // They are not in question now: only then does a push settle, and is the load learnt again.
        self.spread_parameters(0.0);
        // They had bent the angle, and unevenness was taken for a load.
        self.covariance.inflate(ANGLE, BENT * BENT, f32::MAX);
        self.load = 0.0;
        // What was learnt before is taken back, by the next update: any model but the calibration's own has other
        // amplitudes.
        self.model_due = self.model.sensors[0].amplitude != self.sensors[0].sensor.amplitude;
    }

    /// A turn was followed: after enough of them, what is learnt is tried again.
    pub(super) fn wait_in_doubt(&mut self) {
        if !self.doubt.exists || !self.turns_well() {
            return;
        }
        self.doubt.turns -= 1;
        if self.doubt.turns > 0 {
            return;
        }
        (self.doubt.exists, self.doubt.turns) = (false, FIRST_TURNS);
        self.spread_parameters(WIDER);
    }

    /// The parameters' variances in multiples of those at the start.
    fn spread_parameters(&mut self, times: f32) {
        for state in THIRD..STATES {
            self.covariance.reset(state, times * self.start[state]);
        }
    }
}
