//! Control and PWM at 40 kHz, and at the lowest and the highest frequency that the board may be set to: two seconds of
//! turning without a late, a missed or a wrong period, and how long a period's work takes.

mod common;

use common::{ask, calibrated, perform, run, until};

fn turns_at_40_khz(board: &str) {
    let mut session = calibrated(board);
    let promised = session.board().promises.control_cycles;
    common::rate::turns_at(&mut session, 40e3, promised);
}

/// Commands, changes of the mode, faults.
fn longest_steps(board: &str) {
    let mut session = calibrated(board);
    let [_, _, longest] = session.board().promises.control_cycles;
    common::rate::longest_steps(&mut session, longest);
}

/// Set while it is calibrated and off, kept over a power cycle, and calibrated anew there.
fn turns_at_other_frequencies(board: &str) {
    for pwm_hz in common::board(board).promises.pwm_hz {
        let mut session = calibrated(board);
        let promised = session.board().promises.control_cycles;
        let triggers = |session: &mut virtual_board::session::Session| {
            let (from_s, from) = (session.seconds(), session.machine.system.facts().triggers);
            run(session, 0.1);
            (session.machine.system.facts().triggers - from) as f64 / (session.seconds() - from_s)
        };
        assert!((triggers(&mut session) / 40e3 - 1.0).abs() < 1e-3);
        let said = ask(&mut session, &format!("set pwm_hz {pwm_hz}"));
        assert!(said.contains("Setting"), "{said}");
        assert!((triggers(&mut session) / pwm_hz - 1.0).abs() < 1e-3, "{said}");
        ask(&mut session, "save");
        run(&mut session, 0.2);
        perform(&mut session, "power cycle");
        run(&mut session, 0.2);
        assert!((triggers(&mut session) / pwm_hz - 1.0).abs() < 1e-3, "after a power cycle");
        session.machine.forget_profile();
        ask(&mut session, "calibrate");
        run(&mut session, 3.0);
        let at_most_s = session.seconds() + 6.0;
        until(&mut session, "activity: None", at_most_s);
        ask(&mut session, "set command_timeout_s 60");
        // Of another number of periods between two tasks, the mean is a cycle or two more or less.
        let [mean, turning, longest] = promised;
        common::rate::turns_at(&mut session, pwm_hz, [mean + 5, turning, longest]);
    }
}

fn main() {
    common::on_every_board(&[
        ("turns_at_40_khz", turns_at_40_khz),
        ("turns_at_other_frequencies", turns_at_other_frequencies),
        ("longest_steps", longest_steps),
    ]);
}
