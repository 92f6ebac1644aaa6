//! Everything that makes up a plant, and two ready-made ones.

use crate::adc::{AdcParameters, SenseParameters};
use crate::bus::BusParameters;
use crate::hall::{HallParameters, Saturation};
use crate::inverter::{InverterModel, InverterParameters};
use crate::magnets::{Magnets, Unevenness};
use crate::motor::MotorParameters;
use crate::noise::Noise;
use core::f64::consts::PI;

/// A motor, its inverter and its sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantParameters {
    /// The motor.
    pub motor: MotorParameters,
    /// The inverter.
    pub inverter: InverterParameters,
    /// The supply.
    pub bus: BusParameters,
    /// The three linear Hall sensors.
    pub halls: [HallParameters; 3],
    /// Phase φ that all three have in common, electrical radians.
    pub hall_phase_rad: f64,
    /// The magnets that they look at.
    pub magnets: Magnets,
    /// The converter that reads everything.
    pub adc: AdcParameters,
    /// Phase current amplifiers, V/A.
    pub current_sense: SenseParameters,
    /// Bus voltage divider, V/V.
    pub bus_sense: SenseParameters,
}

/// Where the three sensors are meant to sit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HallLayout {
    /// ψ = 0°, 120°, 240° electrical.
    Deg120,
    /// ψ = 0°, -120°, -240°.
    Deg120Reversed,
    /// ψ = 0°, 60°, 120°.
    Deg60,
    /// ψ = 0°, -60°, -120°.
    Deg60Reversed,
}

impl HallLayout {
    /// Nominal placement of a sensor, electrical radians.
    #[must_use]
    pub const fn placement_rad(self, sensor: usize) -> f64 {
        let spacing_deg = match self {
            Self::Deg120 => 120.0,
            Self::Deg120Reversed => -120.0,
            Self::Deg60 => 60.0,
            Self::Deg60Reversed => -60.0,
        };
        spacing_deg * sensor as f64 * (PI / 180.0)
    }
}

const REFERENCE_V: f64 = 3.3;
const BITS: u8 = 12;

impl PlantParameters {
    /// The paper's motor without friction or cogging, an ideal inverter at 40 kHz on a stiff 24 V
    /// and flawless sensors: for comparison with closed formulas.
    ///
    /// Hall sensors at 120° with φ = 0, 1.65 V ± 1 V into 12 bit at 3.3 V; currents 0.2 V/A about
    /// 1.65 V; the bus divided by eleven.
    #[must_use]
    pub const fn ideal() -> Self {
        let layout = HallLayout::Deg120;
        Self {
            motor: MotorParameters::ideal(),
            inverter: InverterParameters::ideal(40e3),
            bus: BusParameters::ideal(24.0),
            halls: [
                HallParameters::ideal(1.65, 1.0, layout.placement_rad(0)),
                HallParameters::ideal(1.65, 1.0, layout.placement_rad(1)),
                HallParameters::ideal(1.65, 1.0, layout.placement_rad(2)),
            ],
            hall_phase_rad: 0.0,
            magnets: Magnets::EVEN,
            adc: AdcParameters::ideal(BITS, REFERENCE_V),
            current_sense: SenseParameters { gain: 0.2, offset_v: 0.5 * REFERENCE_V, noise_v: 0.0 },
            bus_sense: SenseParameters { gain: 1.0 / 11.0, offset_v: 0.0, noise_v: 0.0 },
        }
    }

    /// The imperfect motor with its sensors meant to sit 120° apart: see [`imperfect_with`](Self::imperfect_with).
    #[must_use]
    pub fn imperfect(seed: u64) -> Self {
        Self::imperfect_with(seed, HallLayout::Deg120)
    }

    /// The imperfect motor: everything that a cheap drive has to live with at once.
    ///
    /// Drawn from the seed, uniform: a placement error within ±8° electrical for each sensor, an
    /// amplitude within ±30 % and an offset within ±10 % of the nominal amplitude, the common
    /// phase φ over the whole turn, the phases of the cogging, an amplifier offset within ±10 mV.
    /// The nominal swing is 500 LSB peak to peak of 12 bit at 3.3 V. Fixed: a third harmonic of 5 %
    /// locked to the fundamental, Gaussian noise of 1 % of each sensor's own amplitude, the
    /// paper's motor with friction and cogging, 40 kHz, 0.5 µs of dead time, switches of 20 mΩ,
    /// diodes of 0.7 V, a supply of 24 V behind 0.1 Ω and 470 µF that takes nothing back, current and bus sensing with
    /// 1 mV of noise. No drift, stray field, lag or fault: those are for experiments of their own.
    #[must_use]
    pub fn imperfect_with(seed: u64, layout: HallLayout) -> Self {
        // Apart from the plant's own noise, which may have the same seed.
        let mut random = Noise::new(!seed);
        let ideal = Self::ideal();
        let nominal_v = 250.0 * ideal.adc.lsb_v();
        let mut halls = ideal.halls;
        for (sensor, hall) in halls.iter_mut().enumerate() {
            hall.placement_rad = layout.placement_rad(sensor) + random.uniform() * (8.0 * PI / 180.0);
            hall.amplitude_v = nominal_v * (1.0 + 0.3 * random.uniform());
            hall.offset_v = 0.5 * REFERENCE_V + 0.1 * nominal_v * random.uniform();
            hall.third = 0.05;
            hall.noise = 0.01;
            hall.saturation = Saturation::hard(REFERENCE_V);
        }
        let hall_phase_rad = PI * random.uniform();
        let mut motor = MotorParameters::paper();
        for cogging in &mut motor.cogging {
            cogging.phase_rad = PI * random.uniform();
        }
        Self {
            motor,
            halls,
            hall_phase_rad,
            inverter: InverterParameters {
                pwm_hz: 40e3,
                dead_time_s: 0.5e-6,
                switch_ohm: 0.02,
                diode_v: 0.7,
                model: InverterModel::Averaged { steps: 1 },
            },
            bus: BusParameters {
                supply_v: 24.0,
                source_ohm: 0.1,
                capacitance_f: 470e-6,
                regenerative: false,
                electronics_a: 0.0,
            },
            current_sense: SenseParameters {
                offset_v: 0.5 * REFERENCE_V + 0.01 * random.uniform(),
                noise_v: 1e-3,
                ..ideal.current_sense
            },
            bus_sense: SenseParameters { noise_v: 1e-3, ..ideal.bus_sense },
            ..ideal
        }
    }

    /// The same with two Halls, the second so many electrical degrees from the first besides the error of its
    /// placement. The third input is open: it floats, and a little of the motor's current couples into it.
    #[must_use]
    pub fn with_two_halls(mut self, apart_deg: f64) -> Self {
        let [first, second, third] = &mut self.halls;
        second.placement_rad += apart_deg.to_radians() - HallLayout::Deg120.placement_rad(1);
        *third = HallParameters {
            coupling_v_a: [2e-3, -1e-3, 0.0],
            saturation: first.saturation,
            ..HallParameters::ideal(0.8 * self.adc.reference_v, 0.0, 0.0)
        };
        self
    }

    /// The same with uneven magnets, drawn from a seed.
    #[must_use]
    pub fn with_unevenness(mut self, largest: &Unevenness, seed: u64) -> Self {
        self.magnets = largest.magnets(seed);
        self.halls = largest.halls(self.halls, self.hall_phase_rad, seed);
        self
    }

    /// The same with another number of pole pairs: torque and speed constant stay, and cogging is where such a motor
    /// has it.
    #[must_use]
    pub fn with_pole_pairs(mut self, pole_pairs: u8) -> Self {
        let ratio = f64::from(self.motor.pole_pairs) / f64::from(pole_pairs);
        self.motor.back_emf.flux_linkage_vs *= ratio;
        for cogging in &mut self.motor.cogging {
            cogging.cycles_per_turn = (f64::from(cogging.cycles_per_turn) / ratio) as u16;
        }
        self.motor.pole_pairs = pole_pairs;
        self
    }
}
