//! The adaptation against a thousand imperfect motors: what `cargo run --release -- adapt` measures.

use hallservo::hall::adapt::{Settings, Spread, Status};
use rayon::prelude::*;
use sim::experiment::adapt::trial::{self, Motion, Trial};
use sim::experiment::adapt::{HZ, ensemble, run};
use sim::statistics::Statistics;

#[test]
fn a_thousand_unknown_motors_are_learnt_followed_and_lost() {
    let motors = sim::of(60, 1000);
    let summary = run(1, motors).unwrap().summary;
    println!("{summary:#?}");
    assert_eq!(summary.diverged, 0);
    // From the data sheet, at a hundred samples a turn.
    assert!(summary.convergence_electrical_turns.unwrap() <= 0.75);
    assert!(summary.error_after_one_turn_deg_rms < 0.35);
    // Nothing can be better than the bound, and this is nearly as good.
    for (error, bound) in [
        (summary.error_deg_rms, summary.posterior_bound_deg),
        (summary.ramp_error_deg_rms, summary.ramp_bound_deg),
        (summary.reversal_error_deg_rms, summary.reversal_bound_deg),
    ] {
        assert!((0.99..1.2).contains(&(error / bound)), "{error} {bound}");
    }
    // The paper's filter must be as bad as it is.
    assert!(summary.paper_filter_convergence_turns.is_none() && summary.paper_filter_error_deg_rms > 1.5);
    assert!(summary.drift_error_deg_rms < 0.3);
    assert!(summary.drift_error_without_adaptation_deg_rms > 1.0);
    assert!(summary.drift_bias_deg_rms < 0.15 && summary.drift_bias_without_adaptation_deg_rms > 1.5);
    // The windings' field: a shift that follows the torque, of 1.15° for 2 %; the currents tell most of it.
    let [none, some, much] = summary.coupling_error_without_deg_rms;
    assert!(none < 0.22 && (1.1..1.3).contains(&some) && (2.8..3.6).contains(&much));
    let [_, some, much] = summary.coupling_error_with_deg_rms;
    assert!(some < 0.25 && much < 0.4);
    assert!(summary.coupling_ripple_deg_rms[2] < 0.55);
    assert_eq!((summary.losses, summary.losses_named), (motors as usize, motors as usize));
    // What uneven magnets could have done speaks against no sensor; that costs a sixth of a turn.
    assert!(summary.loss_detection_turns < 0.6 && summary.loss_error_deg_max < 8.0);
    assert!(summary.loss_two_sensors_error_deg_rms < 0.8);
}

/// Share of motors that go wrong, and RMS error of the rest in the fourth turn, with settings of the start.
fn outcome(start: Spread, third: f32) -> (f64, f64) {
    let settings = Settings { start, drift: Spread { third: 0.0, ..Settings::default().drift }, ..Settings::default() };
    let mut model = trial::nominal_model();
    model.sensors.iter_mut().for_each(|sensor| sensor.third = third);
    let (mut wrong, mut error) = (0, Statistics::default());
    for seed in 0..200 {
        let mut trial = Trial::with(seed, trial::halls(seed), Motion::Constant(HZ), &model, &settings).unwrap();
        let steps: Vec<_> = (0..400).map(|_| trial.step()).collect();
        if steps.iter().any(|step| matches!(step.outcome, Status::Failed(_))) {
            wrong += 1;
        } else {
            steps[300..].iter().for_each(|step| error.push(step.error_deg));
        }
    }
    (f64::from(wrong) / 200.0, error.rms())
}

#[test]
fn the_third_harmonic_must_be_a_state_and_costs_nothing() {
    let (wrong, learnt) = outcome(Settings::NOMINAL, 0.0);
    let (without_wrong, without) = outcome(Spread { third: 0.0, ..Settings::NOMINAL }, 0.0);
    let (known_wrong, known) = outcome(Spread { third: 0.0, ..Settings::NOMINAL }, 0.05);
    println!("learnt {learnt:.3}° ({wrong} wrong), left out {without:.3}° ({without_wrong} wrong), known {known:.3}°");
    assert_eq!((wrong, known_wrong), (0.0, 0.0));
    assert!(without_wrong > 0.2 || without > 3.0 * learnt);
    assert!(learnt < 1.03 * known);
}

#[test]
fn every_speed_of_the_range_converges() {
    // Samples a turn: 1400 down to 12, of which a mean of three spans a quarter.
    for (hz, turns) in [(0.7, 0.8), (2.0, 0.8), (20.0, 0.9), (40.0, 1.2), (80.0, 2.2)] {
        let courses = (0..100).into_par_iter().map(|seed| ensemble::converge(seed, hz).unwrap()).collect::<Vec<_>>();
        assert!(courses.iter().all(|course| !course.diverged), "{hz} Hz");
        let rms = ensemble::over_time(&courses, |course| &course.errors);
        let converged = ensemble::convergence_turns(&rms).unwrap();
        println!("{hz} Hz: below 0.5° after {converged:.2} turns");
        assert!(converged <= turns, "{hz} Hz: {converged}");
    }
}
