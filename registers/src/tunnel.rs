//! The stream of bytes that frames carry beside the registers: the diagnostic channel.

/// The drive's end of the stream.
pub trait Tunnel {
    /// Bytes from the client.
    fn receive(&mut self, bytes: &[u8]);

    /// Writes what is to go to the client and returns how many bytes; 0 where there is nothing.
    fn transmit(&mut self, buffer: &mut [u8]) -> usize;
}

/// Nobody listens.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoTunnel;

impl Tunnel for NoTunnel {
    fn receive(&mut self, _: &[u8]) {}

    fn transmit(&mut self, _: &mut [u8]) -> usize {
        0
    }
}
