//! What the drive makes of good and bad samples of the Halls.

use super::*;
use crate::hall::plausibility::Implausible;

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
fn two_halls_that_contradict_each_other_are_found_within_eight_steps() {
    let mut bench = with_control(Commutation::FieldOriented, |_| ());
    bench.command(Command::Arm).unwrap();
    bench.command(Command::Current(Current(0))).unwrap();
    for extra in 0..40 {
        for _ in 0..extra {
            bench.step();
        }
        assert_eq!(bench.drive.record().missed, 0);
        // Plausible each for itself, and together not at all.
        let mut codes = bench.model.codes(bench.rotor);
        codes[1] = codes[1].wrapping_add(350);
        codes[2] = codes[2].wrapping_add(350);
        let found = (1..=8).find(|_| {
            bench.step_with(codes);
            bench.drive.record().missed != 0
        });
        assert!(found.is_some(), "{extra}");
        for _ in 0..4 {
            bench.step();
        }
        assert_eq!(bench.mode(), Mode::Running);
    }
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
    let mut bench = Bench::running_with(&Settings { max_electrical_hz: 500.0, ..Settings::default() });
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
fn speed_in_hertz() {
    let mut bench = Bench::running();
    for _ in 0..2000 {
        bench.rotor += ElectricalAngle::from_turns(123.0 / 40e3);
        bench.step();
    }
    let hz = bench.drive.record().electrical_hz(40e3);
    assert!((hz - 123.0).abs() < 0.5, "{hz}");
}

#[test]
fn turns_by_hand_survive_a_new_model() {
    let mut bench = Bench::new(&Settings::default());
    bench.install().unwrap();
    let turn = |bench: &mut Bench| {
        for _ in 0..1200 {
            bench.rotor += ElectricalAngle::from_degrees(0.3);
            bench.step();
        }
    };
    let start = bench.drive.tracker().position().to_turns();
    for k in 1..=3 {
        turn(&mut bench);
        let before = bench.drive.tracker().speed();
        bench.install().unwrap();
        assert!((bench.drive.tracker().speed() - before).abs() < before / 20, "{k}");
        let turns = bench.drive.tracker().position().to_turns() - start;
        assert!((turns - f64::from(k)).abs() < 0.01, "{k}: {turns}");
    }
    // Where the angle was not known, it is taken up anew.
    for _ in 0..100 {
        bench.step_with([2048; 3]);
    }
    bench.install().unwrap();
    let turns = bench.drive.tracker().position().to_turns();
    assert!(turns.abs() < 1.0, "{turns}");
}
