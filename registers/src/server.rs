//! From a frame to what it does and to its reply.

use crate::FRAME;
use crate::axis::{Axis, Identity, Mode, State};
use crate::fields::Fields;
use crate::frame::{self, Bytes, Fault, Format, Number, SubFrame, SubFrames, Values};
use crate::register::{self, Content, Quantity};
use crate::tunnel::Tunnel;

/// The address that every drive listens to.
pub const BROADCAST: u8 = 0x7f;
/// What the meaning of all registers is numbered with.
const MAP_VERSION: i32 = 5;
/// The channel of the diagnostic text.
pub(crate) const DIAGNOSTIC: u32 = 1;

/// A frame to the drive, by whatever line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Identifier: prefix, whether a reply is wanted and the client's address, the drive's address.
    pub identifier: u32,
    /// The sub-frames.
    pub bytes: Bytes,
}

/// A frame from the drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Identifier: prefix, the drive's address, the client's address.
    pub identifier: u32,
    /// The sub-frames, not padded.
    pub bytes: Bytes,
}

/// Where the drive is on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// 1 to 126.
    pub id: u8,
    /// The bits of an identifier above the lowest 16; 13 of them.
    pub prefix: u16,
}

impl Address {
    /// Whether a frame is for this drive, by its identifier.
    pub const fn is_meant(self, identifier: u32) -> bool {
        let to = identifier as u8;
        identifier >> 16 == self.prefix as u32 && (to == self.id || to == BROADCAST)
    }
}

impl Default for Address {
    fn default() -> Self {
        Self { id: 1, prefix: 0 }
    }
}

/// The drive's end of the protocol.
#[derive(Clone, Debug)]
pub struct Server {
    address: Address,
    /// The last command that was obeyed.
    fields: Fields,
    /// The last packet of the stream, until it has arrived, and its number.
    packet: Bytes,
    number: u8,
}

/// What a frame is to do, before it does anything.
struct Plan {
    fields: Option<Fields>,
    output: Option<(f32, bool)>,
    reindex: bool,
    recapture: bool,
    refused: bool,
}

impl Server {
    /// Before the first frame.
    pub const fn new(address: Address) -> Self {
        Self { address, fields: Fields::of(0), packet: Bytes::new(), number: 0 }
    }

    /// Where the drive is.
    pub const fn address(&self) -> Address {
        self.address
    }

    /// Another address.
    pub const fn set_address(&mut self, address: Address) {
        self.address = address;
    }

    /// Whether a frame is for this drive.
    pub const fn is_for(&self, identifier: u32) -> bool {
        self.address.is_meant(identifier)
    }

    /// Does what a frame says. The reply, if there is one: a client has to want it, and there has to be something to
    /// say.
    pub fn handle(
        &mut self,
        request: &Request,
        axis: &mut (impl Axis + ?Sized),
        tunnel: &mut (impl Tunnel + ?Sized),
    ) -> Option<Reply> {
        if !self.is_for(request.identifier) {
            return None;
        }
        let bytes = meant(&request.bytes, &axis.identity())?;
        if SubFrames::of(bytes).any(|sub_frame| sub_frame.is_err()) {
            return None;
        }
        let source = (request.identifier >> 8) as u8;
        let wanted = source & 0x80 != 0;
        // A client takes a reply for one by its first byte, which an error's is not: errors come last.
        let (mut reply, mut errors) = (Bytes::new(), Bytes::new());
        self.write(bytes, axis, &mut errors);
        // What has no room is left out, and the client misses it.
        let _ = self.answer(bytes, axis, tunnel, wanted, &mut reply);
        let _ = reply.extend_from_slice(&errors);
        let Address { id, prefix } = self.address;
        let identifier = u32::from(prefix) << 16 | u32::from(id) << 8 | u32::from(source & 0x7f);
        (wanted && !reply.is_empty()).then_some(Reply { identifier, bytes: reply })
    }

    /// Everything that changes something: all of it, or nothing.
    fn write(&mut self, bytes: &[u8], axis: &mut (impl Axis + ?Sized), errors: &mut Bytes) {
        let mut plan = Plan { fields: None, output: None, reindex: false, recapture: false, refused: false };
        for sub_frame in SubFrames::of(bytes).flatten() {
            let SubFrame::Write(values) = sub_frame else { continue };
            plan.add(&values, errors);
        }
        if !plan.refused {
            self.execute(&plan, axis, errors);
        }
    }

    fn execute(&mut self, plan: &Plan, axis: &mut (impl Axis + ?Sized), errors: &mut Bytes) {
        let mut check = |register, done: bool| {
            if !done {
                let _ = frame::push_error(true, register, Fault::Refused, errors);
            }
            done
        };
        if let Some((position, nearest)) = plan.output {
            let register = if nearest { register::SET_OUTPUT_NEAREST } else { register::SET_OUTPUT_EXACT };
            if !check(register, axis.set_output(position, nearest).is_ok()) {
                return;
            }
        }
        if plan.reindex && !check(register::REQUIRE_REINDEX, axis.require_reindex().is_ok()) {
            return;
        }
        if let Some(fields) = plan.fields {
            let done = fields.command().and_then(|command| axis.command(&command)).is_ok();
            if !check(register::MODE, done) {
                return;
            }
            self.fields = fields;
        }
        if plan.recapture {
            check(register::RECAPTURE, axis.recapture().is_ok());
        }
    }

    /// What is read, and the stream.
    fn answer(
        &mut self,
        bytes: &[u8],
        axis: &mut (impl Axis + ?Sized),
        tunnel: &mut (impl Tunnel + ?Sized),
        wanted: bool,
        reply: &mut Bytes,
    ) -> Option<()> {
        let reads = Reads { state: axis.state(), identity: axis.identity(), fields: &self.fields, id: self.address.id };
        for sub_frame in SubFrames::of(bytes).flatten() {
            match sub_frame {
                SubFrame::Write(_) => {}
                SubFrame::Read { format, first, count } => reads.push(format, first, count, reply)?,
                SubFrame::ToDrive { channel: DIAGNOSTIC, bytes } => {
                    tunnel.receive(bytes);
                    if wanted {
                        frame::push_channel(DIAGNOSTIC, None, FRAME, reply, |room| tunnel.transmit(room))?;
                    }
                }
                SubFrame::Poll { channel: DIAGNOSTIC, most } if wanted => {
                    // Who polls without numbers does not ask for a packet again: a client that is gone may have left one.
                    self.packet.clear();
                    frame::push_channel(DIAGNOSTIC, None, most as usize, reply, |room| tunnel.transmit(room))?;
                }
                SubFrame::PollAfter { channel: DIAGNOSTIC, packet, most } if wanted => {
                    return push_packet(&mut self.packet, &mut self.number, packet, most, tunnel, reply);
                }
                // Of another channel there is nothing.
                SubFrame::ToDrive { channel, .. } | SubFrame::Poll { channel, .. } if wanted => {
                    frame::push_channel(channel, None, 0, reply, |_| 0)?;
                }
                SubFrame::ToDrive { .. } | SubFrame::Poll { .. } | SubFrame::PollAfter { .. } => {}
            }
        }
        Some(())
    }
}

/// The stream in numbered packets: a packet is sent again until the client names its number.
fn push_packet(
    packet: &mut Bytes,
    number: &mut u8,
    arrived: u8,
    most: u32,
    tunnel: &mut (impl Tunnel + ?Sized),
    reply: &mut Bytes,
) -> Option<()> {
    if arrived == *number || packet.is_empty() {
        let room = (most as usize).min(MOST_IN_PACKET);
        packet.resize(room, 0).ok()?;
        let filled = tunnel.transmit(packet).min(room);
        packet.truncate(filled);
        // An empty one needs no number of its own.
        if filled > 0 {
            *number = arrived.wrapping_add(1);
        } else {
            *number = arrived;
        }
    }
    frame::push_channel(DIAGNOSTIC, Some(*number), packet.len(), reply, |room| {
        room.iter_mut().zip(packet.iter()).for_each(|(place, byte)| *place = *byte);
        packet.len()
    })
}

/// Bytes of a packet: a frame without its kind, channel, number and length.
const MOST_IN_PACKET: usize = FRAME - 4;

/// The sub-frames after those that say for which drive they are; none where they are for another one.
fn meant<'a>(bytes: &'a [u8], identity: &Identity) -> Option<&'a [u8]> {
    let uuid = identity.uuid();
    for sub_frame in SubFrames::of(bytes) {
        let Ok(SubFrame::Write(values)) = sub_frame else { continue };
        for (register, number) in values.iter() {
            let Some(place) = register.checked_sub(register::UUID_MASK_1) else { continue };
            let Some(word) = uuid.get(place as usize) else { continue };
            if number != Number::Integer(*word as i32, Format::Int32) {
                return None;
            }
        }
    }
    Some(bytes)
}

impl Plan {
    /// Takes up values to write; and what is wrong with them.
    fn add(&mut self, values: &Values<'_>, errors: &mut Bytes) {
        for (register, number) in values.iter() {
            if let Err(fault) = self.set(register, number) {
                self.refused = true;
                if frame::push_error(true, register, fault, errors).is_none() {
                    return;
                }
            }
        }
    }

    fn set(&mut self, register: u32, number: Number) -> Result<(), Fault> {
        let format = match number {
            Number::Integer(_, format) => format,
            Number::Float(_) => Format::Float,
        };
        let content = register::decode(number, register::find(register, true, format)?);
        match (register, content) {
            (register::MODE, Content::Bits(mode)) => self.fields = Some(Fields::of(mode)),
            (register::SET_OUTPUT_NEAREST | register::SET_OUTPUT_EXACT, Content::Real(position)) => {
                if position.is_nan() {
                    return Err(Fault::Refused);
                }
                self.output = Some((position, register == register::SET_OUTPUT_NEAREST));
            }
            (register::REQUIRE_REINDEX, _) => self.reindex = true,
            (register::RECAPTURE, _) => self.recapture = true,
            (register::UUID_MASK_1..=register::UUID_MASK_4, _) => {}
            // The mode comes first.
            _ => self.fields.as_mut().ok_or(Fault::Refused)?.set(register, content)?,
        }
        Ok(())
    }
}

/// What registers are read from.
struct Reads<'a> {
    state: State,
    identity: Identity,
    fields: &'a Fields,
    id: u8,
}

impl Reads<'_> {
    /// Adds the replies to a read, or what is wrong with the registers. `None` where there is no room for all.
    fn push(&self, format: Format, first: u32, count: u32, reply: &mut Bytes) -> Option<()> {
        let end = first.saturating_add(count);
        let mut next = first;
        while next < end {
            let readable = (next..end).take(FRAME).take_while(|&number| self.get(number, format).is_ok()).count();
            if let Err(fault) = self.get(next, format) {
                frame::push_error(false, next, fault, reply)?;
                next += 1;
                continue;
            }
            // One that does not fit as a whole is left out as a whole.
            let length = reply.len();
            let run = next..next + readable as u32;
            next = run.end;
            if self.push_run(format, run, reply).is_none() {
                reply.truncate(length);
                return None;
            }
        }
        Some(())
    }

    fn push_run(&self, format: Format, run: core::ops::Range<u32>, reply: &mut Bytes) -> Option<()> {
        frame::push_reply(format, run.start, run.len() as u8, reply)?;
        for number in run {
            frame::push_number(self.get(number, format).ok()?, reply)?;
        }
        Some(())
    }

    fn get(&self, number: u32, format: Format) -> Result<Number, Fault> {
        let quantity = register::find(number, false, format)?;
        Ok(register::encode(self.content(number, quantity), quantity, format))
    }

    fn content(&self, number: u32, quantity: Quantity) -> Content {
        if matches!(quantity, Quantity::Integer | Quantity::Counter | Quantity::Word) {
            Content::Bits(self.bits(number))
        } else {
            Content::Real(self.fields.get(number).unwrap_or_else(|| self.real(number)))
        }
    }

    fn bits(&self, number: u32) -> i32 {
        let Self { state, identity, id, .. } = self;
        match number {
            register::MODE => state.mode as i32,
            register::TRAJECTORY_COMPLETE => state.trajectory_complete.into(),
            register::HOME_STATE => state.home.into(),
            register::FAULT => state.fault.into(),
            register::ENCODER_VALIDITY => validity(state),
            register::MILLISECONDS => state.milliseconds as i32,
            register::MODEL_NUMBER => identity.model as i32,
            register::FIRMWARE_VERSION => identity.firmware as i32,
            register::MAP_VERSION => MAP_VERSION,
            register::MULTIPLEX_ID => (*id).into(),
            register::SERIAL_NUMBER_1..=register::SERIAL_NUMBER_3 => {
                word(&identity.serial, number - register::SERIAL_NUMBER_1)
            }
            register::UUID_1..=register::UUID_4 => word(&identity.uuid(), number - register::UUID_1),
            register::UUID_MASK_CAPABLE => 1,
            register::BUS_TRANSMIT_ERRORS => state.bus.transmit.into(),
            register::BUS_RECEIVE_ERRORS => state.bus.receive.into(),
            register::BUS_PASSIVE => state.bus.passive.into(),
            register::BUS_OFF_COUNT => state.bus.off as i32,
            register::BUS_LOST_FRAMES => state.bus.lost as i32,
            _ => 0,
        }
    }

    fn real(&self, number: u32) -> f32 {
        let State { control: [position, velocity, torque], torques: [kp, ki, kd, forward], .. } = self.state;
        let state = &self.state;
        match number {
            register::POSITION => state.position,
            register::VELOCITY => state.velocity,
            register::TORQUE => state.torque,
            register::Q_CURRENT => state.current[1],
            register::D_CURRENT => state.current[0],
            register::ABSOLUTE_POSITION | register::ENCODER_1_POSITION => state.encoder[0],
            register::ENCODER_1_VELOCITY => state.encoder[1],
            register::ENCODER_0_POSITION => state.halls[0],
            register::ENCODER_0_VELOCITY => state.halls[1],
            register::POWER => state.power,
            register::MOTOR_TEMPERATURE => state.motor_temperature,
            register::VOLTAGE => state.voltage,
            register::TEMPERATURE => state.temperature,
            register::PROPORTIONAL_TORQUE => kp,
            register::INTEGRAL_TORQUE => ki,
            register::DERIVATIVE_TORQUE => kd,
            register::FEED_FORWARD_TORQUE => forward,
            register::CONTROL_POSITION => position,
            register::CONTROL_VELOCITY => velocity,
            register::CONTROL_TORQUE | register::TOTAL_TORQUE => torque,
            register::POSITION_ERROR => state.position - position,
            register::VELOCITY_ERROR => state.velocity - velocity,
            register::TORQUE_ERROR => state.torque - torque,
            _ => f32::NAN,
        }
    }
}

fn word(words: &[u32], place: u32) -> i32 {
    words.get(place as usize).map_or(0, |word| *word as i32)
}

/// A bit each for the position and the velocity of each encoder.
fn validity(state: &State) -> i32 {
    let [halls, encoder] = [state.halls, state.encoder].map(|values| values.map(|value| i32::from(!value.is_nan())));
    let sources = [halls[0], halls[1], encoder[0], encoder[1]];
    sources.iter().rev().fold(0, |bits, valid| bits << 1 | valid)
}

/// Whether a mode moves, or is about to.
impl Mode {
    /// Whether the bridge is on, or about to be.
    pub const fn drives(self) -> bool {
        !matches!(self, Self::Stopped | Self::Fault)
    }
}
