//! What is seen while the chip runs, for the report.

use crate::adc::Converted;
use crate::facts::{Edge, Sampling, Trace};
use measure::Range;
use plant::Truth;

/// Rows of a trace in a second.
const TRACE_HZ: f64 = 4000.0;

/// The record.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// One for each converter and rank.
    pub sampling: Vec<Sampling>,
    /// Triggers of injected sequences, one for all converters that it starts.
    pub triggers: u64,
    /// Sequences with data that was overwritten unread.
    pub unread: u64,
    unread_now: bool,
    /// Edges of MOE.
    pub moe: Vec<Edge>,
    /// When the brake resistor was switched, s.
    pub brake: Vec<(f64, bool)>,
    /// With the time of the first.
    pub findings: Vec<(f64, String)>,
    /// What a script did.
    pub events: Vec<(f64, String)>,
    /// Resets by the independent watchdog.
    pub bites: u64,
    /// Resets by the window watchdog.
    pub window_bites: u64,
    trace: Trace,
    next_trace_s: f64,
}

impl Record {
    /// Something is wrong; told once.
    pub fn find(&mut self, at_s: f64, what: String) {
        if !self.findings.iter().any(|(_, known)| *known == what) {
            self.findings.push((at_s, what));
        }
    }

    /// A conversion of an injected sequence ended; `instants_ns` of trigger, start, hold and end against the
    /// nearest valley.
    pub fn convert(&mut self, adc: &str, signal: impl FnOnce() -> String, one: &Converted, instants_ns: [f64; 4]) {
        self.unread_now |= one.unread;
        if one.last && core::mem::take(&mut self.unread_now) {
            self.unread += 1;
        }
        let (rank, channel) = (one.rank as u32 + 1, one.channel);
        let known =
            self.sampling.iter().position(|entry| entry.rank == rank && entry.channel == channel && entry.adc == adc);
        let index = known.unwrap_or_else(|| {
            self.sampling.push(Sampling {
                adc: adc.into(),
                rank,
                channel,
                signal: signal(),
                trigger: String::new(),
                trigger_ns: Range::default(),
                start_ns: Range::default(),
                held_ns: Range::default(),
                end_ns: Range::default(),
            });
            self.sampling.len() - 1
        });
        let entry = &mut self.sampling[index];
        entry.trigger_ns.add(instants_ns[0]);
        entry.start_ns.add(instants_ns[1]);
        entry.held_ns.add(instants_ns[2]);
        entry.end_ns.add(instants_ns[3]);
    }

    /// When the next row of the trace is due, s.
    pub fn next_trace_s(&self) -> f64 {
        self.next_trace_s
    }

    /// Adds a row.
    pub fn trace(&mut self, now_s: f64, truth: &Truth, moe: bool) {
        self.next_trace_s += 1.0 / TRACE_HZ;
        let turns = 1.0 / core::f64::consts::TAU;
        let [u, v, w] = truth.currents_a;
        self.trace.rows.push(vec![
            now_s,
            truth.mechanical_angle_rad * turns,
            truth.electrical_angle_rad * turns,
            truth.speed_rad_s,
            u,
            v,
            w,
            truth.torque_nm,
            truth.bus_v,
            f64::from(u8::from(moe)),
        ]);
    }

    /// The trace since the last call.
    pub fn take_trace(&mut self) -> Trace {
        let names = [
            "time / s",
            "angle / turns",
            "electrical angle / turns",
            "speed / rad/s",
            "current U / A",
            "current V / A",
            "current W / A",
            "torque / N m",
            "bus / V",
            "MOE",
        ];
        Trace { names: names.map(String::from).to_vec(), rows: core::mem::take(&mut self.trace.rows) }
    }
}
