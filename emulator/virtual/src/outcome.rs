//! What a run came to: all figures, as JSON has them.

use crate::angle::AngleErrors;
use crate::session::{Session, explain, place};
use anyhow::Result;
use bus::{Bus, ResetCause};
use chip::Facts;
use cortex::{Activity, FIRST_IRQ, LogLine, Spent, system_name};
use measure::Range;
use serde::Serialize;
use std::collections::BTreeMap;

/// All figures.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// Name of the board.
    pub board: String,
    /// Virtual time, seconds.
    pub seconds: f64,
    /// Executed since power-on.
    pub instructions: u64,
    /// The core's clock in the end.
    pub hclk_hz: f64,
    /// Part of the time that the core did not sleep.
    pub load: f64,
    /// The control interrupt.
    pub control: Option<Handler>,
    /// All handlers, the control interrupt's among them.
    pub handlers: Vec<Handler>,
    /// What it consists of, the longest first, if it was watched.
    pub parts: Vec<Part>,
    /// Its longest period, if it was watched.
    pub longest: Option<Longest>,
    /// The stack.
    pub stack: Option<Stack>,
    /// Of the drive's angle, where a script asked for telemetry.
    pub angle_error: Option<AngleErrors>,
    /// What was seen at the pins.
    #[serde(flatten)]
    pub facts: Facts,
    /// Accesses to what is not clocked, not modelled, or not there.
    pub wrong_accesses: Vec<WrongAccess>,
    /// Faults, with function, line and registers.
    pub faults: Vec<String>,
    /// Resets, with seconds.
    pub resets: Vec<(f64, ResetCause)>,
    /// The log.
    pub log: Vec<LogLine>,
}

/// How an exception's handler ran. Times in nanoseconds at the clock that HCLK has in the end.
#[derive(Clone, Debug, Serialize)]
pub struct Handler {
    /// Number of the exception.
    pub exception: u16,
    /// Function in the vector table.
    pub name: String,
    /// How often it began in a second, from the mean period.
    pub rate_hz: f64,
    /// Between two beginnings.
    pub period_ns: Range,
    /// From pending to the first instruction.
    pub latency_ns: Range,
    /// Difference between the longest and the shortest latency.
    pub jitter_ns: f64,
    /// From the ADC's trigger to the first instruction.
    pub after_trigger_ns: Range,
    /// From the first instruction to the return.
    pub duration_ns: Range,
    /// Own instructions.
    pub instructions: Range,
    /// Own cycles.
    pub cycles: Range,
    /// Mean of own cycles, and of those that the core waited for the code memory.
    pub mean_cycles: [f64; 2],
    /// Of own cycles, those waited.
    pub waited: Range,
    /// How many took so many own cycles, by the begin of each step of [`cortex::BIN`].
    pub histogram: BTreeMap<u64, u64>,
}

/// What a function took of the control interrupt: in the mean, or in a period.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// Name, without what it calls unless that was inlined from elsewhere.
    pub function: String,
    /// Instructions a period.
    pub instructions: f64,
    /// Cycles a period.
    pub cycles: f64,
    /// Of these, waited for the code memory.
    pub waited: f64,
}

/// A control period.
#[derive(Clone, Debug, Serialize)]
pub struct Longest {
    /// When it was over, seconds.
    pub at_s: f64,
    /// Own cycles.
    pub cycles: u64,
    /// Of these, waited for the code memory.
    pub waited: u64,
    /// What it consists of, the longest first.
    pub parts: Vec<Part>,
}

/// The main stack.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Stack {
    /// Bytes of it.
    pub size: u32,
    /// Bytes that were ever used.
    pub used: u32,
}

/// A wrong access.
#[derive(Clone, Debug, Serialize)]
pub struct WrongAccess {
    /// What is wrong.
    pub what: String,
    /// Address of the access.
    pub address: u32,
    /// Whether it was a store.
    pub write: bool,
    /// Function and line.
    pub place: String,
    /// How often.
    pub count: u64,
    /// When first, seconds.
    pub first_s: f64,
}

impl Outcome {
    /// Of a session so far.
    pub fn of(session: &Session) -> Outcome {
        let machine = &session.machine;
        let handlers: Vec<_> = machine
            .profile()
            .activities()
            .iter()
            .map(|(&number, activity)| handler(session, number, activity))
            .collect();
        let control = session.control_exception();
        let wrong_accesses = machine.complaints().map(|listed| WrongAccess {
            what: listed.complaint.to_string(),
            address: listed.address,
            write: listed.write,
            place: place(&session.image, listed.pc),
            count: listed.count,
            first_s: listed.first_s,
        });
        Outcome {
            board: session.board().name.clone(),
            seconds: session.seconds(),
            instructions: machine.instructions(),
            hclk_hz: machine.system.clock_hz(),
            load: 1.0 - machine.asleep() as f64 / machine.now() as f64,
            control: handlers.iter().find(|handler| Some(handler.exception) == control).cloned(),
            parts: parts(session, machine.watched(), session.watched_periods()),
            longest: machine.longest_watched().map(|found| longest(session, found)),
            handlers,
            stack: session.stack().map(|(size, used)| Stack { size, used }),
            angle_error: AngleErrors::of(&session.deviations(0.0..f64::INFINITY)),
            facts: machine.system.facts(),
            wrong_accesses: wrong_accesses.collect(),
            faults: machine.faults.iter().map(|fault| explain(fault, &session.image)).collect(),
            resets: session.resets.clone(),
            log: session.lines.clone(),
        }
    }

    /// What no firmware should do, in words; nothing of it comes from a script's disturbance alone.
    pub fn verdict(&self) -> Vec<String> {
        let mut wrong: Vec<_> = self.wrong_accesses.iter().map(WrongAccess::to_string).collect();
        wrong.extend(self.facts.findings.iter().map(|(at_s, what)| format!("{what} (first at {at_s:.6} s)")));
        wrong.extend(self.faults.iter().map(|fault| fault.lines().next().unwrap_or_default().to_owned()));
        for leg in self.facts.legs.iter().filter(|leg| leg.shoot_through != 0) {
            wrong.push(format!("shoot-through at {} and {}: {} times", leg.pins[0], leg.pins[1], leg.shoot_through));
        }
        if self.facts.missed_triggers != 0 {
            wrong.push(format!("{} triggers came while a sequence was still converting", self.facts.missed_triggers));
        }
        if self.facts.unread_sequences != 0 {
            wrong.push(format!("{} sequences were overwritten before they were read", self.facts.unread_sequences));
        }
        wrong
    }

    /// As JSON.
    ///
    /// # Errors
    /// None that can be expected: the figures are numbers and text.
    pub fn json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

impl std::fmt::Display for WrongAccess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verb = if self.write { "write to" } else { "read of" };
        write!(f, "{}: {verb} {:#010x} by {}, {} times", self.what, self.address, self.place, self.count)
    }
}

fn handler(session: &Session, exception: u16, activity: &Activity) -> Handler {
    let ns = 1e9 / session.machine.system.clock_hz();
    let in_ns = |range: Range| Range { min: range.min * ns, max: range.max * ns, ..range };
    let vector = session.machine.system.code().get(4 * usize::from(exception)..);
    let target = vector.and_then(|bytes| Some(u32::from_le_bytes(bytes.get(..4)?.try_into().ok()?)));
    let name = system_name(exception).map(String::from).or_else(|| Some(session.image.place(target?).function));
    let jitter = activity.latency.max - activity.latency.min;
    Handler {
        exception,
        name: name.unwrap_or_else(|| format!("IRQ {}", exception - FIRST_IRQ)),
        rate_hz: 1e9 / (activity.mean_period() * ns),
        period_ns: in_ns(activity.period),
        latency_ns: in_ns(activity.latency),
        jitter_ns: if jitter.is_finite() { jitter * ns } else { 0.0 },
        after_trigger_ns: in_ns(activity.since_origin),
        duration_ns: in_ns(activity.duration),
        instructions: activity.instructions,
        cycles: activity.cycles,
        mean_cycles: activity.mean_cycles(),
        waited: activity.waited,
        histogram: activity.histogram.clone(),
    }
}

fn longest(session: &Session, found: &cortex::Longest) -> Longest {
    Longest {
        at_s: session.machine.system.seconds(found.at),
        cycles: found.spent.cycles,
        waited: found.spent.waited,
        parts: parts(session, &found.by_address, 1),
    }
}

/// What each function took of so many periods, in the mean.
fn parts(session: &Session, by_address: &BTreeMap<u32, Spent>, periods: u64) -> Vec<Part> {
    let mut functions = BTreeMap::<String, Spent>::new();
    for (&address, &spent) in by_address {
        functions.entry(session.image.author(address)).or_default().add(spent);
    }
    let a_period = |sum: u64| sum as f64 / periods.max(1) as f64;
    let mut parts: Vec<Part> = functions
        .into_iter()
        .map(|(function, spent)| Part {
            function,
            instructions: a_period(spent.instructions),
            cycles: a_period(spent.cycles),
            waited: a_period(spent.waited),
        })
        .collect();
    parts.sort_by(|a, b| b.cycles.total_cmp(&a.cycles));
    parts
}
