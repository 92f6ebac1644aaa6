//! Everything that a script can break, on both boards: after which time the bridge is off and by what, what the drive says of it,
//! that it stays off, and that it runs again once it is mended and cleared.

use crate::support::{ESC, NUCLEO, ask, motor, perform, run, says, turning};
use bus::System;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

/// Instants within the PWM period at which a fault is injected, one a period.
const INSTANTS: u32 = 8;

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
    Turn(u32),
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
    perform(session, fault.what);
    let begun_s = session.seconds();
    let mut visible = !matches!(fault.by, By::Bus(..));
    let mut last = session.machine.system.last_sampling();
    let (mut samples, mut first_s) = (0, None);
    while session.machine.system.bridge_is_on() {
        if session.seconds() > begun_s + at_most_s {
            return None;
        }
        session.slice(session.seconds() + 1e-6).expect("a run");
        let now = session.machine.system.last_sampling();
        if now != last && visible {
            samples += 1;
            first_s = first_s.or(now.map(|(_, trigger)| session.machine.system.seconds(trigger)));
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

fn number(reply: &str, key: &str) -> Option<u8> {
    let rest = reply.split_once(key)?.1;
    rest.split(|character: char| !character.is_ascii_digit()).next()?.parse().ok()
}

/// Named, latched, and over when it is mended and cleared.
fn recovers(session: &mut Session, board: &str, fault: &Fault) -> u8 {
    let what = fault.what;
    run(session, 5e-3);
    let status = ask(session, "status");
    let code = number(&status, "mode: Faulted(").unwrap_or_else(|| panic!("{board}, {what}: {status}"));
    assert!(fault.codes.contains(&code), "{board}, {what}: {status}");
    assert!(says(session, &format!("fault {code}: ")), "{board}, {what}: {:#?}", session.lines);
    let refused = ask(session, "arm");
    assert!(refused.contains(&format!("Refused(Mode(Faulted({code})))")), "{board}, {what}: {refused}");
    perform(session, fault.mend);
    run(session, 20e-3);
    assert_eq!(number(&ask(session, "status"), "mode: Faulted("), Some(code), "{board}, {what}: latched");
    for request in ["clear", "arm", "speed 40"] {
        let reply = ask(session, request);
        assert!(reply.contains("Done"), "{board}, {what}, {request}: {reply}");
    }
    run(session, 0.25);
    let speed = motor(session, "speed / rad/s");
    assert!(session.machine.system.bridge_is_on() && (speed - 40.0).abs() < 5.0, "{board}, {what}: {speed}");
    code
}

fn all_switch_off(board: &str, faults: &[Fault]) {
    let mut running = turning(board);
    let outcome = Outcome::of(&running);
    let period_s = 1.0 / outcome.facts.pwm.as_ref().expect("a PWM").hz;
    let control = outcome.control.as_ref().expect("a control interrupt");
    // From the trigger of a sample to the end of the interrupt that it is for.
    let reaction_s = (control.after_trigger_ns.max + control.duration_ns.max) * 1e-9;
    println!(
        "{board}: period {:.1} us, from trigger to the interrupt's end {:.1} us",
        period_s * 1e6,
        reaction_s * 1e6
    );
    for fault in faults {
        let what = fault.what;
        let (at_most_s, bound_s) = match fault.by {
            By::Pin(_) => (period_s, 1e-6),
            By::Shunt(_) => (2.0 * period_s, period_s),
            By::Sample(tolerated) => (1e-3, f64::from(tolerated + 1) * period_s + reaction_s),
            By::Bus(..) => (5e-3, f64::INFINITY),
            By::Turn(_) => (0.1, std::f64::consts::TAU / 4.0 / 40.0 * 1.2),
        };
        let (mut after_s, mut shown_s, mut most, mut code) = (0.0_f64, 0.0_f64, 0, 0);
        for instant in 0..INSTANTS {
            let mut session = running.fork();
            run(&mut session, f64::from(instant) * period_s * (1.0 + 1.0 / f64::from(INSTANTS)) + 1e-6);
            let off = inject(&mut session, fault, at_most_s);
            let off = off.unwrap_or_else(|| panic!("{board}, {what}: on after {at_most_s} s: {:#?}", session.lines));
            match fault.by {
                By::Pin(name) | By::Shunt(name) => assert!(off.by.starts_with(name), "{board}, {what}: {}", off.by),
                _ => assert_eq!(off.by, "software", "{board}, {what}"),
            }
            assert!(off.after_s < bound_s, "{board}, {what}: {} s instead of {bound_s}", off.after_s);
            after_s = after_s.max(off.after_s);
            shown_s = shown_s.max(off.shown_s.unwrap_or(0.0));
            most = most.max(off.samples);
            if instant == 0 {
                code = recovers(&mut session, board, fault);
            }
        }
        println!("| {what} | {code} | {:.1} | {:.1} | {most} |", after_s * 1e6, shown_s * 1e6,);
        match fault.by {
            By::Sample(tolerated) => assert!(shown_s < f64::from(tolerated) * period_s + reaction_s, "{board}, {what}"),
            By::Bus(..) => assert!(shown_s < reaction_s, "{board}, {what}: {shown_s}"),
            _ => {}
        }
    }
    run(&mut running, 0.1);
    assert!(running.machine.system.bridge_is_on(), "without a fault it runs on");
}

const TOLERATED: u32 = 1;
const HALL: [&[u8]; 3] = [&[1], &[2], &[3]];

const HALLS: [Fault; 11] = [
    fault("hall 1 open", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 2 open", "hall 2 good", By::Sample(TOLERATED), HALL[1]),
    fault("hall 3 open", "hall 3 good", By::Sample(TOLERATED), HALL[2]),
    fault("hall 1 ground", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 1 supply", "hall 1 good", By::Sample(TOLERATED), HALL[0]),
    fault("hall 2 supply", "hall 2 good", By::Sample(TOLERATED), HALL[1]),
    fault("hall 3 supply", "hall 3 good", By::Sample(TOLERATED), HALL[2]),
    fault("hall 1 stuck", "hall 1 good", By::Turn(TOLERATED), &[4, 5, 6, 7, 8, 9, 16, 17]),
    fault("hall 2 stuck", "hall 2 good", By::Turn(TOLERATED), &[4, 5, 6, 7, 8, 9, 16, 17]),
    fault("hall 3 stuck", "hall 3 good", By::Turn(TOLERATED), &[4, 5, 6, 7, 8, 9, 16, 17]),
    fault("swap halls 1 2", "swap halls 1 2", By::Turn(TOLERATED), &[4, 5, 6, 7, 8, 9, 16, 17]),
];

#[test]
fn every_fault_switches_the_nucleo_off() {
    let mut faults = Vec::from(HALLS);
    for (phase, mend) in [("U", "current U 0A"), ("V", "current V 0A"), ("W", "current W 0A")] {
        let of = |amperes: &str| &*format!("current {phase} {amperes}").leak();
        // From 30 A down through a shunt by hardware, all else by the next sample.
        faults.push(fault(of("-40A"), mend, By::Shunt("break TIM1_BKIN"), &[21]));
        faults.push(fault(of("40A"), mend, By::Sample(0), &[21]));
        faults.push(fault(of("-8A"), mend, By::Sample(0), &[21]));
        faults.push(fault(of("8A"), mend, By::Sample(0), &[21]));
    }
    faults.push(fault("bus 7V", "bus 24V", By::Bus(8.8, 50.2), &[20]));
    faults.push(fault("bus 60V", "bus 24V", By::Bus(8.8, 50.2), &[19]));
    faults.push(fault("break low", "break released", By::Pin("break TIM1_BKIN"), &[21]));
    all_switch_off(NUCLEO, &faults);
}

#[test]
fn every_fault_switches_the_esc_off() {
    let mut faults = Vec::from(HALLS);
    for (phase, mend) in [("U", "current U 0A"), ("V", "current V 0A"), ("W", "current W 0A")] {
        let of = |amperes: &str| &*format!("current {phase} {amperes}").leak();
        // From 60 A down through a shunt by the comparators, all else by the next sample.
        faults.push(fault(of("-70A"), mend, By::Shunt("break COMP"), &[21]));
        faults.push(fault(of("70A"), mend, By::Sample(0), &[21]));
        faults.push(fault(of("-8A"), mend, By::Sample(0), &[21]));
        faults.push(fault(of("8A"), mend, By::Sample(0), &[21]));
    }
    faults.push(fault("bus 10V", "bus 24V", By::Bus(12.3, 28.2), &[20]));
    faults.push(fault("bus 32V", "bus 24V", By::Bus(12.3, 28.2), &[19]));
    all_switch_off(ESC, &faults);
}
