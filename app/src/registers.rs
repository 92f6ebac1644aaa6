//! The register protocol that moteus clients speak, beside the messages of this project's own tools: on the same line
//! as text, and in frames of a bus.
//!
//! A client that commands is a tool that controls, as any other: while another one does, it is refused everything but
//! to stop.

mod axis;
mod channel;
mod goal;
mod sequence;

use crate::encoder::Encoder;
use crate::outbox::Outbox;
use crate::tasks::Tasks;
use axis::Drive;
use channel::{Channel, Pending};
use embedded_storage::nor_flash::NorFlash;
use hallservo_registers::axis::BusHealth;
use hallservo_registers::{Address, Reply, Request, Server, line};
use sequence::Sequence;

/// The number of register clients among the tools that control. A tool draws its own from all but 0, so hardly this
/// one.
const CLIENT: u32 = u32::MAX;

/// The drive's end of the protocol.
pub(crate) struct Registers {
    decoder: line::Decoder,
    server: Server,
    sequence: Sequence,
    id: u8,
    bus: BusHealth,
    channel: Channel,
    pending: Pending,
}

impl Registers {
    pub const fn new() -> Self {
        let address = Address { id: 1, prefix: 0 };
        Self {
            decoder: line::Decoder::new(),
            server: Server::new(address),
            sequence: Sequence::new(),
            id: address.id,
            bus: BusHealth::NONE,
            channel: Channel::new(),
            pending: Pending::new(),
        }
    }

    /// Where the drive is on the bus.
    pub const fn set_address(&mut self, address: Address) {
        self.server.set_address(address);
        self.id = address.id;
    }

    /// How the bus is.
    pub const fn set_bus_health(&mut self, health: BusHealth) {
        self.bus = health;
    }

    /// Whether the drive owes an answer: until then nobody else may command it.
    pub const fn waits(&self) -> bool {
        self.sequence.waits() || self.pending.waits()
    }

    /// Whether something is to be done that the drive has not been told.
    pub const fn has_wish(&self) -> bool {
        self.sequence.has_wish()
    }

    /// Where the drive is on the bus.
    pub const fn address(&self) -> Address {
        self.server.address()
    }

    /// Once a millisecond.
    // A stack frame of its own, which is not to add to what the tasks take.
    #[inline(never)]
    pub fn tick<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) {
        if !self.pending.waits() {
            self.sequence.tick(tasks);
        }
        if !self.sequence.waits() {
            let Self { sequence, id, bus, channel, pending, .. } = self;
            channel.tick(&mut Drive { tasks, sequence, id: *id, bus: *bus, pending });
        }
    }

    /// A byte of the line. What is to be said goes to the outbox, which [has room](Outbox::has_room).
    pub fn hear<F: NorFlash, E: Encoder>(&mut self, byte: u8, tasks: &mut Tasks<F, E>, outbox: &mut Outbox) {
        match self.decoder.push(byte) {
            None => {}
            Some(Err(error)) => outbox.push_line(&line::error(error)),
            Some(Ok(request)) => {
                // Frames of another protocol in between would end a client.
                tasks.stream(0, 0.0);
                outbox.push_line(&line::ok());
                if let Some(reply) = self.handle(&request, tasks) {
                    outbox.push_line(&line::reply(&reply));
                }
            }
        }
    }

    /// A frame of any line, and its reply.
    #[inline(never)]
    pub fn handle<F: NorFlash, E: Encoder>(&mut self, request: &Request, tasks: &mut Tasks<F, E>) -> Option<Reply> {
        let Self { server, sequence, id, bus, channel, pending, .. } = self;
        if server.is_for(request.identifier) {
            tasks.controller.hear(CLIENT, tasks.now_ms);
        }
        let mut drive = Drive { tasks, sequence, id: *id, bus: *bus, pending };
        let reply = server.handle(request, &mut drive, channel.tunnel());
        channel.serve(&mut drive);
        reply
    }
}
