//! Many tools at one drive: whose answer it is, who gets how much telemetry, and what happens when a tool is gone.
//!
//! Takes frames and returns frames; reads and writes nothing itself. Each request gets a number of its own towards the
//! drive, and the answer the number that the tool gave it. The drive sends its telemetry as often as the most eager
//! tool wants it; the others get a share. When the tool that controls the drive vanishes without having released it,
//! the motor is braked and the bridge is switched off.

use hallservo_protocol::{Answer, Ask, Decoder, Error, FRAME, Refusal, Reply, Request, Telemetry, encode};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};

/// Requests that wait for an answer, at most; older ones are forgotten.
const PENDING: usize = 512;
/// Bytes that are no frames and are passed on in one piece.
const RAW: usize = 512;
/// As which the hub itself asks.
const NUMBER: u32 = u32::MAX;

/// A tool at the hub.
pub type Tool = u32;

/// Where a frame goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum To {
    /// The drive.
    Drive(Vec<u8>),
    /// A tool, as the answer to one of its requests.
    Answered(Tool, Vec<u8>),
    /// A tool, unasked.
    Told(Tool, Vec<u8>),
    /// [`Hub::braked`] is to be called when the motor has had time to come to rest.
    Later,
}

/// Cuts a stream of bytes into frames, zeros included, and leaves what is no frame in pieces.
#[derive(Debug, Default)]
pub struct Frames(Vec<u8>);

impl Frames {
    /// Takes a byte; a frame or a piece when it is complete.
    pub fn push(&mut self, byte: u8) -> Option<Vec<u8>> {
        if byte == 0 && self.0.iter().all(|&byte| byte == 0) {
            self.0 = vec![0];
            return None;
        }
        self.0.push(byte);
        (byte == 0 || self.0.len() >= RAW).then(|| std::mem::take(&mut self.0))
    }
}

/// What a frame says, in the decoder's words.
fn decoded<R>(frame: &[u8], understand: impl FnOnce(Result<Request<'_>, Error>) -> R) -> Option<R> {
    let mut decoder = Decoder::new();
    let (last, rest) = frame.split_last()?;
    for &byte in rest {
        let _ = decoder.push::<Request<'_>>(byte);
    }
    decoder.push(*last).map(understand)
}

/// Whether a frame of a tool is a request to disarm, which waits for nothing.
pub fn is_stop(frame: &[u8]) -> bool {
    decoded(frame, |request| matches!(request, Ok(Request { ask: Ask::Disarm, .. }))) == Some(true)
}

fn framed(message: &impl Serialize) -> Vec<u8> {
    let mut frame = [0; FRAME];
    // What was decoded from a frame fits into one.
    let length = encode(message, &mut frame).unwrap_or(0);
    frame[..length].to_vec()
}

/// A request that the drive has not answered yet.
#[derive(Clone, Copy, Debug)]
struct Pending {
    id: u16,
    /// Who asked, and under which number; none where the hub did.
    from: Option<(Tool, u16)>,
    meaning: Meaning,
}

impl Pending {
    fn is_from(&self, tool: Tool) -> bool {
        self.from.is_some_and(|(from, _)| from == tool)
    }
}

/// What an answer means for the hub.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Meaning {
    /// Nothing.
    Other,
    /// The tool controls, attended or not.
    Controls(Control),
    /// This tool no more.
    Releases,
    /// Nobody does.
    Disarms,
    /// From now on telemetry comes under this number, so often, and a tool gets its share of it.
    Telemetry { hz: f32, share: Option<Share> },
}

/// How a tool controls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Control {
    /// Who it is to the drive.
    client: u32,
    /// Whether what it began ends with it.
    attended: bool,
}

/// What a tool wants of the telemetry.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Share {
    id: u16,
    hz: f32,
    due: f32,
    number: u32,
}

/// A tool's telemetry: how often it has asked for it, and what the drive has agreed to.
#[derive(Clone, Copy, Debug, Default)]
struct Wish {
    hz: f32,
    share: Option<Share>,
}

/// Telemetry as the drive sends it.
#[derive(Clone, Copy, Debug)]
struct Stream {
    id: u16,
    hz: f32,
    number: u32,
}

/// The tools of a drive.
#[derive(Debug, Default)]
pub struct Hub {
    last_tool: Tool,
    last_id: u16,
    tools: BTreeMap<Tool, Wish>,
    pending: VecDeque<Pending>,
    stream: Option<Stream>,
    /// Who controls, and how.
    controller: Option<(Tool, Control)>,
    /// Whether the motor is being braked, as its tool has gone.
    brakes: bool,
    /// Requests that control, with their numbers, of tools that came meanwhile: the drive would refuse them.
    kept: Vec<(Tool, u16, Vec<u8>)>,
    frames: Frames,
    /// What came last and could not be understood: a tool that comes later is to know.
    strange: Option<Vec<u8>>,
}

/// As the drive refuses who does not control it.
fn refused(tool: Tool, id: u16) -> To {
    To::Answered(tool, framed(&Reply { id, answer: Answer::Refused(Refusal::Controlled) }))
}

impl Hub {
    /// Without tools.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether nobody is there.
    pub fn is_empty(&self) -> bool {
        self.tools.is_empty()
    }

    /// A tool comes.
    pub fn attach(&mut self) -> (Tool, Option<To>) {
        self.last_tool += 1;
        self.tools.insert(self.last_tool, Wish::default());
        (self.last_tool, self.strange.clone().map(|frame| To::Told(self.last_tool, frame)))
    }

    /// A tool is gone. What it controlled is switched off.
    pub fn detach(&mut self, tool: Tool) -> Vec<To> {
        let mut out = Vec::new();
        let had = self.tools.remove(&tool).unwrap_or_default();
        // What was asked and is not answered yet may have begun.
        let begun = self.pending.iter().find_map(|one| match one.meaning {
            Meaning::Controls(how) if one.is_from(tool) => Some(how),
            _ => None,
        });
        let controls = match self.controller {
            Some((controller, how)) => (controller == tool).then_some(how),
            None => begun,
        };
        self.pending.retain(|one| !one.is_from(tool));
        self.kept.retain(|(from, ..)| *from != tool);
        if let Some(Control { client, .. }) = controls.filter(|how| how.attended) {
            self.brakes = true;
            out.extend([self.own(client, Ask::Speed(0.0), Meaning::Other), To::Later]);
        }
        self.controller = self.controller.filter(|(controller, _)| *controller != tool);
        if had.hz > 0.0 {
            let hz = self.fastest();
            out.push(self.own(NUMBER, Ask::Telemetry(hz), Meaning::Telemetry { hz, share: None }));
        }
        out
    }

    /// The motor of a tool that is gone has had its time to come to rest: off, unless someone has done it. Then others
    /// have their turn.
    pub fn braked(&mut self) -> Vec<To> {
        let off = std::mem::take(&mut self.brakes).then(|| self.own(NUMBER, Ask::Disarm, Meaning::Disarms));
        let kept = std::mem::take(&mut self.kept);
        off.into_iter().chain(kept.into_iter().flat_map(|(tool, _, frame)| self.ask(tool, frame))).collect()
    }

    /// A frame of a tool; nothing, where it has to wait. A motor that somebody switches off stays off: what waits is
    /// refused then.
    pub fn ask(&mut self, tool: Tool, frame: Vec<u8>) -> Vec<To> {
        let to = decoded(&frame, |request| match request {
            Ok(Request { id, ask, .. }) if self.brakes && ask.controls() => {
                if self.kept.len() == PENDING {
                    return vec![refused(tool, id)];
                }
                self.kept.push((tool, id, frame.clone()));
                Vec::new()
            }
            Ok(request) => {
                let off = request.ask == Ask::Disarm;
                let kept = if off { std::mem::take(&mut self.kept) } else { Vec::new() };
                let mut out = vec![self.request(tool, request)];
                out.extend(kept.into_iter().map(|(tool, id, _)| refused(tool, id)));
                out
            }
            // The drive's business: it may be of another version.
            Err(_) => vec![To::Drive(frame.clone())],
        });
        to.unwrap_or_else(|| vec![To::Drive(frame)])
    }

    fn request(&mut self, tool: Tool, request: Request<'_>) -> To {
        let id = self.next_id();
        let mut ask = request.ask;
        let meaning = match ask {
            Ask::Telemetry(hz) if (0.0..=1000.0).contains(&hz) => {
                let share = (hz > 0.0).then_some(Share { id: request.id, hz, due: 0.0, number: 0 });
                if let Some(wish) = self.tools.get_mut(&tool) {
                    wish.hz = hz;
                }
                let hz = self.fastest();
                ask = Ask::Telemetry(hz);
                Meaning::Telemetry { hz, share }
            }
            Ask::Disarm => Meaning::Disarms,
            Ask::Release => Meaning::Releases,
            ask if ask.controls() => {
                Meaning::Controls(Control { client: request.client, attended: !request.unattended })
            }
            _ => Meaning::Other,
        };
        self.wait(Pending { id, from: Some((tool, request.id)), meaning });
        To::Drive(framed(&Request { id, ask, ..request }))
    }

    /// A request of the hub itself.
    fn own(&mut self, client: u32, ask: Ask<'_>, meaning: Meaning) -> To {
        let id = self.next_id();
        self.wait(Pending { id, from: None, meaning });
        To::Drive(framed(&Request { id, client, unattended: false, ask }))
    }

    fn next_id(&mut self) -> u16 {
        self.last_id = self.last_id.wrapping_add(1);
        self.last_id
    }

    fn wait(&mut self, pending: Pending) {
        if self.pending.len() == PENDING {
            self.pending.pop_front();
        }
        self.pending.push_back(pending);
    }

    fn fastest(&self) -> f32 {
        self.tools.values().map(|wish| wish.hz).fold(0.0, f32::max)
    }

    /// Bytes of the drive.
    pub fn hear(&mut self, bytes: &[u8]) -> Vec<To> {
        let mut out = Vec::new();
        for &byte in bytes {
            if let Some(frame) = self.frames.push(byte) {
                self.frame(&frame, &mut out);
            }
        }
        out
    }

    fn frame(&mut self, frame: &[u8], out: &mut Vec<To>) {
        let mut decoder = Decoder::new();
        let (mut reply, mut understood) = (None, false);
        for &byte in frame {
            if let Some(Ok(Reply { id, answer })) = decoder.push::<Reply<'_>>(byte) {
                (understood, self.strange) = (true, None);
                match answer {
                    Answer::Telemetry(telemetry) => self.share(id, &telemetry, out),
                    answer => reply = self.answer(id, &answer),
                }
            }
        }
        out.extend(reply);
        if !understood {
            // Another version's, or no drive's: each tool says so in its words.
            out.extend(self.tools.keys().map(|&tool| To::Told(tool, frame.to_vec())));
            self.strange = Some(frame.to_vec());
        }
    }

    fn answer(&mut self, id: u16, answer: &Answer<'_>) -> Option<To> {
        let place = self.pending.iter().position(|pending| pending.id == id)?;
        let Pending { from, meaning, .. } = self.pending.remove(place)?;
        if let Meaning::Telemetry { hz, share } = meaning {
            // What came before the answer was of the rate before.
            self.stream = Some(Stream { id, hz, number: 0 });
            if let Some(wish) = from.and_then(|(tool, _)| self.tools.get_mut(&tool)) {
                wish.share = share;
            }
        }
        if meaning == Meaning::Disarms {
            (self.controller, self.brakes) = (None, false);
        }
        let (tool, id) = from?;
        match meaning {
            Meaning::Controls(how) if !matches!(answer, Answer::Refused(Refusal::Controlled)) => {
                self.controller = Some((tool, how));
            }
            Meaning::Releases => {
                self.controller = self.controller.filter(|(controller, _)| *controller != tool);
                // What was never answered is over, too.
                self.pending.retain(|one| !one.is_from(tool));
            }
            _ => {}
        }
        Some(To::Answered(tool, framed(&Reply { id, answer: *answer })))
    }

    fn share(&mut self, id: u16, telemetry: &Telemetry, out: &mut Vec<To>) {
        let Some(stream) = self.stream.as_mut().filter(|stream| stream.id == id) else { return };
        let frames = telemetry.number.wrapping_sub(stream.number);
        stream.number = telemetry.number;
        for (&tool, Wish { share, .. }) in &mut self.tools {
            let Some(share) = share else { continue };
            share.due += frames as f32 * (share.hz / stream.hz).min(1.0);
            // Rounding makes no frame come late.
            let whole = (share.due + 1e-3).floor();
            if whole >= 1.0 {
                share.due -= whole;
                share.number = share.number.wrapping_add(whole as u32);
                let telemetry = Telemetry { number: share.number, ..*telemetry };
                out.push(To::Told(tool, framed(&Reply { id: share.id, answer: Answer::Telemetry(telemetry) })));
            }
        }
    }
}
