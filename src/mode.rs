//! Every state of the drive and every allowed transition.
//!
//! ```text
//!            Calibrate              aligned                swept: bridge off, the service fits
//! Unarmed ─────────────▶ Aligning ───────────▶ Calibrating ────────────────────▶ Unarmed
//!    │ ▲                                                                            │
//!    │ ├── Clear ── Faulted ◀── any fault ── Aligning, Calibrating, Running         │
//!    │ └───────── settings that count the other way ─────────────┐                  │
//!    └───────────────── Install (a calibration) ────────────────▶ Ready ◀───────────┘
//!                                                      Arm │  ▲ Disarm
//!                                                          ▼  │
//!                                                         Running
//! ```
//!
//! As a calibration begins, the drive hands the one before back to the tasks. Whatever ends the new one but success, the
//! drive is not armed before one is installed, which may be the one before.

use crate::fault::Fault;

/// State of the drive.
// With a byte for the state: told from the faults' numbers, each look at it would take ten instructions more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[repr(u8)]
pub enum Mode {
    /// Bridge off, no calibration: the angle is unknown.
    #[default]
    Unarmed,
    /// The field stands still and pulls the rotor to it.
    Aligning,
    /// The field turns open loop, and the rotor with it, while samples are taken.
    Calibrating,
    /// Bridge off, angle and speed are known.
    Ready,
    /// Bridge on, following the command.
    Running,
    /// Bridge off until cleared.
    Faulted(Fault),
}

/// What can change the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// A person asks for a calibration.
    Calibrate,
    /// The rotor has come to rest at the standing field.
    Aligned,
    /// Both sweeps are done.
    Swept,
    /// A calibration arrived, from the service or from storage.
    Installed,
    /// The calibration does not fit the settings that the drive was given.
    Invalidated,
    /// A person asks for the bridge to be on.
    Arm,
    /// A person asks for it to be off.
    Disarm,
    /// Something is wrong.
    Fail(Fault),
    /// A person has taken note of the fault; `calibrated` tells whether there is a calibration to go on with.
    Clear {
        /// Whether a calibration is installed.
        calibrated: bool,
    },
}

impl Mode {
    /// The state after an event; `None` where the event is not allowed and the state stays.
    pub const fn after(self, event: Event) -> Option<Self> {
        use Mode::*;
        Some(match (self, event) {
            (Unarmed | Ready, Event::Calibrate) => Aligning,
            (Aligning, Event::Aligned) => Calibrating,
            // The fit takes a while; the old calibration, if any, was given back when this one began.
            (Calibrating, Event::Swept) => Unarmed,
            (Unarmed | Ready, Event::Installed) => Ready,
            // Adaptation, while running.
            (Running, Event::Installed) => Running,
            (Ready, Event::Invalidated) => Unarmed,
            (Ready, Event::Arm) => Running,
            (Running, Event::Disarm) => Ready,
            (Aligning | Calibrating, Event::Disarm) => Unarmed,
            (Unarmed, Event::Fail(Fault::Calibration)) => Faulted(Fault::Calibration),
            (Aligning | Calibrating | Running, Event::Fail(fault)) => Faulted(fault),
            (Faulted(_), Event::Clear { calibrated: true }) => Ready,
            (Faulted(_), Event::Clear { calibrated: false }) => Unarmed,
            _ => return None,
        })
    }

    /// Whether the bridge may be on.
    pub const fn drives(self) -> bool {
        matches!(self, Self::Aligning | Self::Calibrating | Self::Running)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAULT: Fault = Fault::OverSpeed;
    const MODES: [Mode; 6] =
        [Mode::Unarmed, Mode::Aligning, Mode::Calibrating, Mode::Ready, Mode::Running, Mode::Faulted(FAULT)];
    const EVENTS: [Event; 10] = [
        Event::Calibrate,
        Event::Aligned,
        Event::Swept,
        Event::Installed,
        Event::Invalidated,
        Event::Arm,
        Event::Disarm,
        Event::Fail(FAULT),
        Event::Clear { calibrated: true },
        Event::Clear { calibrated: false },
    ];

    #[test]
    fn the_bridge_comes_on_only_by_arming_or_calibrating() {
        for mode in MODES.iter().filter(|mode| !mode.drives()) {
            for event in EVENTS {
                if mode.after(event).is_some_and(Mode::drives) {
                    let asked = (matches!(mode, Mode::Ready) && event == Event::Arm)
                        || (matches!(mode, Mode::Unarmed | Mode::Ready) && event == Event::Calibrate);
                    assert!(asked, "{mode:?} {event:?}");
                }
            }
        }
    }

    #[test]
    fn every_driving_state_fails_to_off_and_disarms() {
        for mode in MODES.into_iter().filter(|mode| mode.drives()) {
            assert_eq!(mode.after(Event::Fail(FAULT)), Some(Mode::Faulted(FAULT)));
            assert!(mode.after(Event::Disarm).is_some_and(|after| !after.drives()));
        }
    }

    #[test]
    fn a_fault_is_latched_until_cleared() {
        for event in EVENTS {
            let after = Mode::Faulted(FAULT).after(event);
            assert_eq!(after.is_some(), matches!(event, Event::Clear { .. }), "{event:?}");
        }
    }

    #[test]
    fn nothing_runs_without_a_calibration() {
        // From the start, no chain of events without an installation or a clearing that claims one leads to running.
        let mut reached = std::collections::HashSet::from([Mode::Unarmed]);
        for _ in 0..10 {
            for mode in reached.clone() {
                for event in EVENTS {
                    if !matches!(event, Event::Installed | Event::Clear { calibrated: true }) {
                        reached.extend(mode.after(event));
                    }
                }
            }
        }
        assert!(reached.contains(&Mode::Calibrating) && !reached.contains(&Mode::Running));
    }

    extern crate std;
}
