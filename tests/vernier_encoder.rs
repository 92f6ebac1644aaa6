//! The encoder from sample to sample: what it reports, what it holds on to, and how it comes back.

use hallservo::angle::MechanicalAngle;
use hallservo::vernier::continuity::{Fault, State};
use hallservo::vernier::encoder::{Calibration, Encoder, EncoderError, Reading};
use hallservo::vernier::rings::{Ring, Rings};

const TURN: f64 = 4_294_967_296.0;

fn rings() -> Rings {
    Rings::new(37, 45, 12).unwrap()
}

/// A step of at most 0.2° between samples: holds out ten samples.
fn encoder<const HEADS: usize>() -> Encoder<HEADS> {
    Encoder::new(&rings(), &Calibration::ideal(&rings()), MechanicalAngle::from_degrees(0.2)).unwrap()
}

/// What perfect heads read at a shaft angle in degrees.
fn reading<const HEADS: usize>(degrees: f64) -> Reading<HEADS> {
    let code = |pole_pairs: f64, head: usize| {
        let turns = (degrees / 360.0 - head as f64 / HEADS as f64) * pole_pairs;
        rings().reading((turns * 4096.0).floor().rem_euclid(4096.0) as u16)
    };
    Reading {
        reference: std::array::from_fn(|head| code(37.0, head)),
        vernier: std::array::from_fn(|head| code(45.0, head)),
    }
}

fn assert_near(angle: MechanicalAngle, degrees: f64) {
    let error = (f64::from(angle.to_bits()) / TURN * 360.0 - degrees + 180.0).rem_euclid(360.0) - 180.0;
    assert!(error.abs() < 0.004, "{angle} instead of {degrees}°");
}

/// Turns on from one angle to another and checks every sample.
fn turn<const HEADS: usize>(encoder: &Encoder<HEADS>, state: &mut State, from: f64, to: f64, step: f64) {
    let steps = ((to - from) / step).abs().round() as u32;
    for number in 1..=steps {
        let degrees = from + f64::from(number) * (to - from) / f64::from(steps);
        assert_near(encoder.step(state, reading(degrees)).unwrap().angle, degrees);
    }
}

fn proven<const HEADS: usize>(encoder: &Encoder<HEADS>) -> State {
    let mut state = State::default();
    turn(encoder, &mut state, 100.0, 110.0, 0.1);
    assert!(state.is_proven());
    state
}

#[test]
fn the_first_sample_gives_the_absolute_angle() {
    let encoder = encoder::<1>();
    for tenth in 0..3600 {
        let degrees = f64::from(tenth) / 10.0;
        let mut state = State::default();
        let decoded = encoder.step(&mut state, reading(degrees)).unwrap();
        assert_near(decoded.angle, degrees);
        assert_eq!(decoded.pole_pair, (degrees * 37.0 / 360.0) as u8);
        assert!(!state.is_proven());
    }
}

#[test]
fn motion_over_a_pole_pair_of_both_rings_proves_the_position() {
    let encoder = encoder::<1>();
    for direction in [1.0, -1.0] {
        let mut state = State::default();
        turn(&encoder, &mut state, 50.0, 50.0 + 9.6 * direction, 0.1);
        assert!(!state.is_proven());
        turn(&encoder, &mut state, 50.0 + 9.6 * direction, 50.0 + 9.9 * direction, 0.1);
        assert!(state.is_proven());
        turn(&encoder, &mut state, 50.0 + 9.9 * direction, 1000.0 * direction, 0.1);
    }
}

#[test]
fn a_single_wrong_reading_is_reported_and_moves_nothing() {
    let encoder = encoder::<1>();
    for wrong in 0..4096_u32 {
        let mut state = proven(&encoder);
        // All over both rings, both readings wrong at once.
        let nonsense = Reading { reference: [(wrong << 4) as u16], vernier: [(wrong.wrapping_mul(2897) << 4) as u16] };
        match encoder.step(&mut state, nonsense) {
            // Wrong by less than the margin is as good as right.
            Ok(decoded) => assert!((decoded.angle.to_degrees() - 110.1).abs() < 0.108),
            Err(_) => assert!(state.is_proven()),
        }
        // The right one after a slightly wrong one may be taken for the wrong one, and no more than that.
        let _ = encoder.step(&mut state, reading(110.2));
        turn(&encoder, &mut state, 110.2, 112.0, 0.1);
    }
}

#[test]
fn each_fault_has_its_name() {
    let encoder = encoder::<1>();
    let fault = |reading| encoder.step(&mut proven(&encoder), reading).unwrap_err();
    let good = reading::<1>(110.1);
    // A third of a table entry's distance too much on the vernier; then a whole one, which is another pole pair.
    let vernier = |part: f64| [good.vernier[0].wrapping_add((part * 65536.0 / 37.0) as u16)];
    assert_eq!(fault(Reading { vernier: vernier(0.45), ..good }), Fault::Residual);
    assert_eq!(fault(Reading { vernier: vernier(1.0), ..good }), Fault::PolePair);
    assert_eq!(fault(reading(111.0)), Fault::Jump);
    assert_eq!(encoder.miss(&mut proven(&encoder)), Err(Fault::Unread));
    let encoder = self::encoder::<2>();
    let good = reading::<2>(110.1);
    let bent = |[first, second]: [u16; 2]| [first, second.wrapping_add(30_000)];
    let fault = |reading| encoder.step(&mut proven(&encoder), reading).unwrap_err();
    assert_eq!(fault(Reading { reference: bent(good.reference), ..good }), Fault::HeadsApart(Ring::Reference));
    assert_eq!(fault(Reading { vernier: bent(good.vernier), ..good }), Fault::HeadsApart(Ring::Vernier));
}

#[test]
fn samples_missed_for_a_moment_cost_nothing_else() {
    let encoder = encoder::<1>();
    let mut state = proven(&encoder);
    for _ in 0..10 {
        assert_eq!(encoder.miss(&mut state), Err(Fault::Unread));
        assert!(state.is_proven());
    }
    // The shaft has gone on at its speed.
    turn(&encoder, &mut state, 111.0, 115.0, 0.1);
}

#[test]
fn a_position_lost_is_withheld_until_motion_proves_it() {
    let encoder = encoder::<1>();
    let mut state = proven(&encoder);
    for _ in 0..60 {
        assert_eq!(encoder.miss(&mut state), Err(Fault::Unread));
    }
    assert!(!state.is_proven());
    // At standstill a stuck head would look just like this.
    for _ in 0..1000 {
        assert_eq!(encoder.step(&mut state, reading(200.0)), Err(Fault::Searching));
    }
    for number in 1..=486 {
        let degrees = 200.0 + f64::from(number) * 0.02;
        assert_eq!(encoder.step(&mut state, reading(degrees)), Err(Fault::Searching));
    }
    turn(&encoder, &mut state, 209.72, 300.0, 0.02);
    assert!(state.is_proven());
}

#[test]
fn a_head_stuck_for_good_is_never_believed_again() {
    let encoder = encoder::<1>();
    for ring in [Ring::Reference, Ring::Vernier] {
        let mut state = proven(&encoder);
        let stuck = reading::<1>(110.0);
        let mut believed = 0;
        for number in 0..36_000 {
            let degrees = 110.0 + f64::from(number) * 0.01;
            let mut sample = reading(degrees);
            match ring {
                Ring::Reference => sample.reference = stuck.reference,
                Ring::Vernier => sample.vernier = stuck.vernier,
            }
            if let Ok(decoded) = encoder.step(&mut state, sample) {
                believed += 1;
                let error = f64::from(decoded.angle.to_degrees()) - degrees;
                assert!(error.abs() < 0.108, "{ring:?} {degrees} {error}");
            }
        }
        assert!(believed < 20, "{believed}");
    }
}

#[test]
fn steps_and_limits_out_of_range_are_refused_by_name() {
    let ideal = Calibration::<1>::ideal(&rings());
    let step = MechanicalAngle::from_degrees(0.2);
    for degrees in [0.0, -0.1, 2.01, 90.0] {
        let found = MechanicalAngle::from_degrees(degrees);
        let error = Encoder::new(&rings(), &ideal, found).unwrap_err();
        assert!(
            matches!(error, EncoderError::LargestStep { largest, .. } if (largest.to_degrees() - 2.0).abs() < 1e-3)
        );
    }
    for residual_limit in [0, 24_577] {
        let error = Encoder::new(&rings(), &Calibration { residual_limit, ..ideal.clone() }, step).unwrap_err();
        assert_eq!(error, EncoderError::ResidualLimit(residual_limit));
    }
    let error = Encoder::new(&rings(), &Calibration { head_distance_limits: [0, 24_577], ..ideal }, step).unwrap_err();
    assert_eq!(error, EncoderError::HeadDistanceLimit(24_577));
}

#[test]
fn sizes_are_those_documented() {
    use hallservo::vernier::calibrate::Calibrator;
    use hallservo::vernier::decode::{AverageTable, IdealTable};
    assert_eq!(size_of::<IdealTable>(), 144);
    assert_eq!(size_of::<AverageTable>(), 532);
    assert_eq!((size_of::<Encoder<1>>(), size_of::<Encoder<2>>()), (1080, 1592));
    assert_eq!(size_of::<State>(), 32);
    assert_eq!((size_of::<Calibration<1>>(), size_of::<Calibration<2>>()), (272, 408));
    assert_eq!((size_of::<Calibrator<1>>(), size_of::<Calibrator<2>>()), (4616, 4752));
}
