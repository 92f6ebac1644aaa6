//! Block and sinusoidal commutation side by side: torque over the angle at constant current, speed at constant command.

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::statistics::{ByAngle, ripple_pct};
use anyhow::Result;
use hallservo::commutation::block::Sextant;
use hallservo::commutation::sinusoidal::PhaseOrder;
use hallservo::commutation::{Commutation, Modulation};
use hallservo::drive::Command;
use hallservo::pwm::Limits;
use hallservo::settings::Settings;
use plant::{Cogging, InverterModel, InverterParameters, MotorParameters, Plant, PlantParameters, Shape};
use rig::{Rig, legs};
use rustfft::{FftPlanner, num_complex::Complex};
use serde::Serialize;
use std::f64::consts::TAU;

/// The figures of `commutation --json`: peak to peak over mean, in per cent.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Summary {
    /// Seed of the sensors and the noise.
    pub seed: u64,
    /// Block commutation, sinusoidal back-EMF, constant current: 14.0 in theory.
    pub block_torque_ripple_pct: f64,
    /// Sinusoidal commutation at constant current, with the calibrated Halls.
    pub sine_torque_ripple_pct: f64,
    /// Block commutation by the signs of the Halls' signals, uncalibrated, as switching Halls would do.
    pub uncalibrated_block_torque_ripple_pct: f64,
    /// Block commutation at constant command without feedback, dead time included, no cogging.
    pub block_speed_ripple_pct: f64,
    /// Sinusoidal commutation, likewise.
    pub sine_speed_ripple_pct: f64,
    /// Block commutation with cogging.
    pub block_speed_ripple_cogging_pct: f64,
    /// Sinusoidal commutation with cogging.
    pub sine_speed_ripple_cogging_pct: f64,
}

/// A run and everything to plot of it.
pub struct Run {
    /// The figures.
    pub summary: Summary,
    torque: [Vec<(f64, f64)>; 3],
    speed: [Vec<f64>; 2],
}

/// `commutation`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses its sensors.
pub fn main(common: &Common) -> Result<()> {
    common.prepare()?;
    let run = run(common.seed)?;
    println!("Block and sinusoidal commutation, constant command, no feedback (seed {}):\n", common.seed);
    print_table(&run.table());
    println!();
    common.finish("commutation", &run.summary, &run.report()?)
}

/// Measures all ripples.
///
/// # Errors
/// A drive that refuses its sensors.
pub fn run(seed: u64) -> Result<Run> {
    let block = torque(seed, Commutation::Block)?;
    let sine = torque(seed, Commutation::Sinusoidal)?;
    let raw = torque_uncalibrated(seed)?;
    let [block_speed, sine_speed] = [Commutation::Block, Commutation::Sinusoidal].map(|c| speed(seed, c, false));
    let (block_speed, sine_speed) = (block_speed?, sine_speed?);
    let ripple = |torque: &[(f64, f64)]| ripple_pct(&torque.iter().map(|p| p.1).collect::<Vec<_>>());
    let summary = Summary {
        seed,
        block_torque_ripple_pct: ripple(&block),
        sine_torque_ripple_pct: ripple(&sine),
        uncalibrated_block_torque_ripple_pct: ripple(&raw),
        block_speed_ripple_pct: ripple_pct(&block_speed),
        sine_speed_ripple_pct: ripple_pct(&sine_speed),
        block_speed_ripple_cogging_pct: ripple_pct(&speed(seed, Commutation::Block, true)?),
        sine_speed_ripple_cogging_pct: ripple_pct(&speed(seed, Commutation::Sinusoidal, true)?),
    };
    Ok(Run { summary, torque: [block, sine, raw], speed: [block_speed, sine_speed] })
}

/// The imperfect sensors on a motor whose current is the command's: no dead time, no drops, no cogging.
fn constant_current(seed: u64) -> PlantParameters {
    let imperfect = PlantParameters::imperfect(seed);
    let inverter =
        InverterParameters { model: InverterModel::Averaged { steps: 1 }, ..InverterParameters::ideal(40e3) };
    PlantParameters { motor: MotorParameters::ideal(), inverter, bus: PlantParameters::ideal().bus, ..imperfect }
}

/// Speed of the dynamometer: so slow that neither the back-EMF nor the change from step to step shows.
const DYNO_RAD_S: f64 = 0.0625 * TAU;
/// Command of the torque measurement.
const MODULATION: f64 = 0.5;

/// A rig, calibrated, armed and turned by a dynamometer.
fn armed(plant: &PlantParameters, seed: u64, commutation: Commutation) -> Result<Rig> {
    let mut rig = Rig::new(plant, &Settings { commutation, ..Settings::default() }, seed)?;
    rig.calibrate(|_| ())?;
    rig.command(Command::Arm)?;
    Ok(rig)
}

/// Mean torque in mN·m over the electrical angle, in half degrees.
fn torque(seed: u64, commutation: Commutation) -> Result<Vec<(f64, f64)>> {
    let mut rig = armed(&constant_current(seed), seed, commutation)?;
    rig.plant.set_dyno(Some(DYNO_RAD_S))?;
    rig.drive_with(MODULATION)?;
    let settle = rig.periods(0.1);
    for _ in 0..settle {
        rig.tick();
    }
    let mut by_angle = ByAngle::new(720);
    for k in 0..rig.periods(4.5) {
        let truth = rig.step().truth;
        by_angle.push(truth.electrical_angle_rad.to_degrees(), 1e3 * truth.torque_nm);
        if k % 40 == 0 {
            rig.serve();
        }
    }
    Ok(by_angle.means(1.0).collect())
}

/// The same with the six-step table switched by the signs of the signals about the data sheet's offset.
fn torque_uncalibrated(seed: u64) -> Result<Vec<(f64, f64)>> {
    // Sensors that a person has turned to where switching Halls belong, but for their placement errors: so that the
    // signs change where the field, a quarter turn ahead, is to step.
    let parameters = PlantParameters { hall_phase_rad: TAU / 12.0, ..constant_current(seed) };
    torque_by_signs(&parameters, seed)
}

/// The same with ideal Halls, at a back-EMF of this shape.
///
/// # Errors
/// A plant that refuses its parameters.
pub fn torque_by_switching_halls(shape: Shape, seed: u64) -> Result<Vec<(f64, f64)>> {
    let halls = PlantParameters::ideal().halls;
    let mut parameters = PlantParameters { hall_phase_rad: TAU / 12.0, halls, ..constant_current(seed) };
    parameters.motor.back_emf.shape = shape;
    torque_by_signs(&parameters, seed)
}

fn torque_by_signs(parameters: &PlantParameters, seed: u64) -> Result<Vec<(f64, f64)>> {
    let mut plant = Plant::new(parameters, seed)?;
    plant.set_dyno(Some(DYNO_RAD_S))?;
    let limits = Limits::new(2125, 0, 2125)?;
    let amplitude = limits.amplitude(Modulation::from_num(MODULATION));
    let mut by_angle = ByAngle::new(720);
    for k in 0..184_000 {
        let codes = plant.sample().halls;
        let truth = plant.truth();
        // From the middle of a sextant of the Halls to the field: 30° to the rotor and a quarter turn.
        let step = Sextant::of_switching_halls(codes.map(|code| code >= 2048))
            .map(|sextant| sextant.next().next().output(PhaseOrder::FORWARD, amplitude, limits.half()));
        plant.advance(&step.map_or(plant::Legs::OFF, |output| legs(&output, 2125)));
        if k > 4000 {
            by_angle.push(truth.electrical_angle_rad.to_degrees(), 1e3 * truth.torque_nm);
        }
    }
    Ok(by_angle.means(1.0).collect())
}

/// Load of the speed measurement: about 1.3 A.
const LOAD_NM: f64 = 0.04;
/// Mean speed of the speed measurement.
const SLOW_RPM: f64 = 100.0;

/// Speed in rpm, each period of a second, at the constant command that turns the load with [`SLOW_RPM`].
fn speed(seed: u64, commutation: Commutation, cogging: bool) -> Result<Vec<f64>> {
    let mut plant = PlantParameters::imperfect(seed);
    if !cogging {
        plant.motor.cogging = [Cogging::NONE; 2];
    }
    let mut rig = armed(&plant, seed, commutation)?;
    rig.drive_with(0.5)?;
    rig.plant.set_load(LOAD_NM)?;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..12 {
        let middle = (low + high) / 2.0;
        rig.drive_with(middle)?;
        record(&mut rig, 0.3);
        let rpm = record(&mut rig, 0.2);
        let mean = rpm.iter().sum::<f64>() / rpm.len() as f64;
        if mean < SLOW_RPM { low = middle } else { high = middle }
    }
    record(&mut rig, 1.0);
    Ok(record(&mut rig, 1.0))
}

/// Speed in rpm, each period of a time.
fn record(rig: &mut Rig, seconds: f64) -> Vec<f64> {
    let periods = rig.periods(seconds);
    let one = |k: u32| {
        if k.is_multiple_of(40) {
            rig.serve();
        }
        rig.step().truth.speed_rad_s * 60.0 / TAU
    };
    (0..periods).map(one).collect()
}

/// Amplitudes of the deviation from the mean, in per cent of it, over the frequency in Hz.
fn spectrum(rpm: &[f64]) -> Vec<(f64, f64)> {
    let mean = rpm.iter().sum::<f64>() / rpm.len() as f64;
    let mut bins: Vec<_> = rpm.iter().map(|x| Complex::new(100.0 * (x / mean - 1.0), 0.0)).collect();
    FftPlanner::new().plan_fft_forward(bins.len()).process(&mut bins);
    let scale = 2.0 / rpm.len() as f64;
    let hz = 40e3 / rpm.len() as f64;
    bins.iter().take(800).enumerate().map(|(k, bin)| (k as f64 * hz, bin.norm() * scale)).collect()
}

impl Run {
    fn table(&self) -> Vec<Vec<String>> {
        let s = &self.summary;
        let row = |name: &str, block: String, sine: String| vec![name.to_string(), block, sine];
        let percent = |x: f64| format!("{x:.2} %");
        vec![
            row("ripple, peak to peak over mean", "block".into(), "sinusoidal".into()),
            row("torque, constant current", percent(s.block_torque_ripple_pct), percent(s.sine_torque_ripple_pct)),
            row("    in theory", "14.03 %".into(), "0 %".into()),
            row("    by the signs of uncalibrated Halls", percent(s.uncalibrated_block_torque_ripple_pct), "".into()),
            row(
                "speed, 100 rpm, constant command",
                percent(s.block_speed_ripple_pct),
                percent(s.sine_speed_ripple_pct),
            ),
            row(
                "    with cogging",
                percent(s.block_speed_ripple_cogging_pct),
                percent(s.sine_speed_ripple_cogging_pct),
            ),
        ]
    }

    fn report(&self) -> Result<Report> {
        let mut report = Report::new("Block and sinusoidal commutation");
        report.lead(
            "Block commutation jerks six times in an electrical turn; sinusoidal commutation hardly at all. That is \
             what an exact angle is good for.",
        );
        report.text(
            "The paper's motor with imperfect Halls, calibrated by the drive. Torque: turned slowly by a dynamometer \
             at a constant command, an ideal inverter. Speed: turning a load of 40 mN·m with 100 rpm at a constant \
             command without feedback, with dead time.",
        );
        let [block, sine, raw] = self.torque.clone();
        let torque =
            [Series::new("block", block), Series::new("sinusoidal", sine), Series::new("block, uncalibrated", raw)];
        report.plot(
            &Plot::new("Torque over the angle", "electrical angle / °", "torque / mN·m", torque.to_vec()),
            "Within each sixth of a turn the torque of a step falls to cos 30° at its edges.",
        )?;
        for (plot, caption) in self.speed_plots() {
            report.plot(&plot, caption)?;
        }
        report.heading("Figures").table(&self.table());
        Ok(report)
    }

    /// Fig. 10 of the paper: the deviation from the mean speed, and its spectrum.
    pub fn speed_plots(&self) -> [(Plot, &'static str); 2] {
        let deviation = |name: &str, rpm: &[f64]| {
            let mean = rpm.iter().sum::<f64>() / rpm.len() as f64;
            Series::new(
                name,
                rpm.iter().take(8000).enumerate().map(|(k, x)| (k as f64 / 40.0, 100.0 * (x / mean - 1.0))),
            )
        };
        let speed = vec![deviation("block", &self.speed[0]), deviation("sinusoidal", &self.speed[1])];
        let [block, sine] = self.spectra();
        let spectra = vec![Series::new("block", block), Series::new("sinusoidal", sine)];
        [
            (
                Plot::new("Deviation from the mean speed", "time / ms", "deviation / %", speed),
                "As in Fig. 10(a) of Simpkins and Todorov.",
            ),
            (
                Plot::new("Spectrum of the speed", "frequency / Hz", "amplitude / % of the mean", spectra),
                "As in Fig. 10(b): block commutation has lines at multiples of six times the electrical frequency.",
            ),
        ]
    }

    /// Spectra of the speed, block and sinusoidal: amplitude in per cent of the mean over Hz.
    pub fn spectra(&self) -> [Vec<(f64, f64)>; 2] {
        self.speed.each_ref().map(|rpm| spectrum(rpm))
    }
}
