//! A refused command changes nothing: of two drives fed alike one gets it, and both go on alike to the bit.

use super::*;
use crate::settings::{Control, OnTimeout};
use crate::telemetry::Measurement;

const COMMUTATIONS: [Option<Commutation>; 4] =
    [None, Some(Commutation::FieldOriented), Some(Commutation::Sinusoidal), Some(Commutation::Block)];

/// Where a drive is when the command comes.
#[derive(Clone, Copy, Debug)]
enum Situation {
    Unarmed,
    Aligning,
    Calibrating,
    Ready,
    /// Ready, but with what would be a fault at once.
    Unfit,
    /// Ready, but the Halls give no angle.
    Blind,
    Voltage,
    Current,
    Speed,
    Position,
    Impedance,
    Faulted,
}

const SITUATIONS: [Situation; 12] = [
    Situation::Unarmed,
    Situation::Aligning,
    Situation::Calibrating,
    Situation::Ready,
    Situation::Unfit,
    Situation::Blind,
    Situation::Voltage,
    Situation::Current,
    Situation::Speed,
    Situation::Position,
    Situation::Impedance,
    Situation::Faulted,
];

/// Every kind of command, some within and some beyond the limits.
type Make = fn(&Bench) -> Command;
const COMMANDS: [Make; 19] = [
    |_| Command::Calibrate,
    |bench| Command::Install(Box::leak(Box::new(Estimator::new(&bench.model, bench.config.adc_bits).unwrap()))),
    |_| Command::CalibrationFailed,
    |_| Command::Arm,
    |_| Command::Disarm,
    |_| Command::Drive(Modulation::from_num(0.3)),
    |_| Command::Drive(Modulation::MIN),
    |_| Command::Current(Current(100)),
    |_| Command::Current(Current(i32::MAX)),
    |_| Command::Speed(Speed(1000)),
    |_| Command::Speed(Speed(i32::MIN)),
    |_| Command::Position(Position::from_bits(1 << 33)),
    |bench| impedance(&bench.config, Motion::HERE),
    // Too far to be there at once, and out of the bounds.
    |bench| impedance(&bench.config, at_once(3.0, 0.0)),
    |bench| impedance(&bench.config, Motion::to(60.0)),
    |_| Command::Commutate(Commutation::Block),
    |_| Command::Commutate(Commutation::FieldOriented),
    |bench| Command::Configure(Box::leak(Box::new(bench.config))),
    |_| Command::Clear,
];

/// A drive and its rotor in a situation; `None` where there is no such situation.
fn bench(commutation: Option<Commutation>, situation: Situation) -> Option<Bench> {
    let mut control = Control::default();
    control.guard.command_timeout_s = 2e-3;
    control.guard.on_timeout = OnTimeout::Stop;
    (control.min_position_turns, control.max_position_turns) = (-50.0, 50.0);
    let settings = Settings {
        max_modulation: 0.9,
        commutation: commutation.unwrap_or_default(),
        control: commutation.map(|_| control),
        calibration_align_s: 0.05,
        ..Settings::default()
    };
    let mut bench = Bench::new(&settings);
    bench.healthy = true;
    if !matches!(situation, Situation::Unarmed | Situation::Aligning | Situation::Calibrating) {
        bench.install().unwrap();
    }
    let demand = match situation {
        Situation::Unarmed | Situation::Ready | Situation::Unfit | Situation::Blind => return Some(bench),
        Situation::Aligning => Command::Calibrate,
        Situation::Calibrating => {
            bench.command(Command::Calibrate).unwrap();
            while bench.mode() != Mode::Calibrating {
                bench.step();
            }
            return Some(bench);
        }
        Situation::Voltage => Command::Drive(Modulation::from_num(0.4)),
        Situation::Faulted => Command::Trip(Fault::Encoder),
        Situation::Current => Command::Current(Current(500)),
        Situation::Speed => Command::Speed(Speed(100_000)),
        Situation::Position => Command::Position(Position::from_bits(7 << 32)),
        Situation::Impedance if commutation.is_none() => return None,
        Situation::Impedance => impedance(&bench.config, Motion::to(1.5)),
    };
    if !matches!(situation, Situation::Aligning) {
        bench.command(Command::Arm).unwrap();
    }
    bench.command(demand).ok().map(|()| bench)
}

/// Everything that can be seen of a step.
type Seen = (Output, Record, State, Limits, ElectricalAngle);

fn step(bench: &mut Bench, situation: Situation, turn: ElectricalAngle) -> Seen {
    bench.rotor += turn;
    let mut sample = healthy(bench.model.codes(bench.rotor));
    match situation {
        Situation::Unfit => sample.bus = 100,
        Situation::Blind => sample.halls = [0; 3],
        _ => {}
    }
    let output = bench.drive.step(&sample);
    (output, *bench.drive.record(), *bench.drive.state(), bench.drive.limits(), bench.drive.trim())
}

/// What the tasks are told, but for the answers.
fn told(bench: &mut Bench) -> (Vec<Record>, Vec<Measurement>, Option<Reply>) {
    let (mut records, mut reply) = (Vec::new(), None);
    while let Some(event) = bench.service.poll() {
        match event {
            service::Event::Record(record) => records.push(record),
            service::Event::Reply(answer) | service::Event::Installed(answer) => reply = Some(answer),
            _ => {}
        }
    }
    (records, core::iter::from_fn(|| bench.service.measurement()).collect(), reply)
}

/// Whether the command was refused.
fn is_refused_without_a_trace(
    commutation: Option<Commutation>,
    situation: Situation,
    number: usize,
    wait: u32,
    turn: ElectricalAngle,
) -> bool {
    let [Some(mut with), Some(mut without)] = [(); 2].map(|()| bench(commutation, situation)) else { return false };
    let name = std::format!("{commutation:?} {situation:?} {:?}", COMMANDS[number](&with));
    let mut refused = None;
    for k in 0..wait + 300 {
        if k == wait {
            let command = COMMANDS[number](&with);
            with.service.send(command).unwrap();
        }
        let [one, other] = [&mut with, &mut without].map(|bench| step(bench, situation, turn));
        let ((records, measurements, reply), (other_records, other_measurements, _)) =
            (told(&mut with), told(&mut without));
        if let Some(reply) = reply {
            if reply.is_ok() {
                return false;
            }
            refused = Some(reply);
        }
        assert_eq!(one, other, "{name}, step {k}");
        assert_eq!((records, measurements), (other_records, other_measurements), "{name}, step {k}");
    }
    // What was left behind would show when the drive is used on.
    let next = |bench: &mut Bench| {
        let replies = [Command::Arm, Command::Drive(Modulation::from_num(0.2))].map(|command| bench.command(command));
        (replies, bench.step(), *bench.drive.record(), *bench.drive.state())
    };
    assert_eq!(next(&mut with), next(&mut without), "{name}");
    refused.is_some()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4))]
    // A command takes the place of a slot of the schedule: before each has had its turn once, what that would have noted for
    // the first time is missing.
    #[test]
    fn a_refused_command_changes_nothing(wait in 64..144_u32, degrees in -2.0..2.0_f32) {
        let turn = ElectricalAngle::from_degrees(degrees);
        let mut refused = 0;
        for commutation in COMMUTATIONS {
            for situation in SITUATIONS {
                for number in 0..COMMANDS.len() {
                    refused += u32::from(is_refused_without_a_trace(commutation, situation, number, wait, turn));
                }
            }
        }
        prop_assert!(refused > 300, "{}", refused);
    }
}
