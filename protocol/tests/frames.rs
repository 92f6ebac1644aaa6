//! Frames: whatever comes over the line, the decoder finds the whole ones and nothing else.

use hallservo::commutation::Commutation;
use hallservo::control::impedance::{self, Motion};
use hallservo::drive::standstill::Probe;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo_protocol::*;
use proptest::prelude::*;

fn request(id: u16, ask: Ask<'_>) -> Vec<u8> {
    let mut frame = [0; FRAME];
    let length = encode(&Request { id, client: 1, unattended: false, ask }, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// What a stream of bytes comes to: the requests as text, for they borrow.
fn decoded(bytes: &[u8]) -> Vec<Result<String, Error>> {
    let mut decoder = Decoder::new();
    let mut messages = Vec::new();
    for &byte in bytes {
        messages.extend(decoder.push::<Request<'_>>(byte).map(|message| message.map(|request| format!("{request:?}"))));
    }
    messages
}

fn texts(bytes: &[u8]) -> Vec<String> {
    decoded(bytes).into_iter().flatten().collect()
}

/// Any request, with values as wild as they come.
fn asks() -> impl Strategy<Value = Vec<u8>> {
    let name = "[a-z_]{0,40}";
    (any::<u16>(), 0..31_u8, any::<u32>(), any::<u64>(), name).prop_map(|(id, kind, bits, wide, name)| {
        let (value, number) = (f32::from_bits(bits), bits as u16);
        request(
            id,
            match kind {
                0 => Ask::Hello,
                1 => Ask::Status,
                2 => Ask::Arm,
                3 => Ask::Disarm,
                4 => Ask::Clear,
                5 => Ask::Voltage(value),
                6 => Ask::Torque(value),
                7 => Ask::Speed(value),
                8 => Ask::Position(f64::from_bits(wide)),
                9 => Ask::Commutate(Commutation::Block),
                10 => Ask::Calibrate,
                11 => Ask::Calibration,
                12 => Ask::Identify,
                13 => Ask::LearnCogging,
                14 => Ask::AntiCogging(bits & 1 == 0),
                15 => Ask::Setting(number),
                16 => Ask::Get(&name),
                17 => Ask::Set { name: &name, value },
                18 => Ask::Save,
                19 => Ask::Load,
                20 => Ask::Restore,
                21 => Ask::Telemetry(value),
                22 => Ask::Release,
                23 => Ask::Accept,
                24 => Ask::Measure {
                    begins: bits & 1 == 0,
                    probe: Probe {
                        phase: number as u8,
                        current: bits as i32,
                        ripple: wide as i32,
                        across: bits & 1 == 1,
                        swings_across: bits & 2 == 2,
                    },
                },
                25 => Ask::Window,
                26 => Ask::Swing,
                27 => Ask::Swings,
                28 => Ask::Reference,
                29 => Ask::Impedance(impedance::Request {
                    kp_nm_rad: Some(value),
                    motion: Motion::to(f64::from_bits(wide)),
                    ..impedance::Request::default()
                }),
                _ => Ask::History(number as u8),
            },
        )
    })
}

/// Of no request: the ids tell.
fn noise(length: usize) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..length)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, ..ProptestConfig::default() })]

    #[test]
    fn noise_is_no_message(bytes in noise(2000)) {
        prop_assert_eq!(texts(&bytes), Vec::<String>::new());
    }

    // What has bytes to spare, or too few, and what is beyond its range, is no message for either.
    #[test]
    fn a_message_is_one_where_postcard_says_so(head in 0_u8..4, kind in 0_u8..40, tail in noise(60)) {
        let message = [&[head, 1, 0, kind][..], &tail].concat();
        let known = postcard::take_from_bytes::<Request<'_>>(&message).ok().filter(|(_, rest)| rest.is_empty());
        let known: Vec<String> = known.into_iter().map(|(request, _)| format!("{request:?}")).collect();
        prop_assert_eq!(texts(&framed(&[&[VERSION], &message[..]].concat())), known);
    }

    #[test]
    fn a_message_with_a_byte_changed_is_one_where_postcard_says_so(
        frame in asks(), place in any::<prop::sample::Index>(), byte in any::<u8>(), cut in 0_usize..3,
    ) {
        let mut message = [0; FRAME];
        let length = cobs::decode(&frame[1..frame.len() - 1], &mut message).unwrap() - 4;
        let message = &mut message[1..length];
        message[place.index(length - 1)] = byte;
        let message = &message[..(length - 1).saturating_sub(cut)];
        let known = postcard::take_from_bytes::<Request<'_>>(message).ok().filter(|(_, rest)| rest.is_empty());
        let known: Vec<String> = known.into_iter().map(|(request, _)| format!("{request:?}")).collect();
        prop_assert_eq!(texts(&framed(&[&[VERSION], message].concat())), known);
    }

    #[test]
    fn a_frame_is_found_after_any_noise(noise in noise(600), frame in asks()) {
        let alone = texts(&frame);
        prop_assert_eq!(alone.len(), 1);
        prop_assert_eq!(texts(&[noise, frame].concat()), alone);
    }

    #[test]
    fn a_cut_frame_is_none_and_the_next_is_found(
        first in asks(), second in asks(), cut in any::<prop::sample::Index>(),
    ) {
        // Without its last byte, the closing zero, it is whole all the same: the next one begins with a zero.
        let cut = cut.index(first.len() - 1);
        prop_assert_eq!(texts(&[&first[..cut], &second].concat()), texts(&second));
    }

    #[test]
    fn a_changed_frame_is_none(frame in asks(), place in any::<prop::sample::Index>(), bit in 0..8_u32) {
        let mut changed = frame.clone();
        changed[place.index(frame.len())] ^= 1_u8 << bit;
        let messages = texts(&[&changed[..], &[0]].concat());
        prop_assert!(messages.is_empty(), "{messages:?}");
    }

    #[test]
    fn frames_together_are_all_found(frames in prop::collection::vec(asks(), 0..8)) {
        let expected: Vec<_> = frames.iter().flat_map(|frame| texts(frame)).collect();
        prop_assert_eq!(expected.len(), frames.len());
        prop_assert_eq!(texts(&frames.concat()), expected);
    }

    #[test]
    fn what_is_too_long_is_told_once_and_the_next_is_found(
        bytes in prop::collection::vec(1..=u8::MAX, FRAME..4 * FRAME), frame in asks(),
    ) {
        let messages = decoded(&[bytes, frame.clone()].concat());
        prop_assert_eq!(messages.len(), 2);
        prop_assert_eq!(&messages[0], &Err(Error::TooLong));
        prop_assert_eq!(texts(&frame), vec![messages[1].clone().unwrap()]);
    }
}

#[test]
fn another_version_is_told() {
    for version in (0..=u8::MAX).filter(|&version| version != VERSION) {
        let checksum = crc32(&[version, 1, 2, 3]).to_le_bytes();
        let inside = [&[version, 1, 2, 3][..], &checksum[..]].concat();
        let mut frame = vec![0; 32];
        let length = cobs::encode(&inside, &mut frame);
        frame.truncate(length + 1);
        assert_eq!(decoded(&frame), [Err(Error::Version { found: version })]);
    }
    let text = Error::Version { found: 9 }.to_string();
    assert!(text.contains("version 9") && text.contains(&format!("version {VERSION}")), "{text}");
}

/// Bit by bit, from the polynomial.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
    })
}

#[test]
fn what_follows_a_message_in_its_frame_makes_it_meaningless() {
    assert_eq!(decoded(&framed(&[VERSION, 0, 1, 0, 1, 77])), [Err(Error::Meaningless)]);
}

/// The frame of any bytes.
fn framed(inside: &[u8]) -> Vec<u8> {
    let inside = [inside, &crc32(inside).to_le_bytes()].concat();
    let mut frame = vec![0; FRAME + 1];
    let length = cobs::encode(&inside, &mut frame);
    frame.truncate(length + 1);
    frame
}

/// The largest and the smallest of what is said often.
#[test]
fn frames_have_these_lengths() {
    let reply = |answer: Answer<'_>| encode(&Reply { id: u16::MAX, answer }, &mut [0; FRAME]).unwrap();
    let telemetry = Telemetry {
        number: u32::MAX,
        step: u32::MAX,
        mode: Mode::Faulted(Fault::Turns),
        codes: [u16::MAX; 3],
        ..Telemetry::default()
    };
    assert_eq!(reply(Answer::Telemetry(telemetry)), 70);
    assert_eq!(reply(Answer::Done), 12);
    assert_eq!(request(1, Ask::Arm).len(), 12);
    assert!(reply(Answer::Status(Status { uptime_ms: u64::MAX, ..Status::default() })) <= FRAME);
    let long = "x".repeat(MESSAGE);
    assert_eq!(
        encode(&Request { id: 1, client: 1, unattended: false, ask: Ask::Get(&long) }, &mut [0; FRAME]),
        Err(Error::TooLong)
    );
    // Of the largest a whole one passes.
    let longest = &long[..MESSAGE - 6];
    assert_eq!(texts(&request(1, Ask::Get(longest))).len(), 1);
}
