//! Amplifiers at shunts below the lower transistors: they show a phase's current only while its lower transistor
//! conducts for as long as sampling takes, half of it before the valley and half after. Otherwise anything, and its edge
//! falls into the time in which the others are sampled.

use hallservo::hall::Codes;
use hallservo::settings::Settings;

/// What an edge disturbs the other phases' samples by at most, in codes.
const DISTURBED: i32 = 40;

/// What the timer made of the last two outputs: one ends in this valley, the other begins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shunts {
    /// Time from a gate's edge to the valley that sampling takes, dead time included, in counts of the timer.
    least: f64,
    /// Times from the edges to the valley in counts.
    recent: [[f64; 3]; 2],
    random: u32,
}

impl Shunts {
    pub fn new(settings: &Settings) -> Self {
        let Settings { sampling_window_s, dead_time_s, timer_hz, .. } = *settings;
        let least = 0.5 * f64::from(sampling_window_s + dead_time_s) * f64::from(timer_hz);
        Self { least: least - 1e-3, recent: [[f64::INFINITY; 3]; 2], random: 1 }
    }

    /// The next period's compare values.
    pub fn advance(&mut self, compare: [u16; 3], period: u16) {
        self.recent = [self.recent[1], compare.map(|compare| f64::from(period) - f64::from(compare))];
    }

    /// Of what is not shown any code takes the place, and what is shown beside it is disturbed.
    pub fn show(&mut self, currents: Codes) -> Codes {
        let shown = [0, 1, 2].map(|phase| self.recent.iter().all(|low: &[f64; 3]| low[phase] >= self.least));
        if shown == [true; 3] {
            return currents;
        }
        core::array::from_fn(|phase| {
            let any = i32::from(self.any_code());
            let disturbed = i32::from(currents[phase]) + any % (2 * DISTURBED + 1) - DISTURBED;
            if shown[phase] { disturbed.clamp(0, 4095) as u16 } else { any as u16 }
        })
    }

    fn any_code(&mut self) -> u16 {
        self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.random >> 20) as u16
    }
}
