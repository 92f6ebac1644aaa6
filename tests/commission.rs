//! Motors of every impedance, from the default settings and a current limit to speed control.

use hallservo::commutation::Commutation;
use hallservo::config::Config;
use hallservo::drive::Command;
use hallservo::drive::standstill::Probe;
use hallservo::fault::Fault;
use hallservo::hall::calibrate::{self, report::Report as Sensors};
use hallservo::mode::Mode;
use hallservo::service::Event;
use hallservo::service::commission::{Action, Commission};
use hallservo::service::identification::{Identification, Plan};
use hallservo::service::procedure::{Error, Procedure, Serve, State};
use hallservo::service::standstill::{Electrical, Standstill};
use hallservo::service::swings::{Rough, Swings};
use hallservo::settings::Settings;
use rayon::prelude::*;
use sim::motors::{MOTORS, Motor};
use sim::rig::Rig;

/// A drive at a motor, and the largest current that truly flowed.
struct Bench {
    rig: Rig,
    largest_a: f64,
}

impl Bench {
    fn run(&mut self, procedure: &mut dyn Procedure) -> State {
        for ms in 0..120_000_u32 {
            let state = procedure.serve(&mut self.rig.service, ms);
            if state != State::Running {
                return state;
            }
            for _ in 0..40 {
                self.step();
            }
        }
        panic!("stuck at {}", procedure.progress());
    }

    /// Runs for a time, serving the queues.
    fn wait(&mut self, seconds: f64) {
        for k in 0..self.rig.periods(seconds) {
            self.step();
            if k % 40 == 0 {
                self.rig.serve();
            }
        }
    }

    fn configure(&mut self, settings: &Settings) {
        let config = settings.validate().unwrap();
        self.rig.config = config;
        let lent: &'static mut Config = Box::leak(Box::new(config));
        self.rig.service.configure(lent).unwrap();
        self.wait(0.01);
    }

    fn calibrate(&mut self) -> Result<Sensors, calibrate::Error> {
        self.rig.command(Command::Calibrate).unwrap();
        let mut result = None;
        for _ in 0..120_000 {
            for _ in 0..40 {
                self.step();
            }
            while let Some(event) = self.rig.service.poll() {
                match event {
                    Event::Calibrated(found) => result = Some(Ok(found.report)),
                    Event::Refused(error) => result = Some(Err(error)),
                    _ => {}
                }
            }
            if let Some(result) = result {
                self.wait(0.01);
                if result.is_err() {
                    self.rig.command(Command::Clear).unwrap();
                }
                for _ in 0..50 {
                    self.wait(0.1);
                    if self.rig.plant.truth().speed_rad_s.abs() < 0.1 {
                        break;
                    }
                }
                return result;
            }
            assert!(!matches!(self.rig.drive.mode(), Mode::Faulted(_)), "{:?}", self.rig.drive.mode());
        }
        panic!("the calibration is stuck");
    }

    fn step(&mut self) {
        let period = self.rig.step();
        self.largest_a = period.truth.currents_a.iter().fold(self.largest_a, |most, a| most.max(a.abs()));
    }
}

/// What commissioning found, and what truly flowed.
struct Outcome {
    settings: Settings,
    electrical: Electrical,
    sensors: Sensors,
    tries: u32,
    rough: Rough,
    seconds: f64,
}

fn commission(bench: &mut Bench, settings: Settings, limit_a: f32) -> Result<Outcome, String> {
    let mut commission = Commission::new(settings, Some(limit_a)).map_err(|error| error.to_string())?;
    let (mut electrical, mut sensors, mut rough, mut tries) = (None, None, None, 0);
    loop {
        bench.configure(commission.settings());
        match commission.action() {
            Action::Measure => {
                let mut standstill = Standstill::new(&bench.rig.config).unwrap();
                let state = bench.run(&mut standstill);
                let found = *standstill.report().ok_or(format!("standstill: {state:?}"))?;
                commission.measured(&found).map_err(|error| format!("measured: {error}"))?;
                electrical = Some(found);
            }
            Action::Calibrate => {
                tries += 1;
                let result = bench.calibrate();
                commission.calibrated(result.as_ref().map_err(|error| *error)).map_err(|error| error.to_string())?;
                sensors = result.ok().or(sensors);
            }
            Action::Swing => {
                let mut swings = Swings::new(&bench.rig.config).unwrap();
                let state = bench.run(&mut swings);
                let found = *swings.report().ok_or(format!("swings: {state:?}"))?;
                commission.swung(&found).map_err(|error| format!("swung: {error}"))?;
                rough = Some(found);
                bench.wait(0.5);
            }
            Action::Identify => {
                let plan = Plan::new(&bench.rig.config).unwrap();
                let mut identification = Identification::new(&bench.rig.config, &plan).unwrap();
                let state = bench.run(&mut identification);
                let found = *identification.report().ok_or(format!("identification: {state:?}, {plan:?}"))?;
                commission.identified(&found).map_err(|error| format!("identified: {error}"))?;
            }
            Action::Done => break,
        }
    }
    Ok(Outcome {
        settings: *commission.settings(),
        electrical: electrical.unwrap(),
        sensors: sensors.unwrap(),
        tries,
        rough: rough.unwrap(),
        seconds: bench.rig.plant.truth().time_s,
    })
}

/// Speed reached at a share of the largest, relative to what was asked for, and its ripple.
fn turn(bench: &mut Bench, settings: &Settings, share: f64) -> Result<(f64, f64), String> {
    let control = settings.control.unwrap();
    let asked = share * f64::from(control.max_speed_rad_s);
    let rig = &mut bench.rig;
    rig.command(Command::Commutate(Commutation::FieldOriented)).map_err(|error| error.to_string())?;
    rig.command(Command::Arm).map_err(|error| error.to_string())?;
    let speed = rig.control().unwrap().speed(asked as f32).unwrap();
    rig.command(Command::Speed(speed)).map_err(|error| error.to_string())?;
    let settling_s = 1.0 + 2.0 / f64::from(control.speed_bandwidth_hz);
    let time_s = settling_s + asked.abs() / f64::from(control.max_acceleration_rad_s2);
    bench.wait(time_s);
    let (mut sum, mut square, count) = (0.0, 0.0, 8000);
    for k in 0..count {
        bench.step();
        if k % 40 == 0 {
            bench.rig.serve();
        }
        let speed = bench.rig.plant.truth().speed_rad_s / asked;
        sum += speed;
        square += speed * speed;
    }
    let mode = bench.rig.drive.mode();
    if mode != Mode::Running {
        return Err(format!("{mode:?}"));
    }
    let stop = bench.rig.control().unwrap().speed(0.0).unwrap();
    bench.rig.command(Command::Speed(stop)).map_err(|error| error.to_string())?;
    // A supply that takes nothing back makes braking slow.
    for _ in 0..300 {
        bench.wait(0.1);
        if bench.rig.plant.truth().speed_rad_s.abs() < 1.0 {
            break;
        }
    }
    bench.rig.command(Command::Disarm).map_err(|error| error.to_string())?;
    let mean = sum / f64::from(count);
    Ok((mean, (square / f64::from(count) - mean * mean).max(0.0).sqrt()))
}

fn attempt(case: &Motor, seed: u64) -> (String, bool) {
    let plant = case.plant(seed);
    let rig = Rig::new(&plant, &case.settings(), seed).unwrap();
    let mut bench = Bench { rig, largest_a: 0.0 };
    let outcome = commission(&mut bench, case.settings(), case.limit_a);
    let share = |found: f64, exact: f64| 100.0 * (found / exact - 1.0);
    let name = format!("{:16} {seed}", case.name);
    let largest = 100.0 * bench.largest_a / f64::from(case.limit_a);
    let outcome = match outcome {
        Err(error) => return (format!("{name} {largest:4.0} % of the limit; {error}"), false),
        Ok(outcome) => outcome,
    };
    let Outcome { settings, electrical, sensors, tries, rough, seconds } = outcome;
    let motor = &plant.motor;
    let control = settings.control.unwrap();
    let off = [
        share(electrical.resistance_ohm.value.into(), motor.resistance_ohm + plant.inverter.switch_ohm),
        share(electrical.inductance_h.value.into(), motor.inductance_h),
        share(control.flux_linkage_wb.into(), motor.back_emf.flux_linkage_vs),
        share(control.inertia_kgm2.into(), motor.inertia_kgm2),
    ];
    let turned = turn(&mut bench, &settings, 0.5).and_then(|forward| Ok((forward, turn(&mut bench, &settings, -0.1)?)));
    let largest = 100.0 * bench.largest_a / f64::from(case.limit_a);
    let rough = [
        share(rough.flux_linkage_wb.into(), motor.back_emf.flux_linkage_vs),
        share(rough.inertia_kgm2.into(), motor.inertia_kgm2),
    ];
    let text = format!(
        "{name} {largest:4.0} % of the limit, {seconds:3.0} s; R {:+.1} L {:+.1} λ {:+.1} J {:+.1} % (rough {:+.0} \
         {:+.0} %); {tries} × {} Hz, lag {:.0}° swing {:.1}°; {:.0} {:.1} Hz, {:.0} rad/s, {:.0} rad/s²: {turned:.3?}",
        off[0],
        off[1],
        off[2],
        off[3],
        rough[0],
        rough[1],
        settings.calibration_hz,
        sensors.lag.to_degrees().abs(),
        sensors.hunting_deg,
        control.current_bandwidth_hz,
        control.speed_bandwidth_hz,
        control.max_speed_rad_s,
        control.max_acceleration_rad_s2,
    );
    let good = off.iter().zip([5.0, 5.0, 10.0, 20.0]).all(|(off, most)| off.abs() <= most)
        && largest <= 120.0
        && turned.is_ok_and(|(fast, slow)| (fast.0 - 1.0).abs() < 0.02 && (slow.0 - 1.0).abs() < 0.05);
    (text, good)
}

#[test]
fn any_motor_is_commissioned_by_its_current_limit() {
    let jobs: Vec<_> = MOTORS.iter().flat_map(|case| [1, 2].map(|seed| (case, seed))).collect();
    let results: Vec<_> = jobs.par_iter().map(|(case, seed)| attempt(case, *seed)).collect();
    for (text, good) in &results {
        println!("{} {text}", if *good { " " } else { "!" });
    }
    assert!(results.iter().all(|(_, good)| *good));
}

/// What commissioning says of a motor with which something is wrong.
fn complaint(case: &Motor, break_it: impl FnOnce(&mut Rig)) -> String {
    let mut rig = Rig::new(&case.plant(1), &case.settings(), 1).unwrap();
    break_it(&mut rig);
    let mut bench = Bench { rig, largest_a: 0.0 };
    let Err(error) = commission(&mut bench, case.settings(), case.limit_a) else { panic!("nothing was wrong") };
    assert!(!bench.rig.drive.mode().drives() && bench.largest_a <= 1.2 * f64::from(case.limit_a), "{error}");
    error
}

#[test]
fn what_is_wrong_is_said() {
    let paper = &MOTORS[8];
    let disconnected = Motor { ohm: 1e6, ..*paper };
    let error = complaint(&disconnected, |_| ());
    assert!(error.contains("NoCurrent"), "{error}");
    let error = complaint(paper, |rig| rig.plant.set_dyno(Some(0.0)).unwrap());
    assert!(error.contains("no Hall sees the magnet turn"), "{error}");
    let error = complaint(paper, |rig| rig.plant.set_hall_fault(1, Some(plant::HallFault::StuckAt(1.65))));
    assert!(error.contains("Hall 2"), "{error}");
    // An amplifier that shows nothing, at each phase, on a board that does not notice by the sum of the currents.
    for phase in 0..3 {
        let error = complaint(&Motor { full_scale_a: 16.0, limit_a: 2.0, ..*paper }, |rig| {
            rig.disturb = Some(Box::new(move |sample| sample.currents[phase] = 2048));
        });
        assert!(error.contains("Uneven") || error.contains("NoCurrent"), "{error}");
    }
    // A shorted winding as far as the current limit goes: nothing leaps.
    let shorted = Motor { ohm: 0.5e-3, henry: 0.5e-6, ..MOTORS[6] };
    println!("{}", complaint(&shorted, |_| ()));
}

#[test]
fn a_measurement_at_standstill_ends_with_the_bridge_off() {
    type Meddle = fn(&mut Rig, &mut Standstill);
    let cases: [(Error, Meddle); 3] = [
        (Error::Cancelled, |_, standstill| standstill.cancel()),
        (Error::Disarmed, |rig, _| rig.service.send(Command::Disarm).unwrap()),
        (Error::Fault(Fault::OverVoltage), |rig, _| rig.disturb = Some(Box::new(|sample| sample.bus = 4000))),
    ];
    for (expected, meddle) in cases {
        let settings = limited(&MOTORS[8]);
        let mut rig = Rig::new(&MOTORS[8].plant(1), &settings, 1).unwrap();
        let mut standstill = Standstill::new(&rig.config).unwrap();
        let mut end = State::Running;
        for ms in 0..1000 {
            if ms == 300 {
                assert_eq!(rig.drive.mode(), Mode::Aligning);
                meddle(&mut rig, &mut standstill);
            }
            end = standstill.serve(&mut rig.service, ms);
            rig.run(1e-3, |_, _| ());
        }
        assert_eq!(end, State::Failed(expected));
        assert!(!rig.drive.mode().drives());
    }
}

#[test]
fn a_drive_that_nobody_asks_any_more_ends_the_measurement_by_itself() {
    let mut rig = Rig::new(&MOTORS[8].plant(1), &limited(&MOTORS[8]), 1).unwrap();
    rig.command(Command::Measure { begins: true, probe: Probe { phase: 0, current: 1000, ripple: 0 } }).unwrap();
    rig.run(0.3, |_, _| ());
    assert_eq!(rig.drive.mode(), Mode::Aligning);
    rig.run(0.2, |_, _| ());
    assert_eq!(rig.drive.mode(), Mode::Unarmed);
    // It is not begun again by going on, nor with more than the largest current.
    for (begins, current) in [(false, 1000), (true, 32_000)] {
        assert!(rig.command(Command::Measure { begins, probe: Probe { phase: 0, current, ripple: 0 } }).is_err());
    }
    assert_eq!(rig.drive.mode(), Mode::Unarmed);
}

fn limited(case: &Motor) -> Settings {
    *Commission::new(case.settings(), Some(case.limit_a)).unwrap().settings()
}

#[test]
fn a_calibration_with_the_settings_of_another_motor_keeps_the_current_limit() {
    let shares: Vec<_> = MOTORS
        .par_iter()
        .map(|case| {
            let rig = Rig::new(&case.plant(3), &limited(case), 3).unwrap();
            let mut bench = Bench { rig, largest_a: 0.0 };
            // It may fail, but by what it says of the sensors and not by a fault.
            let result = bench.calibrate().map(|report| report.hunting_deg);
            (case.name, bench.largest_a / f64::from(case.limit_a), result)
        })
        .collect();
    for (name, share, result) in shares {
        println!("{name:16} {:4.0} % of the limit: {result:?}", 100.0 * share);
        assert!(share <= 1.0, "{name}");
    }
}
