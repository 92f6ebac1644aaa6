//! The command line of a drive.

use hallctl::command::{Arguments, run};
use hallctl::error::Error;
use hallctl::interrupt;
use hallctl::out::Out;
use hallctl::tell;
use hallctl::units::Units;
use std::env::args_os;
use std::ffi::OsString;
use std::process::ExitCode;

fn main() -> ExitCode {
    // `hallctl telemetry | head` ends like any other filter.
    sigpipe::reset();
    let arguments = Arguments::read(args_os().map(quantity));
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Who ends all processes at once, the drive's or the port's among them, did not unplug a cable.
            if matches!(error, Error::Lost { .. }) && interrupt::came() {
                tell!("hallctl: a signal was to end this, and then the drive could not be told");
            }
            tell!("hallctl: {error}");
            if arguments.json {
                // Nothing is left to be said where that fails.
                let _ = (Out { json: true, units: Units::default() }).value(&error.value());
            }
            ExitCode::from(error.code())
        }
    }
}

/// What begins like a negative number is one, though a unit follows, and no option.
fn quantity(argument: OsString) -> OsString {
    // The name of a file may be anything.
    let Some(argument) = argument.to_str() else { return argument };
    // `-.5` is no number to who reads the command line.
    let whole = argument.strip_prefix("-.").map(|rest| format!("-0.{rest}"));
    let argument = whole.as_deref().unwrap_or(argument);
    let negative =
        argument.strip_prefix('-').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit() || c == '.'));
    match argument.parse::<f64>() {
        Err(_) if negative => format!(" {argument}").into(),
        // Nor is `-5e-1`.
        Ok(number) if negative && argument.contains(['e', 'E']) => number.to_string().into(),
        _ => argument.into(),
    }
}
