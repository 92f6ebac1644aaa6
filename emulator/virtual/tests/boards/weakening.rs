//! Speeds beyond what the supply's voltage gives: by a current against the magnets' field, and by longer voltage vectors.

use crate::support::{NUCLEO, arm, ask, motor, run, session_with, until};
use plant::PlantParameters;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

const SPEED_RAD_S: f64 = 690.0;

fn set(session: &mut Session, setting: &str) {
    let reply = ask(session, &format!("set {setting}"));
    assert!(reply.contains("Setting(Setting"), "{setting}: {reply}");
}

/// The speed that is reached of one, rad/s.
fn reached(session: &mut Session, speed: f64) -> f64 {
    ask(session, &format!("speed {speed}"));
    run(session, 2.0);
    motor(session, "speed / rad/s")
}

/// Reaches it both ways, at a motor of another inductance than the settings say; and stays whole when it is switched
/// off there.
pub fn turns_beyond_its_supply(board: &str) {
    let mut plant = PlantParameters::imperfect(1);
    plant.motor.inductance_h = 2e-3;
    let mut session = session_with(board, &plant, "at 30ms send calibrate");
    run(&mut session, 1.0);
    until(&mut session, "activity: None", 14.0);
    let speed = format!("max_speed_rad_s {SPEED_RAD_S}");
    for setting in
        ["command_timeout_s 60", "current_bandwidth_hz 250", "inductance_h 1.7e-3", "max_current_a 2", &speed]
    {
        set(&mut session, setting);
    }
    arm(&mut session);
    let without = reached(&mut session, SPEED_RAD_S);
    ask(&mut session, "disarm");
    run(&mut session, 2.0);
    set(&mut session, "field_weakening_a 1.6");
    arm(&mut session);
    for speed in [SPEED_RAD_S, -SPEED_RAD_S] {
        let with = reached(&mut session, speed);
        println!("{board}: {without:.0} rad/s without, {with:.1} of {speed} rad/s with field weakening");
        assert!((with - speed).abs() < 0.01 * SPEED_RAD_S, "{with}: {:#?}", session.lines);
    }
    assert!((0.7..0.9).contains(&(without / SPEED_RAD_S)), "{without}");
    for (request, mode) in [("status", "mode: Running"), ("disarm", "mode: Ready")] {
        ask(&mut session, request);
        run(&mut session, 0.5);
        let status = ask(&mut session, "status");
        assert!(status.contains(mode), "{status}");
    }
    assert_eq!(Outcome::of(&session).verdict(), Vec::<String>::new());
}

/// With two currents where the third's shunt carries none: the chip's own op-amps and ADCs see nothing of it. Where flash is
/// scarce there is no such setting.
pub fn turns_beyond_what_three_currents_allow(board: &str) {
    let mut session = session_with(board, &PlantParameters::imperfect(1), "at 30ms send calibrate");
    run(&mut session, 1.0);
    until(&mut session, "activity: None", 14.0);
    set(&mut session, "command_timeout_s 60");
    set(&mut session, "max_speed_rad_s 900");
    let reply = ask(&mut session, "set least_low_side_s 1e-6");
    assert_eq!(reply.contains("Setting(Setting"), board == NUCLEO, "{board}: {reply}");
    if board != NUCLEO {
        return;
    }
    let [three, two] = ["0", "1e-6"].map(|least_s| {
        set(&mut session, &format!("least_low_side_s {least_s}"));
        arm(&mut session);
        let both = [900.0, -900.0].map(|speed| reached(&mut session, speed).abs());
        ask(&mut session, "speed 0");
        run(&mut session, 2.0);
        ask(&mut session, "disarm");
        run(&mut session, 0.1);
        both[0].min(both[1])
    });
    println!("{board}: {three:.0} rad/s with three currents, {two:.0} rad/s with two, {:.3} times", two / three);
    assert!(two > 1.07 * three, "{two} {three}: {:#?}", session.lines);
    assert_eq!(Outcome::of(&session).verdict(), Vec::<String>::new());
}
