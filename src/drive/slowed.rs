//! Gains of the speed control for a rotor that is lighter than the settings say: a mass was taken off since they were found,
//! and with gains for a heavy rotor, a light one hums at rest, at the largest current. The [tasks](crate::service) find it.

use crate::control::velocity::Gains;

/// The inertia counts as 2⁻² times that of the settings at least. With gains for less, a position control as fast as the
/// settings allow would swing a rotor that is not lighter far to and fro.
const LIGHTEST: u8 = 2;

/// Gains of the speed control that were too large for the rotor, as one from which a mass was taken.
pub(super) struct Slowed {
    /// How often they have been halved.
    times: u8,
    /// Those of the settings.
    own: Option<Gains>,
}

impl Slowed {
    /// They are those of the settings.
    pub const NOT: Self = Self { times: 0, own: None };

    /// Whether they have been halved.
    pub const fn is_slowed(&self) -> bool {
        self.own.is_some()
    }

    /// Halves them, twice at most; whether it has.
    pub fn halve(&mut self, gains: &mut Gains) -> bool {
        let halves = self.times < LIGHTEST;
        if halves {
            self.own.get_or_insert(*gains);
            self.times += 1;
            *gains = gains.halved();
        }
        halves
    }

    /// They are again what the settings say.
    pub fn end(&mut self, gains: &mut Gains) {
        if let Some(own) = self.own.take() {
            (*gains, self.times) = (own, 0);
        }
    }
}
