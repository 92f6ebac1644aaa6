//! Fig. 4(b), eq. (7) and Fig. 5: what three Halls tell, how finely, and the six steps.

use super::claim::{Claim, Figure, Paper};
use crate::experiment::{adapt::trial, commutation};
use crate::report::{Plot, Series};
use crate::statistics::{Statistics, ripple_pct};
use anyhow::Result;
use baseline::halls::{Normalizer, Signal, single_sensor, three_sensors};
use hallservo::angle::ElectricalAngle;
use hallservo::commutation::block::Sextant;
use hallservo::commutation::sinusoidal::PhaseOrder;
use hallservo::hall::Channel;
use hallservo::hall::estimate::Estimator;
use hallservo::hall::model::Model;
use plant::{AdcParameters, Bench, BenchParameters, HallParameters, PlantParameters, Shape};
use rig::error_deg;
use std::f64::consts::TAU;

const POLE_PAIRS: f64 = 4.0;
/// Peak to peak, the paper's V_pp.
const SWING_V: f64 = 0.4;
const REFERENCE_V: f64 = 3.3;

/// Fig. 4(b), eq. (7), Fig. 5.
///
/// # Errors
/// A simulated drive that refuses its sensors.
pub fn claims(seed: u64) -> Result<Vec<Claim>> {
    Ok(vec![signals(seed)?, resolution()?, steps(seed)?])
}

/// Three sensors of the paper's swing, evenly placed.
fn halls(noise: f64) -> [HallParameters; 3] {
    let ideal = PlantParameters::ideal().halls;
    ideal.map(|hall| HallParameters { amplitude_v: SWING_V / 2.0, noise, ..hall })
}

/// A rotor that turns by so many electrical radians a sample.
fn bench(halls: [HallParameters; 3], bits: u8, step_rad: f64, seed: u64) -> Result<Bench> {
    let parameters = BenchParameters {
        halls,
        magnets: PlantParameters::ideal().magnets,
        adc: AdcParameters::ideal(bits, REFERENCE_V),
        period_s: 1e-3,
        pole_pairs: POLE_PAIRS as u8,
        inertia_kgm2: 1e-5,
        damping_nms: 0.0,
        torque_noise_nm_rthz: 0.0,
    };
    Ok(Bench::new(&parameters, 0.0, step_rad / 1e-3, seed)?)
}

/// The model of these sensors in codes of a converter.
fn model(halls: &[HallParameters; 3], bits: u8) -> Model {
    let scale = 2f32.powi(i32::from(bits) - 12);
    let mut model = trial::exact_model(halls);
    for sensor in &mut model.sensors {
        sensor.offset *= scale;
        sensor.amplitude *= scale;
    }
    model
}

fn normalized(model: &Model, codes: [u16; 3], bits: u8) -> [Signal; 3] {
    [0, 1, 2].map(|k: usize| {
        let sensor = &model.sensors[k];
        let (low, high) = (sensor.offset - sensor.amplitude, sensor.offset + sensor.amplitude);
        let normalizer = Normalizer::new(Channel(k as u8), low, high, bits);
        normalizer.and_then(|normalizer| normalizer.normalize(codes[k]).ok()).unwrap_or(Signal::ZERO)
    })
}

/// Errors in electrical degrees of eq. (5), eq. (4) and of ours over even turns.
fn errors(noise: f64, bits: u8, seed: u64) -> Result<[Statistics; 3]> {
    const SAMPLES: usize = 36_000;
    let halls = halls(noise);
    let model = model(&halls, bits);
    let estimator = Estimator::new(&model, bits)?;
    let mut bench = bench(halls, bits, 10.0 * TAU / SAMPLES as f64, seed)?;
    let mut errors = [Statistics::default(); 3];
    for _ in 0..SAMPLES {
        let codes = bench.step(0.0);
        let signals = normalized(&model, codes, bits);
        let placements = model.sensors.map(|sensor| sensor.placement);
        let angles = [
            single_sensor(signals[0], signals[1], ElectricalAngle::THIRD),
            three_sensors(signals, placements),
            estimator.angle_unchecked(&codes),
        ];
        for (errors, angle) in errors.iter_mut().zip(angles) {
            errors.push(error_deg(angle, bench.angle_rad()));
        }
    }
    Ok(errors)
}

/// The smallest mechanical turn after which all three codes recur.
fn recurrence_rad() -> Result<f64> {
    const STEP: f64 = TAU / 1440.0;
    let mut bench = bench(halls(0.0), 12, STEP, 1)?;
    let codes: Vec<_> = (0..3000).map(|_| bench.step(0.0)).collect();
    let alike = |shift: usize| {
        let pairs = codes.iter().zip(&codes[shift..]).take(1000);
        pairs.flat_map(|(a, b)| a.iter().zip(b)).all(|(a, b)| a.abs_diff(*b) <= 1)
    };
    let shift = (8..1500).find(|&shift| alike(shift)).unwrap_or(0);
    Ok(shift as f64 * STEP / POLE_PAIRS)
}

fn signals(seed: u64) -> Result<Claim> {
    let mut bench = bench(halls(0.0), 12, TAU / 720.0, seed)?;
    let model = model(&halls(0.0), 12);
    let mut series = vec![Vec::new(); 6];
    for _ in 0..1440 {
        let codes = bench.step(0.0);
        let mechanical = series[0].len() as f64 / 720.0 * 360.0 / POLE_PAIRS;
        for (k, signal) in normalized(&model, codes, 12).into_iter().enumerate() {
            let signal = signal.to_num::<f64>();
            series[k].push((mechanical, signal));
            series[k + 3].push((mechanical, signal.clamp(-1.0, 1.0).asin() / (TAU / 4.0)));
        }
    }
    let names = ["Hall A", "Hall B", "Hall C", "arcsine of A", "arcsine of B", "arcsine of C"];
    let series = names.into_iter().zip(series).map(|(name, points)| Series::new(name, points)).collect();
    let [single, three, ours] = errors(0.01, 12, seed)?;
    Ok(Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 4(b)",
        title: "three Halls and their arcsines",
        seen: "Each arcsine has the same value at two angles of an electrical turn, and all three recur with every \
               pole pair: four times in a turn of this motor. Three Halls together tell the two angles apart, but \
               not the pole pairs.",
        equation: "(1)  r_i = sin(n(θ − φ − ψ_i)) + noise\n\
                   (6)  θ = asin(r_i)/n + φ + ψ_i          the mean of three: (4)\n\
                   here: the angle that fits all three signals best (least squares)",
        conditions: "Four pole pairs, three even sensors 120° apart, a swing of 0.4 V at a 12-bit converter of 3.3 V. \
                     For the errors 1 % of noise, which the paper does not give.",
        conclusion: format!(
            "An arcsine is infinitely steep at the peaks, where it amplifies the noise without bound: one sensor is \
             {:.1} times as noisy as ours, the mean of three {:.1} times. The least error that any estimator can \
             have is 0.468°.",
            single.rms() / ours.rms(),
            three.rms() / ours.rms()
        ),
        erratum: Some(
            "(4) and (5) divide φ and ψ by n, against (1) and (6); (4) counts steps of π/2, which holds for four \
             pole pairs only, and its floor(1.8·|θ̇|/π) would count three at each wrap. Corrected: the form of (6), \
             steps of 2π/n, one step where the electrical angle wraps.",
        ),
        figures: vec![
            Figure::new("the Halls recur after, mechanical", "rad", recurrence_rad()?).reproduces(TAU / 4.0, 1e-3),
            Figure::new("error with 1 % of noise, against eq. (5), electrical RMS", "°", ours.rms())
                .improves_on(single.rms()),
            Figure::new("error with 1 % of noise, against eq. (4), electrical RMS", "°", ours.rms())
                .improves_on(three.rms()),
        ],
        table: Vec::new(),
        plots: vec![(
            Plot::new("Hall signals and their arcsines", "mechanical angle / °", "signal, arcsine / 90°", series),
            "Half a turn of the rotor: two electrical turns.",
        )],
    })
}

/// Different readings of the three Halls in a mechanical turn.
fn readings(bits: u8) -> Result<f64> {
    const SAMPLES: usize = 200_000;
    let mut bench = bench(halls(0.0), bits, TAU / SAMPLES as f64, 1)?;
    let mut last = bench.step(0.0);
    let changes = (0..SAMPLES).filter(|_| {
        let codes = bench.step(0.0);
        let change = codes != last;
        last = codes;
        change
    });
    Ok(POLE_PAIRS * changes.count() as f64)
}

fn resolution() -> Result<Claim> {
    let counts = |bits: i32| SWING_V / (REFERENCE_V / 2f64.powi(bits)) * POLE_PAIRS;
    let error = |bits: u8| errors(0.0, bits, 1).map(|[_, _, ours]| ours.rms() / POLE_PAIRS);
    Ok(Claim {
        paper: Paper::LinearHalls,
        place: "Eq. (7)",
        title: "how finely the Halls divide a turn",
        seen: "The finer the reading, the smoother the motion. The paper's formula gives a quarter of the counts that \
               are printed under it at 10 bit; what three Halls really distinguish is finer than the formula.",
        equation: "(7)  CPR = V_pp / (V_ref / 2^bits) · n,   R = 360° / CPR",
        conditions: "V_pp = 0.400 V, V_ref = 3.3 V, n = 4, as printed. The resolution found here counts each change of \
                     any of the three readings while the rotor turns once, without noise; the error is that of the \
                     angle from all three, caused by rounding alone.",
        conclusion: "One sensor passes each code twice in an electrical turn, and there are three of them: six times \
                     the formula, less the readings that change together. With noise, the error is what counts: see \
                     Fig. 4(b). The paper's 0.009° at a joint behind a gear of 20:1 is the formula at 12 bit; 0.9 mm \
                     at the end of an arm would need an arm of 5.7 m, of which the paper says nothing."
            .into(),
        erratum: Some(
            "0.400 V at 3.3 V/1024 are 124 codes, times four 496: not 1984. At 12 bit it is 1986: 4932 follows from \
             neither.",
        ),
        figures: vec![
            Figure::new("counts in a turn by the formula, 10 bit", "", counts(10)).corrects(1984.0),
            Figure::new("resolution by the formula, 10 bit", "°", 360.0 / counts(10)).corrects(0.18),
            Figure::new("counts in a turn by the formula, 12 bit", "", counts(12)).corrects(4932.0),
            Figure::new("resolution by the formula, 12 bit", "°", 360.0 / counts(12)).corrects(0.073),
            Figure::new("the same behind the gear, 12 bit", "°", 360.0 / counts(12) / 20.0).reproduces(9e-3, 0.02),
            Figure::new("different readings of three Halls in a turn, 10 bit", "", readings(10)?),
            Figure::new("different readings of three Halls in a turn, 12 bit", "", readings(12)?),
            Figure::new("error by rounding, 10 bit, mechanical RMS", "°", error(10)?),
            Figure::new("error by rounding, 12 bit, mechanical RMS", "°", error(12)?),
        ],
        table: Vec::new(),
        plots: Vec::new(),
    })
}

/// The Halls' code in the middle of a sixth of the turn, and what its step does with the phases.
fn step_row(number: usize) -> Vec<String> {
    let angle = (60 * number + 30) as f64;
    let high = [0.0, 120.0, 240.0].map(|placement: f64| (angle - placement).to_radians().sin() > 0.0);
    let code = high.map(|high| if high { '1' } else { '0' }).iter().collect::<String>();
    let phase = |leg: usize| {
        let Some(sextant) = Sextant::of_switching_halls(high) else { return "–".to_string() };
        let (up, down) = sextant.next().next().conducting(PhaseOrder::FORWARD);
        if leg == up {
            "+"
        } else if leg == down {
            "−"
        } else {
            "open"
        }
        .to_string()
    };
    let range = format!("{}° to {}°", 60 * number, 60 * (number + 1));
    [vec![range, code], (0..3).map(phase).collect()].concat()
}

/// Phases whose state differs between two rows.
fn changed(a: &[String], b: &[String]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count()
}

fn steps(seed: u64) -> Result<Claim> {
    let head = ["electrical angle", "Halls A B C", "phase A", "phase B", "phase C"].map(String::from).to_vec();
    let rows: Vec<_> = (0..6).map(step_row).collect();
    let next = |k: usize| &rows[(k + 1) % 6];
    let codes: std::collections::BTreeSet<_> = rows.iter().map(|row| row[1].clone()).collect();
    let one_hall = (0..6).filter(|&k| rows[k][1].chars().zip(next(k)[1].chars()).filter(|(a, b)| a != b).count() == 1);
    let one_moves = (0..6).filter(|&k| changed(&rows[k][2..], &next(k)[2..]) == 2);
    let sine = commutation::torque_by_switching_halls(Shape::Sinusoidal, seed)?;
    let trapezoid = commutation::torque_by_switching_halls(Shape::Trapezoidal { flat_deg: 120.0 }, seed)?;
    let ripple = |torque: &[(f64, f64)]| ripple_pct(&torque.iter().map(|p| p.1).collect::<Vec<_>>());
    let figures = vec![
        Figure::new("different codes in an electrical turn", "", codes.len() as f64),
        Figure::new("steps at which one Hall changes", "", one_hall.count() as f64),
        Figure::new("steps at which one phase hands over to the open one", "", one_moves.count() as f64),
        Figure::new("ripple of the torque at a sinusoidal back-EMF, peak to peak", "% of the mean", ripple(&sine)),
        Figure::new(
            "ripple of the torque at a trapezoidal back-EMF, peak to peak",
            "% of the mean",
            ripple(&trapezoid),
        ),
    ];
    Ok(Claim {
        paper: Paper::LinearHalls,
        place: "Fig. 5",
        title: "block commutation, step by step",
        seen: "The signs of three Halls make a code that changes six times in an electrical turn. Each code drives \
               two phases and leaves the third open. On the paper's own motor, whose back-EMF is a sine, the torque \
               dips at each step.",
        equation: "torque = Σ current × back-EMF / speed;  ripple at a sine: (1 − cos 30°) / (3/π) = 14.03 %",
        conditions: "Ideal Halls 120° apart, constant command, 1/16 turn a second, no dead time. Our copy of the paper \
                     lacks the cells of its table, which it takes from Microchip's AN885: only the rules are compared.",
        conclusion:
            "The paper draws a trapezoidal back-EMF, with which block commutation is smooth between the steps; \
                     its Fig. 9(c) shows a sine."
                .into(),
        erratum: None,
        figures,
        table: [vec![head], rows].concat(),
        plots: vec![(
            Plot::new(
                "Torque over the angle",
                "electrical angle / °",
                "torque / mN·m",
                vec![Series::new("back-EMF a sine", sine), Series::new("back-EMF a trapezoid", trapezoid)],
            ),
            "The six steps, switched by the signs of ideal Halls.",
        )],
    })
}
