//! Lets happen to a simulated drive what befalls it, and mends it again.

use super::dice::Dice;
use super::disturbance::{Disturbance, torque_nm};
use super::scenario::{Scenario, Temper};
use anyhow::{Result, anyhow};
use hallservo::board::Sample;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use plant::{HallFault, PlantParameters, Rail};
use simulator::Simulator;
use std::cell::Cell;
use std::f64::consts::TAU;
use std::rc::Rc;

/// What goes on for a while, until so many ms.
#[derive(Clone, Copy, Debug, Default)]
struct Passing {
    shock: Option<(f64, u64)>,
    shake: Option<(f64, f64, u64)>,
    held_until: Option<u64>,
    dip_until: Option<u64>,
    loose: Option<(usize, u64)>,
}

/// Share of the motor's largest torque from which on a load drives the shaft rather than the motor.
const DRIVES: f64 = 0.3;

/// What has happened.
pub(super) struct World {
    parameters: PlantParameters,
    /// Of the motor's largest current.
    torque_nm: f64,
    /// A holding brake takes the load while the bridge is off or is being checked.
    has_brake: bool,
    /// Nor does a shock make it faster.
    is_gentle: bool,
    /// A load drives it up to here.
    fastest_rad_s: f64,
    dice: Dice,
    load_nm: f64,
    passing: Passing,
    /// The converter's reference, as a share of what it is to be.
    reference: Rc<Cell<f64>>,
    /// Whether something outside has turned the shaft, and when that ended, ms.
    pub driven_ms: u64,
    /// Whether the shaft was seized or taken along at once, and when, ms: a voltage that leaps is no control's fault.
    pub leapt_ms: Option<u64>,
    /// Whether a part that measures or carries currents has broken.
    pub blind: bool,
    /// Whether anything has broken.
    pub broken: bool,
}

impl World {
    pub fn new(scenario: &Scenario) -> Self {
        let mut dice = Dice::new(scenario.seed, 5);
        let fastest = if scenario.temper == Temper::Calm { 0.9 } else { dice.within(0.5, 1.5) };
        Self {
            parameters: scenario.plant,
            torque_nm: torque_nm(&scenario.motor),
            fastest_rad_s: fastest
                * scenario.settings.control.map_or(0.0, |control| f64::from(control.max_speed_rad_s)),
            is_gentle: scenario.temper == Temper::Calm,
            has_brake: scenario.temper == Temper::Calm || dice.chance(0.5),
            dice,
            load_nm: 0.0,
            passing: Passing::default(),
            reference: Rc::new(Cell::new(1.0)),
            driven_ms: 0,
            leapt_ms: None,
            blind: false,
            broken: false,
        }
    }

    /// What the converter's reference makes of a sample; the amplifiers' middle is a half of it.
    pub fn converter(&self) -> impl Fn(&mut Sample) + use<> {
        let reference = self.reference.clone();
        move |sample| {
            let times = 1.0 / reference.get();
            if times != 1.0 {
                let about =
                    |code: u16, middle: f64| (middle + times * (f64::from(code) - middle)).clamp(0.0, 4095.0) as u16;
                sample.halls = sample.halls.map(|code| about(code, 0.0));
                sample.currents = sample.currents.map(|code| about(code, 2048.0));
                sample.bus = about(sample.bus, 0.0);
            }
        }
    }

    /// It happens now.
    pub fn happen(&mut self, what: Disturbance, drive: &mut Simulator) -> Result<()> {
        let (now_ms, plant) = (drive.now_ms(), &mut drive.plant);
        let after = |ms: u32| now_ms + u64::from(ms);
        let supply_v = self.parameters.bus.supply_v;
        match what {
            Disturbance::Load(nm) => self.load_nm = nm,
            Disturbance::Shock(nm, ms) => self.passing.shock = Some((nm, after(ms))),
            Disturbance::Shake(nm, hz, ms) => self.passing.shake = Some((nm, hz, after(ms))),
            Disturbance::Inertia(times) => plant.set_inertia(times * self.parameters.motor.inertia_kgm2)?,
            Disturbance::Seize(ms) => {
                plant.set_dyno(Some(0.0))?;
                self.leapt_ms = Some(now_ms);
                self.passing.held_until = Some(after(ms));
            }
            Disturbance::Turn(share, ms) => {
                let motor = &self.parameters.motor;
                let idle_rad_s = supply_v / 3_f64.sqrt() / motor.back_emf.flux_linkage_vs / f64::from(motor.pole_pairs);
                plant.set_dyno(Some(share * idle_rad_s))?;
                self.leapt_ms = Some(now_ms);
                self.passing.held_until = Some(after(ms));
            }
            Disturbance::Warm(celsius) => plant.set_temperature(celsius)?,
            Disturbance::Dip(share, ms) => {
                plant.set_supply(share * supply_v)?;
                self.passing.dip_until = Some(after(ms));
            }
            Disturbance::Supply(share) => plant.set_supply(share * supply_v)?,
            breakage => return self.break_down(breakage, drive),
        }
        Ok(())
    }

    fn break_down(&mut self, what: Disturbance, drive: &mut Simulator) -> Result<()> {
        let now_ms = drive.now_ms();
        let plant = &mut drive.plant;
        self.broken = true;
        self.blind |= matches!(
            what,
            Disturbance::Amplifier(..) | Disturbance::Open(_) | Disturbance::Dead(..) | Disturbance::Reference(_)
        );
        match what {
            Disturbance::Hall(hall, fault) => plant.set_hall_fault(hall, Some(fault)),
            Disturbance::LooseHall(hall, ms) => self.passing.loose = Some((hall, now_ms + u64::from(ms))),
            Disturbance::Reference(times) => self.reference.set(times),
            Disturbance::Amplifier(leg, fault) => plant.set_amplifier_fault(leg, Some(fault))?,
            Disturbance::Open(winding) => plant.set_phase_open(winding, true),
            Disturbance::Dead(leg, transistor) => plant.set_dead_transistor(leg, Some(transistor)),
            Disturbance::Slip(degrees) => plant.set_slip(degrees.to_radians())?,
            other => return Err(anyhow!("{other:?} breaks nothing")),
        }
        Ok(())
    }

    /// A millisecond has passed.
    pub fn pass(&mut self, drive: &mut Simulator) -> Result<()> {
        let now_ms = drive.now_ms();
        let over = |until: u64| now_ms >= until;
        let passing = &mut self.passing;
        // What drives a shaft drives it up to a speed: a rotor that is switched off is not to burst.
        let speed = drive.plant.truth().speed_rad_s;
        let fading = |load_nm: f64| {
            let driving = (-load_nm.signum() * speed / self.fastest_rad_s).max(0.0);
            load_nm * (1.0 - driving).max(0.0)
        };
        let mut load_nm = fading(self.load_nm);
        let holds = drive.drive().mode() == Mode::Running && !drive.drive().limits().contains(Limits::CHECKING);
        if self.has_brake && !holds {
            load_nm = 0.0;
        }
        passing.shock = passing.shock.filter(|&(_, until)| !over(until));
        passing.shake = passing.shake.filter(|&(_, _, until)| !over(until));
        if let Some((nm, _)) = passing.shock {
            load_nm += if self.is_gentle { fading(nm) } else { nm };
        }
        if let Some((nm, hz, _)) = passing.shake {
            load_nm += nm * (TAU * hz * 1e-3 * now_ms as f64).sin();
        }
        drive.plant.set_load(load_nm)?;
        if passing.held_until.is_some_and(over) {
            drive.plant.set_dyno(None)?;
            passing.held_until = None;
        }
        if passing.dip_until.is_some_and(over) {
            drive.plant.set_supply(self.parameters.bus.supply_v)?;
            passing.dip_until = None;
        }
        if let Some((hall, until)) = passing.loose {
            let open = !over(until) && self.dice.chance(0.5);
            drive.plant.set_hall_fault(hall, open.then_some(HallFault::Open(Rail::High)));
            passing.loose = passing.loose.filter(|_| !over(until));
        }
        if passing.held_until.is_some() || load_nm.abs() > DRIVES * self.torque_nm {
            self.driven_ms = now_ms;
        }
        Ok(())
    }

    /// All is as it was, but for the rotor.
    pub fn mend(&mut self, drive: &mut Simulator) -> Result<()> {
        let plant = &mut drive.plant;
        (self.load_nm, self.passing, self.blind) = (0.0, Passing::default(), false);
        self.reference.set(1.0);
        for one in 0..3 {
            plant.set_hall_fault(one, None);
            plant.set_amplifier_fault(one, None)?;
            plant.set_phase_open(one, false);
            plant.set_dead_transistor(one, None);
        }
        plant.set_slip(0.0)?;
        plant.set_dyno(None)?;
        plant.set_inertia(self.parameters.motor.inertia_kgm2)?;
        plant.set_temperature(25.0)?;
        Ok(plant.set_supply(self.parameters.bus.supply_v)?)
    }
}
