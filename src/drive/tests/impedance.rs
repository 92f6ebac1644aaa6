//! A spring and a damper: what is taken up, what is asked for, and what the reference does.

use super::*;
use crate::control::impedance::{Error, Field};
use crate::drive::OUTER;
use crate::telemetry::Reference;

/// Running, at rest, with memory for what is commanded; positions from −50 to 50 turns.
fn bench(change: impl Fn(&mut crate::settings::Control)) -> Bench {
    let mut bench = with_control(Commutation::FieldOriented, |control| {
        (control.min_position_turns, control.max_position_turns) = (-50.0, 50.0);
        change(control);
    });
    for _ in 0..2 {
        assert!(bench.service.add_impedance(Box::leak(Box::new(crate::control::Impedance::NONE))).is_none());
    }
    bench.command(Command::Arm).unwrap();
    bench
}

fn follow(bench: &mut Bench, request: &Request) -> Reply {
    let impedance = bench.config.impedance(request).unwrap();
    bench.service.follow_impedance(&impedance).unwrap();
    bench.reply()
}

/// So many schedules on; the reference.
fn reference(bench: &mut Bench, cycles: u32) -> Reference {
    for _ in 0..cycles * 2 * CYCLE {
        bench.step();
        while bench.service.poll().is_some() {}
    }
    bench.service.reference()
}

/// Torque that is asked for, N·m.
fn torque(bench: &Bench) -> f32 {
    let control = bench.config.control.unwrap();
    bench.drive.state().current_reference as f32 / control.scale.per_ampere() * 0.03
}

/// Mechanical turns that the reference is ahead.
fn ahead(reference: &Reference) -> f32 {
    reference.strain as f32 / 8_388_608.0 / 4.0
}

fn spring(kp: f32, motion: Motion) -> Request {
    Request { kp_nm_rad: Some(kp), kd_nms_rad: Some(0.0), motion, ..Request::default() }
}

#[test]
fn the_torque_is_the_stiffness_times_the_deviation() {
    for (kp, turns) in [(0.05, 0.1), (0.05, -0.2), (0.3, 0.02), (0.001, 0.9), (0.0, 0.5)] {
        let mut bench = bench(|_| ());
        let here = bench.rotor.to_turns() as f64 / 4.0;
        follow(&mut bench, &spring(kp, at_once(here + turns, 0.0))).unwrap();
        let reference = reference(&mut bench, 8);
        assert!((f64::from(ahead(&reference)) - turns).abs() < 2e-4, "{kp} {turns} {reference:?}");
        let expected = kp * turns as f32 * core::f32::consts::TAU;
        assert!((torque(&bench) - expected).abs() < 0.005 * expected.abs() + 1e-5, "{kp} {turns} {}", torque(&bench));
        assert!(reference.complete);
    }
}

#[test]
fn the_largest_torque_and_the_feed_forward_are_kept() {
    let mut bench = bench(|_| ());
    let here = f64::from(bench.rotor.to_turns()) / 4.0;
    for (turns, forward, expected) in [(0.2, 0.0, 0.02), (-0.2, 0.0, -0.02), (0.0, 0.01, 0.01), (0.0, -0.05, -0.02)] {
        let request =
            Request { feed_forward_nm: forward, max_torque_nm: Some(0.02), ..spring(0.3, at_once(here + turns, 0.0)) };
        follow(&mut bench, &request).unwrap();
        reference(&mut bench, 2);
        assert!((torque(&bench) - expected).abs() < 2e-4, "{turns} {forward}: {}", torque(&bench));
    }
    // Another demand has all of the torque again.
    bench.command(Command::Current(bench.config.control.unwrap().current(3.0).unwrap())).unwrap();
    reference(&mut bench, 2);
    assert!((torque(&bench) - 0.09).abs() < 2e-4, "{}", torque(&bench));
}

#[test]
fn within_the_range_there_is_nothing_but_the_feed_forward() {
    let mut bench = bench(|_| ());
    let here = f64::from(bench.rotor.to_turns()) / 4.0;
    let cases = [
        (Some(-0.1), Some(0.1), 0.0),
        (Some(0.05), Some(0.1), 0.05),
        (Some(-0.1), Some(-0.02), -0.02),
        (Some(0.03), None, 0.03),
        (None, Some(-0.01), -0.01),
        (Some(-40.0), None, 0.0),
        (None, Some(40.0), 0.0),
        (None, None, 0.0),
        (Some(-20.0), Some(40.0), 0.0),
    ];
    for (least, most, turns) in cases {
        let end = |turns: Option<f64>| turns.map(|turns| here + turns);
        let motion = Motion::Within { least_turns: end(least), most_turns: end(most) };
        follow(&mut bench, &Request { feed_forward_nm: 0.003, ..spring(0.1, motion) }).unwrap();
        let reference = reference(&mut bench, 2);
        let expected = 0.1 * turns * core::f32::consts::TAU + 0.003;
        assert!((torque(&bench) - expected).abs() < 0.005 * expected.abs() + 1e-4, "{motion:?} {}", torque(&bench));
        assert!((ahead(&reference) - turns).abs() < 2e-4);
    }
}

#[test]
fn the_reference_travels_stops_and_approaches() {
    let mut bench = bench(|control| {
        (control.following_error_turns, control.max_position_turns) = (1e3, 15.0);
    });
    let travel = |speed_rad_s, stop_turns| Motion::To {
        position_turns: None,
        speed_rad_s,
        stop_turns,
        max_speed_rad_s: None,
        max_acceleration_rad_s2: None,
    };
    let free = |motion| Request { max_torque_nm: Some(0.0), ..spring(0.1, motion) };
    let here = f64::from(bench.rotor.to_turns()) / 4.0;
    let is = |reference: &Reference, turns: f64| (f64::from(ahead(reference)) + here - turns).abs() < 1e-3;
    // 2500 schedules are 4 s.
    follow(&mut bench, &free(travel(10.0, None))).unwrap();
    let there = reference(&mut bench, 125);
    let way = 0.2 * 10.0 / core::f64::consts::TAU;
    assert!(there.complete && (f64::from(ahead(&there)) - way).abs() < 5e-3, "{there:?} {way}");
    // Whatever its sign, the speed leads to the stop.
    follow(&mut bench, &free(travel(10.0, Some(-0.5)))).unwrap();
    assert!(!reference(&mut bench, 50).complete);
    let there = reference(&mut bench, 500);
    assert!(there.complete && there.speed == 0 && is(&there, -0.5), "{there:?}");
    follow(&mut bench, &free(Motion::to(3.0))).unwrap();
    let there = reference(&mut bench, 500);
    assert!(there.complete && there.speed == 0 && is(&there, 3.0), "{there:?}");
    // At once, and at the end of the bounds.
    follow(&mut bench, &free(at_once(14.0, 20.0))).unwrap();
    let there = reference(&mut bench, 1000);
    assert!(there.complete && there.speed == 0 && is(&there, 15.0), "{there:?}");
    // It brakes to rest from where it is.
    follow(&mut bench, &free(travel(-300.0, None))).unwrap();
    reference(&mut bench, 60);
    follow(&mut bench, &free(Motion::HERE)).unwrap();
    let there = reference(&mut bench, 100);
    assert!(there.complete && there.speed == 0 && !is(&there, 15.0), "{there:?}");
    assert_eq!(reference(&mut bench, 10), there);
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let bench = bench(|_| ());
    let most = bench.config.largest_impedance().unwrap();
    let refused = |request: Request| bench.config.impedance(&request).unwrap_err();
    let field = |request: Request| match refused(request) {
        Error::OutOfRange { field, .. } => field,
        other => panic!("{other}"),
    };
    let here = Request::default();
    assert_eq!(field(Request { kp_nm_rad: Some(1.01 * most.kp_nm_rad), ..here }), Field::Kp);
    assert_eq!(field(Request { kd_nms_rad: Some(1.01 * most.kd_nms_rad), ..here }), Field::Kd);
    for bad in [f32::NAN, f32::INFINITY, -0.1] {
        assert_eq!(field(Request { kp_nm_rad: Some(bad), ..here }), Field::Kp);
        assert_eq!(field(Request { kd_nms_rad: Some(bad), ..here }), Field::Kd);
        assert_eq!(field(Request { kp_scale: bad, ..here }), Field::Scale);
        assert_eq!(field(Request { kd_scale: bad, ..here }), Field::Scale);
        assert_eq!(field(Request { max_torque_nm: Some(bad), ..here }), Field::MaxTorque, "{bad}");
        assert_eq!(field(Request { motion: Motion::to(f64::from(bad) * 1e30), ..here }), Field::Position);
        if bad != f32::INFINITY {
            assert_eq!(field(Request { timeout_s: Some(bad), ..here }), Field::Timeout);
        }
    }
    for bad in [f32::NAN, 0.1, -0.1] {
        assert_eq!(field(Request { feed_forward_nm: bad, ..here }), Field::FeedForward);
        assert_eq!(field(Request { motion: at_once(0.0, bad * 1e5), ..here }), Field::Speed);
    }
    let limited = |max_speed_rad_s, max_acceleration_rad_s2, speed_rad_s| Motion::To {
        position_turns: Some(0.0),
        speed_rad_s,
        stop_turns: None,
        max_speed_rad_s,
        max_acceleration_rad_s2,
    };
    assert_eq!(field(Request { motion: limited(Some(0.0), None, 0.0), ..here }), Field::MaxSpeed);
    assert_eq!(field(Request { motion: limited(Some(501.0), None, 0.0), ..here }), Field::MaxSpeed);
    assert_eq!(field(Request { motion: limited(None, Some(0.0), 0.0), ..here }), Field::MaxAcceleration);
    assert_eq!(refused(Request { motion: limited(None, None, 1.0), ..here }), Error::Moving);
    let crossed = Motion::Within { least_turns: Some(1.0), most_turns: Some(0.0) };
    assert_eq!(refused(Request { motion: crossed, ..here }), Error::Crossed);
    let without = Settings::default().validate().unwrap();
    assert_eq!(without.impedance(&here), Err(Error::NoControl));
}

#[test]
fn the_drive_refuses_what_would_be_a_fault() {
    let mut bench = bench(|_| ());
    let at = |position, speed| spring(0.1, at_once(position, speed));
    assert_eq!(follow(&mut bench, &at(1.5, 0.0)), Err(Refusal::TooFar));
    assert_eq!(follow(&mut bench, &spring(0.1, Motion::to(51.0))), Err(Refusal::OutOfBounds));
    // A range that the rotor is far outside of, and ranges that it is in, however far their ends are.
    for (least, most, kp, allowed) in [
        (Some(1.5), None, 0.1, false),
        (None, Some(-1.5), 0.1, false),
        (Some(100.0), Some(140.0), 0.1, false),
        (Some(-140.0), Some(-100.0), 0.1, false),
        (Some(-300.0), None, 0.1, true),
        (None, Some(300.0), 0.1, true),
        (Some(-60.0), Some(0.2), 0.1, true),
        (Some(-0.2), Some(60.0), 0.1, true),
        (Some(0.4), Some(60.0), 1e-4, true),
        (None, None, 0.1, true),
        (Some(100.0), Some(140.0), 0.0, true),
    ] {
        let told = follow(&mut bench, &spring(kp, Motion::Within { least_turns: least, most_turns: most }));
        assert_eq!(told, if allowed { Ok(()) } else { Err(Refusal::TooFar) }, "{least:?} {most:?}");
        reference(&mut bench, 20);
        assert_eq!(bench.mode(), Mode::Running, "{least:?} {most:?}");
    }
    // Without a spring nothing is strained.
    follow(&mut bench, &spring(0.0, at_once(1.5, 0.0))).unwrap();
    reference(&mut bench, 20);
    assert_eq!(bench.mode(), Mode::Running);
    // Its memory comes back however often it is refused.
    for _ in 0..10 {
        assert_eq!(follow(&mut bench, &at(1.5, 0.0)), Err(Refusal::TooFar));
    }
    bench.command(Command::Disarm).unwrap();
    assert_eq!(follow(&mut bench, &spring(0.1, Motion::HERE)), Err(Refusal::Mode(Mode::Ready)));
}

#[test]
fn a_command_may_have_a_time_of_its_own() {
    for (own, setting, expected_s) in [(Some(0.05), 60.0, 0.05), (None, 0.1, 0.1), (Some(0.3), 0.1, 0.3)] {
        let mut bench = bench(|control| control.guard.command_timeout_s = setting);
        follow(&mut bench, &Request { timeout_s: own, ..spring(0.1, Motion::HERE) }).unwrap();
        let mut steps = 0;
        while bench.mode() == Mode::Running && steps < 40_000 {
            bench.step();
            while bench.service.poll().is_some() {}
            steps += 1;
        }
        assert_eq!(bench.mode(), Mode::Faulted(Fault::CommandTimeout));
        let seconds = f64::from(steps) / 40e3;
        assert!((seconds - expected_s).abs() < 2.0 * f64::from(OUTER) / 40e3, "{own:?} {setting}: {seconds}");
    }
}

#[test]
fn the_largest_gains_are_those_of_the_page() {
    let bench = bench(|_| ());
    let most = bench.config.largest_impedance().unwrap();
    let page = include_str!("../../../docs/impedance.md");
    for text in
        [std::format!("{:.1} mN·m·s/rad |", 1e3 * most.kd_nms_rad), std::format!("{:.2} N·m/rad |", most.kp_nm_rad)]
    {
        assert!(page.contains(&text), "{text}");
    }
    let preset = bench.config.default_impedance().unwrap();
    assert!(preset.kd_nms_rad <= most.kd_nms_rad && preset.kp_nm_rad <= most.kp_nm_rad, "{preset:?}");
}
