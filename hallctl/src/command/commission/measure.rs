//! The measurements that nothing but commissioning needs.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::words;
use hallservo::mode::Mode;
use hallservo::service::procedure;
use hallservo::service::standstill::{Electrical, Evaluation};
use hallservo::service::swings::Rough;
use hallservo::settings::Settings;
use hallservo_protocol::{Answer, Ask, Procedure};

const STANDSTILL: &str = "R and L at standstill";
const SWINGS: &str = "flux linkage and inertia";

pub(super) fn swings(client: &mut Client) -> Result<Rough> {
    client.order(Ask::Swing)?;
    crate::command::procedures::wait(client, SWINGS)?;
    client.ask(Ask::Swings, |answer| match answer {
        Answer::Swings(Procedure::Done(found)) => Ok(found),
        Answer::Swings(Procedure::Failed(error)) => Err(super::step(SWINGS, &words::procedure_error(&error))),
        other => unexpected(&other),
    })
}

/// Measures R and L: the drive sums up what flows, the tool chooses what is to flow and computes.
pub(super) fn standstill(client: &mut Client, settings: &Settings) -> Result<Electrical> {
    let config = settings.validate().map_err(|error| super::words_of(&error))?;
    let mut evaluation =
        Evaluation::new(&config).map_err(|error| super::step(STANDSTILL, &words::procedure_error(&error)))?;
    let mut begins = true;
    let measured = measure(client, &mut evaluation, &mut begins);
    // Whatever has happened; but what was refused has begun nothing, and the bridge is on for something else.
    let is_on_for_another = begins && matches!(measured, Err(Error::Refused(_)));
    let disarmed = if is_on_for_another { Ok(()) } else { client.order(Ask::Disarm) };
    let found = measured.and_then(|found| disarmed.map(|()| found))?;
    found.map_err(|error| super::step(STANDSTILL, &why(&error, settings)))
}

/// Why nothing was found. At rest nothing but too small a current leaves it open.
fn why(error: &procedure::Error, settings: &Settings) -> String {
    match (error, &settings.control) {
        (procedure::Error::Inconclusive, Some(control)) => format!(
            "{error}: {:.3} A are little beside the {:.1} A that this board measures at most\n  Allow a larger current, if \
             the motor stands it (`--max-current`), or take a board for smaller ones.",
            control.max_current_a, control.current_full_scale_a
        ),
        _ => words::procedure_error(error),
    }
}

type Measured = std::result::Result<Electrical, procedure::Error>;

fn measure(client: &mut Client, evaluation: &mut Evaluation, begins: &mut bool) -> Result<Measured> {
    loop {
        if let Some(result) = evaluation.result() {
            return Ok(*result);
        }
        if let Err(error) = client.order(Ask::Measure { begins: *begins, probe: evaluation.probe() }) {
            let mode = client.status()?.mode;
            return match mode {
                Mode::Faulted(fault) if !*begins => Ok(Err(procedure::Error::Fault(fault))),
                Mode::Ready | Mode::Unarmed if !*begins => Err(super::step(STANDSTILL, words::STOPPED)),
                _ => Err(error),
            };
        }
        *begins = false;
        let window = client.ask(Ask::Window, |answer| match answer {
            Answer::Window(window) => Ok(window),
            other => unexpected(&other),
        })?;
        if let Some(window) = window {
            evaluation.window(&window);
        }
    }
}
