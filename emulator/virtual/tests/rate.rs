//! Control and PWM at 40 kHz: two seconds of turning without a late, a missed or a wrong period, and how long a
//! period's work takes.

mod common;

use common::calibrated;

fn turns_at_40_khz(board: &str) {
    let mut session = calibrated(board);
    let promised = session.board().promises.control_cycles;
    common::rate::turns_at_40_khz(&mut session, promised);
}

/// Commands, changes of the mode, faults.
fn longest_steps(board: &str) {
    let mut session = calibrated(board);
    let [_, _, longest] = session.board().promises.control_cycles;
    common::rate::longest_steps(&mut session, longest);
}

fn main() {
    common::on_every_board(&[("turns_at_40_khz", turns_at_40_khz), ("longest_steps", longest_steps)]);
}
