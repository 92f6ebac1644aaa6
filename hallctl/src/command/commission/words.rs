//! What a step is about to do to the motor, and what it has found.

use super::journal::{Found, Journal};
use crate::error::{Error, Result};
use crate::out::Out;
use crate::say;
use hallservo::service::commission::Action;
use hallservo::service::identify::inertia_unit;
use hallservo::settings::{Control, GuardSettings, Settings};
use serde_json::json;

/// Phases whose resistances differ by more than this share are worth a look.
const UNEVEN: f32 = 0.08;

/// What a step is about to do to the motor.
pub(super) fn announce(action: Action, settings: &Settings, out: Out) -> Result<()> {
    let most_a = settings.control.map_or(f32::NAN, |control| control.max_current_a);
    match action {
        Action::Measure => {
            say!(out, "\n1 of 6: R and L. Each phase carries up to {most_a} A; the rotor may jump to it once.")
        }
        Action::Calibrate => {
            let (turns, hz) = (settings.calibration_turns, settings.calibration_hz);
            say!(out, "\n2 of 6: the Halls. A field turns the rotor, {turns} electrical turns each way at {hz} Hz.")
        }
        Action::Swing => {
            say!(out, "\n3 of 6: flux linkage and inertia. The rotor swings to and fro, by up to {most_a} A.")
        }
        Action::Identify => say!(
            out,
            "\n4 of 6: the motor. It turns to and fro for some seconds, a heavy rotor for minutes, faster than before."
        ),
        Action::Done => {
            say!(
                out,
                "\n5 of 6: the windings' field, by short torques; the speed control. The motor steps between two speeds and \
                 two positions, some times."
            )
        }
    }
}

/// That the measurement of the motor is tried again, and why.
pub(super) fn once_more(error: &Error, settings: &Settings, out: Out) -> Result<()> {
    let why = error.to_string();
    let why = why.lines().next().unwrap_or_default();
    let (rad_s2, hz) = settings
        .control
        .map_or((f32::NAN, f32::NAN), |control| (control.max_acceleration_rad_s2, control.speed_bandwidth_hz));
    let gently = out.units.acceleration(rad_s2.into());
    say!(
        out,
        "  {why}. A load on its shaft or the measured speed may swing: once more, more gently, {gently} and {hz:.1} Hz."
    )
}

/// What a step has found, and what is to be changed by hand.
pub(super) fn tell(found: &Found, settings: &Settings, told_pole_pairs: bool, out: Out) -> Result<()> {
    match found {
        Found::Standstill(found) => {
            say!(out, "{}", found.to_string().trim_end())?;
            let mean = found.resistance_ohm.value;
            for (phase, ohm) in found.phases_ohm.iter().enumerate() {
                if (ohm / mean - 1.0).abs() > UNEVEN {
                    say!(out, "  By hand: phase {} differs: look at its contacts.", phase + 1)?;
                }
            }
        }
        Found::Calibration(Ok(report)) => {
            say!(
                out,
                "  Calibrated at {} Hz: the rotor lagged {:.0}° behind the field and swung by {:.1}°; the angle is noisy \
                 by {:.2}°.",
                settings.calibration_hz,
                report.lag.to_degrees().abs(),
                report.hunting_deg,
                report.angle_noise_deg
            )?;
            for finding in report.findings() {
                say!(out, "  By hand: {finding}.")?;
            }
            if !told_pole_pairs {
                say!(out, "  pole_pairs is {}, as set; the Halls cannot tell.", settings.pole_pairs)?;
            }
        }
        Found::Calibration(Err(error)) => {
            say!(out, "  No calibration at {} Hz: {error}.", settings.calibration_hz)?;
        }
        Found::Swings(found) => {
            say!(out, "  about {} mWb and {}", digits(1e3 * found.flux_linkage_wb), inertia(found.inertia_kgm2))?
        }
        Found::Motor(report) => {
            say!(out, "{}", report.to_string().trim_end())?;
            // As `Commission::identified` decides.
            say!(out, "  R, L and flux linkage stay as found by 1 and 3, where the dead time cancels.")?;
        }
        Found::Unidentified => {
            say!(
                out,
                "  The measurements do not determine the motor, as with a load on a shaft that twists: flux linkage and \
                 inertia stay as found by 3. On a free shaft, or with a stiffer coupling, `hallctl identify` tells more."
            )?;
        }
    }
    out.value(found)
}

/// With as many decimals as there is room for in five digits, four at most.
fn digits(value: f32) -> String {
    let decimals = (4.0 - value.abs().max(1.0).log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

fn inertia(kgm2: f32) -> String {
    let (scale, unit) = inertia_unit(kgm2);
    format!("{} {unit}", digits(scale * kgm2))
}

/// Where it stands.
pub(super) fn stands(journal: &Journal, action: Action, kept: &[&str], out: Out) -> Result<()> {
    let done: Vec<_> = journal
        .found
        .iter()
        .filter_map(|found| match found {
            Found::Standstill(_) => Some("R and L"),
            Found::Calibration(result) => result.is_ok().then_some("the Halls"),
            Found::Swings(_) => Some("flux linkage and inertia"),
            Found::Motor(_) | Found::Unidentified => Some("the motor"),
        })
        .collect();
    if done.is_empty() {
        return Ok(());
    }
    let next = match action {
        Action::Measure => 1,
        Action::Calibrate => 2,
        Action::Swing => 3,
        Action::Identify => 4,
        Action::Done => 5,
    };
    say!(out, "It goes on with step {next}; known from before: {}. `--restart` begins anew.", done.join(", "))?;
    if !kept.is_empty() {
        say!(out, "Set since then, and kept: {}.", kept.join(", "))?;
    }
    out.value(&json!({ "known": done, "next": next, "kept": kept }))
}

/// The motor, and what it is set to.
pub(super) fn summary(settings: &Settings, told_pole_pairs: bool, out: Out) -> Result<()> {
    let Some(Control {
        resistance_ohm,
        inductance_h,
        saliency,
        flux_linkage_wb,
        inertia_kgm2,
        max_current_a,
        max_speed_rad_s,
        max_acceleration_rad_s2,
        current_bandwidth_hz,
        speed_bandwidth_hz,
        guard: GuardSettings { stop_s, .. },
        ..
    }) = settings.control
    else {
        return Ok(());
    };
    say!(out, "\nThe motor, at {max_current_a} A at most:")?;
    let [mh, mwb] = [1e3 * inductance_h, 1e3 * flux_linkage_wb].map(digits);
    say!(out, "  resistance   {:>10} Ω      inductance {mh:>10} mH", digits(resistance_ohm))?;
    if saliency != 1.0 {
        say!(out, "  saliency     {saliency:>10.2}  inductance across the magnets' field over the one along it")?;
    }
    say!(out, "  flux linkage {mwb:>10} mWb    inertia    {:>16}", inertia(inertia_kgm2))?;
    let (speed, unit) = (f64::from(max_speed_rad_s) / out.units.speed.rad_s(), out.units.speed.name());
    let acceleration = out.units.acceleration(max_acceleration_rad_s2.into());
    say!(out, "  speed up to  {speed:10.0} {unit}  reached with {acceleration}")?;
    say!(out, "  a stop after a time-out may take {stop_s:.1} s (stop_s)")?;
    say!(out, "  current control {current_bandwidth_hz:.0} Hz, speed control {speed_bandwidth_hz:.1} Hz")?;
    if !told_pole_pairs {
        say!(
            out,
            "  By hand: pole_pairs is {}, as set. If it is not known, `hallctl pole-pairs` counts them; then commission \
             again.",
            settings.pole_pairs
        )?;
    }
    say!(out, "Next: `hallctl arm`, `hallctl speed 10`; `hallctl cogging learn` makes it smoother.")?;
    out.value(&json!({
        "pole_pairs": settings.pole_pairs,
        "resistance_ohm": resistance_ohm,
        "inductance_h": inductance_h,
        "saliency": saliency,
        "flux_linkage_wb": flux_linkage_wb,
        "inertia_kgm2": inertia_kgm2,
        "max_current_a": max_current_a,
        "max_speed_rad_s": max_speed_rad_s,
        "max_acceleration_rad_s2": max_acceleration_rad_s2,
        "stop_s": stop_s,
        "current_bandwidth_hz": current_bandwidth_hz,
        "speed_bandwidth_hz": speed_bandwidth_hz,
    }))
}

#[test]
fn figures_have_five_digits() {
    let shown = [0.1048, 3.7687, 22.8652, 463_400.0].map(digits);
    assert_eq!(shown, ["0.1048", "3.7687", "22.865", "463400"]);
}
