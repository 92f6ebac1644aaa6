//! The angle that a board's drive tells, against the host's simulation: the same drive, tasks, settings and commands at
//! the same motor.

mod common;
#[path = "angle/two_halls.rs"]
mod two_halls;

use chip::{Disturbance, Trace};
use common::{ESC, NUCLEO, ask, calibrated, run, says};
use core::num::NonZeroU32;
use hallservo::board::TemperatureCode;
use hallservo::board::sensing::SkewCompensation;
use hallservo::settings::Settings;
use hallservo_protocol::{Answer, Decoder, Reply};
use plant::{InverterModel, PlantParameters};
use simulator::{Simulator, flash::Flash};
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::ops::Range;
use std::rc::Rc;
use stm32g4::Adc;
use stm32g4::registers::clock::HCLK_HZ;
use virtual_board::angle::{AngleError, Told, deviations};
use virtual_board::script::{self, Action};
use virtual_board::session::Session;

// What only the chip uses.
#[allow(dead_code, missing_docs)]
#[path = "../../../boards/b-g431b-esc1/src/constants.rs"]
mod esc1;
#[allow(dead_code, missing_docs)]
#[path = "../../../boards/nucleo-g474re-ihm08m1/src/constants.rs"]
mod nucleo;
#[allow(dead_code, missing_docs, unexpected_cfgs)]
#[path = "../../../boards/nucleo-g431rb-ihm16m1/src/constants.rs"]
mod small_nucleo;

/// Supply and reference of the chips, V.
const VDDA: f64 = 3.3;
/// An NTC of 10 kΩ at 25 °C to the supply and 4.7 kΩ to ground, 12 bit.
const COOL: u16 = 1309;

/// The host's drive and motor.
struct Host {
    simulator: Simulator,
    period_s: f64,
    trace: Rc<RefCell<Trace>>,
    replies: Decoder,
    told: Vec<Told>,
}

impl Host {
    /// Settings of a board, and ticks that its Hall 1 is held before the others.
    fn new(settings: Settings, early: u32, seed: u64) -> Self {
        Self::at(&motor(&settings, early), settings, early, seed)
    }

    /// The same at any motor.
    fn at(motor: &PlantParameters, settings: Settings, early: u32, seed: u64) -> Self {
        let mut simulator = Simulator::with(settings, motor, seed, Flash::blank(), Vec::new()).expect("a drive");
        let period_s = 1.0 / f64::from(settings.pwm_hz);
        let names = ["time / s", "angle / turns", "electrical angle / turns"].map(String::from).to_vec();
        let trace = Rc::new(RefCell::new(Trace { names, rows: Vec::new() }));
        let seen = Rc::clone(&trace);
        let mut first_hall =
            SkewCompensation::<12>::new(early, NonZeroU32::new(HCLK_HZ / settings.pwm_hz as u32).unwrap());
        simulator.observe = Some(Box::new(move |sample, truth| {
            sample.temperatures = [Adc::ntc_to_reference(COOL), TemperatureCode::MISSING];
            sample.halls[0] = first_hall.at_once(sample.halls[0]);
            let rows = &mut seen.borrow_mut().rows;
            let [mechanical, electrical] =
                [truth.mechanical_angle_rad, truth.electrical_angle_rad].map(|rad| rad / TAU);
            rows.push(vec![rows.len() as f64 * period_s, mechanical, electrical]);
        }));
        Self { simulator, period_s, trace, replies: Decoder::new(), told: Vec::new() }
    }
}

/// The virtual board's motor at what a board senses with.
fn motor(settings: &Settings, early: u32) -> PlantParameters {
    let control = settings.control.expect("current control");
    let mut motor = PlantParameters::imperfect(1);
    motor.inverter.pwm_hz = f64::from(settings.pwm_hz);
    motor.inverter.dead_time_s = f64::from(settings.dead_time_s);
    motor.inverter.model = InverterModel::Switched;
    motor.current_sense.gain = 0.5 * VDDA / f64::from(control.current_full_scale_a);
    motor.current_sense.offset_v = 0.5 * VDDA;
    motor.bus_sense.gain = VDDA / f64::from(control.bus_full_scale_v);
    // Held earlier is seen later: by a lag of the same delay.
    motor.halls[0].bandwidth_hz = (early > 0).then(|| f64::from(HCLK_HZ) / f64::from(early) / TAU);
    motor
}

/// What is done alike to both.
trait Bench {
    fn ask(&mut self, what: &str);
    fn run(&mut self, seconds: f64);
    fn now_s(&self) -> f64;
    /// Of the angles that were told of a span of time.
    fn errors_deg(&self, span_s: Range<f64>) -> impl Iterator<Item = f64>;
}

impl Bench for Session {
    fn ask(&mut self, what: &str) {
        // The reply may be late: the task that sends it makes a new table of what was learnt.
        ask(self, what);
    }

    fn run(&mut self, seconds: f64) {
        run(self, seconds);
    }

    fn now_s(&self) -> f64 {
        self.seconds()
    }

    fn errors_deg(&self, span_s: Range<f64>) -> impl Iterator<Item = f64> {
        self.deviations(span_s).into_iter().map(|one| one.deg)
    }
}

impl Bench for Host {
    fn ask(&mut self, what: &str) {
        for step in script::parse(&format!("at 0s send {what}")).expect("a request") {
            let Action::Disturb(Disturbance::Serial(bytes)) = step.action else { unreachable!("a request") };
            self.simulator.write(&bytes);
        }
        self.run(8e-3);
    }

    fn run(&mut self, seconds: f64) {
        let end_s = self.now_s() + seconds;
        while self.now_s() < end_s {
            self.simulator.step();
            for byte in self.simulator.read() {
                match self.replies.push::<Reply>(byte) {
                    Some(Ok(Reply { answer: Answer::Telemetry(frame), .. })) => {
                        self.told.push(Told { at_s: f64::from(frame.step) * self.period_s, frame });
                    }
                    Some(Ok(Reply { answer: Answer::Refused(refusal), .. })) => panic!("refused: {refusal:?}"),
                    _ => {}
                }
            }
        }
    }

    fn now_s(&self) -> f64 {
        self.trace.borrow().rows.len() as f64 * self.period_s
    }

    fn errors_deg(&self, span_s: Range<f64>) -> impl Iterator<Item = f64> {
        deviations(&self.told, 0.0, &self.trace.borrow(), span_s).into_iter().map(|one| one.deg)
    }
}

/// Speeds that are kept, both ways, rad/s. At the fast ones, 286 Hz electrical, a microsecond is 0.1°.
const SLOW: [f64; 2] = [40.0, -40.0];
const FAST: [f64; 2] = [450.0, -450.0];
/// Seconds of each.
const STEADY_S: f64 = 1.2;
/// Starts and reversals, rad/s, again and again; 0 is a stop.
const TURNS: [f64; 3] = [80.0, -80.0, 0.0];
const AGAIN: usize = 12;
/// From one to the next, seconds.
const TURN_S: f64 = 0.1;

/// Parts of the experiment.
const PARTS: [&str; 5] = ["+40 rad/s", "-40 rad/s", "start, reversal, stop", "+450 rad/s", "-450 rad/s"];
const STEADY: [usize; 4] = [0, 1, 3, 4];
const TRANSIENTS: [usize; 1] = [2];

type Errors = [AngleError; PARTS.len()];

/// Turns slowly, starts and stops while the sensors' parameters adapt; then fast without: after a reversal as hard as
/// that the filter is off by a tenth of a degree more or less, by chance, which needs many runs to average away.
fn spin(bench: &mut impl Bench) -> Errors {
    let mut found = Vec::new();
    bench.ask("telemetry 500");
    arm(bench);
    // What the filter does with the calibration in its first second differs by chance: of 24 hosts two were off by half
    // as much again.
    keep(bench, SLOW[0]);
    found.extend(SLOW.map(|speed| keep(bench, speed)));
    bench.ask("speed 0");
    bench.run(0.4);
    let from_s = bench.now_s();
    for speed in [TURNS; AGAIN].concat() {
        bench.ask(&format!("speed {speed}"));
        bench.run(TURN_S);
    }
    found.push(error(bench, from_s));
    bench.ask("disarm");
    bench.run(0.2);
    bench.ask("set adaptation 0");
    bench.run(0.2);
    arm(bench);
    found.extend(FAST.map(|speed| keep(bench, speed)));
    found.try_into().expect("all parts")
}

/// Until it is checked.
fn arm(bench: &mut impl Bench) {
    bench.ask("arm");
    bench.run(1.0);
}

/// The error at a constant speed.
fn keep(bench: &mut impl Bench, speed: f64) -> AngleError {
    bench.ask(&format!("speed {speed}"));
    bench.run(0.4);
    let from_s = bench.now_s();
    bench.run(STEADY_S);
    error(bench, from_s)
}

fn error(bench: &impl Bench, from_s: f64) -> AngleError {
    AngleError::of(bench.errors_deg(from_s..bench.now_s())).expect("telemetry")
}

/// Root of the mean square over some parts, each about its own mean.
fn rms(runs: &[Errors], parts: &[usize]) -> f64 {
    let errors = runs.iter().flat_map(|errors| parts.iter().map(|&part| &errors[part]));
    let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| {
        (sum + error.count as f64 * error.rms_deg.powi(2), count + error.count as f64)
    });
    (sum / count).sqrt()
}

/// Mean of a part over all runs.
fn mean(runs: &[Errors], part: usize) -> f64 {
    runs.iter().map(|errors| errors[part].mean_deg).sum::<f64>() / runs.len() as f64
}

/// The same experiment on both sides, each with a calibration of its own.
fn equals(board: &str, settings: Settings, early: u32) {
    let mut session = calibrated(board);
    samples_as_the_settings_say(&session, &settings, early);
    let ours = [spin(&mut session)];
    assert!(!says(&session, "Refused"), "{:#?}", session.lines);
    let hosts = [1, 2, 3, 4].map(|seed| {
        let mut host = Host::new(settings, early, seed);
        host.ask("calibrate");
        host.run(5.0);
        host.ask("set command_timeout_s 60");
        spin(&mut host)
    });
    let means = [0, 1, 2, 3, 4].map(|part| [&ours[..], &hosts].map(|runs| mean(runs, part)));
    for ((name, error), [here, there]) in PARTS.iter().zip(&ours[0]).zip(means) {
        println!("{board}, {name}: mean {here:+.3}°, host {there:+.3}°; {} frames", error.count);
    }
    let kinds = [("constant speed", &STEADY[..]), ("start, reversal, stop", &TRANSIENTS)];
    let ratios = kinds.map(|(name, parts)| {
        let [here, there] = [&ours[..], &hosts].map(|runs| rms(runs, parts));
        let each = hosts.map(|host| format!("{:.4}", rms(&[host], parts))).join(", ");
        println!("{board}, {name}: {here:.4}° RMS, host {there:.4}° ({each}): {:.3} of it", here / there);
        here / there
    });
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.1), "{board}: {ratios:?}, {ours:?}, {hosts:?}");
    // The alignment, of calibrations that scatter by 0.02° (16 of them on the host, standard deviation), here one against
    // four; and what an error of the timing adds one way and takes the other: 0.2 µs.
    let [here, there] = [0, 1].map(|side| means.map(|both| both[side]));
    let aligned = here.iter().zip(&there).map(|(here, there)| here - there).sum::<f64>() / here.len() as f64;
    let late = (here[3] - here[4]) / 2.0 - (there[3] - there[4]) / 2.0;
    println!("{board}: aligned {aligned:+.3}° from the host, late by {late:+.4}° at 286 Hz");
    assert!(aligned.abs() < 0.1 && late.abs() < 0.02, "{board}: {means:?}");
}

/// The Halls are held when the firmware's constants say: the delay that the drive predicts over, and how much too early
/// Hall 1 is.
fn samples_as_the_settings_say(session: &Session, settings: &Settings, early: u32) {
    let facts = session.machine.system.facts();
    let held_ns = [1, 2, 3].map(|hall| {
        let one = facts.sampling.iter().find(|one| one.signal.starts_with(&format!("hall {hall}")));
        one.expect("a Hall").held_ns.max
    });
    let tick_ns = 1e9 / f64::from(HCLK_HZ);
    assert_eq!(held_ns[1], held_ns[2]);
    assert!((held_ns[1] - held_ns[0] - f64::from(early) * tick_ns).abs() < tick_ns, "{held_ns:?}, {early}");
    let told_ns = 1e9 * f64::from(settings.halls_held_s);
    assert!((held_ns[1] - told_ns).abs() < 2.0 * tick_ns, "{held_ns:?} ns, and the drive believes {told_ns} ns");
}

#[test]
fn the_nucleo_knows_the_angle_as_the_host_does() {
    equals(NUCLEO, nucleo::settings(), 0);
}

#[test]
fn the_esc_knows_the_angle_as_the_host_does() {
    equals(ESC, esc1::settings(), esc1::EARLY);
}
