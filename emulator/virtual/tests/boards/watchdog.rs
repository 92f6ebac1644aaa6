//! The watchdogs bite where something hangs, within their time, and never otherwise.

use crate::support::{ask, calibrated, perform, run, says, turning, until};
use bus::{Bus, ResetCause, Width};
use chip::Watchdog;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

const PWM_HZ: f64 = 40e3;

fn watchdog(session: &Session) -> Watchdog {
    session.machine.system.facts().watchdog.expect("a watchdog")
}

/// Number of the exception whose handler has such a name.
fn exception(session: &Session, name: &str) -> u16 {
    let handlers = Outcome::of(session).handlers;
    let handler = handlers.iter().find(|handler| handler.name.contains(name));
    handler.unwrap_or_else(|| panic!("no handler {name}: {handlers:#?}")).exception
}

/// Hangs something in a turning drive, which happens at its next entry: the bridge is off within the watchdog's time,
/// and the board comes back with what it knew.
fn bites(board: &str, turning: &Session, what: &str, entered_s: f64) {
    let mut session = turning.fork();
    let at_s = session.seconds();
    let control = session.control_exception().expect("a control interrupt");
    let periods = |session: &Session| session.machine.profile().activities()[&control].period.count;
    let before = periods(&session);
    perform(&mut session, what);
    // The serial port's handler runs only if something comes.
    perform(&mut session, "send hello");
    let timeout_s = watchdog(&session).timeout_s;
    while session.resets.is_empty() && session.seconds() < at_s + 2.0 * timeout_s {
        session.slice(at_s + 2.0 * timeout_s).expect("a run");
    }
    let [(reset_s, ResetCause::Watchdog)] = session.resets[..] else { panic!("{board}, {what}: {:?}", session.resets) };
    let edge = session.machine.system.facts().moe.last().cloned().expect("an edge");
    println!("{board}, {what}: off after {:.1} ms by {}", (edge.at_s - at_s) * 1e3, edge.by);
    assert!(
        !edge.on && edge.at_s <= reset_s && reset_s < at_s + entered_s + timeout_s,
        "{board}, {what}: {reset_s} s, {edge:?}"
    );
    // What hangs below the control interrupt does not touch it.
    let share = (periods(&session) - before) as f64 / ((reset_s - at_s) * PWM_HZ);
    assert!((share - 1.0).abs() < 1e-2, "{board}, {what}: {share}");
    run(&mut session, 0.1);
    assert!(says(&session, "the watchdog has reset the chip"), "{board}, {what}: {:#?}", session.lines);
    for request in ["arm", "speed 40"] {
        let reply = ask(&mut session, request);
        assert!(reply.contains("Done"), "{board}, {what}, {request}: {reply}");
    }
    run(&mut session, timeout_s);
    assert_eq!(session.resets.len(), 1, "{board}, {what}: {:?}", session.resets);
}

pub fn bites_where_something_hangs(board: &str) {
    let turning = turning(board);
    let [time, serial] = ["TIM", "USART"].map(|name| exception(&turning, name));
    bites(board, &turning, "hang tasks", 0.0);
    // While the tasks stand still they set no alarm, and a byte is waited for.
    bites(board, &turning, &format!("hang {time}"), 0.1);
    bites(board, &turning, &format!("hang {serial}"), 0.1);
}

/// Longest time for which the last voltage vector may stand when nothing controls any more.
pub const OFF_S: f64 = 1e-3;
const TIM1: u32 = 0x4001_2c00;
const ADC1: u32 = 0x5000_0000;

pub type Stop = fn(&mut Session);

/// What leaves the last voltage vector standing.
pub const STOPS: [(&str, Stop); 4] = [
    ("the control interrupt hangs", |session| perform(session, "hang")),
    ("the end of the conversion is not told", |session| write(session, ADC1 + 0x04, 0)),
    // MMS2 of CR2: the trigger of the ADCs.
    ("the converters are not triggered", |session| change(session, TIM1 + 0x04, !(0xf << 20))),
    // CEN of CR1.
    ("the timer stands still", |session| change(session, TIM1, !1)),
];

fn write(session: &mut Session, address: u32, value: u32) {
    let now = session.machine.now();
    assert_eq!(session.machine.system.write(address, Width::Word, value, now), None);
}

fn change(session: &mut Session, address: u32, mask: u32) {
    let now = session.machine.now();
    let (value, _) = session.machine.system.read(address, Width::Word, now);
    write(session, address, value & mask);
}

/// In the drive that turns, at instants all over a period and over the count of the watchdog's prescaler.
pub fn switches_off_where_the_control_stops(board: &str) {
    let turning = turning(board);
    for (what, stop) in STOPS {
        let mut longest_s = 0.0_f64;
        for instant in 0..12 {
            let mut session = turning.fork();
            run(&mut session, f64::from(instant) * 7.3e-6);
            let at_s = session.seconds();
            let edges = session.machine.system.facts().moe.len();
            stop(&mut session);
            while session.resets.is_empty() && session.seconds() < at_s + 2.0 * OFF_S {
                session.slice(at_s + 2.0 * OFF_S).expect("a run");
            }
            let facts = session.machine.system.facts();
            let [off] = &facts.moe[edges..] else { panic!("{board}, {what}: {:?}", &facts.moe[edges..]) };
            assert!(!off.on && off.at_s - at_s < OFF_S, "{board}, {what}: {off:?} after {at_s}");
            assert!(matches!(session.resets[..], [(_, ResetCause::WindowWatchdog)]), "{board}: {:?}", session.resets);
            longest_s = longest_s.max(off.at_s - at_s);
            if instant == 0 {
                comes_back(board, what, &mut session);
            }
        }
        println!("{board}, {what}: off after {:.0} µs at most", longest_s * 1e6);
    }
}

/// The currents have died, the cause is told, and the drive does what it is told.
fn comes_back(board: &str, what: &str, session: &mut Session) {
    run(session, 0.1);
    let currents = session.machine.system.truth().currents_a;
    assert!(currents.iter().all(|current| current.abs() < 0.05), "{board}, {what}: {currents:?}");
    assert!(says(session, "the window watchdog has reset the chip"), "{board}, {what}: {:#?}", session.lines);
    for request in ["arm", "speed 40"] {
        let reply = ask(session, request);
        assert!(reply.contains("Done"), "{board}, {what}, {request}: {reply}");
    }
    run(session, 0.7);
    assert_eq!(session.resets.len(), 1, "{board}, {what}: {:?}", session.resets);
}

/// All that keeps the tasks busy, with the longest time between two feeds meanwhile.
pub fn is_fed_in_time(board: &str) {
    let mut session = calibrated(board);
    let mut told = 0.0;
    let mut tell = |session: &Session, what: &str| {
        let most = watchdog(session).interval_s.max;
        if most > told {
            println!("{board}, {what}: fed after {:.1} ms", most * 1e3);
            told = most;
        }
    };
    tell(&session, "start and calibration");
    ask(&mut session, "set max_speed_rad_s 111");
    ask(&mut session, "save");
    run(&mut session, 0.2);
    tell(&session, "save of the settings");
    ask(&mut session, "telemetry 1000");
    ask(&mut session, "arm");
    ask(&mut session, "speed 40");
    run(&mut session, 1.0);
    tell(&session, "telemetry and adaptation");
    ask(&mut session, "telemetry 0");
    ask(&mut session, "disarm");
    run(&mut session, 1.0);
    ask(&mut session, "identify");
    let end_s = session.seconds() + 15.0;
    until(&mut session, "activity: None", end_s);
    run(&mut session, 0.5);
    tell(&session, "identification");
    assert_eq!(session.resets, []);
    let Watchdog { timeout_s, interval_s, bites } = watchdog(&session);
    assert_eq!(bites, 0);
    let window = session.machine.system.facts().window_watchdog.expect("a window watchdog");
    println!("{board}: the window watchdog is refreshed after {:.1} % of its time at most", window.used.max * 1e2);
    // An erase may take a tenth longer than is typical.
    assert!(window.bites == 0 && window.used.max < 0.6, "{board}: {window:?}");
    // The oscillator may be 5 % fast (DS12589), and the virtual chip's durations are good to 30 %.
    assert!(1.3 * interval_s.max < timeout_s / 1.05, "{board}: {interval_s:?}");
}
