//! What the supply gives and takes back.
//!
//! A current −q that brakes returns the power 1.5 (e q − R q²) of the back-EMF e. What the supply does not take is burnt
//! in the windings by a current along d, which makes no torque: 1.5 (e q − R (q² + d²)) is what goes back. The current
//! along d comes first, and the braking current follows it as far as it has room, so that nothing is returned on the
//! way either. Both together stay within 1.05 of the largest current (see [`beside`]), so a fast motor of a low
//! resistance brakes with q = I²R/e only. Where d is not controlled, with local feedback, the bus voltage limits the braking: see [`Supply::room_for`].
//!
//! What the settings of the motor do not tell is left to the bus voltage: towards `over_voltage_v`, less and less brakes.

use super::beside;
use crate::control::Window;
use crate::control::config::Config;
use crate::fault::Limits;
use crate::math::{clamp, high};

/// Currents in 2⁻¹³ of the full scale, their squares for powers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supply {
    /// Current that the back-EMF would drive through the resistance.
    short: i32,
    /// Power that may go back, and that of an eighth of the largest current, which the noise of the speed loop may return.
    returns: i32,
    /// Current along d that burns the rest.
    field: i16,
    /// Largest currents against and along the rotation.
    braking: i16,
    driving: i16,
    forward: bool,
    /// So slow that next to nothing is returned, whatever the flux linkage; where d is not controlled, so slow that
    /// the largest current is beyond that of shorted windings.
    slow: bool,
}

/// Largest current that the back-EMF would drive, 32 full scales: a square of it is beyond the integers.
const MOST_SHORT: i32 = 1 << 18;

impl Supply {
    /// At rest.
    pub const NONE: Self =
        Self { short: 1, returns: 0, field: 0, braking: i16::MAX, driving: i16::MAX, forward: true, slow: true };

    /// Takes up speed and bus voltage: what may go back. `most` is the largest current in 2⁻¹³ of
    /// the full scale.
    #[inline(always)]
    pub fn take_up(&mut self, config: &Config, speed: i32, bus: i32, most: i32, controls_field: bool) {
        let supply = &config.supply;
        self.forward = speed >= 0;
        self.short = high(speed.abs(), supply.short).min(MOST_SHORT) | 1;
        // What nobody notices: the noise of the speed loop must not move the current along d.
        let little = most >> 3;
        (self.returns, self.slow) = if controls_field {
            (high(bus << 16, supply.returns) + little * little, speed.abs() < config.motion.turning_speed)
        } else {
            // Without control of the current along d, the bus voltage alone limits what brakes.
            (1 << 29, self.short - (self.short >> 2) < most)
        };
    }

    /// Takes up what the supply has to drive with, beside the losses of a current along d.
    #[inline(always)]
    pub fn limit_driving(&mut self, config: &Config, bus: i32, most: i32, field: i32) {
        // Newton's root of q² + a·q = power: from the second time on at most a little too large.
        let (short, driving) = ((self.short >> 1) + (self.short >> 3), i32::from(self.driving));
        let gives = (high(bus << 16, config.supply.gives) - field * field).max(0);
        // What burns is still there when a torque follows.
        let most = most - beside(i32::from(self.field));
        self.driving = ((driving * driving + gives) / ((2 * driving + short) | 1).max(1)).min(most) as i16;
    }

    /// Takes up the current along d that is needed for the one along q that is `asked` for. Returns it in 2⁻²⁸ of the
    /// full scale.
    #[inline(always)]
    pub fn burn(&mut self, config: &Config, bus: i32, asked: i32, most: i32, controls_field: bool) -> i32 {
        let against = if self.forward { -asked } else { asked } >> 2;
        // Beyond half of the short-circuit current, less and less is returned.
        let braking = against.min(self.short >> 1).min(most).max(0);
        let burn = braking * (self.short - braking) - self.returns;
        let field = if !controls_field {
            0
        } else if against <= 0 || burn <= 0 {
            // What a small current returned that nobody asked for.
            let excess = bus - config.supply.end + config.supply.band;
            if excess > 0 && !self.slow { most >> 3 } else { 0 }
        } else {
            // Newton's square root, which leaps from far below; what limits the current along q follows a while later.
            let field = i32::from(self.field) | 1;
            ((field + burn / field) >> 1).min(field + (most >> 3)).min(most - (most >> 4))
        };
        self.field = field as i16;
        -field << 15
    }

    /// Whether a current along d burns something.
    #[inline(always)]
    pub const fn burns(&self) -> bool {
        self.field != 0
    }

    /// Takes up what the current along d and the bus voltage leave to brake with.
    #[inline(always)]
    pub fn limit(&mut self, config: &Config, bus: i32, most: i32) {
        let supply = &config.supply;
        let field = i32::from(self.field);
        let braking = (field * field + self.returns) / self.short.max(1);
        // Where the largest power that can be returned is burnt, any current may brake, within the circle: a load that drives
        // the rotor needs more than the small one. Less a little, as the current along d follows the noise of the speed of
        // before: a share of that power, and of the largest current, which counts where the rotor is slow.
        let braking = if braking >= (self.short >> 2) - ((self.short + most) >> 6) { most } else { braking };
        // Near rest, braking draws as much as driving does.
        let drawn = i32::from(self.driving) + (self.short >> 1);
        let braking = braking.min(most - beside(field)).min(drawn);
        let share = (supply.end - bus).min(supply.band).max(0) * supply.slope;
        // A slow rotor returns next to nothing, and a large current that brakes it draws.
        self.braking = if self.slow { braking } else { (braking * share) >> 16 } as i16;
    }

    /// What the bus, `left` below its end, has room for of a current, where the one along d is not controlled: at once, as a
    /// strong motor charges a small capacitor within a few steps. More than is asked for only for a motion. `None`: not even
    /// for the error of a current of none.
    #[cold]
    #[inline(never)]
    pub fn room_for(&self, config: &Config, left: i32, current: i32, speed: i32, moves: bool) -> Option<i32> {
        let drives = current != 0 && (current ^ speed) >= 0;
        if drives || left > 0 && self.slow {
            return Some(current);
        }
        if left > 0 {
            let most = (config.max_current * ((left * config.supply.slope) >> 4)) >> 12;
            return Some(clamp(current, most));
        }
        // A current beyond that of shorted windings draws from the bus. A small one is the noise of a speed that is held.
        let draws = self.short.min(i32::from(self.braking)) << 2;
        let brakes = if current < 0 { current.min(-draws) } else { current.max(draws) };
        let least = if moves { draws >> 2 } else { draws };
        self.slow.then_some(if current.abs() < least { 0 } else { brakes })
    }

    /// Narrows a window.
    #[inline(always)]
    pub fn narrow(&self, window: &mut Window) {
        let [braking, driving] = [self.braking, self.driving].map(|most| i32::from(most) << 2 | 3);
        let (below, above) = if self.forward { (braking, driving) } else { (driving, braking) };
        window.from_below(-below, Limits::SUPPLY);
        window.from_above(above, Limits::SUPPLY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    /// The limit of the current along q follows half a cycle later: a leap would make both together too large.
    #[test]
    fn the_current_along_d_rises_in_steps_to_what_has_to_be_burnt() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let (most, bus) = (config.max_current >> 2, 16_000);
        for hz in (1..1000).step_by(7) {
            let speed = (f64::from(hz) / 40e3 * 4_294_967_296.0) as i32;
            let mut supply = Supply::NONE;
            for _ in 0..100 {
                let before = i32::from(supply.field);
                supply.take_up(&config, speed, bus, most, true);
                supply.burn(&config, bus, -4 * most, most, true);
                let field = i32::from(supply.field);
                assert!(field - before <= most / 8 + 1, "{hz} Hz: {before} to {field}");
            }
            let braking = most.min(supply.short / 2);
            let field = i32::from(supply.field);
            let burnt = field * field + supply.returns;
            let needed = braking * (supply.short - braking);
            assert!(burnt >= needed / 100 * 95 || field == most - most / 16, "{hz} Hz: {burnt} of {needed}");
        }
    }

    /// Without control of the current along d: what drives is left alone, what brakes returns less and less, and nothing where
    /// the bus is full.
    #[test]
    fn a_full_bus_has_room_for_what_draws_only() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let (most, band) = (config.max_current, config.supply.band);
        for hz in (1..1000).step_by(7) {
            for way in [1, -1] {
                let speed = way * (f64::from(hz) / 40e3 * 4_294_967_296.0) as i32;
                let mut supply = Supply::NONE;
                supply.take_up(&config, speed, 16_000, most >> 2, false);
                supply.limit(&config, 16_000, most >> 2);
                // The back-EMF of the settings drives this through shorted windings; at half of it most is returned.
                let short = 5 * supply.short / 2;
                for current in (-most..=most).step_by(97) {
                    let moves = hz & 1 == 0;
                    let room = |left| supply.room_for(&config, left, current, speed, moves);
                    let drives = current * way > 0;
                    for left in [-band, 0, 1, band / 2, band - 1] {
                        let Some(allowed) = room(left) else {
                            assert!(!drives && left <= 0 && short > most / 2, "{hz} Hz, {current}");
                            continue;
                        };
                        assert!(allowed.abs() <= most && allowed * current >= 0);
                        assert!(!drives || allowed == current);
                        assert!(
                            drives || left > 0 || allowed == 0 || allowed.abs() > short,
                            "{hz} Hz: {allowed} of {short}"
                        );
                        assert!(drives || left <= 0 && moves || allowed.abs() <= current.abs());
                    }
                }
            }
        }
    }
}
