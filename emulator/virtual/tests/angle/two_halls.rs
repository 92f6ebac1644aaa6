//! Boards with two Halls, 90° apart, and nothing at the third input: set up over the serial line, calibrated, turned both
//! ways, the angle against the host's drive with two at the same motor; then one of the two fails.

use super::{Bench, Host, arm, esc1, keep, motor, nucleo, small_nucleo};
use crate::common::{ESC, NUCLEO, ask, board, perform, run, session_with, until};
use hallservo::settings::Settings;
use plant::PlantParameters;
use virtual_board::angle::AngleError;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

const APART_DEG: f64 = 90.0;
/// rad/s.
const SPEEDS: [f64; 2] = [40.0, -40.0];
/// Seeds of the host's drives. Their calibrations scatter, and so does the board's one.
const SEEDS: [u64; 3] = [1, 2, 3];
/// From the trigger of a sample to the bridge's going off in the interrupt that it is for, at most.
const REACTION_S: f64 = 20e-6;
/// Wrong samples that the tracker bridges.
const TOLERATED: f64 = 1.0;

/// A board that was told of its two Halls and has calibrated.
fn told(name: &str) -> Session {
    let mut session = session_with(name, &PlantParameters::imperfect(1).with_two_halls(APART_DEG), "");
    run(&mut session, 0.05);
    for (request, answer) in [("set halls 2", "value: 2.0"), ("calibrate", "Done")] {
        let reply = ask(&mut session, request);
        assert!(reply.contains(answer), "{name}, {request}: {reply}");
    }
    run(&mut session, 1.0);
    let status = until(&mut session, "activity: None", 12.0);
    assert!(status.contains("calibrated: true"), "{name}: {status}");
    ask(&mut session, "set command_timeout_s 60");
    session
}

fn both_ways(bench: &mut impl Bench) -> [AngleError; 2] {
    bench.ask("telemetry 500");
    arm(bench);
    SPEEDS.map(|speed| keep(bench, speed))
}

/// Root of the mean square, the mean included.
fn rms_deg(errors: &[AngleError; 2]) -> f64 {
    (errors.iter().map(|error| error.rms_deg.powi(2) + error.mean_deg.powi(2)).sum::<f64>() / 2.0).sqrt()
}

fn works(name: &str, settings: Settings, early: u32) {
    let mut session = told(name);
    let here = both_ways(&mut session);
    assert!(here.iter().all(|error| error.count > 400), "{name}: {here:?}");
    let hosts = SEEDS.map(|seed| {
        let motor = motor(&settings, early).with_two_halls(APART_DEG);
        let mut host = Host::at(&motor, settings, early, seed);
        ["set halls 2", "calibrate"].iter().for_each(|request| host.ask(request));
        host.run(5.0);
        host.ask("set command_timeout_s 60");
        rms_deg(&both_ways(&mut host))
    });
    let worst_deg = hosts.iter().fold(0.0_f64, |worst, host| worst.max(*host));
    println!("{name}, two Halls: {:.3}° RMS both ways, hosts {hosts:.3?}", rms_deg(&here));
    assert!(rms_deg(&here) < 1.15 * worst_deg && worst_deg < 0.5, "{name}: {here:?}, {hosts:?}");
    // No missed trigger, no late period, nothing else that is wrong.
    assert_eq!(Outcome::of(&session).verdict(), Vec::<String>::new(), "{name}");
    one_fails(name, &session);
}

/// While it turns.
fn one_fails(name: &str, turning: &Session) {
    let period_s = 1.0 / turning.machine.system.facts().pwm.as_ref().expect("a PWM").hz;
    let at_most_s = (1.0 + TOLERATED) * period_s + REACTION_S;
    for (hall, wire) in [1, 2].into_iter().flat_map(|hall| ["open", "ground", "supply"].map(|wire| (hall, wire))) {
        let mut session = turning.fork();
        let begun_s = session.seconds();
        perform(&mut session, &format!("hall {hall} {wire}"));
        run(&mut session, 2e-3);
        assert!(!session.machine.system.bridge_is_on(), "{name}, Hall {hall} {wire}");
        let off_s = session.machine.system.facts().moe.last().expect("an edge").at_s - begun_s;
        println!("{name}, two Halls, Hall {hall} {wire}: off after {:.1} us", 1e6 * off_s);
        assert!(off_s > 0.0 && off_s < at_most_s, "{name}, Hall {hall} {wire}: {off_s} s");
        let end_s = session.seconds() + 0.2;
        let status = until(&mut session, "mode: Faulted(", end_s);
        let named = format!("mode: Faulted(Hall(AtRail(Channel({}))))", hall - 1);
        assert!(status.contains(&named), "{name}, Hall {hall} {wire}: {status}");
    }
    let mut session = turning.fork();
    perform(&mut session, "hall 3 ground");
    run(&mut session, 0.05);
    assert!(session.machine.system.bridge_is_on(), "{name}: the third input is not used");
}

#[test]
fn the_nucleo_turns_with_two_halls() {
    works(NUCLEO, nucleo::settings(), 0);
}

#[test]
fn the_esc_turns_with_two_halls() {
    works(ESC, esc1::settings(), esc1::EARLY);
}

#[test]
fn the_smaller_nucleo_turns_with_two_halls() {
    let name = "nucleo-g431rb-ihm16m1";
    assert_eq!(board(name).name, name);
    works(name, small_nucleo::settings(), small_nucleo::EARLY);
}
