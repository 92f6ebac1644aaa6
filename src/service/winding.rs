//! How warm is the winding by its resistance? Asked of the currents and voltages that the drive notes.
//!
//! The voltage along the current, less the back-EMF's share, is that at the resistance; copper's rises by 0.39 % per kelvin
//! over that at 25 °C. What the resistance of the settings was measured with is the same board, so that the gains of its
//! amplifiers and its divider cancel, but for what they have drifted by since.
//!
//! Left out are measurements
//! - of a current below a third of the continuous one or a sixteenth of the amplifiers' full scale;
//! - in which the winding, cold, takes less than eight times the dead time's voltage, what is left of which after its
//!   compensation would look like resistance;
//! - in which the back-EMF, by a flux linkage that may be off by 15 %, is above an eighth of that voltage;
//! - of a current that has changed by more than an eighth since the one before, where the inductance takes a voltage. That
//!   does not ask whether it follows its reference: the voltage may not suffice for a winding that is hot.
//!
//! Wires and transistors do not rise as copper does in the motor: their share of the resistance is missing in the rise.

use crate::commutation::frames::Dq;
use crate::control::config::Copper;
use crate::telemetry::State;

/// Measurements that a mean reaches back by: 0.05 s at 1250 Hz.
const MEAN: f32 = 64.0;
/// Measurements between two results, and before the first.
const EVERY: u8 = 64;
/// Largest back-EMF as a share of the voltage at the cold resistance.
const LARGEST_EMF: f32 = 0.125;
/// Largest change of a current as a share of it.
const CHANGING: f32 = 0.125;

/// Means of what was measured.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Winding {
    /// Current of the measurement before.
    before: Dq,
    /// Voltage times current.
    power: f32,
    /// Square of the current.
    square: f32,
    /// Since the last result.
    count: u8,
    /// Rise of the resistance, of the cold one, when it was measured last.
    pub risen: Option<f32>,
}

impl Winding {
    /// Takes a measurement in, of a field-oriented commutation; the rise now and then, as the square of the current that
    /// makes it.
    pub fn look(&mut self, state: &State, speed: i32, copper: &Copper) -> Option<i32> {
        let of = |value: i32| value as f32;
        let (voltage, current) = (&state.voltage, &state.current);
        let square = of(current.d) * of(current.d) + of(current.q) * of(current.q);
        let least = copper.least.max(copper.least_per_bus * of(state.bus.into()));
        let emf = copper.flux * of(speed);
        let largest = LARGEST_EMF * copper.cold;
        let (d, q) = (of(current.d - self.before.d), of(current.q - self.before.q));
        self.before = *current;
        // Without a voltage nothing is controlled, as during the check at arming.
        let controlled = voltage.d != 0 || voltage.q != 0;
        let tells = copper.doubled > 0.0
            && controlled
            && square >= least * least
            && emf * emf <= largest * largest * square
            && d * d + q * q <= CHANGING * CHANGING * square;
        if !tells {
            return None;
        }
        let power = of(voltage.d) * of(current.d) + (of(voltage.q) - emf) * of(current.q);
        self.power += (power - self.power) / MEAN;
        self.square += (square - self.square) / MEAN;
        self.count += 1;
        if self.count < EVERY {
            return None;
        }
        self.count = 0;
        let risen = self.power / self.square / copper.cold - 1.0;
        self.risen = Some(risen);
        Some((risen * copper.doubled).clamp(0.0, copper.most) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::config::COPPER_PER_K;
    use crate::settings::{Control, GuardSettings, Settings};

    /// The default motor, of which 100 K are allowed, on 24 V.
    fn copper(resistance_ohm: f32) -> Copper {
        let guard = GuardSettings { max_winding_rise_k: 100.0, ..GuardSettings::default() };
        let control = Control { resistance_ohm, guard, ..Control::default() };
        let settings = Settings { control: Some(control), ..Settings::default() };
        settings.validate().unwrap().control.unwrap().overload.copper
    }

    /// A current along q through a resistance, and the back-EMF of an electrical speed.
    fn state(amperes: f32, resistance_ohm: f32, emf_v: f32) -> State {
        let volts = amperes * resistance_ohm + emf_v;
        let current = Dq { d: 0, q: (amperes / 8.25 * 32_768.0) as i32 };
        let voltage = Dq { d: 0, q: (volts / 36.3 * 32_768.0) as i32 };
        State { current, voltage, bus: (24.0 / 36.3 * 32_768.0) as u16, ..State::default() }
    }

    /// The last rise in so many measurements, K.
    fn measure(states: &[(State, i32)]) -> Option<f32> {
        let (copper, mut winding) = (copper(3.75), Winding::default());
        for (state, speed) in states.iter().cycle().take(200) {
            let _ = winding.look(state, *speed, &copper);
        }
        winding.risen.map(|risen| risen / COPPER_PER_K)
    }

    #[test]
    fn what_the_resistance_has_risen_by_is_told_as_a_square() {
        let (copper, mut winding) = (copper(3.75), Winding::default());
        let hot = state(-1.5, 3.75 * (1.0 + 80.0 * COPPER_PER_K), 0.0);
        let square = (0..200).find_map(|_| winding.look(&hot, 0, &copper)).unwrap();
        // 1.25 times the fault are told at most.
        let share = square as f32 * 1.25 / copper.most;
        assert!((share - 0.8).abs() < 0.01, "{share}");
        assert!((winding.risen.unwrap() / COPPER_PER_K - 80.0).abs() < 1.0);
    }

    #[test]
    fn the_known_share_of_the_back_emf_is_taken_off_whatever_the_direction() {
        // 10 Hz electrical: 0.314 V.
        let speed = (10.0 / 40e3 * 4_294_967_296.0) as i32;
        for (amperes, speed, emf_v) in [(1.5, speed, 0.314), (1.5, -speed, -0.314), (-1.5, speed, 0.314)] {
            let rise_k = measure(&[(state(amperes, 3.75, emf_v), speed)]).unwrap();
            assert!(rise_k.abs() < 1.0, "{rise_k}");
        }
    }

    #[test]
    fn what_would_mislead_is_left_out() {
        let speed = (30.0 / 40e3 * 4_294_967_296.0) as i32;
        let still = |amperes| (state(amperes, 5.0, 0.0), 0);
        // The dead time's voltage is an eighth of the winding's at 1.02 A.
        assert_eq!(measure(&[still(0.95)]), None);
        assert!(measure(&[still(1.1)]).is_some());
        // 0.94 V of back-EMF are a sixth of the winding's.
        assert_eq!(measure(&[(state(1.5, 5.0, 0.94), speed)]), None);
        // A current that changes.
        assert_eq!(measure(&[still(1.5), still(2.0)]), None);
        // Without a voltage nothing is controlled; without the setting nothing is measured.
        assert_eq!(measure(&[(state(1.5, 0.0, 0.0), 0)]), None);
        let (off, mut winding) = (Copper { doubled: 0.0, ..copper(3.75) }, Winding::default());
        assert!((0..200).all(|_| winding.look(&state(1.5, 5.0, 0.0), 0, &off).is_none()) && winding.risen.is_none());
    }

    #[test]
    fn a_motor_of_little_resistance_is_not_measured() {
        // 1.2 Ω: the largest current on the lowest bus voltage would do, but not on 24 V.
        let (copper, mut winding) = (copper(1.2), Winding::default());
        assert!((0..200).all(|_| winding.look(&state(3.0, 1.6, 0.0), 0, &copper).is_none()));
    }
}
