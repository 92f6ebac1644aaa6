//! `hallctl coil-field`: what the field of the windings turns the Halls' angle by, from recorded steps of the torque.

use super::motion::{self, Target};
use super::settings;
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::scope::{self, Recording};
use crate::{say, words};
use hallservo::commutation::Commutation;
use hallservo::mode::Mode;
use hallservo::scope::{Channel, Setup, Trigger};
use hallservo::service::coil::{BEFORE, Plan, ROWS, Row, STEPS, field};
use hallservo::service::identify::Estimate;
use hallservo_protocol::Ask;
use indicatif::ProgressBar;
use serde_json::json;
use std::time::Duration;

/// The setting.
const NAME: &str = "hall_coil_deg_a";
/// Where a step triggers, as a share of it.
const LEVEL: f32 = 0.5;
/// Until a light rotor has come to where it is to rest, and a heavy one has gone on, in the drive's time.
const REST_MS: u64 = 120;
/// A step lasts so long at least: the rows after it.
const LASTS: Duration = Duration::from_millis(3);
/// Longest wait for a recording, in the drive's time.
const LONGEST_S: f64 = 0.5;

/// Measures it, and sets it.
pub(super) fn measure(client: &mut Client, out: Out) -> Result<()> {
    let found = measured(client)?;
    let set = tells(&found);
    tell(&found, out)?;
    out.value(&json!({ "deg_a": found.value, "error_deg_a": found.error, "set": set }))
}

/// In words.
fn tell(found: &Estimate, out: Out) -> Result<()> {
    let Estimate { value, error } = *found;
    if tells(found) {
        say!(out, "An ampere turns the Halls' angle by {value:.3}° ± {error:.3}° electrical: {NAME} is set.")
    } else {
        say!(out, "The windings' field does not show: {value:.3}° ± {error:.3}° an ampere. {NAME} is 0.")
    }
}

/// Whether it is known to be there.
fn tells(found: &Estimate) -> bool {
    found.value.abs() > found.error
}

/// Measures it, and sets it where it shows; the bridge is off in the end. What fails leaves the setting as it was.
fn measured(client: &mut Client) -> Result<Estimate> {
    let status = client.status()?;
    if status.mode == Mode::Running {
        return Err(Error::Refused("the bridge is on: `hallctl stop` first".into()));
    }
    if status.commutation != Commutation::FieldOriented {
        return Err(Error::Refused("there is no current along q: `hallctl commutation field-oriented` first".into()));
    }
    let present = settings::read(client)?;
    let config = present.validate().map_err(|error| Error::Refused(words::setting_error(&error)))?;
    let Some(control) = &config.control else {
        return Err(Error::Refused("there is no current sensing".into()));
    };
    let before = present.control.map_or(0.0, |control| control.hall_coil_deg_a);
    set(client, 0.0)?;
    let constant = present.control.map_or(0.0, |control| 1.5 * f32::from(present.pole_pairs) * control.flux_linkage_wb);
    let steps = Steps { plan: Plan::new(control), constant, pole_pairs: present.pole_pairs.into() };
    let found = steps.record(client).and_then(|recordings| {
        let rows: Vec<_> = recordings.iter().map(Vec::as_slice).collect();
        field(&rows).ok_or_else(|| Error::Failed("the recordings tell nothing: did the current flow?".into()))
    });
    let value = match &found {
        Ok(found) if tells(found) => found.value,
        Ok(_) => 0.0,
        Err(_) => before,
    };
    if matches!(found, Err(Error::Interrupted)) {
        client.carry_on();
    }
    // Why nothing was found matters more than that the setting is refused by a drive that is switched off, say.
    let restored = set(client, value);
    found.and_then(|found| restored.map(|()| found))
}

fn set(client: &mut Client, value: f32) -> Result<()> {
    client.setting(Ask::Set { name: NAME, value }, |_| ())
}

/// The steps.
struct Steps {
    plan: Plan,
    /// N·m/A
    constant: f32,
    pole_pairs: f64,
}

impl Steps {
    /// Records all of them, armed meanwhile.
    fn record(&self, client: &mut Client) -> Result<Vec<Vec<Row>>> {
        let began_turns = client.status()?.position_turns;
        client.arm()?;
        let bar = ProgressBar::new(STEPS.into()).with_message("the field of the windings");
        let recordings = (0..STEPS).map(|step| {
            bar.inc(1);
            self.step(client, step, began_turns)
        });
        let recordings: Result<Vec<_>> = recordings.collect();
        bar.finish_and_clear();
        if matches!(recordings, Err(Error::Interrupted)) {
            client.carry_on();
            motion::brake(client)?;
            client.order(Ask::Disarm)?;
            return Err(Error::Interrupted);
        }
        motion::rest(client)?;
        client.order(Ask::Disarm)?;
        recordings
    }

    fn step(&self, client: &mut Client, step: u32, began_turns: f64) -> Result<Vec<Row>> {
        let order = |client: &mut Client, target: Target| {
            client.order(target.ask()).map_err(|error| motion::fallen(client, error))
        };
        client.still_controls()?;
        if self.plan.is_light {
            // Where the winding is warm, little current is left to stop with.
            motion::rest(client)?;
            order(client, Target::Position(began_turns + self.plan.place(step) / self.pole_pairs))?;
        }
        client.wait_ms(REST_MS)?;
        client.still_controls()?;
        // What holds the rotor asks for currents by itself.
        order(client, Target::Torque(0.0))?;
        let size_a = self.plan.step_a(step);
        let trigger = Trigger::Level { channel: Channel::ReferenceQ, level: LEVEL * size_a, rising: size_a > 0.0 };
        let channels = [Some(Channel::Position), Some(Channel::CurrentQ), None, None];
        let setup = Setup { channels, every: 1, rows: ROWS as u16, before: BEFORE, trigger };
        let id = scope::begin(client, setup)?;
        // The rows before the step.
        client.wait_ms(3)?;
        client.still_controls()?;
        order(client, Target::Torque(size_a * self.constant))?;
        // On the wall: to ask a drive for its time may take so long that the torque has turned the rotor up meanwhile.
        client.listen(LASTS)?;
        order(client, if self.plan.is_light { Target::Speed(0.0) } else { Target::Torque(0.0) })?;
        Ok(self.rows(&scope::finish(client, id, LONGEST_S)?))
    }

    fn rows(&self, recording: &Recording) -> Vec<Row> {
        let (turns, amperes) = (recording.of(Channel::Position), recording.of(Channel::CurrentQ));
        let first = turns.first().copied().unwrap_or_default();
        let rows = recording.time_s.iter().zip(turns.iter().zip(amperes));
        rows.map(|(time_s, (turns, amperes))| Row {
            time_s: *time_s as f32,
            angle_deg: (360.0 * self.pole_pairs * (turns - first)) as f32,
            current_a: *amperes as f32,
        })
        .collect()
    }
}
