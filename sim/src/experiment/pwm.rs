//! The choice of the PWM frequency, and the current's ripple by the paper's formula, in closed form and in a
//! simulation that resolves every edge.

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use anyhow::{Result, anyhow};
use hallservo::pwm::{self, FrequencyChoice, FrequencyNeeds};
use plant::{InverterModel, InverterParameters, Leg, Legs, MotorParameters, Plant, PlantParameters};
use serde::Serialize;

/// Options of `pwm`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Resistance of a phase in ohm
    #[arg(long, default_value_t = 3.75)]
    resistance: f32,
    /// Inductance of a phase in henry
    #[arg(long, default_value_t = 0.36e-3)]
    inductance: f32,
    /// Ripple of the current wanted, in per cent of its mean
    #[arg(long, default_value_t = 5.0)]
    ripple: f32,
    /// Clock of the PWM timer in Hz
    #[arg(long, default_value_t = 170e6)]
    timer: f32,
    /// Highest switching frequency of the bridge in Hz
    #[arg(long, default_value_t = 100e3)]
    highest: f32,
    /// Dead time in seconds
    #[arg(long, default_value_t = 500e-9)]
    dead_time: f32,
}

/// The figures of `pwm --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Switching frequency chosen.
    pub pwm_hz: f32,
    /// Ripple there, of the centre-aligned current.
    pub ripple_pct: f32,
    /// Whether that is what was wanted.
    pub ripple_reached: bool,
    /// Effective resolution of the duty, eq. (19).
    pub resolution_bits: f32,
    /// Auto-reload value of the timer.
    pub period_counts: u16,
    /// Dead time in counts, rounded up.
    pub dead_time_counts: u16,
    /// Ripple over frequency.
    pub sweep: Vec<Ripple>,
}

/// Ripple at a frequency, three ways, in per cent of the mean.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Ripple {
    /// Frequency of the ripple.
    pub ripple_hz: f64,
    /// Eq. (18).
    pub formula_pct: f64,
    /// Peak to peak of an R-L circuit at half duty in the steady state: `2 tanh(R / 4Lf)`.
    pub exact_pct: f64,
    /// Peak to peak in the simulation that resolves every edge.
    pub simulated_pct: f64,
}

/// `pwm`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or needs that contradict each other.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let summary = run(options)?;
    println!("PWM for {} Ω and {} mH:\n", options.resistance, 1e3 * options.inductance);
    print_table(&summary.choice_table(options));
    println!();
    print_table(&summary.sweep_table());
    println!();
    options.common.finish("pwm", &summary, &summary.report(options)?)
}

/// Chooses and measures.
///
/// # Errors
/// Needs that contradict each other, or no motor.
pub fn run(options: &Options) -> Result<Summary> {
    let needs = FrequencyNeeds {
        resistance_ohm: options.resistance,
        inductance_h: options.inductance,
        ripple_percent: options.ripple,
        cycle_s: 1.0 / options.timer,
        least_bits: 10.0,
        highest_hz: options.highest,
        lowest_hz: 20e3,
    };
    let contradiction =
        "no PWM frequency from 20 kHz up to --highest gives 10 bits with this --timer, or a value is not positive";
    let FrequencyChoice { pwm_hz, ripple_percent, bits, reached } = needs.choose().ok_or(anyhow!(contradiction))?;
    let sweep: Result<Vec<_>> = [10e3, 20e3, 40e3, 51.8e3, 80e3, 146e3, 200e3, 518e3]
        .into_iter()
        .map(|hz| ripple(options.resistance.into(), options.inductance.into(), hz))
        .collect();
    Ok(Summary {
        pwm_hz,
        ripple_pct: ripple_percent,
        ripple_reached: reached,
        resolution_bits: bits,
        period_counts: pwm::period_counts(options.timer, pwm_hz)?,
        dead_time_counts: pwm::dead_time_counts(options.timer, pwm_hz, options.dead_time)?,
        sweep: sweep?,
    })
}

/// Ripple at a frequency, three ways.
///
/// # Errors
/// A plant that refuses its parameters.
pub fn ripple(resistance: f64, inductance: f64, hz: f64) -> Result<Ripple> {
    Ok(Ripple {
        ripple_hz: hz,
        formula_pct: pwm::ripple_percent(resistance as f32, inductance as f32, hz as f32).into(),
        exact_pct: 200.0 * (resistance / (4.0 * inductance * hz)).tanh(),
        simulated_pct: simulated(resistance, inductance, hz)?,
    })
}

/// Two phases in series at a locked rotor: one leg at half duty, one low, so that the ripple has the switching
/// frequency.
fn simulated(resistance_ohm: f64, inductance_h: f64, hz: f64) -> Result<f64> {
    let ideal = PlantParameters::ideal();
    let motor = MotorParameters { resistance_ohm, inductance_h, ..MotorParameters::ideal() };
    let inverter = InverterParameters { model: InverterModel::Switched, ..InverterParameters::ideal(hz) };
    let parameters = PlantParameters { motor, inverter, ..ideal };
    let mut plant = Plant::new(&parameters, 1)?;
    plant.set_dyno(Some(0.0))?;
    let legs = Legs::new([Leg::Pwm(0.5), Leg::Pwm(0.0), Leg::Open]);
    let settle = (20.0 * inductance_h / resistance_ohm * hz).ceil() as u32 + 10;
    for _ in 0..settle {
        plant.advance(&legs);
    }
    let (mut low, mut high, mut charge, mut time) = (f64::MAX, f64::MIN, 0.0, 0.0);
    plant.advance_with(&legs, |slice| {
        (low, high) = (low.min(slice.end_currents_a[0]), high.max(slice.end_currents_a[0]));
        charge += slice.currents_a[0] * slice.span_s;
        time += slice.span_s;
    });
    Ok(100.0 * (high - low) / (charge / time))
}

impl Summary {
    fn choice_table(&self, options: &Options) -> Vec<Vec<String>> {
        let row = |name: &str, value: String| vec![name.to_string(), value];
        let reached = if self.ripple_reached { "" } else { " (not reached)" };
        vec![
            row("choice", "".into()),
            row("PWM frequency, centre-aligned", format!("{:.1} kHz", self.pwm_hz / 1e3)),
            row(&format!("ripple, wanted {} %", options.ripple), format!("{:.2} %{reached}", self.ripple_pct)),
            row("resolution of the duty", format!("{:.2} bit", self.resolution_bits)),
            row("timer period", format!("{} counts", self.period_counts)),
            row("dead time", format!("{} counts", self.dead_time_counts)),
        ]
    }

    fn sweep_table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![["ripple frequency", "eq. (18)", "exact", "simulated"].map(String::from).to_vec()];
        for ripple in &self.sweep {
            let percent = |x: f64| format!("{x:.2} %");
            let [formula, exact, simulated] = [ripple.formula_pct, ripple.exact_pct, ripple.simulated_pct].map(percent);
            rows.push(vec![format!("{:.1} kHz", ripple.ripple_hz / 1e3), formula, exact, simulated]);
        }
        rows
    }

    fn report(&self, options: &Options) -> Result<Report> {
        let mut report = Report::new("Choice of the PWM frequency");
        report.lead(
            "The faster the bridge switches, the smoother the current, the coarser the voltage and the hotter the \
             transistors: this is the frequency that fits the motor.",
        );
        let curve = |name: &str, of: fn(&Ripple) -> f64| {
            Series::new(name, self.sweep.iter().map(|ripple| (ripple.ripple_hz / 1e3, of(ripple))))
        };
        let series = vec![
            curve("eq. (18)", |r| r.formula_pct),
            curve("exact", |r| r.exact_pct),
            curve("simulated", |r| r.simulated_pct),
        ];
        report.plot(
            &Plot::new("Ripple of the current", "frequency of the ripple / kHz", "ripple / % of the mean", series),
            "As in Fig. 8 of Simpkins and Todorov, whose numbers are off by ten: 1 % takes 518 kHz, and 51.8 kHz \
             gives 9.6 %. With a centre-aligned timer and two legs switching, the ripple has twice the switching \
             frequency.",
        )?;
        report.heading("Choice").table(&self.choice_table(options));
        report.heading("Ripple over the frequency").table(&self.sweep_table());
        Ok(report)
    }
}
