//! What the magnets of a real rotor differ in, and what the field over the turn then looks like.
//!
//! A magnet has its own strength and sits a little beside its place. Under its middle a sensor sees that magnet alone;
//! towards the next one, strength and displacement go over smoothly. A rotor that runs out or is magnetised unevenly
//! modulates all of them once and twice a turn.

use crate::error::{Error, finite, not_negative, require};
use crate::hall::{HARMONICS, HallParameters, Harmonic};
use crate::noise::Noise;
use core::f64::consts::PI;

/// A modulation of the field's strength with the mechanical turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modulation {
    /// Relative size.
    pub size: f64,
    /// Where on the rotor the field is strongest, mechanical radians.
    pub at_rad: f64,
}

impl Modulation {
    /// None.
    pub const NONE: Self = Self { size: 0.0, at_rad: 0.0 };
}

/// The magnets of a rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnets {
    /// Largest relative deviation of a pole's strength; each is drawn uniformly.
    pub gain: f64,
    /// Largest displacement of a pole, electrical radians; each is drawn uniformly.
    pub pitch_rad: f64,
    /// Strength over the turn: once and twice a turn.
    pub modulation: [Modulation; 2],
    /// Seed of what is drawn.
    pub seed: u64,
}

impl Magnets {
    /// All alike.
    pub const EVEN: Self = Self { gain: 0.0, pitch_rad: 0.0, modulation: [Modulation::NONE; 2], seed: 0 };

    pub(crate) fn check(&self) -> Result<(), Error> {
        not_negative(self.gain, "magnets.gain")?;
        require(self.gain < 1.0, "magnets.gain", "below 1")?;
        not_negative(self.pitch_rad, "magnets.pitch_rad")?;
        for Modulation { size, at_rad } in self.modulation {
            not_negative(size, "magnets.modulation.size")?;
            finite(at_rad, "magnets.modulation.at_rad")?;
        }
        Ok(())
    }

    /// Whether there is nothing to compute.
    pub(crate) fn is_even(&self) -> bool {
        self.gain == 0.0 && self.pitch_rad == 0.0 && self.modulation.iter().all(|modulation| modulation.size == 0.0)
    }

    /// Relative strength and displacement (electrical radians) of a pole; poles count from the rotor's zero.
    #[must_use]
    pub fn pole(&self, pole: u32) -> (f64, f64) {
        // Streams of neighbouring seeds must not resemble each other.
        let mut random = Noise::new((self.seed ^ u64::from(pole) << 32).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        random.uniform();
        (1.0 + self.gain * random.uniform(), self.pitch_rad * random.uniform())
    }

    /// Relative strength of the field, and how far it is displaced (electrical radians), at a place on the rotor, in
    /// mechanical radians.
    #[must_use]
    pub fn at(&self, place_rad: f64, pole_pairs: u8) -> (f64, f64) {
        self.at_near(place_rad, pole_pairs, &mut Neighbours::default())
    }

    /// The same for a sensor that was elsewhere just before: it keeps its neighbours.
    pub(crate) fn at_near(&self, place_rad: f64, pole_pairs: u8, neighbours: &mut Neighbours) -> (f64, f64) {
        let (mut strength, mut displaced) = (1.0, 0.0);
        if self.gain != 0.0 || self.pitch_rad != 0.0 {
            // In poles, from the middle of the first.
            let poles = place_rad * f64::from(pole_pairs) / PI - 0.5;
            let first = libm::floor(poles);
            let over = poles - first;
            let weight = over * over * (3.0 - 2.0 * over);
            let [a, b] = neighbours.from(self, first as i64, pole_pairs);
            strength = a.0 + weight * (b.0 - a.0);
            displaced = a.1 + weight * (b.1 - a.1);
        }
        for (order, modulation) in [1.0, 2.0].into_iter().zip(self.modulation) {
            if modulation.size != 0.0 {
                strength += modulation.size * libm::cos(order * (place_rad - modulation.at_rad));
            }
        }
        (strength, displaced)
    }
}

/// The two poles that a sensor is between, as they were drawn: to draw them takes longer than the rest of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Neighbours {
    /// Number of the first, and both.
    drawn: Option<(i64, [(f64, f64); 2])>,
}

impl Neighbours {
    /// The pole of this number, counted through all turns, and the next.
    fn from(&mut self, magnets: &Magnets, first: i64, pole_pairs: u8) -> [(f64, f64); 2] {
        if let Some((number, poles)) = self.drawn
            && number == first
        {
            return poles;
        }
        let count = 2 * i64::from(pole_pairs);
        let poles = [0, 1].map(|next| magnets.pole((first + next).rem_euclid(count) as u32));
        self.drawn = Some((first, poles));
        poles
    }
}

/// How uneven a rotor may be, and what its sensors see of it. Everything is drawn uniformly up to the given size, with
/// any phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unevenness {
    /// Relative deviation of a pole's strength.
    pub gain: f64,
    /// Displacement of a pole, electrical degrees.
    pub pitch_deg: f64,
    /// Relative modulation once and twice a turn.
    pub modulation: [f64; 2],
    /// Second to seventh harmonic, relative to the fundamental; the sensors' differ by a quarter in size and by 20° in
    /// phase.
    pub harmonics: [f64; HARMONICS],
    /// Field of the windings at [`rated_a`](Self::rated_a), relative to the magnets'.
    pub coil: f64,
    /// Amplitude of the rated current, A.
    pub rated_a: f64,
}

impl Unevenness {
    /// None.
    pub const NONE: Self =
        Self { gain: 0.0, pitch_deg: 0.0, modulation: [0.0; 2], harmonics: [0.0; HARMONICS], coil: 0.0, rated_a: 1.0 };

    /// What cheap magnets are taken to have at most.
    pub const CHEAP: Self = Self {
        gain: 0.1,
        pitch_deg: 5.0,
        modulation: [0.05, 0.05],
        harmonics: [0.05, 0.01, 0.01, 0.005, 0.003, 0.003],
        coil: 0.02,
        ..Self::NONE
    };

    /// So many times as uneven.
    #[must_use]
    pub fn scaled(&self, times: f64) -> Self {
        Self {
            gain: times * self.gain,
            pitch_deg: times * self.pitch_deg,
            modulation: self.modulation.map(|size| times * size),
            harmonics: self.harmonics.map(|size| times * size),
            coil: times * self.coil,
            ..*self
        }
    }

    /// The magnets drawn from a seed.
    #[must_use]
    pub fn magnets(&self, seed: u64) -> Magnets {
        let mut random = Noise::new(!seed);
        let modulation =
            |size: f64| Modulation { size: size * 0.5 * (1.0 + random.uniform()), at_rad: PI * random.uniform() };
        let modulation = self.modulation.map(modulation);
        Magnets { gain: self.gain, pitch_rad: self.pitch_deg.to_radians(), modulation, seed }
    }

    /// Sensors at such a rotor, the harmonics drawn from a seed; `phase_rad` is the common phase φ.
    #[must_use]
    pub fn halls(&self, mut halls: [HallParameters; 3], phase_rad: f64, seed: u64) -> [HallParameters; 3] {
        let mut random = Noise::new(seed.rotate_left(32) ^ 0x5EED);
        for (order, size) in self.harmonics.into_iter().enumerate() {
            let (size, phase_rad) = (size * 0.5 * (1.0 + random.uniform()), PI * random.uniform());
            for hall in &mut halls {
                hall.harmonics[order] = Harmonic {
                    size: size * (1.0 + 0.25 * random.uniform()),
                    phase_rad: phase_rad + 20.0_f64.to_radians() * random.uniform(),
                };
            }
        }
        halls.map(|hall| hall.with_windings(self.coil, self.rated_a, phase_rad))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    const UNEVEN: Magnets = Magnets {
        gain: 0.1,
        pitch_rad: 0.08,
        modulation: [Modulation { size: 0.05, at_rad: 1.0 }, Modulation { size: 0.03, at_rad: -0.4 }],
        seed: 7,
    };

    #[test]
    fn the_middle_of_a_pole_shows_that_pole() {
        let poles = Magnets { modulation: [Modulation::NONE; 2], ..UNEVEN };
        for pole in 0..14 {
            let (strength, displaced) = poles.at((f64::from(pole) + 0.5) * PI / 7.0, 7);
            let expected = poles.pole(pole);
            assert!((strength - expected.0).abs() < 1e-12 && (displaced - expected.1).abs() < 1e-12, "{pole}");
        }
    }

    #[test]
    fn the_field_closes_over_the_turn_and_has_no_steps() {
        let mut last = UNEVEN.at(0.0, 4);
        for k in 1..=8000 {
            let now = UNEVEN.at(TAU * f64::from(k) / 8000.0, 4);
            // At most 1.5 times the mean slope from pole to pole, of which there are 8; modulation is slower.
            assert!((now.0 - last.0).abs() < 0.001 && (now.1 - last.1).abs() < 0.001, "{k}");
            last = now;
        }
        let first = UNEVEN.at(0.0, 4);
        assert!((last.0 - first.0).abs() < 1e-9 && (last.1 - first.1).abs() < 1e-9);
        assert!((UNEVEN.at(-0.1, 4).1 - UNEVEN.at(TAU - 0.1, 4).1).abs() < 1e-12);
    }

    #[test]
    fn what_is_kept_of_the_poles_changes_nothing() {
        let mut neighbours = Neighbours::default();
        for k in -3000..3000 {
            // To and fro, over more than two turns each way.
            let place = 14.0 * libm::sin(f64::from(k) / 300.0) + f64::from(k) / 3000.0;
            assert_eq!(UNEVEN.at_near(place, 4, &mut neighbours), UNEVEN.at(place, 4), "{k}");
        }
    }

    #[test]
    fn modulation_has_its_orders_and_nothing_else() {
        let magnets = Magnets { gain: 0.0, pitch_rad: 0.0, ..UNEVEN };
        for order in 0..5 {
            let (mut cosine, mut sine) = (0.0, 0.0);
            for k in 0..360 {
                let place = TAU * f64::from(k) / 360.0;
                let (strength, displaced) = magnets.at(place, 4);
                assert_eq!(displaced, 0.0);
                cosine += strength * libm::cos(f64::from(order) * place) / 180.0;
                sine += strength * libm::sin(f64::from(order) * place) / 180.0;
            }
            let expected = [2.0, 0.05, 0.03, 0.0, 0.0][order as usize];
            assert!((libm::hypot(cosine, sine) - expected).abs() < 1e-9, "{order}");
        }
    }

    #[test]
    fn what_is_drawn_fills_its_range() {
        let (mut least, mut most, mut mean) = (2.0_f64, 0.0_f64, 0.0);
        for seed in 0..500 {
            for pole in 0..8 {
                let (strength, displaced) = Magnets { seed, ..UNEVEN }.pole(pole);
                least = least.min(strength);
                most = most.max(strength);
                mean += strength / 4000.0;
                assert!(displaced.abs() <= 0.08);
            }
        }
        assert!((0.9..0.901).contains(&least) && (1.099..=1.1).contains(&most) && (mean - 1.0).abs() < 0.004, "{mean}");
    }
}
