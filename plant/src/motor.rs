//! A permanent-magnet machine: windings, back-EMF and rotor, advanced together.

use crate::emf::BackEmf;
use crate::error::{Error, finite, positive, require};
use crate::hall::View;
use crate::heat::{Heat, HeatParameters};
use crate::iron::{Axes, Iron};
use crate::load::{Coupled, Load, LoadParameters};
use crate::phasor::Phasor;
use crate::rotor::{Cogging, Friction, Rotor};
use crate::windings::{Diodes, Terminal, Windings};

/// A motor in a star connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorParameters {
    /// Resistance of one phase, Ω.
    pub resistance_ohm: f64,
    /// Inductance of one phase in the star (self less mutual), H.
    pub inductance_h: f64,
    /// How the inductance differs with direction and current.
    pub iron: Iron,
    /// Pole pairs, 1 to 64.
    pub pole_pairs: u8,
    /// Back-EMF, and with it torque.
    pub back_emf: BackEmf,
    /// Inertia of the rotor and all that turns with it, kg·m².
    pub inertia_kgm2: f64,
    /// Friction.
    pub friction: Friction,
    /// Two components of the cogging torque.
    pub cogging: [Cogging; 2],
    /// Torque of the load against positive rotation, N·m; it acts at rest, too, at the far end of the shaft.
    pub load_nm: f64,
    /// A load on a shaft that twists; without, the shaft is stiff.
    pub load: Option<LoadParameters>,
    /// How the copper warms, and its resistance with it; without, it stays at `resistance_ohm`, which otherwise is that
    /// of cold copper.
    pub heat: Option<HeatParameters>,
}

impl MotorParameters {
    /// The motor of Simpkins and Todorov.
    ///
    /// From the paper: 3.75 Ω, 0.36 mH (taken as values of one phase) and four pole pairs. Chosen
    /// as plausible for a pancake motor of that size: a flux linkage of 5 mV·s, so that it idles at
    /// about 5660 rpm on sinusoids from 24 V; 1e-5 kg·m²; 0.5 mN·m of Coulomb friction, 0.6 mN·m to
    /// break away; 1 µN·m·s of viscous friction; cogging of 0.5 mN·m at 24 cycles a
    /// turn (eight poles over six slots) and 0.2 mN·m at 12 (unequal magnets).
    #[must_use]
    pub const fn paper() -> Self {
        Self {
            resistance_ohm: 3.75,
            inductance_h: 0.36e-3,
            iron: Iron::NONE,
            pole_pairs: 4,
            back_emf: BackEmf::sinusoidal(5e-3),
            inertia_kgm2: 1e-5,
            friction: Friction { viscous_nms: 1e-6, coulomb_nm: 0.5e-3, breakaway_nm: 0.6e-3 },
            cogging: [
                Cogging { amplitude_nm: 0.5e-3, cycles_per_turn: 24, phase_rad: 0.4 },
                Cogging { amplitude_nm: 0.2e-3, cycles_per_turn: 12, phase_rad: 1.9 },
            ],
            load_nm: 0.0,
            load: None,
            heat: None,
        }
    }

    /// The same motor with a sinusoidal back-EMF and neither friction nor cogging, for comparison
    /// with closed formulas.
    #[must_use]
    pub const fn ideal() -> Self {
        Self { friction: Friction::NONE, cogging: [Cogging::NONE; 2], ..Self::paper() }
    }
}

/// Means over one step of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    /// Length of the step, s.
    pub span_s: f64,
    /// Terminal voltages against the negative rail, V. The drop across the switches' resistance is
    /// counted with the windings'.
    pub terminals_v: [f64; 3],
    /// Mean phase currents, A.
    pub currents_a: [f64; 3],
    /// Phase currents at the end of the step, A.
    pub end_currents_a: [f64; 3],
    /// Back-EMF from phase to star point in the middle of the step, V.
    pub back_emf_v: [f64; 3],
    /// Electromagnetic torque, N·m.
    pub torque_nm: f64,
    /// Cogging torque, N·m.
    pub cogging_nm: f64,
    /// Torque of friction, N·m; opposes the motion, or holds the rotor at rest.
    pub friction_nm: f64,
    /// Mechanical angle turned, rad.
    pub turned_rad: f64,
    /// The same of the load, which is the rotor's where the shaft is stiff, rad.
    pub load_turned_rad: f64,
    /// What the shaft's damping and the load's own friction took, J.
    pub load_lost_j: f64,
    /// Current drawn from the positive rail, A.
    pub bus_a: f64,
}

/// The machine in motion.
#[derive(Clone, Debug)]
pub(crate) struct Motor {
    back_emf: BackEmf,
    cogging: [Cogging; 2],
    pole_pairs: f64,
    pub load_nm: f64,
    pub windings: Windings,
    /// With the inductance that it changes, where it changes any.
    iron: Option<(Iron, f64)>,
    pub rotor: Rotor,
    load: Option<Load>,
    pub heat: Option<Heat>,
    switch_ohm: f64,
    phasor: Phasor,
    /// How far what the Halls see has turned on the shaft, mechanical, and the same electrical.
    slip_rad: f64,
    slip: Phasor,
}

impl Motor {
    /// `switch_ohm` is in series with each phase; `usual_s` the step that comes up most.
    pub fn new(parameters: &MotorParameters, switch_ohm: f64, usual_s: f64) -> Result<Self, Error> {
        positive(parameters.resistance_ohm, "motor.resistance_ohm")?;
        require((1..=64).contains(&parameters.pole_pairs), "motor.pole_pairs", "1 to 64")?;
        parameters.back_emf.check()?;
        parameters.iron.check()?;
        for (index, cogging) in parameters.cogging.iter().enumerate() {
            cogging.check().map_err(|error| error.at(index))?;
        }
        finite(parameters.load_nm, "motor.load_nm")?;
        let rotor = Rotor::new(parameters.inertia_kgm2, parameters.friction)?;
        let load = parameters.load.map(|load| Load::new(&load, parameters.inertia_kgm2, usual_s)).transpose()?;
        Ok(Self {
            back_emf: parameters.back_emf,
            cogging: parameters.cogging,
            pole_pairs: f64::from(parameters.pole_pairs),
            load_nm: parameters.load_nm,
            windings: Windings::new(parameters.resistance_ohm + switch_ohm, parameters.inductance_h, usual_s)?,
            iron: parameters.iron.acts().then_some((parameters.iron, parameters.inductance_h)),
            rotor,
            load,
            heat: parameters.heat.map(|heat| Heat::new(&heat, parameters.resistance_ohm)).transpose()?,
            switch_ohm,
            phasor: Phasor::new(0.0),
            slip_rad: 0.0,
            slip: Phasor::new(0.0),
        })
    }

    /// Turns what the Halls see on the shaft, by so much from where it was glued.
    pub fn slip(&mut self, electrical_rad: f64) {
        self.slip_rad = electrical_rad / self.pole_pairs;
        self.slip = Phasor::new(electrical_rad);
    }

    /// The load: the rotor where the shaft is stiff.
    pub fn load(&self) -> &Rotor {
        self.load.as_ref().map_or(&self.rotor, |load| &load.inertia)
    }

    /// Puts rotor and load to an angle, the shaft not twisted and in the middle of its play.
    pub fn place(&mut self, angle_rad: f64, speed_rad_s: f64) {
        self.rotor.place(angle_rad, speed_rad_s);
        if let Some(load) = &mut self.load {
            load.inertia.place(angle_rad, speed_rad_s);
        }
    }

    pub fn electrical_rad(&self) -> f64 {
        self.pole_pairs * self.rotor.angle_rad
    }

    /// What the Halls see, as of the last [`resync`](Self::resync) or step.
    pub fn view(&self) -> View {
        View { electrical: self.phasor.plus(self.slip), mechanical_rad: self.rotor.angle_rad + self.slip_rad }
    }

    /// Takes sine and cosine from the angle itself.
    pub fn resync(&mut self) {
        self.phasor = Phasor::new(self.electrical_rad());
    }

    /// Back-EMF at this very moment.
    pub fn back_emf_v(&self) -> [f64; 3] {
        let speed = self.pole_pairs * self.rotor.speed_rad_s;
        self.back_emf.at(self.phasor, self.electrical_rad()).map(|flux| flux * speed)
    }

    pub fn cogging_nm(&self) -> f64 {
        self.cogging_at(self.rotor.angle_rad)
    }

    fn cogging_at(&self, angle_rad: f64) -> f64 {
        self.cogging[0].torque_nm(angle_rad) + self.cogging[1].torque_nm(angle_rad)
    }

    /// Electromagnetic torque at this very moment.
    pub fn torque_nm(&self) -> f64 {
        let flux_vs = self.back_emf.at(self.phasor, self.electrical_rad());
        self.torque_of(&flux_vs, &self.windings.currents_a) + self.reluctance_nm(self.phasor, &self.windings.currents_a)
    }

    /// Torque of the iron at a phasor of the electrical angle.
    fn reluctance_nm(&self, at: Phasor, currents_a: &[f64; 3]) -> f64 {
        let Some((iron, inductance_h)) = &self.iron else { return 0.0 };
        let axes = Axes::new(at, self.back_emf.sequence);
        self.pole_pairs * axes.torque_beyond_nm(iron, *inductance_h, currents_a)
    }

    /// Co-energy: the torque is what the back-EMF takes up per speed, without dividing by it.
    fn torque_of(&self, flux_vs: &[f64; 3], currents_a: &[f64; 3]) -> f64 {
        self.pole_pairs * (flux_vs[0] * currents_a[0] + flux_vs[1] * currents_a[1] + flux_vs[2] * currents_a[2])
    }

    /// One step with constant terminal voltages. The bus current leaves out the driven terminals,
    /// whose share the inverter knows.
    pub fn step(&mut self, terminals: &[Terminal; 3], diodes: Diodes, span_s: f64) -> Slice {
        let half_s = 0.5 * span_s;
        let speed = self.rotor.speed_ahead_rad_s(half_s);
        let ahead_rad = half_s * speed;
        let middle_rad = self.rotor.angle_rad + ahead_rad;
        let middle = self.phasor.turned_by(self.pole_pairs * ahead_rad);
        let flux_vs = self.back_emf.at(middle, self.pole_pairs * middle_rad);
        let back_emf_v = flux_vs.map(|flux| flux * self.pole_pairs * speed);

        let flow = match self.iron {
            None => self.windings.advance(terminals, &back_emf_v, diodes, span_s),
            Some((iron, inductance_h)) => {
                let (begin, sequence) = (self.phasor, self.back_emf.sequence);
                let turns_rad = 2.0 * self.pole_pairs * ahead_rad;
                let flux_vs_at = |share: f64| {
                    let axes = Axes::new(begin.turned_by(share * turns_rad), sequence);
                    move |currents_a: &[f64; 3]| axes.flux_beyond_vs(&iron, inductance_h, currents_a)
                };
                self.windings.advance_in_iron(terminals, &back_emf_v, diodes, span_s, flux_vs_at)
            }
        };
        if let Some(copper_ohm) = self.heat.as_mut().and_then(|heat| heat.take(&flow.currents_a, span_s)) {
            self.windings.set_resistance(copper_ohm + self.switch_ohm);
        }
        let torque_nm = self.torque_of(&flux_vs, &flow.currents_a) + self.reluctance_nm(middle, &flow.currents_a);
        let cogging_nm = self.cogging_at(middle_rad);
        let moved = self.turn(torque_nm + cogging_nm, span_s);
        self.phasor = middle.turned_by(self.pole_pairs * (moved.rotor.turned_rad - ahead_rad));
        Slice {
            span_s,
            terminals_v: flow.terminals_v,
            currents_a: flow.currents_a,
            end_currents_a: self.windings.currents_a,
            back_emf_v,
            torque_nm,
            cogging_nm,
            friction_nm: moved.rotor.friction_nm,
            turned_rad: moved.rotor.turned_rad,
            load_turned_rad: moved.turned_rad,
            load_lost_j: moved.lost_j,
            bus_a: flow.returned_a,
        }
    }

    /// All that turns, under the torque of the magnets.
    fn turn(&mut self, torque_nm: f64, span_s: f64) -> Coupled {
        match &mut self.load {
            Some(load) => load.step(&mut self.rotor, torque_nm, self.load_nm, span_s),
            None => {
                let rotor = self.rotor.step(torque_nm - self.load_nm, span_s);
                Coupled { turned_rad: rotor.turned_rad, rotor, lost_j: 0.0 }
            }
        }
    }
}
