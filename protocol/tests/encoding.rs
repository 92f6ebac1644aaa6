//! The bytes of this version: when one of them changes, [`VERSION`] has to.

use hallservo::angle::ElectricalAngle;
use hallservo::commutation::Commutation;
use hallservo::control::Motor;
use hallservo::control::config::BadDemand;
use hallservo::control::impedance::{self, Field, Motion};
use hallservo::drive;
use hallservo::drive::standstill::Probe;
use hallservo::fault::{Fault, Limits};
use hallservo::hall::Channel;
use hallservo::hall::adapt::{self, Parameter};
use hallservo::hall::calibrate::report::{Finding, Pattern, Report, SensorReport};
use hallservo::hall::calibrate::{self, Sweep};
use hallservo::hall::estimate::BadModel;
use hallservo::mode::Mode;
use hallservo::pwm;
use hallservo::service::identify::{self, Estimate};
use hallservo::service::procedure;
use hallservo::settings::{self, Kind};
use hallservo_protocol::*;
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// The bytes of a value as postcard has them, which are those of the value in a message; and the value comes back.
fn hex<'a, T: Serialize + Deserialize<'a> + PartialEq + std::fmt::Debug>(value: &T) -> String {
    let bytes: &'static mut [u8] = Box::leak(Box::new([0; MESSAGE]));
    let bytes: &'static [u8] = postcard::to_slice(value, bytes).unwrap();
    let frame: &'static mut [u8; FRAME] = Box::leak(Box::new([0; FRAME]));
    let length = encode(value, frame).unwrap();
    assert_eq!(message(&frame[..length]), bytes);
    let decoder: &'static mut Decoder = Box::leak(Box::new(Decoder::new()));
    // Before the last byte there is nothing to borrow.
    assert!(frame[1..length - 1].iter().all(|byte| decoder.push::<u8>(*byte).is_none()));
    assert_eq!(decoder.push::<T>(0).unwrap().as_ref(), Ok(value));
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What a frame holds between its version and its CRC.
fn message(frame: &[u8]) -> Vec<u8> {
    let mut inside = [0; FRAME];
    let length = cobs::decode(&frame[1..frame.len() - 1], &mut inside).unwrap();
    inside[1..length - 4].to_vec()
}

#[test]
fn the_version_is_this_one() {
    assert_eq!(VERSION, 14);
}

#[test]
fn who_it_is() {
    let hello = Hello { board: "b", firmware: "1", serial: [1, 0x80, 0], settings: 2, step_hz: 1.0 };
    assert_eq!(hex(&Answer::Hello(hello)), "00016201310180010002 0000803f".replace(' ', ""));
}

#[test]
fn requests() {
    let asks = [
        (Ask::Hello, "01ac020000"),
        (Ask::Speed(-1.5), "01ac0200070000c0bf"),
        (Ask::Set { name: "stall_s", value: 1.0 }, "01ac020013077374616c6c5f730000803f"),
        (Ask::Commutate(Commutation::FieldOriented), "01ac02000902"),
        (Ask::History(3), "01ac02001803"),
        (Ask::Release, "01ac020019"),
        (Ask::Accept, "01ac02001a"),
        (
            Ask::Measure {
                begins: true,
                probe: Probe { phase: 1, current: 100, ripple: 2, across: true, swings_across: false },
            },
            "01ac02001b0101c801040100",
        ),
        (Ask::Swing, "01ac02001d"),
        (Ask::Reference, "01ac020020"),
    ];
    for (ask, bytes) in asks {
        assert_eq!(hex(&Request { id: 1, client: 300, unattended: false, ask }), bytes, "{ask:?}");
    }
    assert_eq!(hex(&Request { id: 1, client: 1, unattended: true, ask: Ask::Calibrate }), "0101010a");
}

#[test]
fn springs() {
    let request = impedance::Request { kp_nm_rad: Some(0.5), timeout_s: Some(1.0), ..impedance::Request::default() };
    let springs = [
        (impedance::Request::default(), "1f00000000803f0000803f000000000000000000000000000000"),
        (
            impedance::Request { motion: Motion::to(0.5), ..request },
            "1f010000003f000000803f0000803f00000000000001000000000000e03f00000000000000010000803f",
        ),
        (
            impedance::Request { motion: Motion::Within { least_turns: None, most_turns: Some(1.0) }, ..request },
            "1f010000003f000000803f0000803f0000000000010001000000000000f03f010000803f",
        ),
    ];
    for (request, bytes) in springs {
        assert_eq!(hex(&Ask::Impedance(request)), bytes, "{request:?}");
    }
    let state = impedance::State { position_turns: 1.0, complete: true, ..impedance::State::default() };
    assert_eq!(hex(&Answer::Reference(Some(state))), "0d01000000000000f03f000000000000000000000000000000000000000001");
    assert_eq!(hex(&Answer::Reference(None)), "0d00");
    assert_eq!(hex(&Refusal::Impedance(impedance::Error::NoControl)), "0b00");
    let range = impedance::Error::OutOfRange { field: Field::Kp, value: 2.0, least: 0.0, most: 1.0 };
    assert_eq!(hex(&range), "010000000040000000000000803f");
    assert_eq!(hex(&[impedance::Error::Moving, impedance::Error::Crossed]), "0203");
}

#[test]
fn states() {
    let modes = [
        (Mode::Unarmed, "00"),
        (Mode::Aligning, "01"),
        (Mode::Calibrating, "02"),
        (Mode::Ready, "03"),
        (Mode::Running, "04"),
        (Mode::Faulted(Fault::Turns), "0521"),
    ];
    for (mode, bytes) in modes {
        assert_eq!(hex(&mode), bytes, "{mode:?}");
    }
    // A fault is its code, of which all are in the library's tests.
    assert_eq!(hex(&Fault::Stall), "18");
    assert!(postcard::from_bytes::<Fault>(&[200]).is_err());
    assert_eq!(hex(&Limits::DUTY.with(Limits::TIMEOUT)), "21");
    assert_eq!(hex(&[Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented]), "000102");
    assert_eq!(hex(&[Kind::Real, Kind::Whole, Kind::Switch, Kind::Choice("a|b")]), "0001020303617c62");
    assert_eq!(
        hex(&Status::default()),
        concat!(
            "0000000001000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000",
            "0000"
        )
    );
    assert_eq!(
        hex(&Telemetry::default()),
        "00000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
    );
}

#[test]
fn refusals() {
    let drive = [
        (drive::Refusal::Mode(Mode::Running), "0004"),
        (drive::Refusal::NotCalibrated, "01"),
        (drive::Refusal::NoAngle, "02"),
        (drive::Refusal::TooLarge, "03"),
        (drive::Refusal::HallLost, "04"),
        (drive::Refusal::NoControl, "05"),
        (drive::Refusal::Fault(Fault::OverCurrent), "0615"),
        (drive::Refusal::Turning, "07"),
        (drive::Refusal::OutOfBounds, "08"),
    ];
    for (refusal, bytes) in drive {
        assert_eq!(hex(&refusal), bytes, "{refusal:?}");
    }
    let settings = [
        (
            settings::Error::OutOfRange { field: "stall_s", value: 1.0, min: 2.0, max: 3.0 },
            "00077374616c6c5f730000803f0000004000004040",
        ),
        (settings::Error::Pwm(pwm::Error::Period(1.0)), "01000000803f"),
        (settings::Error::NoControl, "02"),
        (settings::Error::Unknown, "03"),
        (settings::Error::Fixed, "04"),
        (settings::Error::NotWhole, "05"),
        (settings::Error::Ceiling { field: "stall_s", value: 2.0, most: 1.0 }, "06077374616c6c5f73000000400000803f"),
    ];
    for (error, bytes) in settings {
        assert_eq!(hex(&error), bytes, "{error:?}");
    }
    let procedure = [
        (procedure::Error::NoControl, "00"),
        (procedure::Error::FewRecords, "01"),
        (procedure::Error::Plan { field: "field" }, "02"),
        (procedure::Error::Demand(BadDemand { value: 2.0, most: 1.0 }), "03000000400000803f"),
        (procedure::Error::Refused(drive::Refusal::NoAngle), "0402"),
        (procedure::Error::Fault(Fault::Stall), "0518"),
        (procedure::Error::Disarmed, "06"),
        (procedure::Error::NoAnswer, "07"),
        (procedure::Error::NotReached, "08"),
        (procedure::Error::Inconclusive, "09"),
        (procedure::Error::NoTable, "0a"),
        (procedure::Error::Cancelled, "0b"),
        (procedure::Error::NoCurrent { phase: 2 }, "0c02"),
        (procedure::Error::Uneven, "0d"),
        (procedure::Error::Elsewhere, "0e"),
    ];
    for (error, bytes) in procedure {
        assert_eq!(hex(&error), bytes, "{error:?}");
    }
    let refusals = [
        (Refusal::Drive(drive::Refusal::NoAngle), "0002"),
        (Refusal::Demand(BadDemand { value: 2.0, most: 1.0 }), "01000000400000803f"),
        (Refusal::Procedure(procedure::Error::NoControl), "0200"),
        (Refusal::Setting(settings::Error::Fixed), "0304"),
        (Refusal::NothingStored(Problem::Version(3)), "040303"),
        (Refusal::Flash, "05"),
        (Refusal::NoTable, "06"),
        (Refusal::Busy(Activity::Cogging), "0703"),
        (Refusal::NoAnswer, "08"),
        (Refusal::Controlled, "09"),
        (Refusal::Unconfirmed(Problem::Foreign), "0a04"),
    ];
    for (refusal, bytes) in refusals {
        assert_eq!(hex(&refusal), bytes, "{refusal:?}");
    }
}

#[test]
fn calibrations() {
    use calibrate::Error;
    let hall = Channel(2);
    let errors = [
        (Error::Incomplete(Sweep::Forward), "0000"),
        (Error::Incomplete(Sweep::Backward), "0001"),
        (Error::NoSignal(hall), "0102"),
        (Error::NoFit, "02"),
        (Error::Busy, "04"),
        (Error::Model(BadModel::AdcBits(17)), "030011"),
        (Error::Model(BadModel::Sensor(hall)), "030102"),
        (Error::Model(BadModel::Placement { noise_gain: 1.5 }), "03020000c03f"),
        (Error::Refused(Finding::TooFar(hall, 12.0)), "05000200004041"),
        (Error::Refused(Finding::TooClose(hall)), "050102"),
        (Error::Refused(Finding::Unequal(2.5)), "050200002040"),
        (Error::Refused(Finding::Misplaced(hall, 24.0)), "0503020000c041"),
        (Error::Refused(Finding::Noisy(hall, 3.0)), "05040200004040"),
        (Error::Refused(Finding::Unexplained(7.0)), "05050000e040"),
        (Error::Refused(Finding::Lagging(70.0)), "050600008c42"),
        (Error::Refused(Finding::Hunting(9.0)), "050700001041"),
        (Error::SamplesLost { percent: 100 }, "0664"),
        (Error::NotTurning, "07"),
    ];
    for (error, bytes) in errors {
        assert_eq!(hex(&error), bytes, "{error:?}");
    }
    let sensor = |k: u8| SensorReport {
        swing: 400.0 + f32::from(k),
        offset: 2000.0 + f32::from(k),
        placement_error: ElectricalAngle::from_degrees(11.25 * f32::from(k)),
        third_pct: 5.0 + f32::from(k),
        fifth_pct: 1.0 + f32::from(k),
        noise_pct: 0.5 + f32::from(k),
        at_rail: u32::from(k),
    };
    let report = Report {
        sensors: [0, 1, 2].map(sensor),
        pattern: Pattern { spacing: 60, forward: true },
        residual_pct: 0.25,
        lag: ElectricalAngle::from_degrees(-22.5),
        hunting_deg: 0.75,
        angle_noise_deg: 0.375,
    };
    assert_eq!(
        hex(&report),
        concat!(
            "0000c8430000fa44000000a0400000803f0000003f000080c8430020fa4480808080010000c040000000400000c03f01",
            "0000c9430040fa4480808080020000e0400000404000002040023c010000803effffffff010000403f0000c03e",
        )
    );
    let results = [
        (Calibration::None, "00"),
        (Calibration::Running, "01"),
        (Calibration::Failed(Error::NoFit), "0302"),
        (Calibration::Ended, "04"),
    ];
    for (result, bytes) in results {
        assert_eq!(hex(&result), bytes, "{result:?}");
    }
}

#[test]
fn motors_and_cogging() {
    let of = |value: f32| Estimate { value, error: value / 8.0 };
    let report = identify::Report {
        resistance_ohm: of(1.0),
        inductance_h: of(2.0),
        flux_linkage_wb: of(3.0),
        inertia_kgm2: of(4.0),
        coulomb_nm: of(5.0),
        viscous_nms: of(6.0),
        load_nm: of(7.0),
        leftover_v: of(8.0),
        hall_delay_us: of(14.0),
        configured: Motor {
            resistance_ohm: 9.0,
            inductance_h: 10.0,
            saliency: 10.5,
            flux_linkage_wb: 11.0,
            inertia_kgm2: 12.0,
        },
        configured_delay_us: 15.0,
        pole_pairs: 13,
        samples: u32::MAX,
    };
    assert_eq!(
        hex(&report),
        concat!(
            "0000803f0000003e000000400000803e000040400000c03e000080400000003f0000a0400000203f0000c0400000403f",
            "0000e0400000603f000000410000803f000060410000e03f0000104100002041000028410000304100004041",
            "000070410dffffffff0f",
        )
    );
    let longest = Reply { id: u16::MAX, answer: Answer::Identification(Procedure::Done(report)) };
    assert!(encode(&longest, &mut [0; FRAME]).is_ok());
    assert_eq!(hex(&Cogging { largest_a: 1.0, rms_a: 0.5, by_pole_a: 2.0 }), "0000803f0000003f00000040");
}

#[test]
fn learning() {
    let lost = adapt::Fault::Lost(Channel(1));
    let all = [
        (Learning::Off, "00"),
        (Learning::On, "01"),
        (Learning::Ended(lost), "020101"),
        (Learning::Uneven, "03"),
        (Learning::TooFast, "04"),
    ];
    for (learning, bytes) in all {
        assert_eq!(hex(&learning), bytes, "{learning:?}");
    }
}

#[test]
fn incidents() {
    let causes = [
        (Cause::Fault(Fault::Stall), "0018"),
        (Cause::Stored(Record::Settings, Problem::Foreign), "010204"),
        (Cause::NotSaved(Record::Cogging), "0201"),
        (Cause::Adaptation(adapt::Fault::AtRail(Channel(1))), "030001"),
        (Cause::Adaptation(adapt::Fault::Lost(Channel(1))), "030101"),
        (Cause::Adaptation(adapt::Fault::Drifted(Channel(1), Parameter::Offset)), "03020100"),
        (Cause::Adaptation(adapt::Fault::Drifted(Channel(1), Parameter::Amplitude)), "03020101"),
        (Cause::Adaptation(adapt::Fault::Drifted(Channel(1), Parameter::Placement)), "03020102"),
        (Cause::Adaptation(adapt::Fault::Distorted), "0303"),
        (Cause::Adaptation(adapt::Fault::Contradiction), "0304"),
        (Cause::Abandoned(Activity::Cogging), "0403"),
        (Cause::Heavier, "05"),
        (Cause::Lighter, "06"),
    ];
    for (cause, bytes) in causes {
        assert_eq!(hex(&cause), bytes, "{cause:?}");
    }
}

/// A setting with the longest name and unit that the library allows itself, and each of its settings.
#[test]
fn every_setting_fits_a_frame() {
    for entry in settings::TABLE {
        let (name, unit, kind) = (entry.name, entry.unit(), entry.kind());
        let setting = Setting { name, unit, kind, value: 1.0, default: 1.0, min: 0.0, max: 1.0, fixed: true };
        let reply = Reply { id: u16::MAX, answer: Answer::Setting(setting) };
        assert!(encode(&reply, &mut [0; FRAME]).is_ok(), "{name}");
    }
}

#[cfg(feature = "map")]
#[test]
fn magnets() {
    use hallservo::service::magnets::Use;
    let asks = [
        (Ask::Magnets(MagnetsAsk::Learn), "01ac02002200"),
        (Ask::Magnets(MagnetsAsk::Status), "01ac02002201"),
        (Ask::Magnets(MagnetsAsk::Points(300)), "01ac02002202ac02"),
        (Ask::Magnets(MagnetsAsk::Forget), "01ac02002203"),
    ];
    for (ask, bytes) in asks {
        assert_eq!(hex(&Request { id: 1, client: 300, unattended: false, ask }), bytes, "{ask:?}");
    }
    let report = MagnetsReport { without_deg: 1.0, with_deg: 0.5, kept: true, found_again: false };
    let status = MagnetsStatus {
        state: Use::Used,
        pole_pairs: 4,
        report,
        learning: Procedure::Done(report),
        turns: 300,
        fit: 2.0,
        left_deg: 4.0,
        stored: Problem::Foreign,
        cogging: CoggingByPole { state: Use::Searching, rms_a: 1.0 },
    };
    assert_eq!(hex(&status), "02040000803f0000003f0100020000803f0000003f0100ac02000000400000804004010000803f");
    assert_eq!(hex(&[Use::None, Use::Searching, Use::Used, Use::Foreign]), "00010203");
    assert_eq!(hex(&[Activity::Magnets]), "06");
    assert_eq!(hex(&[Record::Magnets]), "04");
    assert_eq!(hex(&Refusal::Magnets(MagnetsRefusal::Encoder)), "0d01");
    // The largest fits a message.
    hex(&Reply { id: u16::MAX, answer: Answer::MagnetPoints([i16::MIN; POINTS_AT_ONCE]) });
}

#[cfg(feature = "scope")]
#[test]
fn scopes() {
    use hallservo::scope::{self, Channel, Setup, State, Trigger};
    let channels = [Some(Channel::PhaseA), None, Some(Channel::Hall3), None];
    let setup = Setup { channels, every: 300, rows: 512, before: 1, trigger: Trigger::Now };
    let level = Trigger::Level { channel: Channel::Speed, level: 1.0, rising: true };
    let asks = [
        (ScopeAsk::Status, "2300"),
        (ScopeAsk::Begin { id: 300, setup }, "2301ac020100000114 00ac0280040100"),
        (ScopeAsk::Rows { id: 300, first: 11 }, "2302ac020b"),
        (ScopeAsk::End, "2303"),
    ];
    for (ask, bytes) in asks {
        assert_eq!(hex(&Ask::Scope(ask)), bytes.replace(' ', ""), "{ask:?}");
    }
    assert_eq!(hex(&[Trigger::Command, Trigger::Fault]), "0102");
    assert_eq!(hex(&level), "030d0000803f01");
    assert_eq!(hex(&[State::None, State::Waiting, State::Triggered, State::Done]), "00010203");
    let errors = [
        (scope::Error::Empty, "00"),
        (scope::Error::Twice(Channel::CurrentQ), "0104"),
        (scope::Error::NoControl(Channel::Bus), "0211"),
        (scope::Error::Every, "03"),
        (scope::Error::Rows(512), "048004"),
        (scope::Error::Before, "05"),
        (scope::Error::Level(1.0), "060000803f"),
    ];
    for (error, bytes) in errors {
        assert_eq!(hex(&error), bytes, "{error:?}");
    }
    assert_eq!(hex(&Refusal::Scope(ScopeRefusal::Busy)), "0e02");
    let status = ScopeStatus { id: 1, client: 2, state: State::Done, capacity: 512, ..ScopeStatus::default() };
    assert_eq!(hex(&Answer::Scope(status)), "11010203800400 00000000000000000000000000000000".replace(' ', ""));
    // The largest fits a message.
    let rows = [[i32::MIN; 4]; ROWS_AT_ONCE];
    let answer = Answer::ScopeRows(ScopeRows { id: u32::MAX, first: u16::MAX, rows });
    hex(&Reply { id: u16::MAX, answer });
}
