//! Whether the sensors agree with each other, whatever the rotor has done. A prediction may be wrong because something turned
//! the rotor of which the filter was not told; two sensors tell the angle without any prediction.

use super::Adapter;
use super::acquire::angle_of_signals;
use super::filter::{State, radians};
use super::isolate::MOST_OF_A_ROTOR;
use crate::hall::{Channel, Codes};

impl Adapter {
    /// Whether a sensor shows what it should at the angle that the other two show, as far as any rotor does.
    #[cold]
    pub(super) fn agrees_with_the_others(&self, sensor: usize, codes: &Codes) -> bool {
        self.fits(sensor, &self.seen_by_others(Channel(sensor as u8), codes), codes)
    }

    /// Whether all sensors in use show what they should at some angle. Of three, two tell it: all of what is wrong with one
    /// shows in a third then, and a third of it in each where all three tell it.
    #[cold]
    pub(super) fn agree(&self, codes: &Codes) -> bool {
        let state = self.seen_by_others(self.suspicions.lost.unwrap_or(Channel(2)), codes);
        self.sensors_in_use().all(|k| self.fits(k, &state, codes))
    }

    /// Whether a sensor shows what it should in a state.
    fn fits(&self, sensor: usize, state: &State, codes: &Codes) -> bool {
        self.sensors[sensor].measure(sensor, state, codes[sensor], 0.0).innovation.abs() < MOST_OF_A_ROTOR
    }

    /// The state at the angle that the others than this sensor show.
    fn seen_by_others(&self, third: Channel, codes: &Codes) -> State {
        let without: [bool; 3] = core::array::from_fn(|k| third == Channel(k as u8));
        let signals: [f32; 3] = core::array::from_fn(|k| self.sensors[k].signal(f32::from(codes[k])));
        let mut state = self.state;
        state.angle = angle_of_signals(&state, &signals, &without);
        // That was of sinusoids: their harmonics turn it on a little.
        let (mut along, mut square) = (0.0, f32::MIN_POSITIVE);
        for k in (0..3).filter(|&k| !without[k]) {
            let m = self.sensors[k].measure(k, &state, codes[k], 0.0);
            along += m.angle * m.innovation;
            square += m.angle * m.angle;
        }
        state.angle += radians(along / square);
        state
    }
}
