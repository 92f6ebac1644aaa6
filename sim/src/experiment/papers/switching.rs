//! Fig. 8, eq. (16) to (19): the ripple of the current, what it costs, and what the PWM frequency costs.

use super::claim::{Claim, Figure, Paper};
use crate::experiment::pwm as experiment;
use crate::report::{Plot, Series};
use anyhow::Result;
use hallservo::pwm;

/// The paper's motor.
const RESISTANCE_OHM: f64 = 3.75;
const INDUCTANCE_H: f64 = 0.36e-3;

/// Fig. 8 and eq. (16) to (19).
///
/// # Errors
/// A plant that refuses its parameters.
pub fn claims() -> Result<Vec<Claim>> {
    Ok(vec![loss(), ripple()?, resolution()?])
}

fn loss() -> Claim {
    let share = f64::from(pwm::square_wave_loss(1.0));
    Claim {
        paper: Paper::LinearHalls,
        place: "Eq. (16), (17)",
        title: "what ripple costs",
        seen: "A current that jumps between zero and twice its mean heats the winding twice as much as a smooth one.",
        equation: "(16)  P = I² R          (17)  P = (2I)² R/2 + 0²/2 = 2 I² R\n\
                   here: P / (I² R) = 1 + deviation²",
        conditions: "A square wave of current with a duty of one half, as printed.",
        conclusion: "The loss grows with the square of the ripple: at 10 % peak to peak it is 0.25 % more.".into(),
        erratum: None,
        figures: vec![
            Figure::new("loss of the square wave over that of the mean", "", share).reproduces(2.0, 1e-6),
            Figure::new("the same at a ripple of 10 % peak to peak", "", f64::from(pwm::square_wave_loss(0.05))),
        ],
        table: Vec::new(),
        plots: Vec::new(),
    }
}

fn ripple() -> Result<Claim> {
    let formula = |hz: f64| f64::from(pwm::ripple_percent(RESISTANCE_OHM as f32, INDUCTANCE_H as f32, hz as f32));
    let needed = |percent: f64| {
        f64::from(pwm::ripple_frequency(RESISTANCE_OHM as f32, INDUCTANCE_H as f32, percent as f32)) / 1e3
    };
    let sweep = (0..=24)
        .map(|k| experiment::ripple(RESISTANCE_OHM, INDUCTANCE_H, 1e4 * 10f64.powf(f64::from(k) / 14.0)))
        .collect::<Result<Vec<_>>>()?;
    let curve = |name: &str, of: fn(&experiment::Ripple) -> f64| {
        Series::new(name, sweep.iter().map(|ripple| (ripple.ripple_hz / 1e3, of(ripple))))
    };
    let series = vec![
        curve("eq. (18)", |r| r.formula_pct),
        curve("R-L circuit, exact", |r| r.exact_pct),
        curve("simulated, every edge", |r| r.simulated_pct),
    ];
    let worst = sweep.iter().map(|r| (r.simulated_pct / r.exact_pct - 1.0).abs()).fold(0.0, f64::max);
    let product = experiment::ripple(RESISTANCE_OHM, INDUCTANCE_H, 80e3)?.simulated_pct;
    Ok(Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 8, eq. (18)",
        title: "the ripple of the current over the PWM frequency",
        seen: "The faster the bridge switches, the smoother the current. The paper's motor needs ten times the \
               frequency that is printed for a ripple of 1 %.",
        equation: "(18)  f = −R / (2 L ln(1 − P/100))          exact: ripple = 2 tanh(R / 4 L f)",
        conditions: "R = 3.75 Ω, L = 0.36 mH, duty one half, rotor locked, as printed. In the simulation one leg \
                     switches, so that the ripple has the frequency of the PWM.",
        conclusion: format!(
            "Eq. (18) and the exact ripple agree within a few per cent of each other. Of centre-aligned PWM with two \
             legs switching, as here, the ripple has twice the frequency: at 40 kHz it is {product:.1} %, the paper's \
             bridge at 50 kHz with one leg has 9.9 %."
        ),
        erratum: Some(
            "“1 % at 51.8 kHz” and “3.5 % at 50 kHz”: the formula gives 518 kHz and 146 kHz; at 51.8 kHz it gives \
             9.57 %, at 50 kHz 9.89 %. The caption of Fig. 8 calls the ripple power dissipation.",
        ),
        figures: vec![
            Figure::new("frequency for 1 %", "kHz", needed(1.0)).corrects(51.8),
            Figure::new("ripple at 51.8 kHz", "%", formula(51.8e3)).corrects(1.0),
            Figure::new("ripple at 50 kHz", "%", formula(50e3)).corrects(3.5),
            Figure::new("frequency for 3.5 %", "kHz", needed(3.5)).corrects(50.0),
            Figure::new("simulation against the exact ripple, largest difference", "%", 100.0 * worst),
            Figure::new("ripple here at 40 kHz, centre-aligned", "%", product),
        ],
        table: Vec::new(),
        plots: vec![(
            Plot::new(
                "Fig. 8: ripple of the current",
                "frequency of the ripple / kHz",
                "ripple / % of the mean",
                series,
            )
            .logarithmic(),
            "Eq. (18), the exact solution and the simulation.",
        )],
    })
}

fn resolution() -> Result<Claim> {
    let levels = |hz: f32, cycle_s: f32| 2f64.powf(f64::from(pwm::resolution_bits(hz, cycle_s)));
    Ok(Claim {
        paper: Paper::LinearHalls,
        place: "Eq. (19)",
        title: "how finely a voltage can be set",
        seen: "The faster the PWM, the fewer steps its duty has: the price of a smooth current.",
        equation: "(19)  γ = log₂(2 T_PWM / T_CY) bits",
        conditions: "The paper does not give T_CY. Its numbers hold for 50 ns, assumed here. Our timer has 170 MHz.",
        conclusion:
            "At 40 kHz this timer has four times as many steps as the paper's: 8500 by the formula, of which a \
                     centre-aligned timer sets 2125 compare values; the drive dithers none."
                .into(),
        erratum: None,
        figures: vec![
            Figure::new("steps at 10 kHz, T_CY = 50 ns", "", levels(10e3, 50e-9)).reproduces(4000.0, 0.01),
            Figure::new("steps at 40 kHz, T_CY = 50 ns", "", levels(40e3, 50e-9)).reproduces(1000.0, 0.01),
            Figure::new("steps at 40 kHz by the formula, 170 MHz", "", levels(40e3, (1.0 / 170e6) as f32)),
            Figure::new("compare values at 40 kHz here", "", f64::from(pwm::period_counts(170e6, 40e3)?)),
        ],
        table: Vec::new(),
        plots: Vec::new(),
    })
}
