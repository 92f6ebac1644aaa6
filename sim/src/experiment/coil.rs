//! The field of the windings in the Halls' signals: what it turns the angle by, as the drive measures it, and the tracked
//! angle before and after.

use super::OfMotors;
use crate::report::{Report, print_table};
use crate::statistics::Statistics;
use anyhow::{Context, Result, anyhow, bail};
use hallservo::angle::Position;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Setup, State, Trigger};
use hallservo::service::coil::{BEFORE, Plan, ROWS, Row, STEPS, field};
use hallservo::service::identify::Estimate;
use hallservo::settings::{Control, Settings};
use plant::PlantParameters;
use rayon::prelude::*;
use rig::commissioning::{Bench, commission};
use rig::motors::{MOTORS, Motor, with_windings};
use rig::{Rig, error_deg};
use serde::Serialize;
use std::f64::consts::TAU;

/// Fields of the windings at the largest current, relative to the magnets'.
pub const SHARES: [f64; 4] = [0.0, 0.02, 0.05, 0.1];
/// Speed at which a load is turned, turns a second.
const LOADED_HZ: f64 = 1.0;

/// Electrical degrees an ampere by which a current along q turns the Halls' angle, in the mean over a turn.
pub fn true_deg_a(plant: &PlantParameters) -> f64 {
    // What a Hall sees of a current vector in the direction x is a · sin(x − φ − ψ) + …; the mean of the three by their
    // own magnets' sine is what turns the angle.
    let third = TAU / 3.0;
    let sum: f64 = plant
        .halls
        .iter()
        .map(|hall| {
            let away = -plant.hall_phase_rad - hall.placement_rad;
            let own: f64 = hall
                .coupling_v_a
                .iter()
                .zip(0_u8..)
                .map(|(volts, k)| volts * (f64::from(k) * third + away).sin())
                .sum();
            own / hall.amplitude_v
        })
        .sum();
    (sum / 3.0).to_degrees()
}

/// Measures it with steps of the torque, as `hallctl coil-field` does.
///
/// # Errors
/// A drive that refuses.
pub fn measure(rig: &mut Rig) -> Result<Estimate> {
    let plan = Plan::new(rig.control()?);
    let pole_pairs = f64::from(rig.config.pole_pairs.get());
    arm(rig)?;
    let begun = rig.drive.tracker().position().to_turns();
    let mut recordings = Vec::new();
    for step in 0..STEPS {
        if plan.is_light {
            let place = begun + plan.place(step);
            rig.command(Command::Position(Position::from_bits((place * 4_294_967_296.0) as i64)))?;
            rig.wait(0.15);
        }
        rig.command(Command::Current(rig.control()?.current(0.0)?))?;
        recordings.push(record(rig, plan.step_a(step), pole_pairs)?);
        // What a line takes to end it.
        rig.wait(0.01);
        let end = if plan.is_light {
            Command::Speed(rig.control()?.speed(0.0)?)
        } else {
            Command::Current(rig.control()?.current(0.0)?)
        };
        rig.command(end)?;
        rig.wait(0.1);
    }
    rig.command(Command::Disarm)?;
    rig.wait(0.1);
    field(&recordings.iter().map(Vec::as_slice).collect::<Vec<_>>()).context("the recordings tell nothing")
}

/// Records a step.
fn record(rig: &mut Rig, size_a: f32, pole_pairs: f64) -> Result<Vec<Row>> {
    let channels = [Some(Channel::Position), Some(Channel::CurrentQ), None, None];
    let setup = Setup { channels, every: 1, rows: ROWS as u16, before: BEFORE, trigger: Trigger::Command };
    let step_hz = 1.0 / rig.period_s();
    let plan = setup.plan(&rig.config, step_hz as f32, 0).map_err(|error| anyhow!("{error}"))?;
    rig.scope.begin(&plan).map_err(|_| anyhow!("the scope is busy"))?;
    rig.wait(0.003);
    rig.scope.commanded();
    rig.command(Command::Current(rig.control()?.current(size_a)?))?;
    rig.wait(0.003);
    if rig.scope.state() != State::Done {
        bail!("the recording is not complete");
    }
    let scale = |channel: Channel| channel.scale(&rig.config, step_hz as f32).context("a drive with currents");
    let (turns, amperes) = (scale(Channel::Position)?, scale(Channel::CurrentQ)?);
    let first = rig.scope.row(0).context("a row")?[0];
    (0..ROWS as u16)
        .map(|k| {
            let [position, current, ..] = rig.scope.row(k).context("a row")?;
            Ok(Row {
                time_s: ((f64::from(k) - f64::from(BEFORE)) / step_hz) as f32,
                angle_deg: position.wrapping_sub(first) as f32 * turns * 360.0 * pole_pairs as f32,
                current_a: current as f32 * amperes,
            })
        })
        .collect()
}

fn arm(rig: &mut Rig) -> Result<()> {
    if rig.drive.mode() != Mode::Running {
        rig.command(Command::Commutate(Commutation::FieldOriented))?;
        rig.arm()?;
    }
    Ok(())
}

/// Error of the tracked angle, electrical degrees.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Errors {
    /// Turned slowly with seven tenths of the largest current, either way: RMS.
    pub loaded_deg: f64,
    /// While four fifths of the largest torque act to and fro: RMS.
    pub torque_deg: f64,
}

/// Of a drive that is calibrated; its bridge is off then.
///
/// # Errors
/// A drive that refuses.
pub fn errors(rig: &mut Rig, torque_nm: f64, inertia_kgm2: f64) -> Result<Errors> {
    arm(rig)?;
    let error = |rig: &Rig, true_rad: f64| error_deg(rig.drive.tracker().angle(), true_rad);
    let largest_a = rig.control()?.largest_current_a();
    let mut loaded = Statistics::default();
    for side in [1.0, -1.0] {
        rig.plant.set_dyno(Some(side * LOADED_HZ * TAU)).map_err(|error| anyhow!("{error}"))?;
        rig.command(Command::Current(rig.control()?.current(0.7 * side as f32 * largest_a)?)).context("load")?;
        rig.wait(0.1);
        rig.run(0.5 / LOADED_HZ, |rig, period| loaded.push(error(rig, period.truth.electrical_angle_rad)));
        rig.command(Command::Current(rig.control()?.current(0.0)?)).context("unload")?;
        rig.wait(0.02);
    }
    rig.plant.set_dyno(None).map_err(|error| anyhow!("{error}"))?;
    rig.command(Command::Speed(rig.control()?.speed(0.0)?)).context("free")?;
    rig.wait(0.3);
    let mut torque = Statistics::default();
    let fast_rad_s = f64::from(rig.control()?.largest_speed_rad_s());
    let seconds = (0.3 * fast_rad_s * inertia_kgm2 / torque_nm).min(0.02);
    for k in 0..20 {
        let side_a = if k % 2 == 0 { 0.8 * largest_a } else { -0.8 * largest_a };
        rig.command(Command::Current(rig.control()?.current(side_a)?)).with_context(|| format!("torque {k}"))?;
        // About rest: half as long at first.
        let seconds = if k == 0 { 0.5 * seconds } else { seconds };
        rig.run(seconds, |rig, period| torque.push(error(rig, period.truth.electrical_angle_rad)));
    }
    rig.command(Command::Speed(rig.control()?.speed(0.0)?))?;
    rig.wait(0.3);
    rig.command(Command::Disarm)?;
    rig.wait(0.2);
    Ok(Errors { loaded_deg: loaded.rms(), torque_deg: torque.rms() })
}

/// A motor.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Its name.
    pub motor: &'static str,
    /// Field of the windings at the largest current, relative to the magnets'.
    pub share: f64,
    /// What it turns the angle by at the largest current, electrical degrees.
    pub true_deg: f64,
    /// As measured.
    pub found_deg: f64,
    /// What that may be off by.
    pub error_deg: f64,
    /// As commissioned.
    pub before: Errors,
    /// With the field compensated.
    pub after: Errors,
}

/// Commissions a motor, measures the field of its windings, and compensates it.
///
/// # Errors
/// A drive that refuses.
pub fn trial(motor: &Motor, share: f64, seed: u64) -> Result<Trial> {
    let limit_a = f64::from(motor.limit_a);
    let plant = with_windings(motor.plant(seed), share, limit_a, seed);
    let torque_nm = 1.5 * f64::from(motor.pairs) * motor.flux_vs * limit_a;
    let mut bench = Bench::new(Rig::new(&plant, &motor.settings(), seed)?);
    let outcome = commission(&mut bench, motor.settings(), motor.limit_a).map_err(|why| anyhow!(why))?;
    let mut rig = bench.rig;
    let before = errors(&mut rig, torque_nm, motor.inertia_kgm2).context("as commissioned")?;
    let found = measure(&mut rig).context("measuring")?;
    let hall_coil_deg_a = if found.value.abs() > found.error { found.value } else { 0.0 };
    let control = outcome.settings.control.map(|control| Control { hall_coil_deg_a, ..control });
    rig.configure(&Settings { control, ..outcome.settings })?;
    let after = errors(&mut rig, torque_nm, motor.inertia_kgm2).context("compensated")?;
    Ok(Trial {
        motor: motor.name,
        share,
        true_deg: true_deg_a(&plant) * limit_a,
        found_deg: f64::from(found.value) * limit_a,
        error_deg: f64::from(found.error) * limit_a,
        before,
        after,
    })
}

impl Trial {
    fn row(&self) -> Vec<String> {
        let degrees = |value: f64| format!("{value:.2}°");
        vec![
            self.motor.into(),
            format!("{} %", 100.0 * self.share),
            degrees(self.true_deg),
            format!("{:.2} ± {:.2}°", self.found_deg, self.error_deg),
            degrees(self.before.loaded_deg),
            degrees(self.after.loaded_deg),
            degrees(self.before.torque_deg),
            degrees(self.after.torque_deg),
        ]
    }
}

/// `coil`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses.
pub fn main(options: &OfMotors) -> Result<()> {
    options.common.prepare()?;
    let chosen = MOTORS.iter().filter(|motor| options.has(motor));
    let jobs: Vec<_> = chosen.flat_map(|motor| SHARES.map(|share| (motor, share))).collect();
    let trials: Vec<Result<Trial>> = jobs
        .par_iter()
        .map(|&(motor, share)| {
            trial(motor, share, options.common.seed).with_context(|| format!("{} at {share}", motor.name))
        })
        .collect();
    println!(
        "What the field of the windings turns the Halls' angle by at the largest current, and error of the tracked angle, \
              electrical degrees RMS:\n"
    );
    let head = ["motor", "field", "turns by", "measured", "loaded", "compensated", "torques", "compensated"];
    let mut table = vec![head.map(String::from).to_vec()];
    table.extend(trials.iter().flatten().map(Trial::row));
    print_table(&table);
    println!();
    let failed: Vec<String> =
        trials.iter().filter_map(|trial| trial.as_ref().err()).map(|why| format!("{why:#}")).collect();
    failed.iter().for_each(|why| println!("No result: {why}"));
    let mut report = Report::new("The field of the windings");
    report.lead(
        "Beside the magnets, the Halls see the windings: a current along q turns the angle that they show. The drive measures \
         by how much, with short torques to and fro, and takes it off.",
    );
    report.text(
        "Motors commissioned by the drive alone. The field of the windings at the largest current, as a share of the magnets'; \
         its true effect and the measured one; the error of the tracked angle, electrical degrees RMS: turned slowly with \
         seven tenths of that current, and with four fifths of it to and fro, before and after. What is left while the torque \
         changes is the tracker's lag at that acceleration.",
    );
    report.table(&table);
    if !failed.is_empty() {
        report.text(&format!("Without a result: {}.", failed.join("; ")));
    }
    let trials: Vec<Trial> = trials.into_iter().flatten().collect();
    options.common.finish("coil", &trials, &report)
}
