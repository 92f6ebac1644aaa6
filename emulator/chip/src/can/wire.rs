//! The pair of wires between nodes: who sends, who hears it, and who disturbs whom.
//!
//! Whoever runs the nodes lets them go on for a step ([`STEP_S`]) and then settles the wire: a step is shorter than the
//! shortest frame at 1 Mbit/s, so that a frame, whose begin is found in the step that is over, ends in one that is not
//! begun yet. So every node hears of everything in time, and the order in which the nodes are run makes no difference.

use super::counters::Kind;
use super::frame::Frame;
use super::timing::Timing;

/// From one settlement to the next, s.
pub const STEP_S: f64 = 20e-6;
/// Recessive bits between frames.
const INTERMISSION: f64 = 3.0;
/// An error flag, the flags of the others after it, and the delimiter.
const ERROR_FRAME: f64 = 6.0 + 6.0 + 8.0;
/// Bits after which another's wrong rate has shown: a sixth equal bit, or an edge where there is none.
const NOTICED: f64 = 12.0;

/// Something that happens to a node.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// Its frame is on the wire. At once.
    Started,
    /// Its frame has gone; the bus is free again at this time, s.
    Sent(f64),
    /// Another's frame was the more urgent.
    Lost,
    /// A frame of another is whole.
    Received(Frame),
    /// A frame is not, and the bus is free again at this time, s.
    Failed {
        /// Why.
        kind: Kind,
        /// It was its own.
        own: bool,
        /// In the data phase of a frame that switches the rate.
        switched: bool,
        /// What the counter of reception takes.
        weight: u32,
        /// s.
        free_s: f64,
    },
    /// So many seconds were recessive. Only to who [waits for it](Node::waits).
    Quiet(f64),
    /// They were not any more. Only to who waits for it.
    Busy,
}

/// Who is on the wire.
pub trait Node {
    /// Its frame is ready to be sent from this time on, s; infinity without a frame. It is off the wire without a
    /// connection; then its frames go nowhere.
    fn ready_s(&self) -> f64;
    /// The frame.
    fn frame(&self) -> Frame;
    /// It receives, and may send.
    fn listens(&self) -> bool;
    /// Its pins and its transceiver connect it to the wire.
    fn connected(&self) -> bool;
    /// It counts recessive bits before it takes part (again).
    fn waits(&self) -> bool;
    /// Its error flags are dominant.
    fn is_active(&self) -> bool;
    /// It sends nothing, acknowledgements neither.
    fn is_silent(&self) -> bool;
    /// It knows frames of the FD format.
    fn knows_fd(&self) -> bool;
    /// Its bit rates.
    fn timing(&self) -> Timing;
    /// Whether it still sees its own bits at the data rate, whatever its transceiver's delay.
    fn follows_itself(&self) -> bool;
    /// To be told at this time, or as soon as it can be, s.
    fn tell(&mut self, at_s: f64, event: Event);
}

/// The wire.
#[derive(Clone, Debug, Default)]
pub struct Wire {
    /// When a frame may begin, s.
    free_s: f64,
    /// Everything before is over, s.
    settled_s: f64,
    /// Until when quiet nodes have been told, s.
    told_s: f64,
    /// Time that frames took of the bus, s.
    pub busy_s: f64,
    /// Frames that were received by somebody.
    pub frames: u64,
    /// Error frames.
    pub errors: u64,
}

/// What comes of a frame.
struct Verdict {
    kind: Kind,
    /// Bits of arbitration before it shows, and of the data phase.
    after: [f64; 2],
    /// Who finds it alone at first.
    finders: Vec<usize>,
}

impl Wire {
    /// Does what began before a time, s.
    pub fn settle(&mut self, nodes: &mut [&mut dyn Node], until_s: f64) {
        loop {
            let ready = nodes.iter().map(|node| node.ready_s()).fold(f64::INFINITY, f64::min);
            let start_s = ready.max(self.free_s).max(self.settled_s);
            if start_s >= until_s {
                break;
            }
            self.be_quiet(nodes, start_s);
            let contends = |node: &dyn Node| node.ready_s() <= start_s;
            for node in nodes.iter_mut().filter(|node| !node.connected() && contends(&***node)) {
                // It does not see its own start of frame.
                let free_s = start_s + (1.0 + ERROR_FRAME + INTERMISSION) * node.timing().nominal.bit_s();
                node.tell(start_s, Event::Started);
                node.tell(free_s, failed(Kind::Bit0, true, false, free_s));
            }
            let contenders: Vec<usize> = (0..nodes.len()).filter(|&index| contends(&*nodes[index])).collect();
            if !contenders.is_empty() {
                self.compete(nodes, &contenders, start_s);
            }
        }
        self.be_quiet(nodes, until_s);
        self.settled_s = until_s;
    }

    /// Nothing was sent until then.
    fn be_quiet(&mut self, nodes: &mut [&mut dyn Node], until_s: f64) {
        let from_s = self.told_s.max(self.free_s);
        if until_s > from_s {
            for node in nodes.iter_mut().filter(|node| node.waits()) {
                node.tell(until_s, Event::Quiet(until_s - from_s));
            }
            self.told_s = until_s;
        }
    }

    /// The most urgent frame is sent.
    fn compete(&mut self, nodes: &mut [&mut dyn Node], contenders: &[usize], start_s: f64) {
        let frames: Vec<Frame> = contenders.iter().map(|&index| nodes[index].frame()).collect();
        let most = frames.iter().map(Frame::priority).min().unwrap_or(0);
        let mut winners: Vec<usize> =
            contenders.iter().zip(&frames).filter(|(_, frame)| frame.priority() == most).map(|(at, _)| *at).collect();
        let timing = nodes[winners[0]].timing();
        if contenders.iter().any(|&index| !nodes[index].timing().hears(&timing)) {
            // Bits of different lengths do not compete; they collide.
            winners = contenders.to_vec();
        }
        for &index in contenders {
            let event = if winners.contains(&index) { Event::Started } else { Event::Lost };
            nodes[index].tell(start_s, event);
        }
        for node in nodes.iter_mut().filter(|node| node.waits() && node.connected()) {
            node.tell(start_s, Event::Busy);
        }
        let of_winners: Vec<&Frame> =
            contenders.iter().zip(&frames).filter(|(at, _)| winners.contains(at)).map(|(_, frame)| frame).collect();
        let frame = of_winners[0].clone();
        let [nominal_s, data_s] = [timing.nominal.bit_s(), timing.data.bit_s()];
        let [nominal, data] = frame.bits().map(f64::from);
        match judge(nodes, &winners, &of_winners) {
            None => {
                let end_s = start_s + nominal * nominal_s + data * data_s;
                self.free_s = end_s + INTERMISSION * nominal_s;
                self.frames += 1;
                for &index in &winners {
                    nodes[index].tell(end_s, Event::Sent(self.free_s));
                }
                for index in receivers(nodes, &winners) {
                    if understands(nodes[index], &timing, &frame) {
                        // The last bit of the end may be anything to a receiver.
                        nodes[index].tell(end_s - nominal_s, Event::Received(frame.clone()));
                    } else {
                        // Its flag is recessive.
                        let kind = if frame.fd && !nodes[index].knows_fd() { Kind::Form } else { Kind::Stuff };
                        nodes[index].tell(end_s, failed(kind, false, false, self.free_s));
                    }
                }
            }
            Some(verdict) => {
                let [nominal_bits, data_bits] = verdict.after;
                let found_s = start_s + nominal_bits * nominal_s + data_bits * data_s;
                self.free_s = found_s + (ERROR_FRAME + INTERMISSION) * nominal_s;
                self.errors += 1;
                let switched = data_bits > 0.0 && verdict.kind != Kind::Ack;
                let loud: Vec<usize> = winners.iter().copied().filter(|index| nodes[*index].is_active()).collect();
                let others: Vec<usize> = receivers(nodes, &winners);
                let echo = others.iter().any(|at| nodes[*at].is_active() && !verdict.finders.contains(at));
                for &index in &winners {
                    nodes[index].tell(found_s, failed(verdict.kind, true, switched, self.free_s));
                }
                for index in others {
                    // Who raises its flag first sees the others' after it.
                    let first = verdict.finders.contains(&index) && (echo || !loud.is_empty());
                    let weight = if first { 9 } else { 1 };
                    let kind = if frame.fd && !nodes[index].knows_fd() { Kind::Form } else { Kind::Stuff };
                    let event = Event::Failed { kind, own: false, switched, weight, free_s: self.free_s };
                    nodes[index].tell(found_s, event);
                }
            }
        }
        self.busy_s += self.free_s - start_s;
        self.told_s = self.free_s - INTERMISSION * nominal_s;
        // Delimiter, end and intermission are eleven recessive bits.
        for node in nodes.iter_mut().filter(|node| node.waits() && node.connected()) {
            let bits_s = 11.0 * node.timing().nominal.bit_s();
            node.tell(self.free_s, Event::Quiet(bits_s));
        }
    }
}

fn failed(kind: Kind, own: bool, switched: bool, free_s: f64) -> Event {
    Event::Failed { kind, own, switched, weight: 1, free_s }
}

fn receivers(nodes: &[&mut dyn Node], senders: &[usize]) -> Vec<usize> {
    let hears = |index: &usize| nodes[*index].connected() && nodes[*index].listens() && !senders.contains(index);
    (0..nodes.len()).filter(hears).collect()
}

fn understands(node: &dyn Node, sender: &Timing, frame: &Frame) -> bool {
    node.timing().hears(sender)
        && (!frame.fd || node.knows_fd())
        && (!frame.switched || node.timing().hears_data(sender))
}

/// Why a frame does not come through, if it does not.
fn judge(nodes: &[&mut dyn Node], senders: &[usize], frames: &[&Frame]) -> Option<Verdict> {
    let (frame, timing) = (frames[0], nodes[senders[0]].timing());
    let [nominal, data] = frame.bits().map(f64::from);
    let verdict = |kind, after, finders| Some(Verdict { kind, after, finders });
    if frames.iter().any(|other| *other != frame) || senders.iter().any(|at| !nodes[*at].timing().hears(&timing)) {
        // Two with one identifier differ after it; or they have different rates.
        return verdict(Kind::Bit1, [nominal / 2.0, 0.0], Vec::new());
    }
    let receivers = receivers(nodes, senders);
    let by_nominal = |index: &usize| !nodes[*index].timing().hears(&timing) || frame.fd && !nodes[*index].knows_fd();
    let loud = |index: &usize| nodes[*index].is_active() && !nodes[*index].is_silent();
    let early: Vec<usize> = receivers.iter().copied().filter(|index| by_nominal(index) && loud(index)).collect();
    if !early.is_empty() {
        return verdict(Kind::Bit1, [NOTICED.min(nominal), 0.0], early);
    }
    if frame.switched {
        let before_acknowledgement = [nominal - 9.0, NOTICED.min(data)];
        if senders.iter().any(|index| !nodes[*index].follows_itself()) {
            return verdict(Kind::Bit0, before_acknowledgement, Vec::new());
        }
        let by_data = |index: &usize| !nodes[*index].timing().hears_data(&timing);
        let late: Vec<usize> = receivers.iter().copied().filter(|index| by_data(index) && loud(index)).collect();
        if !late.is_empty() {
            return verdict(Kind::Bit1, before_acknowledgement, late);
        }
    }
    let acknowledged =
        receivers.iter().any(|&index| understands(nodes[index], &timing, frame) && !nodes[index].is_silent());
    if acknowledged { None } else { verdict(Kind::Ack, [nominal - 8.0, data], Vec::new()) }
}
