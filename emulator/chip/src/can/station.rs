//! A node without a chip: an adapter, or whoever a test puts on the wire. Its frames come from outside, and those that
//! it receives are kept.

use super::counters::{Counters, State};
use super::frame::Frame;
use super::timing::Timing;
use super::wire::{Event, Node};
use std::collections::VecDeque;

/// The node.
#[derive(Clone, Debug)]
pub struct Station {
    timing: Timing,
    /// Sends nothing by itself, acknowledgements neither.
    pub silent: bool,
    /// Knows frames of the FD format.
    pub fd: bool,
    counters: Counters,
    queue: VecDeque<(f64, Frame)>,
    sending: bool,
    not_before_s: f64,
    /// Received frames that nobody has taken yet, with the time of their end, s.
    pub received: Vec<(f64, Frame)>,
    /// Frames that have gone.
    pub sent: u64,
    /// Frames, its own and others', that failed.
    pub failed: u64,
}

impl Station {
    /// With these bit rates.
    pub fn new(timing: Timing) -> Self {
        Self {
            timing,
            silent: false,
            fd: true,
            counters: Counters::default(),
            queue: VecDeque::new(),
            sending: false,
            not_before_s: 0.0,
            received: Vec::new(),
            sent: 0,
            failed: 0,
        }
    }

    /// Sends a frame as soon as the bus is free from this time on, s, after those that wait.
    pub fn send(&mut self, at_s: f64, frame: Frame) {
        self.queue.push_back((at_s, frame));
    }

    /// Frames that wait.
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// By its error counters.
    pub fn state(&self) -> State {
        self.counters.state()
    }

    /// Begins anew with counters of zero, as an adapter does that is opened again.
    pub fn restart(&mut self) {
        self.counters = Counters::default();
        self.queue.clear();
    }

    fn free(&mut self, free_s: f64) {
        let bits = if self.state() == State::Passive { 8.0 } else { 0.0 };
        self.not_before_s = free_s + bits * self.timing.nominal.bit_s();
        self.sending = false;
    }
}

impl Node for Station {
    fn ready_s(&self) -> f64 {
        let may = !self.sending && !self.silent && self.state() != State::Off;
        self.queue.front().filter(|_| may).map_or(f64::INFINITY, |(at_s, _)| at_s.max(self.not_before_s))
    }

    fn frame(&self) -> Frame {
        let passive = |frame: &Frame| frame.fd && self.state() != State::Active;
        let queued = self.queue.front().map(|(_, frame)| Frame { passive: passive(frame), ..frame.clone() });
        queued.unwrap_or_default()
    }

    fn listens(&self) -> bool {
        self.state() != State::Off
    }

    fn connected(&self) -> bool {
        true
    }

    fn waits(&self) -> bool {
        false
    }

    fn is_active(&self) -> bool {
        self.state() == State::Active
    }

    fn is_silent(&self) -> bool {
        self.silent
    }

    fn knows_fd(&self) -> bool {
        self.fd
    }

    fn timing(&self) -> Timing {
        self.timing
    }

    fn follows_itself(&self) -> bool {
        true
    }

    fn tell(&mut self, at_s: f64, event: Event) {
        match event {
            Event::Started => self.sending = true,
            Event::Sent(free_s) => {
                self.counters.sent();
                self.sent += 1;
                self.queue.pop_front();
                self.free(free_s);
            }
            Event::Received(frame) => {
                self.counters.received();
                self.received.push((at_s, frame));
            }
            Event::Failed { kind, own, weight, free_s, .. } => {
                self.failed += 1;
                if own {
                    self.counters.failed(kind);
                    self.free(free_s);
                } else {
                    self.counters.disturbed(weight);
                }
            }
            Event::Lost | Event::Quiet(_) | Event::Busy => {}
        }
    }
}
