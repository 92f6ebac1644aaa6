//! Garbage, truncated and hostile frames never move the motor, stop the control loop or panic.

use crate::tool::{calibrated, done, drive, request, run, status};
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Problem};
use proptest::prelude::*;
use simulator::Simulator;
use simulator::flash::Flash;
use std::sync::LazyLock;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

/// At power-up with a calibration: ready, the bridge off.
fn ready() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    drive
}

fn turning() -> Simulator {
    let mut drive = ready();
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(60.0));
    run(&mut drive, 50);
    drive
}

/// No number, infinite, or far beyond what a drive may be asked for.
fn wild() -> impl Strategy<Value = f32> {
    prop_oneof![
        Just(f32::NAN),
        Just(f32::INFINITY),
        Just(f32::NEG_INFINITY),
        Just(f32::MAX),
        Just(-f32::NAN),
        (1e4_f32..1e30),
        (-1e30_f32..-1e4),
    ]
}

/// Whole frames that must not be obeyed, whatever the drive does.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    (any::<u16>(), 0..13_u8, wild(), "[a-z_]{0,30}", any::<u16>()).prop_map(|(id, kind, value, name, number)| {
        request(
            id,
            match kind {
                0 => Ask::Voltage(value),
                1 => Ask::Torque(value),
                2 => Ask::Speed(value),
                3 => Ask::Position(f64::from(value) * 1e30),
                4 => Ask::Set { name: "max_current_a", value },
                5 => Ask::Set { name: "pole_pairs", value },
                6 => Ask::Set { name: "adc_bits", value: 12.0 },
                7 => Ask::Set { name: &name, value },
                8 => Ask::Telemetry(value),
                9 => Ask::Setting(number),
                10 => Ask::Get(&name),
                11 => Ask::AntiCogging(true),
                _ => Ask::History(number as u8),
            },
        )
    })
}

/// Bytes in which no frame is whole and means anything that a drive would do.
fn garbage() -> impl Strategy<Value = Vec<u8>> {
    let arm = || Just(request(1, Ask::Arm));
    let command = prop_oneof![arm(), Just(request(2, Ask::Voltage(0.5))), Just(request(3, Ask::Calibrate))];
    let piece = prop_oneof![
        4 => prop::collection::vec(any::<u8>(), 0..300),
        // Frames that would move it, with a bit wrong inside.
        3 => (command.clone(), any::<prop::sample::Index>(), 0..8_u32).prop_map(|(mut frame, place, bit)| {
            let inside = 1 + place.index(frame.len() - 2);
            frame[inside] ^= 1 << bit;
            // One that a flipped bit has cut in two stays cut.
            frame
        }),
        // … or cut.
        2 => (command, any::<prop::sample::Index>()).prop_map(|(frame, place)| {
            let mut frame = frame[..place.index(frame.len() - 1)].to_vec();
            frame.extend([0x55, 0]);
            frame
        }),
        // Too long ones.
        1 => prop::collection::vec(1..=u8::MAX, 252..1500),
        // Of another version, and whole: COBS of the version 7 and its CRC.
        1 => Just(vec![0, 6, 7, 0x2e, 0x7a, 0x66, 0x4c, 0]),
        3 => hostile(),
    ];
    prop::collection::vec(piece, 1..8).prop_map(|pieces| pieces.concat())
}

/// Throws bytes at a drive for a while; the bytes a millisecond are those of the UART.
fn throw(drive: &mut Simulator, bytes: &[u8], milliseconds: u32) {
    let mut pieces = bytes.chunks(46);
    for _ in 0..milliseconds {
        if let Some(piece) = pieces.next() {
            drive.write(piece);
        }
        drive.step();
        drive.read();
    }
}

const CASES: u32 = 500;
/// Milliseconds of garbage.
const LONG: u32 = 60;

proptest! {
    #![proptest_config(ProptestConfig { cases: CASES, ..ProptestConfig::default() })]

    #[test]
    fn a_drive_at_rest_stays_off(bytes in garbage()) {
        let rested = *RESTED;
        let mut drive = ready();
        let fed = drive.fed();
        throw(&mut drive, &bytes, LONG);
        prop_assert_eq!(drive.drive().mode(), Mode::Ready);
        prop_assert_eq!(drive.digest(), rested);
        prop_assert!(drive.fed() >= fed + LONG / 20 - 1);
        // And it still listens.
        drive.write(&[0]);
        let status = status(&mut drive);
        prop_assert_eq!(status.stored[0], Problem::None);
    }

    #[test]
    fn a_turning_drive_turns_on_as_if_nothing_were(bytes in garbage()) {
        let turned = *TURNED;
        let mut drive = turning();
        throw(&mut drive, &bytes, LONG);
        let digest = drive.digest();
        prop_assert_eq!(drive.drive().mode(), Mode::Running);
        drive.write(&[0]);
        done(&mut drive, Ask::Status);
        prop_assert_eq!(digest, turned);
    }
}

/// A turning drive that was left alone for as long.
static TURNED: LazyLock<u64> = LazyLock::new(|| {
    let mut drive = turning();
    run(&mut drive, LONG);
    drive.digest()
});

/// A drive at rest that was left alone: off in every period.
static RESTED: LazyLock<u64> = LazyLock::new(|| {
    let mut drive = ready();
    run(&mut drive, LONG);
    drive.digest()
});
