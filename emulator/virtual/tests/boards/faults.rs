//! Everything that a script can break: after which time the bridge is off and by what, what the drive says of it,
//! that it stays off, and that it runs again once it is mended and cleared.

use crate::support::{CHECKED_S, ask, board, motor, perform, run, turning, until};
use bus::Bus;
use virtual_board::session::Session;

/// Instants at which a fault is injected: spread over a PWM period, or over an electrical turn where the angle matters.
const INSTANTS: u32 = 8;
/// Speed of the rotor, and one electrical turn then.
const SPEED_RAD_S: f64 = 40.0;
const TURN_S: f64 = std::f64::consts::TAU / 4.0 / SPEED_RAD_S;
/// From the trigger of a sample to the bridge's going off in the interrupt that it is for, at most.
const REACTION_S: f64 = 20e-6;

/// What switches the bridge off, and so from when on the time counts and how long it may take.
#[derive(Clone, Copy)]
enum By {
    /// The break input of this name, without code: at once.
    Pin(&'static str),
    /// A comparator at a shunt, through which the current flows while a low side conducts.
    Shunt(&'static str),
    /// The control interrupt, at the sample after so many that are tolerated.
    Sample(u32),
    /// The same, once the bus, which has a capacitor, is beyond a threshold: below, above, V.
    Bus(f64, f64),
    /// The same, once the rotor has turned far enough for it to show: an electrical turn at most.
    Turn,
    /// At once where the angle leaps. Elsewhere the rotor swings, comes to rest, and is found to be stalled.
    Stall,
}

struct Fault {
    what: &'static str,
    mend: &'static str,
    by: By,
    /// As the drive numbers it: any of these.
    codes: &'static [u8],
}

const fn fault(what: &'static str, mend: &'static str, by: By, codes: &'static [u8]) -> Fault {
    Fault { what, mend, by, codes }
}

/// When the bridge went off, and by what.
struct Off {
    /// Since the injection, s.
    after_s: f64,
    /// Since the first sample that could show it, s.
    shown_s: Option<f64>,
    /// Samples until then.
    samples: u32,
    by: String,
}

/// Breaks something and waits for the bridge to go off.
fn inject(session: &mut Session, fault: &Fault, at_most_s: f64) -> Option<Off> {
    let begun_s = session.seconds();
    perform(session, fault.what);
    let mut visible = !matches!(fault.by, By::Bus(..));
    let mut last = session.machine.system.last_sampling();
    let (mut samples, mut first_s) = (0, None);
    while session.machine.system.bridge_is_on() {
        if session.seconds() > begun_s + at_most_s {
            return None;
        }
        session.slice(session.seconds() + if samples < 100 { 1e-6 } else { 1e-4 }).expect("a run");
        let now = session.machine.system.last_sampling();
        // A sequence that had begun may have held its input before.
        let trigger_s = now.map(|(_, trigger)| session.machine.system.seconds(trigger));
        if now != last && visible && trigger_s.is_some_and(|trigger_s| trigger_s >= begun_s) {
            samples += 1;
            first_s = first_s.or(trigger_s);
        }
        last = now;
        if let By::Bus(low_v, high_v) = fault.by {
            visible |= !(low_v..=high_v).contains(&session.machine.system.truth().bus_v);
        }
    }
    let edge = session.machine.system.facts().moe.last().cloned().expect("an edge");
    Some(Off {
        after_s: edge.at_s - begun_s,
        shown_s: first_s.map(|first_s| edge.at_s - first_s),
        samples,
        by: edge.by,
    })
}

/// The fault that a status names.
fn named(status: &str) -> Option<hallservo::fault::Fault> {
    hallservo::fault::Fault::all().find(|fault| status.contains(&format!("mode: Faulted({fault:?})")))
}

/// Named, latched, and over when it is mended and cleared.
fn recovers(session: &mut Session, board: &str, fault: &Fault) -> u8 {
    let what = fault.what;
    let at_most_s = session.seconds() + 0.2;
    let status = until(session, "mode: Faulted(", at_most_s);
    let name = named(&status).unwrap_or_else(|| panic!("{board}, {what}: {status}"));
    let code = name.code();
    assert!(fault.codes.contains(&code), "{board}, {what}: {status}");
    let incident = ask(session, "history 0");
    assert!(incident.contains(&format!("cause: Fault({name:?})")), "{board}, {what}: {incident}");
    let refused = ask(session, "arm");
    assert!(refused.contains(&format!("Refused(Drive(Mode(Faulted({name:?}))))")), "{board}, {what}: {refused}");
    perform(session, fault.mend);
    // The zero of the amplifiers is found again.
    run(session, 0.1);
    assert_eq!(named(&ask(session, "status")), Some(name), "{board}, {what}: latched");
    for request in ["clear", "arm", "speed 40"] {
        let reply = ask(session, request);
        assert!(reply.contains("Done"), "{board}, {what}, {request}: {reply}");
    }
    let at_most_s = session.seconds() + CHECKED_S + 0.5;
    while session.seconds() < at_most_s && (motor(session, "speed / rad/s") - SPEED_RAD_S).abs() > 4.0 {
        run(session, 0.02);
    }
    let speed = motor(session, "speed / rad/s");
    assert!(session.machine.system.bridge_is_on() && (speed - SPEED_RAD_S).abs() < 5.0, "{board}, {what}: {speed}");
    code
}

fn all_switch_off(board: &str, faults: &[Fault]) {
    let mut running = turning(board);
    let facts = running.machine.system.facts();
    let period_s = 1.0 / facts.pwm.as_ref().expect("a PWM").hz;
    println!(
        "{board}, a period of {:.1} us: us after the injection, after the first sample; samples, times at once",
        period_s * 1e6
    );
    for fault in faults {
        let what = fault.what;
        let (at_most_s, apart_s) = match fault.by {
            // From the injection, whatever the instant within a period.
            By::Pin(_) => (1e-6, period_s),
            By::Shunt(_) => (period_s, period_s),
            By::Sample(tolerated) => (f64::from(tolerated + 1) * period_s + REACTION_S, period_s),
            // The capacitor takes its time.
            By::Bus(..) => (5e-3, period_s),
            By::Turn => (TURN_S + f64::from(TOLERATED + 1) * period_s, TURN_S),
            By::Stall => (4.0, TURN_S),
        };
        let (mut after_s, mut shown_s, mut samples, mut code, mut at_once) = (0.0_f64, 0.0_f64, 0, 0, 0);
        for instant in 0..INSTANTS {
            let mut session = running.fork();
            run(&mut session, f64::from(instant) * (period_s + apart_s / f64::from(INSTANTS)) + 1e-6);
            let off = inject(&mut session, fault, 2.0 * at_most_s);
            let off = off.unwrap_or_else(|| panic!("{board}, {what}: on, {:#?}", session.lines));
            match fault.by {
                By::Pin(name) | By::Shunt(name) => assert!(off.by.starts_with(name), "{board}, {what}: {}", off.by),
                _ => assert_eq!(off.by, "software", "{board}, {what}"),
            }
            assert!(off.after_s < at_most_s, "{board}, {what}: {} s instead of {at_most_s}", off.after_s);
            after_s = after_s.max(off.after_s);
            shown_s = shown_s.max(off.shown_s.unwrap_or(0.0));
            samples = samples.max(off.samples);
            at_once += u32::from(off.samples <= TOLERATED + 1);
            if instant == 0 {
                code = recovers(&mut session, board, fault);
            }
        }
        println!("| {what} | {code} | {:.1} | {:.1} | {samples} | {at_once} |", after_s * 1e6, shown_s * 1e6);
        let expected = match fault.by {
            By::Turn => 0,
            // Elsewhere the two angles are not far apart.
            By::Stall => INSTANTS / 2,
            _ => INSTANTS,
        };
        assert!(at_once >= expected, "{board}, {what}: {at_once}");
        let from_sample_s = match fault.by {
            By::Sample(tolerated) => f64::from(tolerated) * period_s + REACTION_S,
            By::Bus(..) => REACTION_S,
            By::Pin(_) | By::Shunt(_) | By::Turn | By::Stall => continue,
        };
        assert!(shown_s < from_sample_s, "{board}, {what}: {shown_s} s instead of {from_sample_s}");
    }
    run(&mut running, 0.1);
    assert!(running.machine.system.bridge_is_on(), "without a fault it runs on");
}

const TOLERATED: u32 = 1;
const HALL: [&[u8]; 3] = [&[1], &[2], &[3]];
/// They contradict each other; or they see too little of a magnet, where a step that does not compare them comes first.
const STUCK: &[u8] = &[7, 8];

const HALLS: [Fault; 11] = [
    fault("hall 1 open", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 2 open", "hall 2 good", By::Sample(TOLERATED), HALL[1]),
    fault("hall 3 open", "hall 3 good", By::Sample(TOLERATED), HALL[2]),
    fault("hall 1 ground", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 1 supply", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 2 supply", "hall 2 good", By::Sample(TOLERATED), HALL[1]),
    fault("hall 3 supply", "hall 3 good", By::Sample(TOLERATED), HALL[2]),
    fault("hall 1 stuck", "hall 1 good", By::Turn, STUCK),
    fault("hall 2 stuck", "hall 2 good", By::Turn, STUCK),
    fault("hall 3 stuck", "hall 3 good", By::Turn, STUCK),
    fault("swap halls 1 2", "swap halls 1 2", By::Stall, &[16, 24]),
];

pub fn switch_off(name: &str) {
    let board = board(name);
    let [low_v, high_v] = board.promises.bus_v;
    let (over_a, trip_a) = (board.promises.over_current_a / 0.75, 1.2 * board.promises.trip_a);
    let by = if board.trip.is_some() { "break TIM1_BKIN" } else { "break COMP" };
    let mut faults = Vec::from(HALLS);
    for phase in ["U", "V", "W"] {
        let mut add = |amperes: f64, by| {
            faults.push(fault(
                words(format!("current {phase} {amperes:.2}A")),
                words(format!("current {phase} 0A")),
                by,
                &[21],
            ));
        };
        // Down through a shunt by hardware, all else by the next sample.
        add(-trip_a, By::Shunt(by));
        add(trip_a, By::Sample(0));
        add(-over_a, By::Sample(0));
        add(over_a, By::Sample(0));
    }
    let bus = By::Bus(low_v - 0.5, high_v + 0.5);
    faults.push(fault(words(format!("bus {:.1}V", low_v - 2.0)), "bus 24V", bus, &[20]));
    faults.push(fault(words(format!("bus {:.1}V", 1.15 * high_v)), "bus 24V", bus, &[19]));
    if board.trip.is_some() {
        faults.push(fault("break low", "break released", By::Pin("break TIM1_BKIN"), &[21]));
    }
    if board.enable.is_some() {
        faults.push(fault("enable open", "enable closed", By::Sample(0), &[48]));
    }
    all_switch_off(name, &faults);
}

fn words(text: String) -> &'static str {
    text.leak()
}
