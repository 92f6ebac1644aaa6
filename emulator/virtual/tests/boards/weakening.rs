//! A speed beyond what the supply's voltage gives, by a current against the magnets' field.

use crate::support::{arm, ask, motor, run, session_with, until};
use plant::PlantParameters;
use virtual_board::outcome::Outcome;

const SPEED_RAD_S: f64 = 690.0;

/// Reaches it both ways, at a motor of another inductance than the settings say; and stays whole when it is switched
/// off there.
pub fn turns_beyond_its_supply(board: &str) {
    let mut plant = PlantParameters::imperfect(1);
    plant.motor.inductance_h = 2e-3;
    let mut session = session_with(board, &plant, "at 30ms send calibrate");
    run(&mut session, 1.0);
    until(&mut session, "activity: None", 14.0);
    let set = |session: &mut _, setting: &str| {
        let reply = ask(session, &format!("set {setting}"));
        assert!(reply.contains("Setting(Setting"), "{setting}: {reply}");
    };
    let speed = format!("max_speed_rad_s {SPEED_RAD_S}");
    for setting in
        ["command_timeout_s 60", "current_bandwidth_hz 250", "inductance_h 1.7e-3", "max_current_a 2", &speed]
    {
        set(&mut session, setting);
    }
    let reached = |session: &mut _, speed: f64| {
        ask(session, &format!("speed {speed}"));
        run(session, 2.0);
        motor(session, "speed / rad/s")
    };
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
