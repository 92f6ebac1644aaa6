//! What the drive says of motors that it commissions, and whether that is true: each value with its ± beside the motor.

use super::Common;
use crate::report::{Report, print_table};
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::service::identify::Estimate;
use plant::{AmplifierFault, InverterModel, Noise, PlantParameters, Unevenness};
use rayon::prelude::*;
use rig::Rig;
use rig::commissioning::{Bench, Outcome, commission};
use rig::motors::{MOTORS, Motor};
use serde::Serialize;
use std::f64::consts::TAU;

/// What data sheets of a board's parts allow: shunts of one reel, resistors of an amplifier, those of the bus divider.
const SHUNTS: f64 = 0.01;
const AMPLIFIER: f64 = 0.01;
const DIVIDER: f64 = 0.02;
/// By how much the dead time, the switches and the supply differ from what the drive is told or the list says.
const DEAD_TIME: f64 = 0.3;
const SWITCHES: f64 = 0.5;
const SUPPLY: f64 = 0.1;
/// By how much a motor differs from the one of the list, as a share.
const MOTOR: f64 = 0.3;

/// Which motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Motors {
    /// Around those of the list.
    List,
    /// Any: every number of the motor drawn for itself.
    Any,
}

/// A motor, and what is wrong with everything around it.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    case: Motor,
    /// The physics.
    pub plant: PlantParameters,
    /// Gain of each phase's current sensing, relative.
    pub amplifiers: [f64; 3],
    seed: u64,
}

impl Machine {
    /// The machine of a seed, its magnets at most that uneven.
    pub fn new(seed: u64, motors: Motors, unevenness: &Unevenness) -> Self {
        let case = match motors {
            Motors::List => MOTORS[(seed % MOTORS.len() as u64) as usize],
            Motors::Any => any(seed),
        };
        let mut random = Noise::new(seed.wrapping_mul(0xD134_2543_DE82_EF95));
        let mut around = |share: f64| 1.0 + share * random.uniform();
        let unevenness = Unevenness { rated_a: case.limit_a.into(), ..*unevenness };
        let mut plant = case.plant(seed).with_unevenness(&unevenness, seed);
        let motor = &mut plant.motor;
        motor.resistance_ohm *= around(MOTOR);
        motor.inductance_h *= around(MOTOR);
        motor.back_emf.flux_linkage_vs *= around(MOTOR);
        motor.inertia_kgm2 *= around(MOTOR);
        let (friction, cogging) = (around(0.8), around(0.8));
        motor.friction.coulomb_nm *= friction;
        motor.friction.breakaway_nm *= friction;
        motor.friction.viscous_nms *= friction * around(0.8);
        motor.cogging[0].amplitude_nm *= cogging;
        plant.inverter.dead_time_s *= around(DEAD_TIME);
        plant.inverter.switch_ohm *= around(SWITCHES);
        plant.bus.supply_v *= around(SUPPLY);
        plant.bus_sense.gain *= around(DIVIDER);
        let shunts = around(SHUNTS);
        let amplifiers = [(); 3].map(|()| shunts * around(AMPLIFIER));
        Self { case, plant, amplifiers, seed }
    }

    /// Commissions it.
    ///
    /// # Errors
    /// The step that failed, and why.
    pub fn outcome(&self, model: Option<InverterModel>) -> Result<Outcome, String> {
        let case = &self.case;
        let settings = case.settings();
        let mut plant = self.plant;
        plant.inverter.model = model.unwrap_or(plant.inverter.model);
        let mut rig = Rig::new(&plant, &settings, self.seed).map_err(|error| error.to_string())?;
        for (leg, gain) in self.amplifiers.into_iter().enumerate() {
            rig.plant.set_amplifier_fault(leg, Some(AmplifierFault::Gain(gain))).map_err(|error| error.to_string())?;
        }
        commission(&mut Bench::new(rig), settings, case.limit_a)
    }

    /// Everything that a ± belongs to.
    ///
    /// # Errors
    /// The identification does not determine the motor.
    pub fn compared(&self, outcome: &Outcome) -> Result<[Compared; QUANTITIES.len()], String> {
        let PlantParameters { motor, inverter, .. } = &self.plant;
        let flux = motor.back_emf.flux_linkage_vs;
        let resistance = motor.resistance_ohm + inverter.switch_ohm;
        let Outcome { electrical, report, .. } = outcome;
        let report = report.ok_or("identification: the measurements do not determine the result")?;
        Ok([
            (electrical.resistance_ohm, resistance),
            (electrical.inductance_h, motor.inductance_h),
            (report.resistance_ohm, resistance),
            (report.inductance_h, motor.inductance_h),
            (report.flux_linkage_wb, flux),
            (report.inertia_kgm2, motor.inertia_kgm2),
            (report.coulomb_nm, motor.friction.coulomb_nm),
            (report.viscous_nms, motor.friction.viscous_nms),
            (report.load_nm, motor.load_nm),
        ]
        .map(|(Estimate { value, error }, exact)| Compared {
            found: value.into(),
            stated: error.into(),
            exact,
        }))
    }
}

/// A motor of which every number is drawn for itself, evenly in its logarithm: from resistance, supply and the speed without
/// a load follows what current it takes, from that and a time to speed up its inertia.
pub(super) fn any(seed: u64) -> Motor {
    let mut random = Noise::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xA11);
    let mut between = |least: f64, most: f64| least * (most / least).powf(0.5 + 0.5 * random.uniform());
    let bus_v = between(12.0, 28.0);
    let ohm = between(0.02, 20.0);
    let henry = (ohm * between(80e-6, 2e-3)).clamp(8e-6, 10e-3);
    let pairs = between(1.0, 22.99).floor();
    let idle_hz = between(60.0, 1500.0);
    let flux_vs = bus_v / 3_f64.sqrt() / (TAU * idle_hz);
    let full_scale_a: f64 = [8.25, 16.0, 32.0, 60.0][between(1.0, 4.99) as usize - 1];
    let limit_a = (between(0.05, 0.6) * bus_v / (2.0 * ohm)).clamp(0.02 * full_scale_a, 0.6 * full_scale_a);
    let torque_nm = 1.5 * pairs * flux_vs * limit_a;
    let inertia_kgm2 = torque_nm * between(0.01, 3.0) / (0.5 * TAU * idle_hz / pairs);
    Motor {
        name: "any",
        ohm,
        henry,
        flux_vs,
        inertia_kgm2,
        pairs: pairs as u8,
        limit_a: limit_a as f32,
        full_scale_a: full_scale_a as f32,
        bus_v,
        dead_time_s: between(0.3e-6, 1e-6) as f32,
        friction: between(0.002, 0.1),
        cogging: between(0.002, 0.08),
    }
}

/// What is compared: at standstill, then by the identification.
pub const QUANTITIES: [&str; 9] = [
    "R at standstill",
    "L at standstill",
    "R",
    "L",
    "flux linkage",
    "inertia",
    "Coulomb friction",
    "viscous friction",
    "load",
];

/// A value that was found, its ±, and what is true.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Compared {
    /// As found.
    pub found: f64,
    /// What that may be off by.
    pub stated: f64,
    /// The motor's.
    pub exact: f64,
}

impl Compared {
    /// By how much it is off, as a share of what it may be off by.
    pub fn off(&self) -> f64 {
        (self.found - self.exact).abs() / self.stated
    }
}

/// A machine that was commissioned, or why not.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Motor of the list.
    pub name: &'static str,
    /// Everything random.
    pub seed: u64,
    /// Each of [`QUANTITIES`].
    pub compared: Result<[Compared; QUANTITIES.len()], String>,
}

/// Commissions machines; the inverter as the plant of the list has it, or by another `model`.
pub fn trials(
    seeds: std::ops::Range<u64>,
    motors: Motors,
    unevenness: &Unevenness,
    model: Option<InverterModel>,
) -> Vec<Trial> {
    let trial = |seed| {
        let machine = Machine::new(seed, motors, unevenness);
        let compared = machine.outcome(model).and_then(|outcome| machine.compared(&outcome));
        Trial { name: machine.case.name, seed, compared }
    };
    seeds.into_par_iter().map(trial).collect()
}

/// Share of the machines whose true value of a quantity is within ±.
pub fn inside(trials: &[Trial], quantity: usize) -> f64 {
    let found = || trials.iter().filter_map(|trial| trial.compared.as_ref().ok());
    let inside = found().filter(|compared| compared[quantity].off() <= 1.0).count();
    inside as f64 / found().count() as f64
}

/// The row of a quantity.
fn row(trials: &[Trial], quantity: usize) -> Vec<String> {
    let found = || trials.iter().filter_map(|trial| trial.compared.as_ref().ok()).map(|compared| compared[quantity]);
    let relative = |share: fn(&Compared) -> f64| {
        let mut shares: Vec<f64> = found().map(|compared| share(&compared) / compared.exact).collect();
        shares.sort_by(f64::total_cmp);
        let at = |part: f64| 100.0 * shares[((shares.len() - 1) as f64 * part) as usize];
        if !shares.is_empty() && shares.iter().all(|share| share.is_finite()) {
            format!("{:.1} ({:.1})", at(0.5), at(1.0))
        } else {
            "–".into()
        }
    };
    let off: Statistics = found().map(|compared| compared.off()).collect();
    vec![
        QUANTITIES[quantity].into(),
        format!("{:.1} %", 100.0 * inside(trials, quantity)),
        relative(|compared| (compared.found - compared.exact).abs()),
        relative(|compared| compared.stated),
        format!("{:.1}", off.max_abs()),
    ]
}

/// Options of `identify`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Machines
    #[arg(long, default_value_t = 200)]
    machines: u64,
    /// Around the motors of the list, or any
    #[arg(long, value_enum, default_value_t = Motors::List)]
    motors: Motors,
    /// With all poles alike
    #[arg(long)]
    even: bool,
    /// Every edge of the inverter at its instant, instead of means over a period; some thirty times slower
    #[arg(long)]
    switched: bool,
    /// Print each machine
    #[arg(long)]
    each: bool,
}

/// `identify`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let unevenness = if options.even { Unevenness::NONE } else { Unevenness::CHEAP };
    let model = options.switched.then_some(InverterModel::Switched);
    let seeds = options.common.seed..options.common.seed + options.machines;
    let trials = trials(seeds, options.motors, &unevenness, model);
    for trial in &trials {
        match &trial.compared {
            Ok(compared) if options.each => {
                let off = compared.map(|compared| {
                    let share = |x: f64| 100.0 * x / compared.exact;
                    let (off, stated) = (share(compared.found - compared.exact), share(compared.stated));
                    format!("{}{off:+6.1}±{stated:4.1}", if compared.off() > 1.0 { "!" } else { " " })
                });
                println!("{:14} {:4} {}", trial.name, trial.seed, off.join(" "));
            }
            Ok(_) => {}
            Err(error) => {
                println!("{} {}: {error}", trial.name, trial.seed);
                if options.each && options.motors == Motors::Any {
                    println!("  {:?}", any(trial.seed));
                }
            }
        }
    }
    let head = ["", "within ±", "off by / %", "± / %", "off by at most / ±"].map(String::from).to_vec();
    let table: Vec<_> =
        std::iter::once(head).chain((0..QUANTITIES.len()).map(|quantity| row(&trials, quantity))).collect();
    print_table(&table);
    let refused = trials.iter().filter(|trial| trial.compared.is_err()).count();
    println!("\n{} machines, {refused} of them refused.", trials.len());
    let mut report = Report::new("Is the ± true?");
    report.lead(
        "Motors of every impedance on boards whose amplifiers, bus divider and dead time are not what the drive is \
         told, commissioned: what was found, beside what is.",
    );
    report.table(&table);
    options.common.finish("identify", &trials, &report)
}
