//! The motor, its sensors and supply, and what a script does to them.

use crate::analog::VDDA;
use crate::board::Net;
use crate::disturbance::HallFault;
use plant::heads::{BITS, Encoder};
use plant::{Error, Noise, Plant, PlantParameters, Switch, Truth};

/// Longest step of the simulation, s: a quarter of a period at 20 kHz.
const LONGEST_S: f64 = 12.5e-6;

/// Motor and wiring.
#[derive(Clone, Debug)]
pub struct Motor {
    /// The physics.
    pub plant: Plant,
    at_s: f64,
    switches: [Switch; 3],
    halls_v: [f64; 3],
    halls_at_s: f64,
    faults: [HallFault; 3],
    stuck_v: [f64; 3],
    /// Sensor at each of the three wires.
    wires: [usize; 3],
    /// The rings on its shaft.
    pub encoder: Option<Encoder>,
    /// Currents through shorts, A.
    pub shorts_a: [f64; 3],
    noise: Noise,
    /// Standard deviation of the noise at the converter, V: of currents and of the bus.
    noise_v: [f64; 2],
}

impl Motor {
    /// At rest.
    ///
    /// # Errors
    /// What is wrong with the parameters.
    pub fn new(parameters: &PlantParameters, seed: u64) -> Result<Self, Error> {
        Ok(Self {
            plant: Plant::new(parameters, seed)?,
            at_s: 0.0,
            switches: [Switch::Neither; 3],
            halls_v: [0.0; 3],
            halls_at_s: -1.0,
            faults: [HallFault::Good; 3],
            stuck_v: [0.0; 3],
            wires: [0, 1, 2],
            encoder: None,
            shorts_a: [0.0; 3],
            noise: Noise::new(seed ^ 0x5eed),
            noise_v: [parameters.current_sense.noise_v, parameters.bus_sense.noise_v],
        })
    }

    /// Brings the motor to this time with the switches as they were.
    pub fn advance(&mut self, now_s: f64) {
        let mut left_s = now_s - self.at_s;
        while left_s > 0.0 {
            let span_s = left_s.min(LONGEST_S);
            self.plant.conduct(self.switches, span_s);
            left_s -= span_s;
        }
        self.at_s = self.at_s.max(now_s);
    }

    /// Switches from now on.
    pub fn set_switches(&mut self, switches: [Switch; 3], now_s: f64) {
        if switches != self.switches {
            self.advance(now_s);
            self.switches = switches;
        }
    }

    /// A resistor across the bus from now on, Ω, or none.
    pub fn set_brake(&mut self, ohm: Option<f64>, now_s: f64) {
        self.advance(now_s);
        self.plant.set_brake(ohm).expect("its resistance was checked with the board");
    }

    /// Current up through the shunt of a phase: it flows while the low side conducts, or its diode does.
    pub fn shunt_a(&self, phase: usize) -> f64 {
        let current = self.plant.currents_a()[phase] + self.shorts_a[phase];
        match self.switches[phase] {
            Switch::Low => current,
            Switch::High => 0.0,
            Switch::Neither => current.max(0.0),
        }
    }

    /// Voltage of a net now; the motor has been advanced.
    pub fn volts(&mut self, net: Net) -> f64 {
        let volts = match net {
            Net::Hall(wire) => self.hall_v(wire),
            Net::Shunt { phase, gain, zero } => zero + gain * self.shunt_a(phase),
            Net::Bus(share) => share * self.plant.bus_v(),
            Net::Ntc(ohm) => VDDA * ohm / (ohm + 10_000.0),
            Net::Potentiometer => 0.5 * VDDA,
            Net::Head(ring, head) => self.head_v(ring, head),
        };
        volts.clamp(-0.3, VDDA + 0.3)
    }

    /// Fresh noise of what is sampled, V; the Hall sensors have brought their own. `None` is an op-amp's output.
    pub fn noise_v(&mut self, net: Option<Net>) -> f64 {
        match net {
            None | Some(Net::Shunt { .. }) => self.noise.scaled(self.noise_v[0]),
            Some(Net::Bus(_)) => self.noise.scaled(self.noise_v[1]),
            Some(Net::Hall(_) | Net::Ntc(_) | Net::Potentiometer | Net::Head(..)) => 0.0,
        }
    }

    /// Middle of the code that the head shows, so that the converter reads that.
    fn head_v(&mut self, ring: usize, head: usize) -> f64 {
        let shaft_rad = self.plant.truth().mechanical_angle_rad;
        let code = self.encoder.as_mut().map_or(0, |encoder| encoder.read(shaft_rad)[ring][head]);
        (f64::from(code) + 0.5) / f64::from(1 << BITS) * VDDA
    }

    fn hall_v(&mut self, wire: usize) -> f64 {
        if self.halls_at_s != self.at_s {
            self.halls_v = self.plant.hall_volts();
            self.halls_at_s = self.at_s;
        }
        match self.faults[wire] {
            HallFault::Good => self.halls_v[self.wires[wire]],
            HallFault::Open | HallFault::Ground => 0.0,
            HallFault::Supply => VDDA,
            HallFault::Stuck => self.stuck_v[wire],
        }
    }

    /// A brake holds the shaft at an angle, or lets it go.
    pub fn hold(&mut self, angle_rad: Option<f64>) -> Result<(), Error> {
        if let Some(angle_rad) = angle_rad {
            self.plant.place(angle_rad, 0.0)?;
        }
        self.plant.set_dyno(angle_rad.map(|_| 0.0))
    }

    /// Breaks or mends a wire.
    pub fn set_hall_fault(&mut self, wire: usize, fault: HallFault) {
        self.stuck_v[wire] = self.hall_v(wire);
        self.faults[wire] = fault;
    }

    /// Exchanges two wires.
    pub fn swap_halls(&mut self, a: usize, b: usize) {
        self.wires.swap(a, b);
    }

    /// The state of things.
    pub fn truth(&self) -> Truth {
        self.plant.truth()
    }
}
