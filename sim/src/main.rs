//! The command line of the experiments.

use clap::{Parser, Subcommand};
use sim::experiment::{self, Common};
use std::process::ExitCode;

/// hallservo: a servo drive from three linear Hall sensors, against a simulated motor
#[derive(Parser)]
#[command(version, about, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    experiment: Option<Experiment>,
    #[command(flatten)]
    common: Common,
}

#[derive(Subcommand)]
enum Experiment {
    /// Calibrate an imperfect motor and turn it: start, reversal, slow and fast (the default)
    Spin(Common),
    /// Block and sinusoidal commutation side by side: torque and speed ripple
    Commutation(Common),
    /// Current, speed and position control: steps, hold under load, ripple, copper loss, anti-cogging
    Servo(Common),
    /// Motors whose magnets differ: the ripple of a low speed before and after the cogging is learnt, the pole found again
    Cogging(experiment::OfMotors),
    /// Inject every fault at random times into running drives
    Faults(experiment::faults::Options),
    /// Random settings, commands and worlds, judged by physics alone
    Attack(experiment::attack::Options),
    /// Find and follow the sensors' parameters while the motor turns; lose a sensor
    Adapt(experiment::adapt::Options),
    /// Sound Halls for hours: whether one is ever called broken, and how soon one that is
    Endurance(experiment::endurance::Options),
    /// Rotors with uneven magnets: the error of the tracked angle
    Magnets(experiment::magnets::Options),
    /// Late Halls: their delay as the drive measures it, and the tracked angle before and after
    Delay(experiment::delay::Options),
    /// The field of the windings in the Halls' signals: measured, and the tracked angle under load before and after
    Coil(experiment::OfMotors),
    /// Commission motors on boards with wrong gains: what was found, its ±, and what is true
    Identify(experiment::identify::Options),
    /// Choose the PWM frequency; current ripple by formula and by a switched simulation
    Pwm(experiment::pwm::Options),
    /// Absolute angle from two rings: before and after self-calibration, and when something breaks
    Vernier(experiment::vernier::Options),
    /// Both papers done again: each figure, table and number beside the printed one
    Papers(Common),
}

fn main() -> ExitCode {
    // `hallservo | head` ends like any other filter.
    sigpipe::reset();
    let arguments = Arguments::parse();
    let result = match arguments.experiment {
        None => experiment::spin::main(&arguments.common),
        Some(Experiment::Spin(common)) => experiment::spin::main(&common),
        Some(Experiment::Commutation(common)) => experiment::commutation::main(&common),
        Some(Experiment::Servo(common)) => experiment::servo::main(&common),
        Some(Experiment::Cogging(options)) => experiment::cogging::main(&options),
        Some(Experiment::Faults(options)) => experiment::faults::main(&options),
        Some(Experiment::Attack(options)) => experiment::attack::main(&options),
        Some(Experiment::Adapt(options)) => experiment::adapt::main(&options),
        Some(Experiment::Endurance(options)) => experiment::endurance::main(&options),
        Some(Experiment::Magnets(options)) => experiment::magnets::main(&options),
        Some(Experiment::Delay(options)) => experiment::delay::main(&options),
        Some(Experiment::Coil(options)) => experiment::coil::main(&options),
        Some(Experiment::Identify(options)) => experiment::identify::main(&options),
        Some(Experiment::Pwm(options)) => experiment::pwm::main(&options),
        Some(Experiment::Vernier(options)) => experiment::vernier::main(&options),
        Some(Experiment::Papers(common)) => experiment::papers::main(&common),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("hallservo: {error:#}");
            ExitCode::FAILURE
        }
    }
}
