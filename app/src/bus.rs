//! A bus that carries the frames of registers, such as CAN-FD.

pub use hallservo_registers::axis::BusHealth;
use hallservo_registers::{Address, Reply, Request};

/// The drive's end of a bus.
#[allow(async_fn_in_trait)]
pub trait Bus {
    /// The next frame for this drive, or for all.
    async fn receive(&mut self) -> Request;

    /// Sends a frame, or gives it up if that takes too long.
    async fn send(&mut self, reply: &Reply);

    /// Where the drive is on the bus from now on.
    fn listen(&mut self, address: Address);

    /// Called every [`LOOK_MS`] or more often while no frames come: time to get back on a bus that was left.
    fn look_after(&mut self);

    /// How it is.
    fn health(&self) -> BusHealth;
}

/// From look to look where no frame comes, ms.
pub const LOOK_MS: u64 = 100;

/// There is none.
pub struct NoBus;

impl Bus for NoBus {
    async fn receive(&mut self) -> Request {
        core::future::pending().await
    }

    async fn send(&mut self, _: &Reply) {}

    fn listen(&mut self, _: Address) {}

    fn look_after(&mut self) {}

    fn health(&self) -> BusHealth {
        BusHealth::NONE
    }
}
