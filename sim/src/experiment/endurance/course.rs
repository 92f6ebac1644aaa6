//! What a rotor is made to do over hours: pieces of motion of every kind, one after the other, drawn at random.

use plant::Noise;
use std::f64::consts::TAU;

/// Slowest and fastest speed, Hz electrical: at the fastest, a sample in less than a fifth of a turn.
const SPEEDS_HZ: [f64; 2] = [0.3, 180.0];
/// How long a piece lasts, s.
const LASTING_S: [f64; 2] = [0.3, 30.0];
/// How fast a set speed is reached, Hz/s.
const SLEWS_HZ_S: [f64; 2] = [10.0, 3000.0];
/// How often a sway turns back, Hz, and how fast it is at most, Hz electrical.
const SWAYS_HZ: [f64; 2] = [0.2, 5.0];
const SWAYING_HZ: [f64; 2] = [1.0, 40.0];
/// Gain of the speed control, 1/s.
const CONTROL_1_S: f64 = 30.0;
/// Between two pushes, s; how long one lasts, s, and how strong it is at most, rad/s² electrical.
const PUSHES_S: f64 = 5.0;
const PUSH_S: [f64; 2] = [0.02, 0.3];
const PUSH_RAD_S2: f64 = 1200.0;

/// A piece of motion.
#[derive(Clone, Copy, Debug)]
enum Piece {
    /// To a speed, Hz, and on at it; zero: at rest.
    Hold(f64),
    /// To and fro, so fast at most, Hz, and so often, Hz.
    Sway { far_hz: f64, often_hz: f64 },
    /// Without a torque.
    Coast,
}

/// What turns the rotor at a moment, as accelerations, rad/s² electrical.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drive {
    /// By the motor, of which the filter is told.
    pub told: f64,
    /// By a hand, by friction, by a load.
    pub untold: f64,
}

/// The course of a rotor's life.
#[derive(Clone, Debug)]
pub struct Course {
    random: Noise,
    piece: Piece,
    by_hand: bool,
    began_s: f64,
    ends_s: f64,
    slew_hz_s: f64,
    /// The speed that is set, Hz.
    set_hz: f64,
    /// A push, and until when, s.
    push: f64,
    pushed_s: f64,
}

/// Evenly in the logarithm.
pub fn between(random: &mut Noise, [least, most]: [f64; 2]) -> f64 {
    least * (most / least).powf(0.5 + 0.5 * random.uniform())
}

impl Course {
    /// At rest.
    pub fn new(seed: u64) -> Self {
        Self {
            random: Noise::new(seed ^ 0xC0_0453),
            piece: Piece::Hold(0.0),
            by_hand: false,
            began_s: 0.0,
            ends_s: 0.0,
            slew_hz_s: 1.0,
            set_hz: 0.0,
            push: 0.0,
            pushed_s: 0.0,
        }
    }

    /// To a speed, Hz, and on at it for good.
    pub fn hold(&mut self, hz: f64) {
        (self.piece, self.by_hand, self.ends_s) = (Piece::Hold(hz), false, f64::INFINITY);
    }

    /// At a time, s, and a speed, rad/s, both of the rotor; `period_s` since the last.
    pub fn advance(&mut self, time_s: f64, speed_rad_s: f64, period_s: f64) -> Drive {
        if time_s >= self.ends_s {
            self.begin(time_s, speed_rad_s);
        }
        if time_s >= self.pushed_s {
            self.push = 0.0;
            if 0.5 * (1.0 + self.random.uniform()) < period_s / PUSHES_S {
                self.push = PUSH_RAD_S2 * self.random.uniform();
                self.pushed_s = time_s + between(&mut self.random, PUSH_S);
            }
        }
        let wanted = self.wanted(time_s, period_s).map_or(0.0, |hz| CONTROL_1_S * (TAU * hz - speed_rad_s));
        let (told, untold) = if self.by_hand { (0.0, wanted) } else { (wanted, 0.0) };
        Drive { told, untold: untold + self.push }
    }

    /// The speed that is wanted, Hz; none while it coasts.
    fn wanted(&mut self, time_s: f64, period_s: f64) -> Option<f64> {
        match self.piece {
            Piece::Hold(hz) => {
                let most = self.slew_hz_s * period_s;
                self.set_hz += (hz - self.set_hz).clamp(-most, most);
                Some(self.set_hz)
            }
            Piece::Sway { far_hz, often_hz } => Some(far_hz * (TAU * often_hz * (time_s - self.began_s)).sin()),
            Piece::Coast => None,
        }
    }

    fn begin(&mut self, time_s: f64, speed_rad_s: f64) {
        let random = &mut self.random;
        let way = random.uniform().signum();
        self.piece = match random.uniform() {
            ..-0.7 => Piece::Hold(0.0),
            ..0.4 => Piece::Hold(way * between(random, SPEEDS_HZ)),
            ..0.8 => Piece::Sway { far_hz: way * between(random, SWAYING_HZ), often_hz: between(random, SWAYS_HZ) },
            _ => Piece::Coast,
        };
        self.by_hand = random.uniform() > 0.6;
        self.slew_hz_s = between(random, SLEWS_HZ_S);
        self.set_hz = speed_rad_s / TAU;
        self.began_s = time_s;
        self.ends_s = time_s + between(random, LASTING_S);
    }
}
