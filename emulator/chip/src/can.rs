//! FDCAN1 (RM0440, chapter 44): the controller between its registers and the wire.
//!
//! Frames come and go whole: what the wire finds of a frame is told when it has been on the wire for as long as its
//! bits take, stuffing included. Simpler than silicon: time-triggered operation, tests and loop-backs, timeouts and
//! power-down are complained of; a transmission cannot be cancelled once it is on the wire; the time stamp is that of
//! the end of a frame.

pub mod counters;
pub mod frame;
mod ram;
mod registers;
pub mod station;
pub mod timing;
pub mod wire;

use crate::bits::{bit, field};
use counters::{Counters, Kind, State};
use frame::Frame;
use ram::{Global, Ram, WORDS};
use std::collections::VecDeque;
use timing::{Rate, Timing};
use wire::Event;

const NAME: &str = "FDCAN1";
/// Elements of each FIFO, and buffers.
const DEPTH: u32 = 3;
/// Recessive bits in a row before a node takes part.
const SEQUENCE: f64 = 11.0;
/// Sequences of them before a node that was off does again (RM0440, 44.3.3).
const RECOVERY: u32 = 129;

const INIT: u32 = 1;
const CCE: u32 = 1 << 1;
const MON: u32 = 1 << 5;
const DAR: u32 = 1 << 6;
const FDOE: u32 = 1 << 8;
const BRSE: u32 = 1 << 9;

/// Flags of IR.
mod flag {
    pub const NEW: [u32; 2] = [1, 1 << 3];
    pub const FULL: [u32; 2] = [1 << 1, 1 << 4];
    pub const LOST: [u32; 2] = [1 << 2, 1 << 5];
    pub const HIGH_PRIORITY: u32 = 1 << 6;
    pub const SENT: u32 = 1 << 7;
    pub const CANCELLED: u32 = 1 << 8;
    pub const EMPTY: u32 = 1 << 9;
    pub const EVENT_NEW: u32 = 1 << 10;
    pub const EVENT_FULL: u32 = 1 << 11;
    pub const EVENT_LOST: u32 = 1 << 12;
    pub const OVERFLOW: u32 = 1 << 16;
    pub const PASSIVE: u32 = 1 << 17;
    pub const WARNING: u32 = 1 << 18;
    pub const BUS_OFF: u32 = 1 << 19;
    pub const ERROR: u32 = 1 << 21;
    pub const ERROR_DATA: u32 = 1 << 22;
}

/// A FIFO of the message RAM.
#[derive(Clone, Copy, Debug, Default)]
struct Fifo {
    get: u32,
    fill: u32,
    lost: bool,
}

impl Fifo {
    fn put(&self) -> u32 {
        (self.get + self.fill) % DEPTH
    }

    /// Fill level, get and put index, full, lost.
    fn status(&self) -> u32 {
        self.fill | self.get << 8 | self.put() << 16 | u32::from(self.fill == DEPTH) << 24 | u32::from(self.lost) << 25
    }

    /// Up to this element all have been read.
    fn acknowledge(&mut self, index: u32) {
        if self.fill > 0 {
            let read = (index + DEPTH - self.get) % DEPTH + 1;
            self.get = (index + 1) % DEPTH;
            self.fill -= read.min(self.fill);
        }
    }
}

/// What it waits for before it takes part.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// INIT is set.
    Stopped,
    /// So many sequences of recessive bits are still to come.
    Waiting(u32),
    /// It takes part.
    Running,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct Fdcan {
    cccr: u32,
    nbtp: u32,
    dbtp: u32,
    tdcr: u32,
    /// Registers that are only stored, by offset: TEST, RWD, TSCC, TOCC, IE, ILS, ILE, TXBC, …
    stored: std::collections::BTreeMap<u32, u32>,
    global: Global,
    divider: u32,
    ir: u32,
    counters: Counters,
    /// LEC and DLEC; 7 is no change since they were read.
    codes: [u32; 2],
    /// RESI, RBRS, REDL of the last frame.
    seen: u32,
    high_priority: u32,
    fifos: [Fifo; 2],
    events: Fifo,
    ram: Ram,
    /// Requests of the buffers, and which have been sent or cancelled.
    pending: u32,
    transmitted: u32,
    cancelled: u32,
    /// In the order of their requests.
    queue: VecDeque<(u32, f64)>,
    put: u32,
    /// The buffer whose frame is on the wire.
    sending: Option<u32>,
    phase: Phase,
    /// Recessive bits of the sequence that is seen.
    recessive: f64,
    not_before_s: f64,
    inbox: VecDeque<(f64, Event)>,
    /// Hz.
    clock_hz: f64,
    /// From the pin and back by the transceiver, s.
    loop_s: f64,
    /// Both pins are connected to the transceiver, and it is awake.
    pub connected: bool,
    /// What happened, for the record.
    pub news: Vec<String>,
}

impl Fdcan {
    /// As reset leaves it.
    pub fn new(loop_s: f64) -> Self {
        Self {
            cccr: INIT,
            nbtp: 0x0600_0a03,
            dbtp: 0x0000_0a33,
            tdcr: 0,
            stored: [(0x28, 0xffff_0000)].into(),
            global: Global { control: 0, mask: 0x1fff_ffff },
            divider: 0,
            ir: 0,
            counters: Counters::default(),
            codes: [7, 7],
            seen: 0,
            high_priority: 0,
            fifos: [Fifo::default(); 2],
            events: Fifo::default(),
            ram: Ram([0; WORDS]),
            pending: 0,
            transmitted: 0,
            cancelled: 0,
            queue: VecDeque::new(),
            put: 0,
            sending: None,
            phase: Phase::Stopped,
            recessive: 0.0,
            not_before_s: 0.0,
            inbox: VecDeque::new(),
            clock_hz: 0.0,
            loop_s,
            connected: false,
            news: Vec::new(),
        }
    }

    /// A reset of the peripheral: the message RAM stays.
    pub fn reset(&mut self) {
        let ram = core::mem::replace(&mut self.ram, Ram([0; WORDS]));
        *self = Self { ram, clock_hz: self.clock_hz, ..Self::new(self.loop_s) };
    }

    /// Its kernel clock, Hz.
    pub fn set_clock(&mut self, hz: f64) {
        self.clock_hz = hz;
    }

    /// Bit rates as programmed.
    pub fn timing(&self) -> Timing {
        let clock_hz = self.clock_hz / if self.divider == 0 { 1.0 } else { f64::from(2 * self.divider) };
        let one = |at, length, register| field(register, at, length) + 1;
        let nominal = [one(8, 8, self.nbtp), one(0, 7, self.nbtp), one(25, 7, self.nbtp)];
        let data = [one(8, 5, self.dbtp), one(4, 4, self.dbtp), one(0, 4, self.dbtp)];
        Timing {
            nominal: Rate::new(clock_hz, one(16, 9, self.nbtp), nominal),
            data: Rate::new(clock_hz, one(16, 5, self.dbtp), data),
        }
    }

    /// It takes part in what happens on the wire.
    pub fn runs(&self) -> bool {
        self.phase == Phase::Running
    }

    /// Error counters: transmit, receive; and the state that follows.
    pub fn errors(&self) -> ([u32; 2], State) {
        ([self.counters.transmit, self.counters.receive], self.counters.state())
    }

    /// When something happens next, s.
    pub fn next_s(&self) -> f64 {
        self.inbox.front().map_or(f64::INFINITY, |(at_s, _)| *at_s)
    }

    /// Does the first thing that is due.
    pub fn fire(&mut self) {
        if let Some((at_s, event)) = self.inbox.pop_front() {
            self.happen(at_s, event);
        }
    }

    fn happen(&mut self, at_s: f64, event: Event) {
        match event {
            Event::Started => self.sending = self.next_buffer(),
            Event::Sent(free_s) => self.sent(at_s, free_s),
            Event::Lost if self.cccr & DAR != 0 => {
                if let Some(buffer) = self.next_buffer() {
                    self.give_up(buffer);
                }
            }
            Event::Received(frame) if self.runs() => self.receive(at_s, &frame),
            Event::Failed { kind, own, switched, weight, free_s } => {
                self.fail(kind, own, switched, weight, free_s);
            }
            Event::Quiet(seconds) => self.count(seconds),
            Event::Busy => self.recessive = 0.0,
            Event::Lost | Event::Received(_) => {}
        }
    }

    /// The buffer that is next: the oldest, or the most urgent where they are a queue.
    fn next_buffer(&self) -> Option<u32> {
        if bit(self.stored(0xc0), 24) {
            let urgent = |(buffer, _): &&(u32, f64)| self.load(*buffer).priority();
            self.queue.iter().min_by_key(urgent).map(|(buffer, _)| *buffer)
        } else {
            self.queue.front().map(|(buffer, _)| *buffer)
        }
    }

    fn load(&self, buffer: u32) -> Frame {
        let passive = self.counters.state() != State::Active;
        self.ram.load(buffer as usize, self.cccr & FDOE != 0, self.cccr & BRSE != 0, passive)
    }

    fn done(&mut self, buffer: u32) {
        self.queue.retain(|(queued, _)| *queued != buffer);
        self.pending &= !(1 << buffer);
        if self.pending == 0 {
            self.ir |= flag::EMPTY;
        }
    }

    fn sent(&mut self, at_s: f64, free_s: f64) {
        let Some(buffer) = self.sending.take() else { return };
        self.counters.sent();
        self.codes[0] = 0;
        let frame = self.load(buffer);
        if frame.switched {
            self.codes[1] = 0;
        }
        self.done(buffer);
        self.transmitted |= 1 << buffer;
        if self.stored(0xdc) >> buffer & 1 != 0 {
            self.ir |= flag::SENT;
        }
        if let Some(marker) = self.ram.marker(buffer as usize) {
            let stamp = self.stamp(at_s);
            self.note(&frame, marker, stamp);
        }
        self.rest(free_s);
    }

    fn note(&mut self, frame: &Frame, marker: u32, stamp: u32) {
        if self.events.fill == DEPTH {
            self.events.lost = true;
            self.ir |= flag::EVENT_LOST;
            return;
        }
        self.ram.note(self.events.put() as usize, frame, marker, stamp);
        self.events.fill += 1;
        self.ir |= flag::EVENT_NEW | if self.events.fill == DEPTH { flag::EVENT_FULL } else { 0 };
    }

    /// A passive node lets others go first.
    fn rest(&mut self, free_s: f64) {
        let bits = if self.counters.state() == State::Passive { 8.0 } else { 0.0 };
        self.not_before_s = free_s + bits * self.timing().nominal.bit_s();
    }

    fn give_up(&mut self, buffer: u32) {
        self.done(buffer);
        self.cancelled |= 1 << buffer;
        if self.stored(0xe0) >> buffer & 1 != 0 {
            self.ir |= flag::CANCELLED;
        }
    }

    fn receive(&mut self, at_s: f64, frame: &Frame) {
        self.counters.received();
        self.codes[0] = 0;
        let bits = [(frame.passive, 11), (frame.switched, 12), (frame.fd, 13)];
        self.seen |= bits.iter().filter(|(set, _)| *set).fold(0, |seen, (_, at)| seen | 1 << at);
        if frame.switched {
            self.codes[1] = 0;
        }
        let Some(accepted) = self.ram.accept(frame, self.global) else { return };
        let stamp = self.stamp(at_s);
        let mut stored = None;
        if let Some(number) = accepted.fifo {
            let overwrites = bit(self.global.control, if number == 0 { 9 } else { 8 });
            let fifo = &mut self.fifos[number];
            if fifo.fill == DEPTH {
                fifo.lost = true;
                self.ir |= flag::LOST[number];
                if overwrites {
                    fifo.get = (fifo.get + 1) % DEPTH;
                    fifo.fill -= 1;
                }
            }
            if fifo.fill < DEPTH {
                let place = fifo.put();
                fifo.fill += 1;
                self.ir |= flag::NEW[number] | if fifo.fill == DEPTH { flag::FULL[number] } else { 0 };
                self.ram.store(number, place as usize, frame, accepted, stamp);
                stored = Some(place);
            }
        }
        if accepted.priority {
            self.ir |= flag::HIGH_PRIORITY;
            let where_to = match (accepted.fifo, stored) {
                (None, _) => 0,
                (Some(_), None) => 1 << 6,
                (Some(fifo), Some(place)) => (2 + fifo as u32) << 6 | place,
            };
            let list = u32::from(frame.extended) << 15;
            self.high_priority = list | accepted.filter.unwrap_or(0) << 8 | where_to;
        }
    }

    fn fail(&mut self, kind: Kind, own: bool, switched: bool, weight: u32, free_s: f64) {
        let before = self.counters;
        self.codes[usize::from(switched)] = kind as u32;
        self.ir |= if switched { flag::ERROR_DATA } else { flag::ERROR };
        if own {
            self.counters.failed(kind);
        } else {
            self.counters.disturbed(weight);
        }
        if self.counters.logged == 255 {
            self.ir |= flag::OVERFLOW;
        }
        self.tell_states(&before);
        if own {
            if let Some(buffer) = self.sending.take()
                && self.cccr & DAR != 0
            {
                self.give_up(buffer);
            }
            self.rest(free_s);
        }
        if self.counters.state() == State::Off && before.state() != State::Off {
            self.news.push(format!("{NAME} is bus-off"));
            self.cccr |= INIT;
            self.phase = Phase::Stopped;
        }
    }

    /// Flags of the states that are others than before.
    fn tell_states(&mut self, before: &Counters) {
        if before.warns() != self.counters.warns() {
            self.ir |= flag::WARNING;
        }
        let passive = |counters: &Counters| counters.state() == State::Passive;
        if passive(before) != passive(&self.counters) {
            self.ir |= flag::PASSIVE;
        }
        if (before.state() == State::Off) != (self.counters.state() == State::Off) {
            self.ir |= flag::BUS_OFF | flag::WARNING;
        }
    }

    /// Recessive bits, on the way to taking part.
    fn count(&mut self, seconds: f64) {
        let Phase::Waiting(mut left) = self.phase else { return };
        self.recessive += seconds / self.timing().nominal.bit_s();
        while left > 0 && self.recessive >= SEQUENCE - 1e-6 {
            self.recessive -= SEQUENCE;
            left -= 1;
            if self.counters.state() == State::Off {
                self.codes[0] = Kind::Bit0 as u32;
            }
        }
        self.phase = Phase::Waiting(left);
        if left == 0 {
            self.phase = Phase::Running;
            let before = self.counters;
            if before.state() == State::Off {
                self.counters.recover();
                self.tell_states(&before);
                self.news.push(format!("{NAME} is on the bus again"));
            }
        }
    }

    /// INIT is cleared.
    fn start(&mut self) {
        let off = self.counters.state() == State::Off;
        self.phase = Phase::Waiting(if off { RECOVERY } else { 1 });
        self.recessive = 0.0;
    }

    fn stop(&mut self) {
        self.phase = Phase::Stopped;
        self.sending = None;
        self.inbox.clear();
    }

    /// Whether it samples its own bits of the data phase where they arrive.
    fn follows_itself(&self) -> bool {
        let Timing { data, .. } = self.timing();
        if !bit(self.dbtp, 23) {
            return self.loop_s < data.sample_s();
        }
        // The second sample point is so many quanta of the clock after the bit's begin as it arrives, and is to be
        // within the bit (44.3.2); the delay is counted up to 127.
        let offset_s = f64::from(field(self.tdcr, 8, 7)) / self.clock_hz;
        offset_s > 0.0 && offset_s < data.bit_s() && self.delay() < 127
    }

    /// TDCV: the measured delay and the offset, in periods of the clock.
    fn delay(&self) -> u32 {
        ((self.loop_s * self.clock_hz).ceil() as u32 + field(self.tdcr, 8, 7)).min(127)
    }

    fn stamp(&self, at_s: f64) -> u32 {
        let control = self.stored(0x20);
        if field(control, 0, 2) != 1 {
            return 0;
        }
        let bits = at_s / self.timing().nominal.bit_s() / f64::from(field(control, 16, 4) + 1);
        (bits as u64 & 0xffff) as u32
    }
}

impl wire::Node for Fdcan {
    fn ready_s(&self) -> f64 {
        let may = self.sending.is_none() && self.runs() && self.cccr & MON == 0;
        match self.queue.front() {
            Some((_, asked_s)) if may => asked_s.max(self.not_before_s),
            _ => f64::INFINITY,
        }
    }

    fn frame(&self) -> Frame {
        self.next_buffer().map(|buffer| self.load(buffer)).unwrap_or_default()
    }

    fn listens(&self) -> bool {
        self.runs()
    }

    fn connected(&self) -> bool {
        self.connected
    }

    fn waits(&self) -> bool {
        matches!(self.phase, Phase::Waiting(_))
    }

    fn is_active(&self) -> bool {
        self.counters.state() == State::Active
    }

    fn is_silent(&self) -> bool {
        self.cccr & MON != 0
    }

    fn knows_fd(&self) -> bool {
        self.cccr & FDOE != 0
    }

    fn timing(&self) -> Timing {
        self.timing()
    }

    fn follows_itself(&self) -> bool {
        self.follows_itself()
    }

    fn tell(&mut self, at_s: f64, event: Event) {
        if matches!(event, Event::Started | Event::Lost) {
            return self.happen(at_s, event);
        }
        let place = self.inbox.partition_point(|(known_s, _)| *known_s <= at_s);
        self.inbox.insert(place, (at_s, event));
    }
}
