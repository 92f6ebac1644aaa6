//! What came of the injections, and the settings of the drives that they are made into.

use hallservo::settings::{Control, GuardSettings, OnTimeout, Settings};
use serde::Serialize;
use std::collections::BTreeMap;

/// One kind of fault.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Kind {
    /// How often it was injected.
    pub injected: u32,
    /// Named in time, and the shaft not moved too far the wrong way.
    pub detected: u32,
    /// No fault in time.
    pub unnoticed: u32,
    /// Taken for another.
    pub misnamed: u32,
    /// Named, but the shaft was moved too far the wrong way.
    pub moved: u32,
    /// Where that is asked: the rotor turned faster than it may.
    pub fast: u32,
    /// Where that is asked: the true current was above its limit.
    pub overloaded: u32,
    /// Never named, and harm done.
    pub harmful_unnamed: u32,
    /// Never named, and none done.
    pub harmless_unnamed: u32,
    /// Time from the injection until half of those that were named had been, ms.
    pub median_ms: f64,
    /// The same for 99 % of them.
    pub late_ms: f64,
    /// Longest from the injection (or from switching on) to the fault that names it, ms.
    pub worst_ms: f64,
    /// Of the faults that only a turning rotor shows: most electrical turns until then.
    pub worst_turns: f64,
    /// Largest true phase current until the fault, A.
    pub worst_current_a: f64,
    /// The same in parts of `over_current_a`.
    pub worst_current: f64,
    /// Highest bus voltage, in parts of `over_voltage_v`.
    pub worst_bus: f64,
    /// Largest motion the wrong way, mechanical degrees.
    pub worst_wrong_deg: f64,
    /// Longest motion the wrong way, ms.
    pub worst_wrong_ms: f64,
    /// What the drive said, and how often.
    pub reported: BTreeMap<String, u32>,
    /// On which board with which commutation it was missed, and how often.
    pub missed_in: BTreeMap<String, u32>,
    /// Where it was missed: some of them.
    pub missed_at: Vec<String>,
    /// Of all that were named.
    #[serde(skip)]
    times_ms: Vec<f64>,
}

/// What became of one injection.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// What the drive said.
    pub reported: String,
    /// It named what was wrong, or did what it had to, in time.
    pub right: bool,
    /// It said something else.
    pub misnamed: bool,
    /// It said anything.
    pub named: bool,
    /// The rotor turned faster than it may, or the current was above its limit, where that is asked.
    pub fast: bool,
    pub overloaded: bool,
    /// Whether the time counts.
    pub seconds: f64,
    pub turns: f64,
    pub current_a: f64,
    pub current: f64,
    pub bus: f64,
    pub wrong_deg: f64,
    pub wrong_ms: f64,
    /// Board and commutation; where, in words.
    pub on: String,
    pub at: String,
}

/// The figures of `faults --json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Sensors of the drives.
    pub halls: u8,
    /// Faults injected.
    pub injected: u32,
    /// Faults found and named in time, the shaft not moved too far the wrong way.
    pub detected: u32,
    /// The others.
    pub missed: u32,
    /// Faults reported where none was.
    pub false_alarms: u32,
    /// Which, and how often.
    pub alarms: BTreeMap<String, u32>,
    /// Where: some of them.
    pub alarmed_at: Vec<String>,
    /// Running periods without a fault, in all.
    pub quiet_periods: u64,
    /// Motors that the calibration refused, in favour of others.
    pub refused_motors: u32,
    /// Drives that did not come back after a fault was cleared.
    pub abandoned: BTreeMap<String, u32>,
    /// Whether the step that latched a fault always switched the bridge off.
    pub bridge_off_within_one_period: bool,
    /// Each kind.
    pub kinds: BTreeMap<String, Kind>,
}

/// Examples that are kept of each kind.
const EXAMPLES: usize = 8;
/// Control periods after which a command of the drives with an encoder times out.
const TIMEOUT_PERIODS: u32 = 1200;

/// Settings of the drives with an encoder, which no board ships.
pub(super) fn settings() -> Settings {
    let guard = GuardSettings {
        stall_s: 0.02,
        command_timeout_s: TIMEOUT_PERIODS as f32 / 40e3,
        on_timeout: OnTimeout::Fault,
        ..GuardSettings::default()
    };
    let control = Control { max_speed_rad_s: 150.0, guard, ..Control::default() };
    Settings { control: Some(control), max_electrical_hz: 150.0, tolerated_samples: 1, ..Settings::default() }
}

fn merge(counts: &mut BTreeMap<String, u32>, others: &BTreeMap<String, u32>) {
    for (name, count) in others {
        *counts.entry(name.clone()).or_default() += count;
    }
}

fn some_of(examples: &mut Vec<String>, others: &[String], most: usize) {
    examples.extend(others.iter().take(most.saturating_sub(examples.len())).cloned());
}

impl Summary {
    pub(super) fn new(seed: u64, halls: u8) -> Self {
        Self { seed, halls, bridge_off_within_one_period: true, ..Self::default() }
    }

    /// Of all its parts, the times by when so many were named.
    pub(super) fn finish(&mut self) {
        for kind in self.kinds.values_mut() {
            kind.times_ms.sort_by(f64::total_cmp);
            (kind.median_ms, kind.late_ms) = (kind.time_ms(0.5), kind.time_ms(0.99));
        }
    }

    /// Adds another part of the campaign.
    pub(super) fn add(&mut self, part: &Self) {
        self.injected += part.injected;
        self.detected += part.detected;
        self.missed += part.missed;
        self.false_alarms += part.false_alarms;
        self.quiet_periods += part.quiet_periods;
        self.bridge_off_within_one_period &= part.bridge_off_within_one_period;
        self.refused_motors += part.refused_motors;
        merge(&mut self.alarms, &part.alarms);
        merge(&mut self.abandoned, &part.abandoned);
        some_of(&mut self.alarmed_at, &part.alarmed_at, 10 * EXAMPLES);
        for (name, kind) in &part.kinds {
            self.kinds.entry(name.clone()).or_default().add(kind);
        }
    }

    /// A fault where nothing was wrong.
    pub(super) fn false_alarm(&mut self, what: String, at: String) {
        self.false_alarms += 1;
        some_of(&mut self.alarmed_at, &[format!("{what}: {at}")], 10 * EXAMPLES);
        *self.alarms.entry(what).or_default() += 1;
    }

    /// Counts an injection.
    pub(super) fn count(&mut self, name: &str, found: Found, most_wrong: (f64, f64)) {
        let moved = found.wrong_deg > most_wrong.0 || found.wrong_ms > 1e3 * most_wrong.1;
        let harmful = moved || found.fast || found.overloaded;
        let detected = found.right && !harmful;
        self.injected += 1;
        self.detected += u32::from(detected);
        self.missed += u32::from(!detected);
        let mut one = Kind {
            injected: 1,
            detected: detected.into(),
            unnoticed: (!found.right && !found.misnamed).into(),
            misnamed: found.misnamed.into(),
            moved: (found.right && moved).into(),
            fast: (found.right && found.fast).into(),
            overloaded: (found.right && found.overloaded).into(),
            harmful_unnamed: (!found.named && harmful).into(),
            harmless_unnamed: (!found.named && !harmful).into(),
            times_ms: if found.named { vec![1e3 * found.seconds] } else { Vec::new() },
            worst_current_a: found.current_a,
            worst_current: found.current,
            worst_bus: found.bus,
            worst_wrong_deg: found.wrong_deg,
            worst_wrong_ms: found.wrong_ms,
            ..Kind::default()
        };
        if found.right {
            (one.worst_ms, one.worst_turns) = (1e3 * found.seconds, found.turns);
        }
        if !detected {
            let Found { wrong_deg, wrong_ms, current_a, seconds, .. } = found;
            let ms = 1e3 * seconds;
            one.missed_in.insert(found.on, 1);
            one.missed_at.push(format!(
                "{} after {ms:.2} ms, {wrong_deg:.1}° and {wrong_ms:.1} ms wrong, {current_a:.2} A: {}",
                found.reported, found.at
            ));
        }
        one.reported.insert(found.reported, 1);
        self.kinds.entry(name.into()).or_default().add(&one);
    }

    /// A row for each kind.
    pub(super) fn table(&self) -> Vec<Vec<String>> {
        let head = [
            "fault",
            "injected",
            "missed",
            "unnoticed",
            "misnamed",
            "moved",
            "fast",
            "current",
            "half, ms",
            "ms",
            "A",
            "of the limit",
            "wrong °",
            "wrong ms",
            "reported",
        ];
        let head = head.map(String::from).to_vec();
        std::iter::once(head).chain(self.kinds.iter().map(|(name, kind)| kind.row(name))).collect()
    }

    /// A row for each fault that was reported where none was.
    pub(super) fn alarm_table(&self) -> Vec<Vec<String>> {
        let head = ["false alarm", "count"].map(String::from).to_vec();
        let rows = self.alarms.iter().chain(&self.abandoned).map(|(name, count)| vec![name.clone(), count.to_string()]);
        std::iter::once(head).chain(rows).collect()
    }
}

impl Kind {
    fn add(&mut self, other: &Self) {
        self.injected += other.injected;
        self.detected += other.detected;
        self.unnoticed += other.unnoticed;
        self.misnamed += other.misnamed;
        self.moved += other.moved;
        self.fast += other.fast;
        self.overloaded += other.overloaded;
        self.harmful_unnamed += other.harmful_unnamed;
        self.harmless_unnamed += other.harmless_unnamed;
        self.times_ms.extend(&other.times_ms);
        for (worst, value) in [
            (&mut self.worst_ms, other.worst_ms),
            (&mut self.worst_turns, other.worst_turns),
            (&mut self.worst_current_a, other.worst_current_a),
            (&mut self.worst_current, other.worst_current),
            (&mut self.worst_bus, other.worst_bus),
            (&mut self.worst_wrong_deg, other.worst_wrong_deg),
            (&mut self.worst_wrong_ms, other.worst_wrong_ms),
        ] {
            *worst = worst.max(value);
        }
        merge(&mut self.reported, &other.reported);
        merge(&mut self.missed_in, &other.missed_in);
        some_of(&mut self.missed_at, &other.missed_at, EXAMPLES);
    }

    /// By when a share of those that were named was named.
    fn time_ms(&self, share: f64) -> f64 {
        let last = self.times_ms.len().saturating_sub(1);
        self.times_ms.get((share * last as f64).ceil() as usize).copied().unwrap_or(0.0)
    }

    fn row(&self, name: &str) -> Vec<String> {
        let mut reported: Vec<_> = self.reported.iter().collect();
        reported.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
        let reported: Vec<_> = reported.iter().take(4).map(|(what, count)| format!("{what}: {count}")).collect();
        vec![
            name.to_string(),
            self.injected.to_string(),
            (self.injected - self.detected).to_string(),
            self.unnoticed.to_string(),
            self.misnamed.to_string(),
            self.moved.to_string(),
            self.fast.to_string(),
            self.overloaded.to_string(),
            format!("{:.2}", self.median_ms),
            format!("{:.2}", self.worst_ms),
            format!("{:.2}", self.worst_current_a),
            format!("{:.2}", self.worst_current),
            format!("{:.1}", self.worst_wrong_deg),
            format!("{:.1}", self.worst_wrong_ms),
            reported.join("; "),
        ]
    }
}
