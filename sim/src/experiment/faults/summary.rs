//! What came of the injections, and the settings of the drives that they are made into.

use hallservo::fault::Fault;
use hallservo::settings::{Control, GuardSettings, OnTimeout, Settings};
use serde::Serialize;
use std::collections::BTreeMap;

/// One kind of fault.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Kind {
    /// How often it was injected.
    pub injected: u32,
    /// Found, and told from the others.
    pub detected: u32,
    /// Most control periods from the first sample that shows it to the latched fault.
    pub worst_detection_periods: u32,
    /// Of the faults that only a turning rotor shows: most electrical turns until then.
    pub worst_detection_turns: f64,
}

/// What came of an injection.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub fault: Option<Fault>,
    /// Control periods and electrical turns of the rotor until then.
    pub periods: u32,
    pub turns: f64,
}

/// The figures of `faults --json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Faults injected.
    pub injected: u32,
    /// Faults found.
    pub detected: u32,
    /// Faults not found, or taken for another.
    pub missed: u32,
    /// Faults reported where none was.
    pub false_alarms: u32,
    /// Running periods without a fault, in all.
    pub quiet_periods: u64,
    /// Of the faults that one sample of a voltage, a current or the clock shows: most periods to the latched fault.
    pub worst_detection_periods: u32,
    /// Whether the step that latched a fault always switched the bridge off.
    pub bridge_off_within_one_period: bool,
    /// Each kind.
    pub kinds: BTreeMap<&'static str, Kind>,
}

/// Control periods after which a command times out.
pub(super) const TIMEOUT_PERIODS: u32 = 1200;
/// Successive samples without an angle that are bridged, as on the boards: a spark, but not a broken wire.
pub(super) const TOLERATED: u8 = 1;

/// Settings of the drives that faults are injected into.
pub(super) fn settings() -> Settings {
    let guard = GuardSettings {
        stall_s: 0.02,
        command_timeout_s: TIMEOUT_PERIODS as f32 / 40e3,
        on_timeout: OnTimeout::Fault,
        ..GuardSettings::default()
    };
    let control = Control { max_speed_rad_s: 150.0, guard, ..Control::default() };
    Settings { control: Some(control), max_electrical_hz: 150.0, tolerated_samples: TOLERATED, ..Settings::default() }
}

impl Summary {
    /// Adds another part of the campaign.
    pub(super) fn add(&mut self, part: &Self) {
        self.injected += part.injected;
        self.detected += part.detected;
        self.missed += part.missed;
        self.false_alarms += part.false_alarms;
        self.quiet_periods += part.quiet_periods;
        self.worst_detection_periods = self.worst_detection_periods.max(part.worst_detection_periods);
        self.bridge_off_within_one_period &= part.bridge_off_within_one_period;
        for (name, kind) in &part.kinds {
            let sum = self.kinds.entry(name).or_default();
            sum.injected += kind.injected;
            sum.detected += kind.detected;
            sum.worst_detection_periods = sum.worst_detection_periods.max(kind.worst_detection_periods);
            sum.worst_detection_turns = sum.worst_detection_turns.max(kind.worst_detection_turns);
        }
    }

    /// Counts an injection that was found, or not, and whether one sample shows its kind.
    pub(super) fn count(&mut self, name: &'static str, right: bool, found: &Found, at_once: bool) {
        self.injected += 1;
        self.detected += u32::from(right);
        self.missed += u32::from(!right);
        let kind = self.kinds.entry(name).or_default();
        kind.injected += 1;
        kind.detected += u32::from(right);
        if right {
            kind.worst_detection_periods = kind.worst_detection_periods.max(found.periods);
            kind.worst_detection_turns = kind.worst_detection_turns.max(found.turns);
        }
        if right && at_once {
            self.worst_detection_periods = self.worst_detection_periods.max(found.periods);
        }
    }

    /// A row for each kind.
    pub(super) fn table(&self) -> Vec<Vec<String>> {
        let head = ["fault", "injected", "detected", "longest detection, periods", "electrical turns"]
            .map(String::from)
            .to_vec();
        let rows = self.kinds.iter().map(|(name, kind)| {
            vec![
                (*name).to_string(),
                kind.injected.to_string(),
                kind.detected.to_string(),
                kind.worst_detection_periods.to_string(),
                format!("{:.2}", kind.worst_detection_turns),
            ]
        });
        std::iter::once(head).chain(rows).collect()
    }
}
