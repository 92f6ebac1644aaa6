//! The whole plant, one switching period at a time.

mod breakage;

use crate::adc::{Adc, SenseParameters};
use crate::averaged::{AveragedLegs, DeadTime};
use crate::bus::Bus;
use crate::error::{Error, finite};
use crate::fault::Faults;
use crate::hall::{HallFault, Halls};
use crate::inverter::{InverterModel, InverterParameters, Legs, diodes};
use crate::motor::{Motor, Slice};
use crate::noise::Noise;
use crate::parameters::PlantParameters;
use crate::phasor::wrapped;
use crate::switched::{Switch, SwitchedLegs, drawn_a};
use crate::windings::Terminal;

/// What the converter delivers at a valley.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Codes {
    /// The three Hall sensors.
    pub halls: [u16; 3],
    /// The phase currents.
    pub currents: [u16; 3],
    /// The bus voltage.
    pub bus: u16,
}

/// The state of things, which no drive gets to see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Time since the start, s.
    pub time_s: f64,
    /// Electrical angle, -π .. π.
    pub electrical_angle_rad: f64,
    /// Mechanical angle, unwrapped.
    pub mechanical_angle_rad: f64,
    /// Mechanical speed, rad/s.
    pub speed_rad_s: f64,
    /// Mechanical angle of the load, unwrapped; the rotor's where the shaft is stiff.
    pub load_angle_rad: f64,
    /// Mechanical speed of the load, rad/s.
    pub load_speed_rad_s: f64,
    /// Currents of the windings, A.
    pub currents_a: [f64; 3],
    /// Back-EMF from phase to star point, V.
    pub back_emf_v: [f64; 3],
    /// Electromagnetic torque, N·m.
    pub torque_nm: f64,
    /// Cogging torque, N·m.
    pub cogging_nm: f64,
    /// Torque of the load against positive rotation, N·m.
    pub load_nm: f64,
    /// Temperatures of copper and housing above the surroundings, K; zero where the motor does not warm.
    pub heat_k: [f64; 2],
    /// Bus voltage, V.
    pub bus_v: f64,
    /// The last step of the simulation; `None` before the first.
    pub last: Option<Slice>,
}

/// A switching period and a step of the simulation, s.
fn spans_s(inverter: &InverterParameters) -> (f64, f64) {
    let period_s = 1.0 / inverter.pwm_hz;
    match inverter.model {
        InverterModel::Averaged { steps } => (period_s, period_s / f64::from(steps)),
        InverterModel::Switched => (period_s, period_s),
    }
}

/// A motor with its inverter and sensors.
///
/// The order of use is that of the control interrupt: [`sample`](Self::sample) at the valley, then
/// [`advance`](Self::advance) with the command computed from it.
#[derive(Clone, Debug)]
pub struct Plant {
    motor: Motor,
    inverter: InverterParameters,
    inductance_h: f64,
    period_s: f64,
    step_s: f64,
    dead_time: DeadTime,
    switched: SwitchedLegs,
    bus: Bus,
    halls: Halls,
    adc: Adc,
    current_sense: SenseParameters,
    bus_sense: SenseParameters,
    noise: Noise,
    faults: Faults,
    /// Compare registers as loaded at the coming valley.
    preloaded: Legs,
    periods: u64,
    /// Time spent in [`Plant::conduct`] and in periods of another length, s.
    conducted_s: f64,
    last: Option<Slice>,
}

impl Plant {
    /// At rest at angle zero, bridge off; the noise is a function of the seed.
    ///
    /// # Errors
    /// The field of `parameters` that is out of range, and what it has to be.
    pub fn new(parameters: &PlantParameters, seed: u64) -> Result<Self, Error> {
        let inverter = parameters.inverter;
        inverter.check()?;
        let (period_s, step_s) = spans_s(&inverter);
        parameters.current_sense.check(["current_sense.gain", "current_sense.offset_v", "current_sense.noise_v"])?;
        parameters.bus_sense.check(["bus_sense.gain", "bus_sense.offset_v", "bus_sense.noise_v"])?;
        let mut plant = Self {
            motor: Motor::new(&parameters.motor, inverter.switch_ohm, step_s)?,
            inverter,
            inductance_h: parameters.motor.inductance_h,
            period_s,
            step_s,
            dead_time: DeadTime::new(&inverter, parameters.motor.inductance_h),
            switched: SwitchedLegs::new(period_s, inverter.dead_time_s),
            bus: Bus::new(&parameters.bus)?,
            halls: Halls::new(
                &parameters.halls,
                parameters.hall_phase_rad,
                &parameters.magnets,
                parameters.motor.pole_pairs,
                period_s,
            )?,
            adc: Adc::new(&parameters.adc)?,
            current_sense: parameters.current_sense,
            bus_sense: parameters.bus_sense,
            noise: Noise::new(seed),
            faults: Faults::NONE,
            preloaded: Legs::OFF,
            periods: 0,
            conducted_s: 0.0,
            last: None,
        };
        plant.put(0.0, 0.0);
        Ok(plant)
    }

    /// Length of a switching period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Another switching frequency from this valley on, Hz.
    ///
    /// # Errors
    /// The inverter cannot have it.
    pub fn set_pwm(&mut self, pwm_hz: f64) -> Result<(), Error> {
        let inverter = InverterParameters { pwm_hz, ..self.inverter };
        inverter.check()?;
        // What has passed is no number of the new periods.
        self.conducted_s += self.periods as f64 * self.period_s;
        self.periods = 0;
        self.inverter = inverter;
        (self.period_s, self.step_s) = spans_s(&inverter);
        self.dead_time = DeadTime::new(&inverter, self.inductance_h);
        self.switched = SwitchedLegs::new(self.period_s, inverter.dead_time_s);
        Ok(())
    }

    /// What the converter reads now, at the valley. Each call draws fresh noise.
    pub fn sample(&mut self) -> Codes {
        let halls = self.hall_volts();
        let mut currents = [0; 3];
        for (code, current) in currents.iter_mut().zip(self.shown_a()) {
            *code = self.adc.code(self.current_sense.volts(current, &mut self.noise));
        }
        let bus = self.bus_sense.volts(self.bus.volts, &mut self.noise);
        Codes { halls: halls.map(|volts| self.adc.code(volts)), currents, bus: self.adc.code(bus) }
    }

    /// One switching period, from valley to valley.
    ///
    /// The compare registers are preloaded: during this period the command of the call before acts,
    /// and this one's during the next. A command with the bridge not enabled acts at once; after
    /// it, the bridge stays off for one more period.
    pub fn advance(&mut self, command: &Legs) {
        self.advance_with(command, |_| {});
    }

    /// As [`advance`](Self::advance), showing each step of the simulation as it is done.
    pub fn advance_with(&mut self, command: &Legs, mut observe: impl FnMut(&Slice)) {
        let acting = if command.enabled { self.preloaded } else { Legs::OFF };
        self.preloaded = *command;
        match self.inverter.model {
            InverterModel::Averaged { steps } if !self.faults.in_bridge() => {
                self.averaged(&acting, steps, &mut observe)
            }
            _ => self.edge_by_edge(&acting, &mut observe),
        }
        self.periods += 1;
        self.motor.resync();
        self.halls.advance(self.motor.view(), &self.motor.windings.currents_a, self.period_s);
    }

    fn averaged(&mut self, legs: &Legs, steps: u8, observe: &mut impl FnMut(&Slice)) {
        let legs = AveragedLegs::new(legs, &self.dead_time, &self.currents_a(), self.bus.volts);
        for _ in 0..steps {
            let bus_v = self.bus.volts;
            let terminals = legs.terminals(&self.dead_time, &self.currents_a(), bus_v);
            let mut slice = self.step(&terminals, self.step_s);
            slice.bus_a += legs.bus_a(&self.faults.at_legs(&slice.currents_a));
            self.finish(slice, observe);
        }
    }

    fn edge_by_edge(&mut self, legs: &Legs, observe: &mut impl FnMut(&Slice)) {
        let ends_s = self.switched.start(legs);
        let mut start_s = 0.0;
        for end_s in ends_s {
            let span_s = end_s - start_s;
            if span_s <= 0.0 {
                continue;
            }
            let slice = self.switch(self.switched.switches(start_s + 0.5 * span_s), span_s);
            self.finish(slice, observe);
            start_s = end_s;
        }
    }

    /// With the switches as they are commanded.
    fn switch(&mut self, commanded: [Switch; 3], span_s: f64) -> Slice {
        let switches = self.faults.switches(commanded);
        let terminals = switches.map(|switch| switch.terminal(self.bus.volts));
        let mut slice = self.step(&terminals, span_s);
        slice.bus_a += drawn_a(&switches, &self.faults.at_legs(&slice.currents_a));
        slice
    }

    /// With the legs' terminals at these voltages.
    fn step(&mut self, at_legs: &[Terminal; 3], span_s: f64) -> Slice {
        let rails = diodes(self.bus.volts, self.inverter.diode_v);
        self.motor.step(&self.faults.at_windings(at_legs), rails, span_s)
    }

    fn finish(&mut self, slice: Slice, observe: &mut impl FnMut(&Slice)) {
        self.bus.draw(slice.bus_a, slice.span_s);
        observe(&slice);
        self.last = Some(slice);
    }

    /// A span with the switches as they are, for an inverter whose edges are known elsewhere. Spans
    /// over a quarter of a period let the rotor turn too far in one step.
    pub fn conduct(&mut self, switches: [Switch; 3], span_s: f64) {
        let slice = self.switch(switches, span_s);
        self.finish(slice, &mut |_| {});
        self.conducted_s += span_s;
        self.motor.resync();
        self.halls.advance(self.motor.view(), &self.motor.windings.currents_a, span_s);
    }

    /// Voltages of the Hall sensors' outputs now. Each call draws fresh noise.
    pub fn hall_volts(&mut self) -> [f64; 3] {
        self.faults.hall_wires.seen(&self.halls.volts(&mut self.noise))
    }

    /// Currents of the bridge's legs now, A; those of the windings are the [`truth`](Self::truth).
    #[must_use]
    pub fn currents_a(&self) -> [f64; 3] {
        self.faults.at_legs(&self.motor.windings.currents_a)
    }

    /// Currents of the legs as their amplifiers show them, A, before noise and offset.
    #[must_use]
    pub fn shown_a(&self) -> [f64; 3] {
        self.faults.shown_a(&self.currents_a())
    }

    /// Voltage of the bus now, V.
    #[must_use]
    pub fn bus_v(&self) -> f64 {
        self.bus.volts
    }

    /// Mechanical angle now, unwrapped, rad: that of the [`truth`](Self::truth) alone.
    #[must_use]
    pub fn mechanical_angle_rad(&self) -> f64 {
        self.motor.rotor.angle_rad
    }

    /// The state at this instant.
    #[must_use]
    pub fn truth(&self) -> Truth {
        Truth {
            time_s: self.periods as f64 * self.period_s + self.conducted_s,
            electrical_angle_rad: wrapped(self.motor.electrical_rad()),
            mechanical_angle_rad: self.motor.rotor.angle_rad,
            speed_rad_s: self.motor.rotor.speed_rad_s,
            load_angle_rad: self.motor.load().angle_rad,
            load_speed_rad_s: self.motor.load().speed_rad_s,
            currents_a: self.motor.windings.currents_a,
            back_emf_v: self.motor.back_emf_v(),
            torque_nm: self.motor.torque_nm(),
            cogging_nm: self.motor.cogging_nm(),
            load_nm: self.motor.load_nm,
            heat_k: self.motor.heat.as_ref().map_or([0.0; 2], |heat| [heat.copper_k, heat.housing_k]),
            bus_v: self.bus.volts,
            last: self.last,
        }
    }

    /// Puts rotor and load to a mechanical angle, moving at a speed; the Hall sensors have settled.
    ///
    /// # Errors
    /// Either is not finite.
    pub fn place(&mut self, mechanical_angle_rad: f64, speed_rad_s: f64) -> Result<(), Error> {
        finite(mechanical_angle_rad, "mechanical_angle_rad")?;
        finite(speed_rad_s, "speed_rad_s")?;
        self.put(mechanical_angle_rad, speed_rad_s);
        Ok(())
    }

    fn put(&mut self, mechanical_angle_rad: f64, speed_rad_s: f64) {
        self.motor.place(mechanical_angle_rad, speed_rad_s);
        self.motor.resync();
        self.halls.settle(self.motor.view(), &self.motor.windings.currents_a);
    }

    /// Couples a dyno that imposes a mechanical speed (0: locked rotor), or uncouples it.
    ///
    /// # Errors
    /// The speed is not finite.
    pub fn set_dyno(&mut self, speed_rad_s: Option<f64>) -> Result<(), Error> {
        finite(speed_rad_s.unwrap_or(0.0), "speed_rad_s")?;
        self.motor.rotor.imposed_rad_s = speed_rad_s;
        if let Some(speed) = speed_rad_s {
            self.motor.rotor.place(self.motor.rotor.angle_rad, speed);
        }
        Ok(())
    }

    /// Sets the inertia of the rotor, kg·m²: a mass is mounted or taken off.
    ///
    /// # Errors
    /// The inertia is not finite or not above zero.
    pub fn set_inertia(&mut self, inertia_kgm2: f64) -> Result<(), Error> {
        self.motor.rotor.set_inertia(inertia_kgm2)
    }

    /// Sets the torque of the load against positive rotation, N·m.
    ///
    /// # Errors
    /// The torque is not finite.
    pub fn set_load(&mut self, load_nm: f64) -> Result<(), Error> {
        finite(load_nm, "load_nm")?;
        self.motor.load_nm = load_nm;
        Ok(())
    }

    /// Sets the open-circuit voltage of the supply, V.
    ///
    /// # Errors
    /// The voltage is not finite or below zero.
    pub fn set_supply(&mut self, supply_v: f64) -> Result<(), Error> {
        self.bus.set_supply(supply_v)
    }

    /// Connects a brake resistor across the bus, Ω, or none, from now on.
    ///
    /// # Errors
    /// The resistance is not finite or not above zero.
    pub fn set_brake(&mut self, brake_ohm: Option<f64>) -> Result<(), Error> {
        self.bus.set_brake(brake_ohm)
    }

    /// Sets the temperature of the Hall sensors, °C; they show it from the next period on.
    ///
    /// # Errors
    /// The temperature is not finite.
    pub fn set_temperature(&mut self, celsius: f64) -> Result<(), Error> {
        finite(celsius, "celsius")?;
        self.halls.set_temperature(celsius);
        Ok(())
    }

    /// Breaks a Hall sensor (0 to 2), or mends it with `None`.
    pub fn set_hall_fault(&mut self, sensor: usize, fault: Option<HallFault>) {
        self.halls.set_fault(sensor, fault);
    }
}
