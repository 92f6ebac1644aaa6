//! The drive step by step, with codes straight from a model.

use super::*;
use crate::angle::Position;
use crate::commutation::Modulation;
use crate::control::{Current, Speed};
use crate::hall::model::Model;
use crate::service::{self, Service};
use crate::settings::Settings;
use proptest::prelude::*;

extern crate std;
use std::boxed::Box;
use std::vec::Vec;

const TURN: f64 = 4_294_967_296.0;

/// A drive with its service, and a rotor that is where the test puts it.
struct Bench {
    drive: Drive,
    service: Service,
    model: Model,
    rotor: ElectricalAngle,
    config: Config,
    /// Whether currents, voltage and temperatures are there.
    healthy: bool,
}

impl Bench {
    fn new(settings: &Settings) -> Self {
        let config = settings.validate().unwrap();
        let (interrupt, tasks) = Box::leak(Box::new(Channels::new())).split();
        let estimators = [(); 2].map(|()| Box::leak(Box::new(Estimator::blank())));
        Self {
            drive: Drive::new(config, interrupt),
            service: Service::new(config, tasks, estimators),
            model: Model::nominal(12, 600.0, ElectricalAngle::THIRD),
            rotor: ElectricalAngle::from_degrees(10.0),
            config,
            healthy: false,
        }
    }

    /// Installed and running.
    fn running() -> Self {
        let mut bench = Self::new(&Settings::default());
        bench.install().unwrap();
        bench.command(Command::Arm).unwrap();
        bench
    }

    fn install(&mut self) -> Reply {
        self.service.install(&self.model).unwrap();
        loop {
            match self.service.poll() {
                Some(service::Event::Installed(reply)) => return reply,
                Some(_) => {}
                None => drop(self.step()),
            }
        }
    }

    fn step(&mut self) -> Output {
        self.step_with(self.model.codes(self.rotor))
    }

    fn step_with(&mut self, halls: Codes) -> Output {
        let sample = if self.healthy { healthy(halls) } else { Sample { halls, ..Sample::default() } };
        self.drive.step(&sample)
    }

    fn reply(&mut self) -> Reply {
        loop {
            match self.service.poll() {
                Some(service::Event::Reply(reply)) => return reply,
                Some(_) => {}
                None => drop(self.step()),
            }
        }
    }

    fn command(&mut self, command: Command) -> Reply {
        self.service.send(command).unwrap();
        self.reply()
    }

    fn mode(&self) -> Mode {
        self.drive.mode()
    }
}

#[test]
fn nothing_moves_before_a_calibration() {
    let mut bench = Bench::new(&Settings::default());
    assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
    assert_eq!(bench.command(Command::Drive(Modulation::from_num(0.5))), Err(Refusal::Mode(Mode::Unarmed)));
    for _ in 0..100 {
        assert_eq!(bench.step(), Output::OFF);
    }
    assert_eq!(bench.mode(), Mode::Unarmed);
}

#[test]
fn arms_drives_and_disarms() {
    let mut bench = Bench::running();
    let idle = bench.step();
    assert_eq!((idle.legs, idle.compare), (Legs::ALL, [1062; 3]));
    bench.command(Command::Drive(Modulation::from_num(0.5))).unwrap();
    // At 10° the field stands at 100°: A just below one half, B above, C below.
    let [a, b, c] = bench.step().compare;
    assert!(a < 1062 && b > 1400 && c < 900, "{a} {b} {c}");
    bench.command(Command::Drive(Modulation::from_num(-0.5))).unwrap();
    let [a, b, c] = bench.step().compare;
    assert!(a > 1062 && b < 700 && c > 1200, "{a} {b} {c}");
    bench.command(Command::Disarm).unwrap();
    assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Ready));
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.step().compare, [1062; 3], "the old command is forgotten");
}

#[test]
fn phase_advance_leads_in_both_directions() {
    let [mut plain, mut ahead] = [0.0, 20.0].map(|phase_advance_deg| {
        let mut bench = Bench::new(&Settings { phase_advance_deg, ..Settings::default() });
        bench.install().unwrap();
        bench.command(Command::Arm).unwrap();
        bench
    });
    for (modulation, turned) in [(0.5, 20.0), (-0.5, -20.0)] {
        for bench in [&mut plain, &mut ahead] {
            bench.command(Command::Drive(Modulation::from_num(modulation))).unwrap();
        }
        let field = |bench: &mut Bench| {
            let [a, b, c] = bench.step().compare.map(|compare| f32::from(compare) - 1062.0);
            ElectricalAngle::from_radians(libm::atan2f((b - c) / libm::sqrtf(3.0), a))
        };
        let difference = (field(&mut ahead) - field(&mut plain)).to_degrees();
        assert!((difference - turned).abs() < 0.2, "{modulation} {difference}");
    }
}

#[test]
fn block_commutation_opens_one_leg() {
    let mut bench = Bench::new(&Settings { commutation: Commutation::Block, ..Settings::default() });
    bench.install().unwrap();
    bench.command(Command::Arm).unwrap();
    bench.command(Command::Drive(Modulation::from_num(0.4))).unwrap();
    let mut opened = Vec::new();
    for k in 0..3600 {
        bench.rotor = ElectricalAngle::from_degrees(k as f32 / 10.0);
        let output = bench.step();
        let open: Vec<_> = (0..3).filter(|&leg| !output.legs.contains(leg)).collect();
        assert_eq!(open.len(), 1);
        if opened.last() != Some(&open[0]) {
            opened.push(open[0]);
        }
    }
    // A is at rest first; six steps and the beginning of the first again.
    assert!(opened.windows(2).all(|pair| pair[1] == (pair[0] + 2) % 3), "{opened:?}");
    assert!((6..=7).contains(&opened.len()), "{opened:?}");
}

#[test]
fn a_command_beyond_the_limit_is_refused_and_changes_nothing() {
    let mut bench = Bench::new(&Settings { max_modulation: 0.5, ..Settings::default() });
    bench.install().unwrap();
    bench.command(Command::Arm).unwrap();
    bench.command(Command::Drive(Modulation::from_num(0.4))).unwrap();
    let before = bench.step();
    for modulation in [0.51, -0.51, -1.0] {
        assert_eq!(bench.command(Command::Drive(Modulation::from_num(modulation))), Err(Refusal::TooLarge));
    }
    assert_eq!(bench.step(), before);
}

#[test]
fn the_duty_limit_is_reported() {
    let mut bench = Bench::running();
    bench.command(Command::Drive(Modulation::from_num(0.5))).unwrap();
    assert!(!bench.drive.limits().contains(Limits::DUTY));
    bench.command(Command::Drive(Modulation::MAX)).unwrap();
    assert!(bench.drive.limits().contains(Limits::DUTY));
}

/// Steps until the bridge is off; `None` when it stays on.
fn steps_to_off(bench: &mut Bench, codes: impl Fn(&Bench) -> Codes) -> Option<u32> {
    (1..1000).find(|_| {
        let codes = codes(bench);
        bench.step_with(codes).legs == Legs::NONE
    })
}

#[test]
fn implausible_samples_are_tolerated_then_latched() {
    type Disturb = fn(&Bench) -> Codes;
    let cases: [(Disturb, Fault); 6] = [
        (|b| with(b, 0, 0), Fault::Hall(Implausible::AtRail(crate::hall::Channel(0)))),
        (|b| with(b, 1, 4095), Fault::Hall(Implausible::AtRail(crate::hall::Channel(1)))),
        (|b| with(b, 2, 1000), Fault::Hall(Implausible::OutOfRange(crate::hall::Channel(2)))),
        (|_| [2048; 3], Fault::Hall(Implausible::Weak)),
        (|b| with(b, 0, 1300), Fault::Hall(Implausible::Inconsistent)),
        (|b| b.model.codes(b.rotor + ElectricalAngle::from_degrees(100.0)), Fault::AngleJump),
    ];
    for (disturb, fault) in cases {
        let mut bench = Bench::running();
        // As many as are tolerated do nothing but be reported.
        for _ in 0..8 {
            let codes = disturb(&bench);
            assert_eq!(bench.step_with(codes).legs, Legs::ALL, "{fault:?}");
            assert!(bench.drive.limits().contains(Limits::EXTRAPOLATED));
        }
        bench.step();
        assert!(!bench.drive.limits().contains(Limits::EXTRAPOLATED));
        assert_eq!(steps_to_off(&mut bench, disturb), Some(9), "{fault:?}");
        assert_eq!(bench.mode(), Mode::Faulted(fault));
        // Latched: good samples do not bring it back, nor do commands.
        for _ in 0..100 {
            assert_eq!(bench.step(), Output::OFF);
        }
        assert_eq!(bench.command(Command::Arm), Err(Refusal::Mode(Mode::Faulted(fault))));
        bench.command(Command::Clear).unwrap();
        assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Ready));
        bench.command(Command::Arm).unwrap();
    }
}

fn with(bench: &Bench, channel: usize, code: u16) -> Codes {
    let mut codes = bench.model.codes(bench.rotor);
    codes[channel] = code;
    codes
}

#[test]
fn while_extrapolating_the_field_goes_on_at_the_speed() {
    let mut bench = Bench::running();
    bench.command(Command::Drive(Modulation::from_num(0.5))).unwrap();
    let step = ElectricalAngle::from_turns(400.0 / 40e3);
    for _ in 0..2000 {
        bench.rotor += step;
        bench.step();
    }
    for _ in 0..8 {
        bench.rotor += step;
        bench.step_with([0; 3]);
        assert!((bench.drive.tracker().angle() - bench.rotor).to_degrees().abs() < 0.3);
    }
    let turns = bench.drive.tracker().position().to_turns();
    assert!((turns - 2008.0 * 0.01 - 10.0 / 360.0).abs() < 0.01, "{turns}");
}

#[test]
fn over_speed_switches_off() {
    let mut bench = Bench::new(&Settings { max_electrical_hz: 500.0, ..Settings::default() });
    bench.install().unwrap();
    bench.command(Command::Arm).unwrap();
    let mut hz = 0.0;
    while bench.mode() == Mode::Running {
        hz += 0.5;
        bench.rotor += ElectricalAngle::from_turns(hz / 40e3);
        bench.step();
        assert!(hz < 600.0);
    }
    assert_eq!(bench.mode(), Mode::Faulted(Fault::OverSpeed));
    assert!(hz > 490.0, "{hz}");
}

#[test]
fn arming_needs_an_angle() {
    let mut bench = Bench::new(&Settings::default());
    bench.install().unwrap();
    for _ in 0..20 {
        bench.step_with([0; 3]);
    }
    bench.service.send(Command::Arm).unwrap();
    for _ in 0..2 {
        assert_eq!(bench.step_with([0; 3]), Output::OFF);
    }
    assert_eq!(bench.reply(), Err(Refusal::NoAngle));
    // When the Halls are back, wherever the rotor is by now, so is the drive.
    bench.rotor = ElectricalAngle::from_degrees(140.0);
    for _ in 0..20 {
        bench.step();
    }
    bench.command(Command::Arm).unwrap();
    assert!((bench.drive.tracker().angle() - bench.rotor).to_degrees().abs() < 0.2);
}

#[test]
fn a_calibration_can_be_stopped_and_repeated() {
    let mut bench = Bench::running();
    assert_eq!(bench.command(Command::Calibrate), Err(Refusal::Mode(Mode::Running)));
    bench.command(Command::Disarm).unwrap();
    for disarm_after in [10, 20_000, 60_000] {
        bench.command(Command::Calibrate).unwrap();
        for k in 0..disarm_after {
            bench.rotor = bench.drive.tracker().angle();
            bench.step();
            if k % 40 == 0 {
                while bench.service.poll().is_some() {}
            }
        }
        assert!(bench.mode().drives());
        bench.command(Command::Disarm).unwrap();
        assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Unarmed));
    }
    bench.command(Command::Calibrate).unwrap();
    let mut progress = 0.0;
    let calibration = loop {
        // An ideal rotor that follows the field 5° behind.
        bench.rotor = bench.drive.tracker().angle();
        bench.step();
        if bench.mode() == Mode::Calibrating {
            assert!(bench.service.progress() >= progress);
            progress = bench.service.progress();
        }
        match bench.service.poll() {
            Some(service::Event::Calibrated(calibration)) => break calibration,
            Some(service::Event::Refused(error)) => panic!("{error}"),
            _ => {}
        }
    };
    assert!(progress > 0.99, "{progress}");
    let alignment = calibration.model.electrical(ElectricalAngle::ZERO) - bench.model.electrical(ElectricalAngle::ZERO);
    assert!(alignment.to_degrees().abs() < 0.5, "{alignment}");
    // A command waits while a record is handed over.
    bench.step();
    bench.step();
    assert_eq!(bench.mode(), Mode::Ready);
    bench.command(Command::Arm).unwrap();
}

#[test]
fn bad_samples_fail_the_calibration() {
    let mut bench = Bench::new(&Settings::default());
    bench.command(Command::Calibrate).unwrap();
    let error = loop {
        bench.step_with([2048, 2040, 2060]);
        match bench.service.poll() {
            Some(service::Event::Refused(error)) => break error,
            Some(service::Event::Calibrated(_)) => panic!("calibrated on nothing"),
            _ => {}
        }
    };
    assert_eq!(error, crate::hall::calibrate::Error::NoSignal(crate::hall::Channel(0)));
    bench.step();
    bench.step();
    assert_eq!(bench.mode(), Mode::Faulted(Fault::Calibration));
    bench.command(Command::Clear).unwrap();
    assert_eq!(bench.mode(), Mode::Unarmed);
    assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
}

#[test]
fn estimators_come_back() {
    let mut bench = Bench::running();
    // While running, too: that is how the adaptation works.
    for k in 0..100 {
        bench.model.sensors[0].amplitude = 600.0 + k as f32;
        bench.install().unwrap();
        assert_eq!(bench.step().legs, Legs::ALL);
    }
}

#[test]
fn records_are_decimated_and_numbered() {
    let mut bench = Bench::running();
    let mut sequences = Vec::new();
    for _ in 0..4000 {
        bench.step();
        while let Some(event) = bench.service.poll() {
            if let service::Event::Record(record) = event {
                sequences.push(record.sequence);
            }
        }
    }
    assert!((99..=101).contains(&sequences.len()), "{}", sequences.len());
    assert!(sequences.windows(2).all(|pair| pair[1] - pair[0] == 40));
}

#[test]
fn a_fault_is_told_at_once_and_the_numbers_stay_right() {
    for extra in 0..80 {
        let mut bench = Bench::running();
        let mut steps = 0_u32;
        let mut last = None;
        let mut number = |bench: &mut Bench, halls: Option<Codes>| {
            let halls = halls.unwrap_or_else(|| bench.model.codes(bench.rotor));
            bench.step_with(halls);
            steps += 1;
            while let Some(event) = bench.service.poll() {
                if let service::Event::Record(record) = event {
                    if let Some((sequence, at)) = last {
                        assert_eq!(record.sequence - sequence, steps - at, "{extra}");
                    }
                    last = Some((record.sequence, steps));
                }
            }
            (bench.mode(), last)
        };
        for _ in 0..100 + extra {
            number(&mut bench, None);
        }
        let mut told = None;
        for k in 0..200 {
            let (mode, record) = number(&mut bench, Some([0; 3]));
            if mode != Mode::Running && told.is_none() {
                told = Some(k + 1);
                continue;
            }
            if told == Some(k) {
                // By the step that found it, or the next.
                let at = record.map_or(0, |(_, at)| at);
                assert!((100 + extra + k..=100 + extra + k + 1).contains(&at), "{extra} {k} {at}");
            }
        }
        assert!(told.is_some());
    }
}

#[derive(Clone, Debug)]
enum Action {
    Halls(Codes),
    Turn(f32),
    Command(u8, i16),
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        1 => any::<Codes>().prop_map(Action::Halls),
        1 => proptest::array::uniform3(0..4096_u16).prop_map(Action::Halls),
        8 => (-0.06_f32..0.06).prop_map(Action::Turn),
        2 => (any::<u8>(), any::<i16>()).prop_map(|(kind, bits)| Action::Command(kind, bits)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    /// Whatever is sampled and commanded: compare values stay in the limits, and the bridge is on only in a state that drives.
    #[test]
    fn no_sequence_leaves_the_limits(actions in proptest::collection::vec(action(), 1..400), block: bool, reversed: bool) {
        let commutation = if block { Commutation::Block } else { Commutation::Sinusoidal };
        let mut bench = Bench::new(&Settings { commutation, reversed, ..Settings::default() });
        bench.install().unwrap();
        bench.command(Command::Arm).unwrap();
        let highest = crate::pwm::highest_compare(bench.config.period, 170e6, 1e-6, 500e-9);
        for action in actions {
            let output = match action {
                Action::Halls(halls) => bench.step_with(halls),
                Action::Turn(turns) => {
                    bench.rotor += ElectricalAngle::from_turns(turns);
                    bench.step()
                }
                Action::Command(kind, bits) => {
                    let command = match kind % 6 {
                        0 => Command::Arm,
                        1 => Command::Disarm,
                        2 => Command::Clear,
                        3 => Command::Calibrate,
                        _ => Command::Drive(Modulation::from_bits(bits)),
                    };
                    let _ = bench.service.send(command);
                    bench.step()
                }
            };
            while bench.service.poll().is_some() {}
            prop_assert_eq!(output.legs != Legs::NONE, bench.mode().drives());
            if output.legs != Legs::NONE {
                prop_assert!(output.compare.iter().all(|&compare| compare <= highest), "{:?}", output);
            }
        }
    }
}

#[test]
fn speed_in_hertz() {
    let mut bench = Bench::running();
    for _ in 0..2000 {
        bench.rotor += ElectricalAngle::from_bits((TURN * 123.0 / 40e3) as i32);
        bench.step();
    }
    let hz = bench.drive.live().electrical_hz(40e3);
    assert!((hz - 123.0).abs() < 0.5, "{hz}");
}

/// 24 V, no current, 25 °C.
fn healthy(halls: Codes) -> Sample {
    Sample { halls, currents: [2048; 3], bus: 2708, temperatures: [2048; 2], lost: 0 }
}

fn with_control(commutation: Commutation, change: impl Fn(&mut crate::control::settings::Settings)) -> Bench {
    let mut control = crate::control::settings::Settings::default();
    change(&mut control);
    let mut bench = Bench::new(&Settings { commutation, control: Some(control), ..Settings::default() });
    bench.healthy = true;
    bench.install().unwrap();
    bench
}

#[test]
fn a_drive_without_current_control_says_so() {
    let mut bench = Bench::running();
    assert_eq!(bench.command(Command::Current(Current(0))), Err(Refusal::NoControl));
    bench.command(Command::Disarm).unwrap();
    assert_eq!(bench.command(Command::Commutate(Commutation::FieldOriented)), Err(Refusal::NoControl));
    let settings = Settings { commutation: Commutation::FieldOriented, ..Settings::default() };
    assert_eq!(settings.validate(), Err(crate::settings::Error::NoControl));
}

#[test]
fn the_commutation_changes_only_while_the_bridge_is_off() {
    let mut bench = with_control(Commutation::Block, |_| ());
    bench.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.command(Command::Commutate(Commutation::Block)), Err(Refusal::Mode(Mode::Running)));
    assert_eq!(bench.drive.commutation(), Commutation::FieldOriented);
}

#[test]
fn demands_beyond_the_limits_are_refused() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    assert_eq!(bench.command(Command::Current(Current(0))), Err(Refusal::Mode(Mode::Ready)));
    bench.command(Command::Arm).unwrap();
    for bad in [i32::MAX, i32::MIN, 20_000, -20_000] {
        assert_eq!(bench.command(Command::Current(Current(bad))), Err(Refusal::TooLarge));
    }
    assert_eq!(bench.command(Command::Speed(Speed(i32::MIN))), Err(Refusal::TooLarge));
    assert_eq!(bench.mode(), Mode::Running);
}

#[test]
fn nothing_is_armed_that_would_fail_at_once() {
    type Spoil = fn(&mut Sample);
    let cases: [(Spoil, Fault); 6] = [
        (|s| s.bus = 1000, Fault::UnderVoltage),
        (|s| s.bus = 4000, Fault::OverVoltage),
        (|s| s.currents[1] = 4095, Fault::OverCurrent),
        (|s| s.temperatures[0] = 100, Fault::BridgeHot),
        (|s| s.temperatures[1] = 100, Fault::MotorHot),
        (|s| s.lost = 1, Fault::Deadline),
    ];
    for (spoil, fault) in cases {
        let mut bench = with_control(Commutation::FieldOriented, |_| ());
        bench.service.send(Command::Arm).unwrap();
        let mut sample = healthy(bench.model.codes(bench.rotor));
        spoil(&mut sample);
        while bench.service.poll().is_some() {}
        bench.drive.step(&sample);
        bench.drive.step(&sample);
        assert_eq!(bench.reply(), Err(Refusal::Fault(fault)));
        // The same while running.
        bench.command(Command::Arm).unwrap();
        bench.command(Command::Current(Current(100))).unwrap();
        let off = (1..=8).find(|_| bench.drive.step(&sample).legs == Legs::NONE);
        assert!(off.is_some_and(|steps| steps == 1 || matches!(fault, Fault::BridgeHot | Fault::MotorHot)));
        assert_eq!(bench.mode(), Mode::Faulted(fault));
    }
}

#[test]
fn heat_reduces_the_current_before_it_is_a_fault() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    bench.command(Command::Arm).unwrap();
    let full = bench.config.control.unwrap().current(3.0).unwrap();
    bench.command(Command::Current(full)).unwrap();
    // Half way in codes from 80 to 100 °C.
    let ntc = crate::control::settings::Thermistor::ntc_10k(80.0, 100.0);
    let code = (ntc.code(80.0) + ntc.code(100.0)) / 32.0;
    let mut sample = healthy(bench.model.codes(bench.rotor));
    sample.temperatures[0] = code as u16;
    for _ in 0..2 * CYCLE {
        bench.drive.step(&sample);
    }
    let share = bench.drive.state().wanted as f32 / full.0 as f32;
    assert!((share - 0.5).abs() < 0.02, "{share}");
    assert!(bench.drive.limits().contains(Limits::HEAT.with(Limits::CURRENT)));
}

#[test]
fn records_while_following_are_numbered_and_come_as_often() {
    for end in [Command::Disarm, Command::Trip(Fault::Encoder)] {
        let mut bench = with_control(Commutation::FieldOriented, |_| ());
        bench.command(Command::Arm).unwrap();
        let (mut rotors, mut records, mut states) = (Vec::new(), Vec::new(), Vec::new());
        let mut run = |bench: &mut Bench, count: u32| {
            for _ in 0..count {
                bench.rotor = bench.rotor + ElectricalAngle::from_degrees(1.0);
                bench.step();
                let now = rotors.len() as u32;
                rotors.push(*bench.drive.tracker());
                while let Some(event) = bench.service.poll() {
                    if let service::Event::Record(record) = event {
                        records.push((record, now));
                    }
                }
                while let Some(measurement) = bench.service.measurement() {
                    states.push((measurement, now));
                }
            }
        };
        run(&mut bench, 100);
        bench.service.send(Command::Speed(Speed(0))).unwrap();
        run(&mut bench, 8000);
        bench.service.send(end).unwrap();
        run(&mut bench, 900);
        let start = records[0].1.wrapping_sub(records[0].0.sequence);
        let index = |sequence: u32| sequence.wrapping_add(start) as usize;
        // The number is that of the step whose rotor it is; while following, it is told in the next.
        for (record, now) in &records {
            assert!((0..=1).contains(&(*now as usize - index(record.sequence))), "{record:?} {now}");
            assert_eq!(record.rotor, rotors[index(record.sequence)], "{record:?}");
        }
        // Regularly, from arming on to the end; a fault is told at once.
        let irregular =
            records.windows(2).filter(|pair| pair[1].0.sequence.wrapping_sub(pair[0].0.sequence) != CYCLE).count();
        assert!(irregular <= 1, "{records:?}");
        assert!((281..=283).contains(&records.len()), "{}", records.len());
        // Noted down in slot 13, of the step before, and handed over in slot 31.
        for (measurement, now) in states.iter().skip(5) {
            assert_eq!(*now as usize - index(measurement.sequence), 19);
            assert_eq!(measurement.rotor, rotors[index(measurement.sequence)], "{measurement:?}");
        }
        assert!((250..=254).contains(&states.len()), "{}", states.len());
    }
}

#[test]
fn two_halls_that_contradict_each_other_are_found_within_eight_steps() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    bench.command(Command::Arm).unwrap();
    bench.command(Command::Current(Current(0))).unwrap();
    for extra in 0..40 {
        for _ in 0..extra {
            bench.step();
        }
        assert_eq!(bench.drive.live().missed, 0);
        // Plausible each for itself, and together not at all.
        let mut codes = bench.model.codes(bench.rotor);
        codes[1] = codes[1].wrapping_add(350);
        codes[2] = codes[2].wrapping_add(350);
        let found = (1..=8).find(|_| {
            bench.step_with(codes);
            bench.drive.live().missed != 0
        });
        assert!(found.is_some(), "{extra}");
        for _ in 0..4 {
            bench.step();
        }
        assert_eq!(bench.mode(), Mode::Running);
    }
}

#[test]
fn silence_stops_the_drive_if_so_chosen() {
    use crate::control::settings::OnTimeout;
    let mut bench = with_control(Commutation::FieldOriented, |control| {
        control.guard.command_timeout_s = 0.01;
        control.guard.on_timeout = OnTimeout::Stop;
    });
    bench.command(Command::Arm).unwrap();
    let speed = bench.config.control.unwrap().speed(100.0).unwrap();
    bench.command(Command::Speed(speed)).unwrap();
    for _ in 0..390 {
        bench.step();
    }
    // What the tasks do by themselves is no sign of life of whoever commands.
    bench.install().unwrap();
    assert!(!bench.drive.limits().contains(Limits::TIMEOUT));
    for _ in 0..10 + 2 * OUTER {
        bench.step();
    }
    assert!(bench.drive.limits().contains(Limits::TIMEOUT));
    assert_eq!(bench.drive.servo.demand, Demand::Speed(Speed(0)));
    bench.command(Command::Speed(speed)).unwrap();
    assert!(!bench.drive.limits().contains(Limits::TIMEOUT));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_input_sequence_leaves_the_duty_limits(
        steps in prop::collection::vec((any::<[u16; 3]>(), any::<[u16; 3]>(), any::<u16>(), 0..12_u8, any::<i32>()), 1..300),
        commutation in 0..3_usize, wild in any::<bool>(),
    ) {
        let commutation = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block][commutation];
        let mut bench = with_control(commutation, |_| ());
        let highest = bench.config.limits.clamped(i32::MAX);
        bench.command(Command::Arm).unwrap();
        for (halls, currents, bus, what, value) in steps {
            let command = match what {
                0 => Some(Command::Current(Current(value >> 18))),
                1 => Some(Command::Speed(Speed(value >> 6))),
                2 => Some(Command::Position(Position::from_bits(i64::from(value) << 8))),
                3 => Some(Command::Drive(Modulation::from_bits(value as i16))),
                4 => Some(Command::Clear),
                5 => Some(Command::Arm),
                _ => None,
            };
            if let Some(command) = command {
                let _ = bench.service.send(command);
            }
            bench.rotor += ElectricalAngle::from_bits(value >> 8);
            // Codes within the allowed keep it running; any codes at all must do no harm either.
            let codes = |codes: [u16; 3]| codes.map(|code| if wild { code } else { 2048 + code % 1000 - 500 });
            let sample = Sample {
                halls: if wild { halls } else { bench.model.codes(bench.rotor) },
                currents: codes(currents),
                bus: if wild { bus } else { 1500 + bus % 2000 },
                ..healthy([0; 3])
            };
            let output = bench.drive.step(&sample);
            prop_assert!(output.compare.iter().all(|&compare| compare <= highest), "{output:?}");
            prop_assert!(bench.mode().drives() || output == Output::OFF);
            while bench.service.poll().is_some() {}
        }
    }
}

#[test]
fn other_settings_are_taken_up_while_the_bridge_is_off_only() {
    let mut bench = Bench::running();
    let first = bench.config;
    let other = Settings { max_modulation: 0.25, ..Settings::default() }.validate().unwrap();
    bench.service.configure(Box::leak(Box::new(other))).unwrap();
    // One at a time.
    assert!(bench.service.configure(Box::leak(Box::new(other))).is_err());
    assert_eq!(bench.reply(), Err(Refusal::Mode(Mode::Running)));
    assert_eq!(*bench.service.config(), first);
    // They come back as they went.
    let refused = bench.service.unused_config().unwrap();
    assert_eq!(*refused, other);

    bench.command(Command::Disarm).unwrap();
    bench.service.configure(refused).unwrap();
    assert_eq!(bench.reply(), Ok(()));
    assert_eq!(*bench.service.config(), other);
    assert_eq!(*bench.service.unused_config().unwrap(), first);
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.command(Command::Drive(Modulation::from_num(0.3))), Err(Refusal::TooLarge));
}
