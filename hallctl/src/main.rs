//! The command line of a drive.

use clap::Parser;
use hallctl::command::{Arguments, run};
use std::process::ExitCode;

fn main() -> ExitCode {
    // `hallctl telemetry | head` ends like any other filter.
    sigpipe::reset();
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("hallctl: {error}");
            ExitCode::from(error.code())
        }
    }
}
